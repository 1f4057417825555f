"""The criterion of bounds, for bodies that are too large to factor: it proves a step stable, or proves nothing.

No mode of the bodies is faster than the fastest cell, omega_b. Closed contacts of laws at the current state add
``M^-1 N D N^T`` with ``D = (D_s - (4/dt^2) D_m)_+`` to ``M^-1 K``. The largest eigenvalue of a sum is at most the sum
of the largest ones (Weyl), and that of ``M^-1 N D N^T`` is that of S D, at most the largest sum of the absolute values
in a row. So central difference is stable where ``omega_b^2 + |S| D`` is below ``4/dt^2``. Ties and supports take
motions away, which raises no frequency.

Laws evaluated at the predicted gap need ``theta = dt^2 lambda_max((I + S D_m)^-1 S D_s) <= 1`` besides, and theta is
at most ``dt^2 b / (1 + r b)`` with the largest sum b of a row of ``|S| D_s`` and the least r of eps_m / eps_s.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from percuss.certificate.assessment import MARGINAL_DISTANCE, Assessment, largest_step_below, signed_distance
from percuss.certificate.closed_laws import ClosedLaws, closed_laws
from percuss.certificate.oscillator import limit_ratio

if TYPE_CHECKING:
    from collections.abc import Callable

    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats

BOUND = "up to which the bounds of cells and of closed contacts, as stiff as in this run, exclude growth"
SEARCHED_TO = 1e-6  # relative, of a step by bounds
UNLIKE = "contacts that share nodes differ in eps_m / eps_s, so that they do not act on one another as equals"


class Bounds:
    """Criterion of one stretch of a run from bounds of its frequencies.

    Parameters
    ----------
    model
        A stretch of a run, `percuss.march.model_of_case.stretches`.

    Attributes
    ----------
    ratio
        Largest stable step of the scheme over that of central difference, for an oscillator.
    free
        Step up to which nothing grows with no contact closed but ties.
    """

    by: ClassVar[str] = "bounds"

    def __init__(self, model: Model) -> None:
        self.model = model
        self.ratio = limit_ratio(model)
        self.free = 2.0 * self.ratio / model.bodies.omega

    def _largest_sum(self, stiffness: Floats) -> float:
        """Return the largest sum of a row of ``|S| D`` [1/time^2]."""
        return float((abs(self.model.delassus) @ stiffness).max(initial=0.0))

    def theta(self, dt: float, laws: ClosedLaws | None = None) -> tuple[float, str]:
        """Return a bound of theta, 0 without contacts evaluated at the predicted gap; or inf, and why there is none."""
        laws = laws or closed_laws(self.model, dt)
        doubt = "; ".join(laws.doubts) or (UNLIKE if laws.unlike(self.model.delassus, dt) else "")
        if doubt:
            return np.inf, doubt
        predicted = laws.predicted & laws.pressing
        by_sums = self._largest_sum(np.where(predicted, laws.stiffness, 0.0))
        ratio = float(np.min(laws.inertia[predicted] / laws.stiffness[predicted], initial=np.inf))
        return (dt**2 * by_sums / (1.0 + ratio * by_sums) if by_sums else 0.0), ""

    def _share(self, dt: float, laws: ClosedLaws) -> tuple[float, str]:
        """Return the number below 1 where a step is known to be stable, or inf and why no step is known to be."""
        theta, doubt = self.theta(dt, laws)
        if doubt:
            return np.inf, doubt
        limit = 4.0 * (self.ratio / dt) ** 2
        stiffness, inertia = laws.at_current_state()
        share = (self.model.bodies.omega**2 + self._largest_sum(np.maximum(stiffness - limit * inertia, 0.0))) / limit
        return max(share, theta), ""

    def assess_step(self, dt: float) -> Assessment:
        """Return the assessment of a step."""
        share, doubt = self._share(dt, closed_laws(self.model, dt))
        if share < 1.0 - MARGINAL_DISTANCE:
            return Assessment("stable")
        return Assessment("unknown", doubt=doubt or f"the step is not below {self.proven_step:.6g}, {BOUND}")

    @cached_property
    def proven_step(self) -> float:
        """Largest step that is known to be stable with the laws as they are bound for the step of the run, or nan."""
        laws = closed_laws(self.model, self.model.dt)
        return self._largest(lambda dt: self._share(dt, laws))

    @cached_property
    def critical_step(self) -> float:
        """Largest step that is known to be stable, with laws bound anew for each step tried; nan where none is."""
        return self._largest(lambda dt: self._share(dt, closed_laws(self.model, dt)))

    def _largest(self, share_at: Callable[[float], tuple[float, str]]) -> float:
        """Return the largest step with a share below 1, nan where none is known."""
        if share_at(self.free)[1]:
            return np.nan
        return largest_step_below(lambda dt: signed_distance(share_at(dt)[0]), self.free, SEARCHED_TO)
