"""Options of a component, or entries of a section, checked against a frozen dataclass.

The dataclass's annotations are the only statement of what is allowed: types, bounds, units and documentation
are read from them for validation, for messages and for the JSON schema alike.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import typing
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar, Union, cast, get_args, get_origin

import pydantic

from percuss.case.csv_file import read_table
from percuss.case.type_words import Expects, advice, describe, fact, found, is_union, item_type, words
from percuss.case.yaml_text import KeyPath
from percuss.errors import PluginError, suggestion
from percuss.methods.interfaces import DataFile, Doc, Unit

__all__ = ["Expects", "Fault", "Option", "options_of", "schema_of", "validate"]

T = TypeVar("T")

_STRICT = pydantic.ConfigDict(strict=True, allow_inf_nan=False)
_NUMBERS = ("float_type", "int_type", "finite_number", "int_from_float")
_BOUNDS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")
_TYPES = (
    "bool_type",
    "string_type",
    "tuple_type",
    "literal_error",
    "none_required",
    "missing",
    "too_long",
    "too_short",
)
_DESCRIBED = frozenset(_NUMBERS + _BOUNDS + _TYPES)
_NOTHING = dataclasses.MISSING


class Fault(NamedTuple):
    """One mistake, relative to the mapping checked; `key` tells whether the key is wrong or its value."""

    path: KeyPath
    message: str
    advice: str = ""
    key: bool = False


class Option(NamedTuple):
    """One option as its dataclass states it.

    Attributes
    ----------
    key
        As written in a case: the field's name, less a trailing underscore that keeps clear of keywords.
    field
        Name of the field.
    annotation
        Its type with bounds.
    unit, doc
        What `Unit` and `Doc` say; empty where they are absent.
    required
        Whether there is no default.
    default
        The default, or `dataclasses.MISSING`.
    """

    key: str
    field: str
    annotation: Any
    unit: str
    doc: str
    required: bool
    default: Any


# ------------------------------------------------------------------------------------------- annotations


def options_of(cls: type) -> dict[str, Option]:
    """Return the options of a dataclass by key, in the order of its fields.

    Raises
    ------
    PluginError
        If its annotations cannot be read.
    """
    return _options_of(cast("Hashable", cls))


@functools.cache
def _options_of(cls: Any) -> dict[str, Option]:
    try:
        hints = typing.get_type_hints(cls, include_extras=True)
    except (NameError, TypeError, AttributeError, SyntaxError) as error:
        raise PluginError(f"{cls.__name__}: its annotations cannot be read: {error}") from None
    found = {}
    for field in dataclasses.fields(cls):
        if not field.init:
            continue
        annotation = hints[field.name]
        unit, doc = fact(annotation, Unit), fact(annotation, Doc)
        default = field.default if field.default_factory is _NOTHING else field.default_factory()
        key = field.name.rstrip("_")
        found[key] = Option(
            key,
            field.name,
            annotation,
            unit.unit if unit else "",
            doc.text if doc else "",
            default is _NOTHING,
            default,
        )
    return found


def _substituted(annotation: Any) -> Any:
    """Return the annotation as the input has it: a data file is a path there."""
    if annotation is DataFile:
        return str
    if get_origin(annotation) is Annotated:
        inner = _substituted(annotation.__origin__)
        for one in annotation.__metadata__:
            inner = Annotated[inner, one]
        return inner
    if is_union(annotation):
        return Union[tuple(_substituted(branch) for branch in get_args(annotation))]  # noqa: UP007
    return annotation


def takes_file(annotation: Any) -> bool:
    """Return whether an option takes a data file, perhaps among other things."""
    if annotation is DataFile:
        return True
    if get_origin(annotation) is Annotated:
        return takes_file(annotation.__origin__)
    return is_union(annotation) and any(takes_file(branch) for branch in get_args(annotation))


@functools.cache
def _adapter(cls: type, key: str) -> pydantic.TypeAdapter[Any]:
    annotation = _substituted(options_of(cls)[key].annotation)
    try:
        return pydantic.TypeAdapter(annotation, config=_STRICT)
    except pydantic.errors.PydanticUserError as error:
        said = str(error).splitlines()[0]
        raise PluginError(f"{cls.__name__}: option '{key}' is of a type no case can give: {said}") from None


# ---------------------------------------------------------------------------------------------- checking


def _reached(path: tuple[Any, ...], value: Any) -> KeyPath:
    """Return how far an error's path leads into the value; pydantic mixes names of union branches into it."""
    reached: list[str | int] = []
    for part in path:
        known: Any = value if isinstance(value, Mapping) else range(len(value)) if isinstance(value, tuple) else ()
        if part in known:
            value = value[part]
            reached.append(part)
    return tuple(reached)


