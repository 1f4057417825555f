"""The penalty method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from percuss import ContactLaw, ContactPoints, Doc, Gt, LinearLaw, Unit
from percuss_methods.contacts import _auto

SCALE = 0.1


@dataclass(frozen=True)
class Penalty(ContactLaw):
    """Penalty: a spring that pushes while the bodies overlap.

    Formula: ``lambda = eps_s <-g>``; ``eps_s = beta_s EA/h`` on the softer side, or ``eps_s = scale / (s dt^2)``.

    ``auto``, the default, is beta_s = 1/2, lowered so that ``theta = dt^2 eps_s s <= 0.8`` and eps_s is at most half of
    the largest stiffness with which the step of central difference is stable, whichever contacts are closed:
    ``theta <= 2 sqrt(1 - C^2)`` for long equal bars, and ``theta <= 1/2`` for unlike sides. Both limits are kept up to
    a Courant number of 0.99. On the shipped cases, at Courant numbers .5 and .9, the penetration is at most 4.5 times
    the compression of an end element under the peak force with central difference, and 1.8 times with Wu's
    predictor-corrector; the L1 error of the force is at most 17 % and 6 %, respectively; the peak is at most 20 % too
    high, and no energy beyond 0.1 % is gained.

    ``stiffness: from-step`` is the stiffness that LS-DYNA's SOFT = 1 derives from the step: k = SOFSCL m / (2 dt^2), m
    the smaller nodal mass. Between equal nodes 1/s = m/2, so that `scale` is SOFSCL; the default of both is 0.1.
    LS-DYNA uses this stiffness only where it exceeds its stiffness from the material; this law has no such condition.
    Of points that share nodes s is the sum of the absolute entries of a point's row of S, as for ``auto``. With Wu's
    predictor-corrector theta is `scale`, or less where S has negative entries or other laws share the nodes.

    With central difference a closed contact lowers the critical step; on a rigid wall to the Courant number
    ``sqrt(2 / (1 + sqrt(1 + beta_s^2)))``. With Wu's predictor-corrector theta must stay below 1.
    """

    name = "penalty"
    summary = "Penalty spring on the overlap"
    references = (
        "Belytschko, Liu, Moran, Elkhodary: Nonlinear Finite Elements, Wiley 2014, ch. 10",
        "LS-DYNA Theory Manual, Soft Constraint Penalty Formulation; SOFT and SOFSCL in the Keyword Manual, *CONTACT",
    )
    stiffening = ("beta_s", "epsilon_s", "scale")
    headline = ("beta_s",)
    examples = ({}, {"beta_s": 1.0}, {"epsilon_s": 5.0}, {"stiffness": "from-step"})
    measured = {
        "central-difference": _auto.DRAWN + "with beta_s auto at most 0.01 % in half of them, 0.02 % in 95 of 100, "
        "0.1 % in the worst; none exploded"
    }

    beta_s: _auto.BetaS = None
    epsilon_s: _auto.EpsilonS = None
    stiffness: Annotated[Literal["from-step"], Doc("scale / (s dt^2); instead of beta_s")] | None = None
    scale: Annotated[float, Gt(0), Unit("1"), Doc("of the stiffness from-step; 0.1 unless given")] | None = None

    def __post_init__(self) -> None:
        _auto.refuse_several(self, ("beta_s", "epsilon_s", "stiffness"), "stiffness")
        if self.scale is not None and self.stiffness is None:
            raise ValueError("scale is that of `stiffness: from-step`: give both or neither")

    def epsilon(self, points: ContactPoints, dt: float) -> Any:
        """Return eps_s at each contact point, (P,) [force/length]."""
        if self.stiffness is not None:
            return (self.scale or SCALE) / (points.delassus * points.coupling * dt**2)
        return _auto.limited_stiffness(self, points, dt)

    def bind(self, points: ContactPoints, dt: float) -> LinearLaw:
        """Return the linear law ``lambda / eps_s = -g``."""
        return LinearLaw(at="explicit", sigma=1.0 / self.epsilon(points, dt))

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:
        """Return the stiffness eps_s and its dimensionless form beta_s."""
        return _auto.both_forms(self.epsilon(points, dt), points)

    def chosen(self, points: ContactPoints, dt: float) -> Mapping[str, str]:
        """Return the automatic beta_s with the reason for it, or the stiffness from the step, in words."""
        if self.stiffness is not None:
            scale = self.scale or SCALE
            row = " with s summed over the row of S" if (points.coupling > 1.0 + 1e-12).any() else ""
            return {"stiffness": f"from-step: {scale:g} / (s dt^2){row}, theta <= {scale:g}"}
        return _auto.limited_stiffness_described(self, points, dt)
