"""True errors of a run: its histories compared with the exact solution of its case, where there is one."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from percuss.contact.contact_problem import contact_problem
from percuss.contact.model import Model
from percuss.jsonable import Data
from percuss.methods.interfaces import Exact, ExactContact, Floats, Integers
from percuss.results.exact import ROUND_OFF
from percuss.results.summary import ContactErrors, ExactEntries, ExactErrors

NEGLIGIBLE = 1e-18
ENDED_BY_CTRL_C = "Ctrl-C ended it"  # why a run has no true error
LIGHT = 0.01  # of the largest impulse: a contact with less decides nothing


def summary_entries(errors: ExactErrors | None, reason: str, estimated: ExactErrors | None = None) -> ExactEntries:
    """Return the entries of a summary about the exact solution and the true errors.

    Parameters
    ----------
    errors
        True errors of a run; None if there is no exact solution.
    reason
        Why there is none, or why it ends before the run does; empty if it covers the whole run.
    estimated
        Errors against a finer run, if there is one.
    """
    # Runs must not be compared by errors of a part of their time: comparisons of runs read `exact`.
    if errors is None or not reason:
        return {"exact": errors, "exact_reason": reason or None, "exact_covered": None, "estimated": estimated}
    # An exact solution alone has no errors of contacts.
    covered: Any = {name: errors[name] for name in ("solution", "fronts", "contacts") if name in errors}
    covered["until"] = errors["reached"]
    return {"exact": None, "exact_reason": reason, "exact_covered": covered, "estimated": None}


def largest_error(summary: ExactEntries) -> float | None:
    """Return the force error, L1, of the worst contact, else the displacement error; None if neither is known.

    Where the exact solution ends before the run, it is the error of the part that the solution covers; where a finer
    run stands for it, it is an estimate, and the larger one of two.
    """
    found, largest = errors_of(summary), []
    for errors in filter(None, (found, found and found.get("second"))):
        known = errors_of_contacts(summary, errors, "force_error_l1").values()
        largest.append(max(known) if known else errors.get("displacement_error"))
    return max((error for error in largest if error is not None), default=None)


def errors_of_contacts(summary: Any, errors: Any, name: str) -> dict[str, float]:
    """Return the known errors of a name by contact, of those that had at least 1 % of the largest impulse.

    Parameters
    ----------
    summary, errors
        The summary of a run, and the entry of it that has the errors.
    name
        Name of the error.
    """
    impulses = {
        contact: max(abs(summary["contacts"][contact]["impulse"]), of_contact.get("exact_impulse") or 0.0)
        for contact, of_contact in errors["contacts"].items()
    }
    least = LIGHT * max(impulses.values(), default=0.0)
    found = {contact: errors["contacts"][contact][name] for contact, impulse in impulses.items() if impulse >= least}
    return {contact: error for contact, error in found.items() if error is not None}


def errors_of(summary: ExactEntries) -> ExactErrors | None:
    """Return the errors of a run against the exact solution, as far as it goes, or against a finer run."""
    return summary["exact"] or summary.get("exact_covered") or summary.get("estimated")


def judge_words(summary: Data) -> str:
    """Return one or two finer runs by which the errors of a run are estimated, as the end of a sentence; or nothing."""
    estimated = summary.get("estimated")
    if not estimated:
        return ""
    runs = "two finer runs, of which the larger error counts" if "second" in estimated else "a finer run"
    return f"{runs}: {estimated['solution']}"


def contact_errors(
    contact: ExactContact,
    time: Floats,
    force: Floats,
    exact: Floats,
    dt: float,
    reached: float,
    *,
    every: int,
) -> ContactErrors:
    """Return the errors of the force history of one contact.

    Parameters
    ----------
    contact
        Exact solution of the contact.
    time, force
        Middle of the step over which each recorded force acts, and that force.
    exact
        Exact force averaged over that step.
    dt
        Time step.
    reached
        Time up to which the exact solution holds.
    every
        Steps between two records; errors of the force need a record of every step, and are None otherwise.
    """
    has_exact = np.isfinite(exact)
    time, force, exact = time[has_exact], force[has_exact], exact[has_exact]
    closed = [interval for interval in contact.closed if interval[0] < reached]
    closed_intervals = [list(interval) for interval in closed[:100]]
    if every > 1 or not time.size:  # forces between sparse records are unknown: errors would be those of the recording
        unknown = {**dict.fromkeys(ContactErrors.__annotations__), "closed": closed_intervals}
        return cast("ContactErrors", unknown)
    difference = force - exact
    scale_1, scale_2 = float(np.abs(exact).sum()), float(np.sqrt((exact**2).sum()))
    variation = float(np.abs(np.diff(exact, prepend=0.0)).sum())
    exact_impulse = contact.impulse(time + 0.5 * dt)
    largest_impulse = float(np.abs(exact_impulse).max())
    pressing_steps = np.flatnonzero(force > ROUND_OFF * force.max(initial=0.0))
    return {
        "force_error_l1": _ratio(float(np.abs(difference).sum()), scale_1),
        "force_error_l2": _ratio(float(np.sqrt((difference**2).sum())), scale_2),
        "impulse_error": _ratio(float(np.abs(np.cumsum(force) * dt - exact_impulse).max()), largest_impulse),
        # No variation is none of a contact that never presses, and no ratio.
        "noise": float(np.abs(np.diff(force, prepend=0.0)).sum()) / variation if variation > 0.0 else None,
        "overshoot": _ratio(float(force.max(initial=0.0)), float(exact.max(initial=0.0)), minus=1.0),
        "closing_error": float(time[pressing_steps[0]] - closed[0][0]) if closed and pressing_steps.size else None,
        "opening_error": _opening_error(time, pressing_steps, closed, reached),
        "exact_impulse": largest_impulse,
        "closed": closed_intervals,
    }


def _ratio(value: float, scale: float, minus: float = 0.0) -> float | None:
    """Return value over scale, less `minus`; None if the exact quantity is zero, but 0 if the value is zero too."""
    if scale > 0.0:
        return value / scale - minus
    return 0.0 if value == 0.0 else None


def _opening_error(
    time: Floats, pressing_steps: Integers, closed: list[tuple[float, float]], reached: float
) -> float | None:
    """Return the delay of the last step with a contact force; None if run or exact contact are closed at the end.

    Of the steps that overlap an interval, the last has its middle at most half a step before or after the end of the
    interval, as the first has at its start.
    """
    pressed = pressing_steps.size > 0 and pressing_steps[-1] < time.size - 1
    opened = bool(closed) and closed[-1][1] < reached * (1.0 - ROUND_OFF)
    return float(time[pressing_steps[-1]] - closed[-1][1]) if pressed and opened else None


def displacement_error(model: Model, solution: Exact, displacement: Floats, time: float) -> float | None:
    """Return the relative error of the displacement at `time`, in L2 over all bodies, or None.

    Parameters
    ----------
    model, solution
        The case and its exact solution.
    displacement : (nodes, dim) array
        Displacement of the run at `time`.
    time
        Time of the comparison; the error is None beyond the time that the exact solution reached.
    """
    if time > solution.reached * (1.0 + 1e-12):
        return None
    error = size = 0.0
    problem: Any = contact_problem(model)
    for body in model.bodies.values():
        axis = problem.bodies[body.name].direction
        along, weight = body.along(axis)
        true = solution.displacement(body.name, along, np.full(along.shape, time))
        computed = displacement[body.start : body.stop] @ axis
        sideways = displacement[body.start : body.stop] - np.outer(computed, axis)
        error += float(weight @ (computed - true) ** 2) + float(weight @ (sideways**2).sum(axis=1))
        size += float(weight @ true**2)
    return relative_l2(error, size)


def relative_l2(error: float, size: float) -> float | None:
    """Return the relative error of a field in L2 from the squares of its error and of its size; None if it has none."""
    if size < NEGLIGIBLE * error:  # bodies back at their start: an error relative to round-off means nothing
        return None
    return _ratio(float(np.sqrt(error)), float(np.sqrt(size)))
