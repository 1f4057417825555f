"""The four-node quadrilateral of a body of revolution, whose volume strain is a mean."""

from __future__ import annotations

from dataclasses import dataclass

from percuss_methods.elements._full_cell import RingCell
from percuss_methods.elements._mean_dilatation import MeanDilatation, ring_forces
from percuss_methods.elements.quad4 import Quad4


@dataclass(frozen=True)
class Quad4AxisymmetricMean(MeanDilatation, RingCell):
    """Bilinear quadrilateral about the axis x = 0, as `quad4-axisymmetric`, with a mean volume strain.

    Formula: the material sees ``F' = (Jm / J)^(1/3) F``, ``Jm = sum V J / sum V`` over the points of the cell, and the
    forces are the slopes of ``sum V Psi(F')``.

    It does not lock where a material flows or is almost incompressible. Strains may be of any size.
    """

    name = "quad4-axisymmetric-mean"
    summary = "Four-node quadrilateral of a body of revolution, mean dilatation"
    cell = "quad"
    components = 5
    shapes, slopes, weights = Quad4.shapes, Quad4.slopes, Quad4.weights
    force = staticmethod(ring_forces)
