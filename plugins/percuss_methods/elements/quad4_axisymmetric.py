"""The four-node quadrilateral of bodies of revolution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from percuss import SolidElement
from percuss_methods.elements._plane_cell import Nothing
from percuss_methods.elements._ring_cell import ring_forces, ring_geometry
from percuss_methods.elements.quad4 import SHAPES, SLOPES

if TYPE_CHECKING:
    from percuss import BodyMesh, Floats


@dataclass(frozen=True)
class Quad4Axisymmetric(SolidElement):
    """Bilinear quadrilateral that turns about the axis x = 0, with four quadrature points.

    Formula: as `quad4`, with the hoop strain ``u_x / x`` and the volume ``2 pi x`` times that of the plane; masses and
    forces are those of the whole ring.
    """

    name = "quad4-axisymmetric"
    summary = "Four-node quadrilateral of a body of revolution, full integration"
    linear = True
    cell = "quad"
    dimension = 3
    about_axis = True
    locks = True
    references = ("Hughes: The Finite Element Method, Dover 2000, ch. 2.12",)
    force = staticmethod(ring_forces)

    def rule(self) -> Nothing:
        """Return nothing: slopes and volumes differ from cell to cell."""
        return Nothing()

    def geometry(self, body: BodyMesh) -> Floats:
        """Return slopes, shape functions over the radius, and volume of each point."""
        return ring_geometry(body, self.cell, SLOPES, np.ones(4), SHAPES)

    def volumes(self, body: BodyMesh) -> Floats:
        """Return the volume of each point on its ring."""
        return self.geometry(body)[..., -1]

    def mass_shares(self, body: BodyMesh) -> Floats:
        """Return the integrals of the shape functions over the volume of the cell."""
        volumes = self.volumes(body)
        shares: Floats = volumes @ SHAPES / volumes.sum(axis=1)[:, None]
        return shares
