"""The one grammar of varied values: ``1,2,5``, ``0:1:11``, ``0.01:100:log:30``."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from percuss.case.csv_file import NOT_FINITE, NUMBER
from percuss.errors import InputError, Problem

WHOLE = re.compile(r"[-+]?[0-9]{1,4000}")
MOST = 1_000_000
GRAMMAR = "write values as 1,2,5, a range as 0:1:11, a logarithmic range as 0.01:100:log:30"


def values(text: str, place: str = "--vary") -> list[Any]:
    """Return the values that `text` stands for.

    Parameters
    ----------
    text
        A list, a range (first:last:count) or a logarithmic range (first:last:log:count), both ends included.
    place
        Where it was given, for the message.

    Raises
    ------
    InputError
        If it is none of these.
    """
    parts = text.split(":")
    if len(parts) == 1:
        items = [item.strip() for item in text.split(",")]
        if not all(items):
            raise _wrong(place, f"expected values, found '{text}'")
        return [_number(item) for item in items]
    log = len(parts) == 4 and parts[2].strip() == "log"
    if not (len(parts) == 3 or log):
        raise _wrong(place, f"expected a range, found '{text}'")
    first, last, count = _number(parts[0]), _number(parts[1]), _number(parts[-1])
    if isinstance(first, str) or isinstance(last, str) or not isinstance(count, int) or count < 1:
        raise _wrong(place, f"expected numbers and a count of at least 1, found '{text}'")
    if count > MOST:
        raise _wrong(place, f"expected at most {MOST} values, found {count}")
    if log and not (first > 0 and last > 0):
        raise _wrong(place, f"expected ends above 0 for a logarithmic range, found '{text}'")
    if log:
        return [float(x) for x in np.geomspace(first, last, count)]
    return [float(x) for x in np.linspace(first, last, count)]


def varied(given: list[str], option: str = "--vary") -> dict[str, list[Any]]:
    """Return path to values for each ``PATH=VALUES`` in `given`.

    Raises
    ------
    InputError
        If one of them is not of that form.
    """
    out: dict[str, list[Any]] = {}
    for item in given:
        path, equals, text = item.partition("=")
        if not equals or not path:
            raise _wrong(option, f"expected PATH=VALUES, found '{item}'")
        if path.strip() in out:
            raise InputError(
                [Problem(option, "", f"expected a path once, found {path.strip()} twice", "Join the values.")]
            )
        out[path.strip()] = values(text, f"{option} {path.strip()}")
    return out


def _number(text: str) -> Any:
    """Return the number that a text is, as strictly as tables are read; any other text as it stands."""
    text = text.strip()
    if WHOLE.fullmatch(text):
        return int(text)
    return float(text) if NUMBER.fullmatch(text) or NOT_FINITE.fullmatch(text) else text


def _wrong(place: str, message: str) -> InputError:
    return InputError([Problem(place, "", message, f"{GRAMMAR[0].upper()}{GRAMMAR[1:]}.")])
