"""Surfaces that slide far: identities with small sliding, balances, the bound of the energy, points that come back."""

import itertools

import numpy as np
import pytest

import accounts
import corners
import percuss
import places
from accounts import ran
from marks import deep
from percuss.contact.moving_rows import stiffness_of_points
from percuss.contact.sliding import surfaces_of
from percuss.jit import plain
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.step.actions import BEFORE_CONTACT
from percuss.step.loop import keep
from percuss.step.parts import sliding

WU, CD = "wu-predictor-corrector", "central-difference"
COULOMB = {"name": "coulomb", "mu": 0.3}
PAIRED = (("gauss-points", "regularised-lagrange"), ("node-to-segment", "lagrange"))
IN_THE_PLANE = (*PAIRED, ("mortar", "lagrange"), ("mortar", "regularised-lagrange"))
PAIRINGS = ("node-to-segment", "gauss-points", "mortar")
LAWS_AT_THE_END = ("lagrange", "regularised-lagrange")
KERNEL_LAWS = ("damped-penalty", "hunt-crossley")
SOLID = {"young": 1.0, "density": 1.0, "poisson": 0.3}


def balanced(result):
    """Return a result whose accounts close to round-off and whose guarantee is kept."""
    summary = accounts.balanced(result).summary
    assert summary["angular_momentum"]["error"] < 1e-12
    assert summary["energy_growth"]["kept"] is not False
    return result


def two_blocks(
    pairing="node-to-segment",
    law="lagrange",
    scheme=WU,
    *,
    sliding="large",
    velocity=(0.3, -0.05),
    at=(0.1, 0.5),
    elements=((10, 3), (7, 3)),
    sizes=((2.0, 0.5), (1.0, 0.5)),
    friction="none",
    end=2.0,
    courant=0.5,
    turn=0.0,
    material=SOLID,
    **more,
):
    """Return a block that slides over another one; `turn` tilts the upper one about its lower left corner."""
    lower = {"block": {"size": list(sizes[0]), "elements": list(elements[0])}, "at": [0.0, 0.0], "material": material}
    upper = {"block": {"size": list(sizes[1]), "elements": list(elements[1])}, "at": list(at), "material": material}
    if turn:
        upper["angle"] = turn
    return {
        "percuss": 1,
        "bodies": {"lower": lower, "upper": upper | {"velocity": list(velocity)}},
        "contacts": {"seam": {"between": ["upper.bottom", "lower.top"], "sliding": sliding, "friction": friction}},
        "method": {"integrator": scheme, "contact": law, "pairing": pairing},
        "time": {"end": end, "courant": courant},
        **more,
    }


# ---------------------------------------------------------------------------------------- identities with small sliding


def wave(sliding, pairing, law, scheme, poisson):
    """Return two blocks that meet head on, held across by rollers where they would widen."""
    rollers = {"fixed": [{"on": "left", "along": "x"}, {"on": "right", "along": "x"}]} if poisson else {}
    case = two_blocks(
        pairing, law, scheme, sliding=sliding, velocity=(0.0, -0.1), at=(0.0, 1.0), elements=((4, 8), (4, 8)),
        sizes=((0.4, 1.0), (0.4, 1.0)), end=3.0, courant=0.9, material=SOLID | {"poisson": poisson},
    )  # fmt: skip
    return {**case, "bodies": {name: body | rollers for name, body in case["bodies"].items()}}


@pytest.mark.parametrize("poisson", [0.0, 0.3])
@pytest.mark.parametrize("pairing", PAIRINGS)
@pytest.mark.parametrize(
    ("scheme", "law"), [(WU, "regularised-lagrange"), (CD, {"name": "penalty", "beta_s": 0.25}), (WU, "lagrange")]
)
def test_without_a_slide_it_is_small_sliding(poisson, pairing, scheme, law):
    """A plane wave moves no point along its surface: the rows of each step are those of the start."""
    if (law, pairing) == ("lagrange", "gauss-points"):
        return
    small, large = (ran(wave(sliding, pairing, law, scheme, poisson)) for sliding in ("small", "large"))
    for name in ("contact_force", "kinetic_energy", "gap"):
        of_small, of_large = small.arrays[name], large.arrays[name]
        assert np.abs(of_small - of_large).max() < 2e-12 * np.abs(of_small).max(), name
    assert balanced(large).arrays["contact_force"].max() > 0.0


