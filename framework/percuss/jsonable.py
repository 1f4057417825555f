"""Conversion of values to types that JSON has."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeAlias

Data: TypeAlias = Mapping[str, Any]  # plain data by key: a case, a summary, the options of a method, a row of a table
Entries: TypeAlias = dict[str, Any]  # the same while it is put together
_PLAIN = frozenset({str, int, bool, type(None)})
_NUMBERS_AND_TEXTS = _PLAIN | {float}


def as_lists(value: Any) -> Any:
    """Return nested mappings and sequences with lists in place of tuples; numbers, infinite ones too, stay."""
    if type(value) in _NUMBERS_AND_TEXTS:  # nearly all values
        return value
    if isinstance(value, dict):
        return {key: as_lists(item) for key, item in value.items()}
    return [as_lists(item) for item in value] if isinstance(value, (list, tuple)) else value


def plain(value: Any) -> Any:
    """Return `value` converted to types that JSON has; numbers that are not finite become None."""
    if type(value) in _PLAIN:  # nearly all values
        return value
    if type(value) is float:
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {
            key if type(key) is str else str(key): item if type(item) in _PLAIN else plain(item)
            for key, item in value.items()
        }
    if isinstance(value, (list, tuple)):
        return [item if type(item) in _PLAIN else plain(item) for item in value]
    if hasattr(value, "tolist"):  # a number or an array of numpy
        return plain(value.tolist())
    if isinstance(value, float):  # of a class derived from it
        value = float(value) if math.isfinite(value) else None
    return value if value is None or isinstance(value, (str, int, float)) else str(value)


def infinity_as_text(value: Any) -> Any:
    """Return plain data for JSON, which has no infinities: they are the texts ``inf`` and ``-inf``, and nan is None."""
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    if isinstance(value, dict):
        return {key: infinity_as_text(item) for key, item in value.items()}
    return [infinity_as_text(item) for item in value] if isinstance(value, (list, tuple)) else value
