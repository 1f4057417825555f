"""The exact solution is bounded in memory and processor time, says so, and the run goes on without it."""

import signal
import time

import numpy as np
import pytest

import percuss
import strategies
from percuss.march.model_of_case import model_of
from percuss.reporting.explanation import explanation
from percuss.reporting.verdict import run_verdict
from percuss.results.exact import exact_solution
from percuss.results.exact_only import run_exact
from percuss_methods.solutions import _row
from percuss_methods.solutions._polynomials import pieces_needed
from strategies import UNIT, case_of


def loaded(bars, contacts, end, step, loads=None, **solution):
    case = case_of(bars, contacts, {"end": end, "step": step}, loads)
    return percuss.load(case | {"method": {"contact": "lagrange", **({"solution": solution} if solution else {})}})


def bar(length, at, velocity=0.0, material=UNIT, fixed=()):
    return strategies.bar(length, 2, at, velocity, material, fixed=fixed)


def pressed(tiny, end=1.0, step=0.05, **solution):
    """Return a tiny bar between two others, which press it."""
    bars = {"a": bar(1.0, -1.0, 1.0), "tiny": bar(tiny, 0.0), "b": bar(1.0, tiny)}
    contacts = {"at": {"between": ["a.right", "tiny.left"]}, "tb": {"between": ["tiny.right", "b.left"]}}
    return loaded(bars, contacts, end, step, **solution)


TIP = {"tip": {"between": ["a.right", "b.left"]}}


def pushed(load):
    bars = {"a": bar(1.0, 0.0), "b": bar(1.0, 1.0, fixed=["right"])}
    return loaded(bars, TIP, 4.0, 0.05, {"push": {**load, "on": "a.left"}})


def unlike(**solution):
    """Return two bars whose waves meet at ever more times: the number of fronts is known only on the way."""
    other = {"young": 77.0, "density": 0.013}
    bars = {"a": bar(1.0, 0.0, 1.0, fixed=["left"]), "b": bar(0.3, 1.0, material=other, fixed=["right"])}
    return loaded(bars, TIP, 20.0, 1e-3, **solution)


@pytest.mark.parametrize("tiny", [1e-7, 1e-9])
def test_a_tiny_bar_is_refused_before_anything_is_spent(tiny):
    case = pressed(tiny)
    model, began = model_of(case), time.process_time()
    reason = exact_solution(model, 1.0)[2]
    assert time.process_time() - began < 0.5
    assert reason.startswith("bars-in-a-row: it takes more than 1 GB of memory, at least 3")
    assert reason.endswith("GB for the shortest bar (method.solution.most_memory)")
    with pytest.raises(percuss.InputError, match="most_memory"):
        run_exact(case)


def test_the_run_goes_on_without_the_exact_solution():
    case = pressed(1e-3, step=4e-4, most_memory=1e-4)
    result = percuss.run(case)
    assert result.status == "done"
    assert result.summary["exact"] is result.summary["exact_covered"] is None
    reason = result.summary["exact_reason"]
    assert reason.startswith("bars-in-a-row: it takes more than 0.0001 GB of memory, at least ")
    assert reason in " ".join(run_verdict(result, ""))
    assert reason in explanation(model_of(case)).text  # so it is known before the run, too


def test_fronts_that_multiply_end_the_solution_where_its_memory_does():
    """The part that is known follows from the case alone, so that it is the same on every machine."""
    whole, _, reason = exact_solution(model_of(unlike()), 20.0)
    assert not reason
    parts = [exact_solution(model_of(unlike(most_memory=2e-3)), 20.0) for _ in range(2)]
    part, _, reason = parts[0]
    assert 1.0 < part.reached == parts[1][0].reached < 20.0
    assert "it takes more than 0.002 GB of memory" in reason
    assert "GB or more to the end (method.solution.most_memory)" in reason
    times = np.linspace(0.0, part.reached, 1001)
    assert np.array_equal(part.contacts["tip"].force(times), whole.contacts["tip"].force(times))


def test_too_much_processor_time_leaves_no_solution_and_no_number(monkeypatch):
    monkeypatch.setattr(_row, "EVENTS", 1000)
    case = unlike(most_seconds=1e-3)
    result = percuss.run(case)
    assert result.status == "done"
    assert result.summary["exact"] is result.summary["exact_covered"] is None
    reason = result.summary["exact_reason"]
    assert reason.startswith("bars-in-a-row: it takes more than 0.001 s of processor time")
    assert reason.endswith("s or more to the end (method.solution.most_seconds)")
    assert "contact_force_exact" not in result.arrays


@pytest.mark.parametrize("frequency", [1e9, 1e16])
def test_a_load_faster_than_any_step_is_called_so_at_once(frequency):
    began = time.process_time()
    result = percuss.run(pushed({"harmonic": {"value": 1.0, "mean": 1.0, "frequency": frequency}}))
    assert time.process_time() - began < 3.0
    reason = result.summary["exact_reason"]
    assert "load 'push' (harmonic) changes too fast for polynomials" in reason
    assert "kinks" not in reason


def test_the_pieces_of_a_load_are_estimated():
    edges = np.array([0.0, 4.0])
    assert pieces_needed(lambda t: 1.0 + 2.0 * t, edges) == 1.0
    cycles = 4000.0
    assert 15.0 < pieces_needed(lambda t: np.sin(2.0 * np.pi * 1000.0 * t), edges) / cycles < 45.0
    jump = pieces_needed(lambda t: 1.0 * (t > 1.234), edges)
    assert np.isfinite(jump)  # the fit itself says that it is not smooth there


def test_ctrl_c_ends_the_exact_solution_and_keeps_the_run(monkeypatch):
    monkeypatch.setattr(_row, "EVENTS", 100)
    original, calls = _row.BarChain._advance, []

    def interrupted(self, *arrays):
        calls.append(1)
        if len(calls) == 3:
            signal.raise_signal(signal.SIGINT)
        return original(self, *arrays)

    monkeypatch.setattr(_row.BarChain, "_advance", interrupted)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        result = percuss.run(unlike(most_memory=0.9))
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert len(calls) == 3
    assert result.status == "interrupted"
    assert result.summary["steps"] == 20_000
    assert result.summary["exact"] is None
    assert result.summary["exact_reason"] == "Ctrl-C ended it"
