"""Sections of a case: each class is a mapping of the file, and each of its fields a key.

Validation, messages and the JSON schema are made from these classes and from nothing else. The rest of percuss works
with the checked instances.
"""

from __future__ import annotations

import datetime as dt
import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field, WithJsonSchema, WrapValidator

from percuss.case.options import Computed, Key
from percuss.case.quantities import MEASURABLE, QUANTITIES, STATISTICS, SUMMARY, Quantity, name_schema
from percuss.case.type_words import Expects
from percuss.case.validation import NO_KEY, EmptyIfAbsent, Keyed, Mistake, Named, Section, failure
from percuss.case.yaml_text import KeyPath
from percuss.errors import suggestion
from percuss.methods.interfaces import (
    NAME_PATTERN,
    ContactLaw,
    Doc,
    Element,
    Friction,
    Ge,
    Gt,
    Integrator,
    Load,
    Lt,
    Mass,
    Material,
    Pairing,
    Shape,
    Solution,
    Unit,
)

Vector = tuple[float, ...]
ActsAs = Literal["force", "acceleration", "velocity", "pressure", "traction"]

# Value of a field that follows from the rest of the case, until the whole case is checked.
UNSET: Any = None

_ORIGIN = r"^(exact|converged|paper|frozen on [0-9]{4}-[0-9]{2}-[0-9]{2})$"
_PERCENT = r"^([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)? ?%$"


@dataclass(frozen=True)
class Address:
    """A body, or one end of it: ``BODY`` or ``BODY.REGION``; `region` is empty for the whole body."""

    body: str
    region: str = ""

    def __str__(self) -> str:
        return f"{self.body}.{self.region}" if self.region else self.body

    @classmethod
    def parse(cls, text: str) -> Address:
        """Return the address that a text is."""
        body, _, region = text.partition(".")
        return cls(body, region)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        return handler.generate_schema(Annotated[str, AfterValidator(cls.parse)])


def _valid_date(origin: str) -> str:
    if not origin.isalpha():
        dt.date.fromisoformat(origin.removeprefix("frozen on "))
    return origin


def _increasing(times: tuple[float, float]) -> tuple[float, float]:
    if not 0 <= times[0] < times[1]:
        raise ValueError("not an interval")
    return times


def _nonzero(vector: Vector) -> Vector:
    if not any(vector):
        raise ValueError("the zero vector")
    return vector


def _null_is(default: float) -> WrapValidator:
    """Return a validator by which null is the default, as if the key were absent."""
    return WrapValidator(lambda value, check: default if value is None else check(value))


def quantity_named(name: str) -> Quantity:
    """Return the quantity of a name; a dotted path into the summary is one number of the run."""
    return MEASURABLE.get(name) or Quantity(label=name)


def _existing_quantity(name: str) -> str:
    head, dot, _ = name.partition(".")
    if name not in MEASURABLE and head not in SUMMARY:
        names = list(SUMMARY if dot else dict.fromkeys([*MEASURABLE, *SUMMARY]))
        raise failure(Mistake((), f"unknown quantity '{name}'", suggestion(head, names, "name")))
    return name


def _quantity_schema() -> dict[str, Any]:
    """Return the JSON schema of a quantity that a run may be expected to give."""
    numbers = {quantity.path: quantity.label for quantity in QUANTITIES.values() if "*" not in quantity.path}
    labels = {name: quantity.label for name, quantity in MEASURABLE.items()} | numbers
    return name_schema({name: label for name, label in labels.items() if name})


Name = Annotated[str, Field(pattern=f"^{NAME_PATTERN.pattern}$")]
UnitName = Annotated[str, Field(pattern=r"^[^\s\[\]]{1,20}$"), Expects("the name of a unit, as mm")]
AnAddress = Annotated[Address, Expects("an address, as short.right")]
During = Annotated[
    tuple[float, float],
    AfterValidator(_increasing),
    Expects("two times of at least 0, the later one last"),
    Unit("time"),
    Doc("from when until when"),
]


