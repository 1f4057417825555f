"""The four-node tetrahedron."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from percuss_methods.elements._full_cell import FullCell, solid_forces


@dataclass(frozen=True)
class Tet4(FullCell):
    """Tetrahedron of constant strain.

    Formula: as `tri3`, with the volume coordinates N_a; each node has a quarter of the mass.
    """

    name = "tet4"
    summary = "Four-node tetrahedron, constant strain"
    linear = True
    cell = "tetra"
    dimension = 3
    locks = True
    references = ("Hughes: The Finite Element Method, Dover 2000, ch. 3",)
    shapes = np.full((1, 4), 0.25)
    slopes = np.array([[[-1.0, -1.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]])
    weights = np.array([1.0 / 6.0])
    force = staticmethod(solid_forces)
