"""The conformance kit: it runs its checks on a component and reports the outcomes.

A check is a plain function of a `Subject` that returns if the component meets the demand of the contract, and raises
if it does not. A check that takes a partner is run once with each registered method that the component may be paired
with. Partners of percuss and of the component's own plug-in decide; those of other plug-ins are listed apart. Only
`Component.expected_failures` excuses a failure: the check is still run, and a declared failure that does not occur is
an error. Where a law declares to fail a check with an integrator, nothing is demanded of it with another one that
evaluates laws in the same states.
"""

from __future__ import annotations

import dataclasses
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from percuss.errors import PercussError, PluginError
from percuss.methods.blame import described, is_ctrl_c, line_in_plugin
from percuss.methods.interfaces import Component, LeapFrog
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

# heading of the outcomes that are no part of the verdict
OTHERS = "with methods of other plug-ins, which the verdict does not count:"

__all__ = ["Check", "CheckFailed", "NotApplicable", "Outcome", "Report", "Subject", "check", "checks_of", "conformance"]


@dataclass(frozen=True)
class Outcome:
    """The outcome of one check of a component.

    Attributes
    ----------
    check
        Check that was run.
    partner
        Name of the partner, empty for a check that is not run in pairs.
    status
        ``passed``, ``failed``, ``expected failure``, ``passes unexpectedly`` or ``not applicable``.
    message
        Deviation from the demand, or the reason why the check does not apply.
    reason
        Reason why a failure is expected.
    case
        Text of the case that the check read last before it failed, as a case file that can be saved and run; empty if
        the check read no case.
    counts
        Whether the outcome is part of the verdict; with a partner of somebody else's plug-in it is not.
    """

    check: Check
    partner: str
    status: Status
    message: str = ""
    reason: str = ""
    case: str = ""
    counts: bool = True

    @property
    def name(self) -> str:
        """Name of the check, followed by the name of the partner if there is one."""
        return named(self.check, self.partner)

    @property
    def good(self) -> bool:
        """Whether the component meets the demand, fails as declared, or the outcome is no part of the verdict."""
        return not self.counts or self.status not in {"failed", "passes unexpectedly"}

    def __str__(self) -> str:
        title = f"{self.status:>20}  {self.name}"
        if self.status == "failed":
            demand = _filled(f"demanded: {self.check.demand}")
            parts = [self.message, demand]
            parts += [f"the case of {self.name}, to be saved and run:\n{self.case}"] if self.case else []
            return "\n".join([title, *map(_indented, parts)])
        if self.status == "passes unexpectedly":
            return f"{title}\n{_indented(f'declared to fail ({self.reason}), and does not: take the entry out')}"
        remark = self.reason or self.message
        return f"{title}{f' ({remark})' if remark else ''}"


@dataclass(frozen=True)
class Report:
    """The outcomes of all checks of a component."""

    component: type[Component]
    outcomes: tuple[Outcome, ...]

    @property
    def passed(self) -> bool:
        """Whether no check failed and every declared failure occurred."""
        return all(outcome.good for outcome in self.outcomes)

    def count(self, status: str) -> int:
        """Return the number of outcomes with a status that are part of the verdict."""
        return sum(outcome.status == status for outcome in self.outcomes if outcome.counts)

    def __str__(self) -> str:
        counted, others = ([str(o) for o in self.outcomes if o.counts is counts] for counts in (True, False))
        return "\n".join([self.verdict, *counted, *([OTHERS, *others] if others else [])])

    @property
    def verdict(self) -> str:
        """One line that states whether the component conforms, and the number of outcomes of each status."""
        counts = {outcome.status: self.count(outcome.status) for outcome in self.outcomes if outcome.counts}
        counted = ", ".join(f"{number} {status}" for status, number in counts.items())
        word = "conforms" if self.passed else "DOES NOT CONFORM"
        return f"{self.component.name} ({self.component.family}) {word}: {counted}"

    def as_dict(self) -> dict[str, Any]:
        """Return the report as a dictionary that can be written as JSON."""
        return {
            "name": self.component.name,
            "family": self.component.family,
            "passed": self.passed,
            "checks": [
                {
                    "name": outcome.name,
                    "status": outcome.status,
                    "message": outcome.message,
                    "reason": outcome.reason,
                    "demand": outcome.check.demand,
                    "case": outcome.case,
                    "counts": outcome.counts,
                }
                for outcome in self.outcomes
            ],
        }


