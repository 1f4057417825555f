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
from strategies import CORE_PAIRS, LEAPFROG, apart, bar, case_of, each_pair, run, with_pair

BOUNCE = case_of(
    {
        "hammer": bar(2.0, 41, 0.0, 0.3, {"young": 3.0, "density": 0.7}, 1.1),
        "rod": bar(3.0, 67, 2.01, 0.0, {"young": 1.0, "density": 1.3}, 0.8, ["right"]),
    },
    {"tip": {"between": ["hammer.right", "rod.left"]}},
    {"steps": 700, "courant": 0.6},
    {"push": {"half-sine": {"peak": 0.2, "duration": 3.0}, "on": "hammer.left"}},
) | {"record": {"every": 37}}


def uniform_of(case):
    return March(model_of(percuss.load(case))).arrays.uniform


@pytest.fixture
def general(monkeypatch):
    """Run a case once with the update of uniform rows, and once without; return what each gives."""

    def both(run_of):
        uniform = run_of()
        monkeypatch.setattr(uniform_rows, "uniform_bars", lambda model, nodes: bars([]))
        return uniform, run_of()

    return both


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
    whole = bars([(0, 5, dt * stiffness, 1 / 0.3 - 1, 1 / 0.7 - 1, 1.0, 0.3, 0.7, stiffness)])
    data = UniformRows(whole, empty_records(1, TOTAL), dt)
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
def test_a_run_is_the_same_with_the_kernels(pair, general):
    case = with_pair(BOUNCE, pair)
    assert uniform_of(case)
    uniform, other = general(lambda: run(case))
    assert other.arrays["contact_force"].max() > 0.0
    assert max(apart(other, uniform).values()) <= 1e-11
    assert uniform.summary["energy"]["ledger_error"] < 1e-13


def test_an_unstable_run_stops_at_the_same_step_and_node(general):
    def stopped():
        with pytest.raises(percuss.RunError) as caught:
            run({**BOUNCE, "time": {"steps": 700, "courant": 1.05, "on_unstable": "warn"}})
        return {key: caught.value.result.summary["stop"][key] for key in ("step", "node", "what", "cause")}

    uniform, other = general(stopped)
    assert uniform == other


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
