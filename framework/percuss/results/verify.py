"""Verifying a case by what it expects of itself."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from percuss.case.case import Case, Expectation
    from percuss.results.result import Result
from percuss.results.measures import CannotMeasure, measure


@dataclass(frozen=True)
class Check:
    """One expectation held against a result.

    Attributes
    ----------
    expectation
        What was expected.
    measured
        What was found; nan where it could not be measured.
    allowed
        Largest difference allowed, in the quantity's own unit.
    why
        Why it could not be measured; empty if it could.
    """

    expectation: Expectation
    measured: float
    allowed: float
    why: str = ""

    @property
    def passed(self) -> bool:
        """Whether the difference is within what is allowed."""
        return abs(self.measured - self.expectation.value) <= self.allowed

    def as_dict(self) -> dict[str, Any]:
        """Return the check in the terms of JSON."""
        e = self.expectation
        return {
            "what": describe(e),
            "expected": e.value,
            "within": self.allowed,
            "measured": self.measured if math.isfinite(self.measured) else None,
            "passed": self.passed,
            "source": e.source,
            "why": self.why,
        }


def describe(e: Expectation) -> str:
    """Return an expectation's quantity in words."""
    whose = e.contact or (str(e.probe) if e.probe else "")
    when = f" during {e.during[0]:g} to {e.during[1]:g}" if e.during else f" at {e.at:g}" if e.at is not None else ""
    statistic = "" if e.statistic == "value" else f"{e.statistic} of "
    return f"{statistic}{e.quantity}{' of ' + whose if whose else ''}{when}"


def verify(case: Case, result: Result) -> list[Check]:
    """Hold what a case expects against the result of its run."""
    checks = []
    for e in case.expect:
        allowed = e.within * abs(e.value) if e.relative else e.within
        try:
            measured = measure(
                result,
                e.quantity,
                contact=e.contact,
                probe=str(e.probe) if e.probe else None,
                component=e.component,
                during=e.during,
                at=e.at,
                statistic=e.statistic,
            )
            checks.append(Check(e, measured, allowed))
        except CannotMeasure as why:
            checks.append(Check(e, math.nan, allowed, str(why)))
    return checks
