"""Validation of plain data against frozen dataclasses by pydantic, with a message and advice for every mistake.

Each dataclass is one mapping of the input. Its validator words the mistakes of its own keys, and pydantic puts their
places together on the way up. The class of a component is looked up in the registry of the validation's context.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar, cast

import pydantic
from pydantic_core import InitErrorDetails, PydanticCustomError, PydanticKnownError, core_schema

from percuss.case.csv_file import read_table
from percuss.case.options import Option, options_of
from percuss.case.type_words import Expects, advice_for, describe, fact, found, item_type
from percuss.case.yaml_text import KeyPath, dotted
from percuss.errors import InputError, PluginError, Problem, suggestion
from percuss.methods.interfaces import AllowInf, Component, DataFile

if TYPE_CHECKING:
    from percuss.methods.registry import Registry

__all__ = [
    "SINGULAR",
    "Context",
    "EmptyIfAbsent",
    "Keyed",
    "Named",
    "Section",
    "adapter",
    "mistake",
    "validate",
]

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
_STRICT = core_schema.CoreConfig(strict=True, allow_inf_nan=False)
# Mistakes of these types are worded by what the annotation expects.
_DESCRIBED = {
    *("float_type", "int_type", "bool_type", "string_type", "tuple_type", "dict_type", "none_required", "missing"),
    *("greater_than", "greater_than_equal", "less_than", "less_than_equal", "too_long", "too_short"),
    *("finite_number", "int_from_float", "literal_error"),
}
# Key of a component whose name is itself a key of the mapping; no file has it and no path shows it.
NO_KEY = "\0"


@dataclass(frozen=True)
class Context:
    """Surroundings of a validation.

    Attributes
    ----------
    registry
        Registry of the components; None where none can be named.
    folder
        Folder that the paths of data files are relative to.
    checked
        Instance made from each mapping of the input without mistakes, by the mapping's ``id``.
    """

    registry: Registry | None = None
    folder: Path = Path()
    checked: dict[int, Any] = field(default_factory=dict)

    def names(self, family: str) -> list[str]:
        """Return the names of the components of a family."""
        return self.registry.names(family) if self.registry is not None else []

    def data_file(self, path: str) -> DataFile:
        """Return the data file at a path as written in the input."""
        try:
            return read_table(path, self.folder)
        except ValueError as error:
            advice = "The path is relative to the case." if "no such file" in str(error) else ""
            words = {"message": str(error), "advice": advice}
            raise PydanticCustomError("unusable_file", "{message}", words) from None

    @property
    def left_out(self) -> list[str]:
        """Sentences about the plug-ins that failed to load, one of which could have brought an unknown name."""
        broken = self.registry.broken if self.registry is not None else ()
        sentences = [f"Plug-in that failed to load: {plugin.source}: {plugin.error}" for plugin in broken]
        return [sentence if sentence.endswith("?") else f"{sentence}." for sentence in sentences]


# -------------------------------------------------------------------------------------------------- mistakes


def _detail(loc: KeyPath, message: str, advice: str = "", *, key: bool = False) -> InitErrorDetails:
    """Return a worded mistake; `key` says that its place is the key and not the value."""
    words = {"message": message, "advice": advice, "key": key}
    shown = tuple(part for part in loc if part != NO_KEY)
    return InitErrorDetails(type=PydanticCustomError("worded", "{message}", words), loc=shown, input=None)


def _error(details: list[InitErrorDetails]) -> pydantic.ValidationError:
    return pydantic.ValidationError.from_exception_data("percuss", details)


def mistake(message: str, advice: str = "", *, at: KeyPath = (), key: bool = False) -> pydantic.ValidationError:
    """Return the error that a validator raises for a mistake at a place inside its value."""
    return _error([_detail(at, message, advice, key=key)])


def worded_mistakes(error: pydantic.ValidationError) -> Iterator[tuple[KeyPath, dict[str, Any]]]:
    """Yield place, and message, advice and key, of each mistake."""
    for detail in error.errors(include_url=False, include_input=False):
        yield detail["loc"], detail["ctx"]


def _reached(loc: KeyPath, value: Any) -> KeyPath:
    """Return the part of a location that leads into the value, without the names of branches of unions."""
    reached: list[str | int] = []
    for part in loc:
        keys: Any = value if isinstance(value, Mapping) else range(len(value)) if isinstance(value, tuple) else ()
        if part in keys:
            value = value[part]
            reached.append(part)
    return tuple(reached)


def _value_mistakes(option: Option, value: Any, errors: list[Any]) -> Iterator[InitErrorDetails]:
    """Yield one mistake for each wrong place of a value: the innermost ones, whichever branch of a union saw them."""
    places = [(_reached(error["loc"][1:], value), error) for error in errors]
    seen = set()
    for path, error in places:
        kind, words = error["type"], error.get("ctx", {})
        if kind == "worded":  # by the validator of a section or a component inside
            yield _detail(error["loc"], **words)
            continue
        if path in seen or any(other[: len(path)] == path and len(other) > len(path) for other, _ in places):
            continue
        seen.add(path)
        at, inside, annotation = (option.key, *path), value, option.annotation
        for part in path:
            inside, annotation = inside[part], item_type(annotation) or Any
        if kind == "unusable_file":
            yield _detail(at, words["message"], words["advice"])
        elif error["loc"][-1] == "[key]":
            remedy = "A name is a letter, then letters, digits, _ or -."
            yield _detail(at, f"expected a name, found '{path[-1]}'", remedy, key=True)
        elif kind in _DESCRIBED or (not path and fact(annotation, Expects) is not None):
            expected = f"expected {describe(annotation)}{option.shown_unit if path else ''}"
            yield _detail(at, f"{expected}, found {found(inside)}", advice_for(annotation, inside))
        else:
            message = error["msg"].removeprefix("Value error, ")
            yield _detail(at, f"{message}, found {found(inside)}", advice_for(annotation, inside))


def _mapping_mistakes(
    cls: type, given: Mapping[str, Any], error: pydantic.ValidationError, context: Context
) -> Iterator[InitErrorDetails]:
    """Yield the mistakes of a mapping: unknown keys, missing keys and wrong values."""
    options, kind = options_of(cls), kind_of(cls)
    keyed = _keyed(cls)
    known = [*(key for key in options if key != NO_KEY), *(context.names(keyed.family) if keyed else ())]
    by_key: dict[Any, list[Any]] = {}
    for detail in error.errors(include_url=False):
        by_key.setdefault(detail["loc"][0], []).append(detail)
    unknown = [key for key in by_key if key not in options]
    for key in unknown:
        remedy = suggestion(key, known, "key") if known else "It takes no options."
        # Where the name of a component may stand, a plug-in could have brought the key.
        advices = [remedy, *context.left_out] if keyed else [remedy]
        yield _detail((key,), f"unknown key '{key}' of {kind}", " ".join(advices), key=True)
    for key, errors in by_key.items():
        if key in unknown or (key == NO_KEY and unknown and not given[NO_KEY]):
            continue  # An unknown key is the misspelt name of the component.
        option = options[key]
        if errors[0]["type"] == "missing" and len(errors[0]["loc"]) == 1:
            about = f" ({option.doc}{option.shown_unit})" if option.doc or option.shown_unit else ""
            yield _detail((key,), f"missing{about}", f"Add `{key}:` to {kind}.", key=True)
        else:
            yield from _value_mistakes(option, given.get(key), errors)


def kind_of(cls: type[Any]) -> str:
    """Return the words by which messages call the mapping of a section or the options of a component."""
    return f"the {SINGULAR.get(cls.family, cls.family)} {cls.name}" if issubclass(cls, Component) else str(cls.kind)


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
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> core_schema.CoreSchema:
        return _mapping_schema(cls, handler)


@dataclass(frozen=True)
class _Mapping:
    """Mark of a value that is a mapping whose keys are the options of a dataclass."""

    cls: type

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return _mapping_schema(self.cls, handler)


def _keyed(cls: type) -> Keyed | None:
    """Return the mark of the component that mappings for a dataclass name by a key of their own, if they do."""
    option = options_of(cls).get(NO_KEY)
    return fact(option.annotation, Keyed) if option is not None else None


def _mapping_schema(cls: type, handler: Any) -> core_schema.CoreSchema:
    """Return the schema of a mapping that becomes an instance of a dataclass."""
    options, keyed = options_of(cls), _keyed(cls)
    fields = {}
    for key, option in options.items():
        try:
            schema = handler.generate_schema(option.annotation)
        except pydantic.errors.PydanticUserError as error:
            reason = str(error).splitlines()[0]
            raise PluginError(f"{cls.__name__}: option '{key}' is of a type no case can give: {reason}") from None
        if fact(option.annotation, AllowInf) is not None:
            schema = core_schema.no_info_after_validator_function(_without_nan, schema)
        required = option.required and schema["type"] != "default"
        fields[key] = core_schema.typed_dict_field(schema, required=required)

    def instance(value: Any, check: Any, info: Any) -> Any:
        if not isinstance(value, Mapping):
            return check(value)  # which raises an error that the mapping around this one words
        given = value
        if keyed is not None:
            names = info.context.names(keyed.family)
            given = {key: item for key, item in value.items() if key not in names}
            given[NO_KEY] = {key: item for key, item in value.items() if key in names}
        try:
            values = check(given)
        except pydantic.ValidationError as error:
            raise _error(list(_mapping_mistakes(cls, given, error, info.context))) from None
        try:
            made = cls(**{options[key].field: item for key, item in values.items()})
        except ValueError as error:
            raise mistake(str(error), key=True) from None
        info.context.checked[id(value)] = made
        return made

    mapping = core_schema.typed_dict_schema(fields, extra_behavior="forbid", config=_STRICT, metadata={"percuss": cls})
    return core_schema.with_info_wrap_validator_function(instance, mapping)


def _without_nan(value: Any) -> Any:
    if isinstance(value, float) and math.isnan(value):
        raise PydanticKnownError("finite_number")
    return value


@functools.cache
def _adapter(cls: Any) -> pydantic.TypeAdapter[Any]:
    return pydantic.TypeAdapter(Annotated[Any, _Mapping(cls)])


def adapter(cls: type) -> pydantic.TypeAdapter[Any]:
    """Return the adapter that makes an instance of a dataclass from a mapping, given a `Context`.

    Raises
    ------
    PluginError
        If an annotation cannot be read or allows no value that a case can give.
    """
    return _adapter(cast("Hashable", cls))


def validate(cls: type[T], options: Mapping[str, Any], folder: Path = Path()) -> T:
    """Return the component with the given options, checked like those of a case.

    Raises
    ------
    InputError
        With all mistakes in the options.
    """
    try:
        return adapter(cls).validator.validate_python(dict(options), context=Context(folder=folder))  # type: ignore[no-any-return]
    except pydantic.ValidationError as error:
        raise InputError(
            Problem("", dotted(path), words["message"], words["advice"]) for path, words in worded_mistakes(error)
        ) from None


# ------------------------------------------------------------------------------------------------ components


@dataclass(frozen=True)
class EmptyIfAbsent:
    """Mark of an entry that is read as an empty mapping where it is absent."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.with_default_schema(handler(source), default={}, validate_default=True)


