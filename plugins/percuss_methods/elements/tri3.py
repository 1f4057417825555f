"""The three-node triangle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from percuss import BodyMesh, SolidElement
from percuss_methods.elements._plane_cell import Nothing, forces_of_one_point, plane_geometry

if TYPE_CHECKING:
    from percuss import Floats

SLOPES = np.array([[[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]]])


@dataclass(frozen=True)
class Tri3(SolidElement):
    """Triangle of constant strain.

    Formula: ``u = sum of N_a u_a`` with the area coordinates N_a; ``f_a = -V P grad N_a``; each node has a third of the
    mass.
    """

    name = "tri3"
    summary = "Three-node triangle, constant strain"
    linear = True
    cell = "triangle"
    dimension = 2
    locks = True
    references = ("Hughes: The Finite Element Method, Dover 2000, ch. 3",)
    force = staticmethod(forces_of_one_point)

    def rule(self) -> Nothing:
        """Return nothing: slopes and volumes differ from cell to cell."""
        return Nothing()

    def geometry(self, body: BodyMesh) -> Floats:
        """Return slopes and volume of the only point."""
        return plane_geometry(body, self.cell, SLOPES, np.array([0.5]))

    def volumes(self, body: BodyMesh) -> Floats:
        """Return the volume of the only point."""
        return self.geometry(body)[..., -1]

    def mass_shares(self, body: BodyMesh) -> Floats:  # noqa: ARG002
        """Return thirds."""
        return np.full(3, 1.0 / 3.0)
