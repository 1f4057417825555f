"""Checks of the conformance kit, how they are run on a component, and what comes out.

A check is a plain function of a `Subject` that returns where the component does as the contract demands, and raises
where it does not. One that takes a partner is run once for each registered method it may be paired with. The only way
round a check is `Component.expected_failures`: it is run all the same, and a declared failure that does not occur is
an error.
"""

from __future__ import annotations

import dataclasses
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from percuss.errors import PercussError, PluginError
from percuss.methods.interfaces import Component
from percuss.methods.registry import Registry
from percuss.testing.subject import (
    CHECKS,
    DRAWS,
    PARTNERS,
    Check,
    CheckFailed,
    NotApplicable,
    Status,
    Subject,
    check,
    named,
    registered_checks,
)

__all__ = ["Check", "CheckFailed", "NotApplicable", "Outcome", "Report", "Subject", "check", "checks_of", "conformance"]


@dataclass(frozen=True)
class Outcome:
    """What came of a check.

    Attributes
    ----------
    check
        The check.
    partner
        Name of the partner, empty for a check that is not one of pairs.
    status
        ``passed``, ``failed``, ``expected failure``, ``passes unexpectedly`` or ``not applicable``.
    message
        What was found, or why it does not apply.
    reason
        Why a failure is expected.
    case
        Text of the case file that the check read last before it failed, to be saved and run; empty if it read none.
    """

    check: Check
    partner: str
    status: Status
    message: str = ""
    reason: str = ""
    case: str = ""

    @property
    def name(self) -> str:
        """Name of the check, with that of the partner."""
        return named(self.check, self.partner)

    @property
    def good(self) -> bool:
        """Whether the component does as it should, or as it says."""
        return self.status not in {"failed", "passes unexpectedly"}

    def __str__(self) -> str:
        told = f"{self.status:>20}  {self.name}"
        if self.status == "failed":
            demanded = _filled(f"demanded: {self.check.demand}")
            parts = [self.message, demanded]
            parts += [f"the case of {self.name}, to be saved and run:\n{self.case}"] if self.case else []
            return "\n".join([told, *map(_indented, parts)])
        if self.status == "passes unexpectedly":
            return f"{told}\n{_indented(f'declared to fail ({self.reason}), and does not: take the entry out')}"
        more = self.reason or self.message
        return f"{told}{f' ({more})' if more else ''}"


@dataclass(frozen=True)
class Report:
    """What came of all checks of a component."""

    component: type[Component]
    outcomes: tuple[Outcome, ...]

    @property
    def passed(self) -> bool:
        """Whether every check is as it should be."""
        return all(one.good for one in self.outcomes)

    def count(self, status: str) -> int:
        """Return how many outcomes have a status."""
        return sum(one.status == status for one in self.outcomes)

    def __str__(self) -> str:
        return "\n".join([self.verdict, *map(str, self.outcomes)])

    @property
    def verdict(self) -> str:
        """One line: whether it passed, and how many checks came out how."""
        counts = {one.status: self.count(one.status) for one in self.outcomes}
        told = ", ".join(f"{number} {status}" for status, number in counts.items())
        word = "conforms" if self.passed else "DOES NOT CONFORM"
        return f"{self.component.name} ({self.component.family}) {word}: {told}"

    def as_dict(self) -> dict[str, Any]:
        """Return the report in the terms of JSON."""
        return {
            "name": self.component.name,
            "family": self.component.family,
            "passed": self.passed,
            "checks": [
                {
                    "name": one.name,
                    "status": one.status,
                    "message": one.message,
                    "reason": one.reason,
                    "demand": one.check.demand,
                    "case": one.case,
                }
                for one in self.outcomes
            ],
        }


def known_checks() -> list[Check]:
    """Return all checks, in the order in which they are run."""
    from percuss.testing.checks import bulk, common, contacts, integrators, loads, others, pairs  # noqa: F401

    return list(CHECKS)


def checks_of(subject: Subject) -> Iterator[tuple[Check, str]]:
    """Yield every check that is for a subject, once with each partner where it is one of pairs."""
    known_checks()
    yield from registered_checks(subject)