@dataclass(frozen=True)
class Named:
    """Mark of an entry that is a component: ``NAME`` or ``{name: NAME, option: ...}``.

    Attributes
    ----------
    family
        Family of the component.
    default
        Name of the component if the entry has none.
    optional
        Whether an absent entry is None and not the default component.
    """

    family: str
    default: str
    optional: bool = False

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        schema = core_schema.with_info_plain_validator_function(self.component, metadata={"percuss": self})
        return schema if self.optional else core_schema.with_default_schema(schema, default={}, validate_default=True)

    def component(self, value: Any, info: Any) -> Component:
        """Return the component that an entry names."""
        at: KeyPath = ()
        options: Mapping[str, Any] = {}
        if isinstance(value, Mapping):
            options = {key: item for key, item in value.items() if key != "name"}
            value, at = value.get("name", self.default), ("name",)
        context, kind = info.context, SINGULAR.get(self.family, self.family)
        if not isinstance(value, str):
            remedy = " ".join([suggestion("", context.names(self.family)), *context.left_out])
            raise mistake(f"expected the name of a {kind}, found {found(value)}", remedy, at=at)
        try:
            cls = context.registry.get(self.family, value)
        except KeyError:
            remedy = " ".join([suggestion(value, context.names(self.family)), *context.left_out])
            raise mistake(f"unknown {kind} '{value}'", remedy, at=at) from None
        except PluginError as error:
            raise mistake(str(error), at=at) from None
        return adapter(cls).validator.validate_python(options, context=context)  # type: ignore[no-any-return]


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

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.with_info_plain_validator_function(self.component, metadata={"percuss": self})

    def component(self, given: Mapping[str, Any], info: Any) -> Component:
        """Return the component of a mapping from those entries that have the name of a component as key."""
        keys = list(given)
        if not keys:
            names = ", ".join(info.context.names(self.family))
            raise mistake(f"has no {self.kind}", f"Add one of: {names}.", key=True)
        if len(keys) > 1:
            raise mistake(f"expected one {self.kind}, found {' and '.join(keys)}", "Keep one.", at=(keys[1],), key=True)
        name, value = keys[0], given[keys[0]]
        cls = info.context.registry.get(self.family, name)
        shorthand = cls.shorthand
        if value is None and not shorthand:
            value = {}
        by_value = not isinstance(value, Mapping)
        if by_value and not shorthand:
            raise mistake(f"expected the options of {name}, found {found(value)}", at=(name,))
        try:
            options = {shorthand: value} if by_value else value
            return adapter(cls).validator.validate_python(options, context=info.context)  # type: ignore[no-any-return]
        except pydantic.ValidationError as error:
            raise _error(
                [
                    # The value of a shorthand stands where the mapping would.
                    _detail((name, *(loc[1:] if by_value and loc[:1] == (shorthand,) else loc)), **words)
                    for loc, words in worded_mistakes(error)
                ]
            ) from None
