"""The subject of the conformance kit, a method under test, and what a demand on it is."""

from __future__ import annotations

import dataclasses
import inspect
import sys
import textwrap
import unittest
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np
import yaml
from pydantic import ValidationError

from percuss.case.case import Case, load
from percuss.case.defaults import DEFAULTS
from percuss.case.options import options_of
from percuss.case.type_words import branches
from percuss.case.validation import Context, mistakes_in, validate
from percuss.case.yaml_text import dotted
from percuss.certificate.verdict import Certify, verdict_alone
from percuss.contact.bound_law import bind_law
from percuss.errors import PluginError, RefusedPair
from percuss.jsonable import Data, Entries, plain
from percuss.methods.interfaces import FAMILIES, Component, ContactPoints, DataFile, Integrator, LeapFrog, MeshFile
from percuss.methods.plugin_calls import read_only
from percuss.methods.provenance import Provenance
from percuss.methods.registry import Registry
from percuss.results.result import Result
from percuss.results.runner import examined_run

DRAWS = 12  # number of cases that a check draws
ROUND_OFF = 1e-9  # of a number that is zero but for round-off, relative to the size of the numbers it comes from
PARTNERS = {"integrators": "contacts", "contacts": "integrators"}
# Keys of methods in the section `method` of a case, or in a body.
KEYS_IN_CASE = {
    "integrators": "integrator", "contacts": "contact", "masses": "mass", "solutions": "solution",
    "materials": "material", "elements": "element", "pairings": "pairing", "frictions": "friction",
}  # fmt: skip


class CheckFailed(AssertionError):
    """Raised by a check when a method does not meet its demand.

    Parameters
    ----------
    message
        The deviation.
    demand
        What is demanded, and why.
    case
        Text of the case that the check read last, as a case file that can be saved and run; empty if it read none.
    """

    def __init__(self, message: str, demand: str = "", case: str = "") -> None:
        super().__init__(message)
        self.message, self.demand, self.case = message, demand, case

    def __str__(self) -> str:
        demand = textwrap.fill(f"demanded: {self.demand}", 96) if self.demand else ""
        return "\n".join(filter(None, (self.message, demand, self.case)))


def must(holds: object, words: str) -> None:
    """Raise `CheckFailed` with some words unless something holds; a comparison with nan never does."""
    if not holds:
        raise CheckFailed(words)


def must_vanish(numbers: Any, words: str, allowed: float = ROUND_OFF) -> None:
    """Raise `CheckFailed` with some words unless all numbers, whose size is 1, are zero up to what is allowed."""
    must(np.abs(numbers).max(initial=0.0) <= allowed, words)


class NotApplicable(unittest.SkipTest):
    """Raised by a check that does not apply to a method, with the reason; pytest skips such a test."""


class DeclaredFailure(NotApplicable):
    """Raised by a check that a method fails as it declares."""


def sample_points(count: int, part: slice = slice(None), area: float = 1.0) -> ContactPoints:
    """Return `count` unlike contact points of an area with read-only arrays, or a part of these."""
    k = np.arange(count)[part]
    stiffness, mass = read_only((area * 1000.0 * 1.3**k, area * 0.02 * 0.9**k))
    points = ContactPoints(
        names=tuple(f"point{i}" for i in k),
        stiffness=stiffness,
        frequency=np.sqrt(2.0 * stiffness / mass),
        mass=mass,
        equal_sides=np.ones(k.size, bool),
        delassus=2.0 / mass,
        coupling=np.ones(k.size),
        weight=np.full(k.size, area),
        limits=lambda: stiffness,
    )
    return cast("ContactPoints", read_only(points))


