"""The loop of a step knows no dimension: strips of squares against the bars that they are, and rows that turn."""

from typing import NamedTuple

import numpy as np
import pytest

import percuss
import squares
from percuss.march.march import March
from percuss.march.model import Model
from percuss.step.actions import BULK, Action
from squares import REGISTRY, Strip, at_gauss_points, at_nodes, cuts, rows_between

HEIGHT, COUNT, STEPS, COURANT = 0.2, 20, 100, 0.5
DT = COURANT / COUNT
LAWS = {
    "penalty": {"beta_s": 0.25},
    "bipenalty": {"beta_s": 0.25},
    "lagrange": {},
    "regularised-lagrange": {"beta_s": 1.0},
}
LEAP_FROG = ["central-difference", "wu-predictor-corrector"]
PAIRS = [(integrator, law) for integrator in (*LEAP_FROG, "velocity-verlet") for law in LAWS]


def strips(left, right):
    return Strip(COUNT, left, 1.0, HEIGHT, 0.0, 0.5), Strip(COUNT, right, 1.0, HEIGHT, 1.0, -0.5)


def bars(integrator, law):
    """The march of the same case with bars."""
    body = {"material": {"young": 1.0, "density": 1.0}, "area": HEIGHT, "bar": {"length": 1.0, "elements": COUNT}}
    case = {
        "percuss": 1,
        "bodies": {"left": {**body, "velocity": 0.5}, "right": {**body, "at": 1.0, "velocity": -0.5}},
        "contacts": {"tip": {"between": ["left.right", "right.left"]}},
        "method": {"integrator": integrator, "contact": {"name": law, **LAWS[law]}},
        "time": {"step": DT, "steps": STEPS, "on_unstable": "warn"},
    }
    return March(Model(percuss.load(case))).run()


def marched(integrator, law, left, right, places, **options):
    pair = strips(left, right)
    made = REGISTRY.get("contacts", law)(**LAWS[law])
    return squares.march(pair, rows_between(*pair, places(*pair)), integrator, made, DT, STEPS, **options)


def differences(found, expected, left, right):
    """The largest differences of displacements and of the force from those of bars, over the largest value."""
    columns = [found.u[: (COUNT + 1) * (left + 1)].reshape(COUNT + 1, left + 1, 2)]
    columns.append(found.u[(COUNT + 1) * (left + 1) :].reshape(COUNT + 1, right + 1, 2))
    u = expected.final_displacement.reshape(2, COUNT + 1)
    size = np.abs(u).max()
    along = max(np.abs(c[:, :, 0] - of_bar[:, None]).max() for c, of_bar in zip(columns, u, strict=True)) / size
    across = max(np.abs(c[:, :, 1]).max() for c in columns) / size
    force = expected.record.contact_force[:STEPS, 0]
    assert force.max() > 0.04
    assert (force[-5:] == 0.0).all()  # it has let go
    return along, across, np.abs(found.record.contact_force.sum(axis=1) - force).max() / force.max()


def accounts_close(found, integrator):
    assert found.done == STEPS
    momentum = found.mass @ found.v
    assert np.abs(momentum).max() < 1e-14
    if integrator in LEAP_FROG:  # in stages the energy of the scheme is not that of the bodies
        assert found.ledger() < 1e-13


@pytest.mark.parametrize(("integrator", "law"), PAIRS)
def test_a_strip_of_squares_is_a_bar_where_meshes_match(integrator, law):
    found = marched(integrator, law, 4, 4, lambda left, _: at_nodes(left))
    along, across, force = differences(found, bars(integrator, law), 4, 4)
    assert (along < 1e-12, across < 1e-12, force < 1e-10) == (True, True, True), (along, across, force)
    accounts_close(found, integrator)


@pytest.mark.parametrize(("integrator", "law"), [pair for pair in PAIRS if pair[1] != "lagrange"])
def test_it_is_a_bar_where_meshes_do_not_match_and_rows_are_cut_at_both(integrator, law):
    found = marched(integrator, law, 5, 7, lambda left, right: at_gauss_points(cuts(left, right)))
    along, across, force = differences(found, bars(integrator, law), 5, 7)
    assert max(along, across, force) < 1e-10, (along, across, force)
    accounts_close(found, integrator)


@pytest.mark.parametrize("integrator", LEAP_FROG)
@pytest.mark.parametrize("places", ["nodes", "gauss points"])
def test_other_rows_differ_from_bars_and_their_accounts_close(integrator, places):
    of_facets = {
        "nodes": lambda left, _: at_nodes(left),
        "gauss points": lambda left, _: at_gauss_points([HEIGHT * k / left.ny for k in range(left.ny + 1)]),
    }[places]
    found = marched(integrator, "penalty", 5, 7, of_facets)
    _, across, _ = differences(found, bars(integrator, "penalty"), 5, 7)
    assert across > 1e-6
    accounts_close(found, integrator)


def test_plain_python_marches_the_same():
    places = lambda left, right: at_gauss_points(cuts(left, right))  # noqa: E731
    one = marched("wu-predictor-corrector", "penalty", 2, 3, places)
    other = marched("wu-predictor-corrector", "penalty", 2, 3, places, compiled=False)
    assert np.abs(one.u - other.u).max() < 1e-14
    assert np.abs(one.record.contact_force - other.record.contact_force).max() < 1e-13


# --------------------------------------------------------------------------------------------- rows that turn and move


class Turning(NamedTuple):
    """Rows that are renewed in every step."""

    law: np.recarray
    entries: np.recarray
    mass: np.ndarray  # of the node of each entry
    span: float  # angle of a step


def turn(data, n, u, v, a):
    """Turn the normals of all points, and move their walls."""
    angle = 0.3 + data.span * n
    cosine, sine = np.cos(angle), np.sin(angle)
    for i in range(data.law.size):
        law = data.law[i]
        law.initial_gap = -0.003 + 0.002 * np.sin(0.7 * n + i)
        law.delassus = 0.0
        for k in range(law.start, law.stop):
            entry = data.entries[k]
            entry.normal = cosine if (k - law.start) % 2 == 0 else sine
            entry.response = entry.normal / data.mass[k]
            law.delassus += entry.normal * entry.response


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize(
    ("integrator", "law"), [("central-difference", "penalty"), ("wu-predictor-corrector", "lagrange")]
)
def test_rows_that_turn_and_move_in_every_step_leave_the_ledger_closed(integrator, law, compiled):
    strip = Strip(6, 3, 0.6, 0.3, 0.0, -0.2)
    rows = [squares.Row({int(node): np.array([1.0, 0.0])}, 0.0, 0.1) for node in strip.end(right=False)]

    def further(step):
        mass = step.boundary["mass"][step.points.entries["place"]]
        return [Action(BULK, turn, Turning(step.points.law, step.points.entries, mass, 0.2), order=-1)]

    made = REGISTRY.get("contacts", law)(**LAWS[law])
    found = squares.march([strip], rows, integrator, made, 0.02, 80, compiled=compiled, further=further)
    assert found.done == 80
    assert found.record.contact_force.max() > 1e-3
    assert np.abs(found.record.energy.contact_work).max() > 1e-5
    assert found.ledger() < 1e-13
