"""The bipenalty method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np

from percuss import AllowInf, ContactLaw, ContactPoints, Doc, Ge, Gt, Integrator, LeapFrog, LinearLaw, Unit
from percuss_methods.contacts import _auto

DEFAULT_RATIO = "matched"
SHARES = {"matched": 1.0, "free-step": 0.25, "zero-penetration": 1.0}  # eps_m over eps_s dt^2
SHARED_END_TOLERANCE = 1e-9
AUTOMATIC_X = 2.0  # dt^2 eps_s s that `auto` chooses with zero-penetration, for which eps_m = 1/s


@dataclass(frozen=True)
class Bipenalty(ContactLaw):
    """Bipenalty: a penalty on both stiffness and inertia of the overlap, eq. (3) of Kolman et al.

    Formula: ``lambda / eps_s = -g - (eps_m / eps_s) g''``, with ``K_p = eps_s N N^T`` and the full (consistent)
    ``M_p = eps_m N N^T``. The force may pull before release; it is never clamped.

    ``eps_s = beta_s EA/h`` with EA/h of the softer side, and ``eps_m = eps_s / (ratio omega^2)`` with omega the smaller
    2c/h of the two sides. With central difference and ``ratio <= 1`` every step up to a Courant number of 1 of the
    smallest element is stable; without contact a coarse or a graded mesh may allow a longer step, which ``ratio = 1``
    may lower. ``matched``, the default (eps_m = eps_s dt^2), keeps the critical step of the free bodies with Wu's
    predictor-corrector (theta <= 1) and with central difference, whatever the bars and the mesh; ``free-step`` (eps_m =
    eps_s dt^2 / 4) is the least mass that keeps it with central difference. ``zero-penetration``, for schemes that give
    a law the predicted gap, is the mass with which the corrector removes the whole predicted overlap of a step: ``theta
    = dt^2 eps_s s / (1 + eps_m s) = 1``, so ``eps_m = eps_s dt^2 - 1/s``, whatever the stiffness; a smaller stiffness
    is raised to 1 / (dt^2 s). The penalty then stores no energy, and the force is that of Lagrange multipliers. At a
    wall 1/s is the mass of the node, between two bodies that of both nodes in series. ``auto``, the default of beta_s,
    is beta_s = 1/2, lowered so that ``theta <= 0.8`` and central difference keeps its step up to a Courant number of
    0.99; with ``matched`` it is never lowered. On the shipped cases, at Courant numbers .5 and .9, the penetration is
    at most 2.8 times the compression of an end element under the peak force with central difference, and 2.4 times with
    Wu's predictor-corrector; the L1 error of the force is at most 9 %, the peak at most 20 % too high, and no energy
    beyond 1 % is gained with central difference, none with Wu's predictor-corrector.
    """

    name = "bipenalty"
    summary = "Penalty on stiffness and on inertia of the overlap"
    references = (
        "Kopacka, Tkachuk, Gabriel, Kolman, Bischoff, Plesek: On stability and reflection-transmission analysis of "
        "the bipenalty method in contact-impact problems, IJNME 113 (2018), doi 10.1002/nme.5712",
        "Hetherington, Rodriguez-Ferran, Askes: The bipenalty method for arbitrary multipoint constraints, IJNME 93 "
        "(2013), doi 10.1002/nme.4389",
        "Kwon, Kim, Cho, Gonzalez: A stabilized bipenalty formulation using a predictor-corrector scheme for explicit "
        "contact-impact analysis, IJNME 126 (2025), doi 10.1002/nme.70119; only the abstract was read, and "
        "`zero-penetration` is derived from the condition in it",
    )
    stiffening = ("beta_s", "epsilon_s", "ratio")
    headline = ("beta_s", "ratio")
    examples = (
        {},
        {"beta_s": 0.25, "ratio": 1.0},
        {"beta_s": 1.0, "ratio": "matched"},
        {"beta_s": 1.0, "ratio": "free-step"},
        {"beta_s": 0.5, "beta_m": 0.25},
        {"epsilon_s": 5.0, "epsilon_m": 1e-3},
    )
    needs_only_response_of = {
        "acceleration": "the penalty mass resists the acceleration that the contact force itself brings; Wu's "
        "predictor-corrector applies it there alone, a_corr = (M + M_p)^-1 f_cont"
    }
    measured = {
        "central-difference": _auto.DRAWN + "with beta_s auto and matched at most 0.08 % in half of them, 2.1 % in 95 "
        "of 100, 17 % in the worst; none exploded. With beta_s 1: 0.23 %, 11 %, 410 %; with ratio 1 too: 1.5 %, 23 %, "
        "and 1 of 400 exploded"
    }

    beta_s: _auto.BetaS = None
    epsilon_s: _auto.EpsilonS = None
    ratio: (
        Annotated[float, AllowInf(), Gt(0), Unit("1"), Doc("beta_s / (2 beta_m); .inf is the penalty method")]
        | Literal["matched", "free-step", "zero-penetration"]
        | None
    ) = None
    beta_m: Annotated[float, Ge(0), Unit("1"), Doc("mass over rho A h / 2, for equal sides")] | None = None
    epsilon_m: Annotated[float, Ge(0), Unit("mass"), Doc("mass; instead of ratio or beta_m")] | None = None

    def __post_init__(self) -> None:
        _auto.refuse_several(self, ("beta_s", "epsilon_s"), "stiffness")
        _auto.refuse_several(self, ("ratio", "beta_m", "epsilon_m"), "mass")

    def penalties(self, points: ContactPoints, dt: float) -> tuple[Any, Any]:
        """Return eps_s [force/length] and eps_m [mass] at each contact point, (P,) each."""
        own, share = self.mass(points, dt)
        if self.epsilon_s is not None:
            stiffness = self.epsilon_s * points.weight
        elif self.beta_s in {None, "auto"}:
            stiffness = self.automatic(points, dt).beta_s * points.stiffness
        else:
            stiffness = self.beta_s * points.stiffness
        if self.ratio == "zero-penetration":
            # At the least stiffness the mass is zero, up to round-off.
            stiffness = np.maximum(stiffness, self.least_stiffness(points, dt))
            return stiffness, np.maximum(own + share * stiffness, 0.0)
        return stiffness, own + share * stiffness

    def least_stiffness(self, points: ContactPoints, dt: float) -> Any:
        """Return the least eps_s whose overlap in a step some penalty mass removes, (P,) [force/length]."""
        return 1.0 / (dt**2 * points.delassus)

    def automatic(self, points: ContactPoints, dt: float) -> _auto.Choice:
        """Return the beta_s that the law chooses by itself, with the reasons."""
        if self.ratio != "zero-penetration":
            return _auto.choose_beta_s(points, dt, *self.mass(points, dt))
        why = ("twice the least stiffness whose overlap a penalty mass removes",)
        return _auto.Choice(AUTOMATIC_X * self.least_stiffness(points, dt) / points.stiffness, why)

    def mass(self, points: ContactPoints, dt: float) -> tuple[Any, Any]:
        """Return the two parts of ``eps_m = own + share eps_s``: own [mass] and share [time^2]."""
        if self.epsilon_m is not None:
            return self.epsilon_m * points.weight, 0.0
        if self.beta_m is not None and not points.equal_sides.all():
            unequal = points.names[int(np.argmin(points.equal_sides))]
            raise ValueError(f"beta_m is for equal sides, and contact '{unequal}' joins unequal ones: give `ratio`")
        if self.beta_m is not None:
            return self.beta_m * points.mass, 0.0
        ratio = self.ratio or DEFAULT_RATIO
        if ratio == "zero-penetration":
            if (points.coupling > 1.0 + SHARED_END_TOLERANCE).any():
                shared = points.names[int(np.argmax(points.coupling))]
                raise ValueError(
                    f"contact '{shared}' shares an end with another contact, whose force moves that end too: no mass "
                    "of its own makes its overlap zero; `matched` or `lagrange` is for such contacts"
                )
            return -1.0 / points.delassus, SHARES[ratio] * dt**2
        return 0.0, SHARES[ratio] * dt**2 if isinstance(ratio, str) else 1.0 / (ratio * points.frequency**2)

    def bind(self, points: ContactPoints, dt: float) -> LinearLaw:
        """Return the linear law ``lambda / eps_s = -g - (eps_m / eps_s) g''``."""
        eps_s, eps_m = self.penalties(points, dt)
        return LinearLaw(at="explicit", sigma=1.0 / eps_s, acceleration=eps_m / eps_s)

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:
        """Return both penalty parameters and their dimensionless forms."""
        eps_s, eps_m = self.penalties(points, dt)
        with np.errstate(divide="ignore"):
            ratio = eps_s / (eps_m * points.frequency**2)
        betas = {"beta_s": eps_s / points.stiffness, "beta_m": eps_m / points.mass, "ratio": ratio}
        return {"epsilon_s": eps_s, "epsilon_m": eps_m, **betas}

    def chosen(self, points: ContactPoints, dt: float) -> Mapping[str, str]:
        """Return the automatic beta_s with the reason for it, in words."""
        automatic = self.epsilon_s is None and self.beta_s in {None, "auto"}
        if automatic:
            return _auto.described(self.automatic(points, dt))
        given = self.epsilon_s * points.weight if self.epsilon_s is not None else self.beta_s * points.stiffness
        stiffness, _ = self.penalties(points, dt)
        if (stiffness > given).any():
            why = ("raised to the least stiffness whose overlap a penalty mass removes",)
            return _auto.described(_auto.Choice(stiffness / points.stiffness, why), "given")
        return {}

    def refuses(self, integrator: Integrator) -> str | None:
        """Return why `zero-penetration` makes no sense with a scheme that gives a law the current gap, or None."""
        if self.ratio != "zero-penetration":
            return None
        table = integrator.bind(1.0)
        if isinstance(table, LeapFrog) and table.explicit.gap == "predicted":
            return None
        return (
            "the mass of `zero-penetration` removes the gap that the scheme predicts for the end of the step, and "
            f"{integrator.name} shows the gap before the step"
        )
