"""Exact solution of a case: the choice of the registered solution that covers it, and its values at recorded times."""

from __future__ import annotations

import functools
import pickle
from typing import Any, cast

import numpy as np

from percuss.blas import one_blas_thread
from percuss.contact.contact_problem import contact_problem
from percuss.contact.model import Model
from percuss.interrupt import progress
from percuss.methods.interfaces import ContactProblem, Exact, Solution
from percuss.methods.plugin_calls import answer

ROUND_OFF = 1e-12  # relative tolerance of times; a force below this fraction of the peak counts as zero


@one_blas_thread()
def exact_solution(model: Model, end: float, *, of_contact: bool = False) -> tuple[Exact | None, str, str]:
    """Return the exact solution of a model up to `end`.

    Parameters
    ----------
    model
        The case as arrays.
    end
        Time up to which the solution is needed.
    of_contact
        Whether it is that of contact even where a law holds the bodies together.

    Returns
    -------
    solution
        None if no registered solution covers the case, or none within its bounds.
    name
        Name of the solution.
    reason
        Why there is none, or why it ends before `end`; empty otherwise.
    """
    engine, problem, reason = engine_for(model, end, of_contact=of_contact)
    if engine is None or problem is None:
        return None, "", reason
    progress(0.0)
    solution = solve(engine, problem, end)
    if isinstance(solution, str):
        return None, "", f"{engine.name}: {solution}"
    if solution.reached >= end * (1.0 - ROUND_OFF):
        return solution, engine.name, ""
    stop_reason = solution.stopped or "it does not say why"
    return solution, engine.name, f"{engine.name} holds up to {solution.reached:.9g} only: {stop_reason}"


def engine_for(
    model: Model, end: float, *, of_contact: bool = False
) -> tuple[Solution | None, ContactProblem | None, str]:
    """Return the solution of the case, else the first registered one, that covers it, with the problem that it solves.

    If none covers it, both are None, and the text has the reasons. Parameters are those of `exact_solution`.
    """
    problem = contact_problem(model)
    if isinstance(problem, str):
        return None, None, f"the bodies do not move as a row of bars: {problem}"
    prisms = any(body.modulus is not None for body in problem.bodies.values())
    registry, chosen = model.case.registry, model.case.method.solution
    engines: Any = [chosen] if chosen else (registry.get("solutions", name)() for name in registry.names("solutions"))
    reasons = []
    for engine in engines:
        linear_only = model.bodies.why_not_linear if engine.linear_bodies_only else ""
        unaware = "it knows no prisms" if prisms and not engine.of_prisms else ""
        reason = (
            linear_only or unaware or answer(engine, "covers", problem) or answer(engine, "too_costly", problem, end)
        )
        reason = reason or ("" if of_contact else _bond_in(model, engine, problem, end))
        if not reason:
            return engine, problem, ""
        reasons.append(f"{engine.name}: {reason}")
    return None, None, "; ".join(reasons) or "no solution engine is registered"


def _bond_in(model: Model, engine: Solution, problem: ContactProblem, end: float) -> str:
    """Return why the exact solution of contact does not judge bodies that a law holds together; empty if none does.

    It judges those that are tied while the exact contact is closed, where the law makes no difference.
    """
    for bound_law in filter(lambda bound_law: bound_law.bonds, model.laws):
        for name in dict.fromkeys(bound_law.points.names):
            said = f"contact '{name}' ({bound_law.law.name}) holds its bodies together"
            if bound_law.during is None:
                return f"{said}, and the solution is that of bodies that may part"
            solution = solve(engine, problem, end)
            exact = () if isinstance(solution, str) else solution.contacts[name].closed
            tied, closed = (np.minimum(np.reshape(times, (-1, 2)), end) for times in (bound_law.during, exact))
            tied, closed = (times[times[:, 0] < times[:, 1]] for times in (tied, closed))
            if tied.shape != closed.shape or np.abs(tied - closed).max(initial=0.0) > ROUND_OFF * end:
                return f"{said} at other times than those at which the exact contact is closed"
    return ""


def solve(engine: Solution, problem: ContactProblem, end: float) -> Exact | str:
    """Return the exact solution of a problem up to `end`, or why there is none.

    The last one is kept for the next run, as runs of a study often differ in their methods alone.
    """
    try:
        return _solved(pickle.dumps((engine, problem, end)))
    except (pickle.PicklingError, TypeError, AttributeError):  # a class of a single file
        return cast("Exact | str", answer(engine, "solve", problem, end))


@functools.lru_cache(maxsize=1)
def _solved(asked: bytes) -> Exact | str:
    """Return the solution of a problem given by its bits."""
    engine, problem, end = pickle.loads(asked)  # noqa: S301 - written above
    return cast("Exact | str", answer(engine, "solve", problem, end))
