"""Bars of equal elements, which the loop advances itself, against the general update."""

import numpy as np
import pytest

import percuss
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.step import uniform_rows
from percuss.step.uniform_rows import UNIFORM_BAR
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