@dataclass(frozen=True)
class Subject:
    """A method under test, together with all other registered methods.

    Attributes
    ----------
    component
        Class of the method.
    registry
        All methods, including the method under test.
    draws
        Number of cases that a check draws.
    check
        Name of the running check.
    read
        Case that the running check read last, as a list of one entry; a failure tells it.
    options, partner
        Options of the method and name of its partner in the cases of a check that draws them.
    declarable
        Names of checks, alone and with each partner, that the method may declare as expected failures.
    """

    component: type[Component]
    registry: Registry
    draws: int = DRAWS
    check: str = ""
    read: list[Data] = field(default_factory=list, compare=False, repr=False)
    options: Data = field(default_factory=dict, repr=False)
    partner: str = ""
    declarable: tuple[str, ...] = field(default=(), compare=False, repr=False)

    @staticmethod
    def of(component: type[Component], registry: Registry | None = None, draws: int = DRAWS) -> Subject:
        """Return the subject of a class, which need not be registered and replaces a registered class of its name."""
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
                clashes={clash: sources for clash, sources in registry.clashes.items() if clash != key},
            )
        return Subject(component, registry, draws)

    @property
    def family(self) -> str:
        """Family of the method."""
        return self.component.family

    @property
    def name(self) -> str:
        """Name of the method in a case."""
        return self.component.name

    @property
    def examples(self) -> list[Entries]:
        """Option sets that the method gives as examples, with absolute paths of the data files beside its file."""
        folder = Path(self.registry.sources[self.family, self.name].file).parent
        kinds = {DataFile, MeshFile}
        files = {key for key, option in options_of(self.component).items() if kinds & set(branches(option.annotation))}
        return [
            {key: str((folder / value).resolve()) if key in files else value for key, value in example.items()}
            for example in self.component.examples
        ]

    # ---------------------------------------------------------------------------------------------- its partners

    @cached_property
    def partners(self) -> list[str]:
        """Names of the partners: one of each kind that is registered; none if its family has no partners.

        Integrators are of one kind if contact laws see the same states, laws if they are alike in form. Of a kind it is
        one for which the method declares a failure, else the default, else the plainest.
        """
        if self.family not in PARTNERS:
            return []
        family, declared = PARTNERS[self.family], " ".join(self.component.expected_failures)
        found = []
        for name in self.registry.names(family):
            kind, extras = _kind_of(self.partner_class(name))
            found.append((f"with {name}" not in declared, name != DEFAULTS[family], extras, name, kind))
        kinds: dict[object, str] = {}
        for *_, name, kind in sorted(found, key=lambda one: one[:4]):
            kinds.setdefault(kind, name)
        return sorted(kinds.values())

    def partner_class(self, name: str) -> type[Component]:
        """Return the class of a registered method that this one may be paired with."""
        return self.registry.components[PARTNERS[self.family], name]

    # ------------------------------------------------------------------------------------------- instances, cases

    def make(self, options: Data) -> Any:
        """Return an instance of the method whose options were checked in the same way as the options of a case."""
        try:
            return validate(self.component, dict(options), Context(self.registry, Path()))
        except ValidationError as error:
            mistakes = (f"{dotted(mistake.path)}: {mistake.message}" for mistake in mistakes_in(error))
            raise CheckFailed("; ".join(mistakes)) from None

    def made(self) -> Iterator[tuple[Entries, Any]]:
        """Yield each option set of the examples, with an instance that has these options."""
        for options in self.examples:
            yield options, self.make(options)

    def placed(self, case: Data, options: Data | None = None, partner: str | Data | None = None) -> Entries:
        """Return a case that uses the method, and its partner as the other method of its pair.

        Options and partner are those given, else those of the subject.
        """
        options = self.options if options is None else options
        partner = self.partner if partner is None else partner
        key, bodies, method = KEYS_IN_CASE.get(self.family), case["bodies"], dict(case.get("method", {}))
        own = {"name": self.name, **options}
        if partner:
            other = KEYS_IN_CASE[PARTNERS[self.family]]
            method[other] = {"name": partner} if isinstance(partner, str) else partner
        if self.family in {"materials", "elements"}:
            bodies = {name: {**body, key: own} for name, body in bodies.items()}
        elif key:
            method[key] = own
        return {**case, "bodies": bodies, "method": method}

    def along_line(self) -> None:
        """Raise NotApplicable unless the method is one of bars, of which the cases of most checks are made.

        Raises
        ------
        NotApplicable
            If it is an element, a shape or a material of other bodies, or a pairing of their surfaces.
        """
        made = self.make(self.examples[0])
        cell = getattr(made, "cell", "line" if self.family != "pairings" else "")
        if not cell.startswith("line") or getattr(made, "stress", made) is None:
            raise NotApplicable("it is not one of bars")

    def scheme_of(self, case: Data) -> object:
        """Return the scheme of the integrator of a case, with a step of 1."""
        return self.load(case).method.integrator.bind(1.0)

    def load(self, case: Data) -> Case:
        """Return a case read from a mapping, with the method under test among the registered methods."""
        self.read[:] = [case]
        return load(case, registry=self.registry)

    def run(
        self, case: Data, *, compiled: bool = True, certify: Certify = verdict_alone, like: Result | None = None
    ) -> Result:
        """Run a case given as a mapping.

        To find the certificate of a law with a kernel takes longer than to march, so a check asks for no more of it
        than it needs: for a twin of a run, of the same bodies in another place, order or unit, it is that of the run
        (`like`), and `unasked` where the run alone tells enough.

        Raises
        ------
        NotApplicable
            If integrator and contact law refuse each other.
        """
        known: Certify = certify if like is None else lambda *_: like.summary["certificate"]
        try:
            return examined_run(self.load(case), compiled=compiled, certify=known)
        except RefusedPair as refused:
            raise NotApplicable(f"refused: {refused.sentence}") from None

    def last_case(self) -> str:
        """Return the text of a case file, ready to be saved and run, of the case read last; empty if none was read.

        The case file names the plug-in file of the method if the plug-in is a single file.
        """
        if not self.read:
            return ""
        source = self.registry.sources[self.family, self.name]
        single = not source.distribution and Path(source.file).suffix == ".py"
        plugins = {"plugins": [str(Path(source.file).resolve())]} if single else {}
        case = {"percuss": 1, "title": f"{self.check} of {self.name}", **plugins, **plain(self.read[-1])}
        return str(yaml.safe_dump(case, sort_keys=False, default_flow_style=None, width=72))


