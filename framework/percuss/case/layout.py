"""How a case is laid out in a file: each class is a mapping, each of its fields a key.

Validation, messages and the JSON schema are made from these classes and from nothing else.
"""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field

from percuss.case import defaults
from percuss.case.quantities import STATISTICS
from percuss.case.specs import ActsAs, Vector
from percuss.case.type_words import Expects
from percuss.methods.interfaces import ContactLaw, Doc, Ge, Gt, Integrator, Mass, Unit

__all__ = [
    "BodySection",
    "CaseSection",
    "ContactSection",
    "During",
    "Each",
    "ExpectSection",
    "Items",
    "LoadSection",
    "MethodSpec",
    "Named",
    "Part",
    "RecordSection",
    "TimeSpec",
]

_ADDRESS = Expects("an address, as short.right")
_ORIGIN = r"^(exact|paper|frozen on [0-9]{4}-[0-9]{2}-[0-9]{2})$"
_PERCENT = r"^([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)? ?%$"


def _dated(text: str) -> str:
    if text not in ("exact", "paper"):
        dt.date.fromisoformat(text.removeprefix("frozen on "))
    return text


def interval(times: tuple[float, float]) -> tuple[float, float]:
    """Return two times as they are; raise ValueError where they are no interval."""
    if not 0 <= times[0] < times[1]:
        raise ValueError("not an interval")
    return times


During = Annotated[
    tuple[float, float],
    AfterValidator(interval),
    Expects("two times of at least 0, the later one last"),
    Unit("time"),
    Doc("from when until when"),
]


def _vector(vector: Vector) -> Vector:
    if not any(vector):
        raise ValueError("the zero vector")
    return vector


@dataclass(frozen=True)
class Named:
    """Marks an entry that is a component: ``NAME`` or ``{name: NAME, option: ...}``; absent, `default`."""

    family: str
    default: str
    optional: bool = False


@dataclass(frozen=True)
class Part:
    """Marks an entry that is a section of its own."""

    section: type


@dataclass(frozen=True)
class Each:
    """Marks an entry that maps names to sections; with a `family`, one key of each is a component's name."""

    section: type
    what: str
    family: str = ""


@dataclass(frozen=True)
class Items:
    """Marks an entry that is a list of sections."""

    section: type


@dataclass(frozen=True)
class MethodSpec:
    """The methods of a run."""

    integrator: Annotated[
        Integrator,
        Named("integrators", defaults.INTEGRATOR),
        Doc("time integrator: a name, or {name: ...}"),
    ]
    contact: Annotated[ContactLaw, Named("contacts", defaults.CONTACT), Doc("contact law: a name, or {name: ...}")]
    mass: Annotated[Mass, Named("masses", defaults.MASS), Doc("how element masses become nodal masses")]


@dataclass(frozen=True)
class TimeSpec:
    """How long a run is and how it steps."""

    exactly_one: ClassVar = (("courant", "step"), ("end", "steps"))

    end: Annotated[float, Gt(0), Unit("time"), Doc("the last step reaches it or just passes it")] | None = None
    courant: (
        Annotated[float, Gt(0), Unit("1"), Doc("Courant number of the element with the smallest h/c, or auto")]
        | Literal["auto"]
        | None
    ) = None
    step: Annotated[float, Gt(0), Unit("time"), Doc("time step; instead of courant")] | None = None
    steps: Annotated[int, Ge(1), Unit("1"), Doc("number of steps; instead of end")] | None = None
    on_unstable: Annotated[
        Literal["stop", "warn"], Doc("what to do where the certificate says that the step is not stable")
    ] = "stop"

    def __post_init__(self) -> None:
        wrong = []
        for group in self.exactly_one:
            given = [one for one in group if getattr(self, one) is not None]
            if len(given) != 1:
                wrong.append(f"{'both' if given else 'neither'} of `{group[0]}` and `{group[1]}`")
        if wrong:
            raise ValueError(f"has {', and '.join(wrong)}: give exactly one{' of each' if len(wrong) > 1 else ''}")


@dataclass(frozen=True)
class BodySection:
    """A body; one more key is its shape, as ``bar: {length: 10, elements: 100}``."""

    material: Annotated[Any, Named("materials", defaults.MATERIAL), Doc("material: its options, or {name: ...}")]
    element: Annotated[Any, Named("elements", defaults.ELEMENT), Doc("element: a name, or {name: ...}")]
    area: Annotated[float, Gt(0), Unit("length^2"), Doc("cross-section")]
    at: Annotated[float | Vector, Unit("length"), Doc("where the body starts: a number along x, or a point")] = 0.0
    velocity: Annotated[
        float | Vector, Unit("length/time"), Doc("initial velocity: a number along the body, or a vector")
    ] = 0.0
    fixed: Annotated[tuple[str, ...], Expects("a list of ends, as [right]"), Doc("ends that do not move")] = ()


@dataclass(frozen=True)
class ContactSection:
    """A contact: ``between`` two ends, or of a ``body`` with a ``wall``."""

    method: Annotated[
        Any,
        Named("contacts", defaults.CONTACT, optional=True),
        Doc("contact law of this contact; else method.contact"),
    ]
    between: (
        Annotated[tuple[str, str], Expects("two ends, as [short.right, long.left]"), Doc("the two ends in contact")]
        | None
    ) = None
    body: Annotated[str, _ADDRESS, Doc("the end that meets the wall")] | None = None
    wall: (
        Annotated[float | Vector, Unit("length"), Doc("position of a rigid wall: a number along x, or a point")] | None
    ) = None

    def __post_init__(self) -> None:
        wall = self.body is not None and self.wall is not None
        if self.between is not None and (self.body is not None or self.wall is not None):
            raise ValueError("has both `between` and a wall: give `between`, or `body` and `wall`")
        if self.between is None and not wall:
            missing = "`wall`" if self.body is not None else "`body`" if self.wall is not None else "`between`"
            raise ValueError(f"has no {missing}: give `between: [END, END]`, or `body: END` and `wall: POSITION`")


