"""The bipenalty method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np

from percuss.contracts import AllowInf, ContactLaw, ContactPoints, Doc, Ge, Gt, Rows, Unit

DEFAULT_BETA_S = 0.25
DEFAULT_RATIO = "matched"


@dataclass(frozen=True)
class Bipenalty(ContactLaw):
    """Bipenalty: stiffness and inertia of the overlap are penalised together, eq. (3) of Kolman et al.

    Formula: ``lambda / eps_s = -g - (eps_m / eps_s) g''``, with ``K_p = eps_s N N^T`` and the full (consistent)
    ``M_p = eps_m N N^T``. The force may pull before release; it is never clamped.

    ``eps_s = beta_s EA/h`` and ``eps_m = eps_s / (ratio omega^2)``, omega = 2c/h, both on the softer side. With
    central difference ``ratio <= 1`` never lowers the critical step. ``matched`` (eps_m = eps_s dt^2) keeps the free
    step with Wu's predictor-corrector (theta <= 1) and with central difference, whatever the bars and the mesh;
    ``free-step`` (eps_m = eps_s dt^2 / 4) is the least mass that keeps it with central difference. Without options:
    beta_s 0.25 and ratio ``matched``.
    """

    name = "bipenalty"
    summary = "Penalty on stiffness and on inertia of the overlap"
    references = (
        "Kopacka, Tkachuk, Gabriel, Kolman, Bischoff, Plesek: On stability and reflection-transmission analysis of "
        "the bipenalty method in contact-impact problems, IJNME 113 (2018), doi 10.1002/nme.5712",
        "Hetherington, Rodriguez-Ferran, Askes: The bipenalty method for arbitrary multipoint constraints, IJNME 93 "
        "(2013), doi 10.1002/nme.4389",
    )
    examples = (
        {},
        {"beta_s": 0.25, "ratio": 1.0},
        {"beta_s": 1.0, "ratio": "matched"},
        {"beta_s": 1.0, "ratio": "free-step"},
        {"beta_s": 0.5, "beta_m": 0.25},
        {"epsilon_s": 5.0, "epsilon_m": 1e-3},
    )

    beta_s: Annotated[float, Gt(0), Unit("1"), Doc("stiffness over EA/h of the softer side")] | None = None
    epsilon_s: Annotated[float, Gt(0), Unit("force/length"), Doc("stiffness; instead of beta_s")] | None = None
    ratio: (
        Annotated[float, AllowInf(), Gt(0), Unit("1"), Doc("beta_s / (2 beta_m); .inf is the penalty method")]
        | Literal["matched", "free-step"]
        | None
    ) = None
    beta_m: Annotated[float, Ge(0), Unit("1"), Doc("mass over rho A h / 2, for equal sides")] | None = None
    epsilon_m: Annotated[float, Ge(0), Unit("mass"), Doc("mass; instead of ratio or beta_m")] | None = None

    def __post_init__(self) -> None:
        if self.beta_s is not None and self.epsilon_s is not None:
            raise ValueError("beta_s and epsilon_s both give the stiffness: keep one")
        given = [name for name in ("ratio", "beta_m", "epsilon_m") if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)} all give the mass: keep one")

    def penalties(self, points: ContactPoints, dt: float) -> tuple[Any, Any]:
        """Return eps_s [force/length] and eps_m [mass] at each point, (P,) each."""
        if self.epsilon_s is not None:
            stiffness = self.epsilon_s * points.weight
        else:
            stiffness = (DEFAULT_BETA_S if self.beta_s is None else self.beta_s) * points.stiffness
        if self.epsilon_m is not None:
            return stiffness, self.epsilon_m * points.weight
        if self.beta_m is not None:
            if not points.equal_sides.all():
                unequal = points.names[int(np.argmin(points.equal_sides))]
                raise ValueError(f"beta_m is for equal sides, and contact '{unequal}' joins unlike ones: give `ratio`")
            return stiffness, self.beta_m * points.mass
        ratio = DEFAULT_RATIO if self.ratio is None else self.ratio
        if isinstance(ratio, str):
            return stiffness, stiffness * dt**2 * {"matched": 1.0, "free-step": 0.25}[ratio]
        return stiffness, stiffness / (ratio * points.frequency**2)

    def bind(self, points: ContactPoints, dt: float) -> Rows:
        """Return the row ``lambda / eps_s = -g - (eps_m / eps_s) g''``."""
        stiffness, mass = self.penalties(points, dt)
        return Rows(at="explicit", sigma=1.0 / stiffness, acceleration=mass / stiffness)

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:
        """Return both penalties and their dimensionless forms."""
        stiffness, mass = self.penalties(points, dt)
        with np.errstate(divide="ignore"):
            ratio = stiffness / (mass * points.frequency**2)
        return {
            "epsilon_s": stiffness,
            "epsilon_m": mass,
            "beta_s": stiffness / points.stiffness,
            "beta_m": mass / points.mass,
            "ratio": ratio,
        }
