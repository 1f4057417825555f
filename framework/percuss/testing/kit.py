"""The conformance kit: it runs its checks on a component and reports the outcomes.

A check is a plain function of a `Subject` that returns if the component meets the demand of the contract, and raises
if it does not. A check that takes a partner is run once with each registered method that the component may be paired
with. Partners of percuss and of the component's own plug-in decide; those of other plug-ins are listed apart. Only
`Component.expected_failures` excuses a failure: the check is still run, and a declared failure that does not occur is
an error. Where a law declares to fail a check with an integrator, nothing is demanded of it with another one that
evaluates laws in the same states. In a check the methods of the component are asked everything twice (`trials`).
"""

from __future__ import annotations

import dataclasses
import traceback
from collections.abc import Callable, Iterator

import numpy as np

from percuss.errors import PercussError, PluginError, suggestion
from percuss.methods.blame import described
from percuss.methods.interfaces import Component, ContactState, LeapFrog
from percuss.methods.registry import Registry
from percuss.testing.report import OTHERS, Outcome, Report
from percuss.testing.subject import DRAWS, PARTNERS, Check, CheckFailed, NotApplicable, Status, Subject, named
from percuss.testing.trials import asked_twice


def known_checks() -> list[Check]:
    """Return all checks of the kit in the order in which they are run.

    Raises
    ------
    PluginError
        If Hypothesis is missing, with which they draw cases.
    """
    try:
        from percuss.testing.checks import bulk, common, contacts, integrators, loads, others, pairs, solids
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "hypothesis":
            raise
        raise PluginError("the kit draws its cases with hypothesis: pip install 'percuss[kit]'") from None
    modules = (bulk, common, contacts, pairs, integrators, loads, others, solids)
    return [each for module in modules for each in vars(module).values() if isinstance(each, Check)]


def checks_of(subject: Subject) -> Iterator[tuple[Check, str]]:
    """Yield each check of a subject with an empty partner, or once with each partner if the check is made in pairs.

    The check whether the subject runs at all comes first. Pairs with partners that do not judge the subject come last.
    """
    checks = sorted((one for one in known_checks() if subject.family in one.families), key=lambda one: not one.first)
    for kit_check in checks:
        yield from ((kit_check, partner) for partner in (subject.partners if kit_check.in_pairs else [""]))
    others = subject.registry.names(PARTNERS[subject.family]) if subject.family in PARTNERS else []
    for partner in (name for name in others if name not in subject.partners):
        yield from ((kit_check, partner) for kit_check in checks if kit_check.in_pairs)


def expected(kit_check: Check, subject: Subject, partner: str) -> str:
    """Return the reason for an expected failure declared by the component or its partner, empty if there is none."""
    sides = [(subject.component, partner)]
    if partner:
        sides.append((subject.partner_class(partner), subject.name))
    names = [(side, name) for side, other in sides for name in (kit_check.name, named(kit_check, other))]
    return next((side.expected_failures[name] for side, name in names if side.expected_failures.get(name)), "")


def _fails_elsewhere(kit_check: Check, subject: Subject, partner: str) -> str:
    """Return the integrators with which a law declares to fail a check, where nothing follows for another integrator.

    That is any other integrator if it is the subject, and one that shows a law the same states if the law is.
    """
    if not partner:
        return ""
    if subject.family == "integrators":
        declared = subject.partner_class(partner).expected_failures
        start = f"{kit_check.name} with "
        return " and ".join(name.removeprefix(start) for name in declared if name.startswith(start))
    states = _shown_states(subject, partner)
    others = (name for name in subject.partners if name != partner and states is not None)
    alike = (name for name in others if _shown_states(subject, name) == states)
    return next((name for name in alike if expected(kit_check, subject, name)), "")


