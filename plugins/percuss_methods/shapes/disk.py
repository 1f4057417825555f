"""A disk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from percuss import Doc, Ge, Gt, Mesh, Unit
from percuss_methods.shapes._cells import FilledShape, PlaneCells, closed
from percuss_methods.shapes._round import Grading, counts, disk_mesh, expect_moderate

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class Disk(FilledShape):
    """A disk about a point, of a core of rows and columns and of layers around it.

    Formula: half of the cells across the diameter lie in the core, a square with curved sides, and as many layers
    around it as fill the rest. The nodes of the skin lie on the circle, so that the area is that of a polygon:
    ``n sin(2 pi / n) / (2 pi)`` of the disk, with n edges around.

    Core and layers are refined together. With a single layer between core and circle the mesh would not converge.

    A small contact at the lowest point needs small cells there alone: `grading` moves the nodes by
    ``(z - i a) / (1 + i a z)`` with ``a = (grading^(1/2) - 1) / (grading^(1/2) + 1)``, which keeps circle and angles.
    Cells are ``grading^(1/2)`` times smaller at the lowest point and larger at the highest one, and the area of the
    polygon is smaller. The `angle` of the body turns the fine side to where it touches.
    """

    name = "disk"
    summary = "A disk of quadrilaterals or triangles"
    regions = ("skin",)
    examples = (
        {"radius": 1.0, "elements": 8},
        {"radius": 0.5, "elements": 4, "cells": "tri3"},
        {"radius": 1.0, "elements": 16, "grading": 9.0},
    )

    radius: Annotated[float, Gt(0), Unit("length"), Doc("radius")]
    elements: Annotated[int, Ge(4), Unit("1"), Doc("number of cells across the diameter, before `refine`")]
    cells: PlaneCells = "quad4"
    grading: Grading = 1.0

    def __post_init__(self) -> None:
        expect_moderate(self.grading, self.elements)

    def element_count(self, refine: float) -> int:
        """Return the number of cells."""
        across, layers = counts(self.refined(self.elements, refine))
        return self.count_of_cells(across**2 + 4 * across * layers)

    def mesh(self, at: Floats, refine: float) -> Mesh:
        """Return the mesh of the disk about `at`."""
        nodes, cells, skin = disk_mesh(self.refined(self.elements, refine), self.grading)
        return Mesh(at + self.radius * nodes, self.as_cells(cells), {"skin": closed(skin)})
