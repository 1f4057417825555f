"""The eight-node hexahedron, whose volume strain is a mean."""

from __future__ import annotations

from dataclasses import dataclass

from percuss_methods.elements._full_cell import FullCell
from percuss_methods.elements._mean_dilatation import solid_forces
from percuss_methods.elements.hex8 import Hex8


@dataclass(frozen=True)
class Hex8Mean(FullCell):
    """Trilinear hexahedron, with the points of `hex8`, whose volume strain is the mean over the cell.

    Formula: the material sees ``F' = (Jm / J)^(1/3) F``, ``Jm = sum V J / sum V`` over the points of the cell, and the
    forces are the slopes of ``sum V Psi(F')``.

    It does not lock where a material flows or is almost incompressible. Strains may be of any size.
    """

    name = "hex8-mean"
    summary = "Eight-node hexahedron, mean dilatation"
    cell = "hexahedron"
    dimension = 3
    isochoric = True
    references = (
        "Nagtegaal, Parks, Rice: On numerically accurate finite element solutions in the fully plastic range, Comput. "
        "Methods Appl. Mech. Engrg. 4 (1974), doi 10.1016/0045-7825(74)90032-2",
        "Simo, Taylor, Pister: Variational and projection methods for the volume constraint in finite deformation "
        "elasto-plasticity, Comput. Methods Appl. Mech. Engrg. 51 (1985), doi 10.1016/0045-7825(85)90033-7",
    )
    shapes, slopes, weights = Hex8.shapes, Hex8.slopes, Hex8.weights
    force = staticmethod(solid_forces)
