"""A half-sine pulse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import Doc, Gt, Load, Unit

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class HalfSine(Load):
    """One half-wave of a sine.

    Formula: ``A(t) = peak sin(pi t / duration)`` for ``t < duration``, 0 after it.
    """

    name = "half-sine"
    summary = "One half-wave of a sine"
    examples = ({"peak": 2.0, "duration": 0.1},)

    peak: Annotated[float, Unit("amplitude"), Doc("largest value")]
    duration: Annotated[float, Gt(0), Unit("time"), Doc("length of the pulse")]

    def amplitude(self, time: Floats) -> Floats:
        """Return the pulse at each time."""
        return np.where(time < self.duration, self.peak * np.sin(np.pi * time / self.duration), 0.0)

    def kinks(self) -> tuple[float, ...]:
        """Return the times at which the amplitude is not smooth."""
        return (self.duration,)
