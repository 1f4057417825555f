"""Impact law on the gaps before and after a step, with restitution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from percuss import ContactLaw, ContactPoints, Doc, Ge, Integrator, Le, LinearLaw, Unit
from percuss_methods.contacts import _leap_frog

WHY_ENERGY_MAY_GROW = "with restitution the force does positive work on bodies that overlapped one step before"


@dataclass(frozen=True)
class PaoliSchatzman(ContactLaw):
    """Unilateral constraint on a weighted mean of the gaps one step before and one step after a force.

    Formula: ``0 <= lambda_n``, ``g(u_{n+1}) + e g(u_{n-1}) >= 0``, one of them zero; ``u_{-1} = u_0 - dt v_{-1/2}``.
    e = 0 is the forward-increment method, `lagrange`.

    A node that strikes at constant speed leaves with e times its speed exactly, two steps after the first force, and
    overlaps by at most its motion in one step. The contact work of a step is ``-(1 + e) lambda_n g(u_{n-1}) / 2``,
    positive where the bodies overlapped one step before. With e = 0 they never do, and energy minus work never grows.
    With e above 0 bars that stay together for many steps may gain much energy in a single impact; a shorter step
    reduces it. A step that is stable without contact is stable with any contacts held closed.
    """

    name = "paoli-schatzman"
    summary = "Impact law on the gaps before and after a step, with restitution"
    references = (
        "Paoli, Schatzman: A numerical scheme for impact problems I: the one-dimensional case, SIAM J. Numer. Anal. 40 "
        "(2002), doi 10.1137/S0036142900378728",
    )
    guarantees = ("never pulls",)
    headline = ("restitution",)
    expected_failures = {
        "energy-never-grows with central-difference": WHY_ENERGY_MAY_GROW,
        "energy-never-grows with wu-predictor-corrector": WHY_ENERGY_MAY_GROW,
    }
    examples = ({}, {"restitution": 0.5})

    restitution: Annotated[float, Ge(0), Le(1), Unit("1"), Doc("e of the nodes in contact")] = 0.0

    def bind(self, points: ContactPoints, dt: float) -> LinearLaw:  # noqa: ARG002
        """Return the complementarity of ``0 <= lambda`` and ``g_{n+1} + e g_{n-1} >= 0`` as a linear law.

        In a leap-frog step ``g_{n-1} = g_{n+1} - 2 dt g'_{n+1/2} + dt^2 g''``.
        """
        e = self.restitution
        return LinearLaw(
            at="end",
            sigma=0.0,
            gap=1.0 + e,
            rate=-2.0 * e * dt,
            acceleration=e * dt**2,
            active="all",
            sign=">= 0",
        )

    def refuses(self, integrator: Integrator) -> str | None:
        """Refuse schemes that are no leap-frog."""
        return _leap_frog.reason_against(integrator, "the gaps one step before and after a force")
