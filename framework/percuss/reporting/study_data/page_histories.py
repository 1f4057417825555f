"""Histories of some runs of a study, thinned and packed for a page."""

from __future__ import annotations

import base64
import itertools
from typing import Any

import numpy as np

from percuss.reporting.figures import thinned
from percuss.reporting.study_data.roles import StudyLike
from percuss.reporting.study_data.values import methods, numbers, texts

MOST_HISTORIES = 120

MOST_LETTERS = 2_000_000  # The histories of a page may take this many letters of base64.

MOST_ASKED = 1000  # At most this many runs are asked for their histories.

MOST_CONTACTS = 4

POINTS = 400  # A history is thinned to this many points, which include its extremes.


def packed(values: Any, kind: str = "<f4") -> str:
    """Return numbers as base64 of their bytes; a number too large for `kind` becomes infinite, a missing one nan."""
    with np.errstate(over="ignore"):
        return base64.b64encode(np.asarray(values, dtype=float).astype(kind).tobytes()).decode("ascii")


def kept_histories(study: StudyLike, table: Any) -> dict[int, dict[str, Any]]:
    """Return thinned histories by row number, for some of the rows.

    The rows are taken from each pair of methods in turn, its best run first and then spread over its runs.
    """
    turns: dict[str, list[int]] = {}
    for row, (method, status) in enumerate(zip(methods(table), texts(table["status"]), strict=True)):
        if status in {"done", "unstable", "interrupted"}:
            turns.setdefault(method, []).append(row)
    queues = [
        iter(dict.fromkeys([*_best_run(table, rows), *_spread_rows(rows, MOST_ASKED)])) for rows in turns.values()
    ]
    # More rows are asked for than are wanted, because a study may have kept the histories of some runs only.
    in_turn = (row for turn in itertools.zip_longest(*queues) for row in turn if row is not None)
    out: dict[int, dict[str, Any]] = {}
    letters = 0
    for row in itertools.islice(in_turn, MOST_ASKED):
        history = study.histories(table["key"].iloc[row])
        if history is not None:
            out[row] = _packed_history(history)
            letters += sum(len(part) for name in ("force", "exact") for line in out[row][name] for part in line)
        if len(out) == MOST_HISTORIES or letters > MOST_LETTERS:
            break
    return dict(sorted(out.items()))


def _best_run(table: Any, rows: list[int]) -> list[int]:
    """Return the done run with the smallest force error among some rows, as a list of one row or none."""
    if "force_error_l1" not in table:
        return []
    own = table.iloc[rows]
    errors = numbers(own["force_error_l1"].where(own["status"] == "done"))
    return [rows[int(np.nanargmin(errors))]] if errors is not None and np.isfinite(errors).any() else []


def _spread_rows(rows: list[int], most: int) -> list[int]:
    """Return at most `most` rows in an order in which any beginning of the list is spread over all rows."""
    steps = np.arange(1, min(most, len(rows)) + 1)
    golden = np.floor(np.modf(steps * 0.6180339887498949)[0] * len(rows)).astype(int)
    return [rows[k] for k in dict.fromkeys([0, *golden.tolist(), *range(min(most, len(rows)))])]


def _packed_history(history: dict[str, Any]) -> dict[str, Any]:
    time = np.asarray(history["time"], dtype=float)

    def lines(name: str) -> list[list[str]]:
        values = history.get(name)
        if values is None:
            return []
        force = np.asarray(values, dtype=float).reshape(time.size, -1)
        return [[packed(part) for part in thinned(time, curve, POINTS)] for curve in force.T[:MOST_CONTACTS]]

    names = [str(name) for name in history.get("contact", [])][:MOST_CONTACTS]
    return {"contacts": names, "force": lines("contact_force"), "exact": lines("contact_force_exact")}
