"""Ripple: how unsteady a contact force is while the exact one presses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from percuss import Measure

if TYPE_CHECKING:
    from percuss import Result


@dataclass(frozen=True)
class Ripple(Measure):
    """Ripple of the contact force: its standard deviation from the exact one while that presses.

    Formula: ``sqrt(mean (lambda_n - F_n)^2) / mean F_n``, F_n the exact force averaged over the step around t_n, both
    means over the steps in which it is above a tenth of its peak; of the contact with the largest.
    """

    name = "ripple"
    summary = "Deviation of the force from the exact one while that presses"
    what = "standard deviation of force less exact force over the mean exact force, steps in which that presses"

    def of(self, result: Result) -> float | None:
        """Return the ripple, None where no exact solution covers the whole run or nothing presses."""
        exact = result.arrays.get("contact_force_exact")
        if exact is None or result.summary["exact"] is None:
            return None
        found = []
        for force, true in zip(result.arrays["contact_force"].T, exact.T, strict=True):
            presses = true > 0.1 * true.max(initial=0.0)
            if presses.any():
                found.append(float(np.sqrt(np.mean((force - true)[presses] ** 2)) / np.mean(true[presses])))
        return max(found, default=None)
