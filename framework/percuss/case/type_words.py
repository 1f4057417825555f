"""Types of options in words, and the words in which messages show a value that does not fit."""

from __future__ import annotations

import math
import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

from percuss.case.yaml_text import flow
from percuss.errors import nearest
from percuss.methods.interfaces import DataFile, Unit

__all__ = [
    "Expects",
    "advice_for",
    "describe",
    "fact",
    "found",
    "is_union",
    "item_type",
    "without_facts",
]

T = TypeVar("T")


@dataclass(frozen=True)
class Expects:
    """The expected value of an option in words, where its type alone would read badly, and advice for any other."""

    text: str
    advice: str = ""


def is_union(annotation: Any) -> bool:
    """Return whether a type is a union, however written."""
    return get_origin(annotation) in (Union, types.UnionType)


def without_facts(annotation: Any) -> Any:
    """Return an annotation without the facts around it."""
    return annotation.__origin__ if get_origin(annotation) is Annotated else annotation


def _facts(annotation: Any) -> Iterator[Any]:
    """Yield the facts of an annotation, those of a union's branches after its own."""
    if get_origin(annotation) is Annotated:
        yield from annotation.__metadata__
        yield from _facts(annotation.__origin__)
    elif is_union(annotation):
        for branch in get_args(annotation):
            yield from _facts(branch)


# by identity: to hash an annotation takes as long as to walk it; the annotation is kept, so that its id stays its own
_KNOWN: dict[int, tuple[Any, tuple[Any, ...]]] = {}


def fact(annotation: Any, kind: type[T]) -> T | None:
    """Return the first fact of a kind, or None."""
    kept = _KNOWN.get(id(annotation))
    if kept is None:
        kept = _KNOWN[id(annotation)] = (annotation, tuple(_facts(annotation)))
    for one in kept[1]:
        if isinstance(one, kind):
            return one
    return None


def _bounded(noun: str, facts: tuple[Any, ...]) -> str:
    """Return a noun with its bounds and unit: ``a number greater than 0 [length]``."""
    parts = []
    for one in facts:
        for kind, words in (
            ("gt", "greater than"),
            ("ge", "of at least"),
            ("lt", "less than"),
            ("le", "of at most"),
        ):
            limit = getattr(one, kind, None)
            if limit is not None:
                parts.append(f"{words} {limit:g}" if isinstance(limit, int | float) else f"{words} {limit}")
    unit = next((one.unit for one in facts if isinstance(one, Unit)), "1")
    text = f"{noun} {' and '.join(parts)}" if parts else noun
    return text if unit == "1" else f"{text} [{unit}]"


def describe(annotation: Any) -> str:
    """Return what a type expects, in words, with bounds and unit."""
    branches = _branches(annotation, ())
    return branches[0] if len(branches) == 1 else f"{', '.join(branches[:-1])} or {branches[-1]}"


def _branches(annotation: Any, facts: tuple[Any, ...]) -> list[str]:
    """Return what each branch of a type expects; the unit of a union is said once, after its last."""
    if get_origin(annotation) is Annotated:
        said = next((one for one in annotation.__metadata__ if isinstance(one, Expects)), None)
        return [said.text] if said else _branches(annotation.__origin__, (*annotation.__metadata__, *facts))
    if is_union(annotation):
        bare = tuple(one for one in facts if not isinstance(one, Unit))
        types_ = [one for one in get_args(annotation) if one is not type(None)]
        words = [word for one in types_[:-1] for word in _branches(one, bare)]
        return words + _branches(types_[-1], facts)
    if get_origin(annotation) is Literal:
        return [repr(one) if isinstance(one, str) else flow(one) for one in get_args(annotation)]
    if get_origin(annotation) is tuple:
        inner, *rest = get_args(annotation)
        many = {"a number": "numbers", "a whole number": "whole numbers", "a text": "texts"}
        noun = many.get(describe(inner), "values")
        return [_bounded(f"a list of {noun}" if rest == [...] else f"a list of {1 + len(rest)} {noun}", facts)]
    simple = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}
    if annotation in simple:
        return [_bounded(simple[annotation], facts)]
    return ["the path of a CSV file" if annotation is DataFile else str(getattr(annotation, "__name__", annotation))]


def found(value: Any) -> str:
    """Return what stands in the input, short enough for a message."""
    if isinstance(value, str):
        return f"'{value}'" if len(value) <= 60 else f"'{value[:57]}...'"
    text = flow(value)
    if len(text) <= 40:
        return text
    if isinstance(value, Mapping):
        return f"a mapping of {len(value)} entries"
    return f"a list of {len(value)} items" if isinstance(value, tuple) else f"{text[:37]}..."


def words(annotation: Any) -> list[str]:
    """Return the words a type accepts."""
    if get_origin(annotation) is Annotated:
        return words(annotation.__origin__)
    if is_union(annotation):
        return [word for branch in get_args(annotation) for word in words(branch)]
    return [one for one in get_args(annotation) if isinstance(one, str)] if get_origin(annotation) is Literal else []


def has_type(annotation: Any, wanted: type) -> bool:
    """Return whether a type is `wanted`, or a union with it."""
    if get_origin(annotation) is Annotated:
        return has_type(annotation.__origin__, wanted)
    return any(has_type(one, wanted) for one in get_args(annotation)) if is_union(annotation) else annotation is wanted


def item_type(annotation: Any) -> Any:
    """Return the type of the items of a list, or None."""
    if get_origin(annotation) is Annotated:
        return item_type(annotation.__origin__)
    if is_union(annotation):
        return next((one for one in map(item_type, get_args(annotation)) if one is not None), None)
    return {tuple: get_args(annotation)[:1], dict: get_args(annotation)[1:]}.get(get_origin(annotation), (None,))[0]


def advice_for(annotation: Any, value: Any) -> str:
    """Return advice for a value that does not fit an annotation; it may be empty."""
    expects = fact(annotation, Expects)
    if expects is not None and expects.advice:
        return expects.advice
    if isinstance(value, str):
        close = nearest(value, words(annotation))
        if close is not None:
            return f"Did you mean '{close}'?"
    if isinstance(value, float):
        if math.isnan(value):
            return "nan is never a value."
        if math.isinf(value):
            return "Give a finite number."
        if value == int(value) and has_type(annotation, int):
            return f"Write {int(value)}."
    return ""
