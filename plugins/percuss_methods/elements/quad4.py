"""The four-node quadrilateral."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from percuss import BodyMesh, SolidElement
from percuss_methods.elements._plane_cell import Nothing, plane_forces, plane_geometry

if TYPE_CHECKING:
    from percuss import Floats

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
POINTS = CORNERS / np.sqrt(3.0)  # of Gauss' rule
SHAPES = 0.25 * (1.0 + POINTS[:, :1] * CORNERS[:, 0]) * (1.0 + POINTS[:, 1:] * CORNERS[:, 1])
SLOPES = 0.25 * np.stack(
    [CORNERS[:, 0] * (1.0 + POINTS[:, 1:] * CORNERS[:, 1]), CORNERS[:, 1] * (1.0 + POINTS[:, :1] * CORNERS[:, 0])],
    axis=-1,
)


@dataclass(frozen=True)
class Quad4(SolidElement):
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
    force = staticmethod(plane_forces)

    def rule(self) -> Nothing:
        """Return nothing: slopes and volumes differ from cell to cell."""
        return Nothing()

    def geometry(self, body: BodyMesh) -> Floats:
        """Return slopes and volume of each point."""
        return plane_geometry(body, self.cell, SLOPES, np.ones(4))

    def volumes(self, body: BodyMesh) -> Floats:
        """Return the volume of each point."""
        return self.geometry(body)[..., -1]

    def mass_shares(self, body: BodyMesh) -> Floats:
        """Return the integrals of the shape functions over the volume of the cell."""
        volumes = self.volumes(body)
        shares: Floats = volumes @ SHAPES / volumes.sum(axis=1)[:, None]
        return shares
