"""Reciprocal mass matrix."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import Doc, Ge, Le, Mass, Unit

if TYPE_CHECKING:
    from percuss import Floats, Lumping


@dataclass(frozen=True)
class Reciprocal(Mass):
    """Reciprocal mass: a tridiagonal inverse of a consistent mass matrix, assembled from those of the elements.

    Formula: ``M^-1 = A^-1 (sum over elements of A_e M_e^-1 A_e) A^-1``, with the lumped masses A_e of an element and A
    of the body, and ``M_e = m_e / 6 [[3 - b, b], [b, 3 - b]]``, b the `consistency`: 0 is `lumped`, to the last bit,
    and 1 the consistent mass of each element.
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

    def inverse(self, element_mass: Floats, lumping: Lumping) -> Floats | None:
        """Return the diagonal of M^-1 and the one beside it, (2, nodes) [1/mass]."""
        if self.consistency == 0.0:
            return None
        lumped = lumping.at_nodes(element_mass)
        # A_e M_e^-1 A_e is m_e / 4 [[1 + s, 1 - s], [1 - s, 1 + s]]: s is how much lighter an element is when it
        # stretches than when it moves.
        lighter = 1.0 / (1.0 - 2.0 / 3.0 * self.consistency)
        bands = np.zeros((2, lumped.size))
        bands[0] = 0.5 * (1.0 + lighter) / lumped
        bands[1, :-1] = 0.25 * (1.0 - lighter) * element_mass / (lumped[:-1] * lumped[1:])
        return bands
