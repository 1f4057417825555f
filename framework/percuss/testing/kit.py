"""Checks of the conformance kit, how they are run on a component, and what comes out.

A check is a plain function of a `Subject` that returns where the component does as the contract demands, and raises
where it does not. One that takes a partner is run once for each registered method it may be paired with. The only way
round a check is `Component.expected_failures`: it is run all the same, and a declared failure that does not occur is
an error.
"""

from __future__ import annotations

import dataclasses
import inspect
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from percuss.errors import PercussError, PluginError, RefusedPair, RunError, nearest
from percuss.methods.interfaces import FAMILIES, Component
from percuss.methods.registry import Provenance, Registry

__all__ = ["Check", "CheckFailed", "NotApplicable", "Outcome", "Report", "Subject", "check", "checks", "conformance"]

DRAWS = 12  # cases a check draws
PARTNERS = {"integrators": "contacts", "contacts": "integrators"}
Status = Literal["passed", "failed", "expected failure", "passes unexpectedly", "not applicable"]


class CheckFailed(AssertionError):
    """A component does not do what a check demands; the message says what was found."""


class NotApplicable(Exception):
    """A check has nothing to say of a component; the message says why."""


def forbidden(stopped: RunError) -> bool:
    """Whether a run was not started because of its certificate, in place of being stopped."""
    from percuss.solver.stop import NOT_STARTED

    return bool(stopped.result.summary["stop"]["what"] == NOT_STARTED)


@dataclass(frozen=True)
class Subject:
    """A component under test, with everything else that is registered beside it.

    Attributes
    ----------
    component
        The class.
    registry
        All components, the one under test among them.
    draws
        How many cases a check draws.
    check
        Name of the check that is running.
    loaded
        The case that the check that is running has read last; a failure tells it.
    """

    component: type[Component]
    registry: Registry
    draws: int = DRAWS
    check: str = ""
    loaded: list[Mapping[str, Any]] = field(default_factory=list, compare=False, repr=False)

    @staticmethod
    def of(component: type[Component], registry: Registry | None = None, draws: int = DRAWS) -> Subject:
        """Return a class as a subject; it need not be registered, and takes the place of one of its name."""
        if not (isinstance(component, type) and issubclass(component, Component) and "name" in vars(component)):
            raise PluginError(f"{component!r} is no finished component: pass the class of a method")
        registry = registry or Registry.load()
        key = component.family, component.name
        if registry.components.get(key) is not component:
            file = inspect.getsourcefile(component) if component.__module__ in sys.modules else None
            source = Provenance("", "unregistered", component.__module__, file or "")
            registry = dataclasses.replace(
                registry,
                components={**registry.components, key: component},
                sources={**registry.sources, key: source},
                clashes={one: who for one, who in registry.clashes.items() if one != key},
            )
        return Subject(component, registry, draws)

    @property
    def family(self) -> str:
        """Its family."""
        return self.component.family

    @property
    def name(self) -> str:
        """Its name in a case."""
        return self.component.name

    @property
    def examples(self) -> list[dict[str, Any]]:
        """The option sets that it says make sense; a data file stands beside the file of the component."""
        from percuss.case.options import options_of, takes_file

        folder = Path(self.registry.sources[self.family, self.name].file).parent
        files = [key for key, option in options_of(self.component).items() if takes_file(option.annotation)]
        out = [dict(one) for one in self.component.examples]
        for example in out:
            example |= {
                key: str((folder / example[key]).resolve())
                for key in files
                if isinstance(example.get(key), str) and (folder / example[key]).is_file()
            }
        return out

    def make(self, options: Mapping[str, Any]) -> Any:
        """Return an instance, its options checked as those of a case are."""
        from percuss.case.options import validate

        made, faults = validate(self.component, options, kind=f"the {self.family} {self.name}", folder=Path())
        if made is None:
            raise CheckFailed("; ".join(f"{'.'.join(map(str, one.path))}: {one.message}" for one in faults))
        return made

    def placed(self, case: Mapping[str, Any], options: Mapping[str, Any], partner: Any = "") -> dict[str, Any]:
        """Return a case in which the component has its part, with `options`, and `partner` the other part of a pair."""
        named = {"name": self.name, **options}
        out = dict(case)
        method = dict(case.get("method", {}))
        if self.family in {"integrators", "contacts", "masses"}:
            method[{"integrators": "integrator", "contacts": "contact", "masses": "mass"}[self.family]] = named
        if partner:
            other = "contact" if self.family == "integrators" else "integrator"
            method[other] = {"name": partner} if isinstance(partner, str) else partner
        out["method"] = method
        if self.family in {"materials", "elements"}:
            part = {"materials": "material", "elements": "element"}[self.family]
            out["bodies"] = {name: {**body, part: named} for name, body in case["bodies"].items()}
        if self.family == "shapes":
            out["bodies"] = {
                name: {key: value for key, value in body.items() if key != "bar"} | {self.name: dict(options)}
                for name, body in case["bodies"].items()
            }
        return out

    def load(self, case: Mapping[str, Any]) -> Any:
        """Return a case given as a mapping, read with the component at hand."""
        from percuss.case.case import load

        self.loaded[:] = [case]
        return load(case, registry=self.registry)

    def last_case(self) -> str:
        """Return the case that was read last as the text of a case file, to be saved and run; empty if there is none.

        It names the file that registers the component, where that is a single file.
        """
        import yaml

        from percuss.jsonable import plain

        if not self.loaded:
            return ""
        source = self.registry.sources.get((self.family, self.name))
        single = source is not None and not source.distribution and Path(source.file).suffix == ".py"
        plugins = {"plugins": [str(Path(source.file).resolve())]} if source is not None and single else {}
        case = {"percuss": 1, "title": f"{self.check} of {self.name}", **plugins, **plain(self.loaded[-1])}
        text: str = yaml.safe_dump(case, sort_keys=False, default_flow_style=None, width=120, allow_unicode=True)
        return text

    def run(self, case: Mapping[str, Any], *, compiled: bool = True) -> Any:
        """Run a case given as a mapping.

        Raises
        ------
        NotApplicable
            If its pair refuses one another.
        """
        from percuss.results.runner import run

        try:
            return run(self.load(case), compiled=compiled)
        except RefusedPair as refused:
            raise NotApplicable(f"refused: {refused}") from None


