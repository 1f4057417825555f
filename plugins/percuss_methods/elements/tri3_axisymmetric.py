"""The three-node triangle of bodies of revolution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from percuss import SolidElement
from percuss_methods.elements._plane_cell import Nothing
from percuss_methods.elements._ring_cell import ring_forces, ring_geometry
from percuss_methods.elements.tri3 import SLOPES

if TYPE_CHECKING:
    from percuss import BodyMesh, Floats


@dataclass(frozen=True)
class Tri3Axisymmetric(SolidElement):
    """Triangle that turns about the axis x = 0, with one quadrature point at its middle.

    Formula: as `tri3`, with the hoop strain ``u_x / x`` at the middle and the volume ``2 pi x`` times that of the
    plane; masses and forces are those of the whole ring.
    """

    name = "tri3-axisymmetric"
    summary = "Three-node triangle of a body of revolution"
    linear = True
    cell = "triangle"
    dimension = 3
    about_axis = True
    locks = True
    references = ("Hughes: The Finite Element Method, Dover 2000, ch. 2.12",)
    force = staticmethod(ring_forces)

    def rule(self) -> Nothing:
        """Return nothing: slopes and volumes differ from cell to cell."""
        return Nothing()

    def geometry(self, body: BodyMesh) -> Floats:
        """Return slopes, shape functions over the radius, and volume of the only point."""
        return ring_geometry(body, self.cell, SLOPES, np.array([0.5]), np.full((1, 3), 1.0 / 3.0))

    def volumes(self, body: BodyMesh) -> Floats:
        """Return the volume of the only point on its ring."""
        return self.geometry(body)[..., -1]

    def mass_shares(self, body: BodyMesh) -> Floats:  # noqa: ARG002
        """Return thirds."""
        return np.full(3, 1.0 / 3.0)
