"""The four-node quadrilateral with one point and hourglass control."""

from __future__ import annotations

from dataclasses import dataclass

from percuss_methods.elements._one_point import OnePointCell, plane_forces
from percuss_methods.elements.quad4 import CELL, Quad4


@dataclass(frozen=True)
class Quad4OnePoint(OnePointCell):
    """Quadrilateral of the mean strain, with hourglass control.

    Formula: ``f_a = -V (P grad N_a + C q gamma_a)`` with the means ``grad N_a`` over the cell, its stress P at the mean
    strain, ``C = 4 hourglass G sum_b |grad N_b|^2``, the shear modulus G, ``q = sum of gamma_a u_a`` and ``gamma_a =
    (h_a - sum_b h_b x_b . grad N_a) / 4``, ``h = (1, -1, 1, -1)``. Linear displacements have no q. The default is the
    stiffness of 0.05 of the modulus of longitudinal waves where Poisson's ratio is 1/3.

    In bending it locks less than full integration, but long cells are still too stiff. A strip needs
    some cells across to bend: with one, only the hourglass control holds it.
    """

    name = "quad4-one-point"
    summary = "Four-node quadrilateral, one point and hourglass control"
    linear = True
    cell = "quad"
    dimension = 2
    hourglass_points = 1
    references = ("Flanagan, Belytschko 1981, doi:10.1002/nme.1620170504",)
    examples = ({}, {"hourglass": 0.2})
    shapes, slopes, weights = Quad4.shapes, Quad4.slopes, Quad4.weights
    modes = CELL.corners.prod(axis=1)[None]
    force = staticmethod(plane_forces)
