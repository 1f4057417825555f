"""Prescribed velocity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import Doc, Load, Unit

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class PrescribedVelocity(Load):
    """A constant prescribed velocity of an end, whatever force it requires.

    Formula: ``v(t) = value`` at the middle of each step, along the direction of the load.
    """

    name = "prescribed-velocity"
    summary = "Constant prescribed velocity of an end"
    shorthand = "value"
    acts_as = "velocity"
    examples = ({"value": 1.0},)

    value: Annotated[float, Unit("length/time"), Doc("velocity along the direction")]

    def amplitude(self, time: Floats) -> Floats:
        """Return `value` at each time."""
        return np.full(time.shape, self.value)

    def kinks(self) -> tuple[float, ...]:
        """Return the times at which the amplitude is not smooth."""
        return ()
