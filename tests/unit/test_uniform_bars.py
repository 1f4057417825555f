"""Bars of equal elements, which the loop advances itself, against the general update."""

import numpy as np
import pytest

import percuss
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.record_arrays import empty_records
from percuss.step import uniform_rows
from percuss.step.records import TOTAL
from percuss.step.uniform_rows import UNIFORM_BAR, UniformRows, add_energies, advance_uniform_row, advance_whole
from strategies import CORE_PAIRS, LEAPFROG, each_pair, run, with_pair

BOUNCE = {
    "percuss": 1,
    "bodies": {
        "hammer": {
            "bar": {"length": 2.0, "elements": 41}, "material": {"young": 3.0, "density": 0.7}, "area": 1.1,
            "velocity": 0.3, "at": 0.0,
        },
        "rod": {
            "bar": {"length": 3.0, "elements": 67}, "at": 2.01, "material": {"young": 1.0, "density": 1.3}, "area": 0.8,
            "fixed": ["right"],
        },
    },
    "contacts": {"tip": {"between": ["hammer.right", "rod.left"]}},
    "loads": {"push": {"half-sine": {"peak": 0.2, "duration": 3.0}, "on": "hammer.left"}},
    "method": {"integrator": "central-difference", "contact": "penalty"},
    "time": {"steps": 700, "courant": 0.6},
    "record": {"every": 37},
}  # fmt: skip


def uniform_of(case):
    made = March(model_of(percuss.load(case)))
    return made.arrays.uniform


def no_bars(model, nodes):
    return bars([])


def a_bar(nodes, rate, left, right, start=0, mass=1.0, stiffness=1.0):
    return (start, start + nodes, rate, left, right, mass, mass / (1 + left), mass / (1 + right), stiffness)


def bars(rows):
    return np.array(rows, dtype=UNIFORM_BAR).view(np.recarray)


# ------------------------------------------------------------------------------------------------- the functions


def test_a_whole_bar_moves_by_its_stiffness_and_masses():
    generator = np.random.default_rng(0)
    mass = np.array([0.3, 1.0, 1.0, 1.0, 0.7])
    stiffness, dt = 5.0, 0.05
    u, v = generator.uniform(-1, 1, 5), generator.uniform(-1, 1, 5)
    matrix = stiffness * (np.diag([1.0, 2, 2, 2, 1]) - np.diag(np.ones(4), 1) - np.diag(np.ones(4), -1))
    expected_v = v - dt * (matrix @ u) / mass
    expected_u = u + dt * expected_v
    expected_elastic = 0.5 * u @ matrix @ expected_u
    bar = bars([a_bar(5, dt * stiffness, 1 / 0.3 - 1, 1 / 0.7 - 1, stiffness=stiffness)])
    data = UniformRows(bar, empty_records(1, TOTAL), dt)
    advance_whole(data, 0, u, v, v)
    assert v == pytest.approx(expected_v, rel=1e-13)
    assert u == pytest.approx(expected_u, rel=1e-13)
    add_energies(data, 0, u, v, v)
    kinetic, elastic = data.totals[0].kinetic_energy, data.totals[0].elastic_energy
    assert kinetic == pytest.approx(0.5 * mass @ v**2, rel=1e-13)
    assert elastic == pytest.approx(expected_elastic, rel=1e-12)


def test_a_row_of_one_node_has_an_element_on_either_side():
    u, v = np.array([0.0]), np.array([1.0])
    advance_uniform_row(u, v, 0.25, 0.5, 2.0, 0.1)
    assert (u[0], v[0]) == (pytest.approx(0.15), pytest.approx(1.5))


# ------------------------------------------------------------------------------------------------------ the runs


@each_pair([pair for pair in CORE_PAIRS if pair[0] in LEAPFROG])
def test_a_run_is_the_same_with_the_kernels(pair, monkeypatch):
    case = with_pair(BOUNCE, pair)
    assert uniform_of(case)
    uniform = run(case)
    monkeypatch.setattr(uniform_rows, "uniform_bars", no_bars)
    general = run(case)
    assert largest_force(general) > 0.0
    for name in ("contact_force", "gap", "displacement", "velocity", "kinetic_energy", "elastic_energy"):
        one, other = uniform.arrays[name], general.arrays[name]
        assert np.abs(one - other).max() <= 1e-11 * max(np.abs(other).max(), 1.0), name
    assert uniform.summary["energy"]["ledger_error"] < 1e-13


def largest_force(result):
    return result.arrays["contact_force"].max()


def test_an_unstable_run_stops_at_the_same_step_and_node(monkeypatch):
    case = {**BOUNCE, "time": {"steps": 700, "courant": 1.05, "on_unstable": "warn"}}
    with pytest.raises(percuss.RunError) as stopped:
        run(case)
    uniform = stopped.value.result.summary["stop"]
    monkeypatch.setattr(uniform_rows, "uniform_bars", no_bars)
    with pytest.raises(percuss.RunError) as stopped:
        run(case)
    general = stopped.value.result.summary["stop"]
    assert {key: uniform[key] for key in ("step", "node", "what", "cause")} == {
        key: general[key] for key in ("step", "node", "what", "cause")
    }


@pytest.mark.parametrize(
    "changes",
    [
        {"bodies.rod.bar.grading": 2.0},
        {"loads.push": {"gravity": -0.1}},
        {"bodies.hammer.at": [0.0, 0.0], "bodies.rod.at": [2.01, 0.0]},
        {"method.integrator": "noh-bathe"},
    ],
    ids=["unlike elements", "load on bodies", "two dimensions", "multi-stage"],
)
def test_other_bodies_are_advanced_by_their_kernels(changes):
    assert uniform_of(BOUNCE)
    assert not March(model_of(percuss.load(BOUNCE, changes))).arrays.uniform
