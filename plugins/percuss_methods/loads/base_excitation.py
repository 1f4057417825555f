"""Base excitation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import Doc, Load, Unit
from percuss_methods.loads._points import Points

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class BaseExcitation(Points, Load):
    """An end that moves with a prescribed acceleration, piecewise linear through given points, whatever force it needs.

    Formula: ``v(t) = initial + integral of a from 0 to t``, where ``a = value_i + (value_{i+1} - value_i) (t - time_i)
    / (time_{i+1} - time_i)`` between ``time_i`` and ``time_{i+1}``; before and after all points a is that of the
    nearest one.

    The points of a come from the case or from a file, such as a record of the motion of the ground, in the same way as
    those of `table`. The integral is exact, and the end has it as its velocity at the middle of each step. Its
    displacement is the sum of these velocities times the step, which differs from the double integral by at most ``dt^2
    / 8`` times the total variation of a, and where a changes smoothly by ``dt^2 / 24`` times its change. A record whose
    last value is not zero accelerates the end until the run ends.
    """

    name = "base-excitation"
    summary = "Prescribed acceleration of an end, from points or a file"
    acts_as = "velocity"
    references = ("Chopra: Dynamics of Structures, Prentice Hall 2012, ch. 1 and 6",)
    examples = (
        {"time": (0.0, 0.1), "value": (0.0, 2.0)},
        {"time": (0.01, 0.05, 0.09), "value": (0.0, 3.0, 0.0), "scale": -0.5, "initial": 0.1},
    )

    value: Annotated[tuple[float, ...], Unit("length/time^2"), Doc("one acceleration a time")] | None = None
    initial: Annotated[float, Unit("length/time"), Doc("velocity at the start")] = 0.0

    @cached_property
    def _velocities(self) -> Floats:
        """Integral of the acceleration from the first point to each point, (points,)."""
        points, values = self.points
        return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(points))])

    def amplitude(self, time: Floats) -> Floats:
        """Return the velocity at each time."""
        return self.initial + self._integral(time) - self._integral(np.zeros(1))

    def _integral(self, time: Floats) -> Floats:
        """Return the integral of the acceleration from the first point to each time, (T,)."""
        points, values = self.points
        # The last point before each time, or the first point, where there is none.
        near = np.clip(np.searchsorted(points, time, side="right") - 1, 0, None)
        mean = 0.5 * (values[near] + np.interp(time, points, values))
        return self._velocities[near] + mean * (time - points[near])

    def kinks(self) -> tuple[float, ...]:
        """Return the times at which the acceleration changes its slope."""
        return tuple(float(t) for t in self.points[0])