@dataclass(frozen=True)
class MethodSpec(Section):
    """The methods of a run."""

    kind: ClassVar[str] = "method"

    integrator: Annotated[Integrator, Named("integrators"), Doc("time integrator: a name, or {name: ...}")]
    contact: Annotated[ContactLaw, Named("contacts"), Doc("contact law: a name, or {name: ...}")]
    mass: Annotated[Mass, Named("masses"), Doc("how element masses become nodal masses")]
    pairing: Annotated[
        Pairing | None, Named("pairings"), Doc("how surfaces of bodies that are no bars make contact points")
    ] = None
    friction: Annotated[
        Friction | None,
        Named("frictions"),
        Doc("friction between surfaces of bodies that are no bars"),
    ] = None
    solution: Annotated[
        Solution | None,
        Named("solutions"),
        Doc("exact solution that judges the run; by default the first that covers it"),
    ] = None


@dataclass(frozen=True)
class TimeSpec(Section):
    """Length of a run and its step."""

    kind: ClassVar[str] = "time"
    exactly_one: ClassVar = (("courant", "step"), ("end", "steps"))

    end: Annotated[float, Gt(0), Unit("time"), Doc("the last step reaches it or just passes it")] | None = None
    courant: (
        Annotated[float, Gt(0), Unit("1"), Doc("dt over 2/omega, omega the highest frequency of an element, or auto")]
        | Literal["auto"]
        | None
    ) = None
    stretch: (
        Annotated[
            float,
            Ge(1),
            Unit("1"),
            Doc("with auto and finite strain, times by which frequencies may rise over those at the start; else 2"),
        ]
        | None
    ) = None
    step: Annotated[float, Gt(0), Unit("time"), Doc("time step; instead of courant")] | None = None
    steps: Annotated[int, Ge(1), Unit("1"), Doc("number of steps; instead of end")] | None = None
    on_unstable: Annotated[
        Literal["stop", "warn"], Doc("what to do where the certificate says that the step is not stable")
    ] = "stop"

    def __post_init__(self) -> None:
        wrong, both = [], []
        for group in self.exactly_one:
            given = [key for key in group if getattr(self, key) is not None]
            both += given[:1] if len(given) > 1 else []
            if len(given) != 1:
                wrong.append(f"{'both' if given else 'neither'} of `{group[0]}` and `{group[1]}`")
        if self.stretch is not None and self.courant != "auto":
            raise ValueError("has a `stretch`, which belongs to `courant: auto`: remove it")
        if wrong:
            message = f"has {', and '.join(wrong)}: give exactly one{' of each' if len(wrong) > 1 else ''}"
            advice = f"Remove one, or unset it on the command line: `--set time.{both[0]}=null`." if both else ""
            raise failure(Mistake((), message, advice, key=True))

    @property
    def known_end(self) -> float | None:
        """End of the run, or None where its step follows from the model alone."""
        if self.steps is not None and self.step is not None:
            return self.steps * self.step
        return self.end


@dataclass(frozen=True)
class Roller(Section):
    """A support in one direction: ``{on: REGION, along: x}``."""

    kind: ClassVar[str] = "the support"

    region: Annotated[str, Key("on"), Doc("region of the boundary")]
    along: Annotated[Literal["x", "y", "z"], Doc("axis along which it does not move")]

    @property
    def axis(self) -> int:
        """Number of the axis along which the region does not move."""
        return "xyz".index(self.along)

    def __str__(self) -> str:
        return f"{self.region} along {self.along}"


@dataclass(frozen=True)
class DampingSpec(Section):
    """The damping of a body: ``{mass: 0.05}``."""

    kind: ClassVar[str] = "the damping"

    mass: Annotated[float, Ge(0), Unit("1/time"), Doc("force on each node against its velocity, over its momentum")]


