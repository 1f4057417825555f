"""The four-node quadrilateral in plane strain, whose volume strain is a mean."""

from __future__ import annotations

from dataclasses import dataclass

from percuss_methods.elements._full_cell import FullCell
from percuss_methods.elements._mean_dilatation import MeanDilatation, plane_forces
from percuss_methods.elements.quad4 import Quad4


@dataclass(frozen=True)
class Quad4Mean(MeanDilatation, FullCell):
    """Bilinear quadrilateral in plane strain, as `quad4`, whose volume strain is the mean over the cell.

    Formula: the material sees ``F' = (Jm / J)^(1/3) F``, ``Jm = sum V J / sum V`` over the points of the cell, and the
    forces are the slopes of ``sum V Psi(F')``.

    It does not lock where a material flows or is almost incompressible. Strains may be of any size.
    """

    name = "quad4-mean"
    summary = "Four-node quadrilateral in plane strain, mean dilatation"
    cell = "quad"
    components = 5
    shapes, slopes, weights = Quad4.shapes, Quad4.slopes, Quad4.weights
    force = staticmethod(plane_forces)
