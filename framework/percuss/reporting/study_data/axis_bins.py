"""Axes of the charts of a study: logarithmic or not, and the bins of many distinct values."""

from __future__ import annotations

from typing import Any

import numpy as np

from percuss.reporting.study_data.values import in_order, numbers, texts

DISTINCT = 40  # More distinct values than this are put in bins.

BINS = 24

FAR_FEW, FAR_MANY = 8, 30

ROUND_OFF = 1e-10  # A logarithmic axis does not reach below this fraction of the largest number.


def may_be_log(values: Any) -> bool:
    """Return whether a logarithmic axis can show all numbers: there is at least one, and all are above zero."""
    finite = values[np.isfinite(values)]
    return bool(finite.size) and bool((finite > 0).all())


def lowest(values: Any) -> float:
    """Return the lower edge of a logarithmic axis; smaller numbers are zero but for round-off and drawn at the edge."""
    finite = values[np.isfinite(values)]
    return float(max(finite.min(), ROUND_OFF * finite.max()))


def is_log(values: Any) -> bool:
    """Return whether numbers suit a logarithmic axis: all above zero, and spread far or in geometric progression."""
    if not may_be_log(values):
        return False
    finite = values[np.isfinite(values)]
    above = finite[finite >= lowest(values)]
    distinct = np.unique(above)
    steps = distinct[1:] / distinct[:-1]
    few = distinct.size <= DISTINCT
    multiples = few and distinct.size > 2 and bool(np.allclose(steps, steps[0], rtol=1e-6))
    return multiples or bool(distinct[-1] / (FAR_FEW if few else FAR_MANY) >= distinct[0])


def binned(values: Any, most: int = DISTINCT, bins: int = BINS) -> tuple[Any, Any]:
    """Return the place of each bin on the axis, and the number of the bin of each value, -1 for a value without one.

    Up to `most` distinct values have one bin each. More are put in `bins` bins of equal width, in the logarithm where
    `is_log` holds.
    """
    good = np.isfinite(values)
    distinct, own = np.unique(values[good], return_inverse=True)
    bin_of = np.full(values.size, -1)
    if distinct.size <= most:
        bin_of[good] = own
        return distinct, bin_of
    log = is_log(values)
    good &= (values > 0) | (not log)
    scaled = np.log10(values[good]) if log else values[good]
    edges = np.linspace(scaled.min(), scaled.max(), bins + 1)
    bin_of[good] = np.clip(np.searchsorted(edges, scaled, side="right") - 1, 0, bins - 1)
    middles = 0.5 * (edges[1:] + edges[:-1])
    return (10**middles if log else middles), bin_of


def binned_column(column: object) -> tuple[Any, Any]:
    """Return `binned` of a column of numbers; of a column of words the place of each word in order, 0, 1, 2, ..."""
    values = numbers(column)
    if values is not None:
        return binned(values)
    own = texts(column)
    place_of = {word: place for place, word in enumerate(in_order(own))}
    return np.arange(len(place_of)), np.array([place_of[word] for word in own], dtype=int)
