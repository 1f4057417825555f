"""Walls that are round or move: Hertz' theory, frames that move, accounts, bodies of one more dimension, bad input."""

import itertools

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

import percuss
import places
from accounts import balanced, ran
from percuss.case.specs import Ball, Cylinder, RigidWall
from percuss.contact.walls import meet_wall, shape_of
from percuss.errors import InputError
from percuss.march.model_of_case import model_of

WU, CD = "wu-predictor-corrector", "central-difference"
SOLID = {"young": 1.0, "density": 1.0, "poisson": 0.3}
PAIRINGS = ("node-to-segment", "gauss-points", "mortar")
COULOMB = {"name": "coulomb", "mu": 0.3}
SHAPES = {
    "plane": RigidWall(point=(0.3, 0.1, -0.2), normal=(1.0, 2.0, -0.5)),
    "circle": RigidWall(circle=Ball((0.3, 0.1), 0.7)),
    "hollow circle": RigidWall(circle=Ball((0.3, 0.1), 0.7), inside=True),
    "sphere": RigidWall(sphere=Ball((0.3, 0.1, -0.2), 0.7)),
    "hollow sphere": RigidWall(sphere=Ball((0.3, 0.1, -0.2), 0.7), inside=True),
    "cylinder": RigidWall(cylinder=Cylinder((0.3, 0.1, -0.2), (1.0, 2.0, -0.5), 0.7)),
    "hollow cylinder": RigidWall(cylinder=Cylinder((0.3, 0.1, -0.2), (1.0, 2.0, -0.5), 0.7), inside=True),
}


def block(wall, dim=2, *, velocity=(0.05, -0.1), loads=None, method=None, end=3.0, **contact):
    """Return a block that flies at a wall, on which it rubs."""
    body = {"block": {"size": [1.0] * dim, "elements": [3] * dim}, "at": [0.0] * (dim - 1) + [0.02]}
    body |= {"material": SOLID, "velocity": [velocity[0], *[0.0] * (dim - 2), velocity[1]]}
    return {
        "percuss": 1,
        "bodies": {"block": body},
        "contacts": {"wall": {"body": "block.bottom", "wall": wall, "friction": COULOMB, **contact}},
        "loads": loads or {},
        "method": {"integrator": WU, "contact": "lagrange"} | (method or {}),
        "time": {"end": end, "courant": 0.5},
        "record": {"every": 1},
    }


