"""The three-node triangle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from percuss_methods.elements._full_cell import FullCell, plane_forces


@dataclass(frozen=True)
class Tri3(FullCell):
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
    shapes = np.full((1, 3), 1.0 / 3.0)
    slopes = np.array([[[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]]])
    weights = np.array([0.5])
    force = staticmethod(plane_forces)
