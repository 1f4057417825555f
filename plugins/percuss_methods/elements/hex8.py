"""The eight-node hexahedron."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from percuss import REFERENCE_CELLS
from percuss_methods.elements._full_cell import FullCell, solid_forces

CELL = REFERENCE_CELLS["hexahedron"]
SHAPES, SLOPES = CELL.shape_functions(CELL.corners / np.sqrt(3.0))  # at the points of Gauss' rule


@dataclass(frozen=True)
class Hex8(FullCell):
    """Trilinear hexahedron with eight quadrature points.

    Formula: as `quad4`, with ``N_a = (1 + xi xi_a)(1 + eta eta_a)(1 + zeta zeta_a) / 8``.

    It locks where the material is almost incompressible, and where thin plates and long thin bars bend.
    """

    name = "hex8"
    summary = "Eight-node hexahedron, full integration"
    linear = True
    cell = "hexahedron"
    dimension = 3
    locks = True
    references = ("Hughes: The Finite Element Method, Dover 2000, ch. 3",)
    shapes, slopes, weights = SHAPES, SLOPES, np.ones(8)
    force = staticmethod(solid_forces)