@dataclass(frozen=True)
class BodySpec(Section):
    """A body; one key is the name of its shape, as ``bar: {length: 10, elements: 100}``.

    `start` is as given, `at` has one number for each dimension of the case.
    """

    kind: ClassVar[str] = "the body"

    material: Annotated[Material, Named("materials"), Doc("material: its options, or {name: ...}")]
    element: Annotated[Element, Named("elements"), Doc("element: a name, or {name: ...}")]
    shape: Annotated[Shape, Keyed("shapes", "shape"), Key(NO_KEY)]
    area: Annotated[float, Gt(0), Unit("length^2"), Doc("cross-section of a body along a line")] | None = None
    thickness: (
        Annotated[float, Gt(0), Unit("length"), Doc("thickness of a body of two dimensions; 1 by default")] | None
    ) = None
    start: Annotated[
        float | Vector, Key("at"), Unit("length"), Doc("where the body starts: a number along x, or a point")
    ] = 0.0
    velocity: Annotated[
        float | Vector, Unit("length/time"), Doc("initial velocity: a number along the body, or a vector")
    ] = 0.0
    angle: Annotated[float, Unit("degrees"), Doc("by which the mesh is turned about its middle")] = 0.0
    axis: (
        Annotated[
            Vector,
            AfterValidator(_nonzero),
            Expects("a vector that is not zero, as [0, 0, 1]"),
            Unit("1"),
            Doc("vector about which the mesh is turned, in three dimensions"),
        ]
        | None
    ) = None
    spin: Annotated[
        float | Vector,
        Unit("1/time"),
        Doc("initial angular velocity about the centre of mass: a number in two dimensions, else a vector"),
    ] = 0.0
    locking: Annotated[Literal["accepted"], Doc("whether triangles and tetrahedra may lock where they flow")] | None = (
        None
    )
    damping: (
        Annotated[
            DampingSpec,
            Expects("a mapping as {mass: 0.05}"),
            Doc("damping in proportion to the mass, of nodes that nothing holds or drives"),
        ]
        | None
    ) = None
    fixed: Annotated[
        tuple[Annotated[str | Roller, Expects("an end, or a mapping as {on: right, along: x}")], ...],
        Expects("a list of ends, as [right]"),
        Doc("ends that do not move, or do not move along an axis, as {on: right, along: x}"),
    ] = ()
    plane: (
        Annotated[
            Literal["strain", "stress", "axisymmetric"],
            Doc("plane strain, plane stress, or a body of revolution about the axis x = 0, in two dimensions"),
        ]
        | None
    ) = None
    name: Annotated[str, Computed()] = UNSET
    at: Annotated[Vector, Computed()] = UNSET

    @property
    def supports(self) -> tuple[tuple[str, int | None], ...]:
        """The regions that are held, each with the axis along which it is, None in all directions."""
        return tuple((one, None) if isinstance(one, str) else (one.region, one.axis) for one in self.fixed)

    def plane_of(self, dimension: int) -> str:
        """Return the plane of a body in two dimensions that is along no line, else nothing."""
        return (self.plane or "strain") if self.shape.cell != "line" and dimension == 2 else ""

    @property
    def section(self) -> float:
        """What a unit of length of a line, or of area in two dimensions, has as volume: `BodyMesh.section`."""
        return self.area or self.thickness or 1.0


Radius = Annotated[float, Gt(0), Unit("length"), Doc("its radius")]
Normal = Annotated[Vector, AfterValidator(_nonzero), Expects("a vector that is not zero, as [0, 1]"), Unit("1")]


@dataclass(frozen=True)
class Ball(Section):
    """A circle, or a sphere: ``{centre: [0, -2], radius: 2}``."""

    kind: ClassVar[str] = "the wall"

    centre: Annotated[Vector, Unit("length"), Doc("its middle")]
    radius: Radius


@dataclass(frozen=True)
class Cylinder(Section):
    """A cylinder without ends: ``{point: [0, 0, 0], axis: [1, 0, 0], radius: 2}``."""

    kind: ClassVar[str] = "the wall"

    point: Annotated[Vector, Unit("length"), Doc("a point of its axis")]
    axis: Annotated[Normal, Doc("vector along its axis")]
    radius: Radius


