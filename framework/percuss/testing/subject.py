"""The subject of the conformance kit, a component under test, and what a check of it is."""

from __future__ import annotations

import dataclasses
import inspect
import sys
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, cast

from percuss.case.case import Case
from percuss.certificate.verdict import Certify, verdict_alone
from percuss.errors import PluginError, RefusedPair, RunError
from percuss.jsonable import Data, Entries
from percuss.methods.interfaces import FAMILIES, Component, DataFile, Integrator, LeapFrog, MeshFile, Stages
from percuss.methods.provenance import Provenance
from percuss.methods.registry import Registry
from percuss.results.result import Result

DRAWS = 12  # number of cases that a check draws
Scheme = LeapFrog | Stages
PARTNERS = {"integrators": "contacts", "contacts": "integrators"}
# Keys of methods in the section `method` of a case, or in a body.
KEYS_IN_CASE = {
    "integrators": "integrator", "contacts": "contact", "masses": "mass", "solutions": "solution",
    "materials": "material", "elements": "element",
}  # fmt: skip
SHIPPED = "percuss"  # distribution whose methods judge those of others
Status = Literal["passed", "failed", "expected failure", "passes unexpectedly", "not applicable"]


class CheckFailed(AssertionError):
    """Raised by a check when a component does not meet its demand; the message states the deviation."""


class NotApplicable(Exception):
    """Raised by a check that does not apply to a component; the message gives the reason."""


def as_of(result: Result) -> Certify:
    """Return what gives the twin of a run the certificate of that run."""
    return lambda *_: result.summary["certificate"]


def was_not_started(stopped: RunError) -> bool:
    """Return whether a run was refused before its first step because of its certificate, not stopped during it."""
    from percuss.march.stop import NOT_STARTED

    return bool(stopped.result.summary["stop"]["what"] == NOT_STARTED)