@pytest.mark.parametrize("pairing", PAIRINGS)
@pytest.mark.parametrize("friction", ["none", COULOMB])
def test_a_held_body_is_a_wall_however_far_a_block_slides(pairing, friction):
    """It slides over eleven facets of another mesh, all of whose nodes are held."""
    case = two_blocks(
        pairing, "regularised-lagrange", velocity=(1.0, -0.05), sizes=((4.0, 0.5), (1.0, 0.5)),
        elements=((17, 1), (4, 2)), friction=friction, end=2.5,
    )  # fmt: skip
    case["bodies"]["lower"] |= {"fixed": ["left", "right", "top", "bottom"]}
    at_wall = {**case, "bodies": {"upper": case["bodies"]["upper"]}}
    wall = {"point": [0, 0.5], "normal": [0, 1]}
    at_wall["contacts"] = {"seam": {"body": "upper.bottom", "wall": wall, "friction": friction, "sliding": "large"}}
    on_body, on_wall = balanced(ran(case)), balanced(ran(at_wall))
    for name in ("contact_force", "kinetic_energy"):
        of_wall = on_wall.arrays[name]
        assert np.abs(of_wall - on_body.arrays[name]).max() < 1e-11 * np.abs(of_wall).max(), name
    assert on_wall.arrays["contact_force"].max() > 0.0
    impulses = (on_body.summary["momentum"]["impulse_of_supports"], on_wall.summary["momentum"]["impulse_of_walls"])
    assert np.allclose(*impulses, rtol=1e-9, atol=1e-12)


# -------------------------------------------------------------------------------------------------- balances and energy


@pytest.mark.parametrize("pairing", PAIRINGS)
@pytest.mark.parametrize(
    ("scheme", "law"),
    [(WU, "lagrange"), deep(CD, "lagrange"), (WU, "regularised-lagrange"), (CD, "penalty"), deep(WU, "penalty"),
     deep(CD, "bipenalty"), deep(WU, "bipenalty"), deep(CD, "damped-penalty"), deep(CD, "hunt-crossley")],
)  # fmt: skip
@pytest.mark.parametrize("friction", ["none", COULOMB])
def test_accounts_close_while_blocks_slide(pairing, scheme, law, friction):
    if (law, pairing) == ("lagrange", "gauss-points") or (pairing == "mortar" and law in KERNEL_LAWS):
        return
    result = balanced(ran(two_blocks(pairing, law, scheme, friction=friction, turn=2.0, at=(0.1, 0.52))))
    assert result.arrays["contact_force"].max() > 0.0
    assert result.summary["bodies"]["upper"]["velocity_x"] < 0.3 or friction == "none"


ENERGIES = [("gauss-points", "regularised-lagrange"), *itertools.product(PAIRINGS[::2], LAWS_AT_THE_END)]


@pytest.mark.parametrize(("pairing", "law"), ENERGIES)
@pytest.mark.parametrize("seed", [deep(seed) if seed > 1 else seed for seed in range(20)])
@pytest.mark.parametrize("friction", ["none", deep(COULOMB)])
def test_energy_is_bounded_by_the_renewal_of_rows(pairing, law, seed, friction):
    """Of drawn tilted blocks, work and stored energy of the contact never exceed the bound that the run computes."""
    random = np.random.default_rng(seed)
    turn, shift = random.uniform(-4.0, 4.0), random.uniform(0.9, 1.6)
    case = two_blocks(
        pairing, law, velocity=(random.uniform(0.1, 0.6), -random.uniform(0.05, 0.2)), turn=turn, friction=friction,
        at=(shift, 0.5 + 1.01 * abs(np.sin(np.radians(turn)))), end=4.0, elements=((9, 3), (random.integers(3, 8), 3)),
    )  # fmt: skip
    result = balanced(ran(case))
    growth, energy = result.summary["energy_growth"], result.summary["energy"]
    assert growth["guarantee"] == "bounded by the renewal of rows"
    assert growth["kept"] is True
    assert result.arrays["contact_force"].max() > 0.0
    assert energy["renewal"] >= 0.0


