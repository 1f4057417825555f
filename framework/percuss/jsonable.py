"""Conversion of values to types that JSON has."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

Data: TypeAlias = Mapping[str, Any]  # plain data by key: a case, a summary, the options of a method, a row of a table
Entries: TypeAlias = dict[str, Any]  # the same while it is put together


def as_lists(value: Any) -> Any:
    """Return nested mappings and sequences with lists in place of tuples; numbers, infinite ones too, stay."""
    return _converted(value, lambda item: item)


def plain(value: Any) -> Any:
    """Return `value` converted to types that JSON has; numbers that are not finite become None."""
    return _converted(value, _plain)


def infinity_as_text(value: Any) -> Any:
    """Return plain data for JSON, which has no infinities: they are the texts ``inf`` and ``-inf``, and nan is None."""
    return _converted(value, _finite_or_text)


def _converted(value: Any, convert: Callable[[Any], Any]) -> Any:
    """Return nested mappings and sequences as dictionaries and lists, with converted values."""
    if isinstance(value, dict):
        return {str(key): _converted(item, convert) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_converted(item, convert) for item in value]
    return convert(value)


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if value is None or isinstance(value, (str, int)):
        return value
    return plain(value.tolist()) if hasattr(value, "tolist") else str(value)  # numbers and arrays of numpy have it


def _finite_or_text(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value
