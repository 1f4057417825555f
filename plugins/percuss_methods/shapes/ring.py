"""A ring."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import Doc, Gt, Mesh, Unit
from percuss_methods.shapes._cells import FilledShape, PlaneCells, closed, quadrilaterals_of

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class Ring(FilledShape):
    """A ring about a point, of layers of cells.

    Formula: ``r_j = inner + (outer - inner) j / layers``, ``phi_i = 2 pi i / around``; all nodes lie on circles.
    """

    name = "ring"
    summary = "A ring of quadrilaterals or triangles"
    regions = ("inner", "outer")
    examples = (
        {"inner": 0.5, "outer": 1.0, "elements": (16, 3)},
        {"inner": 0.5, "outer": 1.0, "elements": (12, 2), "cells": "tri3"},
    )

    inner: Annotated[float, Gt(0), Unit("length"), Doc("inner radius")]
    outer: Annotated[float, Gt(0), Unit("length"), Doc("outer radius")]
    elements: Annotated[tuple[int, int], Unit("1"), Doc("numbers of cells around and of layers, before `refine`")]
    cells: PlaneCells = "quad4"

    def __post_init__(self) -> None:
        if self.outer <= self.inner:
            raise ValueError(f"outer is {self.outer:g}: give a radius greater than inner, {self.inner:g}")
        if self.elements[0] < 3 or self.elements[1] < 1:
            raise ValueError(f"elements is {list(self.elements)}: give at least 3 around and 1 layer")

    def element_count(self, refine: float) -> int:
        """Return the number of cells."""
        around, layers = (self.refined(count, refine) for count in self.elements)
        return self.count_of_cells(around * layers)

    def mesh(self, at: Floats, refine: float) -> Mesh:
        """Return the mesh of the ring about `at`."""
        around, layers = (self.refined(count, refine) for count in self.elements)
        angle = 2.0 * np.pi * np.arange(around) / around
        radius = self.inner + (self.outer - self.inner) * np.arange(layers + 1) / layers
        nodes = at + (radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)).reshape(-1, 2)
        number = np.arange(nodes.shape[0]).reshape(layers + 1, around)
        cells = self.as_cells(quadrilaterals_of(np.concatenate([number, number[:, :1]], axis=1)))
        return Mesh(nodes, cells, {"inner": closed(number[0, ::-1]), "outer": closed(number[-1])})