@dataclass(frozen=True)
class RigidWall(Section):
    """A rigid wall: ``{point: [0, 0], normal: [0, 1]}``, or ``{circle: {centre: [0, -2], radius: 2}}`` and its like."""

    kind: ClassVar[str] = "the wall"

    point: Annotated[Vector, Unit("length"), Doc("a point of a plane")] | None = None
    normal: Annotated[Normal, Doc("vector out of a plane, to the side where the body is")] | None = None
    circle: Annotated[Ball, Expects("a mapping as {centre: [0, -2], radius: 2}"), Doc("in two dimensions")] | None = (
        None
    )
    sphere: (
        Annotated[
            Ball,
            Expects("a mapping as {centre: [0, 0, -2], radius: 2}"),
            Doc("in three dimensions, or centred on the axis of a body of revolution"),
        ]
        | None
    ) = None
    cylinder: (
        Annotated[
            Cylinder,
            Expects("a mapping as {point: [0, 0, 0], axis: [1, 0, 0], radius: 2}"),
            Doc("in three dimensions"),
        ]
        | None
    ) = None
    inside: Annotated[bool, Doc("whether the body is inside of a round wall")] = False
    moving: Annotated[str, Doc("name of a load of prescribed velocity, with which the wall moves")] | None = None

    def __post_init__(self) -> None:
        shapes = [name for name in ROUND if getattr(self, name) is not None]
        plane = [name for name in ("point", "normal") if getattr(self, name) is not None]
        if len(shapes) + bool(plane) != 1:
            raise ValueError("is no wall: give `point` and `normal`, or one of `circle`, `sphere` and `cylinder`")
        if len(plane) == 1:
            (missing,) = {"point", "normal"}.difference(plane)
            message = "missing (a plane has a point and a normal)"
            raise failure(Mistake((missing,), message, f"Add `{missing}:`.", key=True))
        if plane and self.inside:
            raise ValueError("is a plane, which has no inside: turn its `normal`")

    @property
    def shape(self) -> str:
        """What it is: a plane, circle, sphere or cylinder."""
        return next((name for name in ROUND if getattr(self, name) is not None), "plane")

    @property
    def stays(self) -> bool:
        """Whether it is a plane at rest, whose normal and place are those of the start."""
        return self.shape == "plane" and self.moving is None


ROUND = ("circle", "sphere", "cylinder")


@dataclass(frozen=True)
class ContactSpec(Section):
    """A contact: ``between`` two ends, or of a ``body`` with a rigid ``wall``.

    `law` is the contact's own law `method`, else that of the section `method`.
    """

    kind: ClassVar[str] = "the contact"

    method: Annotated[
        ContactLaw | None,
        Named("contacts"),
        Doc("contact law of this contact; else method.contact"),
    ] = None
    pairing: Annotated[Pairing | None, Named("pairings"), Doc("pairing of this contact; else method.pairing")] = None
    friction: Annotated[Friction | None, Named("frictions"), Doc("friction of this contact; else method.friction")] = (
        None
    )
    sliding: (
        Annotated[
            Literal["small", "large"],
            Doc(
                "small: normals and partners are those of the start; large: the points find them anew in each step; by "
                "default large where a body is of finite strain"
            ),
        ]
        | None
    ) = None
    overlap: Annotated[
        Literal["refuse", "keep", "press"],
        Doc(
            "of surfaces that slide, where they overlap at the start: refuse it, keep it as an offset, or let it press"
        ),
    ] = "refuse"
    between: (
        Annotated[
            tuple[AnAddress, AnAddress],
            Expects("two ends, as [short.right, long.left]"),
            Doc("the two ends in contact"),
        ]
        | None
    ) = None
    body: Annotated[AnAddress, Doc("the end that meets the wall")] | None = None
    wall: (
        Annotated[
            float | Vector | RigidWall,
            Expects("a number, a point as [0, 1], or a mapping as {point: [0, 1], normal: [0, 1]}"),
            Unit("length"),
            Doc("rigid wall: its place along x, a point of it, or {point: ..., normal: ...}, {circle: ...}, ..."),
        ]
        | None
    ) = None
    name: Annotated[str, Computed()] = UNSET
    law: Annotated[ContactLaw, Computed()] = UNSET

    def __post_init__(self) -> None:
        wall = self.body is not None and self.wall is not None
        if self.between is not None and (self.body is not None or self.wall is not None):
            raise ValueError("has both `between` and a wall: give `between`, or `body` and `wall`")
        if self.between is None and not wall:
            missing = "`wall`" if self.body is not None else "`body`" if self.wall is not None else "`between`"
            raise ValueError(f"has no {missing}: give `between: [END, END]`, or `body: END` and `wall: POSITION`")

    @property
    def sides(self) -> tuple[Address, ...]:
        """The two ends in contact, or the one that meets the wall."""
        return self.between or ((self.body,) if self.body is not None else ())

    @property
    def own_law(self) -> bool:
        """Whether the contact has a law of its own."""
        return self.method is not None


