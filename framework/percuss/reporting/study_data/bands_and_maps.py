"""Medians, quantiles and counts of runs over one or two varied values of a study."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from percuss.reporting.study_data.axis_bins import binned, binned_column
from percuss.reporting.study_data.values import WAITING, methods, numbers

MAP_DISTINCT, MAP_BINS = 16, 12  # These are the limits for each side of a map.

MOST_MAPPED = 4  # Each pair of this many varied values has a map of all rows.

QUANTILES = (0.1, 0.5, 0.9)


def lacking(table: Any, path: str) -> set[str]:
    """Return the pairs of methods whose runs all lack a varied value, because they have no such option or leave it out.

    Their runs are the same at every value of the path.
    """
    present = table[path].notna().to_numpy()
    method_of_row = methods(table)
    return set(method_of_row) - {method for method, has_value in zip(method_of_row, present, strict=True) if has_value}


def bands(table: Any, names: Sequence[str], path: str) -> Iterator[tuple[str, str, Any]]:
    """Yield the median and the quantile band of each measure over one varied value, for each pair of methods.

    Yields
    ------
    tuple
        Pair of methods, measure, and an array (6, bins): the place of each bin on the axis, the three `QUANTILES` over
        the runs that have the measure, the number of these runs, and the number of runs made. A pair that lacks the
        value has one bin, whose place is nan; among words it has the bin of the empty text.
    """
    is_made = (table["status"] != WAITING).to_numpy()
    made = table[is_made]
    places, bin_of = binned_column(table[path])
    if not places.size:
        return
    bin_of = bin_of[is_made]
    method_of_row, done = np.array(methods(made)), (made["status"] == "done").to_numpy()
    without = lacking(made, path) if numbers(table[path]) is not None else set()
    measured = made[list(names)].astype(float).to_numpy()
    for method in dict.fromkeys(method_of_row.tolist()):
        own = method_of_row == method
        bins = (
            [(np.nan, own)] if method in without else [(place, own & (bin_of == k)) for k, place in enumerate(places)]
        )
        runs = [(place, np.flatnonzero(in_bin & done), int(in_bin.sum())) for place, in_bin in bins]
        for n, name in enumerate(names):
            yield method, name, _band(runs, measured[:, n])


def _band(runs: Sequence[tuple[float, Any, int]], values: Any) -> Any:
    """Return place, quantiles, number of values and number of runs of each bin that has a run: array (6, bins)."""
    out = []
    for place, rows, count in runs:
        own = values[rows]
        own = own[np.isfinite(own)]
        quantiles = np.quantile(own, QUANTILES) if own.size else np.full(len(QUANTILES), np.nan)
        if count:
            out.append((place, *quantiles, own.size, count))
    return np.array(out).reshape(-1, 6).T


def maps(table: Any, names: Sequence[str], paths: Sequence[str]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield a map over each two varied numbers, with counts of runs by status and medians of the done runs in cells.

    Yields
    ------
    tuple
        The path across, the path up, and a dictionary of ``across`` and ``up`` (the places of the cells) and
        ``methods``: for each pair of methods the counts ``done``, ``unstable`` and ``other`` and the median of each
        measure, cells in rows from below. A pair that lacks a varied value has one cell along it. Where some done
        runs lack a measure, the number of those that have it is given as the measure's name followed by ``|known``.
    """
    made = table[table["status"] != WAITING]
    method_of_row, status = np.array(methods(made)), made["status"].to_numpy()
    kinds = {"done": status == "done", "unstable": status == "unstable"}
    kinds["other"] = ~(kinds["done"] | kinds["unstable"])
    numeric = {path: numbers(made[path]) for path in paths}
    placed = {
        path: binned(values, MAP_DISTINCT, MAP_BINS)
        for path, values in numeric.items()
        if values is not None and np.unique(values[np.isfinite(values)]).size > 1
    }
    without = {path: lacking(made, path) for path in placed}
    for x, y in itertools.combinations(list(placed)[:MOST_MAPPED], 2):
        of_methods = {}
        for method in dict.fromkeys(method_of_row.tolist()):
            (wide, i), (high, j) = (
                (1, np.zeros(len(made), dtype=int)) if method in without[path] else (places.size, bin_of)
                for path, (places, bin_of) in ((x, placed[x]), (y, placed[y]))
            )
            own = (method_of_row == method) & (i >= 0) & (j >= 0)
            cell, size = np.where(own, j * wide + i, -1), wide * high
            counts = {kind: np.bincount(cell[own & mask], minlength=size) for kind, mask in kinds.items()}
            done_runs = made.loc[own & kinds["done"], list(names)].astype(float).groupby(cell[own & kinds["done"]])
            medians, with_number = (
                statistic.reindex(range(size)) for statistic in (done_runs.median(), done_runs.count())
            )
            for name in names if counts["done"].any() else ():
                counts[name] = medians[name].to_numpy()
                if (with_number[name].fillna(0).to_numpy() < counts["done"]).any():
                    counts[f"{name}|known"] = with_number[name].fillna(0).to_numpy()
            of_methods[method] = counts
        yield x, y, {"across": placed[x][0], "up": placed[y][0], "methods": of_methods}
