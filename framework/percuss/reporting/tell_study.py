"""Printing of a study as tables on a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from percuss.case.quantities import STUDY_TABLE, ranking
from percuss.reporting.tables import Column, plain_text, print_table
from percuss.reporting.tables import console as console_of_output
from percuss.reporting.terminal import _number
from percuss.reporting.verdict import is_number, value_text

if TYPE_CHECKING:
    from percuss.studies.study_table import Study

BEST = 12


def tell_study(study: Study) -> None:
    """Print the number of rows with each status, and the best of the done rows."""
    console, rows = console_of_output(), study.as_records()
    counts = ", ".join(f"{count} {status}" for status, count in study.counts.items())
    resumed = f", {study.found} found done" if study.found else ""
    console.print(f"[bold]{plain_text(study.title or 'untitled study')}[/bold]: {len(rows)} runs: {counts}{resumed}")
    done = [row for row in rows if row["status"] == "done"]
    measured = [name for name in study.columns if any(is_number(row[name]) for row in done)]
    if done and measured:
        _print_best_runs(console, done, measured, list(rows[0]))
    for name, without in _without_value(study, done).items():
        console.print(
            f"no value of {plain_text(name)} in {without} of {len(done)} done: {plain_text(study.columns[name])}"
        )
    console.print(f"rows: {plain_text(str(study.path))}")


def _without_value(study: Study, done: list[dict[str, Any]]) -> dict[str, int]:
    """Return in how many of the done rows each measure of a time has no value, as they end before it; without zeros."""
    asked = [one for one in study.spec.get("measure") or () if isinstance(one, dict) and {"during", "at"} & one.keys()]
    counts = {one["name"]: sum(row[one["name"]] is None for row in done) for one in asked}
    return {name: count for name, count in counts.items() if count}


def _print_best_runs(console: Any, done: list[dict[str, Any]], measured: list[str], keys: list[str]) -> None:
    """Print the done rows by the first measured error, as a table of cases and pairs or as a ranking."""
    error = next(iter(ranking(measured)), "")
    usual = [name for name in STUDY_TABLE if name in measured] or measured[:6]
    shown = list(dict.fromkeys([*usual, "seconds"]))
    if error and error not in shown:
        shown = [error, *shown]
    if not error or len({row["case"] for row in done}) == 1 or len(keys[3 : keys.index("status")]):
        _print_ranked(console, done, error, shown, keys)
    else:
        _print_cases(console, done, error)


def _print_cases(console: Any, done: list[dict[str, Any]], error: str) -> None:
    """Print one measure as a table with one line per case and one column per pair of methods."""
    pairs = list(dict.fromkeys((row["integrator"], row["contact"]) for row in done))
    value_of = {(row["case"], row["integrator"], row["contact"]): row[error] for row in done}
    cases = list(dict.fromkeys(row["case"] for row in done))
    columns = [Column("case", cases, is_number=False)]
    columns += [
        Column(
            f"{integrator} {contact}", [value_text(error, value_of.get((case, integrator, contact))) for case in cases]
        )
        for integrator, contact in pairs
    ]
    print_table(console, columns, error, continued=1)


def _print_ranked(console: Any, done: list[dict[str, Any]], error: str, shown: list[str], keys: list[str]) -> None:
    """Print the rows with the smallest values of an error, or the first rows where no error was measured."""
    varied = [key for key in keys[3 : keys.index("status")] if len({str(row[key]) for row in done}) > 1]
    cases = ["case"] if len({row["case"] for row in done}) > 1 else []
    # A run without a number for the error cannot be ranked by it.
    ranked = sorted((row for row in done if is_number(row[error])), key=lambda row: row[error]) if error else done
    best = ranked[:BEST]
    columns = [
        Column(head, [_number(row[head]) for row in best], is_number=False)
        for head in (*cases, "integrator", "contact")
    ]
    columns += [Column(head, [_number(row[head], 5) for row in best]) for head in varied]
    columns += [
        Column(head, [value_text(head, row[head]) for row in best], drop=None if head == error else rank)
        for rank, head in enumerate(shown)
    ]
    print_table(console, columns, f"smallest {error}" if error else "first runs")
