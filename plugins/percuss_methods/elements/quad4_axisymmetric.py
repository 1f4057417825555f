"""The four-node quadrilateral of bodies of revolution."""

from __future__ import annotations

from dataclasses import dataclass

from percuss_methods.elements._full_cell import RingCell, ring_forces
from percuss_methods.elements.quad4 import Quad4


@dataclass(frozen=True)
class Quad4Axisymmetric(RingCell):
    """Bilinear quadrilateral that turns about the axis x = 0, with four quadrature points.

    Formula: as `quad4`, with the hoop strain ``u_x / x`` and the volume ``2 pi x`` times that of the plane; masses and
    forces are those of the whole ring.
    """

    name = "quad4-axisymmetric"
    summary = "Four-node quadrilateral of a body of revolution, full integration"
    linear = True
    cell = "quad"
    locks = True
    references = ("Hughes: The Finite Element Method, Dover 2000, ch. 2.12",)
    shapes, slopes, weights = Quad4.shapes, Quad4.slopes, Quad4.weights
    force = staticmethod(ring_forces)
