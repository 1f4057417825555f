"""The three-node triangle of bodies of revolution."""

from __future__ import annotations

from dataclasses import dataclass

from percuss_methods.elements._full_cell import RingCell, ring_forces
from percuss_methods.elements.tri3 import Tri3


@dataclass(frozen=True)
class Tri3Axisymmetric(RingCell):
    """Triangle that turns about the axis x = 0, with one quadrature point at its middle.

    Formula: as `tri3`, with the hoop strain ``u_x / x`` at the middle and the volume ``2 pi x`` times that of the
    plane; masses and forces are those of the whole ring.
    """

    name = "tri3-axisymmetric"
    summary = "Three-node triangle of a body of revolution"
    linear = True
    cell = "triangle"
    locks = True
    references = ("Hughes: The Finite Element Method, Dover 2000, ch. 2.12",)
    shapes, slopes, weights = Tri3.shapes, Tri3.slopes, Tri3.weights
    force = staticmethod(ring_forces)
