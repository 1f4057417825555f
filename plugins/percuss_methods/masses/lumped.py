"""Lumped mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from percuss import Mass

if TYPE_CHECKING:
    from percuss import Floats, Lumping


@dataclass(frozen=True)
class Lumped(Mass):
    """Row-sum lumping: each node gets its share of the mass of each element it belongs to.

    Formula: ``M_i = (m_{i-1} + m_i) / 2`` in a line of two-node elements, ``m_i = rho A h_i`` the mass of the element
    between nodes i and i + 1. The shares of elements with more nodes are those that the element says.
    """

    name = "lumped"
    summary = "Each element's mass to its nodes, half to each of two"
    references = ("Hughes: The Finite Element Method, Dover 2000, ch. 7",)

    def nodal(self, element_mass: Floats, lumping: Lumping) -> Floats:
        """Return the nodal masses, (nodes,), from the element masses, (n,) [mass]."""
        return lumping.at_nodes(element_mass)
