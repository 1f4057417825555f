"""The right half of a disk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from percuss import Doc, Ge, Gt, Mesh, Shape, Unit
from percuss_methods.shapes._round import as_cells, counts, disk_mesh, opened

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class HalfDisk(Shape):
    """The right half of a `disk`: as a body of revolution a ball, and half a disk where it meets its mirror image.

    Formula: the cells of `disk` to the right of its centre.
    """

    name = "half-disk"
    summary = "The right half of a disk: as a body of revolution a ball"
    regions = ("skin", "axis")
    examples = ({"radius": 1.0, "elements": 8}, {"radius": 0.5, "elements": 4, "cells": "tri3"})

    radius: Annotated[float, Gt(0), Unit("length"), Doc("radius")]
    elements: Annotated[int, Ge(4), Unit("1"), Doc("number of cells across the diameter, before `refine`")]
    cells: Annotated[Literal["quad4", "tri3"], Doc("kind of cells; two triangles for a quadrilateral")] = "quad4"

    @property
    def cell(self) -> str:  # type: ignore[override]
        """Kind of cells."""
        return {"quad4": "quad", "tri3": "triangle"}[self.cells]

    def dimension(self) -> int:
        """Return 2."""
        return 2

    def element_count(self, refine: float) -> int:
        """Return the number of cells."""
        across, layers = counts(self.refined(self.elements, refine))
        return (across**2 // 2 + 2 * across * layers) * (2 if self.cells == "tri3" else 1)

    def mesh(self, at: Floats, refine: float) -> Mesh:
        """Return the mesh of the half of the disk about `at`."""
        nodes, cells, skin = disk_mesh(self.refined(self.elements, refine))
        kept, cells = np.unique(cells[nodes[cells, 0].mean(axis=1) > 0.0], return_inverse=True)
        nodes = nodes[kept]
        axis = np.flatnonzero(np.abs(nodes[:, 0]) < 1e-12)
        nodes[axis, 0] = 0.0
        quarter = skin.size // 4
        skin = np.searchsorted(kept, skin[quarter // 2 : 2 * quarter + quarter // 2 + 1])
        regions = {
            "skin": opened(skin, [1.0, 0.0]),
            "axis": opened(axis[np.argsort(-nodes[axis, 1])], [-1.0, 0.0]),
        }
        return Mesh(at + self.radius * nodes, {self.cell: as_cells(cells.reshape(-1, 4), self.cells)}, regions)
