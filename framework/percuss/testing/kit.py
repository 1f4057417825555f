"""The conformance kit: a generator of checks of a method.

A check asks one demand of the contract of one method, with a partner where the demand is on pairs. Only
`Component.expected_failures` excuses a failure: the check is still made, and a declared failure that does not occur is
a failure. Where a law declares to fail a check with an integrator, nothing is demanded of another integrator with it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from percuss.errors import PercussError, PluginError, suggestion
from percuss.methods.blame import OF_AN_ANSWER, described, line_in_plugin, third_party_files
from percuss.methods.interfaces import Component
from percuss.methods.registry import Registry
from percuss.testing.subject import DRAWS, PARTNERS, CheckFailed, DeclaredFailure, Demand, NotApplicable, Subject


def demands() -> list[Demand]:
    """Return all demands of the kit in the order in which they are checked: whether a method runs at all comes first.

    Raises
    ------
    PluginError
        If Hypothesis is missing, with which they draw cases.
    """
    if find_spec("hypothesis") is None:
        raise PluginError("the kit draws its cases with hypothesis: pip install 'percuss[kit]'")
    from percuss.testing.demands import bodies, common, contacts, frictions, surfaces

    modules = (common, bodies, contacts, surfaces, frictions)
    return [each for module in modules for each in vars(module).values() if isinstance(each, Demand)]


@dataclass(frozen=True)
class Check:
    """The check of a demand on a method: called, it raises `CheckFailed` if the demand is not met.

    Attributes
    ----------
    demand
        What is demanded.
    subject
        The method.
    partner
        Name of the partner, empty where the demand is not on pairs.
    """

    demand: Demand
    subject: Subject
    partner: str = ""

    @property
    def name(self) -> str:
        """Name of the demand, followed by the name of the partner if there is one."""
        return f"{self.demand.name} with {self.partner}" if self.partner else self.demand.name

    def __call__(self) -> None:
        """Make the check.

        Raises
        ------
        CheckFailed
            If the method does not meet the demand, or is declared to fail and does not.
        NotApplicable
            If the check does not apply to it: among them `DeclaredFailure`, if it fails as declared.
        """
        reason = self._declared()
        if not reason and (elsewhere := self._fails_elsewhere()):
            raise NotApplicable(
                f"{self.partner} fails it with {elsewhere} too: nothing follows for {self.subject.name}"
            )
        subject = dataclasses.replace(self.subject, check=self.demand.name, read=[])
        try:
            with np.printoptions(threshold=6, linewidth=10**6):  # what decides stands behind an array in one line
                self.demand.function(subject, *filter(None, [self.partner]))
        except NotApplicable:
            raise
        except Exception as error:
            # A declared failure excuses a demand that is not met, never an error of the program.
            if reason and isinstance(error, CheckFailed | PercussError):
                raise DeclaredFailure(f"declared: {reason}") from None
            raise CheckFailed(_text_of(error), self.demand.text, subject.last_case()) from error
        if reason:
            raise CheckFailed(f"declared to fail ({reason}), but it passes: delete the entry", self.demand.text)

    def _declared(self) -> str:
        """Return the reason for a failure that the method or its partner declares, empty if none does."""
        sides = [(self.subject.component, self.partner)]
        if self.partner:
            sides.append((self.subject.partner_class(self.partner), self.subject.name))
        for side, other in sides:
            for name in (self.demand.name, f"{self.demand.name} with {other}"):
                if reason := side.expected_failures.get(name):
                    return reason
        return ""

    def _fails_elsewhere(self) -> str:
        """Return the integrators with which the law beside an integrator declares to fail the check."""
        if not self.partner or self.subject.family != "integrators":
            return ""
        start = f"{self.demand.name} with "
        declared = self.subject.partner_class(self.partner).expected_failures
        return " and ".join(name.removeprefix(start) for name in declared if name.startswith(start))


def checks(
    method: type[Component], *, registry: Registry | None = None, draws: int = DRAWS
) -> Iterator[tuple[str, Check]]:
    """Yield the name of each check of a method, and the check as a function without arguments.

    Parameters
    ----------
    method
        Class of the method; it need not be registered.
    registry
        Registered methods from which partners are taken; by default everything installed.
    draws
        Number of cases that a check draws.
    """
    subject = Subject.of(method, registry, draws)
    asked = [one for one in demands() if subject.family in one.families]
    others = subject.registry.names(PARTNERS[subject.family]) if subject.family in PARTNERS else []
    pairs = [f"{one.name} with {other}" for one in asked if one.in_pairs for other in others]
    subject = dataclasses.replace(subject, declarable=(*(one.name for one in asked), *pairs))
    for one in asked:
        for partner in subject.partners if one.in_pairs else [""]:
            check = Check(one, subject, partner)
            yield check.name, check


def parametrize(*methods: type[Component], draws: int = DRAWS) -> Callable[..., Any]:
    """Return a decorator that makes a test of each check of some methods out of a function of pytest.

    Examples
    --------
    ::

        @parametrize(MyLaw)
        def test_conformance(check):
            check()
    """
    import pytest

    found = [
        pytest.param(check, id=f"{method.name}-{name}")
        for method in methods
        for name, check in checks(method, draws=draws)
    ]
    return pytest.mark.parametrize("check", found)


class Outcome(NamedTuple):
    """The outcome of a check.

    Attributes
    ----------
    name
        Name of the check.
    status
        ``passed``, ``failed``, ``declared`` for a failure that the method declares, or ``skipped``.
    message
        Deviation from the demand, or the reason why the check does not apply.
    demand
        What is demanded, and why.
    case
        Case of a failure, as the text of a file that can be saved and run; empty if the check read none.
    """

    name: str
    status: str
    message: str = ""
    demand: str = ""
    case: str = ""

    def __str__(self) -> str:
        return f"{self.status:>8}  {self.name}{': ' if self.message else ''}{self.message}"


def outcome_of(check: Check) -> Outcome:
    """Make a check and return its outcome."""
    try:
        check()
    except CheckFailed as failure:
        return Outcome(check.name, "failed", failure.message, failure.demand, failure.case)
    except DeclaredFailure as failure:
        return Outcome(check.name, "declared", str(failure).removeprefix("declared: "), check.demand.text)
    except NotApplicable as exemption:
        return Outcome(check.name, "skipped", str(exemption), check.demand.text)
    return Outcome(check.name, "passed", demand=check.demand.text)


def _text_of(error: Exception) -> str:
    """Return the text of an error, of one of the program after the line of the plug-in in which it was raised."""
    if isinstance(error, CheckFailed | PercussError):
        return error.message if isinstance(error, CheckFailed) else str(error)
    where, advice = line_in_plugin(error), ""
    if not where and isinstance(error, OF_AN_ANSWER):
        where, advice = ", ".join(third_party_files()), ", where percuss used an answer of the method"
    if isinstance(error, AttributeError) and error.name and error.obj is not None:
        advice = f". {suggestion(error.name, (name for name in dir(error.obj) if name[0] != '_'), 'attribute')}"
    return f"{where}{': ' if where else ''}{described(error)}{advice}"
