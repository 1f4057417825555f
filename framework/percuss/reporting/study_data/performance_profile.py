"""Performance profile of the pairs of methods, over the problems that every pair was set once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from percuss.reporting.study_data.bands_and_maps import lacking
from percuss.reporting.study_data.roles import references
from percuss.reporting.study_data.values import WAITING, methods, numbers, texts

# These varied paths choose the pair of methods itself, so they do not define a problem.
CHOICES = ("method.integrator", "method.integrator.name", "method.contact", "method.contact.name")
PENDING = (WAITING, "lost")  # Nothing is known of these runs, which are still to be made or to be made again.


@dataclass(frozen=True)
class Problems:
    """The problems of a study that every pair of methods was set once: a case with one value of each varied path.

    Attributes
    ----------
    solvers
        The pairs of methods; the references with mesh tying are not among them.
    rows
        Row number of the run of each pair on each problem, (problems, solvers).
    left_out
        Number of problems that some pair was not set, or was set more than once.
    """

    solvers: list[str]
    rows: Any
    left_out: int


def problems(table: Any, varied: Sequence[str]) -> Problems:
    """Return the problems of a study; the one run of a pair that lacks a varied value counts at each value of it."""
    method_of_row, excluded = methods(table), set(references(table))
    solvers = [method for method in dict.fromkeys(method_of_row) if method not in excluded]
    paths = [path for path in varied if path not in CHOICES]
    without = {path: lacking(table, path) & set(solvers) for path in paths}
    # A pair that lacks a value which other pairs have does not define problems of its own.
    partial = {method for pairs in without.values() if len(pairs) < len(solvers) for method in pairs}
    runs: dict[Any, list[int]] = {}
    points: dict[Any, None] = {}
    columns_of_text = [texts(table[path]) for path in paths]
    for row, (method, *point) in enumerate(zip(method_of_row, texts(table["case"]), *columns_of_text, strict=True)):
        runs.setdefault((method, *point), []).append(row)
        if method not in partial and method not in excluded:
            points[tuple(point)] = None
    kept = []
    for case, *values in points:
        own = []
        for method in solvers:
            point = ["" if method in without[path] else value for path, value in zip(paths, values, strict=True)]
            rows_of_point = runs.get((method, case, *point), [])
            if len(rows_of_point) != 1:
                break
            own.append(rows_of_point[0])
        else:
            kept.append(own)
    rows = np.array(kept, dtype=int).reshape(len(kept), len(solvers))
    return Problems(solvers, rows, len(points) - len(kept))


@dataclass(frozen=True)
class Profile:
    """A performance profile: the share of problems on which each pair of methods is within a factor of the best pair.

    Attributes
    ----------
    counted
        Number of problems in the profile.
    unknown
        Number of problems left out because one of their runs is still to be made, is done without the measure or has
        a measure below zero, or because none of their runs is done.
    ratios
        For each pair of methods the ratios of its measure to that of the best pair, in rising order: at least 1,
        infinite where its run is not done.
    """

    counted: int
    unknown: int
    ratios: dict[str, Any]


def profile(table: Any, name: str, problem_set: Problems) -> Profile:
    """Return the performance profile of the pairs of methods by one measure that is better when smaller.

    The profile of a pair at a factor tau is the fraction of problems whose ratio is at most tau (Dolan, More:
    Benchmarking optimization software with performance profiles, Math. Program. 91 (2002), doi 10.1007/s101070100263).
    """
    status = table["status"].to_numpy()[problem_set.rows]
    values = numbers(table[name])[problem_set.rows]
    cost = np.where(np.isin(status, PENDING), np.nan, np.where(status == "done", values, np.inf))
    with np.errstate(invalid="ignore"):
        good = ~np.isnan(cost).any(axis=1) & np.isfinite(cost).any(axis=1) & (cost >= 0).all(axis=1)
    cost = cost[good]
    least = cost.min(axis=1, keepdims=True, initial=np.inf)
    # The best pairs have the ratio 1 also where their measure is zero.
    ratio = np.divide(cost, least, out=np.where(cost == least, 1.0, np.inf), where=least > 0)
    ratios = {method: np.sort(ratio[:, k]) for k, method in enumerate(problem_set.solvers)}
    return Profile(int(good.sum()), int((~good).sum()), ratios)
