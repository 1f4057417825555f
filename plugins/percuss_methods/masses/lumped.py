"""Lumped mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from percuss import Mass

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class Lumped(Mass):
    """Row-sum lumping: each node gets half the mass of each element it belongs to.

    Formula: ``M_i = (m_{i-1} + m_i) / 2``, ``m_i = rho A h_i`` the mass of the element between nodes i and i + 1.
    """

    name = "lumped"
    summary = "Half of each element's mass to each of its nodes"
    references = ("Hughes: The Finite Element Method, Dover 2000, ch. 7",)

    def nodal(self, element_mass: Floats) -> Floats:
        """Return the nodal masses, (n + 1,), from the element masses, (n,) [mass]."""
        nodal = np.zeros(element_mass.size + 1)
        nodal[:-1] += 0.5 * element_mass
        nodal[1:] += 0.5 * element_mass
        return nodal
