"""Lagrange multipliers by forward increments."""

from __future__ import annotations

from dataclasses import dataclass

from percuss import ContactLaw, ContactPoints, LinearLaw


@dataclass(frozen=True)
class Lagrange(ContactLaw):
    """Forward-increment Lagrange multipliers of Carpenter, Taylor and Katona.

    Formula: ``0 <= lambda_n``, ``g(u_{n+1}) >= 0``, ``lambda_n g(u_{n+1}) = 0``: the multiplier of step n is the one
    that keeps the bodies apart at its end.

    Keeps the critical step of the free bodies. Energy minus work never grows, and each closing of a contact loses some.
    """

    name = "lagrange"
    summary = "Forward-increment Lagrange multipliers, exact complementarity"
    references = (
        "Carpenter, Taylor, Katona: Lagrange constraints for transient finite element surface contact, IJNME 32 "
        "(1991), doi 10.1002/nme.1620320107",
    )

    guarantees = ("never pulls", "no penetration", "keeps the free step")

    def bind(self, points: ContactPoints, dt: float) -> LinearLaw:  # noqa: ARG002
        """Return the complementarity of ``0 <= lambda`` and ``gap at the end of the step >= 0`` as a linear law."""
        return LinearLaw(at="end", sigma=0.0, active="all", sign=">= 0")
