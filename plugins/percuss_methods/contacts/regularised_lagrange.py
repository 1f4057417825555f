"""Regularised Lagrange multipliers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from percuss import ContactLaw, ContactPoints, LinearLaw
from percuss_methods.contacts import _auto


@dataclass(frozen=True)
class RegularisedLagrange(ContactLaw):
    """Forward-increment Lagrange multipliers with a compliance: a penalty on the gap at the end of the step.

    Formula: ``0 <= lambda_n``, ``g(u_{n+1}) + lambda_n / eps_s >= 0``, one of them zero, so that
    ``lambda_n = eps_s <-g(u_{n+1})>``; ``eps_s = beta_s EA/h`` on the softer side. ``1/eps_s = 0`` is `lagrange`.

    Every stiffness keeps the critical step of the free bodies. Energy of the bodies minus work plus
    ``eps_s/4 (<-g_{n+1}>^2 + <-g_n>^2)`` never grows; closed contacts damp. At ends in no other contact the law is
    Wu's predictor-corrector with `bipenalty` of the same eps_s and the mass `matched`.
    """

    name = "regularised-lagrange"
    summary = "Lagrange multipliers with a compliance: an implicit penalty, stable with any stiffness"
    references = (
        "Simo, Wriggers, Taylor: A perturbed Lagrangian formulation for the finite element solution of contact "
        "problems, CMAME 50 (1985), doi 10.1016/0045-7825(85)90088-X",
        "Carpenter, Taylor, Katona: Lagrange constraints for transient finite element surface contact, IJNME 32 "
        "(1991), doi 10.1002/nme.1620320107",
    )
    guarantees = ("never pulls", "keeps the free step")
    headline = ("beta_s",)

    beta_s: _auto.BetaS = None
    epsilon_s: _auto.EpsilonS = None

    def __post_init__(self) -> None:
        _auto.refuse_several(self, ("beta_s", "epsilon_s"), "stiffness")

    def bind(self, points: ContactPoints, dt: float) -> LinearLaw:  # noqa: ARG002
        """Return the complementarity of ``0 <= lambda`` and ``g_{n+1} + lambda / eps_s >= 0`` as a linear law."""
        return LinearLaw(at="end", sigma=1.0 / _auto.any_stiffness(self, points), active="all", sign=">= 0")

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:  # noqa: ARG002
        """Return the stiffness eps_s and its dimensionless form beta_s."""
        return _auto.both_forms(_auto.any_stiffness(self, points), points)

    def chosen(self, points: ContactPoints, dt: float) -> Mapping[str, str]:  # noqa: ARG002
        """Return the automatic beta_s with the reason for it, in words."""
        return _auto.any_stiffness_described(self)
