"""A harmonic load."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import Doc, Gt, Load, Unit

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class Harmonic(Load):
    """A harmonic amplitude about a mean value.

    Formula: ``A(t) = mean + value sin(2 pi frequency t + phase)``.
    """

    name = "harmonic"
    summary = "A sine about a mean value"
    examples = ({"value": 2.0, "frequency": 5.0},)

    value: Annotated[float, Unit("amplitude"), Doc("amplitude of the sine")]
    frequency: Annotated[float, Gt(0), Unit("1/time"), Doc("cycles per time")]
    phase: Annotated[float, Unit("radian"), Doc("phase at the start")] = 0.0
    mean: Annotated[float, Unit("amplitude"), Doc("value it swings about")] = 0.0

    def amplitude(self, time: Floats) -> Floats:
        """Return the sine at each time."""
        return self.mean + self.value * np.sin(2.0 * np.pi * self.frequency * time + self.phase)

    def kinks(self) -> tuple[float, ...]:
        """Return the times at which the amplitude is not smooth."""
        return ()
