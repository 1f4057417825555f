"""The four-node quadrilateral."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from percuss import REFERENCE_CELLS
from percuss_methods.elements._full_cell import FullCell, plane_forces

CELL = REFERENCE_CELLS["quad"]
SHAPES, SLOPES = CELL.shape_functions(CELL.corners / np.sqrt(3.0))  # at the points of Gauss' rule


@dataclass(frozen=True)
class Quad4(FullCell):
    """Bilinear quadrilateral with four quadrature points.

    Formula: ``u = sum of N_a u_a``, ``N_a = (1 + xi xi_a)(1 + eta eta_a) / 4``; ``f_a = -sum over points of V P grad
    N_a`` with the volume V of a point and its stress P; the mass of a node is ``sum of rho V N_a``, the row sums of the
    consistent mass by the same points.

    It locks where the material is almost incompressible, and where long thin cells bend.
    """

    name = "quad4"
    summary = "Four-node quadrilateral, full integration"
    linear = True
    cell = "quad"
    dimension = 2
    locks = True
    references = ("Hughes: The Finite Element Method, Dover 2000, ch. 3",)
    shapes, slopes, weights = SHAPES, SLOPES, np.ones(4)
    force = staticmethod(plane_forces)
