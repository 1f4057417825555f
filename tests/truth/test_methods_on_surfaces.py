"""Every law with every integrator and pairing on two blocks, regions in two contacts, corners, and tied blocks."""

import itertools

import numpy as np
import pytest

import percuss
from blocks import bar, block, loaded
from percuss.contact.laws import parameters
from percuss.march.model_of_case import model_of
from strategies import CORE, REGISTRY, is_refused

WU, CENTRAL = "wu-predictor-corrector", "central-difference"
NODES, GAUSS, MORTAR = "node-to-segment", "gauss-points", "mortar"
FIRST_OPTIONS = {name: next(iter(REGISTRY.get("contacts", name).examples), {}) for name in REGISTRY.names("contacts")}


def strip(at, speed, elements, size=(1.0, 0.4), poisson=0.3, **more):
    return block(at, speed, elements, poisson, size=size, **more)


def case(bodies, contacts, integrator=WU, law=None, pairing=MORTAR, end=4.0, **more):
    method = {"integrator": integrator, "contact": law or "regularised-lagrange", "pairing": pairing}
    return loaded(bodies, contacts, method, more.pop("time", {"courant": 0.4, "end": end}), **more)


def line_of(at, speed, area=0.4, **more):
    return bar(at, speed, 10, area, **more)


# What does not go together on surfaces, beside what pairs of methods refuse each other whatever the bodies.
SEAM = {"s": {"between": ["a.right", "b.left"]}}
NOT_BUILT = {
    "asynchronous": "It works for bars only",
    "nitsche": "has no compliance and is not evaluated at the end of the step, which works for bars only",
    "uzawa": "uses the coupling of contacts, which works for bars only",
    "energy-conserving-penalty": "uses the coupling of contacts, which works for bars only",
}
RIGID = {"lagrange", "moreau-jean", "paoli-schatzman", "tied"}
QUICK = {
    (WU, "tied", MORTAR), (WU, "cohesive", GAUSS), (CENTRAL, "walton-braun", NODES), ("noh-bathe", "penalty", MORTAR),
    ("asynchronous", "penalty", MORTAR), (WU, "uzawa", MORTAR), (WU, "moreau-jean", GAUSS),
}  # fmt: skip
INTEGRATORS, LAWS, PAIRINGS = map(REGISTRY.names, ("integrators", "contacts", "pairings"))
# Each integrator with each law, on pairings in turn, so that each of them meets each pairing: a pairing makes the rows
# of the points, and neither integrators nor laws know which one made them.
ALL = [
    (integrator, law, PAIRINGS[(i + k) % len(PAIRINGS)])
    for (i, integrator), (k, law) in itertools.product(enumerate(INTEGRATORS), enumerate(LAWS))
]


def mark_of(integrator, law, _pairing):
    """Deep is each law with an integrator of each state that it can see, and each integrator with a penalty."""
    return pytest.mark.deep if integrator in CORE or law == "penalty" else pytest.mark.nightly


@pytest.mark.parametrize(
    ("integrator", "law", "pairing"),
    [
        *sorted(QUICK),
        *(pytest.param(*each, marks=mark_of(*each)) for each in ALL if each not in QUICK),
    ],
)
def test_each_method_runs_with_closed_accounts_or_is_refused_with_a_reason(integrator, law, pairing):
    pair = {"a": strip((0, 0), (0.01, 0.02), (6, 2)), "b": strip((1, 0), (-0.01, 0.02), (6, 3))}
    made = case(pair, SEAM, integrator, {"name": law, **FIRST_OPTIONS[law]}, pairing)
    reasons = [why for name, why in NOT_BUILT.items() if name in (integrator, law)]
    if law in RIGID and pairing == GAUSS:
        reasons.append("expected a law with a compliance on gauss-points")
    if is_refused(integrator, {"name": law, **FIRST_OPTIONS[law]}):
        reasons = ["is refused by"]
    if reasons:
        with pytest.raises(percuss.PercussError) as refusal:
            percuss.run(made)
        assert all(why in str(refusal.value) for why in reasons)
        return
    result = percuss.run(made)
    summary = result.summary
    assert summary["energy"]["ledger_closed"] in (True, None)  # None: what a multi-stage scheme takes is no error
    assert summary["momentum"]["balanced"]
    assert summary["angular_momentum"]["balanced"]
    assert summary["energy_growth"]["kept"] is not False
    assert summary["contacts"]["s"]["impulse"] != 0.0


# ---------------------------------------------------------------------------- regions in two contacts, and corners