def _mistakes(option: Option, value: Any, error: pydantic.ValidationError) -> Iterator[Fault]:
    """Yield one fault for each wrong place of a value: the innermost ones, whatever branch saw them."""
    details = error.errors(include_url=False, include_context=False, include_input=False)
    places = [(_reached(one["loc"], value), one) for one in details]
    seen = set()
    worded = fact(option.annotation, Expects) is not None
    for path, one in places:
        if path in seen or any(other[: len(path)] == path and len(other) > len(path) for other, _ in places):
            continue
        seen.add(path)
        inside, annotation = value, option.annotation
        for part in path:
            inside, annotation = inside[part], item_type(annotation) or Any
        if one["type"] in _DESCRIBED or (worded and not path):
            unit = f" [{option.unit}]" if path and option.unit not in ("", "1") else ""
            expected = f"expected {describe(annotation)}{unit}"
        else:
            expected = one["msg"].removeprefix("Value error, ")
        yield Fault((option.key, *path), f"{expected}, found {found(inside)}", advice(annotation, inside))


def _checked(cls: type, option: Option, value: Any, folder: Path) -> tuple[Any, list[Fault]]:
    """Return the value of one option, or why it is wrong."""
    try:
        checked = _adapter(cls, option.key).validate_python(value)
    except pydantic.ValidationError as error:
        return None, list(_mistakes(option, value, error))
    if isinstance(checked, float) and math.isnan(checked):
        return None, [
            Fault((option.key,), f"expected {describe(option.annotation)}, found .nan", "nan is never a value.")
        ]
    if isinstance(checked, str) and takes_file(option.annotation) and checked not in words(option.annotation):
        try:
            return read_table(checked, folder), []
        except ValueError as error:
            advice_ = "The path is relative to the case." if "no such file" in str(error) else ""
            return None, [Fault((option.key,), str(error), advice_)]
    return checked, []


def _nearest_key(key: str, known: list[str]) -> str:
    return suggestion(key, known, "key") if known else "It takes no options."


def validate(
    cls: type[T],
    given: Mapping[str, Any],
    *,
    kind: str,
    folder: Path = Path(),
    resolve: Callable[[Option, Any], tuple[Any, bool] | None] | None = None,
    also: Iterable[str] = (),
) -> tuple[T | None, list[Fault]]:
    """Check a mapping against a frozen dataclass.

    Parameters
    ----------
    cls
        The dataclass; its fields are the options.
    given
        Plain data: mappings, tuples, scalars.
    kind
        What messages call the whole, e.g. ``the contact law bipenalty``.
    folder
        Folder that paths are relative to.
    resolve
        Called with each option and its value (`dataclasses.MISSING` where absent) before anything else;
        returns the finished value and whether it is good, or None to have it checked here.
    also
        Further keys that a message may suggest.

    Returns
    -------
    tuple
        The instance, None if anything is wrong; and everything that is.
    """
    options = options_of(cls)
    values: dict[str, Any] = {}
    good = True
    faults = [
        Fault((key,), f"unknown key '{key}' of {kind}", _nearest_key(key, [*options, *also]), key=True)
        for key in given
        if key not in options
    ]
    for key, option in options.items():
        value = given.get(key, _NOTHING)
        resolved = resolve(option, value) if resolve is not None else None
        if resolved is not None:
            values[option.field], fine = resolved
            good = good and fine
        elif value is not _NOTHING:
            values[option.field], wrong = _checked(cls, option, value, folder)
            faults += wrong
        elif option.required:
            unit = f" [{option.unit}]" if option.unit not in ("", "1") else ""
            about = f" ({option.doc}{unit})" if option.doc or unit else ""
            faults.append(Fault((key,), f"missing{about}", f"Add `{key}:` to {kind}.", key=True))
    if faults or not good:
        return None, faults
    try:
        return cls(**values), []
    except ValueError as error:
        return None, [Fault((), str(error), key=True)]


# ------------------------------------------------------------------------------------------------ schema


def option_schema(cls: type, option: Option) -> dict[str, Any]:
    """Return the JSON schema of one option, with its unit and what it is."""
    schema = dict(_adapter(cls, option.key).json_schema())
    if option.unit:
        schema["x-unit"] = option.unit
    if not option.required and option.default is not None:
        schema["default"] = list(option.default) if isinstance(option.default, tuple) else option.default
    return described(schema, option)


def described(schema: dict[str, Any], option: Option) -> dict[str, Any]:
    """Return a schema with the option's description."""
    unit = f" [{option.unit}]" if option.unit not in ("", "1") else ""
    return {**schema, "description": option.doc + unit} if option.doc else schema


def schema_of(cls: type, schema_for: Callable[[Option], dict[str, Any] | None] | None = None) -> dict[str, Any]:
    """Return the JSON schema of a dataclass's options: types, bounds, units, descriptions and defaults.

    Parameters
    ----------
    cls
        The dataclass. Its `exactly_one`, where it has one, lists groups of options of which one is given.
    schema_for
        Called with each option; returns its schema, or None to have it made here.
    """
    options = options_of(cls)
    own = {key: schema_for(option) if schema_for is not None else None for key, option in options.items()}
    schema: dict[str, Any] = {
        "type": "object",
        "properties": {key: own[key] or option_schema(cls, option) for key, option in options.items()},
        "additionalProperties": False,
    }
    if required := [key for key, option in options.items() if option.required]:
        schema["required"] = required
    if groups := getattr(cls, "exactly_one", ()):
        schema["allOf"] = [{"oneOf": [{"required": [key]} for key in group]} for group in groups]
    return schema
