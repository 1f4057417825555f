"""Verification of a case by the expected values that it contains."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from percuss.case.arguments import wrong_argument
from percuss.case.case import Case, expect_case
from percuss.case.specs import Expectation
from percuss.results.measures import CannotMeasure, measure
from percuss.results.result import Result
from percuss.results.runner import run


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
