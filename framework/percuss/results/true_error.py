"""The true error of a run: its histories held against the exact solution of its case, where there is one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.results.exact import ROUND_OFF

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.methods.interfaces import Exact, ExactContact, Floats
    from percuss.solver.model import Model

NOTHING = 1e-18
ERRORS = (
    *("force_error_l1", "force_error_l2", "impulse_error", "noise", "overshoot"),
    *("closing_error", "opening_error"),
)
NUDGE = 1e-12
FRAGILE = 1e-4


def verdict(errors: dict[str, Any] | None, reason: str) -> dict[str, Any]:
    """Return what a summary says about the exact solution.

    Parameters
    ----------
    errors
        What was found by holding a run against its solution, with the time ``reached``; None where there is none.
    reason
        Why there is none, or why it ends before the run does; empty where it covers the whole run.

    Returns
    -------
    dict
        ``exact``: the errors of the whole run, None where they are not known; ``exact_reason``: why not; and
        ``exact_covered``: what is known up to the time ``until``, where the solution ends before the run does. Two runs
        that are known for a part of their time are not to be compared by it: what compares runs reads ``exact``.
    """
    if errors is None or not reason:
        return {"exact": errors, "exact_reason": reason or None, "exact_covered": None}
    part = {key: value for key, value in errors.items() if key in {"solution", "fronts", "contacts"}}
    return {"exact": None, "exact_reason": reason, "exact_covered": {"until": errors["reached"], **part}}


def contact_errors(
    contact: ExactContact, time: Floats, force: Floats, exact: Floats, dt: float, reached: float, *, every: int
) -> dict[str, Any]:
    """Return the errors of one contact's force history.

    Parameters
    ----------
    contact
        The exact contact.
    time, force
        The run's records, at the middle of the step whose impulse each is.
    exact
        The exact force averaged over that step.
    dt
        Time step.
    reached
        Time up to which the exact solution holds.
    every
        Steps between two records; errors of the force need every step, and are None without.

    Returns
    -------
    dict
        Errors of the force in L1 and L2, of the impulse, `noise`, `overshoot`; `closing_error` and `opening_error`, by
        how much the middle of the first and of the last step that presses is late, which is known to half a step; and
        the intervals in which the exact contact is `closed`.
    """
    known = np.isfinite(exact)
    time, force, exact = time[known], force[known], exact[known]
    difference = force - exact
    scale_1, scale_2 = float(np.abs(exact).sum()), float(np.sqrt((exact**2).sum()))
    variation = float(np.abs(np.diff(exact, prepend=0.0)).sum())
    impulse = None
    if every == 1 and time.size:
        summed = np.cumsum(force) * dt
        true = contact.impulse(time + 0.5 * dt)
        impulse = _over(float(np.abs(summed - true).max()), float(np.abs(true).max()))
    closed = [interval for interval in contact.closed if interval[0] < reached]
    pressed = np.flatnonzero(force > ROUND_OFF * force.max(initial=0.0))
    found = {
        "force_error_l1": _over(float(np.abs(difference).sum()), scale_1),
        "force_error_l2": _over(float(np.sqrt((difference**2).sum())), scale_2),
        "impulse_error": impulse,
        "noise": _over(float(np.abs(np.diff(force, prepend=0.0)).sum()), variation),
        "overshoot": _over(float(force.max(initial=0.0)), float(exact.max(initial=0.0)), minus=1.0),
        "closing_error": float(time[pressed[0]] - closed[0][0]) if closed and pressed.size else None,
        "opening_error": _opening_error(time, pressed, closed, reached),
        "closed": [list(interval) for interval in closed[:100]],
    }
    # what lies between sparse records is not known: these would be errors of the records
    return found | dict.fromkeys(ERRORS) if every > 1 or not time.size else found


def _over(value: float, scale: float, minus: float = 0.0) -> float | None:
    """Return value over scale; None where the exact quantity is zero, unless the value is too."""
    if scale > 0.0:
        return value / scale - minus
    return 0.0 if value == 0.0 else None


def _opening_error(time: Floats, pressed: Any, closed: list[tuple[float, float]], reached: float) -> float | None:
    """Return by how much the last step that presses is late; None where run or exact contact are closed at the end.

    Both its ends count: of steps that overlap an interval the last has its middle before or behind the interval's end
    by half a step at most, as the first has at the start.
    """
    if not closed or not pressed.size or pressed[-1] == time.size - 1:
        return None
    if closed[-1][1] >= reached * (1.0 - ROUND_OFF):
        return None
    return float(time[pressed[-1]] - closed[-1][1])


def displacement_error(model: Model, solution: Exact, displacement: Floats, time: float) -> float | None:
    """Return the error of the displacement along the bars at `time`, in L2 over all bars, relative.

    Parameters
    ----------
    model, solution
        The case and its exact solution.
    displacement : (nodes, dim) array
        Of the run at `time`.
    time
        At most what the solution reached.
    """
    if time > solution.reached * (1.0 + 1e-12):
        return None
    error = size = 0.0
    for body in model.bodies.values():
        along = np.concatenate([[0.0], np.cumsum(body.mesh.lengths)])
        weight = np.zeros(along.size)
        weight[:-1] += 0.5 * body.mesh.lengths
        weight[1:] += 0.5 * body.mesh.lengths
        true = solution.displacement(body.name, along, np.full(along.shape, time))
        found = displacement[body.start : body.stop] @ body.mesh.direction
        error += float(weight @ (found - true) ** 2)
        size += float(weight @ true**2)
    if size < NOTHING * error:  # a bar back where it began: an error relative to round-off says nothing
        return None
    return _over(float(np.sqrt(error)), float(np.sqrt(size)))


def nudged(case: Case, courant: float) -> Case:
    """Return the case with its first body a hair thicker, `NUDGE` of its area, at the Courant number of the run."""
    name, body = next(iter(case.bodies.items()))
    chosen = {"time.courant": courant} if case.time.courant == "auto" else {}
    return case.with_overrides({f"bodies.{name}.area": body.area * (1.0 + NUDGE), **chosen})


def is_fragile(forces: Floats, others: Floats) -> bool:
    """Return whether the forces of a run and its nudged twin differ by more than `FRAGILE`, relative, in L2."""
    size = float(np.linalg.norm(forces))
    return bool(forces.shape != others.shape or np.linalg.norm(forces - others) > FRAGILE * size)
