"""Ripple: the deviation of a contact force from the exact one while the exact force presses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from percuss import Measure

if TYPE_CHECKING:
    from percuss import Result

# Share of its peak from which on an exact force presses. A step in which it acts for just a tenth of the time has that
# share but for round-off, and does not count.
PRESSES = 0.1 * (1.0 + 1e-9)


@dataclass(frozen=True)
class Ripple(Measure):
    """Ripple of the contact force: its standard deviation from the exact force while the exact force presses.

    Formula: ``sqrt(mean (lambda_n - F_n)^2) / mean F_n``, F_n the exact force averaged over the step around t_n, both
    means over the steps in which F_n is above a tenth of its peak; the largest value of all contacts.
    """

    name = "ripple"
    summary = "Deviation of the force from the exact one while the exact one presses"
    what = (
        "standard deviation of force less exact force over the mean exact force, steps in which the exact force presses"
    )

    def of(self, result: Result) -> float | None:
        """Return the ripple, or None if no exact solution covers the whole run or no exact contact force presses."""
        exact = result.arrays.get("contact_force_exact")
        if exact is None or result.summary["exact"] is None:
            return None
        ripples = []
        for force, exact_force in zip(result.arrays["contact_force"].T, exact.T, strict=True):
            presses = exact_force > PRESSES * exact_force.max(initial=0.0)
            if presses.any():
                ripples.append(
                    float(np.sqrt(np.mean((force - exact_force)[presses] ** 2)) / np.mean(exact_force[presses]))
                )
        return max(ripples, default=None)
