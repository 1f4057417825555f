"""The eight-node hexahedron with one point and hourglass control."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from percuss_methods.elements._one_point import OnePointCell, solid_forces
from percuss_methods.elements.hex8 import CELL, Hex8

X, Y, Z = CELL.corners.T


@dataclass(frozen=True)
class Hex8OnePoint(OnePointCell):
    """Hexahedron of the mean strain, with hourglass control.

    Formula: as `quad4-one-point`, with the four modes ``h = eta zeta, zeta xi, xi eta, xi eta zeta`` at the corners,
    and ``gamma_a = (h_a - sum_b h_b x_b . grad N_a) / 8`` of each.

    In bending it locks less than full integration, but long cells are still too stiff. Plates and
    bars need some cells across to bend: with one, only the hourglass control holds them. It does not lock in an almost
    incompressible material.
    """

    name = "hex8-one-point"
    summary = "Eight-node hexahedron, one point and hourglass control"
    linear = True
    cell = "hexahedron"
    dimension = 3
    hourglass_points = 4
    references = ("Flanagan, Belytschko 1981, doi:10.1002/nme.1620170504",)
    examples = ({}, {"hourglass": 0.2})
    shapes, slopes, weights = Hex8.shapes, Hex8.slopes, Hex8.weights
    modes = np.array([Y * Z, Z * X, X * Y, X * Y * Z])
    force = staticmethod(solid_forces)
