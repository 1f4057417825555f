"""Types of options in words, and the words in which messages show a value that does not fit."""

from __future__ import annotations

import math
import types
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

from percuss.case.hints import number_advice
from percuss.case.yaml_text import flow
from percuss.errors import nearest, shortened
from percuss.methods.interfaces import DataFile, Ge, MeshFile, Unit

T = TypeVar("T")
LIMITS = {"gt": "greater than", "ge": "of at least", "lt": "less than", "le": "of at most"}


@dataclass(frozen=True)
class Expects:
    """The expected value of an option in words, where its type alone would read badly, and advice for any other."""

    text: str
    advice: str = ""


def is_union(annotation: object) -> bool:
    """Return whether a type is a union, however written."""
    return get_origin(annotation) in (Union, types.UnionType)


def branches(annotation: Any) -> Iterator[Any]:
    """Yield the types that an annotation allows, without its facts: each branch of a union by itself."""
    if get_origin(annotation) is Annotated:
        yield from branches(annotation.__origin__)
    elif is_union(annotation):
        for branch in get_args(annotation):
            yield from branches(branch)
    else:
        yield annotation


def _facts(annotation: Any) -> Iterator[Any]:
    """Yield the facts of an annotation, and after its own those of the branches of a union."""
    if get_origin(annotation) is Annotated:
        yield from annotation.__metadata__
        yield from _facts(annotation.__origin__)
    elif is_union(annotation):
        for branch in get_args(annotation):
            yield from _facts(branch)


def fact(annotation: object, kind: type[T]) -> T | None:
    """Return the first fact of a kind, or None."""
    return next((fact for fact in _facts(annotation) if isinstance(fact, kind)), None)


def _limits(facts: Iterable[object]) -> Iterator[tuple[str, Any]]:
    """Yield the kind of each limit among the facts of an annotation, and the limit."""
    for fact in facts:
        yield from ((kind, limit) for kind in LIMITS if (limit := getattr(fact, kind, None)) is not None)


def bounds(annotation: object) -> tuple[float, float, bool, bool]:
    """Return the lower and the upper bound of an annotation, and whether each bound is itself an allowed value."""
    low, high, at_low, at_high = -math.inf, math.inf, True, True
    for kind, limit in _limits(_facts(annotation)):
        if kind in ("gt", "ge"):
            low, at_low = float(limit), kind == "ge"
        else:
            high, at_high = float(limit), kind == "le"
    return low, high, at_low, at_high


def item_type(annotation: object) -> Any:
    """Return the type of the items of a list, or of the values of a mapping, or None."""
    items = {tuple: 0, dict: 1}
    containers = (branch for branch in branches(annotation) if get_origin(branch) in items)
    return next((get_args(branch)[items[get_origin(branch)]] for branch in containers), None)


def _bounded(noun: str, facts: tuple[object, ...]) -> str:
    """Return a noun with its bounds and unit, as ``a number greater than 0 [length]``."""
    bounds = [
        f"{LIMITS[kind]} {limit:g}" if isinstance(limit, int | float) else f"{LIMITS[kind]} {limit}"
        for kind, limit in _limits(facts)
    ]
    unit = next((fact.unit for fact in facts if isinstance(fact, Unit)), "1")
    text = f"{noun} {' and '.join(bounds)}" if bounds else noun
    return text if unit == "1" else f"{text} [{unit}]"


def describe(annotation: object) -> str:
    """Return the expected value of a type in words, with bounds and unit."""
    *first, last = _phrases(annotation, ())
    return f"{', '.join(first)} or {last}" if first else last


def _phrases(annotation: Any, facts: tuple[object, ...]) -> list[str]:
    """Return the expected value of each branch of a type; a unit of the whole union stands after the last branch."""
    if get_origin(annotation) is Annotated:
        expects = next((fact for fact in annotation.__metadata__ if isinstance(fact, Expects)), None)
        return [expects.text] if expects else _phrases(annotation.__origin__, (*annotation.__metadata__, *facts))
    if is_union(annotation):
        without_unit = tuple(fact for fact in facts if not isinstance(fact, Unit))
        *first, last = [branch for branch in get_args(annotation) if branch is not type(None)]
        return [phrase for branch in first for phrase in _phrases(branch, without_unit)] + _phrases(last, facts)
    if get_origin(annotation) is Literal:
        return [repr(value) if isinstance(value, str) else flow(value) for value in get_args(annotation)]
    if get_origin(annotation) is tuple:
        inner, *rest = get_args(annotation)
        plurals = {"a number": "numbers", "a whole number": "whole numbers", "a text": "texts"}
        noun = plurals.get(describe(inner), "values")
        return [_bounded(f"a list of {noun}" if rest == [...] else f"a list of {1 + len(rest)} {noun}", facts)]
    nouns = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}
    if annotation in nouns:
        return [_bounded(nouns[annotation], facts)]
    files = {DataFile: "the path of a CSV file", MeshFile: "the path of a mesh file of gmsh"}
    return [files.get(annotation) or str(getattr(annotation, "__name__", annotation))]


def found(value: object) -> str:
    """Return a value as the input has it, short enough for a message."""
    if isinstance(value, str):
        return f"'{shortened(value, 60)}'"
    text = flow(_rounded(value))
    if len(text) > 40 and isinstance(value, Mapping):
        return f"a mapping of {len(value)} entries"
    return f"a list of {len(value)} items" if len(text) > 40 and isinstance(value, tuple) else shortened(text, 40)


def _rounded(value: object) -> Any:
    """Return a value whose numbers have twelve digits at most."""
    if isinstance(value, float):
        return float(f"{value:.12g}")
    return tuple(map(_rounded, value)) if isinstance(value, tuple) else value


def advice_for(annotation: object, value: object) -> str:
    """Return advice for a value that does not fit an annotation; it may be empty."""
    expects = fact(annotation, Expects)
    if expects is not None and expects.advice:
        return expects.advice
    if isinstance(value, str):
        literals = [branch for branch in branches(annotation) if get_origin(branch) is Literal]
        close = nearest(value, [word for literal in literals for word in get_args(literal) if isinstance(word, str)])
        if close is not None:
            return f"Did you mean '{close}'?"
        return number_advice(value) if {int, float} & set(branches(annotation)) else ""
    return _float_advice(annotation, value) if isinstance(value, float) else ""


def _float_advice(annotation: object, value: float) -> str:
    """Return advice for a number that is infinite, not a number, or whole but not written so; else nothing."""
    if math.isnan(value):
        return "nan is never a value."
    if math.isinf(value) and {int, float} & set(branches(annotation)):
        return "Give a finite number."
    least = fact(annotation, Ge)
    if value.is_integer() and int in branches(annotation) and (least is None or value >= least.ge):  # type: ignore[operator]
        return f"Write {int(value)}."
    return ""
