"""What shapes of cells share: their kinds, the division of cells in rows and columns, and regions of the boundary."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from percuss import REFERENCE_CELLS, Doc, Region, Shape

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss import Integers

PlaneCells = Annotated[Literal["quad4", "tri3"], Doc("kind of cells; two triangles for a quadrilateral")]
SolidCells = Annotated[Literal["hex8", "tet4"], Doc("kind of cells; six tetrahedra for a hexahedron")]
KINDS = {"quad4": "quad", "tri3": "triangle", "hex8": "hexahedron", "tet4": "tetra"}
PARTS = {"triangle": 2, "tetra": 6}


class FilledShape(Shape, contract="shapes"):
    """A shape of quadrilaterals or hexahedra, or of the triangles or tetrahedra in them."""

    cells: str | None

    @property
    def cell(self) -> str:  # type: ignore[override]
        """Kind of cells."""
        return KINDS[self.cells or "quad4"]

    def dimension(self) -> int:
        """Return 2 or 3."""
        return 2 if self.cell in {"quad", "triangle"} else 3

    def as_cells(self, whole: Integers) -> dict[str, Integers]:
        """Return the cells of a mesh, by kind: quadrilaterals or hexahedra, or the parts of each of them."""
        corners = whole.reshape(-1, whole.shape[-1])
        if self.cell == "triangle":
            corners = corners[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
        if self.cell == "tetra":
            corners = tetrahedra_of(corners)
        return {self.cell: corners}

    def count_of_cells(self, whole: int) -> int:
        """Return the number of cells in a number of quadrilaterals or hexahedra."""
        return whole * PARTS.get(self.cell, 1)

    def region(self, faces: Integers, outward: Sequence[float] = (0.0, 0.0, 0.0)) -> Region:
        """Return a region in three dimensions of quadrilaterals that run counter-clockwise as seen from outside.

        `outward` is the single vector out of the body; zero where there is none.
        """
        corners = faces.reshape(-1, 4)
        facets = {"triangle": triangles_of(corners)} if self.cell == "tetra" else {"quad": corners}
        return Region(tuple(np.unique(corners).tolist()), np.array(outward), facets)


def quadrilaterals_of(number: Integers) -> Integers:
    """Return the corners of quadrilaterals between rows and columns of nodes, (rows - 1, columns - 1, ..., 4)."""
    return np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)


def hexahedra_of(number: Integers) -> Integers:
    """Return the corners of hexahedra between rows, columns and layers of nodes, each one less, (..., 8)."""
    faces = quadrilaterals_of(number)
    return np.concatenate([faces[:, :, :-1], faces[:, :, 1:]], axis=-1)


def triangles_of(quadrilaterals: Integers) -> Integers:
    """Return two triangles of each quadrilateral, (2 n, 3): the cut begins at its node of the least number."""
    first = np.argmin(quadrilaterals, axis=1)[:, None]
    turned = np.take_along_axis(quadrilaterals, (first + np.arange(4)) % 4, axis=1)
    return turned[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


def tetrahedra_of(hexahedra: Integers) -> Integers:
    """Return six tetrahedra of each hexahedron, (6 n, 4), that meet those of its neighbours face to face.

    Each is a triangle of a face, as `triangles_of` makes it, with the node of the least number, which is not on it.
    """
    faces = hexahedra[:, REFERENCE_CELLS["hexahedron"].facets]
    least = hexahedra.min(axis=1)
    away = faces[(faces != least[:, None, None]).all(axis=2)]
    triangles = triangles_of(away)
    return np.concatenate([triangles[:, [0, 2, 1]], np.repeat(least, 6)[:, None]], axis=1)


def closed(nodes: Integers) -> Region:
    """Return the region of a closed line of nodes, the body on its left; it has no single vector out of the body."""
    return Region(tuple(nodes.tolist()), np.zeros(2), {"line": np.stack([nodes, np.roll(nodes, -1)], axis=1)})


def opened(nodes: Integers, outward: Sequence[float]) -> Region:
    """Return the region of a line of nodes with two ends, the body on its left."""
    return Region(tuple(nodes.tolist()), np.array(outward), {"line": np.stack([nodes[:-1], nodes[1:]], axis=1)})
