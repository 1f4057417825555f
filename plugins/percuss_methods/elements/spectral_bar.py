"""The spectral bar element."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import BodyMesh, CellElement, Doc, Ge, Le, Unit
from percuss_methods.elements._straight_cell import StraightRule, axial_forces, straight_rule

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class SpectralBarElement(CellElement):
    """Bar of a polynomial of any order through the Gauss-Lobatto-Legendre points; small displacements.

    Formula: ``order + 1`` nodes at the ends and at the zeros of the derivative of Legendre's polynomial of this order;
    ``strain = sum of N_a' . u_a`` at each node, ``force_a = -sum over nodes q of A h w_q stress(strain_q) N_a'(q)``,
    ``m_a = w_a m``, with the weights ``w = 1 / (order (order + 1) P_order^2)`` of the nodes.

    The same points carry stiffness and mass, so that the mass is diagonal without lumping. The error of the frequency
    of a harmonic of wave number k is of order ``(k h)^(2 order)``. The highest frequency of a uniform bar is that of a
    single element: ``2 c / h`` for order 1, which is the two-node bar, and ``sqrt(24) c / h`` for order 2. Central
    difference is stable up to 2 over that frequency, a Courant number of 1.
    """

    name = "spectral-bar"
    summary = "Bar of any order through Gauss-Lobatto-Legendre points"
    linear = True
    force = staticmethod(axial_forces)
    references = (
        "Patera: A spectral element method for fluid dynamics, J. Comput. Phys. 54 (1984), "
        "doi 10.1016/0021-9991(84)90128-1",
        "Komatitsch, Vilotte: The spectral element method, Bull. Seismol. Soc. Am. 88 (1998), "
        "doi 10.1785/BSSA0880020368",
        "Cohen: Higher-Order Numerical Methods for Transient Wave Equations, Springer 2002, "
        "doi 10.1007/978-3-662-04823-8",
    )
    examples = ({}, {"order": 1}, {"order": 2}, {"order": 3})

    order: Annotated[int, Ge(1), Le(10), Unit("1"), Doc("order of the polynomial; an element has one node more")] = 4

    @property
    def cell(self) -> str:  # type: ignore[override]
        """Kind of cells by their number of nodes."""
        return "line" if self.order == 1 else f"line{self.order + 1}"

    def rule(self) -> StraightRule:
        """Return the slopes of the shape functions at the nodes."""
        nodes, weight = lobatto(self.order)
        return straight_rule(nodes, nodes, weight)

    def reference_nodes(self) -> Floats:
        """Return the Gauss-Lobatto-Legendre points, the ends first."""
        return lobatto(self.order)[0]

    def mass_shares(self, body: BodyMesh) -> Floats:  # noqa: ARG002
        """Return the weights of the points."""
        return lobatto(self.order)[1]

    def volumes(self, body: BodyMesh) -> Floats:
        """Return the volume times the weight of each point."""
        return np.outer(body.section * body.mesh.lengths, lobatto(self.order)[1])

    def highest_frequency(self, body: BodyMesh, wave_speed: float) -> Floats:
        """Return the highest frequency of each element by itself, which is that of a uniform bar."""
        return highest_frequency(self.order) * wave_speed / body.mesh.lengths


@cache
def lobatto(order: int) -> tuple[Floats, Floats]:
    """Return points from 0 to 1, the ends first, and weights of the rule of Gauss, Lobatto and Legendre."""
    legendre = np.polynomial.Legendre.basis(order)
    inner = np.sort(legendre.deriv().roots().real)
    inner = 0.5 * (inner - inner[::-1])  # alike on both sides
    points = np.concatenate([[-1.0, 1.0], inner])
    weight = 1.0 / (order * (order + 1) * legendre(points) ** 2)
    nodes, weight = 0.5 * (1.0 + points), weight / weight.sum()
    for array in (nodes, weight):
        array.flags.writeable = False
    return nodes, weight


@cache
def highest_frequency(order: int) -> float:
    """Return the highest frequency of an element [1/time] whose length and wave speed are 1."""
    nodes, weight = lobatto(order)
    slope = straight_rule(nodes, nodes, weight).slope
    scaled = np.sqrt(weight)[:, None] * slope / np.sqrt(weight)
    return float(np.linalg.norm(scaled, 2))
