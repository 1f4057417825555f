"""The eight-node hexahedron, whose volume strain is a mean."""

from __future__ import annotations

from dataclasses import dataclass

from percuss_methods.elements._full_cell import FullCell
from percuss_methods.elements._mean_dilatation import MeanDilatation, solid_forces
from percuss_methods.elements.hex8 import Hex8


@dataclass(frozen=True)
class Hex8Mean(MeanDilatation, FullCell):
    """Trilinear hexahedron, with the points of `hex8`, whose volume strain is the mean over the cell.

    Formula: the material sees ``F' = (Jm / J)^(1/3) F``, ``Jm = sum V J / sum V`` over the points of the cell, and the
    forces are the slopes of ``sum V Psi(F')``.

    It does not lock where a material flows or is almost incompressible. Strains may be of any size.
    """

    name = "hex8-mean"
    summary = "Eight-node hexahedron, mean dilatation"
    cell = "hexahedron"
    components = 9
    shapes, slopes, weights = Hex8.shapes, Hex8.slopes, Hex8.weights
    force = staticmethod(solid_forces)