def floor(dim, **more):
    return {"point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0], **more}


def hill(dim, radius=2.0, **more):
    """Return a wall under the middle of the block whose top is at height 0."""
    middle = [0.5] * (dim - 1) + [-radius]
    return {"circle" if dim == 2 else "sphere": {"centre": middle, "radius": radius}, **more}


# ------------------------------------------------------------------------------------------------------------ geometry


@pytest.mark.parametrize("name", SHAPES)
@given(data=st.data())
def test_the_normal_leads_by_the_gap_to_the_nearest_place(name, data):
    """And it is the gradient of the gap; the kernel finds the same."""
    wall = shape_of(SHAPES[name])
    dim = wall.point.size
    at = np.array(data.draw(st.lists(st.floats(-3.0, 3.0), min_size=dim, max_size=dim)))
    gap, out = (one[0] for one in wall.meet(at[None]))
    foot = at - gap * out
    assert wall.meet(foot[None])[0][0] == pytest.approx(0.0, abs=1e-14)
    assert np.linalg.norm(out) == pytest.approx(1.0, abs=1e-14)
    kernel = np.zeros(dim)
    assert meet_wall(wall, wall.point, at, kernel) == pytest.approx(gap, abs=1e-15)
    assert kernel == pytest.approx(out, abs=1e-15)
    if abs(gap + wall.side * wall.radius) > 1e-3:  # away from the centre
        h = 1e-6
        steps = h * np.eye(dim)
        slopes = (wall.meet(at + steps)[0] - wall.meet(at - steps)[0]) / (2.0 * h)
        assert slopes == pytest.approx(out, abs=1e-8)


@pytest.mark.parametrize(
    ("radius", "inside", "curvature"), [(1.0, False, 2.0), (3.0, False, 4.0 / 3.0), (2.0, True, 0.5), (5.0, True, 0.8)]
)
def test_force_and_time_of_a_ball_follow_hertz(radius, inside, curvature):
    """Force as the relative radius to the power 1/5, time as it to the power -1/5, of the ball on a plane."""
    case = yaml.safe_load((places.CASES / "ball-on-wall.yaml").read_text(encoding="utf-8"))
    case["bodies"]["ball"]["half-disk"]["elements"], case["bodies"]["ball"]["velocity"] = 96, [0, -0.003]
    case["time"]["end"], case["expect"] = 26.0, []
    plane = ran(case).summary["contacts"]["floor"]
    centre = [0.0, radius if inside else -radius]
    case["contacts"]["floor"]["wall"] = {"sphere": {"centre": centre, "radius": radius}, "inside": inside}
    round_ = balanced(ran(case)).summary["contacts"]["floor"]
    assert round_["peak_force"] / plane["peak_force"] == pytest.approx(curvature**-0.2, rel=0.02)
    assert round_["closed_time"] / plane["closed_time"] == pytest.approx(curvature**0.2, rel=0.007)
    assert round_["impulse"] == pytest.approx(plane["impulse"], rel=0.003)


@pytest.mark.parametrize(("dim", "law"), [*itertools.product((2, 3), ("lagrange", "penalty"))])
def test_a_large_wall_is_a_plane(dim, law):
    method = {"contact": law}
    plane = ran(block(floor(dim), dim, method=method))
    large = balanced(ran(block(hill(dim, 1e7), dim, method=method)))
    hollow = hill(dim, 1e7, inside=True)
    next(iter(hollow.values()))["centre"][-1] = 1e7
    large_hollow = balanced(ran(block(hollow, dim, method=method)))
    force = plane.arrays["contact_force"]
    for other in (large, large_hollow):
        assert other.arrays["contact_force"] == pytest.approx(force, abs=1e-5 * force.max())


@pytest.mark.parametrize(("pairing", "inside"), [*itertools.product(PAIRINGS, (False, True))])
def test_a_cylinder_in_space_is_a_circle_in_the_plane(pairing, inside):
    """A layer of hexahedra that is held across the plane moves as quadrilaterals in plane strain do."""
    moving = {"tool": {"prescribed-velocity": 0.05, "direction": [0.3, 1.0]}}
    centre = [0.4, 2.0 if inside else -2.0]
    circle = {"circle": {"centre": centre, "radius": 2.07 if inside else 2.0}, "inside": inside, "moving": "tool"}
    law = "regularised-lagrange" if pairing == "gauss-points" else "lagrange"
    flat = block(circle, 2, loads=moving, method={"pairing": pairing, "contact": law})
    flat["time"] = {"end": 3.0, "step": 0.1}
    deep = yaml.safe_load(yaml.safe_dump(flat))
    body = deep["bodies"]["block"]
    body["block"] = {"size": [1.0, 1.0, 1.0], "elements": [3, 1, 3]}
    body["at"], body["velocity"] = [0.0, 0.0, 0.02], [0.05, 0.0, -0.1]
    body["fixed"] = [{"on": side, "along": "y"} for side in ("front", "back")]
    tube = {"point": [centre[0], 7.0, centre[1]], "axis": [0, -2, 0], "radius": circle["circle"]["radius"]}
    deep["contacts"]["wall"]["wall"] = {"cylinder": tube, "inside": inside, "moving": "tool"}
    deep["loads"]["tool"]["direction"] = [0.3, 0.0, 1.0]
    one, other = (balanced(ran(case)) for case in (flat, deep))
    assert one.arrays["contact_force"].max() > 0.0
    for name in ("contact_force", "friction_work", "wall_work", "kinetic_energy"):
        scale = np.abs(one.arrays[name]).max()
        assert other.arrays[name] == pytest.approx(one.arrays[name], abs=1e-10 * scale), name


# -------------------------------------------------------------------------------------------------------------- motion


@pytest.mark.parametrize(
    ("dim", "wall", "integrator", "law"),
    [
        *itertools.product((2, 3), (floor, hill), (WU, CD), ("lagrange", "penalty")),
        (2, hill, WU, "regularised-lagrange"),
        (2, floor, CD, "hunt-crossley"),
    ],
)
def test_a_wall_that_moves_is_a_frame_that_moves(dim, wall, integrator, law):
    """Only the relative velocity counts, which the forces, the friction and the contact work see."""
    direction = np.array([0.4, *[0.1] * (dim - 2), 1.0])
    velocity = 0.07 * direction / np.linalg.norm(direction)
    loads = {"tool": {"prescribed-velocity": 0.07, "direction": direction.tolist()}}
    method = {"integrator": integrator, "contact": law}
    moves = balanced(ran(block(wall(dim, moving="tool"), dim, loads=loads, method=method)))
    case = block(wall(dim), dim, method=method)
    start = np.array(case["bodies"]["block"]["velocity"])
    case["bodies"]["block"]["velocity"] = (start - velocity).tolist()
    still = balanced(ran(case))
    assert moves.arrays["contact_force"].max() > 0.0
    assert moves.summary["notes"] == still.summary["notes"]
    for name in ("contact_force", "friction_work", "contact_work", "elastic_energy"):
        scale = max(np.abs(still.arrays[name]).max(), 1e-12)
        assert moves.arrays[name] == pytest.approx(still.arrays[name], abs=1e-9 * scale), name


@pytest.mark.parametrize(
    ("dim", "wall", "load"),
    [
        *itertools.product(
            (2, 3), (floor, hill), ({"prescribed-velocity": 0.1}, {"harmonic": {"value": 0.1, "frequency": 0.4}})
        )
    ],
)
def test_the_work_of_a_wall_is_its_force_times_its_way(dim, wall, load):
    direction = np.array([0.4, *[0.1] * (dim - 2), 1.0])
    loads = {"tool": {**load, "as": "velocity", "direction": direction.tolist()}}
    case = block(wall(dim, moving="tool"), dim, loads=loads)
    case["bodies"]["block"]["at"] = [0.0] * dim  # which presses in the first step
    result = balanced(ran(case))
    dt = result.summary["dt"]
    times = (np.arange(-1, result.arrays["time"].size) + 0.5) * dt
    amplitude = 0.1 * (np.sin(2.0 * np.pi * 0.4 * times) if "harmonic" in load else np.ones(times.size))
    velocity = amplitude[:, None] * direction / np.linalg.norm(direction)
    force = np.asarray(result.arrays["contact_force_vector"])[:, 0]
    work = np.cumsum((force * 0.5 * dt * (velocity[:-1] + velocity[1:])).sum(axis=1))
    found = result.arrays["wall_work"][:, 0]
    assert np.abs(found).max() > 0.0
    assert found == pytest.approx(work, abs=1e-12 * np.abs(work).max())
    assert result.arrays["external_work"] == pytest.approx(found, abs=1e-15)
    summary = result.summary
    assert summary["contacts"]["wall"]["wall_work"] == found[-1]
    assert summary["angular_momentum"]["error"] < 1e-12
    assert summary["momentum"]["impulse_of_walls"] == pytest.approx(dt * force[:-1].sum(axis=0), rel=1e-10)


def test_a_wall_pushes_a_damped_body_at_its_velocity():
    """The force is then alpha m V, and the power of the wall what the damping takes."""
    alpha, v = 2.0, 0.03
    loads = {"tool": {"prescribed-velocity": v, "along": "y"}}
    case = block(floor(2, moving="tool"), velocity=(0.0, 0.0), loads=loads, end=60.0)
    case["bodies"]["block"]["damping"] = {"mass": alpha}
    result = balanced(ran(case))
    assert result.arrays["contact_force"][-1, 0] == pytest.approx(alpha * v, rel=1e-9)
    assert result.summary["bodies"]["block"]["velocity_y"] == pytest.approx(v, rel=1e-9)
    power = [np.diff(result.arrays[name][-2:], axis=0).item() for name in ("wall_work", "damped_energy")]
    assert power == pytest.approx([alpha * v**2 * result.summary["dt"]] * 2, rel=1e-8)


def test_a_wall_stands_still_while_its_load_is_off():
    loads = {"tool": {"prescribed-velocity": 0.5, "along": "y", "from": 0.5, "until": 1.0}}
    case = block(floor(2, moving="tool"), velocity=(0.0, 0.0), loads=loads, end=2.0)
    case["bodies"]["block"]["at"] = [0.0, 10.0]
    case["record"] = {"fields": 8, "pressure": True}
    result = ran(case)
    places_of_wall = np.array(result.provenance["geometry"]["wall_displacements"]["wall"])
    times = result.field_arrays["time"]
    assert places_of_wall[:, 1] == pytest.approx(0.5 * np.clip(times - 0.5, 0.0, 0.5), abs=result.summary["dt"])
    assert places_of_wall[-1, 1] == pytest.approx(0.25, abs=0.5 * result.summary["dt"])
    # a body that hovers over the place where the wall stops is not touched, and one below it is
    for height, touched in ((0.26, False), (0.24, True)):
        case["bodies"]["block"]["at"] = [0.0, height]
        assert (ran(case).summary["contacts"]["wall"]["impulse"] > 0.0) is touched


@pytest.mark.parametrize("pairing", PAIRINGS)
def test_rows_on_a_round_wall_keep_the_bound_of_the_energy(pairing):
    law = "regularised-lagrange" if pairing == "gauss-points" else "lagrange"
    case = block(
        hill(2, 0.8), velocity=(0.3, -0.1), end=8.0, method={"pairing": pairing, "contact": law}, friction="none"
    )
    case["loads"] = {"fall": {"gravity": 0.05, "on": "block", "direction": [0, -1]}}
    result = balanced(ran(case))
    growth = result.summary["energy_growth"]
    assert growth["kept"] is True
    assert growth["guarantee"] == "bounded by the renewal of rows"
    assert result.summary["contacts"]["wall"]["renewal"] > 0.0


def test_a_plane_that_moves_keeps_the_certificate_of_one_at_rest():
    loads = {"tool": {"prescribed-velocity": 0.05, "along": "y"}}
    walls = ((floor(2), {}), (floor(2, moving="tool"), loads))
    results = [ran(block(wall, loads=known, friction="none")).summary for wall, known in walls]
    assert results[1]["energy_growth"]["kept"] is True
    found = [summary["certificate"] for summary in results]
    for key in ("stable", "energy", "dt_critical"):
        assert found[0][key] == found[1][key], key
    round_ = ran(block(hill(2), friction="none")).summary["certificate"]
    assert round_["stable"] == "unknown"


def test_the_stiffness_at_a_wall_is_that_of_each_node_alone():
    """No wall moves, so that S is diagonal for points at nodes: b is the largest stiffness over a mass."""
    case = block(hill(2), method={"contact": "penalty"}, friction="none")
    model = model_of(percuss.load(case))
    (law,) = model.laws
    largest = (model.delassus.diagonal() / law.linear.sigma).max()
    assert ran(case).summary["contacts"]["wall"]["stiffness_bound"] == pytest.approx(largest, rel=1e-12)


def test_two_walls_and_a_body_that_slides_go_in_one_case():
    """Points that seek a facet, points at walls and points that a pairing renews, in one step."""
    low = {"block": {"size": [3.0, 0.5], "elements": [6, 2]}, "at": [-1.0, -0.5], "material": SOLID}
    case = block(
        hill(2, moving="tool"), velocity=(0.1, -0.1), loads={"tool": {"prescribed-velocity": 0.05, "along": "y"}}
    )
    case["bodies"] |= {"low": low}
    case["bodies"]["block"]["at"] = [0.0, 0.0]
    case["contacts"] = {
        "die": {"body": "block.top", "wall": {"circle": {"centre": [0.5, 2.02], "radius": 1.0}, "moving": "down"}},
        "seam": {"between": ["block.bottom", "low.top"], "sliding": "large", "friction": COULOMB},
        "base": {"body": "low.bottom", "wall": {"point": [0, -0.5], "normal": [0, 1], "moving": "up"}},
        "beside": {"between": ["low.right", "block.left"], "sliding": "large", "pairing": "mortar"},
    }
    case["loads"] = {
        "down": {"prescribed-velocity": 0.05, "direction": [0, -1]},
        "up": {"prescribed-velocity": 0.02, "along": "y"},
    }
    result = balanced(ran(case))
    for name in ("die", "seam", "base"):
        assert result.summary["contacts"][name]["impulse"] > 0.0
    work = [result.summary["contacts"][name]["wall_work"] for name in ("die", "seam", "base", "beside")]
    assert min(work[0], work[2]) > 0.0 == work[1] == work[3]
    assert result.summary["energy"]["external_work"] == pytest.approx(sum(work), rel=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_plain_python_finds_the_same(dim):
    loads = {"tool": {"prescribed-velocity": 0.05, "direction": [0.0] * (dim - 1) + [1.0]}}
    case = percuss.load(block(hill(dim, moving="tool"), dim, loads=loads))
    forces = [percuss.run(case, compiled=compiled).arrays["contact_force"] for compiled in (True, False)]
    assert forces[0] == pytest.approx(forces[1], abs=1e-12 * forces[1].max())


def test_a_node_behind_a_round_wall_that_no_point_sees_is_told():
    case = block(hill(2, 0.6), velocity=(0.0, -0.4), end=3.0)
    case["contacts"]["wall"]["body"] = "block.left"
    case["bodies"]["block"]["at"] = [0.05, 0.02]
    notes = " ".join(ran(case).summary["notes"])
    assert "behind the wall of contact 'wall'" in notes
    assert "it is not in block.left" in notes


# ----------------------------------------------------------------------------------------------------------- bad input

BOND = {"name": "cohesive", "strength": 1.0, "length": 99.0}
TOOL = {"prescribed-velocity": 0.1, "along": "y"}
BAD = {
    "no wall": ({"inside": True}, {}, "is no wall: give `point` and `normal`, or one of"),
    "two walls": ({**floor(2), **hill(2)}, {}, "is no wall"),
    "half a plane": ({"point": [0, 0]}, {}, "normal: missing (a plane has a point and a normal)"),
    "plane inside": (floor(2, inside=True), {}, "is a plane, which has no inside: turn its `normal`"),
    "no radius": ({"circle": {"centre": [0, -1]}}, {}, "radius: missing"),
    "radius": ({"circle": {"centre": [0, -1], "radius": 0}}, {}, "radius: expected a number greater than 0"),
    "no mapping": ({"circle": 3}, {}, "circle: expected a mapping as {centre: [0, -2], radius: 2}, found 3"),
    "cylinder of a number": (
        {"cylinder": 3}, {}, "expected a mapping as {point: [0, 0, 0], axis: [1, 0, 0], radius: 2}, found 3"
    ),
    "components": ({"circle": {"centre": [0, -1, 0], "radius": 1}}, {}, "implies 3 dimensions"),
    "sphere in the plane": (
        {"sphere": {"centre": [0, -1], "radius": 1}}, {},
        "expected another wall for a body in 2 dimensions, found a sphere",
    ),
    "cylinder in the plane": (
        {"cylinder": {"point": [0, -1], "axis": [1, 0], "radius": 1}}, {}, "Write `circle`, or a plane."
    ),
    "inside the wall": (hill(2, inside=True), {}, "found an overlap of"),
    "finite mass": (hill(2, mass=3.0), {}, "unknown key 'mass' of the wall"),
    "unknown load": (floor(2, moving="toll"), {"tool": TOOL}, "there is no load 'toll'"),
    "a force": (
        floor(2, moving="tool"), {"tool": {"constant": 1.0, "on": "block.top", "along": "y"}},
        "expected a load of prescribed velocity, found 'tool', a force",
    ),
    "no direction": (
        floor(2, moving="tool"), {"tool": {"prescribed-velocity": 1.0}}, "expected a load with a direction",
    ),
    "both directions": (
        floor(2, moving="tool"), {"tool": {**TOOL, "direction": [0, 1]}}, "has both `along` and `direction`",
    ),
    "axis": (floor(2, moving="tool"), {"tool": {**TOOL, "along": "z"}}, "expected x or y, as the case has 2"),
    "a velocity of nothing": (floor(2), {"tool": TOOL}, "missing (where the load acts)"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_walls_are_told(name):
    wall, loads, message = BAD[name]
    with pytest.raises(InputError) as told:
        ran(block(wall, loads=loads))
    assert message in str(told.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"method.integrator": "noh-bathe"}, "expected a leap-frog scheme"),
        ({"contacts.wall.method": BOND}, "bodies part"),
    ],
)
def test_methods_that_know_no_rows_of_a_step_are_refused(change, message):
    case = block(hill(2))
    del case["contacts"]["wall"]["friction"]
    with pytest.raises(InputError, match=message):
        percuss.run(percuss.load(case, change))


@pytest.mark.parametrize(
    ("wall", "loads", "message"),
    [
        ({"circle": {"centre": [0, -1], "radius": 1}}, {}, "expected another wall for a body of revolution"),
        ({"sphere": {"centre": [0.2, -1], "radius": 1}}, {}, "expected a sphere centred on the axis of revolution"),
        (floor(2, moving="tool"), {"tool": {"prescribed-velocity": 0.1, "along": "x"}}, "moves along the axis"),
    ],
)
def test_walls_of_bodies_of_revolution(wall, loads, message):
    case = yaml.safe_load((places.CASES / "ball-on-wall.yaml").read_text(encoding="utf-8"))
    case["contacts"]["floor"]["wall"], case["loads"] = wall, loads
    with pytest.raises(InputError, match=message):
        ran(case)


def test_a_bar_meets_no_round_wall():
    case = {
        "percuss": 1,
        "bodies": {"rod": {"bar": {"length": 1, "elements": 4}, "area": 1, "at": [0.0, 0.0],
                           "material": {"young": 1, "density": 1}}},
        "contacts": {"stop": {"body": "rod.right", "wall": {"circle": {"centre": [3, 0], "radius": 1}}}},
        "time": {"end": 1, "courant": 0.5},
    }  # fmt: skip
    with pytest.raises(InputError, match="expected a plane at rest for a bar, found a circle"):
        ran(case)
