"""percuss knows no dimension: strips of squares against the bars that they are, and rows that turn.

The squares, their element and the rows between them are a plug-in of this test: nothing of percuss knows them.
"""

import itertools
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import percuss
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.step.actions import BULK, Action

PLUGIN = Path(__file__).parents[1] / "support" / "solids" / "squares.py"
HEIGHT, COUNT, STEPS, COURANT = 0.2, 20, 100, 0.5
DT = COURANT / COUNT
LAWS = {
    "penalty": {"beta_s": 0.25},
    "bipenalty": {"beta_s": 0.25},
    "lagrange": {},
    "regularised-lagrange": {"beta_s": 1.0},
}
LEAP_FROG = ["central-difference", "wu-predictor-corrector"]
PAIRS = [
    *itertools.product(LEAP_FROG, LAWS),
    *(pytest.param("velocity-verlet", law, marks=pytest.mark.deep) for law in LAWS),  # blocks run in stages elsewhere
]
MATERIAL = {"young": 1.0, "density": 1.0, "poisson": 0.0}


def case_of(bodies, integrator, law, **method):
    return {
        "percuss": 1,
        "bodies": bodies,
        "contacts": {"tip": {"between": ["left.right", "right.left"]}},
        "method": {"integrator": integrator, "contact": {"name": law, **LAWS[law]}, **method},
        "time": {"step": DT, "steps": STEPS, "on_unstable": "warn"},
    }


def strip(across, at, speed):
    shape = {"squares": {"size": [1.0, HEIGHT], "elements": [COUNT, across]}}
    return {**shape, "at": [at, 0.0], "velocity": [speed, 0.0], "material": MATERIAL}


def bars(integrator, law):
    """The run of the same case with bars."""
    body = {"material": MATERIAL, "area": HEIGHT, "bar": {"length": 1.0, "elements": COUNT}}
    ends = {"left": {**body, "velocity": 0.5}, "right": {**body, "at": 1.0, "velocity": -0.5}}
    return percuss.run(percuss.load(case_of(ends, integrator, law)))


def strips(integrator, law, left, right, places, **options):
    """The run with strips of squares: so many across on the left and on the right."""
    bodies = {"left": strip(left, 0.0, 0.5), "right": strip(right, 1.0, -0.5)}
    pairing = {"name": "straight", "points_at": places}
    case = case_of(bodies, integrator, law, pairing=pairing)
    return percuss.run(percuss.load(case, plugins=[PLUGIN]), **options)


def differences(found, expected):
    """The largest differences of motions and force from those of bars, over the largest value."""
    u, of_bars = found.arrays["displacement"], expected.arrays["displacement"][..., 0]
    v, speed = found.arrays["velocity"], expected.arrays["velocity"][..., 0]
    along = max(np.abs(u[..., 0] - of_bars).max() / np.abs(of_bars).max(), np.abs(v[..., 0] - speed).max())
    across = np.abs(u[..., 1]).max() / np.abs(of_bars).max()
    force, of_bar = found.arrays["contact_force"], expected.arrays["contact_force"]
    assert of_bar.max() > 0.04
    assert (of_bar[-5:] == 0.0).all()  # it has let go
    return along, across, np.abs(force - of_bar).max() / of_bar.max()


def accounts_close(result, integrator):
    assert result.status == "done"
    assert result.summary["momentum"]["balanced"]
    if integrator in LEAP_FROG:  # in stages the energy of the scheme is not that of the bodies
        assert result.summary["energy"]["ledger_closed"]
        assert result.summary["energy"]["ledger_error"] < 1e-13


def same_certificate(found, expected):
    one, other = found.summary["certificate"], expected.summary["certificate"]
    if other["by"] == "black-box" and one["stable"] == "unknown":
        assert "growth was looked for" in one["why"]  # more motions than are examined one by one
        return
    for name in ("stable", "energy", "by", "worst"):
        assert one[name] == other[name], name
    for name in ("dt_critical", "dt_critical_free", "theta"):
        assert one[name] == (other[name] and pytest.approx(other[name], rel=1e-9)), name


