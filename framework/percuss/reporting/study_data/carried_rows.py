"""The rows of a study that fit on a page: a sample of all runs, and the runs that no other run beats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.quantities import ranking
from percuss.reporting.study_data.roles import ColumnRoles
from percuss.reporting.study_data.values import groups, methods, numbers, texts
from percuss.studies.pareto import front_of

if TYPE_CHECKING:
    import pandas as pd

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


def best_runs(table: pd.DataFrame, roles: ColumnRoles) -> Any:
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


def front(cost: Any, error: Any) -> Any:
    """Return the Pareto front of error against cost, by rising cost: costs and errors, (2, n)."""
    rows = front_of(cost, error)
    return np.vstack([cost[rows], error[rows]])
