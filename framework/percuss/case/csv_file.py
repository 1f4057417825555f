"""Numbers from CSV files that a case names."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from percuss.methods.interfaces import DataFile

__all__ = ["read_table"]

# Python's own `float` is too kind: it also takes 1_0 for 10, digits of other scripts, and words.
NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
NOT_FINITE = re.compile(r"[-+]?(?:nan|inf|infinity)", re.IGNORECASE)
BEGINS_AS_NUMBER = re.compile(r"[-+]?\.?[0-9]")
LINE_END = re.compile(r"\r\n|\n|\r")  # `splitlines` would also break lines at form feeds and the like


class _Field(NamedTuple):
    """One field of a line: its text without blanks around it, and the column at which that begins."""

    text: str
    column: int

    @property
    def looks_like_a_number(self) -> bool:
        return bool(BEGINS_AS_NUMBER.match(self.text) or NOT_FINITE.fullmatch(self.text))


def read_table(path: str, folder: Path) -> DataFile:
    """Return the numbers of a CSV file.

    Fields are separated by commas, or by semicolons where the file has any. Empty lines and lines that begin with
    ``#`` are skipped, and so is a first line of which no field begins as a number does.

    Parameters
    ----------
    path
        As written in a case.
    folder
        Folder it is relative to.

    Returns
    -------
    DataFile
        With one row for each column of the file.

    Raises
    ------
    ValueError
        If there is no such file, or something in it is not a finite number; with line and column.
    """
    try:
        text = (folder / path).read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise ValueError(f"no such file: {folder / path}") from None
    except (OSError, ValueError) as error:
        raise ValueError(f"cannot read {folder / path}: {getattr(error, 'strerror', None) or error}") from None
    rows: list[list[float]] = []
    for position, (line, fields) in enumerate(_lines(text)):
        if position == 0 and not any(field.looks_like_a_number for field in fields):
            continue  # the header
        row = [_number(field, f"{path}:{line}:{field.column}") for field in fields]
        if rows and len(row) != len(rows[0]):
            raise ValueError(f"{path}:{line}:1: expected {len(rows[0])} columns as above, found {len(row)}")
        rows.append(row)
    if not rows:
        raise ValueError(f"{path} holds no numbers")
    table = np.ascontiguousarray(np.array(rows).T)
    table.flags.writeable = False
    return DataFile(path, table)


def _lines(text: str) -> Iterator[tuple[int, list[_Field]]]:
    """Yield number and fields of each line that is neither empty nor a comment."""
    lines = [(number, line) for number, line in enumerate(LINE_END.split(text), start=1)]
    lines = [(number, line) for number, line in lines if line.strip(" \t") and not line.lstrip(" \t").startswith("#")]
    # One separator for the whole file: with decimal commas, 0,5;1,0 would otherwise be four numbers.
    separator = ";" if any(";" in line for _, line in lines) else ","
    for number, line in lines:
        fields, column = [], 1
        for part in line.split(separator):
            indent = len(part) - len(part.lstrip(" \t"))
            fields.append(_Field(part.strip(" \t"), column + indent))
            column += len(part) + 1
        yield number, fields


def _number(field: _Field, place: str) -> float:
    """Return the number in a field; raise ValueError with its place where there is none."""
    if NUMBER.fullmatch(field.text) is None:
        if NOT_FINITE.fullmatch(field.text):
            raise ValueError(f"{place}: expected a finite number, found '{field.text}'")
        found = f"'{field.text}'" if field.text else "nothing"
        raise ValueError(f"{place}: expected a number as 1.5 or 2e-3, found {found}")
    value = float(field.text)
    if not math.isfinite(value):
        raise ValueError(f"{place}: expected a finite number, found '{field.text}', which is too large")
    return value
