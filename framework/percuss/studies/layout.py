"""Layout of a study file: each class is a mapping, each of its fields a key; its JSON schema; the values of a path.

Values are written ``1,2,5``, ``0:1:11``, ``0.01:100:log:30``. Points are all combinations of varied values,
points whose values go together, and points drawn from a box.
"""

from __future__ import annotations

import itertools
import math
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import eq, ge, gt, le, lt, ne
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, WrapValidator

from percuss.case.csv_file import NOT_FINITE, NUMBER
from percuss.case.json_schema import DIALECT, component_schema, name_or, schema_of
from percuss.case.options import LARGEST_NUMBER, Key
from percuss.case.quantities import MEASURABLE, METRICS, name_schema
from percuss.case.specs import MeasureSection
from percuss.case.type_words import Expects
from percuss.case.validation import EmptyIfAbsent, Section
from percuss.errors import InputError, shortened, wrong_input
from percuss.jsonable import Data, Entries
from percuss.methods.interfaces import Doc, Ge, Le, Unit
from percuss.methods.registry import Registry

NAMES = Expects("a list of names", "Write the names in brackets, separated by commas.")
PATHS = Expects("a mapping of paths to values")
WHOLE = re.compile(r"[-+]?[0-9]{1,4000}")
MOST = 1_000_000
GRAMMAR = "write values as 1,2,5, a range as 0:1:11, a logarithmic range as 0.01:100:log:30"


@dataclass(frozen=True)
class MethodsSection(Section):
    """Integrators and contact laws; every pair is run."""

    kind: ClassVar[str] = "the methods"

    integrators: Annotated[
        tuple[Any, ...], NAMES, Doc("names of integrators, or {name: ..., option: ...}; by default the case's own")
    ] = ()
    contacts: Annotated[
        tuple[Any, ...], NAMES, Doc("names of contact laws, or {name: ..., option: ...}; by default the case's own")
    ] = ()


OPERATORS = {"<": lt, "<=": le, ">": gt, ">=": ge, "==": eq, "!=": ne}


@dataclass(frozen=True)
class RangeSection(Section):
    """The range of a sampled path."""

    kind: ClassVar[str] = "the range"

    from_: Annotated[float, Doc("lower end")]
    to: Annotated[float, Doc("upper end")]
    scale: Annotated[Literal["linear", "log"], Doc("whether values or their logarithms are evenly spaced")] = "linear"

    def __post_init__(self) -> None:
        if not self.from_ < self.to:
            raise ValueError(f"has no width: `to` {self.to:g} is not above `from` {self.from_:g}")
        if self.scale == "log" and not self.from_ > 0:
            raise ValueError(f"starts at {self.from_:g}: a logarithmic range needs ends above 0")

    def at(self, share: float) -> float:
        """Return the value at a share of the way from the lower to the upper end."""
        if self.scale == "log":
            return math.exp(math.log(self.from_) + share * (math.log(self.to) - math.log(self.from_)))
        return self.from_ + share * (self.to - self.from_)


@dataclass(frozen=True)
class SampleSection(Section):
    """Points drawn from a box of values."""

    kind: ClassVar[str] = "the sample"

    count: Annotated[int, Ge(1), Le(1_000_000), Unit("1"), Doc("number of points")]
    of: Annotated[
        dict[str, Annotated[RangeSection, Expects("a range as {from: 0, to: 1}")]],
        Field(min_length=1),
        Expects("a mapping of paths to ranges"),
        Doc("by path: {from: ..., to: ..., scale: linear or log}"),
    ]
    method: Annotated[Literal["random", "latin-hypercube", "sobol", "halton"], Doc("how the points are drawn")] = (
        "latin-hypercube"
    )
    seed: Annotated[int, Ge(0), Unit("1"), Doc("the same seed draws the same points")] = 0

    def points(self) -> list[dict[str, float]]:
        """Return the points in the order drawn: independent random numbers, or a sequence of `scipy.stats.qmc`."""
        if self.method == "random":
            shares = np.random.default_rng(self.seed).random((self.count, len(self.of)))
        else:
            from scipy.stats import qmc

            kinds = {"latin-hypercube": qmc.LatinHypercube, "sobol": qmc.Sobol, "halton": qmc.Halton}
            with warnings.catch_warnings():
                # A Sobol sequence is balanced at powers of two only, but the user may choose any count.
                warnings.filterwarnings("ignore", message="The balance properties of Sobol", category=UserWarning)
                shares = kinds[self.method](len(self.of), rng=np.random.default_rng(self.seed)).random(self.count)
        return [
            {path: self.of[path].at(share) for path, share in zip(self.of, row, strict=True)} for row in shares.tolist()
        ]


