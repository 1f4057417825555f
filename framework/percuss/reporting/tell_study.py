"""What is printed of a study."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from percuss.case.quantities import STUDY_TABLE, ranking
from percuss.jsonable import Data, Entries
from percuss.reporting.tables import Column, Piece, Table, Unbroken, words
from percuss.reporting.terminal import number_text
from percuss.reporting.verdict import is_number, value_text

if TYPE_CHECKING:
    from percuss.studies.study_table import Study

BEST = 12


def study_lines(study: Study) -> Iterator[Piece]:
    """Yield the number of rows with each status, and the best of the done rows."""
    rows = study.as_records()
    counts = ", ".join(f"{count} {status}" for status, count in study.counts.items())
    resumed = f", {study.found} found done" if study.found else ""
    yield (study.title or "untitled study", "bold"), f": {len(rows)} runs: {counts}{resumed}"
    done = [row for row in rows if row["status"] == "done"]
    measured = [name for name in study.columns if any(is_number(row[name]) for row in done)]
    if done and measured:
        yield _best_runs(done, measured, list(rows[0]))
    for name, without in _without_value(study, done).items():
        yield f"no value of {name} in {without} of {len(done)} done: {study.columns[name]}"
    yield Unbroken(f"rows: {study.path}")


def _without_value(study: Study, done: list[Entries]) -> dict[str, int]:
    """Return in how many of the done rows each measure of a time has no value, as they end before it; without zeros."""
    asked = [one for one in study.spec.get("measure") or () if isinstance(one, dict) and {"during", "at"} & one.keys()]
    counts = {one["name"]: sum(row[one["name"]] is None for row in done) for one in asked}
    return {name: count for name, count in counts.items() if count}


def _best_runs(done: Sequence[Data], measured: list[str], keys: list[str]) -> Table:
    """Return the done rows by the first measured error, as a table of cases and pairs or as a ranking."""
    error = next(iter(ranking(measured)), "")
    varied = keys[3 : keys.index("status")]
    several = len({row["case"] for row in done}) > 1
    if error and several and not varied:
        return _cases(done, error)
    usual = [name for name in STUDY_TABLE if name in measured] or measured[:6]
    shown = list(dict.fromkeys([*([error] if error and error not in usual else []), *usual, "seconds"]))
    # A run without a number for the error cannot be ranked by it.
    ranked = sorted((row for row in done if is_number(row[error])), key=lambda row: row[error]) if error else done
    best = ranked[:BEST]
    columns = [
        words(head, (number_text(row[head]) for row in best))
        for head in (*(["case"] if several else []), "integrator", "contact")
    ]
    columns += [
        Column(head, [number_text(row[head], 5) for row in best])
        for head in varied
        if len({str(row[head]) for row in done}) > 1
    ]
    columns += [
        Column(head, [value_text(head, row[head]) for row in best], drop=None if head == error else rank)
        for rank, head in enumerate(shown)
    ]
    return Table(columns, f"smallest {error}" if error else "first runs")


def _cases(done: Sequence[Data], error: str) -> Table:
    """Return one measure as a table with one line per case and one column per pair of methods."""
    value_of = {(row["case"], row["integrator"], row["contact"]): row[error] for row in done}
    cases = list(dict.fromkeys(case for case, *_ in value_of))
    columns = [words("case", cases)]
    for pair in dict.fromkeys((integrator, contact) for _, integrator, contact in value_of):
        cells = [value_text(error, value_of.get((case, *pair))) for case in cases]
        columns.append(Column(" ".join(pair), cells))
    return Table(columns, error, continued=1)
