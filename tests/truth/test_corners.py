"""A corner that falls on a face: when it touches, and what is told where the contact points do not see it."""

import itertools
import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import corners
import percuss
from blocks import chain, plane_at, plate
from corners import GAP, ORDERS, SPEED, STEEL, falling
from marks import deep
from pages import shown
from percuss.march.model_of_case import model_of
from percuss_methods.pairings.mortar import Mortar
from percuss_methods.pairings.node_to_segment import NodeToSegment
from strategies import with_methods

CORNER_FIRST, FACE_FIRST = ORDERS["corner"], ORDERS["face"]


def times_of_touch(case):
    """Return when each contact point closes if the bodies keep their first velocities."""
    model = model_of(percuss.load(case))
    velocity = np.concatenate([body.nodal_velocity for body in model.bodies.values()])
    rate = velocity.ravel() @ model.contact_points.matrix(model.bodies.n_nodes)
    return (model.contact_points.gap / -rate).tolist()


@pytest.mark.parametrize("refine", [1, 2])
@pytest.mark.parametrize("tilt", [1, 10, 30, *map(deep, (5, 25))])
@pytest.mark.parametrize(
    ("pairing", "between"), [("mortar", CORNER_FIRST), ("mortar", FACE_FIRST), ("node-to-segment", CORNER_FIRST)]
)
@pytest.mark.parametrize("dim", [2, 3])
def test_a_corner_touches_at_the_time_of_geometry(dim, pairing, between, tilt, refine):
    assert min(times_of_touch(falling(tilt, between, pairing, dim=dim, refine=refine))) == pytest.approx(GAP / SPEED)


@pytest.mark.parametrize("between", [CORNER_FIRST, FACE_FIRST])
def test_a_run_closes_at_that_time(between):
    result = percuss.run(percuss.load(falling(10, between)))
    assert result.summary["contacts"]["hit"]["first_closed"] == pytest.approx(GAP / SPEED, abs=result.summary["dt"])
    assert result.summary["notes"] == []


@given(
    tilts=st.tuples(*[st.floats(-25.0, 25.0)] * 2),
    place=st.tuples(*[st.floats(0.0, 1.0)] * 2),
    cells=st.tuples(*[st.integers(1, 4)] * 4),
    swapped=st.booleans(),
)
def test_no_gap_is_below_the_least_distance_of_plane_faces(tilts, place, cells, swapped):
    """Of two plane faces the least distance is that of a corner of the upper one, along the normal that gaps are of."""
    turns = np.radians(tilts)
    x, y = (np.array([[math.cos(a), -math.sin(a)], [math.sin(a), math.cos(a)]]) for a in turns)
    rotation = np.eye(3)
    rotation[np.ix_([0, 2], [0, 2])] = x
    second = np.eye(3)
    second[np.ix_([1, 2], [1, 2])] = y
    rotation = rotation @ second
    lower = plane([-3.0, -3.0], [6.0, 6.0], cells[:2])
    upper = plane([-0.5, -0.5], [1.0, 1.0], cells[2:])
    turned = upper.positions @ rotation.T
    turned += np.array([*place, GAP - turned[:, 2].min()])
    facets = upper.facets[:, ::-1]  # it looks down
    upper = upper._replace(
        positions=turned, facets=facets, normals=np.tile(-rotation[:, 2], (len(facets), 1)), nodes=upper.nodes + 100
    )
    pair = (lower, upper) if swapped else (upper, lower)
    found = Mortar().points(*pair)
    along = found.normal if swapped else -found.normal  # upwards
    # The plane of the normals is that of the second surface: the lowest corner is GAP above the lower face.
    least = GAP * along[:, 2] if swapped else np.full(len(along), GAP)
    assert (found.gap >= least * (1.0 - 1e-9)).all()
    assert found.gap.min() == pytest.approx(least.min(), rel=1e-6)


def plane(start, size, cells):
    """Return a surface in the plane z = 0 that looks up."""
    found = plate(*(np.linspace(a, a + length, n + 1) for a, length, n in zip(start, size, cells, strict=True)))
    return found._replace(positions=found.positions[:, [1, 2, 0]], normals=found.normals[:, [1, 2, 0]])


@pytest.mark.parametrize(("pairing", "early"), [("node-to-segment", False), ("mortar", True)])
@pytest.mark.parametrize("cells", [(3, 2), (10, 8), (8, 15)])
@pytest.mark.parametrize("tilt", [10.0, 30.0])
def test_a_corner_of_a_surface_that_runs_round_it_is_never_met_at_a_distance(pairing, early, cells, tilt):
    """Face first: nodes of the plate see the sides of the block, none of which is nearer than its corner.

    A nearest place at a corner has no facet of its own: along the normal of either the gap could be any.
    """
    times = times_round_a_corner(pairing, cells, tilt)
    assert min(times) >= 1.0 - 1e-9
    if early:  # mortar sees the corner itself
        assert min(times) == pytest.approx(1.0)


def times_round_a_corner(pairing, cells, tilt):
    """Return gaps over closing rates of a plate and the two lower sides of a turned square, by its corner's time."""
    turn = math.radians(tilt)
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    plate = chain(along(np.array([[4.0, 0.0], [-4.0, 0.0]]), cells[0]))  # it looks up
    sides = np.array([[0.0, 2.0], [0.0, 0.0], [3.0, 0.0]]) @ rotation.T
    sides += np.array([0.123, GAP - sides[:, 1].min()])
    made = {"mortar": Mortar, "node-to-segment": NodeToSegment}[pairing]()
    found = made.points(plate, chain(along(sides, cells[1]), 100))
    rate = SPEED * found.normal[:, 1]  # the block falls, and normals point from the plate to it
    return [gap / speed / (GAP / SPEED) for gap, speed in zip(found.gap, rate, strict=True) if speed > 0.0]


