"""A load interpolated in a table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from percuss import Load
from percuss_methods.loads._points import Points

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class Table(Points, Load):
    """A piecewise-linear amplitude through given points, with the first and the last value held outside them.

    Formula: ``A(t) = value_i + (value_{i+1} - value_i) (t - time_i) / (time_{i+1} - time_i)`` between ``time_i`` and
    ``time_{i+1}``.

    The points come from the case (`time`, `value`) or from a CSV or TSV file, whose path is relative to the case, such
    as a measured record. A file of two columns has the times first; of a file of more, `columns` gives two, by their
    names in the first line or by their numbers. All values are multiplied by `scale`.
    """

    name = "table"
    summary = "Piecewise linear through given points"
    examples = ({"time": (0.0, 0.1), "value": (0.0, 2.0)},)

    def amplitude(self, time: Floats) -> Floats:
        """Return the interpolated value at each time."""
        points, values = self.points
        return np.interp(time, points, values)

    def kinks(self) -> tuple[float, ...]:
        """Return the times at which the amplitude is not smooth."""
        return tuple(float(t) for t in self.points[0])
