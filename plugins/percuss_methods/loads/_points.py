"""Points of a piecewise-linear function of time, given in a case or in a file: the options of several loads."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import DataFile, Doc, OptionError, Unit

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class Points:
    """The points come from the case (`time`, `value`), or from two columns of a file (`file`, `columns`)."""

    time: Annotated[tuple[float, ...], Unit("time"), Doc("increasing times")] | None = None
    value: Annotated[tuple[float, ...], Unit("amplitude"), Doc("one value a time")] | None = None
    file: Annotated[DataFile, Doc("file of columns, as CSV or TSV; instead of both")] | None = None
    columns: (
        Annotated[
            tuple[str | int, str | int],
            Doc("columns of time and value, by name or by number from 1, in a file of more"),
        ]
        | None
    ) = None
    scale: Annotated[float, Unit("1"), Doc("factor on all values")] = 1.0

    def __post_init__(self) -> None:
        if self.file is None:
            self._check_numbers()
        elif self.time is not None or self.value is not None:
            raise ValueError("expected both `time` and `value`, or `file`, found both ways of giving points")
        times, _ = self.points
        wrong = np.flatnonzero(np.diff(times) <= 0)
        if wrong.size and self.file is not None:
            row = int(wrong[0]) + 1
            place, before = self.file.place(row), self.file.place(row - 1)
            raise ValueError(f"{place}: times must increase: {times[row]:g} follows {times[row - 1]:g} of {before}")
        if wrong.size:
            raise ValueError("`time` must increase from point to point")

    def _check_numbers(self) -> None:
        """Raise ValueError unless the case itself gives as many times as values, and no columns of a file."""
        if self.time is None and self.value is None:
            raise ValueError("expected points: give both `time` and `value`, or `file`")
        if self.time is None or self.value is None:
            raise ValueError("expected both `time` and `value`, found one of them")
        if self.columns is not None:
            raise ValueError("`columns` are those of a `file`, which is not given")
        if len(self.time) != len(self.value):
            counts = f"`time` has {len(self.time)} numbers and `value` has {len(self.value)}"
            raise ValueError(f"{counts}: give one value a time")
        if not self.time:
            raise ValueError("expected at least one point, found none")

    @cached_property
    def points(self) -> tuple[Floats, Floats]:
        """Times and values of the points, cached because an exact solution uses them thousands of times."""
        if self.file is None:
            return np.asarray(self.time, dtype=float), self.scale * np.asarray(self.value, dtype=float)
        if self.columns is not None:
            times, values = (self._column(self.file, i) for i in range(2))
        elif self.file.width > 2:
            count = f"{self.file.path} has {self.file.width} columns"
            raise ValueError(f"{count}: name the two for time and value with `columns`")
        else:
            times, values = self.file.as_columns(2)
        return times, self.scale * values

    def _column(self, file: DataFile, i: int) -> Floats:
        """Return the column that the item `i` of `columns` names."""
        which = (self.columns or ())[i]
        try:
            return file.column(which)
        except ValueError as error:
            raise OptionError(str(error), "columns", i) from None
