"""Performance profile of the pairs of methods, over the problems that every pair was set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.jsonable import Entries
from percuss.reporting.study_data.roles import references
from percuss.reporting.study_data.values import STATISTICS, WAITING, groups, methods, numbers, texts

if TYPE_CHECKING:
    import pandas as pd

PENDING = (WAITING, "lost")  # Nothing is known of these runs, which are still to be made or to be made again.


@dataclass(frozen=True)
class Problems:
    """The problems of a study that every pair of methods was set.

    A problem is a case with one value of each varied path that is not an option of a method: a pair may have several
    runs of it, one for each value of its options.

    Attributes
    ----------
    solvers
        The pairs of methods; the references with mesh tying are not among them.
    rows
        For each problem the row numbers of the runs of each pair.
    left_out
        Number of problems that some pair was not set.
    """

    solvers: list[str]
    rows: list[list[Any]]
    left_out: int


def problems(table: pd.DataFrame, varied: Sequence[str]) -> Problems:
    """Return the problems of a study."""
    method_of_row, excluded = methods(table), set(references(table))
    solvers = [method for method in dict.fromkeys(method_of_row) if method not in excluded]
    paths = ["case", *(path for path in varied if path.split(".")[0] != "method")]
    runs: dict[Any, dict[str, Any]] = {}
    for (method, *point), rows in groups(method_of_row, *(texts(table[path]) for path in paths)).items():
        if method not in excluded:
            runs.setdefault(tuple(point), {})[method] = rows
    kept = [[own[method] for method in solvers] for own in runs.values() if len(own) == len(solvers)]
    return Problems(solvers, kept, len(runs) - len(kept))


@dataclass(frozen=True)
class Profile:
    """A performance profile: the share of problems on which each pair of methods is within a factor of the best pair.

    Attributes
    ----------
    counted
        Number of problems in the profile.
    unknown
        Number of problems left out because one of their runs is still to be made, is done without the measure or has
        a measure below zero, or because no pair has a value.
    ratios
        For each pair of methods the ratios of its measure to that of the best pair, in rising order: at least 1,
        infinite where it has no value.
    """

    counted: int
    unknown: int
    ratios: Entries


def profile(table: pd.DataFrame, name: str, problem_set: Problems, statistic: str = "best") -> Profile:
    """Return the performance profile of the pairs of methods by one measure that is better when smaller.

    A pair's value on a problem is the best or the median over its runs of it; a run that is not done counts as
    infinite. The profile of a pair at a factor tau is the fraction of problems whose ratio is at most tau (Dolan, More:
    Benchmarking optimization software with performance profiles, Math. Program. 91 (2002), doi 10.1007/s101070100263).
    """
    status, values = table["status"].to_numpy(), numbers(table[name])
    of_run = np.where(np.isin(status, PENDING), np.nan, np.where(status == "done", values, np.inf))
    with np.errstate(invalid="ignore"):
        cost = np.array([[STATISTICS[statistic](of_run[rows]) for rows in own] for own in problem_set.rows])
        cost = cost.reshape(-1, len(problem_set.solvers))
        good = ~np.isnan(cost).any(axis=1) & np.isfinite(cost).any(axis=1) & (cost >= 0).all(axis=1)
    cost = cost[good]
    least = cost.min(axis=1, keepdims=True, initial=np.inf)
    # The best pairs have the ratio 1 also where their measure is zero.
    ratio = np.divide(cost, least, out=np.where(cost == least, 1.0, np.inf), where=least > 0)
    ratios = {method: np.sort(ratio[:, k]) for k, method in enumerate(problem_set.solvers)}
    return Profile(int(good.sum()), int((~good).sum()), ratios)