@dataclass(frozen=True)
class LoadSpec(Section):
    """A load; one key is the name of its amplitude, as ``constant: 2``. It acts for ``start <= t < stop``.

    `along` is the direction as given, `direction` has one number for each dimension of the case, is not of unit length,
    and None means the direction of the body.
    """

    kind: ClassVar[str] = "the load"

    load: Annotated[Load, Keyed("loads", "amplitude"), Key(NO_KEY)]
    places: (
        Annotated[
            AnAddress | tuple[AnAddress, ...],
            Key("on"),
            Expects("an end or a body, as short.left, or a list of them"),
            Doc("where: an end, a body, or a list of them"),
        ]
        | None
    ) = None
    start: Annotated[
        float,
        Key("from"),
        _null_is(-math.inf),
        Unit("time"),
        Doc("when it is switched on; its amplitude counts from here"),
    ] = -math.inf
    stop: Annotated[float, Key("until"), _null_is(math.inf), Unit("time"), Doc("when it is switched off")] = math.inf
    along: (
        Annotated[
            Vector,
            Key("direction"),
            AfterValidator(_nonzero),
            Expects("a vector that is not zero, as [1, 0]"),
            Unit("1"),
            Doc("vector along which it acts; the body's direction by default"),
        ]
        | None
    ) = None
    axis: Annotated[Literal["x", "y", "z"], Key("along"), Doc("axis along which it acts")] | None = None
    quantity: Annotated[ActsAs, Key("as"), Doc("what the amplitude is")] | None = None
    follows: Annotated[bool, Doc("whether a pressure acts on the facets as they are in each step")] = False
    name: Annotated[str, Computed()] = UNSET
    direction: Annotated[Vector | None, Computed()] = None

    def __post_init__(self) -> None:
        if self.axis is not None and self.along is not None:
            raise ValueError("has both `along` and `direction`: give one")
        if self.stop <= self.start:
            raise ValueError(f"ends before it begins: `until` {self.stop:g} is not after `from` {self.start:g}")

    @property
    def on(self) -> tuple[Address, ...]:
        """Bodies or ends; empty means every body."""
        return (self.places,) if isinstance(self.places, Address) else self.places or ()

    @property
    def given_direction(self) -> Vector | None:
        """The direction that the case gives, as a vector or along an axis."""
        return self.along or ((0.0,) * "xyz".index(self.axis) + (1.0,) if self.axis is not None else None)

    @property
    def acts_as(self) -> ActsAs:
        """Quantity of the amplitude."""
        return self.quantity or self.load.acts_as


@dataclass(frozen=True)
class Spot(Section):
    """A point of a body: ``{body: left, at: [0.5, 0.1]}``."""

    kind: ClassVar[str] = "the probe"

    body: Annotated[str, Doc("name of the body")]
    at: Annotated[Vector, Unit("length"), Doc("the point, where it is at the start")]

    @property
    def region(self) -> str:
        """No region of the boundary."""
        return ""

    def __str__(self) -> str:
        return f"{self.body}@{','.join(f'{x:g}' for x in self.at)}"


@dataclass(frozen=True)
class RecordSpec(Section):
    """Quantities that a run records; by default the probes are all ends in contact."""

    kind: ClassVar[str] = "record"

    every: Annotated[int, Ge(1), Unit("1"), Doc("number of steps from one record to the next")] = 1
    probes: (
        Annotated[
            tuple[Annotated[AnAddress | Spot, Expects("an end, or a mapping as {body: short, at: [0.5, 0]}")], ...],
            Expects("a list of ends, as [short.right]"),
            Doc("ends whose motion is recorded, or points, as {body: short, at: [0.5, 0]}"),
        ]
        | None
    ) = None
    fields: Annotated[
        int,
        Ge(0),
        Unit("1"),
        Doc("snapshots for the picture: of stress along bars; of motion, stress and contact pressure of other bodies"),
    ] = 0
    pressure: Annotated[bool, Doc("whether snapshots have the contact pressure of each point, except of bars")] = True