@dataclass(frozen=True)
class Check:
    """A demand on components of some families.

    Attributes
    ----------
    name
        By which a component declares that it is known to fail it.
    families
        Whom it is for.
    demand
        What is demanded and why: the docstring of the function.
    function
        Called with the `Subject`, and with the name of a partner where the check is one of pairs.
    in_pairs
        Whether it is run with every partner.
    """

    name: str
    families: tuple[str, ...]
    demand: str
    function: Callable[..., None]
    in_pairs: bool


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


_CHECKS: list[Check] = []


def check(*families: str, in_pairs: bool = False) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a function ``check_what_it_says`` as the check ``what-it-says`` of some families, by default of all."""

    def register(function: Callable[..., None]) -> Callable[..., None]:
        name = function.__name__.removeprefix("check_").replace("_", "-")
        demand = " ".join(inspect.cleandoc(function.__doc__ or "").split())
        _CHECKS.append(Check(name, families or tuple(FAMILIES), demand, function, in_pairs))
        return function

    return register


def known_checks() -> list[Check]:
    """Return all checks, in the order in which they are run."""
    from percuss.testing import bulk, common, contacts, integrators, loads, others, pairs  # noqa: F401

    return list(_CHECKS)


def named(one: Check, partner: str) -> str:
    """Return the name of a check with its partner's."""
    return f"{one.name} with {partner}" if partner else one.name


def checks(subject: Subject) -> Iterator[tuple[Check, str]]:
    """Yield every check that is for a subject, once with each partner where it is one of pairs."""
    for one in known_checks():
        if subject.family not in one.families:
            continue
        if one.in_pairs:
            yield from ((one, partner) for partner in subject.registry.names(PARTNERS[subject.family]))
        else:
            yield one, ""


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
    report = Report(component, tuple(perform(one, subject, partner) for one, partner in checks(subject)))
    if strict and not report.passed:
        raise AssertionError(str(report))
    return report


def conformance_test(component: type[Component], *, draws: int = DRAWS) -> Callable[..., None]:
    """Return a pytest function of all checks, one test a check: ``test_conformance = conformance_test(MyLaw)``."""
    import pytest

    subject = Subject.of(component, draws=draws)
    every = list(checks(subject))

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


def known_names(subject: Subject) -> list[str]:
    """Return the names by which a subject may declare expected failures."""
    every = list(checks(subject))
    return list(dict.fromkeys([*(one.name for one, _ in every), *(named(*each) for each in every)]))


def did_you_mean(text: str, known: list[str]) -> str:
    """Return advice with the nearest known name."""
    near = nearest(text, known)
    return f"; did you mean '{near}'?" if near else ""


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