@pytest.mark.parametrize("sides", [["ball.skin", "floor.top"], ["floor.top", "ball.skin"]])
@pytest.mark.parametrize("elements", [16, 64])
def test_a_disk_slides_over_a_floor_by_mortar(sides, elements):
    """Facets on its flanks look along the floor, and meet nothing."""
    disk = {"disk": {"radius": 0.5, "elements": 8}, "at": [0.0, 1.05], "velocity": [0.3, -0.1], "material": SOLID}
    floor = {"block": {"size": [4.0, 0.5], "elements": [elements, 2]}, "at": [-1.0, 0.0], "material": SOLID}
    case = {
        "percuss": 1,
        "bodies": {"ball": disk, "floor": floor | {"fixed": ["bottom"]}},
        "contacts": {"seam": {"between": sides, "sliding": "large"}},
        "method": {"integrator": WU, "contact": "lagrange", "pairing": "mortar"},
        "time": {"end": 6.0, "courant": 0.5},
    }
    result = balanced(ran(case))
    assert result.summary["energy_growth"]["kept"] is True
    assert result.summary["energy"]["max"] < 1.05 * result.summary["energy"]["initial"]
    assert result.summary["contacts"]["seam"]["first_closed"] == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("pairing", ["node-to-segment", "mortar"])
def test_a_block_that_leaves_points_behind_gains_nothing(pairing):
    """A point that has lost its partner moves no node in the sweeps of the next step."""
    result = balanced(percuss.run(percuss.load(places.CASES / "slide-off.yaml", {"method.pairing": pairing})))
    assert result.summary["energy_growth"]["kept"] is True
    assert result.summary["contacts"]["seam"]["returned_points"] > 1


# ------------------------------------------------------------------------------------------------------------- partners


def solids(dim, first, second, **more):
    """Return two bodies near each other, the first one with its points on all of its boundary."""
    bodies = {"a": first | {"material": SOLID}, "b": second | {"material": SOLID}}
    contacts = {
        "seam": {"between": [more.pop("on", "a.skin"), more.pop("of", "b.skin")], "sliding": "large", "overlap": "keep"}
    }
    method = {"contact": "regularised-lagrange", "pairing": "node-to-segment"}
    time = {"steps": 1, "courant": 0.5}
    return {"percuss": 1, "bodies": bodies, "contacts": contacts, "method": method, "time": time, **more}


MEETINGS = {
    "disks": solids(
        2, {"disk": {"radius": 1, "elements": 8}, "at": [0, 0]},
        {"disk": {"radius": 0.7, "elements": 6}, "at": [1.04, 1.32]},
    ),
    "corner": solids(
        2, {"block": {"size": [1, 1], "elements": [5, 5]}, "at": [0, 0]},
        {"block": {"size": [1, 1], "elements": [3, 3]}, "at": [1.13, 0.4], "angle": 40.0}, on="a.right", of="b.left",
    ),
    "tilted": solids(
        2, {"block": {"size": [1, 1], "elements": [5, 2]}, "at": [0, 0]},
        {"block": {"size": [1.2, 1], "elements": [7, 2]}, "at": [0.45, 1.2], "angle": 14.0}, on="a.top", of="b.bottom",
    ),
    "balls": solids(
        3, {"ball": {"radius": 1, "elements": 4}, "at": [0, 0, 0]},
        {"ball": {"radius": 0.8, "elements": 6}, "at": [1.15, 1.05, 0.86]},
    ),
    "tetrahedra": solids(
        3, {"block": {"size": [1, 1, 1], "elements": [3, 3, 3], "cells": "tet4"}, "at": [0, 0, 0]},
        {"block": {"size": [1, 1, 1], "elements": [2, 2, 2], "cells": "tet4"}, "at": [0.3, 0.2, 1.1]}, on="a.top",
        of="b.bottom",
    ),
}  # fmt: skip
MET = [
    deep(pairing, name) if name == "balls" else (pairing, name)  # many points, in plain Python
    for pairing in PAIRINGS
    for name in MEETINGS
    if pairing != "mortar" or name in {"tilted", "corner"}
]


