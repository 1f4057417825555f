"""A load interpolated in a table."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import DataFile, Doc, Load, Unit

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class Table(Load):
    """A piecewise-linear amplitude through given points, with the first and the last value held outside them.

    Formula: ``A(t) = value_i + (value_{i+1} - value_i) (t - time_i) / (time_{i+1} - time_i)`` between ``time_i`` and
    ``time_{i+1}``.

    The points come from the case (`time`, `value`) or from a CSV file of two columns, time and value, whose path is
    relative to the case; a first line of words is skipped.
    """

    name = "table"
    summary = "Piecewise linear through given points"
    examples = ({"time": (0.0, 0.1), "value": (0.0, 2.0)},)

    time: Annotated[tuple[float, ...], Unit("time"), Doc("increasing times")] | None = None
    value: Annotated[tuple[float, ...], Unit("amplitude"), Doc("one value a time")] | None = None
    file: Annotated[DataFile, Doc("CSV file of two columns, time and value; instead of both")] | None = None

    def __post_init__(self) -> None:
        if (self.file is None) == (self.time is None and self.value is None):
            raise ValueError("a table has either `time` and `value`, or `file`")
        if self.file is None and (self.time is None or self.value is None):
            raise ValueError("a table has both `time` and `value`")
        points, values = self.points
        if len(points) != len(values):
            raise ValueError(f"`time` has {len(points)} numbers and `value` has {len(values)}: give one value a time")
        if len(points) == 0:
            raise ValueError("a table has at least one point")
        if not (np.diff(points) > 0).all():
            raise ValueError("`time` must increase from point to point")

    @cached_property
    def points(self) -> tuple[Floats, Floats]:
        """Times and values of the points, cached because an exact solution uses them thousands of times."""
        if self.file is not None:
            columns = self.file.as_columns(2)
            return columns[0], columns[1]
        return np.asarray(self.time, dtype=float), np.asarray(self.value, dtype=float)

    def amplitude(self, time: Floats) -> Floats:
        """Return the interpolated value at each time."""
        points, values = self.points
        return np.interp(time, points, values)

    def kinks(self) -> tuple[float, ...]:
        """Return the times at which the amplitude is not smooth."""
        return tuple(float(t) for t in self.points[0])
