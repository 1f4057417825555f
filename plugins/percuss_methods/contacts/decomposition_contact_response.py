"""Decomposition contact response: corrected positions, and velocities reflected with restitution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from percuss import ContactLaw, ContactPoints, Doc, Ge, Le, Unit

if TYPE_CHECKING:
    from percuss import Floats, Trial


WHY_ENERGY_MAY_GROW = "the shift does work against the stress of the end elements, and nothing bounds that work"


class Restitution(NamedTuple):
    """The coefficient of restitution e of the nodes in contact."""

    e: float


@dataclass(frozen=True)
class DecompositionContactResponse(ContactLaw):
    """Decomposition contact response: where a step would overlap, positions touch and velocities are reflected.

    Formula: where ``g_{n+1} < 0`` without contact: ``g_{n+1} = 0`` by a shift of the nodes in contact along
    ``M^-1 N``, and ``g'_{n+1/2} = -e g'`` with g' the rate without contact; elsewhere nothing.

    The paper divides the momentum of the nodes in contact into a part that changes the gap and the rest, and reflects
    the former; positions are moved to the nearest ones without overlap. In one dimension that is the formula. A closed
    contact is a sequence of small impacts: with e = 0 the nodes stay together, with e = 1 they part and meet again
    every few steps, so that the force of single steps is spiky while its mean over them is not. The kinetic energy of
    the gap rate is lost with e = 0 and kept with e = 1; the shift does work against the stress of the end elements in
    either case. With e near 1 and a step near the critical one of the free bodies that work and the energy may grow
    without bound. A closed contact is reflected in some steps and only moved in others, so the certificate is `unknown`
    at best.
    """

    name = "decomposition-contact-response"
    summary = "Decomposition contact response: positions corrected, velocities reflected"
    references = (
        "Cirak, West: Decomposition contact response (DCR) for explicit finite element dynamics, IJNME 64 (2005) "
        "1078-1110, doi 10.1002/nme.1400",
    )
    examples = ({}, {"restitution": 0.5}, {"restitution": 1.0})
    guarantees = ("never pulls", "no penetration")
    headline = ("restitution",)
    shifts = True
    expected_failures = {
        "energy-never-grows with central-difference": WHY_ENERGY_MAY_GROW,
        "energy-never-grows with wu-predictor-corrector": WHY_ENERGY_MAY_GROW,
    }

    restitution: Annotated[float, Ge(0), Le(1), Unit("1"), Doc("e of the nodes in contact")] = 0.0

    def bind(self, points: ContactPoints, dt: float) -> Restitution:  # noqa: ARG002
        """Return the coefficient of restitution."""
        return Restitution(self.restitution)

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:  # noqa: ARG002
        """Return the coefficient of restitution."""
        return {"restitution": self.restitution}

    @staticmethod
    def multipliers(bound: Restitution, trial: Trial, multiplier: Floats) -> None:
        """Set the force that reflects the gap rate, and the shift that closes the gap to zero, of each point."""
        for p in range(multiplier.size):
            multiplier[p] = 0.0
            if trial.predicted_gap[p] < 0.0:
                rate = trial.predicted_rate[p]
                multiplier[p] = max(-(1.0 + bound.e) * rate, 0.0) / (trial.rate_response * trial.delassus[p])
                gap = trial.predicted_gap[p] + trial.gap_response * trial.delassus[p] * multiplier[p]
                trial.shift[p] = -gap / trial.delassus[p]