@dataclass(frozen=True)
class Expectation(Section):
    """An expected value of a run: quantity, owner and time, the value, its tolerance and its source.

    `path` is the place of the expectation in the case.
    """

    kind: ClassVar[str] = "the expectation"
    exactly_one: ClassVar = (STATISTICS,)

    quantity: Annotated[
        str,
        AfterValidator(_existing_quantity),
        WithJsonSchema(_quantity_schema()),
        Doc("a recorded quantity, or a dotted path into the summary"),
    ]
    tolerance: Annotated[
        Annotated[float, Ge(0)] | Annotated[str, Field(pattern=_PERCENT)],
        Key("within"),
        Expects("a share as 1%, or a number of at least 0"),
        Doc("tolerance: a share of the value, as 1%, or a number"),
    ]
    source: Annotated[
        str,
        Field(pattern=_ORIGIN),
        AfterValidator(_valid_date),
        Expects("'exact', 'converged', 'paper' or 'frozen on YYYY-MM-DD'"),
        Doc("where the value is from: exact, converged, paper or frozen on YYYY-MM-DD"),
    ]
    contact: Annotated[str, Doc("which contact")] | None = None
    probe: Annotated[AnAddress, Doc("which end")] | None = None
    support: Annotated[str, Doc("which support or prescribed motion, as short.left")] | None = None
    component: Annotated[int, Ge(0), Doc("component of a displacement, a velocity or the force of a support")] = 0
    during: During | None = None
    at: Annotated[float, Ge(0), Unit("time"), Doc("time at which `value` holds")] | None = None
    mean: Annotated[float, Doc("expected mean")] | None = None
    max: Annotated[float, Doc("expected largest value")] | None = None
    min: Annotated[float, Doc("expected smallest value")] | None = None
    final: Annotated[float, Doc("expected last value")] | None = None
    integral: Annotated[float, Doc("expected integral over time")] | None = None
    single: Annotated[float, Key("value"), Doc("expected value, at the time `at` or of the run")] | None = None
    path: Annotated[KeyPath, Computed()] = ()

    def __post_init__(self) -> None:
        given = [f"`{statistic}`" for statistic in self._values]
        if len(given) != 1:
            state = f"has {' and '.join(given)}" if given else "expects no value"
            raise ValueError(f"{state}: give exactly one of {', '.join(STATISTICS)}")

    @cached_property
    def _values(self) -> dict[str, float]:
        """The given values by statistic."""
        values = {name: self.single if name == "value" else getattr(self, name) for name in STATISTICS}
        return {name: value for name, value in values.items() if value is not None}

    @property
    def statistic(self) -> str:
        """Statistic of the history: mean, max, min, final, integral or value."""
        return next(iter(self._values))

    @property
    def value(self) -> float:
        """Expected value."""
        return self._values[self.statistic]

    @property
    def relative(self) -> bool:
        """Whether the tolerance is a share of the value."""
        return isinstance(self.tolerance, str)

    @property
    def within(self) -> float:
        """Tolerance, as a share of the value where `relative`."""
        return float(self.tolerance.removesuffix("%")) / 100.0 if isinstance(self.tolerance, str) else self.tolerance

    @property
    def allowed(self) -> float:
        """Largest difference from the value that is allowed, in the unit of the quantity."""
        return self.within * abs(self.value) if self.relative else self.within


@dataclass(frozen=True)
class MeasureSection(Section):
    """A number taken from each run: a quantity, its contact, probe or support, the time, and the statistic."""

    kind: ClassVar[str] = "the measure"

    name: Annotated[str, Doc("name of the column")]
    quantity: Annotated[str, Doc("a recorded quantity, or a dotted path into the summary")]
    statistic: Annotated[
        Literal["mean", "max", "min", "final", "integral", "value"], Key("take"), Doc("what is made of a history")
    ] = "value"
    contact: Annotated[str, Doc("which contact")] | None = None
    probe: Annotated[AnAddress, Doc("which end")] | None = None
    support: Annotated[str, Doc("which support or prescribed motion, as short.left")] | None = None
    component: Annotated[int, Ge(0), Doc("component of a displacement, a velocity or the force of a support")] = 0
    during: During | None = None
    at: Annotated[float, Ge(0), Unit("time"), Doc("time at which `take: value` is read")] | None = None


@dataclass(frozen=True)
class UnitsSpec(Section):
    """Names of the units of a case: labels of axes and tables that nothing checks."""

    kind: ClassVar[str] = "units"

    length: Annotated[UnitName, Doc("name of the unit of length, as m")] = ""
    mass: Annotated[UnitName, Doc("name of the unit of mass, as kg")] = ""
    time: Annotated[UnitName, Doc("name of the unit of time, as s")] = ""
    force: Annotated[UnitName, Doc("name of the unit of force, as N")] = ""
    energy: Annotated[UnitName, Doc("name of the unit of energy, as J; force times length by default")] = ""
    stress: Annotated[UnitName, Doc("name of the unit of stress, as Pa; force over area by default")] = ""


