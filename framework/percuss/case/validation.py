"""Validation of plain data against frozen dataclasses by pydantic, with a message and advice for every mistake.

Each dataclass is one mapping of the input. Its validator words the mistakes of its own keys, and pydantic puts their
places together on the way up. The class of a component is looked up in the registry of the validation's context.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple, TypeAlias, TypeVar, cast, get_args

import pydantic
from pydantic import GetCoreSchemaHandler
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError, PydanticKnownError, core_schema

from percuss.case.csv_file import read_text, table_in
from percuss.case.defaults import DEFAULTS
from percuss.case.hints import name_advice
from percuss.case.options import LARGEST_NUMBER, SMALLEST_NUMBER, UNITS, Option, options_of
from percuss.case.source import Source
from percuss.case.type_words import Expects, advice_for, describe, fact, found, item_type
from percuss.case.yaml_text import KeyPath
from percuss.errors import InputError, PluginError, Problem, suggestion
from percuss.jsonable import Data
from percuss.methods.blame import SINGULAR, said_by
from percuss.methods.interfaces import Component, DataFile, Gt, MeshFile, OptionError
from percuss.methods.registry import Registry

T = TypeVar("T")

_STRICT = core_schema.CoreConfig(strict=True, allow_inf_nan=False)
# Mistakes of these types are worded by what the annotation expects.
_DESCRIBED = {
    *("float_type", "int_type", "bool_type", "string_type", "tuple_type", "dict_type", "none_required", "missing"),
    *("greater_than", "greater_than_equal", "less_than", "less_than_equal", "too_long", "too_short"),
    *("finite_number", "int_from_float", "literal_error"),
}
# Whole numbers count elements, steps and records, in arrays whose indices have 64 bits.
MOST = 2**63 - 1
# Key of a component whose name is itself a key of the mapping; no file has it and no path shows it.
NO_KEY = "\0"


F = TypeVar("F", DataFile, MeshFile)
Checked: TypeAlias = dict[int, tuple[Any, Any]]  # see `Context.checked`


@dataclass(frozen=True)
class Context:
    """Surroundings of a validation.

    Attributes
    ----------
    registry
        Registry of the components.
    folder
        Folder that the paths of data files are relative to.
    given_texts
        Texts that stand in for data files, by the path written in the input.
    checked
        Mapping without mistakes and the instance made from it, by the mapping's ``id``.
    texts_read
        Text of each data file of the input, by the path written there.
    """

    registry: Registry
    folder: Path
    given_texts: Mapping[str, str] = field(default_factory=dict)
    checked: Checked = field(default_factory=dict)
    texts_read: dict[str, str] = field(default_factory=dict)

    def made_of(self, mapping: object) -> Any:
        """Return the instance made from a mapping of the input, None if there is none."""
        checked, made = self.checked.get(id(mapping), (None, None))
        return made if checked is mapping else None

    def data_file(self, path: str) -> DataFile:
        """Return the data file at a path as written in the input."""
        return self._read(path, read_text, table_in)

    def mesh_file(self, path: str) -> MeshFile:
        """Return the mesh file at a path as written in the input."""
        from percuss.case.mesh_file import mesh_in, read_mesh

        return self._read(path, read_mesh, mesh_in)

    def _read(self, path: str, read: Callable[[str, Path], str], made_of: Callable[[str, str], F]) -> F:
        """Return what is made of the text of a file, and note the text."""
        try:
            text = self.given_texts[path] if path in self.given_texts else read(path, self.folder)
            made = made_of(text, path)
        except ValueError as error:
            words = {"message": str(error), "advice": getattr(error, "advice", "")}
            raise PydanticCustomError("unusable_file", "{message}", words) from None
        self.texts_read[path] = text
        return made

    @property
    def left_out(self) -> list[str]:
        """Sentences about the plug-ins that failed to load, one of which could have brought an unknown name."""
        sentences = [f"Plug-in that failed to load: {broken.source}: {broken.error}" for broken in self.registry.broken]
        return [sentence if sentence.endswith("?") else f"{sentence}." for sentence in sentences]


# -------------------------------------------------------------------------------------------------- mistakes


class Mistake(NamedTuple):
    """A mistake in words, at a path inside the value that was validated; `key` says that the key is wrong."""

    path: KeyPath
    message: str
    advice: str = ""
    key: bool = False


def failure(*mistakes: Mistake) -> pydantic.ValidationError:
    """Return the error that a validator raises for mistakes inside its value."""
    details = [
        InitErrorDetails(
            type=PydanticCustomError("worded", "{message}", mistake._asdict()),
            loc=tuple(part for part in mistake.path if part != NO_KEY),
            input=None,
        )
        for mistake in mistakes
    ]
    return pydantic.ValidationError.from_exception_data("percuss", details)


def _worded(detail: ErrorDetails) -> Mistake:
    """Return the mistake that an inner validator has put into words, with its path in the outer value."""
    return Mistake(**{**detail["ctx"], "path": detail["loc"]})


def mistakes_in(error: pydantic.ValidationError) -> list[Mistake]:
    """Return the mistakes of a validation by `adapter`."""
    return [_worded(detail) for detail in error.errors(include_url=False)]


def _reached(loc: KeyPath, value: Any) -> KeyPath:
    """Return the part of a location that leads into the value, without the names of branches of unions."""
    reached: list[str | int] = []
    for part in loc:
        keys: Any = value if isinstance(value, Mapping) else range(len(value)) if isinstance(value, tuple) else ()
        if part in keys:
            value = value[part]
            reached.append(part)
    return tuple(reached)


def _place(detail: ErrorDetails, value: Any) -> KeyPath:
    """Return the place of a mistake inside a value; one that is in words may be at a key that is missing there."""
    if detail["type"] != "worded":
        return _reached(detail["loc"][1:], value)
    return tuple(part for part in detail["loc"][1:] if not str(part).startswith("function-"))  # branches of unions


def _value_mistakes(option: Option, value: object, details: list[ErrorDetails]) -> Iterator[Mistake]:
    """Yield one mistake for each wrong place of a value: the innermost ones, whichever branch of a union saw them."""
    places = [_place(detail, value) for detail in details]
    told = {path[:n] for path in places for n in range(len(path))}  # places that hold a wrong one
    for path, detail in zip(places, details, strict=True):
        if detail["type"] == "worded":
            yield _worded(detail)._replace(path=(option.key, *path))
        elif path not in told:
            yield _value_mistake(option, value, path, detail)
        told.add(path)


def _value_mistake(option: Option, value: Any, path: KeyPath, detail: ErrorDetails) -> Mistake:
    """Return the mistake at a path inside the value of an option."""
    at, kind, annotation = (option.key, *path), detail["type"], option.annotation
    if kind == "unusable_file":
        return Mistake(at, **detail["ctx"])
    if detail["loc"][-1] == "[key]":
        advice = "A name is a letter, then letters, digits, _ or -."
        return Mistake(at, f"expected a name, found '{path[-1]}'", advice, key=True)
    for part in path:
        value, annotation = value[part], item_type(annotation) or Any
    message = detail["msg"].removeprefix("Value error, ")
    if kind in _DESCRIBED or (not path and fact(annotation, Expects) is not None):
        message = f"expected {describe(annotation)}{option.shown_unit if path else ''}"
    return Mistake(at, f"{message}, found {found(value)}", advice_for(annotation, value))


def _mapping_mistakes(cls: Any, given: Data, details: list[ErrorDetails], context: Context) -> Iterator[Mistake]:
    """Yield the mistakes of a mapping: unknown keys, missing keys and wrong values."""
    options, keyed = options_of(cls), _keyed(cls)
    kind = f"the {SINGULAR.get(cls.family, cls.family)} {cls.name}" if issubclass(cls, Component) else cls.kind
    by_key: dict[Any, list[ErrorDetails]] = {}
    for detail in details:
        by_key.setdefault(detail["loc"][0], []).append(detail)
    for key in (unknown := [key for key in by_key if key not in options]):
        keys = [*options.keys() - {NO_KEY}, *(context.registry.names(keyed.family) if keyed else ())]
        advice = suggestion(key, keys, "key") if keys else "It takes no options."
        # Where the name of a component may stand, a plug-in could have brought the key.
        advice = " ".join([advice, *context.left_out]) if keyed else advice
        yield Mistake((key,), f"unknown key '{key}' of {kind}", advice, key=True)
        del by_key[key]
    if unknown and not given.get(NO_KEY):
        by_key.pop(NO_KEY, None)  # An unknown key is the misspelt name of the component.
    for key, of_key in by_key.items():
        option = options[key]
        if key in given:
            yield from _value_mistakes(option, given[key], of_key)
        elif of_key[0]["type"] == "missing":
            about = f" ({option.doc}{option.shown_unit})" if option.doc or option.shown_unit else ""
            yield Mistake((key,), f"missing{about}", f"Add `{key}:` to {kind}.", key=True)
        else:  # in the default component
            yield from map(_worded, of_key)


# --------------------------------------------------------------------------------------------------- schemas


class Section:
    """Base of the dataclasses that are sections of a file.

    Attributes
    ----------
    kind
        Words by which messages call the section.
    """

    kind: ClassVar[str]

    @classmethod
    def __get_pydantic_core_schema__(cls, source: object, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return _mapping_schema(cls, handler)


@dataclass(frozen=True)
class _Mapping:
    """Mark of a value that is a mapping whose keys are the options of a dataclass."""

    cls: Any

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return _mapping_schema(self.cls, handler)


def _keyed(cls: Any) -> Keyed | None:
    """Return the mark of the component that mappings for a dataclass name by a key of their own, if they do."""
    option = options_of(cls).get(NO_KEY)
    return fact(option.annotation, Keyed) if option is not None else None


def _mapping_schema(cls: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
    """Return the schema of a mapping that becomes an instance of a dataclass."""
    options, keyed = options_of(cls), _keyed(cls)
    fields = {}
    for key, option in options.items():
        try:
            schema = handler.generate_schema(option.annotation)
        except pydantic.errors.PydanticUserError as error:
            reason = str(error).splitlines()[0]
            raise PluginError(f"{cls.__name__}: option '{key}' is of a type no case can give: {reason}") from None
        required = option.required and schema["type"] != "default"
        if schema["type"] != "default":  # else it is a component or a section, whose options have limits of their own
            above = fact(option.annotation, Gt)
            smallest = SMALLEST_NUMBER if above is not None and above.gt == 0 else 0.0
            within = functools.partial(_within_limits, option, smallest)
            schema = core_schema.no_info_after_validator_function(within, schema)
        fields[key] = core_schema.typed_dict_field(schema, required=required)

    def instance(value: object, check: Any, info: core_schema.ValidationInfo[Context]) -> Any:
        if not isinstance(value, Mapping):
            return check(value)  # which raises an error that the mapping around this one puts into words
        if type(made := info.context.made_of(value)) is cls:
            return made
        given = value
        if keyed is not None:
            names = info.context.registry.names(keyed.family)
            given = {key: item for key, item in value.items() if key not in names}
            given[NO_KEY] = {key: item for key, item in value.items() if key in names}
        try:
            values = check(given)
        except pydantic.ValidationError as error:
            raise failure(*_mapping_mistakes(cls, given, error.errors(include_url=False), info.context)) from None
        try:
            made = cls(**{options[key].field: item for key, item in values.items()})
        except pydantic.ValidationError:
            raise
        except OptionError as error:
            raise failure(Mistake(error.path, str(error))) from None
        except ValueError as error:
            raise failure(Mistake((), said_by(error), key=True)) from None
        info.context.checked[id(value)] = value, made
        return made

    mapping = core_schema.typed_dict_schema(fields, extra_behavior="forbid", config=_STRICT, metadata={"percuss": cls})
    return core_schema.with_info_wrap_validator_function(instance, mapping)


def _within_limits(option: Option, smallest: float, value: object) -> Any:
    """Return the value of an option if it can be computed with: products of a few of its numbers are finite.

    Numbers that are greater than 0 are divided by, so that they must not be tiny either: none is below `smallest`. If a
    number may be infinite, nan comes here too.
    """
    if isinstance(value, float) and math.isnan(value):
        raise PydanticKnownError("finite_number")
    if isinstance(value, int) and abs(value) > MOST:
        raise PydanticCustomError("too_large", "expected a whole number below 2^63")
    for path, number in _finite_numbers(value):
        if not smallest <= abs(number) <= LARGEST_NUMBER:
            sign = "" if smallest else "-"
            message = f"expected a number between {sign}{smallest or LARGEST_NUMBER:g} and {LARGEST_NUMBER:g}"
            advice = UNITS if option.shown_unit else ""
            raise failure(Mistake(path, f"{message}{option.shown_unit}, found {found(number)}", advice))
    return value


def _finite_numbers(value: object, path: KeyPath = ()) -> Iterator[tuple[KeyPath, float]]:
    """Yield the path and the value of each finite number in a value that is a number or a list of them."""
    if isinstance(value, float) and math.isfinite(value):
        yield path, value
    elif isinstance(value, tuple):
        for index, item in enumerate(value):
            yield from _finite_numbers(item, (*path, index))


@functools.cache
def adapter(cls: Any) -> pydantic.TypeAdapter[Any]:
    """Return the adapter that makes an instance of a dataclass from a mapping, given a `Context`.

    Raises
    ------
    PluginError
        If an annotation cannot be read or allows no value that a case can give.
    """
    return pydantic.TypeAdapter(Annotated[Any, _Mapping(cls)])


def validate(cls: type[T], options: object, context: Context) -> T:
    """Return the instance of a dataclass with the given options.

    Raises
    ------
    pydantic.ValidationError
        With all mistakes in the options, see `mistakes_in`.
    """
    validator = adapter(cast("Any", cls)).validator
    return validator.validate_python(options, context=context)  # type: ignore[no-any-return]


# ------------------------------------------------------------------------------------------------ components


@dataclass(frozen=True)
class EmptyIfAbsent:
    """Mark of an entry that is read as an empty mapping where it is absent."""

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.with_default_schema(handler(source), default={}, validate_default=True)


@dataclass(frozen=True)
class Named:
    """Mark of an entry that is a component: ``NAME`` or ``{name: NAME, option: ...}``.

    Attributes
    ----------
    family
        Family of the component.
    """

    family: str

    @property
    def default(self) -> str:
        """Name of the component if the entry has none."""
        return DEFAULTS[self.family]

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        may_be_absent = type(None) in get_args(source)  # None is then not the default component
        schema = core_schema.with_info_plain_validator_function(
            self.component_or_none if may_be_absent else self.component, metadata={"percuss": self}
        )
        return schema if may_be_absent else core_schema.with_default_schema(schema, default={}, validate_default=True)

    def component_or_none(self, entry: object, info: core_schema.ValidationInfo[Context]) -> Component | None:
        """Return the component that an entry names; null is as if the key were absent."""
        return None if entry is None else self.component(entry, info)

    def component(self, entry: object, info: core_schema.ValidationInfo[Context]) -> Component:
        """Return the component that an entry names."""
        name, options = entry, {}
        at: KeyPath = ()
        if isinstance(entry, Mapping):
            options = {**entry}
            name, at = options.pop("name", self.default), ("name",)
        try:
            cls: type[Component] = info.context.registry.get(self.family, name if isinstance(name, str) else "")
        except KeyError:
            kind, text = SINGULAR[self.family], name if isinstance(name, str) else ""
            advice = " ".join([name_advice(text, self.family, info.context.registry), *info.context.left_out])
            message = f"unknown {kind} '{name}'" if text else f"expected the name of a {kind}, found {found(name)}"
            raise failure(Mistake(at, message, advice)) from None
        except PluginError as error:
            raise failure(Mistake(at, str(error))) from None
        return validate(cls, options, info.context)


@dataclass(frozen=True)
class Keyed:
    """Mark of a component whose name is a key of the mapping around it, as ``constant: 2`` of a load.

    Attributes
    ----------
    family
        Family of the component.
    kind
        Word for the component in messages.
    """

    family: str
    kind: str

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.with_info_plain_validator_function(self.component, metadata={"percuss": self})

    def component(self, given: Data, info: core_schema.ValidationInfo[Context]) -> Component:
        """Return the component of a mapping from those entries whose keys are names of components."""
        keys = list(given)
        if not keys:
            names = ", ".join(info.context.registry.names(self.family))
            raise failure(Mistake((), f"has no {self.kind}", f"Add one of: {names}.", key=True))
        if len(keys) > 1:
            message = f"expected one {self.kind}, found {' and '.join(keys)}"
            raise failure(Mistake((keys[1],), message, "Keep one.", key=True))
        name, value = keys[0], given[keys[0]]
        cls: type[Component] = info.context.registry.get(self.family, name)
        options = {} if value is None and not cls.shorthand else value
        if not isinstance(options, Mapping):
            if not cls.shorthand:
                raise failure(Mistake((name,), f"expected the options of {name}, found {found(value)}"))
            options = {cls.shorthand: value}
        try:
            return validate(cls, options, info.context)
        except pydantic.ValidationError as error:
            mistakes = mistakes_in(error)
        if options is not value:  # The value of a shorthand stands where the mapping would.
            mistakes = [m._replace(path=m.path[1:]) if m.path[:1] == (cls.shorthand,) else m for m in mistakes]
        raise failure(*(m._replace(path=(name, *m.path)) for m in mistakes))


# ------------------------------------------------------------------------------------------------------ reader


class Reader:
    """Reader of one source.

    Attributes
    ----------
    source, registry
        The source, and the registry of the components that it may name.
    context
        Surroundings of its validation; the parts without mistakes are in it, whether others have mistakes or not, and
        from the beginning those that have been checked before.
    problems
        Mistakes so far, each with its place in the order of the source.
    """

    def __init__(self, source: Source, registry: Registry, checked: Checked | None = None) -> None:
        self.source, self.registry = source, registry
        self.context = Context(registry, source.folder, source.data_files, dict(checked or {}))
        self.problems: list[tuple[tuple[int, int, int], Problem]] = []

    def wrong(self, path: KeyPath, message: str, advice: str = "", *, key: bool = False) -> None:
        """Keep a mistake."""
        problem = self.source.problem(path, message, advice, key=key)
        self.problems.append((self.source.order(path, key=key), problem))

    def report(self, mistake: Mistake, at: KeyPath = ()) -> None:
        """Keep a mistake inside the value at a path."""
        self.wrong((*at, *mistake.path), mistake.message, mistake.advice, key=mistake.key)

    def finish(self) -> None:
        """Raise InputError with all mistakes in the order of the file, if there are any."""
        if self.problems:
            ordered = sorted(self.problems, key=lambda placed: placed[0])
            # An anchor that is used twice would be reported twice.
            raise InputError(dict.fromkeys(problem for _, problem in ordered))

    def read(self, cls: type[T]) -> T | None:
        """Return the whole source as a section, or None if it has mistakes."""
        try:
            return validate(cls, self.source.data, self.context)
        except pydantic.ValidationError as error:
            for mistake in mistakes_in(error):
                self.report(mistake)
            return None

    def part(self, path: KeyPath) -> Any:
        """Return the checked section at `path`, or None if it has mistakes or is no section."""
        return self.context.made_of(self.source.get(path))
