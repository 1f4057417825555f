"""The runs of which none is both cheaper and more accurate."""

from __future__ import annotations

import numpy as np

from percuss.methods.interfaces import Floats, Integers


def front_of(cost: Floats, error: Floats) -> Integers:
    """Return the row numbers of the Pareto front of error against cost, by rising cost, of runs that have both."""
    rows = np.flatnonzero(np.isfinite(cost) & np.isfinite(error))
    rows = rows[np.lexsort((error[rows], cost[rows]))]
    best = np.minimum.accumulate(error[rows]) if rows.size else error[rows]
    kept = np.ones(rows.size, dtype=bool)
    kept[1:] = error[rows][1:] < best[:-1]
    return rows[kept]