@dataclass(frozen=True)
class SecondReferenceSpec(Section):
    """A second finer run, with another law or pairing: ``{pairing: node-to-segment}``."""

    kind: ClassVar[str] = "the second finer run"

    contact: Annotated[ContactLaw | None, Named("contacts"), Doc("its contact law, else that of the first")] = None
    pairing: Annotated[Pairing | None, Named("pairings"), Doc("its pairing, else that of the first")] = None


@dataclass(frozen=True)
class ReferenceSpec(Section):
    """A finer run of the case, which judges a run where no exact solution covers it: ``{refine: 4}``.

    It has the mesh, step, law and pairing named here, else a law without compliance, and the integrator and mass by
    default. So one and the same finer run judges all runs that differ in methods, mesh or step alone. A contact with a
    law of its own keeps it. A second finer run shows how far the judgement depends on law and pairing of the first.
    """

    kind: ClassVar[str] = "the reference"

    refine: Annotated[float, Gt(0), Lt(1e18), Unit("1"), Doc("value of `refine` of the finer run")]
    courant: Annotated[float, Gt(0), Unit("1"), Doc("its Courant number")] = 0.5
    contact: Annotated[ContactLaw | None, Named("contacts"), Doc("its contact law")] = None
    pairing: Annotated[Pairing | None, Named("pairings"), Doc("its pairing")] = None
    second: (
        Annotated[
            SecondReferenceSpec,
            Expects("a mapping as {pairing: node-to-segment}"),
            Doc("second finer run, of another law or pairing; comparisons and studies of several make one"),
        ]
        | None
    ) = None


@dataclass(frozen=True)
class CaseSection(Section):
    """A case of percuss."""

    kind: ClassVar[str] = "the case"

    percuss: Annotated[Literal[1], Doc("version of the format: 1")]
    bodies: Annotated[
        dict[Name, Annotated[BodySpec, Expects("a mapping that says what the body is")]],
        Field(min_length=1),
        Expects("at least one body by name"),
        Doc("the bodies, by name"),
    ]
    time: Annotated[TimeSpec, Expects("a mapping as {end: 1, courant: 0.5}"), Doc("how long a run is and how it steps")]
    method: Annotated[
        MethodSpec, Expects("a mapping as {contact: lagrange}"), EmptyIfAbsent(), Doc("the methods of a run")
    ]
    record: Annotated[RecordSpec, Expects("a mapping as {every: 1}"), EmptyIfAbsent(), Doc("what is recorded")]
    units: Annotated[
        UnitsSpec,
        Expects("a mapping as {length: m, force: N}"),
        EmptyIfAbsent(),
        Doc("names of the units, for axes and tables; nothing is checked or converted"),
    ]
    title: Annotated[str, Doc("one line that says what the case is")] = ""
    source: Annotated[str, Doc("where the case is from")] = ""
    plugins: Annotated[
        tuple[str, ...],
        Expects("a list of files, as [my_law.py]"),
        Doc("single-file plug-ins, relative to this file: code that each command executes"),
    ] = ()
    contacts: Annotated[
        dict[Name, Annotated[ContactSpec, Expects("a mapping that says what the contact is")]],
        Expects("contacts by name"),
        Doc("the contacts, by name"),
    ] = field(default_factory=dict)
    loads: Annotated[
        dict[Name, Annotated[LoadSpec, Expects("a mapping that says what the load is")]],
        Expects("loads by name"),
        Doc("the loads, by name"),
    ] = field(default_factory=dict)
    refine: Annotated[
        Annotated[int, Ge(1)] | Annotated[float, Gt(0), Lt(1e18)],
        Unit("1"),
        Expects("a number greater than 0 and less than 1e18", "Above 1 it refines, below 1 it coarsens."),
        Doc("multiplies every body's elements, to the nearest whole number; below 1 it coarsens, down to one element"),
    ] = 1
    reference: (
        Annotated[
            ReferenceSpec,
            Expects("a mapping as {refine: 4}"),
            Doc("finer run that judges a run, as an estimate, where no exact solution covers it"),
        ]
        | None
    ) = None
    expect: Annotated[
        tuple[Annotated[Expectation, Expects("a mapping as {quantity: gap, ...}")], ...],
        Expects("a list of expectations", "Begin each with a dash."),
        Doc("what a run is expected to give"),
    ] = ()