def the_part(march):
    """Return what slides of a march."""
    (data,) = (one.data for one in march.arrays.parts if isinstance(one, sliding.Sliding))
    return data


def rows_now(case, pairing, moved=None):
    """Return a model, and the points that slide, in a step that begins with displacements `moved`."""
    model = model_of(percuss.load(case, {"method.pairing": pairing}))
    march = March(model, compiled=False)
    if moved is not None:
        march.u[:] = moved
    keep(march.arrays.step.boundary, march.u, march.v)
    for part in march.arrays.parts:
        for action in part.actions() if isinstance(part, sliding.Sliding) else ():
            if action.place == BEFORE_CONTACT:
                plain(action.kernel, action.slots)(action.data, 0, march.u, march.v, march.v)
    return model, the_part(march)


def as_paired(model, moved):
    """Return the points that the pairing finds on the surfaces where they are."""
    (spec,) = model.case.contacts.values()
    surfaces = surfaces_of(spec, model.bodies)
    return spec.pairing.points(*(there(one, moved) for one in surfaces))


def there(surface, moved):
    """Return a surface whose nodes have moved."""
    surface, width = surface._replace(positions=surface.positions + moved[surface.nodes]), surface.facets.shape[1]
    out = surface.outward(np.arange(len(surface.facets)), np.full(surface.facets.shape, 1.0 / width))
    return surface._replace(normals=out / np.linalg.norm(out, axis=1)[:, None])


def assert_as_paired(model, data, moved):
    """Assert that gaps and rows of all points that have a partner are those that the pairing finds.

    A point that is farther away than the next search has but one candidate.
    """
    expected, points, dofs = as_paired(model, moved.reshape(-1, model.dim)), data.points, data.boundary["dof"]
    rows = np.zeros((expected.gap.size, model.bodies.n_nodes, model.dim))
    for p in range(expected.gap.size):
        entries = slice(expected.start[p], expected.start[p + 1])
        np.add.at(rows[p], expected.node[entries], expected.value[entries])
    has = np.flatnonzero(data.partners.partner != sliding.NOBODY)
    (mean,) = (spec.pairing.renews for spec in model.case.contacts.values())
    assert has.size == expected.gap.size
    for s, row, gap in zip(has, rows, expected.gap, strict=True):
        mine = points.row[data.which[s]]
        if gap > 0.5 * data.partners.skin[s]:
            continue
        entries = points.entries[mine.start : mine.stop]
        value = np.zeros(moved.size)
        np.add.at(value, dofs[entries["place"]], entries["normal"])
        assert np.abs(value - row.ravel()).max() < 1e-9
        if gap > 0.0 or model.dim not in mean:  # where surfaces overlap, a mortar gap at the start is their depth
            assert mine.initial_gap + value @ moved.ravel() - data.offset[s] == pytest.approx(gap, abs=1e-12)


@pytest.mark.parametrize(("pairing", "name"), MET)
@pytest.mark.parametrize("size", [0.0, 0.02])
def test_rows_of_a_step_are_those_that_the_pairing_finds_there(pairing, name, size):
    """At corners and edges too, on moved and distorted surfaces."""
    model = model_of(percuss.load(MEETINGS[name], {"method.pairing": pairing}))
    moved = size * np.random.default_rng(1).standard_normal(model.bodies.n_nodes * model.dim)
    assert_as_paired(*rows_now(MEETINGS[name], pairing, moved), moved)


def bodies_on_their_way(name):
    """Return bodies that pass each other, touching, some facets wide."""
    case = MEETINGS[name]
    speed = [0.6, -0.3] if case["bodies"]["a"].get("disk") else [0.7, -0.1, 0.2][: len(case["bodies"]["a"]["at"])]
    if len(speed) < len(case["bodies"]["a"]["at"]):
        speed = [0.6, -0.1, -0.2]
    bodies = {**case["bodies"], "b": case["bodies"]["b"] | {"velocity": speed, "material": SOLID | {"young": 30.0}}}
    return {**case, "bodies": bodies, "time": {"end": 0.9, "courant": 0.5}}