@dataclass(frozen=True)
class Subject:
    """A component under test, together with all other registered components.

    Attributes
    ----------
    component
        Class of the component.
    registry
        All components, including the component under test.
    draws
        Number of cases that a check draws.
    check
        Name of the running check.
    loaded
        Case that the running check read last, as a list of one entry; a failure reports it.
    shrinks
        Whether a check that draws cases looks for a small one that fails.
    options, partner
        Options of the component and name of its partner in the cases of a check that draws them.
    asked
        How often each question has been put to the component in the checks so far.
    declarable
        Names of checks, alone and with each partner, that the component may declare as expected failures.
    """

    component: type[Component]
    registry: Registry
    draws: int = DRAWS
    check: str = ""
    loaded: list[Data] = field(default_factory=list, compare=False, repr=False)
    shrinks: bool = False
    options: Data = field(default_factory=dict, repr=False)
    partner: str = ""
    asked: Counter[str] = field(default_factory=Counter, compare=False, repr=False)
    declarable: Sequence[str] = field(default=(), compare=False, repr=False)

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
        """Family of the component."""
        return self.component.family

    @property
    def name(self) -> str:
        """Name of the component in a case."""
        return self.component.name

    @property
    def examples(self) -> list[Entries]:
        """Option sets that the component gives as examples, with absolute paths of the data files beside its file."""
        from percuss.case.options import options_of
        from percuss.case.type_words import branches

        folder = Path(self.registry.sources[self.family, self.name].file).parent
        kinds = {DataFile, MeshFile}
        files = [key for key, option in options_of(self.component).items() if kinds & set(branches(option.annotation))]

        def placed(key: str, value: Any) -> Any:
            is_file = key in files and isinstance(value, str) and (folder / value).is_file()
            return str((folder / value).resolve()) if is_file else value

        return [{key: placed(key, value) for key, value in example.items()} for example in self.component.examples]

    def judges(self, family: str) -> list[str]:
        """Return the methods of a family that judge the component: those of percuss, and those of its own plug-in.

        A method of somebody else may be unfinished: the fault of a pair with it may be its own.
        """
        own = self.registry.sources[self.family, self.name]
        return [
            name
            for name in self.registry.names(family)
            if (source := self.registry.sources[family, name]).distribution in {SHIPPED, own.distribution or SHIPPED}
            or source.file == own.file
        ]

    @property
    def partners(self) -> list[str]:
        """Names of the partners that judge the component; none if its family has no partners."""
        return self.judges(PARTNERS[self.family]) if self.family in PARTNERS else []

    def partner_class(self, name: str) -> type[Component]:
        """Return the class of a registered method that the component may be paired with."""
        return self.registry.components[PARTNERS[self.family], name]

    def make(self, options: Data) -> Any:
        """Return an instance of the component whose options were checked in the same way as the options of a case."""
        from pydantic import ValidationError

        from percuss.case.validation import Context, mistakes_in, validate
        from percuss.case.yaml_text import dotted

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
        """Return a case that uses the component, and its partner as the other method of its pair.

        Options and partner are those given, else those of the subject.
        """
        self.along_line()
        options = self.options if options is None else options
        partner = self.partner if partner is None else partner
        key, bodies = KEYS_IN_CASE.get(self.family), case["bodies"]
        own = {key: {"name": self.name, **options}} if key else {}
        of_bodies = self.family in {"materials", "elements"}
        method = {**case.get("method", {}), **({} if of_bodies else own)}
        if partner:
            other = KEYS_IN_CASE[PARTNERS[self.family]]
            method[other] = {"name": partner} if isinstance(partner, str) else partner
        if of_bodies:
            bodies = {name: {**body, **own} for name, body in bodies.items()}
        if self.family == "shapes":
            shape = {self.name: dict(options)}
            bodies = {name: {key: body[key] for key in body if key != "bar"} | shape for name, body in bodies.items()}
        return {**case, "bodies": bodies, "method": method}

    def along_line(self) -> None:
        """Raise NotApplicable unless the component is one of bars, of which the cases of most checks are made.

        Raises
        ------
        NotApplicable
            If it is an element, a shape or a material of other bodies, or a pairing of their surfaces.
        """
        made = self.make(self.examples[0])
        cell = getattr(made, "cell", "line" if self.family != "pairings" else "")
        if not cell.startswith("line") or getattr(made, "stress", made) is None:
            raise NotApplicable("it is not one of bars")

    def scheme(self, integrator: str) -> Scheme:
        """Return the scheme of a registered integrator, with the first of its examples and a step of 1."""
        cls = cast("type[Integrator]", self.registry.components["integrators", integrator])
        return cls(**cls.examples[0]).bind(1.0)

    def scheme_of(self, case: Data) -> Scheme:
        """Return the scheme of the integrator of a case, with a step of 1."""
        return self.load(case).method.integrator.bind(1.0)

    def load(self, case: Data) -> Case:
        """Return a case read from a mapping, with the component under test among the registered components."""
        from percuss.case.case import load

        self.loaded[:] = [case]
        return load(case, registry=self.registry)

    def last_case(self) -> str:
        """Return the text of a case file, ready to be saved and run, of the case read last; empty if none was read.

        The case file names the plug-in file of the component if the plug-in is a single file.
        """
        from percuss.case.yaml_text import flow
        from percuss.jsonable import plain

        if not self.loaded:
            return ""
        source = self.registry.sources.get((self.family, self.name))
        single = source is not None and not source.distribution and Path(source.file).suffix == ".py"
        plugins = {"plugins": [str(Path(source.file).resolve())]} if source is not None and single else {}
        case = {"percuss": 1, "title": f"{self.check} of {self.name}", **plugins, **plain(self.loaded[-1])}
        lines = []
        for key, value in case.items():
            entries = value if key in {"bodies", "contacts", "loads", "method"} else {}  # a line for each
            lines += [f"{key}:" if entries else f"{key}: {flow(value)}"]
            lines += [f"  {name}: {flow(entry)}" for name, entry in entries.items()]
        wrapper = textwrap.TextWrapper(72, subsequent_indent=" " * 6, break_long_words=False, break_on_hyphens=False)
        return "".join(f"{wrapper.fill(line)}\n" for line in lines)

    def run(self, case: Data, *, compiled: bool = True, certify: Certify = verdict_alone) -> Result:
        """Run a case given as a mapping.

        To find the certificate of a law with a kernel takes longer than to march, so a check asks for no more of it
        than it needs: `as_of` a run for its twin, of the same bodies in another place, order or unit, and `unasked`
        where the run alone tells enough.

        Raises
        ------
        NotApplicable
            If integrator and contact law refuse each other.
        """
        from percuss.results.runner import examined_run
        from percuss.testing.trials import try_kernels

        loaded = self.load(case)
        try:
            try_kernels(loaded, self.component, self.asked)
            return examined_run(loaded, compiled=compiled, certify=certify)
        except RefusedPair as refused:
            raise NotApplicable(f"refused: {refused.sentence}") from None


@dataclass(frozen=True)
class Check:
    """A demand on the components of some families, with the function that checks it.

    Attributes
    ----------
    name
        Name by which a component declares the check as an expected failure.
    families
        Families of the components to which the check applies.
    holds
        What holds if the demand is met, in at most 40 characters: the first line of the docstring of the function.
    demand
        Demand and its reason: the rest of the docstring.
    function
        Function called with the `Subject`, and with the name of a partner where the check is run in pairs.
    in_pairs
        Whether the check is made once with each possible partner.
    first
        Whether the check is made before all others, which are not made if it fails.
    """

    name: str
    families: tuple[str, ...]
    holds: str
    demand: str
    function: Callable[..., None]
    in_pairs: bool
    first: bool

    def __call__(self, subject: Subject, *partner: str) -> None:
        """Check a subject, with the name of a partner where the check is made in pairs."""
        self.function(subject, *partner)


def check(*families: str, in_pairs: bool = False, first: bool = False) -> Callable[[Callable[..., None]], Check]:
    """Make the check ``energy-drift`` of some families, by default of all, of a function ``check_energy_drift``."""

    def made(function: Callable[..., None]) -> Check:
        name = function.__name__.removeprefix("check_").replace("_", "-")
        holds, _, demand = inspect.cleandoc(function.__doc__ or "").partition(".\n\n")
        demand = " ".join(demand.split())
        return Check(name, families or tuple(FAMILIES), holds, demand, function, in_pairs, first)

    return made


def named(kit_check: Check, partner: str) -> str:
    """Return the name of a check, followed by the name of the partner if there is one."""
    return f"{kit_check.name} with {partner}" if partner else kit_check.name
