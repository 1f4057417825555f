"""Exact solution of a case: choice of the registered solution that covers it, and its values at recorded times."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.blas import one_blas_thread
from percuss.methods.plugin_calls import answer
from percuss.results import kept_solutions
from percuss.solver.contact_problem import contact_problem

if TYPE_CHECKING:
    from percuss.methods.interfaces import ContactProblem, Exact, Floats, Solution
    from percuss.solver.model import Model

ROUND_OFF = 1e-12  # relative tolerance of times; a force below this fraction of the peak counts as zero


@one_blas_thread()
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
    problem = contact_problem(model)
    reasons = []
    for name in registry.names("solutions"):
        engine: Any = registry.get("solutions", name)()
        uncovered_reason = why_not_covered(engine, model, problem)
        if uncovered_reason is not None:
            reasons.append(f"{name}: {uncovered_reason}")
            continue
        solution = kept_solutions.solve(engine, problem, end)
        if solution.reached >= end * (1.0 - ROUND_OFF):
            return solution, name, ""
        stop_reason = solution.stopped or "it does not say why"
        return solution, name, f"{name} holds up to {solution.reached:.9g} only: {stop_reason}"
    return None, "", "; ".join(reasons) or "no solution engine is registered"


def why_not_covered(solution: Solution, model: Model, problem: ContactProblem) -> str | None:
    """Return the reason why an exact solution does not cover a case with this problem, or None if it does."""
    if solution.linear_bodies_only and model.why_not_linear:
        return model.why_not_linear
    reason: str | None = answer(solution, "covers", problem)
    return reason


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
    places = tuple(names), time.tobytes(), middle.tobytes(), dt
    force, gap = kept_solutions.values_at(
        solution, "histories", places, lambda: _histories(solution, names, time, middle, dt)
    )
    return {"contact_force_exact": force, "gap_exact": gap}


def impulse_at(solution: Exact, name: str, time: Floats) -> Floats:
    """Return the exact impulse of the contact `name` from 0 to each of several times."""
    (impulse,) = kept_solutions.values_at(
        solution, ("impulse", name), time.tobytes(), lambda: (solution.contacts[name].impulse(time),)
    )
    return impulse


def displacement_at(solution: Exact, name: str, along: Floats, time: float) -> Floats:
    """Return the exact displacement of the body `name` at distances `along` from its start, along its direction."""
    (displacement,) = kept_solutions.values_at(
        solution,
        ("displacement", name),
        (along.tobytes(), time),
        lambda: (solution.displacement(name, along, np.full(along.shape, time)),),
    )
    return displacement


def _histories(solution: Exact, names: list[str], time: Floats, middle: Floats, dt: float) -> tuple[Floats, Floats]:
    """Return force, averaged over each step, and gap of the contacts, (T, contacts) each."""
    covered = middle + 0.5 * dt <= solution.reached * (1.0 + 1e-12)
    force = np.full((time.size, len(names)), np.nan)
    gap = np.full((time.size, len(names)), np.nan)
    for k, name in enumerate(names):
        contact = solution.contacts[name]
        force[covered, k] = contact.mean_force(middle[covered] - 0.5 * dt, middle[covered] + 0.5 * dt)
        gap[covered, k] = contact.gap(time[covered])
    return force, gap