@pytest.mark.parametrize(("pairing", "name"), MET)
def test_no_candidate_is_missed_on_the_way(pairing, name):
    """After many steps with few searches the partners are still the nearest of all facets."""
    model = model_of(percuss.load(bodies_on_their_way(name), {"method.pairing": pairing}))
    march = March(model)
    outcome = march.run()
    assert outcome.status == "done"
    assert_as_paired(model, the_part(march), outcome.final_displacement)


@pytest.mark.parametrize("name", ["disks", deep("balls")])
def test_the_gap_changes_along_its_row(name):
    """The derivative of the gap by displacements is the row of the point, away from where its partner changes."""
    random = np.random.default_rng(2)
    model = model_of(percuss.load(MEETINGS[name]))
    way, step = random.standard_normal(model.bodies.n_nodes * model.dim), 1e-6
    gaps = []
    for moved in (-step, step):
        _, data = rows_now(MEETINGS[name], "node-to-segment", moved * way)
        rows = data.points.row[data.which]
        gaps.append([row.initial_gap + along(data.points, row, data.boundary, moved * way) for row in rows])
    _, data = rows_now(MEETINGS[name], "node-to-segment")
    points = data.points
    slopes = (np.array(gaps[1]) - np.array(gaps[0])) / (2.0 * step)
    rows = np.array([along(points, row, data.boundary, way) for row in points.row[data.which]])
    has = data.partners.partner != sliding.NOBODY
    agrees = np.abs(slopes - rows)[has] < 1e-4 * np.abs(way).max()
    assert agrees.mean() > 0.9  # at a few points the partner changes
    assert has.sum() > 15


def along(points, row, boundary, motion):
    """Return what the row of a point measures of a motion."""
    entries = points.entries[row.start : row.stop]
    return entries["normal"] @ motion[boundary["dof"][entries["place"]]]


# -------------------------------------------------------------------------------------------------- invariance and bits


def dragged(dim, turn=None, law="regularised-lagrange", pairing="gauss-points", friction=COULOMB, cells=None):
    """Return a block that is thrown obliquely over another one, all turned by a matrix."""
    turn = np.eye(dim) if turn is None else turn
    shape = {"cells": cells} if cells else {}

    def of(*numbers):
        """Return the first numbers and the last one."""
        return [*numbers[: dim - 1], numbers[-1]]

    way = of(0.4, 0.25, -0.1)
    lower = {"block": {"size": of(2.0, 1.6, 0.4), "elements": of(6, 5, 2), **shape}, "at": [0.0] * dim}
    upper = {"block": {"size": of(1.0, 1.0, 0.4), "elements": of(4, 4, 2), **shape}, "at": of(0.2, 0.1, 0.4)}
    upper |= {"velocity": way}
    case = {
        "percuss": 1,
        "bodies": {"lower": lower | {"material": SOLID}, "upper": upper | {"material": SOLID}},
        "contacts": {"seam": {"between": ["upper.bottom", "lower.top"], "sliding": "large", "friction": friction}},
        "method": {"integrator": WU, "contact": law, "pairing": pairing},
        "time": {"end": 1.2, "courant": 0.5},
    }
    if dim == 2 and (turn != np.eye(2)).any():
        angle = float(np.degrees(np.arctan2(turn[1, 0], turn[0, 0])))
        for body in case["bodies"].values():
            extent = np.array(body["block"]["size"])
            body["at"] = (turn @ (np.array(body["at"]) + 0.5 * extent) - 0.5 * extent).tolist()
            body |= {"angle": angle}
        upper_now = case["bodies"]["upper"]
        upper_now["velocity"] = (turn @ np.array(way)).tolist()
    return case


@pytest.mark.parametrize("angle", [10.0, 90.0, 200.0, 350.0])
@pytest.mark.parametrize(("pairing", "law"), IN_THE_PLANE)
def test_blocks_that_are_turned_make_the_same_run(angle, pairing, law):
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    straight, turned = (balanced(ran(dragged(2, turn, law, pairing))) for turn in (None, np.array([[c, -s], [s, c]])))
    for name in ("contact_force", "kinetic_energy", "friction_work"):
        assert np.abs(straight.arrays[name] - turned.arrays[name]).max() < 1e-10 * np.abs(straight.arrays[name]).max()