@pytest.mark.parametrize("pairing", [NODES, GAUSS, MORTAR])
def test_a_block_in_a_corner_is_a_bar_along_each_wall(pairing):
    """Without contraction its motion along one axis knows nothing of the other; one node touches both walls."""
    square = {"a": strip((0, 0), (-0.01, -0.02), (10, 10), (1.0, 1.0), 0.0)}
    walls = {
        "left": {"body": "a.left", "wall": {"point": [-0.01, 0.0], "normal": [1.0, 0.0]}},
        "floor": {"body": "a.bottom", "wall": {"point": [0.0, -0.01], "normal": [0.0, 1.0]}},
    }
    found = percuss.run(case(square, walls, pairing=pairing, record={"probes": ["a.right", "a.top"]}))
    u, forces = found.arrays["displacement"], found.arrays["contact_force"]
    for k, (contact, speed) in enumerate((("left", -0.01), ("floor", -0.02))):
        line = percuss.run(case(
            {"a": line_of(0.0, speed, 1.0)}, {"w": {"body": "a.left", "wall": -0.01}}, record={"probes": ["a.right"]}
        ))  # fmt: skip
        force = line.arrays["contact_force"][:, 0]
        assert np.abs(forces[:, k] - force).max() < 1e-10 * force.max(), contact
        along = line.arrays["displacement"][:, 0, 0]
        assert np.abs(u[:, k, k] - along).max() < 1e-12 * np.abs(along).max()
    assert found.summary["angular_momentum"]["balanced"]


@pytest.mark.parametrize("pairing", [NODES, GAUSS, MORTAR])
def test_a_region_in_two_contacts_presses_both_as_one_bar(pairing):
    """A strip meets two half as wide, whose ends meet its middle node: together they are one bar, half of it each."""
    bodies = {
        "a": strip((0, 0), (0.5, 0), (10, 4), (1.0, 0.4), 0.0),
        "low": strip((1, 0), (-0.5, 0), (10, 2), (1.0, 0.2), 0.0),
        "high": strip((1, 0.2), (-0.5, 0), (10, 2), (1.0, 0.2), 0.0),
    }
    seams = {"below": {"between": ["low.left", "a.right"]}, "above": {"between": ["high.left", "a.right"]}}
    found = percuss.run(case(bodies, seams, pairing=pairing, end=2.5))
    line = percuss.run(case({"a": line_of(0.0, 0.5), "b": line_of(1.0, -0.5)}, SEAM, end=2.5))
    force = line.arrays["contact_force"][:, 0]
    assert force.max() > 0.1
    for k in range(2):
        assert np.abs(found.arrays["contact_force"][:, k] - 0.5 * force).max() < 1e-10 * force.max()
    assert found.summary["energy"]["ledger_closed"]


# --------------------------------------------------------------------------------------------------------- ties


@pytest.mark.parametrize("integrator", [WU, CENTRAL])
@pytest.mark.parametrize("pairing", [NODES, MORTAR])
def test_blocks_that_are_tied_are_one_block(integrator, pairing):
    """Between rollers, where no shear arises at the seam: a tie holds what is normal to it."""
    rollers = {"fixed": [{"on": "bottom", "along": "y"}, {"on": "top", "along": "y"}]}
    load = {"push": {"ramp": {"value": 0.01, "duration": 0.5}, "on": "a.left", "as": "pressure"}}
    halves = {"a": strip((0, 0), (0, 0), (10, 4), **rollers), "b": strip((1, 0), (0, 0), (10, 4), **rollers)}
    whole = {"a": strip((0, 0), (0, 0), (20, 4), (2.0, 0.4), **rollers)}
    watched = {"time": {"step": 0.02, "end": 4.0}, "record": {"probes": ["a.left"]}}
    found, expected = (
        percuss.run(case(bodies, contacts, integrator, "tied", pairing, loads=load, **watched))
        for bodies, contacts in ((halves, SEAM), (whole, {}))
    )
    u, of_one = found.arrays["displacement"], expected.arrays["displacement"]
    assert of_one.max() > 1e-3
    assert np.abs(u - of_one).max() < 1e-12 * np.abs(of_one).max()
    assert found.summary["energy"]["ledger_closed"]


@pytest.mark.parametrize("across", [(4, 4), (3, 5)])
def test_tied_prisms_of_unlike_meshes_are_one_bar(across):
    halves = {
        "a": strip((0, 0), (0.5, 0), (10, across[0]), poisson=0.0),
        "b": strip((1, 0), (0, 0), (10, across[1]), poisson=0.0),
    }
    watched = {"record": {"probes": ["a.left", "b.right"]}, "time": {"step": 0.02, "end": 4.0}}
    bars = {"a": line_of(0.0, 0.5), "b": line_of(1.0, 0.0)}
    found, line = (percuss.run(case(bodies, SEAM, law="tied", **watched)) for bodies in (halves, bars))
    u, along = found.arrays["displacement"], line.arrays["displacement"][..., 0]
    assert line.arrays["contact_force"].min() < -0.05  # it pulls, too
    assert np.abs(u[..., 0] - along).max() < 1e-10 * np.abs(along).max()
    assert np.abs(u[..., 1]).max() < 1e-10 * np.abs(along).max()


