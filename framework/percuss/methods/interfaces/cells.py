"""The kinds of cells: corners, facets and shape functions of a cell in its own coordinates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from percuss.methods.interfaces.base import Floats, Integers


class ReferenceCell(NamedTuple):
    """A kind of cell in its own coordinates, with the order of nodes of VTK and meshio.

    Attributes
    ----------
    corners : (nodes, dim) array
        Coordinates of its nodes: -1 and 1 of lines, quadrilaterals and hexahedra, 0 and 1 of triangles and tetrahedra.
    facets : (facets, nodes of a facet) array
        Its facets, counter-clockwise as seen from outside; edges of a plane cell have it on their left.
    kind_of_facet
        Kind of its facets; empty for the ends of a line.
    beside : (k, dim) array
        Corners next to its first k corners, in space anticlockwise as seen from there. All corners, or of a simplex the
        first: the edges to them span a positive volume unless the cell is turned inside out.
    """

    corners: Floats
    facets: Integers
    kind_of_facet: str
    beside: Integers

    def shape_functions(self, places: Floats) -> tuple[Floats, Floats]:
        """Return the shape functions of the nodes and their slopes by each coordinate at places of the cell.

        Parameters
        ----------
        places : (P, dim) array
            Coordinates.

        Returns
        -------
        (P, nodes) and (P, nodes, dim) arrays
        """
        count, dim = self.corners.shape
        if (self.corners >= 0.0).all():
            first = 1.0
            for coordinate in places.T:
                first = first - coordinate
            slopes = np.concatenate([-np.ones((1, dim)), np.eye(dim)])
            return np.column_stack([first, places]), np.repeat(slopes[None], len(places), axis=0)
        factors = 1.0 + places[:, None] * self.corners  # 1 + xi xi_a, 1 + eta eta_a, 1 + zeta zeta_a
        others = np.stack([np.delete(factors, d, axis=2).prod(axis=2) for d in range(dim)], axis=2)
        return factors.prod(axis=2) / count, self.corners * others / count


def _kind(corners: object, facets: object, kind_of_facet: str, beside: object) -> ReferenceCell:
    return ReferenceCell(np.array(corners, dtype=float), np.array(facets), kind_of_facet, np.array(beside))


_SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
REFERENCE_CELLS = {
    "line": _kind([[-1], [1]], [[0], [1]], "", [[1]]),
    "triangle": _kind([[0, 0], [1, 0], [0, 1]], [[0, 1], [1, 2], [2, 0]], "line", [[1, 2]]),
    "quad": _kind(_SQUARE, [[0, 1], [1, 2], [2, 3], [3, 0]], "line", [[1, 3], [2, 0], [3, 1], [0, 2]]),
    "tetra": _kind(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
        "triangle",
        [[1, 2, 3]],
    ),
    "hexahedron": _kind(
        np.concatenate([np.insert(_SQUARE, 2, side, axis=1) for side in (-1.0, 1.0)]),
        [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]],
        "quad",
        [[1, 3, 4], [2, 0, 5], [3, 1, 6], [0, 2, 7], [7, 5, 0], [4, 6, 1], [5, 7, 2], [6, 4, 3]],
    ),
}
