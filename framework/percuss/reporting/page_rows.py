"""The rows of a study that a page carries, a sample and the runs that no other beats, and their packed histories."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from percuss.case.quantities import ranking
from percuss.jsonable import Entries
from percuss.methods.interfaces import Array
from percuss.reporting.figures import thinned
from percuss.reporting.study_data import ColumnRoles, groups, methods, numbers, texts
from percuss.studies.pareto import front_of

if TYPE_CHECKING:
    import pandas as pd

    from percuss.studies.study_table import Study

MOST_ROWS = 5000  # A browser draws and sorts this many rows without a pause; the best runs are added to them.

SEED = 0


@dataclass(frozen=True)
class Carried:
    """The rows of a study that a page carries.

    Attributes
    ----------
    table
        The rows, in the order of the study.
    kept
        Mask of these rows among all rows of the study.
    drawn
        Mask (rows,) of the random sample of all rows; the other rows are added because no run beats them.
    best
        Number of runs that no other run beats, drawn or not; 0 where the page carries all rows.
    """

    table: pd.DataFrame
    kept: pd.DataFrame
    drawn: pd.DataFrame
    best: int


def carried(table: pd.DataFrame, roles: ColumnRoles) -> Carried:
    """Return all rows, or a seeded random sample and all `best_runs` where there are too many for a page."""
    if len(table) <= MOST_ROWS:
        every = np.ones(len(table), dtype=bool)
        return Carried(table.reset_index(drop=True), every, every, 0)
    drawn = np.zeros(len(table), dtype=bool)
    drawn[np.random.default_rng(SEED).choice(len(table), MOST_ROWS, replace=False)] = True
    best = best_runs(table, roles)
    kept = drawn | best
    return Carried(table[kept].reset_index(drop=True), kept, drawn[kept], int(best.sum()))


def best_runs(table: pd.DataFrame, roles: ColumnRoles) -> Array:
    """Return a mask (rows,) of the runs that no other run of the same case and the same pair of methods beats.

    For each measure of `ranking` these are the run with its smallest value and the runs on its Pareto front against
    each cost. A run without a number for a measure takes no part in the ranking by it.
    """
    done = (table["status"] == "done").to_numpy()
    costs = [numbers(table[name]) for name in roles.costs]
    errors = [numbers(table[name]) for name in ranking(roles.measures)]
    best = np.zeros(len(table), dtype=bool)
    for own in groups(texts(table["case"]), methods(table)).values():
        rows = own[done[own]]
        for error in errors:
            finite = rows[np.isfinite(error[rows])]
            if finite.size:
                best[finite[np.argmin(error[finite])]] = True
            for cost in costs:
                best[rows[front_of(cost[rows], error[rows])]] = True
    return best


MOST_HISTORIES = 120

MOST_NUMBERS = 150_000  # The histories of a page may have this many numbers.

MOST_CONTACTS = 4

POINTS = 400  # A history is thinned to this many points, which include its extremes.


def kept_histories(study: Study, table: pd.DataFrame, ranked: Sequence[str]) -> dict[int, Entries]:
    """Return thinned histories by row number, for as many of the rows as a page can carry.

    The rows are taken from each pair of methods in each case in turn, those with the least of the first `ranked`
    measure first: what a page leaves out are the worst runs of each pair. A history maps each contact to the times and
    forces of the run, and to those of the exact solution where it is known.
    """
    kept = table["key"].isin(list(study.with_histories)).to_numpy()
    errors = numbers(table[ranked[0]].where(table["status"] == "done")) if ranked else np.zeros(len(table))
    own = [rows[kept[rows]] for rows in groups(texts(table["case"]), methods(table)).values()]
    queues = [rows[np.argsort(errors[rows], kind="stable")].tolist() for rows in own]
    out: dict[int, Entries] = {}
    count = 0
    for row in (row for turn in itertools.zip_longest(*queues) for row in turn if row is not None):
        history = study.histories(table["key"].iloc[row])
        if history is None:
            continue
        out[row] = _lines(history, table["case"].iloc[row])
        count += sum(2 * len(line[0]) for lines in out[row].values() for line in lines)
        if len(out) == MOST_HISTORIES or count > MOST_NUMBERS:
            break
    return out


def _lines(history: Entries, case: str) -> dict[str, list[list[list[float]]]]:
    """Return for each contact the computed and the exact line, thinned to times and forces of five digits."""
    time = np.asarray(history["time"], dtype=float)
    names = list(history.get("contact", []))
    out: dict[str, list[list[list[float]]]] = {}
    for values in (history.get("contact_force"), history.get("contact_force_exact")):
        for k, curve in enumerate(
            np.asarray(values, dtype=float).reshape(time.size, -1).T if values is not None else ()
        ):
            if k < MOST_CONTACTS:
                contact = f"{case}: {names[k] if k < len(names) else f'contact {k + 1}'}"
                line = [[float(f"{v:.5g}") for v in part] for part in thinned(time, curve, POINTS)]
                out.setdefault(contact, []).append(line)
    return out
