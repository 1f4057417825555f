"""Bars of equal elements, which the loop advances itself by several steps at a time, against the general update."""

import numpy as np
import pytest

import percuss
from percuss.solver import march, uniform_bars
from percuss.solver.compiled.uniform_bars import (
    UNIFORM_BAR,
    UniformBars,
    advance_ends,
    advance_inside,
    advance_row,
    advance_whole,
    energies,
)
from percuss.solver.march import March
from percuss.solver.model import Model
from strategies import CORE_PAIRS, LEAPFROG, PAIRS, each_pair, hunek, run, with_pair

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
    made = March(Model(percuss.load(case)))
    return made.uniform


def advance_by_many(monkeypatch, steps=3):
    """Advance short bars by many steps too; by three steps, the bars of `BOUNCE` have several tiles."""
    for name, value in {"SHORT_BAR": 40, "TILE": 8, "STEPS": steps}.items():
        monkeypatch.setattr(uniform_bars, name, value)


def no_bars(model, nodes):
    return bars([], 1, 1)


def a_bar(nodes, rate, left, right, start=0, mass=1.0, stiffness=1.0):
    return (start, start + nodes, rate, left, right, mass, mass / (1 + left), mass / (1 + right), stiffness)


def bars(rows, steps, tile):
    count = len(rows)
    return UniformBars(
        np.array(rows, dtype=UNIFORM_BAR).view(np.recarray), steps, tile,
        np.zeros((count, steps)), np.zeros((count, steps)), np.zeros(steps),
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------- the functions


@pytest.mark.parametrize(("steps", "tile"), [(1, 8), (2, 8), (3, 300), (4, 8), (7, 16), (8, 24), (16, 8)])
def test_several_steps_at_a_time_are_the_same_steps_to_the_last_bit(steps, tile):
    generator = np.random.default_rng(steps)
    rows = [a_bar(237, 0.3, 1.0, 1.0), a_bar(40, 0.2, 0.4, -0.5, start=237)]
    one_by_one, together = bars(rows, 1, tile), bars(rows, steps, tile)
    u, v = generator.uniform(-1, 1, 277), generator.uniform(-1, 1, 277)
    expected_u, expected_v = u.copy(), v.copy()
    for _ in range(3):
        kicks = generator.uniform(-1, 1, (steps, 4))  # what contacts and supports do to the ends
        for k in range(steps):
            advance_whole(one_by_one, expected_u, expected_v, 0.1)
            expected_u[[0, 236, 237, 276]] += kicks[k]
        advance_inside(together, u, v, steps, 0.1)
        for k in range(steps):
            advance_ends(together, u, v, k, 0.1)
            u[[0, 236, 237, 276]] += kicks[k]
        assert (u == expected_u).all()
        assert (v == expected_v).all()


def test_a_whole_bar_moves_by_its_stiffness_and_masses():
    generator = np.random.default_rng(0)
    mass = np.array([0.3, 1.0, 1.0, 1.0, 0.7])
    stiffness, dt = 5.0, 0.05
    u, v = generator.uniform(-1, 1, 5), generator.uniform(-1, 1, 5)
    matrix = stiffness * (np.diag([1.0, 2, 2, 2, 1]) - np.diag(np.ones(4), 1) - np.diag(np.ones(4), -1))
    expected_v = v - dt * (matrix @ u) / mass
    expected_u = u + dt * expected_v
    expected_elastic = 0.5 * u @ matrix @ expected_u
    bar = bars([a_bar(5, dt * stiffness, 1 / 0.3 - 1, 1 / 0.7 - 1, stiffness=stiffness)], 1, 8)
    advance_whole(bar, u, v, dt)
    assert v == pytest.approx(expected_v, rel=1e-13)
    assert u == pytest.approx(expected_u, rel=1e-13)
    kinetic, elastic = energies(bar, u, v, dt)
    assert kinetic == pytest.approx(0.5 * mass @ v**2, rel=1e-13)
    assert elastic == pytest.approx(expected_elastic, rel=1e-12)


def test_a_row_of_one_node_has_an_element_on_either_side():
    u, v = np.array([0.0]), np.array([1.0])
    advance_row(u, v, 0, 1, 0.25, 0.5, 2.0, 0.1)
    assert (u[0], v[0]) == (pytest.approx(0.15), pytest.approx(1.5))


# ------------------------------------------------------------------------------------------------------ the runs


# Bars of schemes with viscosity, of laws that shift positions and of those that see end forces need the kernels.
FAST = [pair for pair in PAIRS if pair[0] in LEAPFROG and uniform_of(with_pair(BOUNCE, pair)).bars.size > 0]


def test_the_core_pairs_of_leap_frog_schemes_need_no_kernels_in_uniform_bars():
    assert [pair for pair in CORE_PAIRS if pair[0] in LEAPFROG and pair not in FAST] == []


@each_pair(FAST)
def test_a_run_is_the_same_by_one_step_by_many_and_with_the_kernels(pair, monkeypatch):
    """By one step and by many to the last bit; only long bars are advanced by many, here short ones are too."""
    case = with_pair(BOUNCE, pair)
    one_by_one = run(case)
    advance_by_many(monkeypatch)
    assert uniform_of(case).steps == uniform_bars.STEPS
    together = run(case)
    for name, values in one_by_one.arrays.items():
        assert values.tobytes() == together.arrays[name].tobytes(), name
    assert one_by_one.summary["energy"] == together.summary["energy"]
    monkeypatch.setattr(march, "uniform_bars", no_bars)
    general = run(case)
    assert largest_force(general) > 0.0
    for name in ("contact_force", "gap", "displacement", "velocity", "kinetic_energy", "elastic_energy"):
        one, other = together.arrays[name], general.arrays[name]
        assert np.abs(one - other).max() <= 1e-11 * max(np.abs(other).max(), 1.0), name
    assert together.summary["energy"]["ledger_error"] < 1e-13


def test_snapshots_records_and_stretches_meet_all_nodes_at_the_same_step(monkeypatch):
    """The steps at a time fit neither between two snapshots nor between two records, nor into a stretch."""
    case = {**BOUNCE, "record": {"every": 11, "fields": 7}}
    one_by_one = run(case)
    advance_by_many(monkeypatch, steps=6)
    monkeypatch.setattr(march, "CHUNK_STEPS", 50)
    together = run(case)
    for name, values in one_by_one.arrays.items():
        assert values.tobytes() == together.arrays[name].tobytes(), name
    assert one_by_one.field_arrays["stress"].tobytes() == together.field_arrays["stress"].tobytes()
    assert one_by_one.summary["contacts"] == together.summary["contacts"]


def test_the_plain_loop_makes_several_steps_at_a_time_too(monkeypatch):
    advance_by_many(monkeypatch)
    case = {**BOUNCE, "time": {"steps": 150, "courant": 0.6}}
    compiled, plain = run(case), run(case, compiled=False)
    assert largest_force(plain) > 0.0
    for name, values in compiled.arrays.items():
        np.testing.assert_allclose(plain.arrays[name], values, rtol=0.0, atol=1e-12 * max(np.abs(values).max(), 1.0))


def largest_force(result):
    return result.arrays["contact_force"].max()


def test_an_unstable_run_stops_at_the_same_step_and_node(monkeypatch):
    case = {**BOUNCE, "time": {"steps": 700, "courant": 1.05, "on_unstable": "warn"}}
    stops = []
    for change in (lambda monkeypatch: None, advance_by_many):
        change(monkeypatch)
        with pytest.raises(percuss.RunError) as stopped:
            run(case)
        stops.append(stopped.value.result.summary["stop"])
    monkeypatch.setattr(march, "uniform_bars", no_bars)
    with pytest.raises(percuss.RunError) as stopped:
        run(case)
    general = stopped.value.result.summary["stop"]
    assert stops[0] == stops[1]
    assert {key: stops[0][key] for key in ("step", "node", "what", "cause")} == {
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
    assert uniform_of(BOUNCE).bars.size == 2
    assert March(Model(percuss.load(BOUNCE, changes))).uniform.bars.size == 0


def test_an_element_that_is_no_spring_is_called(monkeypatch):
    assert uniform_of(hunek(10)).bars.size == 2
    uniform_bars._is_spring.cache_clear()
    monkeypatch.setattr(uniform_bars.ElementProbe, "force", lambda self, number, displacement: np.zeros(2))
    assert uniform_of(hunek(10)).bars.size == 0
    uniform_bars._is_spring.cache_clear()


def test_an_element_of_somebody_else_is_called(monkeypatch):
    monkeypatch.setattr(uniform_bars, "is_third_party", lambda module: True)
    assert uniform_of(hunek(10)).bars.size == 0
