"""The four-node quadrilateral."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from percuss_methods.elements._full_cell import FullCell, plane_forces

if TYPE_CHECKING:
    from percuss import Floats

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def bilinear(places: Floats) -> tuple[Floats, Floats]:
    """Return the shape functions of a quadrilateral, (points, 4), and their slopes, (points, 4, 2), at places of it."""
    factors = 1.0 + places[:, None] * CORNERS  # 1 + xi xi_a and 1 + eta eta_a
    return 0.25 * factors.prod(axis=-1), 0.25 * CORNERS * factors[..., ::-1]


SHAPES, SLOPES = bilinear(CORNERS / np.sqrt(3.0))  # at the points of Gauss' rule


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