@pytest.mark.parametrize("cells", [None, "tet4"])
@pytest.mark.parametrize(("pairing", "law"), PAIRED)
def test_accounts_close_in_space(pairing, law, cells):
    result = balanced(ran(dragged(3, None, law, pairing, cells=cells)))
    assert result.arrays["contact_force"].max() > 0.0
    assert result.arrays["friction_work"].min() < 0.0


@pytest.mark.parametrize("pairing", ["node-to-segment", "mortar"])
def test_the_bound_of_the_energy_is_that_of_the_last_record(pairing):
    """Whose energies are those half a step behind the last one."""
    case = percuss.load(dragged(2, None, "lagrange", pairing), {"time.end": 0.4})
    model = model_of(case)
    grown = np.diff(March(model).run().histories["renewal"].sum(axis=1)) > 0.0
    last = int(np.flatnonzero(grown)[-2]) + 1  # a step that has a term
    books = March(model_of(case.with_overrides({"time.end": last * model.dt}))).run().histories
    assert books["renewal_so_far"].tolist() == books["renewal"][-1].tolist() != books["renewal"][-2].tolist()


@pytest.mark.parametrize("pairing", ["node-to-segment", "mortar"])
def test_a_run_goes_on_bit_for_bit_and_in_plain_python(pairing):
    """State that a killed run would have saved is all that it needs; plain Python differs by round-off."""
    case = percuss.load(dragged(2, None, "lagrange", pairing), {"time.end": 0.4})
    whole, plain = percuss.run(case), percuss.run(case, compiled=False)
    forces = whole.arrays["contact_force"], plain.arrays["contact_force"]
    assert np.abs(forces[0] - forces[1]).max() < 1e-12 * np.abs(forces[0]).max()
    model = model_of(case)
    march, other = March(model), March(model)
    outcome = march.run()
    other.compile()
    other._start_stepper()
    half = model.steps // 2
    other.advance(other.stepper.amplitudes(0, half), 0, half)
    saved, third = other._saved_state(), March(model)
    third.compile()
    third._start_stepper()
    third._restore_state(saved)
    rest = model.steps - half
    third.advance(third.stepper.amplitudes(half, rest), half, rest)
    assert outcome.done == model.steps
    assert (third._displacement(model.steps) == outcome.final_displacement).all()


@pytest.mark.parametrize(
    ("law", "scheme", "energy", "said"),
    [
        ("lagrange", WU, "bounded by the renewal of rows", "as stable at every position"),
        ({"name": "penalty", "beta_s": 0.25}, CD, "not guaranteed", "each step by itself is stable at every position"),
        ({"name": "penalty", "beta_s": 1.2}, CD, "not guaranteed", "no step by itself is shown to be stable"),
        deep({"name": "hunt-crossley"}, CD, "not guaranteed", "no bound at every position is known"),
    ],
)
def test_what_is_known_of_the_step(law, scheme, energy, said):
    """The product of steps is unknown; each by itself has a bound, which no step of the run exceeds."""
    case = percuss.load(two_blocks("node-to-segment", law, scheme, turn=2.0, at=(0.1, 0.52), courant=0.7))
    summary = percuss.run(case).summary
    certificate, seam = summary["certificate"], summary["contacts"]["seam"]
    assert certificate["stable"] == "unknown"
    assert certificate["states"]["closed later"] == "unknown"
    assert certificate["energy"] == energy
    assert said in certificate["why"].lower()
    assert (summary["energy"]["renewal"] is None) == (energy == "not guaranteed")
    stiffness = stiffness_of_points(model_of(case))
    if (stiffness > 0.0).any():
        model = model_of(case)
        per_area = (stiffness / model.contact_points.weight).max()
        assert 0.0 < seam["stiffness_bound"] <= 2.0 * per_area * model.largest_response("seam")


