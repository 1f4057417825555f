"""A rectangle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import Doc, Mesh, Unit
from percuss_methods.shapes._plane import PlaneCells, PlaneShape, opened, quadrilaterals_of

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class Block(PlaneShape):
    """A rectangle from its corner of least coordinates along the axes.

    Formula: ``x_i = x_0 + width i / n``, ``y_j = y_0 + height j / m``. With triangles each rectangle of the mesh is cut
    in two along its diagonal from lower left to upper right.
    """

    name = "block"
    summary = "A rectangle of quadrilaterals or triangles"
    regions = ("left", "right", "bottom", "top")
    examples = ({"size": (1.0, 0.5), "elements": (4, 2)}, {"size": (1.0, 0.5), "elements": (4, 2), "cells": "tri3"})

    size: Annotated[tuple[float, float], Unit("length"), Doc("width and height")]
    elements: Annotated[tuple[int, int], Unit("1"), Doc("numbers of cells across and up, before `refine`")]
    cells: PlaneCells = "quad4"

    def __post_init__(self) -> None:
        for key, values in (("size", self.size), ("elements", self.elements)):
            if not min(values) > 0:
                raise ValueError(f"{key} is {list(values)}: give numbers greater than 0")

    def element_count(self, refine: float) -> int:
        """Return the number of cells."""
        nx, ny = (self.refined(count, refine) for count in self.elements)
        return self.count_of_cells(nx * ny)

    def mesh(self, at: Floats, refine: float) -> Mesh:
        """Return the mesh from its corner at `at`."""
        nx, ny = (self.refined(count, refine) for count in self.elements)
        x, y = self.size[0] * np.arange(nx + 1) / nx, self.size[1] * np.arange(ny + 1) / ny
        nodes = at + np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        number = np.arange((nx + 1) * (ny + 1)).reshape(nx + 1, ny + 1)
        # Edges run with the body on their left.
        regions = {
            "left": opened(number[0, ::-1], [-1.0, 0.0]),
            "right": opened(number[-1], [1.0, 0.0]),
            "bottom": opened(number[:, 0], [0.0, -1.0]),
            "top": opened(number[::-1, -1], [0.0, 1.0]),
        }
        return Mesh(nodes, self.as_cells(quadrilaterals_of(number)), regions)