@pytest.mark.parametrize(("integrator", "law"), PAIRS)
def test_a_strip_of_squares_is_a_bar_where_meshes_match(integrator, law):
    found, expected = strips(integrator, law, 4, 4, "nodes"), bars(integrator, law)
    along, across, force = differences(found, expected)
    assert (along < 1e-12, across < 1e-12, force < 1e-10) == (True, True, True), (along, across, force)
    accounts_close(found, integrator)
    same_certificate(found, expected)


@pytest.mark.parametrize(
    ("integrator", "law"), [pair for pair in PAIRS if "lagrange" not in getattr(pair, "values", pair)]
)
def test_it_is_a_bar_where_meshes_do_not_match_and_rows_are_cut_at_both(integrator, law):
    found, expected = strips(integrator, law, 5, 7, "cut"), bars(integrator, law)
    along, across, force = differences(found, expected)
    assert max(along, across, force) < 1e-10, (along, across, force)
    accounts_close(found, integrator)


@pytest.mark.parametrize("integrator", LEAP_FROG)
@pytest.mark.parametrize("places", ["nodes", "gauss"])
def test_other_rows_differ_from_bars_and_their_accounts_close(integrator, places):
    found = strips(integrator, "penalty", 5, 7, places)
    assert np.abs(found.arrays["displacement"][..., 1]).max() < 1e-3
    assert np.abs(found.arrays["contact_force"] - bars(integrator, "penalty").arrays["contact_force"]).max() > 1e-6
    accounts_close(found, integrator)


@pytest.mark.deep
def test_plain_python_marches_the_same():
    one = strips("wu-predictor-corrector", "penalty", 2, 3, "cut")
    other = strips("wu-predictor-corrector", "penalty", 2, 3, "cut", compiled=False)
    assert np.abs(one.arrays["displacement"] - other.arrays["displacement"]).max() < 1e-14
    assert np.abs(one.arrays["contact_force"] - other.arrays["contact_force"]).max() < 1e-13


# --------------------------------------------------------------------------------------------- rows that turn and move


class Turning(NamedTuple):
    """Rows that are renewed in every step."""

    row: np.recarray
    entries: np.recarray
    mass: np.ndarray  # of the node of each entry
    span: float  # angle of a step


def turn(data, n, u, v, a):
    """Turn the normals of all points, and move their walls."""
    angle = 0.3 + data.span * n
    cosine, sine = np.cos(angle), np.sin(angle)
    for i in range(data.row.size):
        row = data.row[i]
        row.initial_gap = -0.003 + 0.002 * np.sin(0.7 * n + i)
        row.delassus = 0.0
        for k in range(row.start, row.stop):
            entry = data.entries[k]
            entry.normal = cosine if (k - row.start) % 2 == 0 else sine
            entry.response = entry.normal / data.mass[k]
            row.delassus += entry.normal * entry.response


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize(
    ("integrator", "law"), [("central-difference", "penalty"), ("wu-predictor-corrector", "lagrange")]
)
def test_rows_that_turn_and_move_in_every_step_leave_the_ledger_closed(integrator, law, compiled):
    shape = {"squares": {"size": [0.6, 0.3], "elements": [6, 3]}}
    case = {
        "percuss": 1,
        "bodies": {"block": {**shape, "at": [0.0, 0.0], "velocity": [-0.2, 0.0], "material": MATERIAL}},
        "contacts": {"wall": {"body": "block.left", "wall": 0.0}},
        "method": {"integrator": integrator, "contact": {"name": law, **LAWS[law]}, "pairing": "straight"},
        "time": {"step": 0.02, "steps": 80, "on_unstable": "warn"},
    }
    march = March(model_of(percuss.load(case, plugins=[PLUGIN])), compiled=compiled)
    step = march.arrays.step
    mass = step.boundary["mass"][step.points.entries["place"]]
    turning = Action(BULK, turn, Turning(step.points.row, step.points.entries, mass, 0.2), order=-1)
    march.arrays.actions = [*march.arrays.actions, turning]
    march.use(march.kernels, march.arrays.actions)
    outcome = march.run()
    energy = outcome.record.energy[: outcome.records]
    assert outcome.done == 80
    assert outcome.record.contact_force.max() > 1e-3
    assert np.abs(energy.contact_work).max() > 1e-5
    error = energy.kinetic_energy + energy.elastic_energy - energy.contact_work - outcome.totals.energy_before
    assert np.abs(error).max() < 1e-13 * max(outcome.totals.energy_before, np.abs(energy.contact_work).max())