def known_checks() -> list[Check]:
    """Return all checks of the kit in the order in which they are run."""
    from percuss.testing.checks import bulk, common, contacts, integrators, loads, others, pairs  # noqa: F401

    return list(CHECKS)


def checks_of(subject: Subject) -> Iterator[tuple[Check, str]]:
    """Yield each check of a subject with an empty partner, or once with each partner if the check is run in pairs."""
    known_checks()
    yield from registered_checks(subject)


def expected(kit_check: Check, subject: Subject, partner: str) -> str:
    """Return the reason for an expected failure declared by the component or its partner, empty if there is none."""
    failures = subject.component.expected_failures
    reason = failures.get(kit_check.name, "") or (failures.get(named(kit_check, partner), "") if partner else "")
    if partner and not reason:
        failures_of_partner = subject.registry.components[PARTNERS[subject.family], partner].expected_failures
        reason = failures_of_partner.get(kit_check.name, "") or failures_of_partner.get(
            named(kit_check, subject.name), ""
        )
    return reason


def _fails_with(kit_check: Check, subject: Subject, partner: str) -> str:
    """Return the integrators with which a law, the partner of another integrator, declares to fail a check."""
    if not partner or subject.family != "integrators":
        return ""
    declared = subject.registry.components[PARTNERS[subject.family], partner].expected_failures
    start = named(kit_check, "")
    return " and ".join(name.removeprefix(f"{start} with ") for name in declared if name.startswith(f"{start} with "))


def _fails_in_the_same_states(kit_check: Check, subject: Subject, partner: str) -> str:
    """Return an integrator that shows a law the states that its partner shows, and with which it declares to fail."""
    if not partner or subject.family != "contacts":
        return ""
    states = _shown_states(subject, partner)
    others = (name for name in subject.partners if name != partner)
    alike = (name for name in others if states is not None and _shown_states(subject, name) == states)
    return next((name for name in alike if expected(kit_check, subject, name)), "")


def _shown_states(subject: Subject, integrator: str) -> Any:
    """Return the states at which a leap-frog scheme evaluates contact laws, None for a multi-stage scheme."""
    definition = subject.registry.components["integrators", integrator]().bind(1.0)  # type: ignore[attr-defined]
    return (definition.explicit, definition.end) if isinstance(definition, LeapFrog) else None


def perform(kit_check: Check, subject: Subject, partner: str = "") -> Outcome:
    """Run a check on a subject and return its outcome."""
    outcome = _outcome(kit_check, subject, partner)
    return dataclasses.replace(outcome, counts=not partner or partner in subject.partners)


def _outcome(kit_check: Check, subject: Subject, partner: str) -> Outcome:
    """Return the outcome of a check as if it counted."""
    fails_with = _fails_with(kit_check, subject, partner) or _fails_in_the_same_states(kit_check, subject, partner)
    if fails_with and not expected(kit_check, subject, partner):
        law, integrator = (subject.name, partner) if subject.family == "contacts" else (partner, subject.name)
        message = f"{law} fails it with {fails_with} too: nothing follows for {integrator}"
        return Outcome(kit_check, partner, "not applicable", message)
    subject = dataclasses.replace(subject, check=kit_check.name, loaded=[])
    outcome = _performed(kit_check, subject, partner)
    return dataclasses.replace(outcome, case=subject.last_case()) if outcome.status == "failed" else outcome


