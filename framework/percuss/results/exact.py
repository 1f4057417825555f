"""Exact solution of a case: choice of the registered solution that covers it, and its values at recorded times."""

from __future__ import annotations

from typing import Any

import numpy as np

from percuss.blas import one_blas_thread
from percuss.contact.contact_problem import contact_problem
from percuss.heartbeat import progress
from percuss.march.model import Model
from percuss.methods.interfaces import ContactProblem, Exact, Floats, Solution
from percuss.methods.plugin_calls import answer
from percuss.results import kept_solutions

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
        None if no registered solution covers the case, or none within its bounds.
    name
        Name of the solution.
    reason
        Why there is none, or why it ends before `end`; empty otherwise.
    """
    problem = contact_problem(model)
    engine, reason = engine_for(model, problem, end)
    if engine is None:
        return None, "", reason
    progress(0.0)
    solution = kept_solutions.solve(engine, problem, end)
    if isinstance(solution, str):
        return None, "", f"{engine.name}: {solution}"
    if solution.reached >= end * (1.0 - ROUND_OFF):
        return solution, engine.name, ""
    stop_reason = solution.stopped or "it does not say why"
    return solution, engine.name, f"{engine.name} holds up to {solution.reached:.9g} only: {stop_reason}"


def engine_for(model: Model, problem: ContactProblem, end: float) -> tuple[Solution | None, str]:
    """Return the solution of the case, else the first registered one, that covers it; or None and the reasons."""
    registry, chosen = model.case.registry, model.case.method.solution
    engines: Any = [chosen] if chosen else (registry.get("solutions", name)() for name in registry.names("solutions"))
    reasons = []
    for engine in engines:
        linear_only = model.why_not_linear if engine.linear_bodies_only else ""
        reason = linear_only or answer(engine, "covers", problem) or answer(engine, "too_costly", problem, end)
        if reason is None:
            return engine, ""
        reasons.append(f"{engine.name}: {reason}")
    return None, "; ".join(reasons) or "no solution engine is registered"


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
