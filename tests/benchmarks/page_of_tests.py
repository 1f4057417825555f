"""Tables of programs that measure, on the page of the tests."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable, Sequence
from datetime import date
from pathlib import Path

PAGE = Path(__file__).resolve().parents[1] / "README.md"


def machine() -> str:
    """Return when and where a table was made."""
    where = f"{platform.machine()} with {os.cpu_count()} cores, Python {platform.python_version()}"
    return f"Made on {date.today().isoformat()} on {where}."


def table(rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown; the first row is its head."""
    head, *rest = rows
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, ["---"] * len(head), *rest))


def write(part: str, text: str) -> None:
    """Write the part of the page between the marks of its name."""
    first, last = f"<!-- {part} -->\n", f"<!-- end of {part} -->\n"
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(first)
    PAGE.write_text(before + first + text + last + rest.partition(last)[2], encoding="utf-8")
