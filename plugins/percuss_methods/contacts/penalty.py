"""The penalty method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from percuss.contracts import ContactLaw, ContactPoints, Doc, Gt, Rows, Unit

DEFAULT_BETA_S = 0.25


@dataclass(frozen=True)
class Penalty(ContactLaw):
    """Penalty: a spring that pushes while the bodies overlap.

    Formula: ``lambda = eps_s <-g>``; ``eps_s = beta_s EA/h`` on the softer side.

    With central difference a closed contact lowers the critical step; on a rigid wall to the Courant number
    ``sqrt(2 / (1 + sqrt(1 + beta_s^2)))``. With Wu's predictor-corrector theta must stay below 1.
    """

    name = "penalty"
    summary = "Penalty spring on the overlap"
    references = ("Belytschko, Liu, Moran, Elkhodary: Nonlinear Finite Elements, Wiley 2014, ch. 10",)
    examples = ({}, {"beta_s": 1.0}, {"epsilon_s": 5.0})

    beta_s: Annotated[float, Gt(0), Unit("1"), Doc("stiffness over EA/h of the softer side")] | None = None
    epsilon_s: Annotated[float, Gt(0), Unit("force/length"), Doc("stiffness; instead of beta_s")] | None = None

    def __post_init__(self) -> None:
        if self.beta_s is not None and self.epsilon_s is not None:
            raise ValueError("beta_s and epsilon_s both give the stiffness: keep one")

    def stiffness(self, points: ContactPoints) -> Any:
        """Return eps_s at each point, (P,) [force/length]."""
        if self.epsilon_s is not None:
            return self.epsilon_s * points.weight
        return (DEFAULT_BETA_S if self.beta_s is None else self.beta_s) * points.stiffness

    def bind(self, points: ContactPoints, dt: float) -> Rows:  # noqa: ARG002
        """Return the row ``lambda / eps_s = -g``."""
        return Rows(at="explicit", sigma=1.0 / self.stiffness(points))

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:  # noqa: ARG002
        """Return stiffness and its dimensionless form."""
        stiffness = self.stiffness(points)
        return {"epsilon_s": stiffness, "beta_s": stiffness / points.stiffness}
