"""Reciprocal mass matrix."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from percuss import Doc, Ge, Le, Mass, Unit

if TYPE_CHECKING:
    from percuss import Floats, Lumping


@dataclass(frozen=True)
class Reciprocal(Mass):
    """Reciprocal mass: a tridiagonal inverse of a consistent mass matrix, assembled from those of the elements.

    Formula: ``M^-1 = A^-1 (sum over elements of A_e M_e^-1 A_e) A^-1``, with the lumped masses A_e of an element and A
    of the body, and ``M_e = m_e / 6 [[3 - b, b], [b, 3 - b]]``, b the `consistency`: 0 is `lumped`, to the last bit,
    and 1 the consistent mass of each element.

    A body that moves as a whole has its mass, with any b: ``M^-1 A 1 = 1``. An element that stretches is lighter than
    lumped by the factor ``s = 1 / (1 - 2 b / 3)``, and a wave of a uniform bar has the frequency
    ``(omega h / c)^2 = 2 z + (s - 1) z^2``, ``z = 1 - cos(kappa h)``: that of a long wave is too high by a share of
    ``(2 b / (3 - 2 b) - 1/3) (kappa h)^2 / 8``. So b = 3/8 is of fourth order in space; with a leap-frog scheme at the
    Courant number C it is ``b = 3 (1 - C^2) / (2 (4 - C^2))``, and C is below the critical one then. The consistent
    mass matrix itself is too high by ``(kappa h)^2 / 24``, the matrix with b = 1 by five times that.

    The critical Courant number of a uniform bar without contact is ``1 / sqrt(s)`` from b = -3/2 on: 0.577 with b = 1,
    that of the consistent mass matrix, 0.866 with b = 3/8, and 1.414 with b = -3/2, which is selective mass scaling:
    short waves are slower, and the mass is the same. Below b = -3/2 the shortest wave is not the fastest any more.

    Contact moves the end by ``(1 + s) / 2`` of what it would with lumped mass, and the node beside it by ``(1 - s) /
    4``, which the contact equation and its stability limits include. The stress at an end, which `nitsche` uses,
    follows from the accelerations of both nodes. The certificate is `unknown` for laws with a kernel, and wherever only
    the black box could decide.
    """

    name = "reciprocal"
    summary = "Tridiagonal inverse of a consistent mass"
    references = (
        "Tkachuk, Bischoff: Direct and sparse construction of consistent inverse mass matrices: general variational "
        "formulation and application to selective mass scaling, IJNME 101 (2015), doi 10.1002/nme.4805",
        "Gonzalez, Kolman, Cho, Felippa, Park: Inverse mass matrix via the method of localized Lagrange multipliers, "
        "IJNME 113 (2018), doi 10.1002/nme.5613",
    )
    examples = ({}, {"consistency": 0.375}, {"consistency": -1.5})

    consistency: Annotated[
        float, Ge(-1.5), Le(1), Unit("1"), Doc("share of the consistent mass of each element; 0 is lumped")
    ] = 1.0

    def nodal(self, element_mass: Floats, lumping: Lumping) -> Floats:
        """Return the nodal masses, (nodes,), of a body that moves as a whole, from the element masses, (n,) [mass]."""
        return lumping.at_nodes(element_mass)

    def inverse(self, element_mass: Floats, lumping: Lumping) -> Any:
        """Return M^-1, which is tridiagonal, (nodes, nodes) [1/mass]."""
        if self.consistency == 0.0:
            return None
        from scipy.sparse import diags_array

        lumped = lumping.at_nodes(element_mass)
        # A_e M_e^-1 A_e is m_e / 4 [[1 + s, 1 - s], [1 - s, 1 + s]]: s is how much lighter an element is when it
        # stretches than when it moves.
        lighter = 1.0 / (1.0 - 2.0 / 3.0 * self.consistency)
        diagonal = 0.5 * (1.0 + lighter) / lumped
        beside = 0.25 * (1.0 - lighter) * element_mass / (lumped[:-1] * lumped[1:])
        return diags_array([beside, diagonal, beside], offsets=[-1, 0, 1])
