"""A study as tables on a terminal."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from rich.markup import escape
from rich.table import Table

from percuss.reporting.terminal import _console, _number

if TYPE_CHECKING:
    from percuss.studies.study import Study

BEST = 12
SHOWN = ("force_error_l2", "impulse_error", "displacement_error", "noise", "energy_growth", "steps", "seconds")


def tell_study(study: Study) -> None:
    """Print how many rows have which status, the best of those that are done, and why others are not."""
    console, rows = _console(), study.rows()
    counts = ", ".join(f"{count} {status}" for status, count in study.counts.items())
    found = f", {study.found} found done" if study.found else ""
    console.print(f"[bold]{escape(study.title or 'untitled study')}[/bold]: {len(rows)} runs: {counts}{found}")
    if fragile := sum(row["fragile"] is True for row in rows):
        console.print(f"fragile, as the answer hangs on round-off: {fragile}")
    done = [row for row in rows if row["status"] == "done"]
    measured = [name for name in study.columns if any(_is_number(row[name]) for row in done)]
    if done and measured:
        _tell_best(console, done, measured, list(rows[0]))
    reasons = Counter((row["status"], row["said_by"], row["reason"].split("\n")[0]) for row in rows if row["reason"])
    for (status, said_by, reason), count in reasons.most_common(BEST):
        said = f" (says {said_by})" if said_by else ""
        console.print(f"{count} {status}{escape(said)}: {escape(reason)}")
    if len(reasons) > BEST:
        console.print(f"and {len(reasons) - BEST} other reasons: see the column `reason`")
    console.print(f"rows: {escape(str(study.path))}")


def _tell_best(console: Any, done: list[dict[str, Any]], measured: list[str], keys: list[str]) -> None:
    """Print the rows with the smallest values of the first error measured, else the first rows."""
    by = next((name for name in measured if "error" in name and name != "ledger_error"), "")
    told = [name for name in SHOWN if name in measured] or measured[:6]
    shown = list(dict.fromkeys([*told, "seconds"]))
    if by and by not in shown:
        shown = [by, *shown]
    if not by or len({row["case"] for row in done}) == 1 or len(keys[3 : keys.index("status")]):
        _tell_ranked(console, done, by, shown, keys)
    else:
        _tell_cases(console, done, by)


def _tell_cases(console: Any, done: list[dict[str, Any]], by: str) -> None:
    """Print a line a case and a column a pair of methods."""
    pairs = list(dict.fromkeys((row["integrator"], row["contact"]) for row in done))
    table = Table("case", *(escape(f"{one}\n{two}") for one, two in pairs), title=by)
    found = {(row["case"], row["integrator"], row["contact"]): row[by] for row in done}
    for case in dict.fromkeys(row["case"] for row in done):
        table.add_row(escape(case), *(_number(found.get((case, *pair)), 3) for pair in pairs))
    console.print(table)


def _tell_ranked(console: Any, done: list[dict[str, Any]], by: str, shown: list[str], keys: list[str]) -> None:
    """Print the rows with the smallest values of a measure, else the first."""
    varied = [key for key in keys[3 : keys.index("status")] if len({str(row[key]) for row in done}) > 1]
    cases = ["case"] if len({row["case"] for row in done}) > 1 else []
    heads = [*cases, "integrator", "contact", *varied, *shown]
    table = Table(*(escape(head) for head in heads), title=f"smallest {by}" if by else "first runs")
    # a run without the number is in no ranking by it
    ranked = sorted((row for row in done if _is_number(row[by])), key=lambda row: row[by]) if by else done
    for row in ranked[:BEST]:
        cells = [row[key] for key in heads]
        table.add_row(*(_number(cell, 3 if key in shown else 5) for key, cell in zip(heads, cells, strict=True)))
    console.print(table)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
