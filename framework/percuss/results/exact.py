"""Exact solution of a case: choice of the registered solution that covers it, and its values at recorded times."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.results import kept_solutions
from percuss.solver.contact_problem import contact_problem

if TYPE_CHECKING:
    from percuss.methods.interfaces import Exact, Floats, Solution
    from percuss.solver.model import Model

ROUND_OFF = 1e-12  # relative tolerance of times; a force below this fraction of the peak counts as zero


def exact_solution(model: Model, end: float) -> tuple[Exact | None, str, str]:
    """Return the exact solution of a model up to `end`.

    Parameters
    ----------
    model
        The case as arrays.
    end
        Time up to which the solution is needed.

    Returns
    -------
    solution
        None if no registered solution covers the case.
    name
        Name of the solution.
    reason
        Why there is none, or why it ends before `end`; empty otherwise.
    """
    registry = model.case.registry
    reasons = []
    for name in registry.names("solutions"):
        engine: Any = registry.get("solutions", name)()
        uncovered_reason = why_not_covered(engine, model)
        if uncovered_reason is not None:
            reasons.append(f"{name}: {uncovered_reason}")
            continue
        solution = kept_solutions.solve(engine, contact_problem(model), end)
        if solution.reached >= end * (1.0 - ROUND_OFF):
            return solution, name, ""
        stop_reason = solution.stopped or "it does not say why"
        return solution, name, f"{name} holds up to {solution.reached:.9g} only: {stop_reason}"
    return None, "", "; ".join(reasons) or "no solution engine is registered"


def why_not_covered(solution: Solution, model: Model) -> str | None:
    """Return the reason why an exact solution does not cover a case, or None if it does."""
    if solution.linear_bodies_only and model.why_not_linear:
        return model.why_not_linear
    return solution.covers(contact_problem(model))


def sampled(solution: Exact, names: list[str], time: Floats, middle: Floats, dt: float) -> dict[str, Floats]:
    """Return the exact histories on the time axis of a run, nan after the time that the exact solution reached.

    Parameters
    ----------
    solution, names
        The exact solution, and the names of the contacts.
    time
        Times of the records.
    middle
        Middle of the step over which each recorded force acts.
    dt
        Time step.

    Returns
    -------
    dict
        ``contact_force_exact``, averaged over each step as the impulse lambda dt is, and ``gap_exact``; (T, contacts)
        each.
    """
    times = tuple(names), time.tobytes(), middle.tobytes(), dt
    return kept_solutions.histories_at(solution, times, lambda: _histories(solution, names, time, middle, dt))


def _histories(solution: Exact, names: list[str], time: Floats, middle: Floats, dt: float) -> dict[str, Floats]:
    covered = middle + 0.5 * dt <= solution.reached * (1.0 + 1e-12)
    force = np.full((time.size, len(names)), np.nan)
    gap = np.full((time.size, len(names)), np.nan)
    for k, name in enumerate(names):
        contact = solution.contacts[name]
        force[covered, k] = contact.mean_force(middle[covered] - 0.5 * dt, middle[covered] + 0.5 * dt)
        gap[covered, k] = contact.gap(time[covered])
    return {"contact_force_exact": force, "gap_exact": gap}
