"""Gravity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import Doc, Load, Unit

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class Gravity(Load):
    """A constant acceleration of all bodies, given as a number along x or as a vector.

    Formula: ``A(t) = |value|`` along `value`, or ``A(t) = value`` along x; the force on each node is its mass times A.
    """

    name = "gravity"
    summary = "Constant acceleration of every body"
    shorthand = "value"
    acts_as = "acceleration"
    everywhere = True
    examples = ({"value": -9.81}, {"value": (0.0, -9.81)})

    value: Annotated[float | tuple[float, ...], Unit("length/time^2"), Doc("acceleration along x, or a vector")]

    def vector(self) -> tuple[float, ...]:
        """Return the given vector, or the direction x if a number was given."""
        return self.value if isinstance(self.value, tuple) else (1.0,)

    def amplitude(self, time: Floats) -> Floats:
        """Return the magnitude of the vector, or the given number, at each time."""
        size = float(np.linalg.norm(self.value)) if isinstance(self.value, tuple) else self.value
        return np.full(time.shape, size)

    def kinks(self) -> tuple[float, ...]:
        """Return the times at which the amplitude is not smooth."""
        return ()