@pytest.mark.parametrize("shift", [0.0, deep(0.03), deep(0.08), 0.137])
@pytest.mark.parametrize("pairing", PAIRINGS)
@pytest.mark.parametrize(("dim", "cells"), [(2, None), (2, "tri3"), (3, None), (3, "tet4")])
def test_the_bound_at_every_position_is_above_the_largest_eigenvalue(shift, pairing, dim, cells):
    """Of S W with the rows of drawn positions, on meshes of 5 to 7 facets."""
    if (pairing, dim) == ("mortar", 3):
        return
    shape = {"cells": cells} if cells else {}
    first = {"block": {"size": [1.0] * dim, "elements": [5] * (dim - 1) + [3], **shape}}
    second = {"block": {"size": [1.0] * dim, "elements": [7] * (dim - 1) + [3], **shape}, "at": [0.0] * dim}
    at = [*[shift, 0.7 * shift][: dim - 1], 1.0]
    case = solids(dim, first | {"at": at}, second, on="a.bottom", of="b.top")
    model, data = rows_now(case, pairing)
    rows, dofs = np.zeros((model.bodies.n_nodes * dim, data.which.size)), data.boundary["dof"]
    for s in range(data.which.size):
        row = data.points.row[data.which[s]]
        entries = data.points.entries[row.start : row.stop]
        np.add.at(rows[:, s], dofs[entries["place"]], entries["normal"])
    weighted = rows * np.sqrt(data.points.row["weight"][data.which])
    largest = np.linalg.eigvalsh(weighted.T @ (weighted / model.bodies.mass_of_dofs[:, None]))[-1]
    bound = model.largest_response("seam")
    assert largest <= bound * (1.0 + 1e-12)
    assert bound < 8.0 * largest * max(one.pairing.mean_bound for one in model.case.contacts.values())


def came_back(pairing, law):
    """Return a block that overhangs another one and slides back over it, pressed."""
    case = two_blocks(
        pairing, law, velocity=(-0.2, -0.1), at=(0.35, 0.5205), sizes=((1.0, 0.5), (1.0, 0.5)),
        elements=((10, 5), (7, 5)), turn=2.3, end=6.0,
    )  # fmt: skip
    case["contacts"]["seam"]["between"] = ["lower.top", "upper.bottom"]
    return case


@pytest.mark.parametrize(("pairing", "law"), IN_THE_PLANE)
def test_points_that_come_back_are_not_thrown_out(pairing, law):
    """A point that lies inside the surface to which it comes back keeps that overlap; else energy rises by .03."""
    result = balanced(ran(came_back(pairing, law)))
    energy, seam = result.summary["energy"], result.summary["contacts"]["seam"]
    assert seam["returned_points"] > 1
    assert energy["max"] <= energy["initial"] * (1.0 + 1e-4)
    # A mortar mean goes on beyond the covered part of a facet, and changes as less is covered.
    assert energy["renewal"] < (2e-2 if pairing == "mortar" else 3e-3) * energy["initial"]
    assert [note for note in result.summary["notes"] if "came back" in note]


@pytest.mark.parametrize("overlap", ["refuse", "keep", "press"])
def test_an_overlap_at_the_start(overlap):
    """It is refused with its depth, kept without a force, or presses the bodies apart."""
    case = two_blocks(velocity=(0.0, 0.0), at=(0.1, 0.49), end=0.5)
    case["contacts"]["seam"]["overlap"] = overlap
    if overlap == "refuse":
        with pytest.raises(percuss.InputError, match=r"overlap of 0\.01"):
            ran(case)
        return
    result = balanced(ran(case))
    force = result.arrays["contact_force"]
    assert (force.max() > 1e-3) if overlap == "press" else (force == 0.0).all()
    assert any("0.01 deep, presses" in note for note in result.summary["notes"]) == (overlap == "press")


def test_points_that_meet_nothing_are_told():
    """A block that has slid off another one: no gap, no force, and points that are alone in the snapshots."""
    case = two_blocks(velocity=(0.5, 0.0), at=(0.5, 0.5), sizes=((1.0, 0.5), (1.0, 0.5)), end=2.0, friction=COULOMB)
    case |= {"record": {"fields": 5, "pressure": True}, "loads": {"weight": {"constant": 0.01, "on": "upper"}}}
    case["loads"]["weight"] |= {"direction": [0, -1], "as": "acceleration"}
    case["bodies"]["lower"] |= {"fixed": ["bottom"]}
    result = balanced(ran(case))
    status, gap = np.array(result.field_arrays["point_status"]), result.arrays["gap"][:, 0]
    assert np.isnan(gap[-1])
    assert not np.isnan(gap[0])
    assert (status[-1] == 3.0).all()
    assert {2.0, 3.0} <= set(status[0].tolist())


