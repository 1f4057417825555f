"""A case's plain data checked, part by part; every mistake is kept with its place, and reading goes on."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import MISSING
from typing import TYPE_CHECKING, Any, TypeVar, cast

from percuss.case.layout import (
    BodySection,
    CaseSection,
    ContactSection,
    Each,
    Items,
    LoadSection,
    MethodSpec,
    Named,
    Part,
    RecordSection,
    TimeSpec,
)
from percuss.case.options import Option, options_of, validate
from percuss.case.source import Source
from percuss.case.specs import Address, BodySpec, ContactSpec, LoadSpec, RecordSpec
from percuss.case.type_words import fact, found
from percuss.case.yaml_text import KeyPath, dotted
from percuss.errors import InputError, PluginError, Problem, suggestion
from percuss.methods.interfaces import NAME_PATTERN, Component, ContactLaw, Element, Load, Material, Shape

if TYPE_CHECKING:
    from percuss.methods.registry import Registry

__all__ = ["SINGULAR", "Reader"]

T = TypeVar("T")

SINGULAR = {
    "integrators": "integrator",
    "contacts": "contact law",
    "loads": "load",
    "shapes": "shape",
    "elements": "element",
    "materials": "material",
    "masses": "mass",
}


class Reader:
    """Reads one case. Each method returns what it made of its part, or None where that is wrong.

    Attributes
    ----------
    problems
        What is wrong so far, each with what sorts it.
    dimension
        Number of dimensions; known after `bodies`, `contacts` and `loads`.
    """

    def __init__(self, source: Source, registry: Registry) -> None:
        self.source, self.registry = source, registry
        self.problems: list[tuple[tuple[int, int, int], Problem]] = []
        self.vectors: list[tuple[KeyPath, int]] = []
        self.ends: dict[str, tuple[str, ...] | None] = {}
        self.contact_names: set[str] = set()

    def wrong(self, path: KeyPath, message: str, advice: str = "", *, key: bool = False) -> None:
        """Keep a mistake."""
        problem = self.source.problem(path, message, advice, key=key)
        self.problems.append((self.source.order(path, key=key), problem))

    def finish(self) -> None:
        """Raise InputError with all mistakes in the order of the file, if there are any."""
        if self.problems:
            # an anchor used twice would say the same thing twice
            ordered = sorted(self.problems, key=lambda one: one[0])
            raise InputError(dict.fromkeys(problem for _, problem in ordered))

    # ------------------------------------------------------------------------------------------ general

    def mapping(self, path: KeyPath, value: Any, what: str) -> Mapping[str, Any] | None:
        """Return a mapping as it is."""
        if isinstance(value, Mapping):
            return value
        self.wrong(path, f"expected {what}, found {found(value)}")
        return None

    def section(
        self, cls: type[T], path: KeyPath, given: Mapping[str, Any], kind: str, also: Iterable[str] = ()
    ) -> T | None:
        """Return a section of the file, its components made; what is a section in turn stays as it is."""

        def resolve(option: Option, value: Any) -> tuple[Any, bool] | None:
            named = fact(option.annotation, Named)
            if named is not None:
                if value is MISSING and named.optional:
                    return None, True
                component = self.component((*path, option.key), named, {} if value is MISSING else value)
                return component, component is not None
            inner = any(fact(option.annotation, cast("type[Any]", kind)) for kind in (Part, Each, Items))
            return (value, True) if inner and value is not MISSING else None

        made, faults = validate(cls, given, kind=kind, folder=self.source.folder, resolve=resolve, also=also)
        # where the name of a component may stand, a plug-in may be what would have known a key
        left_out = self._left_out() if also else []
        for one in faults:
            advice = " ".join([one.advice, *left_out]) if one.key else one.advice
            self.wrong((*path, *one.path), one.message, advice, key=one.key)
        return made

    def component(self, path: KeyPath, named: Named, value: Any) -> Component | None:
        """Return the component written as ``NAME`` or ``{name: NAME, ...}``."""
        at, options = path, {}
        if isinstance(value, Mapping):
            options = {key: item for key, item in value.items() if key != "name"}
            value = value.get("name", named.default)
            at = (*path, "name")
        if not isinstance(value, str):
            kind = SINGULAR.get(named.family, named.family)
            self.wrong(at, f"expected the name of a {kind}, found {found(value)}", self._known(named.family, ""))
            return None
        return self._make(at, path, named.family, value, options)

    def _known(self, family: str, name: str) -> str:
        """Return the advice for an unknown component, with the plug-ins that might have brought it."""
        return " ".join([suggestion(name, self.registry.names(family), "name"), *self._left_out()])

    def _left_out(self) -> list[str]:
        """Return, in words, the plug-ins that are not there."""
        said = [f"Plug-in that failed to load: {one.source}: {one.error}" for one in self.registry.broken]
        return [one if one.endswith("?") else f"{one}." for one in said]

    def _make(
        self,
        at: KeyPath,
        path: KeyPath,
        family: str,
        name: str,
        options: Mapping[str, Any],
        *,
        drop: str = "",
    ) -> Component | None:
        """Return the component `name` with its options, which stand at `path`."""
        kind = SINGULAR.get(family, family)
        try:
            cls = self.registry.get(family, name)
        except KeyError:
            self.wrong(at, f"unknown {kind} '{name}'", self._known(family, name))
            return None
        except PluginError as error:
            self.wrong(at, str(error))
            return None
        made, faults = validate(cls, options, kind=f"the {kind} {name}", folder=self.source.folder)
        for one in faults:
            # a shorthand's value stands where the mapping would
            inside = one.path[1:] if drop and one.path[:1] == (drop,) else one.path
            self.wrong((*path, *inside), one.message, one.advice, key=one.key and inside == one.path)
        return made

    def keyed(self, path: KeyPath, given: Mapping[str, Any], family: str, quiet: bool) -> tuple[str, Component | None]:
        """Return the one component whose name is a key of a section, and that name; else an empty one."""
        kind = "amplitude" if family == "loads" else SINGULAR.get(family, family)
        names = self.registry.names(family)
        keys = [key for key in given if key in names]
        if not keys:
            if not quiet:
                self.wrong(path, f"has no {kind}", f"Add one of: {', '.join(names)}.", key=True)
            return "", None
        if len(keys) > 1:
            self.wrong((*path, keys[1]), f"expected one {kind}, found {' and '.join(keys)}", "Keep one.", key=True)
            return "", None
        name, value = keys[0], given[keys[0]]
        at = (*path, name)
        shorthand = self.registry.get(family, name).shorthand
        if value is None and not shorthand:
            value = {}
        if isinstance(value, Mapping):
            return name, self._make(at, at, family, name, value)
        if shorthand:
            return name, self._make(at, at, family, name, {shorthand: value}, drop=shorthand)
        self.wrong(at, f"expected the options of {name}, found {found(value)}")
        return name, None

    def each(self, name: str) -> Iterable[tuple[str, KeyPath, Mapping[str, Any]]]:
        """Yield name, path and mapping of the bodies, contacts or loads."""
        entries = self.source.get((name,), {})
        kind = name.removesuffix("s") if name != "bodies" else "body"
        if not isinstance(entries, Mapping):
            self.wrong((name,), f"expected {name} by name, found {found(entries)}")
            return
        for key, value in entries.items():
            path = (name, key)
            if not NAME_PATTERN.fullmatch(key):
                advice = "A name is a letter, then letters, digits, _ or -."
                self.wrong(path, f"expected a name, found '{key}'", advice, key=True)
            given = self.mapping(path, value, f"a mapping that says what the {kind} is")
            if given is not None:
                yield key, path, given

    def _split(self, path: KeyPath, given: Mapping[str, Any], cls: type[T], kind: str) -> tuple[T | None, str, Any]:
        """Return section, name and component of a mapping whose one key is a component's name."""
        family = "shapes" if cls is BodySection else "loads"
        names = self.registry.names(family)
        rest = {key: value for key, value in given.items() if key not in names}
        section = self.section(cls, path, rest, kind, also=names)
        known = options_of(cls)
        unknown = any(key not in known for key in rest)
        name, component = self.keyed(path, given, family, quiet=unknown)
        return section, name, component

    def vector(self, path: KeyPath, value: Any) -> None:
        """Note a vector, whose length every other one must have."""
        if isinstance(value, tuple):
            if 1 <= len(value) <= 3:
                self.vectors.append((path, len(value)))
            else:
                self.wrong(path, f"expected 1, 2 or 3 components, found {len(value)}")

    def dimension(self) -> int:
        """Return the number of dimensions; vectors of another length than the first are wrong."""
        if not self.vectors:
            return 1
        first, size = self.vectors[0]
        for path, length in self.vectors[1:]:
            if length != size:
                where = f"{dotted(first)} ({self.source.place(first)})"
                self.wrong(
                    path,
                    f"implies {length} dimensions, and {where} implies {size}",
                    "All vectors of a case have one dimension.",
                )
        return size

    def address(self, path: KeyPath, text: str, *, end: bool = True) -> Address | None:
        """Return the end, or the body, that `text` names."""
        body, dot, region = text.partition(".")
        if body not in self.ends:
            self.wrong(path, f"there is no body '{body}'", suggestion(body, self.ends, "name"))
            return None
        ends = self.ends[body]
        if end and not dot:
            example = f"{body}.{ends[0]}" if ends else f"{body}.END"
            self.wrong(path, f"expected an end, found the whole body '{body}'", f"Write as '{example}'.")
            return None
        if dot and ends is not None and region not in ends:
            self.wrong(path, f"the body '{body}' has no end '{region}'", suggestion(region, ends, "end"))
            return None
        return Address(body, region)

    # -------------------------------------------------------------------------------------------- parts

    def case(self) -> CaseSection | None:
        """Return the top of the case, its parts as they are."""
        data = self.source.data
        if data is None:
            self.wrong((), "is empty", "Begin with `percuss: 1`.")
        elif not isinstance(data, Mapping):
            self.wrong((), f"expected a case, found {found(data)}", "Begin with `percuss: 1`.")
        elif "percuss-study" in data and "percuss" not in data:
            self.wrong(("percuss-study",), "is a study, not a case", "Run it with `percuss study`.", key=True)
        elif data.get("percuss", MISSING) is MISSING:
            self.wrong(("percuss",), "missing (version of the format)", "Begin with `percuss: 1`.", key=True)
        elif data["percuss"] != 1 or isinstance(data["percuss"], bool | float):
            message = f"expected version 1 of the format, found {found(data['percuss'])}"
            self.wrong(("percuss",), message, "This percuss reads version 1 only.")
        else:
            return self.section(CaseSection, (), data, "the case")
        self.finish()
        return None

    def bodies(self) -> dict[str, BodySpec]:
        """Return the bodies; `at` has as many numbers as there are dimensions only after `sized`."""
        made = {}
        for name, path, given in self.each("bodies"):
            section, shape_name, shape = self._split(path, given, BodySection, "the body")
            known = shape_name and getattr(self.registry.get("shapes", shape_name), "regions", None)
            self.ends[name] = known or None
            if isinstance(shape, Shape) and shape.dimension() is not None:
                self.vectors.append(((*path, shape_name), int(shape.dimension() or 0)))
            if section is None:
                continue
            self.vector((*path, "at"), section.at)
            self.vector((*path, "velocity"), section.velocity)
            self._fixed((*path, "fixed"), name, section.fixed)
            if isinstance(shape, Shape):
                at = section.at if isinstance(section.at, tuple) else (float(section.at),)
                made[name] = BodySpec(
                    name,
                    shape,
                    at,
                    cast("Material", section.material),
                    cast("Element", section.element),
                    section.area,
                    section.velocity,
                    section.fixed,
                )
        if self.source.get(("bodies",)) == {}:
            self.wrong(("bodies",), "a case has at least one body")
        return made

    def _fixed(self, path: KeyPath, body: str, fixed: tuple[str, ...]) -> None:
        ends = self.ends[body]
        for i, end in enumerate(fixed):
            if ends is not None and end not in ends:
                self.wrong((*path, i), f"the body '{body}' has no end '{end}'", suggestion(end, ends, "end"))
            elif end in fixed[:i]:
                self.wrong((*path, i), f"the end '{end}' is fixed twice", "Keep one.")

    def contacts(self, law: ContactLaw | None) -> dict[str, ContactSpec]:
        """Return the contacts; one without a method of its own has the `law` of the method."""
        made: dict[str, ContactSpec] = {}
        pairs: dict[Any, str] = {}
        for name, path, given in self.each("contacts"):
            self.contact_names.add(name)
            section = self.section(ContactSection, path, given, "the contact")
            if section is None:
                continue
            self.vector((*path, "wall"), section.wall)
            texts = section.between or (section.body or "",)
            places: list[KeyPath] = (
                [(*path, "between", 0), (*path, "between", 1)] if section.between else [(*path, "body")]
            )
            sides = [self.address(place, text) for place, text in zip(places, texts, strict=True)]
            ends = tuple(side for side in sides if side is not None)
            if len(ends) != len(texts):
                continue
            if len(set(ends)) != len(ends):
                self.wrong(places[1], f"the end {ends[1]} is in contact with itself", "Name two ends.")
                continue
            pair = (frozenset(ends), section.wall)
            if pair in pairs:
                same = "ends" if section.between is not None else "end and wall"
                message = f"the contact '{pairs[pair]}' has the same {same}"
                self.wrong(path, message, "Keep one of them.", key=True)
                continue
            pairs[pair] = name
            own = section.method is not None
            chosen = section.method if own else law
            if chosen is not None:
                made[name] = ContactSpec(name, ends, section.wall, chosen, own)
        return made

    def loads(self, bodies: Mapping[str, BodySpec]) -> dict[str, LoadSpec]:
        """Return the loads."""
        made = {}
        for name, path, given in self.each("loads"):
            section, key, load = self._split(path, given, LoadSection, "the load")
            if section is None or not isinstance(load, Load):
                continue
            acts_as = section.as_ or load.acts_as
            texts = (section.on,) if isinstance(section.on, str) else (section.on or ())
            places = [(*path, "on")] if isinstance(section.on, str) else [(*path, "on", i) for i in range(len(texts))]
            on = [self.address(place, one, end=acts_as == "velocity") for place, one in zip(places, texts, strict=True)]
            for i, one in enumerate(on):
                if one is not None and one in on[:i]:
                    self.wrong(places[i], f"{one} is named twice", "Keep one.")
                elif one is not None and acts_as == "velocity":
                    self._free(places[i], one, bodies)
            if not texts and (not load.everywhere or acts_as == "velocity"):
                what = "an end" if acts_as == "velocity" else "an end or a body"
                self.wrong((*path, "on"), "missing (where the load acts)", f"Add `on:` with {what}.", key=True)
            direction = self._direction(path, key, section, load)
            start = -math.inf if section.from_ is None else section.from_
            stop = math.inf if section.until is None else section.until
            places_on = tuple(one for one in on if one is not None)
            made[name] = LoadSpec(name, load, places_on, acts_as, direction, start, stop)
        return made

    def _free(self, path: KeyPath, end: Address, bodies: Mapping[str, BodySpec]) -> None:
        if end.body in bodies and end.region in bodies[end.body].fixed:
            self.wrong(path, f"{end} is fixed and cannot have a velocity", f"Take it out of bodies.{end.body}.fixed.")

    def _direction(self, path: KeyPath, key: str, section: LoadSection, load: Load) -> tuple[float, ...] | None:
        """Return the direction of the case, else that of the load; None leaves it to the body."""
        own = load.vector()
        if own is not None and len(own) > 1:
            self.vector((*path, key), own)
            if section.direction is not None:
                self.wrong((*path, "direction"), f"{key} is a vector already", "Keep one.", key=True)
        self.vector((*path, "direction"), section.direction)
        chosen = section.direction or own
        return chosen if chosen is not None and any(chosen) else None

    def record(self) -> RecordSpec | None:
        """Return what is recorded."""
        given = self.mapping(("record",), self.source.get(("record",), {}), "a mapping as {every: 1}")
        section = self.section(RecordSection, ("record",), given, "record") if given is not None else None
        if section is None:
            return None
        if section.probes is None:
            return RecordSpec(section.every, None, section.fields)
        probes = [self.address(("record", "probes", i), text) for i, text in enumerate(section.probes)]
        for i, one in enumerate(probes):
            if one is not None and one in probes[:i]:
                self.wrong(("record", "probes", i), f"{one} is named twice", "Keep one.")
        return RecordSpec(section.every, tuple(one for one in probes if one is not None), section.fields)

    def method(self) -> MethodSpec | None:
        """Return the methods."""
        given = self.mapping(("method",), self.source.get(("method",), {}), "a mapping as {contact: lagrange}")
        return self.section(MethodSpec, ("method",), given, "method") if given is not None else None

    def time(self) -> TimeSpec | None:
        """Return how long the run is and how it steps."""
        value = self.source.get(("time",), MISSING)
        if value is MISSING:
            return None
        given = self.mapping(("time",), value, "a mapping as {end: 1, courant: 0.5}")
        return self.section(TimeSpec, ("time",), given, "time") if given is not None else None