@dataclass(frozen=True)
class LoadSection:
    """A load; one more key is its amplitude, as ``constant: 2``."""

    on: (
        Annotated[
            str | tuple[str, ...],
            Expects("an end or a body, as short.left, or a list of them"),
            Doc("where: an end, a body, or a list of them"),
        ]
        | None
    ) = None
    from_: Annotated[float, Unit("time"), Doc("when it is switched on; its amplitude counts from here")] | None = None
    until: Annotated[float, Unit("time"), Doc("when it is switched off")] | None = None
    direction: (
        Annotated[
            Vector,
            AfterValidator(_vector),
            Expects("a vector that is not zero, as [1, 0]"),
            Unit("1"),
            Doc("vector along which it acts; the body's direction by default"),
        ]
        | None
    ) = None
    as_: Annotated[ActsAs, Doc("what the amplitude is")] | None = None

    def __post_init__(self) -> None:
        if self.until is not None and self.from_ is not None and self.until <= self.from_:
            raise ValueError(f"ends before it begins: `until` {self.until:g} is not after `from` {self.from_:g}")


@dataclass(frozen=True)
class RecordSection:
    """What is recorded."""

    every: Annotated[int, Ge(1), Unit("1"), Doc("record every so many steps")] = 1
    probes: (
        Annotated[tuple[str, ...], Expects("a list of ends, as [short.right]"), Doc("ends whose motion is recorded")]
        | None
    ) = None
    fields: Annotated[
        int, Ge(0), Unit("1"), Doc("snapshots of stress along the bodies, for the space-time picture")
    ] = 0


@dataclass(frozen=True)
class ExpectSection:
    """An expected value: quantity, where and when, the value, its tolerance and where it is from."""

    exactly_one: ClassVar = (STATISTICS,)

    quantity: Annotated[str, Doc("a recorded quantity, or a dotted path into the summary")]
    within: Annotated[
        Annotated[float, Ge(0)] | Annotated[str, Field(pattern=_PERCENT)],
        Expects("a share as 1%, or a number of at least 0"),
        Doc("tolerance: a share of the value, as 1%, or a number"),
    ]
    source: Annotated[
        str,
        Field(pattern=_ORIGIN),
        AfterValidator(_dated),
        Expects("'exact', 'paper' or 'frozen on YYYY-MM-DD'"),
        Doc("where the value is from: exact, paper or frozen on YYYY-MM-DD"),
    ]
    contact: Annotated[str, Doc("which contact")] | None = None
    probe: Annotated[str, _ADDRESS, Doc("which end")] | None = None
    component: Annotated[int, Ge(0), Doc("component of a displacement or velocity")] = 0
    during: During | None = None
    at: Annotated[float, Ge(0), Unit("time"), Doc("time at which `value` holds")] | None = None
    mean: Annotated[float, Doc("expected mean")] | None = None
    max: Annotated[float, Doc("expected largest value")] | None = None
    min: Annotated[float, Doc("expected smallest value")] | None = None
    final: Annotated[float, Doc("expected last value")] | None = None
    integral: Annotated[float, Doc("expected integral over time")] | None = None
    value: Annotated[float, Doc("expected value, at the time `at` or of the run")] | None = None

    def __post_init__(self) -> None:
        given = [f"`{name}`" for name in STATISTICS if getattr(self, name) is not None]
        if len(given) != 1:
            what = f"has {' and '.join(given)}" if given else "expects no value"
            raise ValueError(f"{what}: give exactly one of {', '.join(STATISTICS)}")
        if self.during is not None and self.at is not None:
            raise ValueError("has both `during` and `at`: keep one")

    @property
    def tolerance(self) -> tuple[float, bool]:
        """How far off the value may be, and whether that is a share of it."""
        if isinstance(self.within, str):
            return float(self.within.removesuffix("%")) / 100.0, True
        return self.within, False

    @property
    def statistic(self) -> tuple[str, float]:
        """Which statistic is expected, and its value."""
        return next((name, getattr(self, name)) for name in STATISTICS if getattr(self, name) is not None)


@dataclass(frozen=True)
class CaseSection:
    """A case of percuss."""

    percuss: Annotated[Literal[1], Doc("version of the format: 1")]
    bodies: Annotated[Any, Each(BodySection, "body", "shapes"), Doc("the bodies, by name")]
    time: Annotated[Any, Part(TimeSpec), Doc("how long a run is and how it steps")]
    title: Annotated[str, Doc("one line that says what the case is")] = ""
    source: Annotated[str, Doc("where the case is from")] = ""
    plugins: Annotated[
        tuple[str, ...],
        Expects("a list of files, as [my_law.py]"),
        Doc("single-file plug-ins, relative to this file"),
    ] = ()
    contacts: Annotated[Any, Each(ContactSection, "contact"), Doc("the contacts, by name")] = ()
    loads: Annotated[Any, Each(LoadSection, "load", "loads"), Doc("the loads, by name")] = ()
    refine: Annotated[int, Ge(1), Unit("1"), Doc("multiplies every body's elements")] = 1
    method: Annotated[Any, Part(MethodSpec), Doc("the methods of a run")] = ()
    record: Annotated[Any, Part(RecordSection), Doc("what is recorded")] = ()
    expect: Annotated[Any, Items(ExpectSection), Doc("what a run is expected to give")] = ()
