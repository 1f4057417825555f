"""The best, quantiles and counts of runs over a varied value of a study."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.reporting.study_data.axis_bins import binned_column
from percuss.reporting.study_data.values import WAITING, groups, methods, numbers

if TYPE_CHECKING:
    import pandas as pd

QUANTILES = (0.0, 0.1, 0.5, 0.9)  # The best, the lower end of the band, the median, and its upper end.


def lacking(table: pd.DataFrame, path: str) -> set[str]:
    """Return the pairs of methods whose runs all lack a varied value, because they have no such option or leave it out.

    Their runs are the same at every value of the path.
    """
    return set(methods(table)) - set(methods(table[table[path].notna()]))


def bands(table: pd.DataFrame, names: Sequence[str], path: str) -> Iterator[tuple[str, str, Any]]:
    """Yield the best, the median and the quantile band of each measure over a varied value, for each pair of methods.

    Yields
    ------
    tuple
        Pair of methods, measure, and an array (7, bins): the place of each bin on the axis, the four `QUANTILES` over
        the runs that have the measure, the number of these runs, and the number of runs made. A pair that lacks the
        value has one bin, whose place is nan; among words it has the bin of the empty text.
    """
    is_made = (table["status"] != WAITING).to_numpy()
    made = table[is_made]
    places, bin_of = binned_column(table[path])
    if not places.size:
        return
    bin_of = bin_of[is_made]
    done = (made["status"] == "done").to_numpy()
    without = lacking(made, path) if numbers(table[path]) is not None else set()
    measured = made[list(names)].astype(float).to_numpy()
    for (method,), own in groups(methods(made)).items():
        bins = [(np.nan, own)] if method in without else [(x, own[bin_of[own] == k]) for k, x in enumerate(places)]
        runs = [(place, in_bin[done[in_bin]], in_bin.size) for place, in_bin in bins]
        for n, name in enumerate(names):
            yield method, name, _band(runs, measured[:, n])


def _band(runs: Sequence[tuple[float, object, int]], values: Any) -> Any:
    """Return place, quantiles, number of values and number of runs of each bin that has a run: array (7, bins)."""
    out = []
    for place, rows, count in runs:
        own = values[rows]
        own = own[np.isfinite(own)]
        quantiles = np.quantile(own, QUANTILES) if own.size else np.full(len(QUANTILES), np.nan)
        if count:
            out.append((place, *quantiles, own.size, count))
    return np.array(out).reshape(-1, 7).T
