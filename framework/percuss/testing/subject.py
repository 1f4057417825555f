"""A component under test, and the checks that are registered for its family."""

from __future__ import annotations

import dataclasses
import inspect
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from percuss.errors import PluginError, RefusedPair, RunError, nearest
from percuss.methods.interfaces import FAMILIES, Component
from percuss.methods.provenance import Provenance
from percuss.methods.registry import Registry

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


CHECKS: list[Check] = []


def check(*families: str, in_pairs: bool = False) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a function ``check_what_it_says`` as the check ``what-it-says`` of some families, by default of all."""

    def register(function: Callable[..., None]) -> Callable[..., None]:
        name = function.__name__.removeprefix("check_").replace("_", "-")
        demand = " ".join(inspect.cleandoc(function.__doc__ or "").split())
        CHECKS.append(Check(name, families or tuple(FAMILIES), demand, function, in_pairs))
        return function

    return register


def named(one: Check, partner: str) -> str:
    """Return the name of a check with its partner's."""
    return f"{one.name} with {partner}" if partner else one.name


def registered_checks(subject: Subject) -> Iterator[tuple[Check, str]]:
    """Yield every check that is for a subject, once with each partner where it is one of pairs."""
    for one in CHECKS:
        if subject.family not in one.families:
            continue
        if one.in_pairs:
            yield from ((one, partner) for partner in subject.registry.names(PARTNERS[subject.family]))
        else:
            yield one, ""


def known_names(subject: Subject) -> list[str]:
    """Return the names by which a subject may declare expected failures."""
    every = list(registered_checks(subject))
    return list(dict.fromkeys([*(one.name for one, _ in every), *(named(*each) for each in every)]))


def did_you_mean(text: str, known: list[str]) -> str:
    """Return advice with the nearest known name."""
    near = nearest(text, known)
    return f"; did you mean '{near}'?" if near else ""
