"""A ramp from zero."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import Doc, Gt, Load, Unit

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class Ramp(Load):
    """A linear rise from zero, then constant.

    Formula: ``A(t) = value min(t / duration, 1)``.
    """

    name = "ramp"
    summary = "Linear from zero to a value, which is then held"
    examples = ({"value": 2.0, "duration": 0.1},)

    value: Annotated[float, Unit("amplitude"), Doc("the value reached")]
    duration: Annotated[float, Gt(0), Unit("time"), Doc("how long the rise takes")]

    def amplitude(self, time: Floats) -> Floats:
        """Return the ramp at each time."""
        return self.value * np.minimum(time / self.duration, 1.0)

    def kinks(self) -> tuple[float, ...]:
        """Return the times at which the amplitude is not smooth."""
        return (self.duration,)