@dataclass(frozen=True)
class Condition(Section):
    """A condition on the points of a study; points that fulfil it are kept."""

    kind: ClassVar[str] = "the condition"

    path: Annotated[str, Doc("a varied path, or case, integrator or contact")]
    op: Annotated[Literal["<", "<=", ">", ">=", "==", "!="], Doc("how the value is compared")]
    value: Annotated[float | str | bool, Doc("with what")]

    def holds(self, row: Data) -> bool:
        """Return whether the row fulfils the condition; a row without the path does."""
        if self.path not in row:
            return True
        try:
            return bool(OPERATORS[self.op](row[self.path], self.value))
        except TypeError:
            # A word and a number have no order: `auto` among numbers is kept, a wrong bound keeps nothing.
            return isinstance(row[self.path], str)


@dataclass(frozen=True)
class KeepSection(Section):
    """Data kept of each run besides its row."""

    kind: ClassVar[str] = "keep"

    histories: Annotated[int, Ge(0), Unit("1"), Doc("most points kept of each contact force; 0 keeps none")] = 0


MEASURE = Expects("a name, or a measure as {name: plateau, quantity: contact_force, ...}")


def _or_name(value: object, check: Callable[[object], MeasureSection]) -> MeasureSection | str:
    """Return a name as it is, and anything else as a checked measure."""
    return value if isinstance(value, str) else check(value)


@dataclass(frozen=True)
class StudySection(Section):
    """A study of percuss: many runs, one row each."""

    kind: ClassVar[str] = "the study"

    percuss_study: Annotated[Literal[1], Key("percuss-study"), Doc("version of the format: 1")]
    cases: Annotated[
        tuple[str, ...],
        Field(min_length=1),
        Expects("a list of files, as [hunek.yaml]"),
        Doc("the cases, relative to this file"),
    ]
    methods: Annotated[
        MethodsSection, Expects("a mapping"), EmptyIfAbsent(), Doc("integrators and contact laws; every pair is run")
    ]
    keep: Annotated[KeepSection, Expects("a mapping"), EmptyIfAbsent(), Doc("what is kept of each run beside its row")]
    title: Annotated[str, Doc("title of the study in one line")] = ""
    question: Annotated[str, Doc("what it is to answer")] = ""
    set: Annotated[Entries, PATHS, Doc("values replaced in every case, by dotted path")] = field(default_factory=dict)
    vary: Annotated[
        Entries,
        PATHS,
        Doc("values by dotted path, every combination: a list, or 0:1:11 or 0.01:100:log:30"),
    ] = field(default_factory=dict)
    paired: Annotated[
        tuple[Annotated[Entries, PATHS], ...],
        Expects("a list of mappings", "Begin with a dash."),
        Doc("list of mappings of paths to values that go together"),
    ] = ()
    sample: Annotated[SampleSection, Expects("a mapping"), Doc("points drawn from a box")] | None = None
    measure: Annotated[
        tuple[Annotated[MeasureSection, WrapValidator(_or_name), MEASURE], ...],
        Expects("a list of measures", "Begin each with a dash."),
        Doc("the columns of the table; by default those of a comparison"),
    ] = ()
    where: Annotated[
        tuple[Annotated[Condition, Expects("a condition as {path: refine, op: <, value: 4}")], ...],
        Expects("a list of conditions", "Begin with a dash."),
        Doc("conditions that every run meets"),
    ] = ()
    tied: Annotated[bool, Doc("also run with interfaces tied while the exact contact is closed")] = False
    nudge: Annotated[bool, Doc("repeat each run with a tiny change, to see if it depends on round-off")] = False
    repeats: (
        Annotated[
            int,
            Ge(1),
            Le(1000),
            Unit("1"),
            Doc("marches of each run, of which the least time counts; null: 3, none after 0.3 s"),
        ]
        | None
    ) = None