@pytest.mark.parametrize("pairing", [NODES, GAUSS, MORTAR])
@pytest.mark.parametrize("cells", ["quad4", "tri3", "hex8", "tet4", "rings"])
def test_the_areas_of_two_contacts_side_by_side_add_up_to_the_face(cells, pairing):
    """Two blocks side by side meet a face of a third one: a node or an edge of it lies at the corner of both."""
    space, rings = cells in {"hex8", "tet4"}, cells == "rings"
    kind, depth = "quad4" if rings else cells, [0.7] if space else []

    def body(at, height, elements):
        size, count = [1.0, height], [2, elements]
        if rings:  # the face is the right one of a ring, whose radius does not change along it
            at = [at[0] + 1.0, at[1]]
        at = [at[0], at[1] - 0.2, *(0.1 for _ in depth)]
        return strip(at, 0.0, count + [3] * space, size + depth, 0.0, cells=kind,
                     **({"plane": "axisymmetric"} if rings else {}))  # fmt: skip

    bodies = {"a": body([0.0, 0.0], 1.0, 8), "b": body([1.0, 0.0], 0.5, 3), "c": body([1.0, 0.5], 0.5, 4)}
    contacts = {f"a{name}": {"between": ["a.right", f"{name}.left"]} for name in ("b", "c")}
    model = model_of(case(bodies, contacts, pairing=pairing))
    whole = model.bodies["a"].area_of("right")
    for name in contacts:
        area = model.contact_points.weight[np.array(model.contact_points.names) == name].sum()
        assert area == pytest.approx(0.5 * whole, rel=1e-9)


@pytest.mark.parametrize("pairing", [NODES, MORTAR])
def test_a_node_at_the_end_of_the_other_face_has_the_area_that_lies_over_it(pairing):
    bodies = {"a": strip([0.0, 0.0], [0.1, 0.0], (4, 8), (1.0, 0.8)), "b": strip([1.0, 0.2], [0.0, 0.0], (4, 4))}
    model = model_of(case(bodies, SEAM, pairing=pairing))
    assert model.contact_points.weight == pytest.approx([0.05, 0.1, 0.1, 0.1, 0.05], rel=1e-9)


@pytest.mark.parametrize(
    ("law", "per_area", "totals"),
    [
        ({"name": "cohesive", "strength": 0.04, "length": 0.2}, ("strength",), ("energy_to_break",)),
        ({"name": "damped-penalty", "damping": 0.1}, (), ("coefficient",)),
        ({"name": "penalty", "beta_s": "auto"}, (), ()),
        ({"name": "walton-braun", "restitution": 0.5}, (), ()),
        ({"name": "softened-penalty", "clearance": 0.01, "pressure": 0.02}, ("pressure",), ()),
    ],
    ids=lambda value: value["name"] if isinstance(value, dict) else "",
)
def test_the_parameters_of_a_contact_of_surfaces_are_those_of_bars_of_its_area(law, per_area, totals):
    """What is per area is times the area that of bars; a total is that of the contact, not of its first point."""
    area = 0.4
    bodies = {
        name: strip([at, 0.0], [speed, 0.0], (10, 4), poisson=0.0) for name, at, speed in (("a", 0, 0.1), ("b", 1, 0))
    }
    blocks = case(bodies, SEAM, CENTRAL, law, NODES)
    of_bars = law | {name: area * law[name] for name in per_area}
    bars = case({"a": line_of(0.0, 0.1, area), "b": line_of(1.0, 0.0, area)}, SEAM, CENTRAL, of_bars, None)
    of_blocks, of_bars = (parameters(model_of(one))["s"] for one in (blocks, bars))
    assert of_blocks.keys() == of_bars.keys()
    assert of_blocks.pop("law") == of_bars.pop("law")
    for name, value in of_blocks.items():
        times = 1.0 if name in {*totals, "beta_s"} else area
        assert times * value == pytest.approx(of_bars[name], rel=1e-12), name


@pytest.mark.parametrize(("key", "values"), [("thickness", (1.0, 2.0)), ("plane", ("strain", "stress"))])
def test_two_bodies_of_unequal_thickness_or_plane_are_noted(key, values):
    one, other = (
        strip([at, 0.0], [0.0, 0.0], (2, 2), **{key: value}) for at, value in zip((0, 1), values, strict=True)
    )
    found = case({"a": one, "b": other}, SEAM, end=0.1)
    assert sum("unequal" in note for note in percuss.run(found).summary["notes"]) == 1
