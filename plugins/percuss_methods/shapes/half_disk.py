"""The right half of a disk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import Doc, Ge, Gt, Mesh, Unit
from percuss_methods.shapes._cells import FilledShape, PlaneCells, opened
from percuss_methods.shapes._round import Grading, counts, disk_mesh, expect_moderate

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class HalfDisk(FilledShape):
    """The right half of a `disk`: as a body of revolution a ball, and half a disk where it meets its mirror image.

    Formula: the cells of `disk` to the right of its centre. With a `grading` below 1 the fine side is the upper one.
    """

    name = "half-disk"
    summary = "The right half of a disk: as a body of revolution a ball"
    regions = ("skin", "axis")
    examples = ({"radius": 1.0, "elements": 8}, {"radius": 0.5, "elements": 4, "cells": "tri3"})

    radius: Annotated[float, Gt(0), Unit("length"), Doc("radius")]
    elements: Annotated[int, Ge(4), Unit("1"), Doc("number of cells across the diameter, before `refine`")]
    cells: PlaneCells = "quad4"
    grading: Grading = 1.0

    def __post_init__(self) -> None:
        expect_moderate(self.grading, self.elements)

    def element_count(self, refine: float) -> int:
        """Return the number of cells."""
        across, layers = counts(self.refined(self.elements, refine))
        return self.count_of_cells(across**2 // 2 + 2 * across * layers)

    def mesh(self, at: Floats, refine: float) -> Mesh:
        """Return the mesh of the half of the disk about `at`."""
        nodes, cells, skin = disk_mesh(self.refined(self.elements, refine), self.grading)
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
        return Mesh(at + self.radius * nodes, self.as_cells(cells), regions)
