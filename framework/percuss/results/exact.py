"""The exact solution of a case: which one covers it, and its values at the times of a record."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from percuss.methods.interfaces import Exact, Floats, Solution
    from percuss.solver.model import Model
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from percuss.methods.interfaces import Exact, Floats
    from percuss.solver.model import Model


def exact_solution(model: Model, end: float) -> tuple[Exact | None, str, str]:
    """Return the exact solution of a model up to `end`.

    Parameters
    ----------
    model
        The case as arrays.
    end
        Time up to which it is wanted.

    Returns
    -------
    solution
        None where no registered solution covers the case.
    name
        Of the solution.
    reason
        Why there is none, or why it stops before `end`; empty otherwise.
    """
    registry = model.case.registry
    reasons = []
    for name in registry.names("solutions"):
        engine: Any = registry.get("solutions", name)()
        why = why_not_covered(engine, model)
        if why is not None:
            reasons.append(f"{name}: {why}")
            continue
        solution = engine.solve(model, end)
        if solution.reached >= end * (1.0 - ROUND_OFF):
            return solution, name, ""
        why = solution.stopped or "it does not say why"
        return solution, name, f"{name} holds up to {solution.reached:.9g} only: {why}"
    return None, "", "; ".join(reasons) or "no solution engine is registered"


def why_not_covered(solution: Solution, model: Model) -> str | None:
    """Return why an exact solution does not cover a case, or None where it does."""
    if solution.linear_bodies_only and model.why_not_linear:
        return model.why_not_linear
    return solution.covers(model)


def sampled(solution: Exact, names: list[str], time: Floats, middle: Floats, dt: float) -> dict[str, Floats]:
    """Return the exact histories on the time axis of a run; nan behind the time the solution reached.

    Parameters
    ----------
    solution, names
        The exact solution, and the contacts asked for.
    time
        Times of the records.
    middle
        Middle of the step whose impulse each record of the force is.
    dt
        Time step.

    Returns
    -------
    dict
        ``contact_force_exact``, averaged over each step as the impulse lambda dt is, and ``gap_exact``; (T, contacts).
    """
    known = middle + 0.5 * dt <= solution.reached * (1.0 + 1e-12)
    force = np.full((time.size, len(names)), np.nan)
    gap = np.full((time.size, len(names)), np.nan)
    for k, name in enumerate(names):
        contact = solution.contacts[name]
        force[known, k] = contact.mean_force(middle[known] - 0.5 * dt, middle[known] + 0.5 * dt)
        gap[known, k] = contact.gap(time[known])
    return {"contact_force_exact": force, "gap_exact": gap}


ROUND_OFF = 1e-12  # of the peak: a smaller force is none
