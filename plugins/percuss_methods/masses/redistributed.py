"""Mass redistribution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from percuss import Doc, Mass

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from percuss import Floats, Lumping

LEAST_SHARE = 0.5  # of its lumped mass that every node keeps
# Some bars of equal elements leave a node exactly that share. The shares come from a small system of equations, whose
# round-off depends on the units: a miss by less than this counts as met.
ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Redistributed(Mass):
    """Mass redistribution: ends in contact have no mass, so that contact excites no oscillation of a mass against it.

    Formula: ``M_i = 0`` at ends in contact, ``M_i = m_i (1 + a + b x_i + c x_i^2)`` at all other nodes. m_i is the
    lumped mass, x_i the position along the body, and a, b and c preserve mass, centre of mass and moment of inertia.

    These three are what Khenous, Laborde and Renard preserve; of all masses that do, these are the nearest to the
    lumped ones, ``sum (M_i - m_i)^2 / m_i``. If a node lost more than half of its mass, c is zero and the moment of
    inertia changes, or b too and the centre of mass moves: of equal elements this is so with fewer than 5 of them and
    one end in contact, and with fewer than 7 and both. An element in contact at both of its ends keeps its mass, as do
    ends on which a support, a drive or a load acts. ``moved_to: neighbour`` gives the mass of an end to the node beside
    it instead, which preserves the mass alone, and never lowers the step that lumped bars allow without contact, unless
    a force acts on the other end in contact, so that it has mass and moves.

    An end without mass is in static balance with its contact at t_n, so that all leap-frog schemes without viscosity
    are one method. It requires linear laws that do not weigh the gap acceleration, and linear bodies. Its critical step
    is that of central difference with the law and the end element as springs in series: 0.9963 of the one with lumped
    mass for a bar of 100 elements. Energy changes only where a contact opens or closes: ten bounces of 100 elements at
    a Courant number of 0.5 (`cases/doyen-bounce.yaml`) keep 0.98 of it with `lagrange`, and 0.9997 with `penalty` and a
    beta_s of 0.25.

    The singular mass of Renard, with velocities constant in each element, is another matrix: the sum of
    ``m_e / 4 [[1, 1], [1, 1]]`` over the elements. It has no mass for the one motion in which neighbours move in
    opposite directions, but some at every node, and is not diagonal; its row sums are `lumped`.
    """

    name = "redistributed"
    summary = "Lumped, with the mass of ends in contact moved into the body"
    references = (
        "Khenous, Laborde, Renard: Mass redistribution method for finite element contact problems in elastodynamics, "
        "Eur. J. Mech. A/Solids 27 (2008), doi 10.1016/j.euromechsol.2008.01.001",
        "Doyen, Ern, Piperno: Time-integration schemes for the finite element dynamic Signorini problem, SIAM J. Sci. "
        "Comput. 33 (2011), doi 10.1137/100791440",
        "Renard: The singular dynamic method for constrained second order hyperbolic equations, J. Comput. Appl. Math. "
        "234 (2010), doi 10.1016/j.cam.2010.01.058",
    )
    examples = ({}, {"moved_to": "neighbour"})

    moved_to: Annotated[Literal["body", "neighbour"], Doc("nodes that take the mass of ends in contact")] = "body"

    def nodal(self, element_mass: Floats, lumping: Lumping) -> Floats:
        """Return the nodal masses of a body without contact, (nodes,), from the element masses, (n,) [mass]."""
        return lumping.at_nodes(element_mass)

    def nodal_in_contact(self, element_mass: Floats, lumping: Lumping, in_contact: NDArray[np.bool_]) -> Floats:
        """Return the nodal masses of a body with one end or both in contact, (nodes,) [mass]."""
        lumped = self.nodal(element_mass, lumping)
        ends = in_contact
        if ends.all():
            return lumped
        if self.moved_to == "neighbour":
            lumped[1] += ends[0] * lumped[0]
            lumped[-2] += ends[-1] * lumped[-1]
            return np.where(ends, 0.0, lumped)
        rest = ~ends
        position = np.append(0.0, np.cumsum(element_mass)) / element_mass.sum() - 0.5
        for moments in range(min(3, int(rest.sum())), 0, -1):
            powers = np.vander(position, moments, increasing=True)
            lost = lumped[ends] @ powers[ends]
            share = powers[rest] @ np.linalg.solve(powers[rest].T * lumped[rest] @ powers[rest], lost)
            if share.min() >= LEAST_SHARE - 1.0 - ROUND_OFF:
                break
        lumped[ends] = 0.0
        lumped[rest] *= 1.0 + share
        return lumped
