"""Hints for the slips that people make most often: what they probably meant, and what to write instead."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from percuss.errors import suggestion
from percuss.methods.blame import SINGULAR

if TYPE_CHECKING:
    from percuss.methods.registry import Registry

PLAIN = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?", re.IGNORECASE)
COMMA = re.compile(r"[-+]?\d+,\d+(e[-+]?\d+)?", re.IGNORECASE)
SHARE = re.compile(r"([-+]?\d+(?:\.\d+)?)\s*%")
WITH_UNIT = re.compile(r"([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[-+]?\d+)?)\s*([^\W\d_%][^\s,;]*)", re.IGNORECASE)
# The pattern of a kind of file, what it is, and what to do with it. Texts are read as YAML where YAML is expected.
BINARY = (
    (rb"\A\x89HDF\r\n\x1a\n", "a NetCDF file, as `percuss run -o` writes", "Read it with `percuss verify {}`."),
    (rb"\ASQLite format 3\0", "a SQLite database, as `percuss study` makes", "Read it with `percuss report {}`."),
)
TEXTS = (
    (rb"(?m)^percuss:", "a case", "Run it with `percuss run {}`."),
    (rb"(?m)^percuss-study:", "a study that was not run", "First run it: `percuss study {}`."),
)


def number_advice(text: str) -> str:
    """Return advice for a text instead of a number: quotes, a comma, a share, a unit; or nothing."""
    if PLAIN.fullmatch(text):
        return f"Write {text} without quotes."
    if COMMA.fullmatch(text):
        return comma_advice(text)
    if share := SHARE.fullmatch(text):
        return f"Write {float(share[1]) / 100:g}."
    if given := WITH_UNIT.fullmatch(text):
        return f"Write {given[1]} alone, without a unit: all numbers of a case are in units that fit together."
    return ""


def comma_advice(text: str) -> str:
    """Return advice for a number with a comma, which also stands between groups of three digits."""
    thousands = f" or {text.replace(',', '')}" if re.fullmatch(r"[-+]?\d{1,3},\d{3}", text) else ""
    return f"Write {text.replace(',', '.')}{thousands}: the decimal mark is a point."


def name_advice(word: str, family: str, *registries: Registry) -> str:
    """Return advice for an unknown name in a family of components: the family that has it, or the nearest name."""
    for other in (other for registry in registries for other, name in registry.components if name == word):
        kind = SINGULAR[other]
        return f"'{word}' is {'an' if kind[0] in 'aeiou' else 'a'} {kind}: name it as the {kind}."
    return suggestion(word, {name for registry in registries for name in registry.names(family)})


def file_advice(name: str, content: bytes, *, texts: bool = False) -> tuple[str, str] | None:
    """Return what a file of another kind is, and advice; None if that is not known.

    With `texts` cases and studies are recognised too.
    """
    for pattern, kind, advice in (*BINARY, *(TEXTS if texts else ())):
        if re.search(pattern, content):
            return kind, advice.format(name)
    return None