def _performed(kit_check: Check, subject: Subject, partner: str) -> Outcome:
    """Return the outcome of a check, without the text of the case that it read last."""
    reason = expected(kit_check, subject, partner)
    try:
        kit_check.function(subject, partner) if partner else kit_check.function(subject)
    except NotApplicable as exemption:
        return Outcome(kit_check, partner, "not applicable", str(exemption), reason)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] == "hypothesis":
            raise PluginError("the kit draws its cases with hypothesis: pip install 'percuss[kit]'") from None
        return Outcome(kit_check, partner, "failed", _error_with_line(error, subject))
    except (CheckFailed, PercussError) as error:
        message = str(error) if isinstance(error, CheckFailed) else _error_with_line(error, subject)
        return Outcome(kit_check, partner, "expected failure" if reason else "failed", message, reason)
    except BaseException as error:  # the kit reports any error that a plug-in raises
        if not isinstance(error, Exception) and (is_ctrl_c(error) or not line_in_plugin(error)):
            raise
        # an expected failure excuses a broken demand, never an error of the program
        return Outcome(kit_check, partner, "failed", _error_with_line(error, subject))
    if reason:
        return Outcome(kit_check, partner, "passes unexpectedly", reason=reason)
    return Outcome(kit_check, partner, "passed")


def conformance(
    component: type[Component], *, registry: Registry | None = None, draws: int = DRAWS, strict: bool = True
) -> Report:
    """Run every check of the kit on a component.

    Parameters
    ----------
    component
        Class of the method; it need not be registered.
    registry
        Registered components from which partners are taken; by default everything installed.
    draws
        Number of cases that a check draws.
    strict
        Whether to raise an error if a check failed or a declared failure did not occur.

    Returns
    -------
    Report
        Outcome of each check; converted to text, it is a readable report.

    Raises
    ------
    AssertionError
        If `strict` and a check failed or a declared failure did not occur; the message is the report.
    """
    subject = Subject.of(component, registry, draws)
    report = Report(component, tuple(perform(kit_check, subject, partner) for kit_check, partner in checks_of(subject)))
    if strict and not report.passed:
        raise AssertionError(str(report))
    return report


def conformance_test(component: type[Component], *, draws: int = DRAWS) -> Callable[..., None]:
    """Return a pytest function with one test for each check: ``test_conformance = conformance_test(MyLaw)``."""
    import pytest

    subject = Subject.of(component, draws=draws)
    checks = list(checks_of(subject))

    @pytest.mark.parametrize(("kit_check", "partner"), checks, ids=[named(*pair) for pair in checks])
    def test_conformance(kit_check: Check, partner: str) -> None:
        outcome = perform(kit_check, subject, partner)
        if outcome.status == "not applicable":
            pytest.skip(outcome.message)
        if outcome.status == "expected failure":
            pytest.xfail(outcome.reason)
        if not outcome.counts:
            pytest.skip(f"{OTHERS} {outcome.status} {outcome.message}")
        if not outcome.good:
            pytest.fail(str(outcome), pytrace=False)

    return test_conformance


def _error_with_line(error: BaseException, subject: Subject) -> str:
    """Return the text of an error with its notes and the last line of the plug-in in its traceback."""
    file = subject.registry.sources[subject.family, subject.name].file
    lines = [f"{f.filename}:{f.lineno}" for f in traceback.extract_tb(error.__traceback__) if f.filename == file]
    notes = "".join(f"\n{note}" for note in getattr(error, "__notes__", ()))
    place = f" [{lines[-1]}]" if lines else ""
    return f"{described(error)}{place}{notes}"


def _filled(text: str) -> str:
    """Return a text wrapped to lines of at most 96 characters."""
    import textwrap

    return textwrap.fill(text, 96, break_long_words=False, break_on_hyphens=False)


def _indented(text: str) -> str:
    """Return a text with every line indented below the names of the checks."""
    return "\n".join(f"{'':22}{line}" for line in text.splitlines())
