"""Varied parameters: the grammar of their values, and the points of a study in their space.

Values are written ``1,2,5``, ``0:1:11``, ``0.01:100:log:30``. Points are all combinations of varied values,
points whose values go together, and points drawn from a box.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence

import numpy as np

from percuss.case.csv_file import NOT_FINITE, NUMBER
from percuss.case.options import LARGEST_NUMBER
from percuss.errors import InputError, shortened, wrong_input
from percuss.jsonable import Data, Entries
from percuss.studies.layout import SampleSection

WHOLE = re.compile(r"[-+]?[0-9]{1,4000}")
MOST = 1_000_000
GRAMMAR = "write values as 1,2,5, a range as 0:1:11, a logarithmic range as 0.01:100:log:30"


def values(text: str, place: str = "--vary") -> list[int | float | str]:
    """Return the values that `text` describes.

    Parameters
    ----------
    text
        A list, a range (first:last:count) or a logarithmic range (first:last:log:count), both ends included.
    place
        Option or path where the text was given, for the message.

    Raises
    ------
    InputError
        If the text is none of these.
    """
    parts = text.split(":")
    if len(parts) == 1:
        items = [item.strip() for item in text.split(",")]
        if not all(items):
            raise _grammar_error(place, f"expected values, found '{text}'")
        return [_number(item) for item in items]
    log = len(parts) == 4 and parts[2].strip() == "log"
    if not (len(parts) == 3 or log):
        raise _grammar_error(place, f"expected a range, found '{text}'")
    first, last, count = _number(parts[0]), _number(parts[1]), _number(parts[-1])
    if isinstance(first, str) or isinstance(last, str) or not isinstance(count, int) or not 1 <= count <= MOST:
        raise _grammar_error(place, f"expected numbers and a count of 1 to {MOST}, found '{text}'")
    if not (abs(first) <= LARGEST_NUMBER and abs(last) <= LARGEST_NUMBER):
        message = f"expected ends of at most {LARGEST_NUMBER:g} in size, found '{shortened(text, 60)}'"
        raise _grammar_error(place, message)
    if log and not (first > 0 and last > 0):
        raise _grammar_error(place, f"expected ends above 0 for a logarithmic range, found '{text}'")
    return [float(x) for x in (np.geomspace if log else np.linspace)(first, last, count)]


def varied(given: list[str], option: str = "--vary") -> dict[str, list[int | float | str]]:
    """Return path to values for each ``PATH=VALUES`` in `given`.

    Raises
    ------
    InputError
        If an entry is not of that form, or a path is given twice.
    """
    out: dict[str, list[int | float | str]] = {}
    for item in given:
        path, equals, text = item.partition("=")
        if not equals or not path:
            raise _grammar_error(option, f"expected PATH=VALUES, found '{item}'")
        if path.strip() in out:
            raise wrong_input(option, f"expected a path once, found {path.strip()} twice", "Join the values.")
        out[path.strip()] = values(text, f"{option} {path.strip()}")
    return out


def _number(text: str) -> int | float | str:
    """Return the number written in a text, by the same strict rules as in tables; return other text unchanged."""
    text = text.strip()
    if WHOLE.fullmatch(text):
        return int(text)
    return float(text) if NUMBER.fullmatch(text) or NOT_FINITE.fullmatch(text) else text


def _grammar_error(place: str, message: str) -> InputError:
    return wrong_input(place, message, f"{GRAMMAR[0].upper()}{GRAMMAR[1:]}.")


def combinations(
    varied: Mapping[str, Sequence[object]], paired: Sequence[Data] = (), sample: SampleSection | None = None
) -> list[Entries]:
    """Return all combinations of the varied values, each with every paired point and every drawn point.

    Raises
    ------
    InputError
        If there are more than `MOST`.
    """
    varied = {path: list(values) for path, values in varied.items()}
    count = math.prod(map(len, varied.values())) * max(len(paired), 1) * (sample.count if sample is not None else 1)
    if count > MOST:
        message = f"expected at most {MOST} combinations of values, found {count}"
        raise wrong_input("--vary", message, "Vary fewer values.")
    grid = [dict(zip(varied, values, strict=True)) for values in itertools.product(*varied.values())]
    drawn: Sequence[Data] = sample.points() if sample is not None else [{}]
    return [
        {**grid_point, **paired_point, **drawn_point}
        for grid_point in grid
        for paired_point in (paired or [{}])
        for drawn_point in drawn
    ]
