"""Reading of numbers from the CSV files that a case names."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from percuss.case.options import LARGEST_NUMBER
from percuss.files import found_instead
from percuss.methods.interfaces import DataFile

MAX_BYTES = 100_000_000  # of a file
COLUMNS_OF_NUMBERS = 2  # A file of no more columns holds numbers alone: times and values.

# Python's own `float` accepts too much: also 1_0 for 10, digits of other scripts, and words.
NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
NOT_FINITE = re.compile(r"[-+]?(?:nan|inf|infinity)", re.IGNORECASE)
LIKE_A_NUMBER = re.compile(rf"[-+]?\.?[0-9]|(?:{NOT_FINITE.pattern})\Z", re.IGNORECASE)
BLANKS = " \t"
BETWEEN_FIELDS = re.compile("(?<=[^ \t])[ \t]")
LINE_END = re.compile(r"\r\n|\n|\r")  # The method `splitlines` would also break lines at form feeds and the like.


class UnusableFileError(ValueError):
    """A file that cannot be read, with advice what to do."""

    def __init__(self, message: str, advice: str = "") -> None:
        super().__init__(message)
        self.advice = advice


def read_bytes(path: str, folder: Path, kind: str, advice: str) -> bytes:
    """Return the contents of a file at a path as written in a case, relative to `folder`; `kind` says what it holds.

    Raises
    ------
    UnusableFileError
        If there is no such file, or it is far too large.
    """
    file = folder / path
    if other := found_instead(file):
        raise UnusableFileError(f"expected a file of {kind}, found {other}: {file}", advice)
    try:
        with file.open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise UnusableFileError(f"no such file: {file}", "The path is relative to the case.") from None
    except (OSError, ValueError) as error:
        raise UnusableFileError(f"cannot read {file}: {getattr(error, 'strerror', None) or error}") from None
    if len(content) > MAX_BYTES:
        message = f"expected at most {MAX_BYTES // 1_000_000} MB of {kind}, found more: {file}"
        raise UnusableFileError(message, "Keep less of it.")
    return content


def read_text(path: str, folder: Path) -> str:
    """Return the text of a file of numbers at a path as written in a case, relative to `folder`.

    Raises
    ------
    UnusableFileError
        If there is no such file, or it is not text in UTF-8, or far too large.
    """
    content, file = read_bytes(path, folder, "numbers", "Name a CSV file."), folder / path
    try:
        text, wrong = content.decode("utf-8-sig"), content.find(b"\0")  # which UTF-16 has
    except UnicodeDecodeError as error:
        text, wrong = "", error.start
    if wrong >= 0:
        line = content.count(b"\n", 0, wrong) + 1
        raise UnusableFileError(f"{file}:{line}: not UTF-8 text", "Save the file as UTF-8.")
    return text


def table_in(text: str, path: str) -> DataFile:
    """Return the numbers in the text of a CSV file.

    Fields are separated by semicolons where the file has any, else by commas where it has any, else by blanks. Empty
    lines and lines that begin with ``#`` are skipped; a first line in which no field begins like a number names the
    columns if it has as many fields. In a file of more than two columns, some may hold other things than numbers.

    Parameters
    ----------
    text
        Text of the file.
    path
        Path as written in a case.

    Returns
    -------
    DataFile
        Table with one row for each column of the file.

    Raises
    ------
    ValueError
        If a field of a file of one or two columns is not a finite number, with line and column; or if lines have unlike
        numbers of fields, or there are none.
    """
    rows: list[list[float]] = []
    names: tuple[str, ...] = ()
    lines: list[int] = []
    faults: dict[int, str] = {}
    for position, (line, fields) in enumerate(_lines(text)):
        if position == 0 and not any(LIKE_A_NUMBER.match(field.strip(BLANKS)) for field in fields):
            names = tuple(field.strip(BLANKS).strip('"') for field in fields)
            continue
        row = _numbers(fields, f"{path}:{line}", faults)
        if rows and len(row) != len(rows[0]):
            raise ValueError(f"{path}:{line}:1: expected {len(rows[0])} columns as above, found {len(row)}")
        rows.append(row)
        lines.append(line)
    if not rows:
        raise ValueError(f"{path} holds no numbers")
    numbers = np.ascontiguousarray(np.array(rows).T)
    numbers[list(faults)] = np.nan
    numbers.flags.writeable = False
    names = names if len(names) == len(numbers) else ()  # as of a title, or of names with blanks between blanks
    return DataFile(path, numbers, names, tuple(lines), faults)


def _lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number and the fields, with blanks, of each line that is neither empty nor a comment."""
    numbered = enumerate(LINE_END.split(text), start=1)
    lines = [(number, line) for number, line in numbered if line.strip(BLANKS) and line.lstrip(BLANKS)[0] != "#"]
    # The whole file has one separator; otherwise 0,5;1,0 with decimal commas would be four numbers.
    separator = next((mark for mark in (";", ",") if any(mark in line for _, line in lines)), "")
    if not separator and all("\t" in line.strip(BLANKS) for _, line in lines):
        separator = "\t"  # else tabs are blanks like others
    for number, line in lines:
        # The blanks before a field are its own, by which its column is known.
        yield number, line.split(separator) if separator else BETWEEN_FIELDS.split(line.rstrip(BLANKS))


def _numbers(fields: list[str], place: str, faults: dict[int, str]) -> list[float]:
    """Return the numbers in the fields of a line; where a column is not of numbers, add to `faults` what is wrong."""
    row = [math.nan] * len(fields)
    for index, field in enumerate(fields):
        if index in faults:
            continue
        try:
            row[index] = _number(field.strip(BLANKS))
        except ValueError as error:
            column = 1 + sum(len(before) + 1 for before in fields[:index]) + len(field) - len(field.lstrip(BLANKS))
            fault = f"{place}:{column}: {error}"
            if len(fields) <= COLUMNS_OF_NUMBERS:
                raise ValueError(fault) from None
            faults[index] = fault
    return row


def _number(text: str) -> float:
    """Return the number in a field; raise ValueError if it is not a finite number."""
    if NUMBER.fullmatch(text) is None:
        if NOT_FINITE.fullmatch(text):
            raise ValueError(f"expected a finite number, found '{text}'")
        shown = f"'{text}'" if text else "nothing"
        raise ValueError(f"expected a number as 1.5 or 2e-3, found {shown}")
    value = float(text)
    if abs(value) > LARGEST_NUMBER:
        raise ValueError(f"expected a number of at most {LARGEST_NUMBER:g} in size, found '{text}', which is too large")
    return value
