"""Runs of the same problem share its exact solution, and only they do."""

import numpy as np
import pytest

import percuss
import places
from percuss.results import exact

HUNEK = str(places.ROOT / "cases" / "hunek.yaml")
SMALL = {"bodies.short.bar.elements": 5, "bodies.long.bar.elements": 10}


@pytest.fixture
def solved(monkeypatch):
    """Return the list of problems that were solved."""
    monkeypatch.setattr(exact, "_kept", {})
    problems = []
    engine = percuss.load(HUNEK).registry.get("solutions", "bars-in-a-row")
    solve = engine.solve

    def counted(self, problem, end):
        problems.append((problem, end))
        return solve(self, problem, end)

    monkeypatch.setattr(engine, "solve", counted)
    return problems


def run(**changes):
    return percuss.run(percuss.load(HUNEK, SMALL | changes))


def test_runs_that_differ_in_their_methods_alone_share_it(solved):
    first = run()
    again = run(**{"method.contact": "lagrange"})
    assert first.solution is again.solution
    assert len(solved) == 1
    exact = [one.arrays["contact_force_exact"] for one in (first, again)]
    assert np.array_equal(*exact)
    assert exact[0] is not exact[1]


@pytest.mark.parametrize(
    "change",
    [
        {"bodies.short.velocity": -0.1000000001},
        {"bodies.short.area": 1.0000000001},
        {"bodies.long.material": {"young": 100.0, "density": 0.0100000001}},
        {"time.end": 1.9},
        {"bodies.long.at": 10.001},
    ],
)
def test_any_other_problem_is_solved_anew(solved, change):
    run()
    run(**change)
    assert len(solved) == 2


def test_what_a_reader_changes_in_a_result_is_not_in_the_next(solved):
    first = run()
    first.arrays["contact_force_exact"][:] = 7.0
    run().arrays["gap_exact"][:] = 7.0
    third = run()
    assert len(solved) == 1
    assert third.summary["exact"] == first.summary["exact"]
    assert (third.arrays["contact_force_exact"] != 7.0).any()
    assert (third.arrays["gap_exact"] != 7.0).all()


def test_a_problem_with_loads_is_solved_anew(solved):
    """The amplitude of a load may depend on more than its options."""
    for _ in range(2):
        run(loads={"push": {"constant": {"value": 1e-3}, "on": "long.right"}})
    assert len(solved) == 2


def test_few_solutions_are_kept(solved):
    for velocity in np.linspace(-0.1, -0.2, 7):
        run(**{"bodies.short.velocity": float(velocity)})
    assert len(exact._kept) == exact.MOST_KEPT
    run(**{"bodies.short.velocity": -0.2})
    assert len(solved) == 7
    run(**{"bodies.short.velocity": -0.1})
    assert len(solved) == 8