@pytest.mark.parametrize("order", corners.ORDERS)
def test_a_corner_that_falls_on_a_face_closes_when_it_reaches_it(order):
    """Mortar, with the corner first and with the face first."""
    case = corners.falling(10, corners.ORDERS[order])
    case["contacts"]["hit"]["sliding"] = "large"
    result = ran(case)
    assert result.summary["contacts"]["hit"]["first_closed"] == pytest.approx(
        corners.GAP / corners.SPEED, abs=result.summary["dt"]
    )


SQUARE = """$MeshFormat
2.2 0 8
$EndMeshFormat
$Nodes
4
1 0 0 0
2 1 1 0
3 0 2 0
4 -1 1 0
$EndNodes
$Elements
1
1 3 2 0 1 1 2 3 4
$EndElements
"""


@pytest.mark.parametrize(("angle", "between", "told"), [(0, 0, 0), (0, 1, 1), (20, 1, 1), (44, 1, 0)])
def test_a_corner_that_mortar_may_see_late_is_told(tmp_path, angle, between, told):
    """Both of its sides are in the second surface, and point at the first one."""
    (tmp_path / "square.msh").write_text(SQUARE, encoding="utf-8")
    bodies = {
        "floor": {"block": {"size": [4.0, 0.5], "elements": [8, 2]}, "at": [-1.8, -0.7]},
        "square": {"mesh": {"file": str(tmp_path / "square.msh")}, "angle": angle, "velocity": [0.0, -0.1]},
    }
    case = {
        "percuss": 1,
        "bodies": {name: body | {"material": SOLID} for name, body in bodies.items()},
        "contacts": {"seam": {"between": ["square.skin", "floor.top"][:: 1 - 2 * between], "sliding": "large"}},
        "method": {"contact": "lagrange", "pairing": "mortar"},
        "time": {"end": 0.1, "courant": 0.5},
    }
    notes = [note for note in ran(case).summary["notes"] if "may close late there" in note]
    assert len(notes) == told
    assert all("the corner of square.skin at [0, 0] points at floor.top" in note for note in notes) or angle


@pytest.mark.parametrize(("dim", "pairing"), [(2, "node-to-segment"), (3, "node-to-segment"), (2, "mortar")])
def test_a_corner_meets_a_face_when_it_reaches_it(dim, pairing):
    """A block turned by 45 degrees meets another one with its corner: these pairings close within a step."""
    speed, gap = 0.05, 0.02
    size = [1.0] * dim
    lower = {"block": {"size": [2.0] * (dim - 1) + [0.5], "elements": [9] + [3] * (dim - 2) + [2]}, "at": [0.0] * dim}
    upper = {"block": {"size": size, "elements": [4] * dim}, "angle": 45.0}
    if dim == 3:
        upper["axis"] = [0, 1, 0]
    half = 0.5 * np.sqrt(2.0)
    centre = [0.93] + [1.0] * (dim - 2) + [0.5 + half + gap]
    upper |= {"at": [c - 0.5 for c in centre], "velocity": [0.2] + [0.0] * (dim - 2) + [-speed]}
    bodies = {"lower": lower | {"material": SOLID}, "upper": upper | {"material": SOLID}}
    case = {
        "percuss": 1,
        "bodies": bodies,
        "contacts": {"seam": {"between": ["upper.bottom", "lower.top"], "sliding": "large"}},
        "method": {"integrator": WU, "contact": "lagrange", "pairing": pairing},
        "time": {"end": 0.6, "courant": 0.5},
    }
    result = ran(case)
    assert result.summary["contacts"]["seam"]["first_closed"] == pytest.approx(
        gap / speed, abs=1.01 * result.summary["dt"]
    )
