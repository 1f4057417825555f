"""The four-node quadrilateral."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from percuss_methods.elements._full_cell import FullCell, plane_forces

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
POINTS = CORNERS / np.sqrt(3.0)  # of Gauss' rule
FACTORS = 1.0 + POINTS[:, None] * CORNERS  # (points, nodes, 2): 1 + xi xi_a and 1 + eta eta_a


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
    shapes = 0.25 * FACTORS.prod(axis=-1)
    slopes = 0.25 * CORNERS * FACTORS[..., ::-1]
    weights = np.ones(4)
    force = staticmethod(plane_forces)
