"""What shapes in two dimensions share: the kind of their cells, and regions along lines of nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from percuss import Doc, Region, Shape

if TYPE_CHECKING:
    from percuss import Integers

PlaneCells = Annotated[Literal["quad4", "tri3"], Doc("kind of cells; two triangles for a quadrilateral")]


class PlaneShape(Shape, contract="shapes"):
    """A shape in two dimensions that makes quadrilaterals, or two triangles of each."""

    cells: PlaneCells

    @property
    def cell(self) -> str:  # type: ignore[override]
        """Kind of cells."""
        return {"quad4": "quad", "tri3": "triangle"}[self.cells]

    def dimension(self) -> int:
        """Return 2."""
        return 2

    def as_cells(self, quadrilaterals: Integers) -> dict[str, Integers]:
        """Return the cells of a mesh, by kind: quadrilaterals, or the two triangles in each of them."""
        corners = quadrilaterals.reshape(-1, 4)
        if self.cells == "tri3":
            corners = corners[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
        return {self.cell: corners}

    def count_of_cells(self, quadrilaterals: int) -> int:
        """Return the number of cells in a number of quadrilaterals."""
        return quadrilaterals * (2 if self.cells == "tri3" else 1)


def quadrilaterals_of(number: Integers) -> Integers:
    """Return the corners of quadrilaterals between rows and columns of nodes, (rows - 1, columns - 1, 4)."""
    return np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)


def closed(nodes: Integers) -> Region:
    """Return the region of a closed line of nodes, the body on its left; it has no single vector out of the body."""
    return Region(tuple(nodes.tolist()), np.zeros(2), {"line": np.stack([nodes, np.roll(nodes, -1)], axis=1)})


def opened(nodes: Integers, outward: list[float]) -> Region:
    """Return the region of a line of nodes with two ends, the body on its left."""
    return Region(tuple(nodes.tolist()), np.array(outward), {"line": np.stack([nodes[:-1], nodes[1:]], axis=1)})
