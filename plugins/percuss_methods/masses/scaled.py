"""Lumped mass with the mass of short elements increased."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import Doc, Gt, Le, Mass, Unit

if TYPE_CHECKING:
    from percuss import Floats, Lumping


@dataclass(frozen=True)
class Scaled(Mass):
    """Row-sum lumping after the mass of short elements has been increased, so that they allow a longer step.

    Formula: ``M_i = (m'_{i-1} + m'_i) / 2``, ``m'_i = max(m_i, (least_step m_max)^2 / m_i)``, where ``m_i = rho A h_i``
    and m_max is the mass of the longest element of the body.

    The critical step of an element by itself is ``h sqrt(m' / m) / c``, and h is in proportion to m. With m' it is at
    least `least_step` times that of the longest element of the body, and so is the critical step of the body (Irons'
    theorem, as each element has half of its mass at each node). Courant numbers count from the elements as they were;
    this step is a Courant number above 1, or `courant: auto`, or a time.

    Mass is added: momentum and weight grow by its share, waves are slower where it stands, and fronts are reflected
    there. The matrix stays diagonal; adding off-diagonal mass that leaves rigid motions alone is another method, of
    Olovsson, Simonsson and Unosson. A body of equal elements does not change.
    """

    name = "scaled"
    summary = "Lumped, with mass added to short elements for a longer step"
    references = (
        "Olovsson, Simonsson, Unosson: Selective mass scaling for explicit finite element analyses, IJNME 63 (2005), "
        "doi 10.1002/nme.1293",
        "Belytschko, Liu, Moran, Elkhodary: Nonlinear Finite Elements, Wiley 2014, ch. 6",
    )
    examples = ({"least_step": 0.5}, {"least_step": 1.0})
    expected_failures = {"total-mass": "the method adds mass to short elements, which makes their step longer"}

    least_step: Annotated[
        float, Gt(0), Le(1), Unit("1"), Doc("least critical step of an element, over that of the longest of its body")
    ]

    def nodal(self, element_mass: Floats, lumping: Lumping) -> Floats:
        """Return the nodal masses, (nodes,), from the element masses, (n,) [mass]."""
        least = (self.least_step * element_mass.max()) ** 2 / element_mass
        return lumping.at_nodes(np.maximum(element_mass, least))
