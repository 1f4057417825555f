"""A constant load."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import Doc, Load, Unit

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class Constant(Load):
    """A constant amplitude.

    Formula: ``A(t) = value``.
    """

    name = "constant"
    summary = "The same value at all times"
    shorthand = "value"
    examples = ({"value": 2.0},)

    value: Annotated[float, Unit("amplitude"), Doc("the value")]

    def amplitude(self, time: Floats) -> Floats:
        """Return `value` at each time."""
        return np.full(time.shape, self.value)

    def kinks(self) -> tuple[float, ...]:
        """Return the times at which the amplitude is not smooth."""
        return ()
