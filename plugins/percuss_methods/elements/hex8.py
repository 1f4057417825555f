"""The eight-node hexahedron."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from percuss_methods.elements._full_cell import FullCell, solid_forces
from percuss_methods.elements.quad4 import CORNERS as SQUARE

CORNERS = np.concatenate([np.insert(SQUARE, 2, side, axis=1) for side in (-1.0, 1.0)])
POINTS = CORNERS / np.sqrt(3.0)  # of Gauss' rule
FACTORS = 1.0 + POINTS[:, None] * CORNERS  # (points, nodes, 3): 1 + xi xi_a and so on


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
    shapes = 0.125 * FACTORS.prod(axis=-1)
    slopes = 0.125 * CORNERS * np.stack([FACTORS[..., (d + 1) % 3] * FACTORS[..., (d + 2) % 3] for d in range(3)], -1)
    weights = np.ones(8)
    force = staticmethod(solid_forces)
