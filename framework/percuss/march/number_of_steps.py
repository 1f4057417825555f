"""The number of steps of a run, and bounds on it and on the time step."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from percuss.case.options import LARGEST_NUMBER, SMALLEST_NUMBER, UNITS
from percuss.errors import InputError
from percuss.mesh.loads import ROUND_OFF

if TYPE_CHECKING:
    from percuss.case.case import Case

MOST_STEPS = 2**40


def steps_of(case: Case, dt: float) -> int:
    """Return the number of steps of a run: as the case gives it, or so many that they reach or just pass its end.

    Raises
    ------
    InputError
        If `dt` is out of the bounds for numbers, or there are more than `MOST_STEPS`.
    """
    if not SMALLEST_NUMBER <= dt <= LARGEST_NUMBER:
        key = "step" if case.time.step is not None else "courant"
        message = f"expected a time step between {SMALLEST_NUMBER:g} and {LARGEST_NUMBER:g}, found {dt:.6g}"
        advice = "A step is stable up to about the Courant number 1." if dt > LARGEST_NUMBER else UNITS
        raise InputError([case.problem(("time", key), message, advice)])
    if case.time.steps is not None:
        return case.time.steps
    count = (case.time.end or 0.0) / dt * (1.0 - ROUND_OFF) - 1e-9
    if count > MOST_STEPS:
        message = f"expected at most {MOST_STEPS} steps, found {count:.3g}"
        raise InputError([case.problem(("time",), message, "Lengthen the step.", any_inside=True)])
    return max(1, math.ceil(count))
