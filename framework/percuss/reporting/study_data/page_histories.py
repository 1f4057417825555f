"""Histories of some runs of a study, thinned and packed for a page."""

from __future__ import annotations

import base64
import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from percuss.jsonable import Entries
from percuss.reporting.figures import thinned
from percuss.reporting.study_data.values import groups, methods, numbers, texts

if TYPE_CHECKING:
    from percuss.studies.study_table import Study

if TYPE_CHECKING:
    import pandas as pd

MOST_HISTORIES = 120

MOST_LETTERS = 2_000_000  # The histories of a page may take this many letters of base64.

MOST_CONTACTS = 4

POINTS = 400  # A history is thinned to this many points, which include its extremes.


def packed(values: object, kind: str = "<f4") -> str:
    """Return numbers as base64 of their bytes; a number too large for `kind` becomes infinite, a missing one nan."""
    with np.errstate(over="ignore"):
        return base64.b64encode(np.asarray(values, dtype=float).astype(kind).tobytes()).decode("ascii")


def kept_histories(study: Study, table: pd.DataFrame, ranked: Sequence[str]) -> dict[int, Entries]:
    """Return thinned histories by row number, for as many of the rows as a page can carry.

    The rows are taken from each pair of methods in each case in turn, by the first of the `ranked` measures: what a
    page leaves out are the worst runs of each pair.
    """
    kept = table["key"].isin(list(study.with_histories)).to_numpy()
    errors = numbers(table[ranked[0]].where(table["status"] == "done")) if ranked else np.zeros(len(table))
    own = [rows[kept[rows]] for rows in groups(texts(table["case"]), methods(table)).values()]
    queues = [rows[np.argsort(errors[rows], kind="stable")].tolist() for rows in own]
    out: dict[int, Entries] = {}
    letters = 0
    for row in (row for turn in itertools.zip_longest(*queues) for row in turn if row is not None):
        history = study.histories(table["key"].iloc[row])
        if history is None:
            continue
        out[row] = _packed_history(history)
        letters += sum(len(part) for name in ("force", "exact") for line in out[row][name] for part in line)
        if len(out) == MOST_HISTORIES or letters > MOST_LETTERS:
            break
    return dict(sorted(out.items()))


def _packed_history(history: Entries) -> Entries:
    time = np.asarray(history["time"], dtype=float)

    def lines(name: str) -> list[list[str]]:
        values = history.get(name)
        if values is None:
            return []
        force = np.asarray(values, dtype=float).reshape(time.size, -1)
        return [[packed(part) for part in thinned(time, curve, POINTS)] for curve in force.T[:MOST_CONTACTS]]

    names = [str(name) for name in history.get("contact", [])][:MOST_CONTACTS]
    return {"contacts": names, "force": lines("contact_force"), "exact": lines("contact_force_exact")}