def along(corners, cells):
    """Return points along some corners, with so many cells on each straight part."""
    parts = [np.linspace(a, b, cells, endpoint=False) for a, b in itertools.pairwise(corners)]
    return np.concatenate([*parts, corners[-1:]])


@pytest.mark.parametrize("pairing", ["mortar", "node-to-segment"])
def test_mirrored_disks_meet_without_a_sideways_force(pairing):
    """Their lowest and highest nodes meet, between two facets each."""
    disk = {"disk": {"radius": 1, "elements": 8}, "material": STEEL}
    case = {
        "percuss": 1,
        "bodies": {
            "upper": {**disk, "at": [0, 1], "velocity": [0, -0.01]},
            "lower": {**disk, "at": [0, -1], "velocity": [0, 0.01]},
        },
        "contacts": {"touch": {"between": ["upper.skin", "lower.skin"]}},
        "method": {"pairing": pairing},
        "time": {"end": 8.0, "courant": 0.5},
    }
    found = percuss.run(percuss.load({**case, "record": {"probes": ["upper.skin"]}}))
    sideways, along = np.abs(found.arrays["velocity"][-1, 0])
    assert along > 5e-3
    assert sideways < 1e-10 * along


@pytest.mark.parametrize("name", corners.PARTS)
def test_a_table_of_the_page_is_that_of_the_rows(name):
    assert shown(name) == corners.PARTS[name]()


SAMPLE = [(2, "mortar", "corner", 10, 2), (2, "node-to-segment", "face", 5, 1), (3, "mortar", "face", 30, 1)]


@pytest.mark.parametrize("which", SAMPLE, ids=str)
def test_a_row_is_what_a_run_gives(which):
    kept, made = corners.rows().loc[which], dict(zip(corners.HEAD, corners.row(*which), strict=True))
    assert float(made["touch"]) == pytest.approx(kept["touch"], abs=1e-3)
    assert float(made["impulse"]) == pytest.approx(kept["impulse"], rel=1e-2)


# -- what is told ----------------------------------------------------------------------------------------------


def notes_of(case, registry=None):
    return percuss.run(percuss.load(case, registry=registry)).summary["notes"]


@pytest.mark.parametrize("dim", [2, 3])
def test_a_corner_between_the_points_of_a_face_is_told(dim):
    case = falling(30, FACE_FIRST, "node-to-segment", dim=dim)
    sink = 0.2 * GAP
    (note,) = notes_of(case)
    assert "of 'block'" in note
    assert f"{sink:.3g}"[:4] in note or "0.01" in note
    assert "the points of contact 'hit', on anvil.top, do not see it. Name block.bottom first" in note
    assert notes_of(falling(30, CORNER_FIRST, "node-to-segment", dim=dim)) == []


def test_nodes_behind_a_wall_that_their_region_does_not_have_are_told():
    case = falling(30, CORNER_FIRST)
    del case["bodies"]["anvil"]
    case["contacts"] = {"hit": {"body": "block.right", "wall": plane_at([0, 3.0], [0, 1])}}
    (note,) = notes_of(case)
    assert "of 'block' lies" in note
    assert "behind the wall of contact 'hit'" in note
    assert "it is not in block.right" in note


def test_bodies_without_a_contact_that_pass_through_each_other_are_told():
    case = falling(5, CORNER_FIRST)
    del case["contacts"]
    (note,) = notes_of(case)
    assert "of 'block'" in note
    assert note.endswith("no contact is declared between them; declare one")
    case["bodies"]["block"]["at"] = [2.5, 2.0]  # they lie over each other from the start: they do not know each other
    assert notes_of(case) == []


@dataclass(frozen=True)
class TooNear(percuss.Pairing):
    """Nodes whose gaps begin at nothing."""

    name = "too-near"
    summary = "a pairing"

    def points(self, first, second):
        """Return points that touch at once."""
        found = NodeToSegment().points(first, second)
        return found._replace(gap=0.0 * found.gap)


def test_a_contact_that_presses_at_a_distance_is_told():
    case = falling(10, CORNER_FIRST, "too-near", record={"fields": 10})
    (note,) = notes_of(case, with_methods(TooNear))
    assert note.startswith("contact 'hit' presses at time 0")
    assert "although its surfaces are 0.05 apart" in note


def sliding(speed, cells=4, **changes):
    """Return two squares of side 1 beside each other, of which one moves along their common face."""
    square = {"block": {"size": [1, 1], "elements": [cells, cells]}, "material": STEEL}
    return {
        "percuss": 1,
        "bodies": {
            "a": {**square, "at": [0, 0], "velocity": [0.01, speed]},
            "b": {**square, "at": [1, 0], "velocity": [-0.01, 0]},
        },
        "contacts": {"side": {"between": ["a.right", "b.left"]}},
        "time": {"end": 1.0, "courant": 0.5},
        **changes,
    }


@pytest.mark.parametrize("pairing", ["mortar", "node-to-segment"])
def test_points_that_press_where_they_have_slid_are_told(pairing):
    """A facet is a quarter long, which is passed within the step to 0.27."""
    method = {"method": {"pairing": pairing}}
    (note,) = notes_of(sliding(1.0, time={"end": 0.7, "courant": 0.5}, **method))
    assert note.startswith("contact 'side' presses from time 0.270416 on at points that have slid along their surface")
    assert "by more than a facet, by 2." in note or "by more than a facet, by 3." in note
    assert notes_of(sliding(0.2, **method)) == []
    case = sliding(1.0, time={"end": 0.7, "courant": 0.5}, **method)
    case["bodies"]["a"]["velocity"] = [-0.02, 1.0]  # it leaves the other one, and slides beside it
    assert notes_of(case) == []
