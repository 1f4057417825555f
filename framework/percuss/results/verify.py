"""Numbers measured on a result, by one definition of each for cases and studies, and the checks of a case by them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from percuss.case.arguments import wrong_argument
from percuss.case.case import Case, expect_case
from percuss.case.quantities import CONTACT_NUMBERS, MEASURABLE
from percuss.case.specs import Expectation
from percuss.errors import PercussError
from percuss.methods.interfaces import Floats
from percuss.results.result import Result
from percuss.results.runner import run


class CannotMeasure(PercussError):
    """Error: the result does not have the quantity."""

    exit_code = 1


def measure(
    result: Result,
    quantity: str,
    *,
    contact: str | None = None,
    probe: str | None = None,
    component: int = 0,
    during: tuple[float, float] | None = None,
    at: float | None = None,
    statistic: str = "value",
) -> float:
    """Return one number of a result.

    Parameters
    ----------
    result
        Result of a run.
    quantity
        A history (``contact_force``, ``gap``, ``displacement``, ``energy``, ...), a number of a contact
        (``impulse``, ``peak_force``, ...) or a dotted path into the summary.
    contact, probe, component
        Contact, or probe and component, of the quantity.
    during, at
        Time interval, both ends included, or time of a value (interpolated).
    statistic
        ``mean``, ``max``, ``min``, ``final``, ``integral`` or ``value``.

    Raises
    ------
    CannotMeasure
        If the result does not have the quantity.
    """
    definition = MEASURABLE.get(quantity)
    if definition is None or definition.axis is None:
        return _scalar(result, quantity, contact)
    time, values = _history(result, quantity, contact, probe, component)
    if statistic == "value":
        if at is not None and at > time[-1] + result.summary.get(
            "dt", 0.0
        ):  # the last record may be a step before the end
            raise CannotMeasure(f"{quantity} has no record at {at:g}, after the end at {time[-1]:g}")
        return float(np.interp(at if at is not None else time[-1], time, values))
    if statistic == "final":
        return float(values[-1])
    inside = np.ones(time.size, dtype=bool)
    if during is not None:
        slack = 1e-9 * result.summary.get("dt", 0.0)
        inside = (time >= during[0] - slack) & (time <= during[1] + slack)
    if not inside.any():
        raise CannotMeasure(f"{quantity} has no record between {during}")
    if statistic == "integral":
        if definition.unit == "force":  # each force acts over a whole step
            return float(values[inside & (time < time[-1])].sum() * (time[1] - time[0])) if time.size > 1 else 0.0
        return float(np.trapezoid(values[inside], time[inside]))
    reduce: dict[str, Any] = {"mean": np.mean, "max": np.max, "min": np.min}
    return float(reduce[statistic](values[inside]))


def _history(
    result: Result, quantity: str, contact: str | None, probe: str | None, component: int
) -> tuple[Floats, Floats]:
    arrays = result.arrays
    time = arrays[str(MEASURABLE[quantity].axis)]
    if quantity == "energy":
        return time, arrays["kinetic_energy"] + arrays["elastic_energy"]
    if quantity not in arrays:
        raise CannotMeasure(f"this run has no {quantity}")
    values = arrays[quantity]
    if MEASURABLE[quantity].of == "contact":
        return time, values[:, _axis_index(result, "contact", contact)]
    if MEASURABLE[quantity].of == "probe":
        return time, values[:, _axis_index(result, "probe", probe), component]
    return time, values


def _axis_index(result: Result, axis: str, name: str | None) -> int:
    names = result.coordinates[axis]
    if name is None and len(names) == 1:
        return 0
    if name not in names:
        raise CannotMeasure(f"no {axis} '{name}' was recorded; there are: {', '.join(names) or 'none'}")
    return names.index(name)


def _scalar(result: Result, quantity: str, contact: str | None) -> float:
    value: Any = result.summary
    path = quantity.split(".")
    if quantity in CONTACT_NUMBERS:
        name = result.coordinates["contact"][_axis_index(result, "contact", contact)]
        path = [name if part == "*" else part for part in MEASURABLE[quantity].path.split(".")]
    for key in path:
        if value is None and path[0] == "exact":
            raise CannotMeasure(f"no true error is known of this run: {result.summary['exact_reason']}")
        if not isinstance(value, dict) or key not in value:
            raise CannotMeasure(f"the summary has no {'.'.join(path)}")
        value = value[key]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise CannotMeasure(f"{'.'.join(path)} is {value!r}, not a number")
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

    def as_dict(self) -> dict[str, Any]:
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


def describe(expectation: Expectation) -> str:
    """Return the quantity of an expectation in words."""
    owner = expectation.contact or (str(expectation.probe) if expectation.probe else "")
    when = "" if expectation.at is None else f" at {expectation.at:g}"
    if expectation.during:
        when = f" during {expectation.during[0]:g} to {expectation.during[1]:g}"
    statistic = "" if expectation.statistic == "value" else f"{expectation.statistic} of "
    return f"{statistic}{expectation.quantity}{' of ' + owner if owner else ''}{when}"


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
            where = {name: getattr(expectation, name) for name in ("contact", "component", "during", "at", "statistic")}
            probe = str(expectation.probe) if expectation.probe else None
            measured = measure(result, expectation.quantity, probe=probe, **where)
            checks.append(Check(expectation, measured))
        except CannotMeasure as error:
            checks.append(Check(expectation, math.nan, str(error)))
    return checks