def expected(one: Check, subject: Subject, partner: str) -> str:
    """Return why a check is known to fail, as the component or its partner declares it; empty where it is not."""
    mine = subject.component.expected_failures
    found = mine.get(one.name, "") or (mine.get(named(one, partner), "") if partner else "")
    if partner and not found:
        theirs = subject.registry.components[PARTNERS[subject.family], partner].expected_failures
        found = theirs.get(one.name, "") or theirs.get(named(one, subject.name), "")
    return found


def perform(one: Check, subject: Subject, partner: str = "") -> Outcome:
    """Run a check on a subject and return what came of it."""
    subject = dataclasses.replace(subject, check=one.name, loaded=[])
    outcome = _performed(one, subject, partner)
    return dataclasses.replace(outcome, case=subject.last_case()) if outcome.status == "failed" else outcome


def _performed(one: Check, subject: Subject, partner: str) -> Outcome:
    reason = expected(one, subject, partner)
    try:
        one.function(subject, partner) if partner else one.function(subject)
    except NotApplicable as why:
        return Outcome(one, partner, "not applicable", str(why), reason)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] == "hypothesis":
            raise PluginError("the kit draws its cases with hypothesis: pip install 'percuss[kit]'") from None
        return Outcome(one, partner, "failed", _told(error, subject))
    except (CheckFailed, PercussError) as error:
        told = str(error) if isinstance(error, CheckFailed) else _told(error, subject)
        return Outcome(one, partner, "expected failure" if reason else "failed", told, reason)
    except Exception as error:  # noqa: BLE001  whatever a plug-in does is what the kit is there to find
        return Outcome(one, partner, "failed", _told(error, subject))  # nobody expects this
    if reason:
        return Outcome(one, partner, "passes unexpectedly", reason=reason)
    return Outcome(one, partner, "passed")


def conformance(
    component: type[Component], *, registry: Registry | None = None, draws: int = DRAWS, strict: bool = True
) -> Report:
    """Run every check of the kit on a component.

    Parameters
    ----------
    component
        Class of the method; it need not be registered.
    registry
        What else there is; by default everything installed.
    draws
        How many cases a check draws.
    strict
        Whether to raise if anything failed.

    Returns
    -------
    Report
        What came of each check; as text, a report to read.

    Raises
    ------
    AssertionError
        If a check failed, or one declared to fail did not; the message is the report.
    """
    subject = Subject.of(component, registry, draws)
    report = Report(component, tuple(perform(one, subject, partner) for one, partner in checks_of(subject)))
    if strict and not report.passed:
        raise AssertionError(str(report))
    return report


def conformance_test(component: type[Component], *, draws: int = DRAWS) -> Callable[..., None]:
    """Return a pytest function of all checks, one test a check: ``test_conformance = conformance_test(MyLaw)``."""
    import pytest

    subject = Subject.of(component, draws=draws)
    every = list(checks_of(subject))

    @pytest.mark.parametrize(("one", "partner"), every, ids=[named(*each) for each in every])
    def test_conformance(one: Check, partner: str) -> None:
        outcome = perform(one, subject, partner)
        if outcome.status == "not applicable":
            pytest.skip(outcome.message)
        if outcome.status == "expected failure":
            pytest.xfail(outcome.reason)
        if not outcome.good:
            pytest.fail(str(outcome), pytrace=False)

    return test_conformance


def _told(error: BaseException, subject: Subject) -> str:
    """Return an error with the line of the plug-in that it came from."""
    file = subject.registry.sources[subject.family, subject.name].file
    steps = [f"{s.filename}:{s.lineno}" for s in traceback.extract_tb(error.__traceback__) if s.filename == file]
    notes = "".join(f"\n{note}" for note in getattr(error, "__notes__", ()))
    place = f" [{steps[-1]}]" if steps else ""
    return f"{type(error).__name__}: {error}{place}{notes}"


def _filled(text: str) -> str:
    import textwrap

    return textwrap.fill(text, 96, break_long_words=False, break_on_hyphens=False)


def _indented(text: str) -> str:
    return "\n".join(f"{'':22}{line}" for line in text.splitlines())