def _shown_states(subject: Subject, integrator: str) -> tuple[ContactState, ContactState] | None:
    """Return the states at which a leap-frog scheme evaluates contact laws, None for a multi-stage scheme."""
    scheme = subject.scheme(integrator)
    return (scheme.explicit, scheme.end) if isinstance(scheme, LeapFrog) else None


def perform(kit_check: Check, subject: Subject, partner: str = "") -> Outcome:
    """Run a check on a subject and return its outcome."""
    counts, reason = not partner or partner in subject.partners, expected(kit_check, subject, partner)
    if not reason and (fails_with := _fails_elsewhere(kit_check, subject, partner)):
        law, integrator = (subject.name, partner) if subject.family == "contacts" else (partner, subject.name)
        message = f"{law} fails it with {fails_with} too: nothing follows for {integrator}"
        return Outcome(kit_check, partner, "not applicable", message, counts=counts)
    checks = list(checks_of(subject))
    declarable = dict.fromkeys([*(one.name for one, _ in checks), *(named(*pair) for pair in checks)])
    subject = dataclasses.replace(subject, check=kit_check.name, loaded=[], declarable=tuple(declarable))
    status, message = _performed(kit_check, subject, partner, declared=bool(reason))
    if status == "failed":
        return Outcome(kit_check, partner, status, message, case=subject.last_case(), counts=counts)
    return Outcome(kit_check, partner, status, message, reason, counts=counts)


def _performed(kit_check: Check, subject: Subject, partner: str, *, declared: bool) -> tuple[Status, str]:
    """Return status and message of a check, which may be declared to fail."""
    try:
        # the words after an array decide: they stand in the same line
        with asked_twice(subject.component, subject.asked), np.printoptions(threshold=6, linewidth=10**6):
            kit_check(subject, partner) if partner else kit_check(subject)
    except NotApplicable as exemption:
        return "not applicable", str(exemption)
    except (CheckFailed, PercussError) as error:
        message = str(error) if isinstance(error, CheckFailed) else _error_with_line(error, subject)
        return "expected failure" if declared else "failed", message
    except Exception as error:  # noqa: BLE001  the kit reports any error that a plug-in raises
        # an expected failure excuses a broken demand, never an error of the program
        return "failed", _error_with_line(error, subject)
    return "passes unexpectedly" if declared else "passed", ""


def examine(subject: Subject, tell: Callable[[Outcome, int, int], None] = lambda *_: None) -> Report:
    """Run every check of the kit on a subject, and return the report.

    Each outcome is told as it comes, with the number of checks that are made and the number of all.

    If the first check fails, the component cannot run, and no other check is made. Of the failure with the smallest
    case, a smaller case still is sought.
    """
    planned = list(checks_of(subject))
    outcomes = []
    for kit_check, partner in planned:
        outcomes.append(perform(kit_check, subject, partner))
        tell(outcomes[-1], len(outcomes), len(planned))
        if kit_check.first and not outcomes[-1].good:
            break
    report = Report(subject.component, tuple(outcomes), len(planned) - len(outcomes))
    if found := report.smallest:
        smaller = perform(found.check, dataclasses.replace(subject, shrinks=True), found.partner)
        if smaller.status == "failed":
            kept = tuple(smaller if outcome is found else outcome for outcome in outcomes)
            return dataclasses.replace(report, outcomes=kept)
    return report


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
    report = examine(Subject.of(component, registry, draws))
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
    """Return the text of an error, after the last line of the plug-in in its traceback."""
    file = subject.registry.sources[subject.family, subject.name].file
    lines = [f"{f.filename}:{f.lineno}: " for f in traceback.extract_tb(error.__traceback__) if f.filename == file]
    if isinstance(error, PercussError):  # it names the line itself
        return str(error)
    advice = ""
    if isinstance(error, AttributeError) and error.name and error.obj is not None:
        advice = f". {suggestion(error.name, (name for name in dir(error.obj) if name[0] != '_'), 'attribute')}"
    return f"{lines[-1] if lines else ''}{described(error)}{advice}"
