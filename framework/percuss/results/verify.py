"""Numbers measured on a result, by one definition of each for cases and studies, and the checks of a case by them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from percuss.case.arguments import wrong_argument
from percuss.case.case import Case, expect_case
from percuss.case.quantities import CONTACT_NUMBERS, MEASURABLE, values_at
from percuss.case.specs import Address, Expectation, MeasureSection
from percuss.errors import PercussError
from percuss.jsonable import Entries
from percuss.methods.interfaces import Floats
from percuss.results.result import Result
from percuss.results.runner import run


class CannotMeasure(PercussError):
    """Error: the result does not have the quantity."""

    exit_code = 1


def measure(result: Result, wanted: Expectation | MeasureSection) -> float:
    """Return one number of a result.

    Parameters
    ----------
    result
        Result of a run.
    wanted
        What is measured: a history (``contact_force``, ``gap``, ``displacement``, ``energy``, ...), a number of a
        contact (``impulse``, ``peak_force``, ...) or a dotted path into the summary; of which contact, probe or
        support; when, in an interval with both ends or at a time (interpolated); and the statistic.

    Raises
    ------
    CannotMeasure
        If the result does not have the quantity.
    """
    definition = MEASURABLE.get(wanted.quantity)
    if definition is None or definition.axis is None:
        return _scalar(result, wanted)
    time, values = result.arrays[definition.axis], _history(result, wanted)
    during, at, statistic, dt = wanted.during, wanted.at, wanted.statistic, result.summary.get("dt", 0.0)
    if statistic == "value":
        if at is not None and at > time[-1] + dt:  # the last record may be a step before the end
            raise CannotMeasure(f"{wanted.quantity} has no record at {at:g}, after the end at {time[-1]:g}")
        return float(np.interp(at if at is not None else time[-1], time, values))
    if statistic == "final":
        return float(values[-1])
    start, stop = during or (-math.inf, math.inf)
    inside = (time >= start - 1e-9 * dt) & (time <= stop + 1e-9 * dt)
    if not inside.any():
        raise CannotMeasure(f"{wanted.quantity} has no record between {during}")
    if statistic == "integral":
        if definition.unit == "force":  # each force acts over a whole step
            return float(values[inside & (time < time[-1])].sum() * (time[1] - time[0])) if time.size > 1 else 0.0
        return float(np.trapezoid(values[inside], time[inside]))
    reduce: Entries = {"mean": np.mean, "max": np.max, "min": np.min}
    return float(reduce[statistic](values[inside]))


def _history(result: Result, wanted: Expectation | MeasureSection) -> Floats:
    arrays, of = result.arrays, MEASURABLE[wanted.quantity].of
    if wanted.quantity == "energy":
        return arrays["kinetic_energy"] + arrays["elastic_energy"]
    if wanted.quantity not in arrays:
        raise CannotMeasure(f"this run has no {wanted.quantity}")
    values = arrays[wanted.quantity]
    if of == "contact":
        return values[:, _axis_index(result, "contact", wanted.contact)]
    if of in ("probe", "support"):
        return values[:, _axis_index(result, of, getattr(wanted, of)), wanted.component]
    return values


def _axis_index(result: Result, axis: str, owner: str | Address | None) -> int:
    names = result.coordinates[axis]
    if owner is None and len(names) == 1:
        return 0
    if str(owner) not in names:
        raise CannotMeasure(f"no {axis} '{owner}' was recorded; there are: {', '.join(names) or 'none'}")
    return names.index(str(owner))


def _scalar(result: Result, wanted: Expectation | MeasureSection) -> float:
    path = wanted.quantity
    if path in CONTACT_NUMBERS:
        name = result.coordinates["contact"][_axis_index(result, "contact", wanted.contact)]
        value = MEASURABLE[path].of_contact(result.summary["contacts"][name])
    else:
        value = next(values_at(result.summary, path), None)
    if value is None and path.startswith("exact."):
        raise CannotMeasure(f"no true error is known of this run: {result.summary['exact_reason']}")
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise CannotMeasure(f"{path} of the summary is {value!r}, not a number")
    return float(value)


@dataclass(frozen=True, repr=False)
class Check:
    """Comparison of one expected value with a result.

    Attributes
    ----------
    expectation
        Expected value, with its quantity and tolerance.
    measured
        Measured value; nan if it could not be measured.
    why
        Why it could not be measured; empty if it could.
    """

    expectation: Expectation
    measured: float
    why: str = ""

    @property
    def passed(self) -> bool:
        """Whether the difference is at most the allowed difference."""
        return abs(self.measured - self.expectation.value) <= self.expectation.allowed

    def __repr__(self) -> str:
        expected = f"expected {self.expectation.value:.6g} within {self.expectation.allowed:.3g}"
        measured = self.why or f"{self.measured:.6g}"
        return f"<{'passed' if self.passed else 'failed'}: {describe(self.expectation)} {measured}, {expected}>"

    def as_dict(self) -> Entries:
        """Return the check as plain data for JSON."""
        expectation = self.expectation
        return {
            "what": describe(expectation),
            "expected": expectation.value,
            "within": expectation.allowed,
            "measured": self.measured if math.isfinite(self.measured) else None,
            "passed": self.passed,
            "source": expectation.source,
            "why": self.why,
        }


def describe(wanted: Expectation | MeasureSection) -> str:
    """Return in words what is measured: the statistic, the quantity, of which contact, probe or support, and when."""
    owner = str(wanted.contact or wanted.probe or wanted.support or "")
    when = "" if wanted.at is None else f" at {wanted.at:g}"
    if wanted.during:
        when = f" during {wanted.during[0]:g} to {wanted.during[1]:g}"
    statistic = "" if wanted.statistic == "value" else f"{wanted.statistic} of "
    return f"{statistic}{wanted.quantity}{' of ' + owner if owner else ''}{when}"


def verify(case: Case, result: Result | None = None) -> list[Check]:
    """Return a check of each value that a case expects, with what was measured and whether it passed.

    Parameters
    ----------
    case
        The case, with its key ``expect``.
    result
        A result of the case; without it the case is run.
    """
    expect_case("percuss.verify", case)
    if result is not None and not isinstance(result, Result):
        raise wrong_argument("percuss.verify", "expected a result", result, "Make one: percuss.run(case).")
    result = run(case) if result is None else result
    checks = []
    for expectation in case.expect:
        try:
            checks.append(Check(expectation, measure(result, expectation)))
        except CannotMeasure as error:
            checks.append(Check(expectation, math.nan, str(error)))
    return checks
