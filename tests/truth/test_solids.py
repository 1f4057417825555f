"""Blocks in two dimensions against the bars that they are, and against critical steps found by other means."""

import math

import numpy as np
import pytest

import percuss
from blocks import SEAM, alone, bar, block, impact, loaded, plane_at
from marks import deep
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.results.ledger import angular_momentum_summary, open_accounts

WU = "wu-predictor-corrector"


@pytest.mark.parametrize(
    ("cells", "pairing"),
    [
        *(("tri3", pairing) for pairing in ("node-to-segment", "gauss-points", "mortar")),
        *(deep("tet4", pairing) for pairing in ("node-to-segment", "gauss-points")),
    ],
)
def test_simplices_tend_to_the_bar_with_the_first_order(cells, pairing):
    """The nodes at the edges of the end faces have other masses than a bar has there; of triangles 1/3 and 2/3."""
    counts, courant, width, largest, within = {
        "tri3": ((10, 20, 40), 0.4, [0.2], 0.05, 0.015), "tet4": ((10, 20), 0.2, [0.2, 0.2], 0.15, 0.05),
    }[cells]  # fmt: skip
    errors, area = [], math.prod(width)
    for count in counts:
        elements, sides = [count] + [count // 5] * len(width), (("left", 0.0, 0.5), ("right", 1.0, -0.5))
        solids = {name: block(at, speed, elements, cells=cells, size=[1.0, *width]) for name, at, speed in sides}
        bars = {name: bar(at, speed, count, area) for name, at, speed in sides}
        found, expected = (
            impact(bodies, WU, "regularised-lagrange", courant / count, of).arrays["contact_force"]
            for bodies, of in ((solids, pairing), (bars, None))
        )
        errors.append(np.abs(found - expected).max() / (0.5 * area))
    assert errors[0] < largest
    assert np.array(errors[1:]) / errors[:-1] == pytest.approx(0.5, abs=within)


HUNDRED = {"time": {"step": 0.02, "steps": 100}, "record": {"probes": ["a.right", "a.left"]}}


def pushed(load, cells="quad4", **more):
    body = block(0.0, 0.0, [20, 4], 0.0, cells, thickness=0.5, **more)
    return percuss.run(alone(body, loads={"push": load}, **HUNDRED))


@pytest.mark.parametrize("cells", ["quad4", "tri3"])
def test_pressure_traction_and_force_on_an_edge_are_the_same_load(cells):
    pressure = pushed({"constant": 3.0, "on": "a.right", "as": "pressure"}, cells)
    traction = pushed({"constant": 3.0, "on": "a.right", "as": "traction", "direction": [-1.0, 0.0]}, cells)
    force = pushed({"constant": 3.0 * 0.2 * 0.5, "on": "a.right", "direction": [-1.0, 0.0]}, cells)
    for other in (traction, force):
        scale = np.abs(other.arrays["displacement"]).max()
        assert np.abs(pressure.arrays["displacement"] - other.arrays["displacement"]).max() < 1e-13 * scale


def test_a_block_that_is_turned_is_the_block_in_that_direction():
    """A quarter of a turn about the middle, with speed, support and contact turned as well."""
    forces = []
    turned = {"angle": 90.0, "at": [-0.4, 0.4], "velocity": [0.0, 0.5]}
    for body, wall in (({}, [1.1, 0.0]), (turned, [0.0, 1.1])):
        case = alone({**block(0.0, 0.5, [20, 4], 0.3, "tri3"), **body}, wall, time={"courant": 0.5, "end": 2.5})
        forces.append(percuss.run(case).arrays["contact_force"])
    assert forces[0].max() > 0.05
    assert np.abs(forces[0] - forces[1]).max() < 1e-10 * forces[0].max()


@pytest.mark.parametrize("cells", ["quad4", "tri3"])
def test_spin_turns_a_body_about_its_centre_of_mass(cells):
    body = {**block(0.0, 0.0, [20, 4], 0.3, cells), "spin": 0.01, "angle": 30.0, "velocity": [0.2, -0.1]}
    case = alone(body, time={"courant": 0.5, "steps": 20})
    model, result = model_of(case), percuss.run(case)
    mass, nodes = model.bodies.mass, model.bodies["a"].mesh.nodes
    arm = nodes - mass @ nodes / mass.sum()
    turning = 0.5 * 0.01**2 * float(mass @ (arm**2).sum(axis=1))
    if cells == "quad4":  # of lumped masses each cell has that of its corners: h^2/4 more a direction than a rectangle
        assert float(mass @ (arm**2).sum(axis=1)) == pytest.approx(
            0.2 / 12.0 * (1.0 + 0.04) + 0.2 * 2 * (0.05**2 / 4 - 0.05**2 / 12), rel=1e-12
        )
    energy = result.summary["energy"]
    assert energy["initial"] == pytest.approx(0.5 * 0.2 * (0.2**2 + 0.1**2) + turning, rel=1e-12)
    assert result.summary["momentum"]["initial"] == pytest.approx([0.2 * 0.2, -0.1 * 0.2], abs=1e-15)
    assert energy["ledger_closed"]
    angular = result.summary["angular_momentum"]
    assert angular["initial"] == pytest.approx([2.0 * turning / 0.01], rel=1e-12)
    assert angular["final"] == pytest.approx(angular["initial"], rel=1e-12)


def cross(place, force):
    return float((place[..., 0] * force[..., 1] - place[..., 1] * force[..., 0]).sum())


@pytest.mark.parametrize("integrator", [deep(WU), "velocity-verlet"])
def test_angular_momentum_is_balanced_by_the_moments_of_impulses(integrator):
    """A turned block meets another one that stands, and both have loads: of each impulse the moment is counted."""
    bodies = {
        "left": block(0.0, 0.5, [10, 4], 0.3, "tri3", spin=0.02),
        "right": block([1.0, 0.05], 0.0, [10, 6], 0.3, fixed=[{"on": "bottom", "along": "y"}]),
    }
    loads = {
        "push": {"constant": 0.02, "on": "left.top", "as": "pressure"}, "weight": {"gravity": [0.03, -0.1]},
    }  # fmt: skip
    contacts = {**SEAM, "wall": {"body": "right.right", "wall": plane_at([2.01, 0.0], [-1.0, 0.0])}}
    method = {"integrator": integrator, "contact": {"name": "penalty", "beta_s": 0.25}}
    case = loaded(bodies, contacts, method, {"courant": 0.5, "end": 1.5}, loads=loads)
    model, march = model_of(case), March(model_of(case))
    outcome = march.run()
    nodes, mass = model.bodies.nodes - mean_place(model.bodies.nodes, model.bodies.mass), model.bodies.mass[:, None]
    found = percuss.run(case).summary["angular_momentum"]
    for velocity, told in ((outcome.starting_velocity, "initial"), (outcome.final_velocity, "final")):
        assert found[told] == pytest.approx([cross(nodes, mass * velocity.reshape(-1, 2))], rel=1e-12)
    duration = march.model.steps * model.dt
    push = [0.02 * duration * cross(nodes[one.node], one.force) for one in model.loads.nodal_forces]
    weight = duration * cross(nodes, mass * np.array([0.03, -0.1]))
    assert found["impulse_of_loads"] == pytest.approx([sum(push) + weight], rel=0.05)  # half a step at the start
    for name in ("impulse_of_loads", "impulse_of_supports", "impulse_of_contacts"):
        assert abs(found[name][0]) > 1e-5
    assert found["balanced"]
    assert found["error"] < 1e-13
    turned = outcome.final_velocity.reshape(-1, 2)
    turned += 1e-6 * np.stack([-nodes[:, 1], nodes[:, 0]], axis=1)
    open_account = angular_momentum_summary(march, outcome, 1e-3)
    assert open_account["balanced"] is False
    accounts = {**percuss.run(case).summary, "angular_momentum": open_account}
    assert any("angular momentum does not balance" in words for words in open_accounts(accounts))


def mean_place(nodes, mass):
    return mass @ nodes / mass.sum()


@pytest.mark.parametrize("shape", [{}, {"cells": "tri3"}, {"size": [1, 1, 1], "elements": [1, 1, 1]}])
def test_cells_that_are_turned_inside_out_are_told(shape):
    """The first of them at the first snapshot that shows any, or at the end."""
    dim = len(shape.get("size", [1, 1]))
    body = block(0, -6, **{"elements": [2, 1], "size": [1, 1], **shape})
    wall = plane_at([0] * dim, [1, 0, 0][:dim])
    case = alone(body, wall, "left", time={"courant": 0.5, "end": 6})
    said = "body 'a' has cells turned inside out, "
    slow = percuss.run(case, {"bodies.a.velocity": [-0.1, 0, 0][:dim]}).summary["notes"]
    assert not any(said in note for note in slow)
    result = percuss.run(case, {"record.fields": 100})
    fields = result.fields
    moved = fields["node_position"].values + fields["displacement"].values
    corners = moved[:, fields["cell_nodes"].values]
    if corners.shape[2:] == (8, 3):
        corners = corners[:, :, :4]  # a cube of one cell moves as its lower face
    (ax, ay), (bx, by) = (np.moveaxis(corners[..., k, :2] - corners[..., 0, :2], -1, 0) for k in (1, -1))
    twice_area = ax * by - ay * bx
    first = int(np.argmax((twice_area <= 0.0).any(axis=1)))
    assert first > 0
    (note,) = (note for note in result.summary["notes"] if said in note)
    assert f"at t = {float(fields['time'][first]):.4g}, the first about (" in note
    at_end = percuss.run(case, {"time.end": float(fields["time"][first])}).summary["notes"]
    assert any(said in note for note in at_end)


@pytest.mark.parametrize("cells", ["quad4", "tri3"])
def test_a_probe_at_a_point_moves_as_its_cell(cells):
    """On a node its motion, elsewhere a mean of those around, at the middle of the edge that of both its nodes."""
    body = {**block(0.0, 0.5, [10, 2], 0.3, cells), "angle": 10.0}
    nodes = model_of(alone(body)).bodies["a"].mesh.nodes
    spots = [nodes[7], 0.5 * (nodes[7] + nodes[10]), nodes[[7, 8, 11, 10]].mean(axis=0)]
    probes = ["a.left", *({"body": "a", "at": spot.tolist()} for spot in spots)]
    case = alone(body, [1.01, 0.1], time={"courant": 0.5, "end": 1.0}, record={"probes": probes})
    outcome = March(model_of(case)).run()
    u = outcome.final_displacement.reshape(-1, 2)
    middle = u[[7, 8, 11, 10]].mean(axis=0) if cells == "quad4" else 0.5 * (u[7] + u[11])
    found = outcome.record.displacement[outcome.records - 1].reshape(-1, 2)
    assert found[1:] == pytest.approx(np.array([u[7], 0.5 * (u[7] + u[10]), middle]), abs=1e-12)
    assert np.ptp(found[1:], axis=0).max() > 1e-4


LOCKS = "body 'a' is almost incompressible, where quad4 locks: it is too stiff"
TURNS = "Its turn of 0.12 rad is seen as a stretch of 0.72 %: the result is wrong."
# longer by 1/cos of the angle of a real body: sqrt(1 + angle^2)
SPINNING = block(0.0, 0.0, [10, 4], 0.3, spin=0.03)
THICK, LONG = "times as long as it is thick", [20, 1]
TOLD = [
    (SPINNING, 1.5, TURNS, False),
    (SPINNING, 4.0, TURNS, True),
    *((block(0.0, 0.1, [4, 2], poisson, plane=plane), 0.1, LOCKS, warned)
      for poisson, plane, warned in ((0.44, "strain", False), (0.46, "strain", True), (0.49, "stress", False))),
    # no more than what a cantilever shows: see the test of a slender beam of one-point elements
    (block(0.0, 0.0, [20, 4], size=LONG, angle=30), 0.1, f"1 {THICK}", True),
    (block(0.0, 0.0, [40, 1], size=LONG), 0.1, THICK, False),
    (block(0.0, 0.0, [2, 1], size=[4, 1]), 0.1, THICK, False),
    (block(0.0, 0.0, [20, 4], size=LONG, element="quad4-one-point"), 0.1, THICK, False),
    (block(1.0, 0.0, [20, 4], size=LONG, plane="axisymmetric"), 0.1, THICK, False),
    deep(block(0.0, 0.0, [2, 2, 10], size=[1, 2, 20], cells="tet4"), 0.1, f"2 {THICK}", True),
]  # fmt: skip


@pytest.mark.parametrize(("body", "end", "said", "warned"), TOLD)
def test_a_run_and_its_check_warn_of_bodies_that_turn_lock_or_have_long_cells(body, end, said, warned):
    case = alone(body, time={"courant": 0.5, "end": end})
    assert sum(said in note for note in percuss.run(case).summary["notes"]) == warned
    assert (said in str(percuss.check(case))) is warned


def test_methods_that_a_case_leaves_out_are_those_of_solids():
    pair = {"left": block(0.0, 0.5, [20, 4]), "right": block(1.0, -0.5, [20, 6])}
    case = loaded(pair, SEAM)
    assert (case.method.contact.name, case.method.pairing.name) == ("lagrange", "mortar")
    assert case.contacts["tip"].pairing.name == "mortar"
    case = loaded(pair, SEAM, {"contact": "lagrange", "pairing": "node-to-segment"})
    assert (case.contacts["tip"].law.name, case.contacts["tip"].pairing.name) == ("lagrange", "node-to-segment")


def test_a_load_on_an_edge_is_spread_and_a_support_holds_it():
    body = block(0.0, 0.0, [10, 3], 0.3, fixed=["left"])
    loads = {"pull": {"constant": 0.01, "on": "a.right", "direction": [1.0, 0.0]}}
    time = {"courant": 0.5, "end": 3.0}
    result = percuss.run(alone(body, loads=loads, time=time, record={"probes": ["a.right", "a.left"]}))
    assert result.summary["energy"]["ledger_closed"]
    assert result.summary["momentum"]["balanced"]
    pulled, held = result.arrays["displacement"].transpose(1, 0, 2)
    assert (held == 0.0).all()
    assert np.abs(pulled[:, 1]).max() < 1e-2 * pulled[:, 0].max()
    # twice the static elongation (1 - nu^2) F L / (E A), a little less as the held edge cannot contract
    assert pulled[:, 0].max() == pytest.approx(2.0 * 0.91 * 0.01 / 0.2, rel=0.05)


def test_a_wall_that_is_oblique_to_a_bar_is_refused():
    line = {**bar(0.0, 0.5), "at": [0.0, 0.0]}
    with pytest.raises(percuss.InputError, match="expected a wall across the bar, found one of the normal"):
        model_of(alone(line, plane_at([1.1, 0.0], [1, 1])))


# ------------------------------------------------------------------------------------------------ forces of supports


def supported(integrator="central-difference", friction=True, **more):
    """Return a case of a block that falls on another one, which rollers and its bottom hold, and that is drawn along.

    The bottom holds the lower left corner too, whose roller has it first.
    """
    bodies = {
        "base": block(0.0, 0.0, [3, 2], 0.3, size=[1.0, 1.0], fixed=[{"on": "left", "along": "x"}, "bottom"]),
        "top": block([0.1, 1.0], [0.01, -0.02], [3, 2], 0.3, size=[0.8, 0.5]),
    }
    drive = {"prescribed-velocity": 0.05, "on": "top.right", "direction": [1.0, 0.0]}
    loads = {
        "weight": {"gravity": [0.0, -0.01]},
        "draw": {**drive, "from": 0.5, "until": 1.3}, "again": {**drive, "from": 2.1},
    }  # fmt: skip
    rubs = {"friction": {"name": "coulomb", "mu": 0.3}} if friction else {}
    method = {"integrator": integrator, "contact": "penalty", "pairing": "node-to-segment", **rubs}
    contacts = {"seam": {"between": ["top.bottom", "base.top"]}}
    return loaded(bodies, contacts, method, {"courant": 0.6, "end": 3.0}, loads=loads, **more)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize(("integrator", "friction"), [("central-difference", True), (WU, True), ("noh-bathe", False)])
def test_the_force_of_each_support_makes_up_its_impulse(integrator, friction, compiled):
    """Four supports, two of which act for some time, are all of the balance of momentum."""
    result = percuss.run(supported(integrator, friction), compiled=compiled)
    names, summary = ["base.left", "base.bottom", "draw", "again"], result.summary
    assert list(result.histories.support_force.support) == list(summary["supports"]) == names
    force = result.arrays["support_force"][:-1]  # the last record is a step beyond the end
    impulses = np.array([list(summary["supports"][name].values()) for name in names])
    assert summary["dt"] * force.sum(axis=0) == pytest.approx(impulses, abs=1e-15)
    assert impulses.sum(axis=0) == pytest.approx(summary["momentum"]["impulse_of_supports"], abs=1e-15)
    assert summary["momentum"]["error"] < 1e-13
    assert np.abs(force).max(axis=0)[[0, 1, 2, 3], [0, 1, 0, 0]].min() > 5e-4
    assert not force[:, 2:, 1].any()
    if integrator != "noh-bathe":  # whose first step after a drive still begins with the acceleration that it kept
        middle = result.arrays["time"][:-1] + 0.5 * summary["dt"]  # where the velocity is prescribed
        for k, (start, stop) in enumerate(((0.5, 1.3), (2.1, 9.0)), start=2):
            assert np.array_equal(force[:, k, 0] != 0.0, (middle > start) & (middle < stop))


def test_a_case_expects_the_force_and_the_impulse_of_a_support():
    """Over the whole run the integral of the force is the impulse, of a region and of a prescribed motion."""
    result = percuss.run(supported(), compiled=False)
    expect = []
    for support, component in (("base.bottom", 1), ("draw", 0)):
        name, given = f"impulse_{'xyz'[component]}", {"within": "1e-7%", "source": "exact"}
        impulse = result.summary["supports"][support][name]
        force = {"quantity": "support_force", "support": support, "component": component, "integral": impulse}
        expect += [force | given, {"quantity": f"supports.{support}.{name}", "value": impulse} | given]
    checks = percuss.verify(supported(expect=expect), result)
    assert [check.passed for check in checks] == [True] * 4, checks
    assert repr(checks[2]).startswith("<passed: integral of support_force of draw ")


def test_rare_records_of_supports_are_those_of_every_step():
    every, rare = (percuss.run(supported(**more)).arrays for more in ({}, {"record": {"every": 4}}))
    steps = np.searchsorted(every["time"], rare["time"])
    assert np.array_equal(rare["support_force"], every["support_force"][steps])


def test_a_support_gives_its_block_the_momentum_that_gravity_does_not():
    """A block at rest is let go on its held bottom: the force swings about its weight, and its impulse is exact."""
    result = percuss.run(
        alone(block(0.0, 0.0, [4, 8], 0.3, size=[0.5, 1.0], fixed=["bottom"]), time={"courant": 0.8, "end": 40.0},
              loads={"weight": {"gravity": [0.0, -1e-3]}})
    )  # fmt: skip
    summary, force = result.summary, result.arrays["support_force"][:, 0]
    impulse, momentum = np.array(list(summary["supports"]["a.bottom"].values())), summary["momentum"]
    gained = np.array(momentum["final"]) - momentum["initial"] - momentum["impulse_of_loads"]
    assert impulse == pytest.approx(gained, abs=1e-15)
    weight = 0.5 * 1e-3
    assert force[0] == pytest.approx([0.0, weight / 16], rel=1e-12, abs=1e-18)  # of the nodes that it holds
    assert force[:, 1].mean() == pytest.approx(weight, rel=0.02)
    assert force[:, 1].max() > 1.8 * weight


@pytest.mark.parametrize("drawn", [0.0, 0.3])
def test_a_drive_gives_a_free_block_the_momentum_of_each_step(drawn):
    """Of the whole block, as runs of 10 and of 11 steps have it."""
    drive = {"prescribed-velocity": 0.03, "on": "a.left", "direction": [0.6, 0.8], "from": drawn}
    cases = [
        alone(block(0.0, 0.0, [4, 3], 0.3), time={"step": 0.05, "steps": steps}, loads={"draw": drive})
        for steps in (10, 11)
    ]
    before, after = (percuss.run(case) for case in cases)
    momenta = (np.array(result.summary["momentum"]["final"]) for result in (before, after))
    change = -next(momenta) + next(momenta)
    assert after.arrays["support_force"][10, 0] == pytest.approx(change / 0.05, rel=1e-9)
    assert np.abs(change).min() > 1e-6


def test_a_case_without_supports_has_none():
    result = percuss.run(alone(block(0.0, 0.1, [4, 3])))
    assert "support_force" not in result.arrays
    assert "supports" not in result.summary
    assert "support" not in result.coordinates
