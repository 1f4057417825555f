"""Values of a study's table as numbers, as texts and as labels, and the pair of methods of each row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.studies import perform

if TYPE_CHECKING:
    import pandas as pd

WAITING = perform.WAITING
# What is shown of several runs of one pair of methods.
STATISTICS: dict[str, Callable[[Any], Any]] = {"best": np.min, "median": np.median}


def numbers(column: Any) -> Any:
    """Return a column as float64 with nan for missing values, or None if it holds anything but numbers."""
    present = [] if column.dtype.kind in "iuf" else column[column.notna()]
    if not all(isinstance(v, (int, float, np.number)) and not isinstance(v, (bool, np.bool_)) for v in present):
        return None
    return column.to_numpy(dtype=float, na_value=np.nan)


def as_text(value: object) -> str:
    """Return a value of the table as text that reads back as the same value; an empty text for a missing value."""
    if value is None or (isinstance(value, (float, np.floating)) and np.isnan(value)):
        return ""
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    # repr gives the fewest digits that read back as the same double; the .0 of a whole number is superfluous.
    return repr(float(value)).removesuffix(".0") if isinstance(value, (float, np.floating)) else str(value)


def as_label(text: str) -> str:
    """Return the label of a text from `as_text`: a number with six digits, any other text unchanged."""
    try:
        return f"{float(text):.6g}" if text.strip() == text and text[:1] in "-.0123456789" else text
    except ValueError:
        return text


def texts(column: Any) -> list[str]:
    """Return the values of a column as texts, empty for missing values."""
    values = column.tolist()
    if set(map(type, values)) <= {str}:
        return list(values)  # as most columns of words are: a large table is read many times for a page
    return [
        "" if is_missing else value if type(value) is str else as_text(value)
        for value, is_missing in zip(values, column.isna().tolist(), strict=True)
    ]


def methods(table: pd.DataFrame) -> list[str]:
    """Return the pair of methods of each row as one text: integrator + contact law."""
    pairs = zip(texts(table["integrator"]), texts(table["contact"]), strict=True)
    return [f"{integrator} + {contact}" for integrator, contact in pairs]


def groups(*keys: Sequence[str]) -> dict[tuple[str, ...], Any]:
    """Return the row numbers of each combination of texts, in the order in which the combinations appear."""
    out: dict[tuple[str, ...], list[int]] = {}
    for row, key in enumerate(zip(*keys, strict=True)):
        out.setdefault(key, []).append(row)
    return {key: np.array(rows) for key, rows in out.items()}


def in_order(values: Sequence[str]) -> list[str]:
    """Return the distinct texts in order: numbers by value, then words, then the empty text."""

    def rank(value: str) -> tuple[int, float, str]:
        try:
            return (0, float(value), value)
        except ValueError:
            return (2 if value == "" else 1, 0.0, value)

    return sorted(set(values), key=rank)