def _kind_of(method: type[Component]) -> tuple[object, tuple[Any, ...]]:
    """Return what tells apart the kinds of integrators, or of laws, and what a method has beside those of its kind."""
    try:
        made: Any = method(**method.examples[0])
        if isinstance(made, Integrator):
            scheme = made.bind(1.0)
            return (scheme.explicit[:3], scheme[2:]) if isinstance(scheme, LeapFrog) else (type(scheme), ())
        linear = bind_law(made, (0,), sample_points(1), 1e-3).linear
    except Exception:  # noqa: BLE001 - of an unfinished method beside it
        return method.name, ()
    if linear is None:
        return (made.uses_coupling, bool(made.state)), ()
    return (linear.at, linear.active, linear.sign, bool(np.any(linear.acceleration))), ()


@dataclass(frozen=True)
class Demand:
    """What the kit demands of the methods of some families.

    Attributes
    ----------
    name
        Name by which a method declares that it fails the check of the demand.
    families
        Families of the methods of which it is demanded.
    text
        The demand and its reason: the docstring of the function.
    function
        Function called with the `Subject`, and with the name of a partner where it is demanded in pairs. It returns if
        the demand is met, and raises if it is not.
    in_pairs
        Whether it is demanded with each partner.
    """

    name: str
    families: tuple[str, ...]
    text: str
    function: Callable[..., None]
    in_pairs: bool


def demand(*families: str, in_pairs: bool = False) -> Callable[[Callable[..., None]], Demand]:
    """Make the demand ``energy-drift`` on some families, by default on all, of a function ``check_energy_drift``."""

    def made(function: Callable[..., None]) -> Demand:
        name = function.__name__.removeprefix("check_").replace("_", "-")
        text = " ".join(inspect.cleandoc(function.__doc__ or "").split())
        return Demand(name, families or tuple(FAMILIES), text, function, in_pairs)

    return made