def study_schema(registry: Registry) -> Entries:
    """Return the JSON schema (draft 2020-12) of a study.

    Parameters
    ----------
    registry
        Registry whose integrators and contact laws appear by name.
    """
    schema = schema_of(StudySection, registry)
    properties = schema["properties"]
    properties["vary"]["additionalProperties"] = {"type": ["array", "string", "number", "boolean"]}
    for family, family_schema in properties["methods"]["properties"].items():
        components = {name: registry.get(family, name) for name in registry.names(family)}
        # Options of the case are kept, and others are varied, so that none has to stand here.
        family_schema["items"] = component_schema(components, complete=False)
    columns = {name: quantity.label for name, quantity in METRICS.items()}
    columns |= {name: registry.get("measures", name).summary for name in registry.names("measures")}
    quantities = {name: quantity.label for name, quantity in {**MEASURABLE, **METRICS}.items()}
    measure = properties["measure"]["items"]
    measure["properties"]["quantity"] |= name_schema(quantities)
    properties["measure"]["items"] = name_or(name_schema(columns), measure)
    return {"$schema": DIALECT, "title": "percuss study", "description": "A study of percuss, format 1", **schema}


# ------------------------------------------------------------------------------------------ the values of a path


def values_in(text: str, place: str = "--vary") -> list[int | float | str]:
    """Return the values that `text` describes.

    Parameters
    ----------
    text
        A list, a range (first:last:count) or a logarithmic range (first:last:log:count), both ends included.
    place
        Option or path where the text was given, for the message.

    Raises
    ------
    InputError
        If the text is none of these.
    """
    parts = text.split(":")
    if len(parts) == 1:
        items = [item.strip() for item in text.split(",")]
        if not all(items):
            raise _grammar_error(place, f"expected values, found '{text}'")
        return [_number(item) for item in items]
    log = len(parts) == 4 and parts[2].strip() == "log"
    if not (len(parts) == 3 or log):
        raise _grammar_error(place, f"expected a range, found '{text}'")
    first, last, count = _number(parts[0]), _number(parts[1]), _number(parts[-1])
    if isinstance(first, str) or isinstance(last, str) or not isinstance(count, int) or not 1 <= count <= MOST:
        raise _grammar_error(place, f"expected numbers and a count of 1 to {MOST}, found '{text}'")
    if not (abs(first) <= LARGEST_NUMBER and abs(last) <= LARGEST_NUMBER):
        message = f"expected ends of at most {LARGEST_NUMBER:g} in size, found '{shortened(text, 60)}'"
        raise _grammar_error(place, message)
    if log and not (first > 0 and last > 0):
        raise _grammar_error(place, f"expected ends above 0 for a logarithmic range, found '{text}'")
    return [float(x) for x in (np.geomspace if log else np.linspace)(first, last, count)]


def varied(given: list[str], option: str = "--vary") -> dict[str, list[int | float | str]]:
    """Return path to values for each ``PATH=VALUES`` in `given`.

    Raises
    ------
    InputError
        If an entry is not of that form, or a path is given twice.
    """
    out: dict[str, list[int | float | str]] = {}
    for item in given:
        path, equals, text = item.partition("=")
        if not equals or not path:
            raise _grammar_error(option, f"expected PATH=VALUES, found '{item}'")
        if path.strip() in out:
            raise wrong_input(option, f"expected a path once, found {path.strip()} twice", "Join the values.")
        out[path.strip()] = values_in(text, f"{option} {path.strip()}")
    return out


def _number(text: str) -> int | float | str:
    """Return the number written in a text, by the same strict rules as in tables; return other text unchanged."""
    text = text.strip()
    if WHOLE.fullmatch(text):
        return int(text)
    return float(text) if NUMBER.fullmatch(text) or NOT_FINITE.fullmatch(text) else text


def _grammar_error(place: str, message: str) -> InputError:
    return wrong_input(place, message, f"{GRAMMAR[0].upper()}{GRAMMAR[1:]}.")


def combinations(
    varied: Mapping[str, Sequence[object]], paired: Sequence[Data] = (), sample: SampleSection | None = None
) -> list[Entries]:
    """Return all combinations of the varied values, each with every paired point and every drawn point.

    Raises
    ------
    InputError
        If there are more than `MOST`.
    """
    varied = {path: list(values) for path, values in varied.items()}
    count = math.prod(map(len, varied.values())) * max(len(paired), 1) * (sample.count if sample is not None else 1)
    if count > MOST:
        message = f"expected at most {MOST} combinations of values, found {count}"
        raise wrong_input("--vary", message, "Vary fewer values.")
    grid = [dict(zip(varied, values, strict=True)) for values in itertools.product(*varied.values())]
    drawn: Sequence[Data] = sample.points() if sample is not None else [{}]
    return [
        {**grid_point, **paired_point, **drawn_point}
        for grid_point in grid
        for paired_point in (paired or [{}])
        for drawn_point in drawn
    ]
