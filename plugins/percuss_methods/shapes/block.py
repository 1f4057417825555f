"""A rectangle or a box."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from percuss import Doc, Mesh, Unit
from percuss_methods.shapes._cells import KINDS, FilledShape, hexahedra_of, opened, quadrilaterals_of
from percuss_methods.shapes._row import lengths_of, places_of

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class Block(FilledShape):
    """A rectangle, or in three dimensions a box, from its corner of least coordinates along the axes.

    Formula: ``x_i = x_0 + width i / n``, and so on; with `grading` the lengths of cells along an axis form a geometric
    sequence, as those of `bar`. With triangles each rectangle of the mesh is cut in two along its
    diagonal from lower left to upper right; with tetrahedra each box in six about its diagonal (Kuhn).

    The regions `bottom` and `top` are at the ends of y in two dimensions and of z in three, where `front` and `back`
    are at those of y.
    """

    name = "block"
    summary = "A rectangle of quadrilaterals or triangles, or a box of hexahedra or tetrahedra"
    examples = (
        {"size": (1.0, 0.5), "elements": (4, 2)},
        {"size": (1.0, 0.5), "elements": (4, 2), "cells": "tri3"},
        {"size": (1.0, 0.5), "elements": (4, 2), "grading": (3.0, 1.0)},
        {"size": (1.0, 0.5, 0.8), "elements": (4, 2, 3)},
        {"size": (1.0, 0.5, 0.8), "elements": (4, 2, 3), "cells": "tet4"},
    )
    size: Annotated[tuple[float, ...], Unit("length"), Doc("extent along each axis, two numbers or three")]
    elements: Annotated[tuple[int, ...], Unit("1"), Doc("numbers of cells along each axis, before `refine`")]
    cells: Annotated[
        Literal["quad4", "tri3", "hex8", "tet4"] | None,
        Doc("kind of cells, quad4 or hex8 if left out; two triangles for a quadrilateral, six tetrahedra for a box"),
    ] = None
    grading: Annotated[
        tuple[float, ...] | None, Unit("1"), Doc("last cell's length over the first one's along each axis")
    ] = None

    def __post_init__(self) -> None:
        for key, values in (("size", self.size), ("elements", self.elements), ("grading", self.gradings)):
            if len(values) not in {2, 3} or len(values) != len(self.size):
                raise ValueError(f"{key} is {list(values)}: give two numbers, or three for a box, as many in all")
            if not min(values) > 0:
                raise ValueError(f"{key} is {list(values)}: give numbers greater than 0")
        if (self.cells in {"hex8", "tet4"}) != (len(self.size) == 3) and self.cells is not None:
            raise ValueError(f"{self.cells} cells do not fill a block of {len(self.size)} dimensions")

    @property
    def gradings(self) -> tuple[float, ...]:
        """Last cell's length over the first one's along each axis."""
        return self.grading or (1.0,) * len(self.size)

    @property
    def regions(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the sides."""
        return ("left", "right", "bottom", "top", *(("front", "back") if len(self.size) == 3 else ()))

    @property
    def cell(self) -> str:  # type: ignore[override]
        """Kind of cells."""
        return KINDS[self.cells or ("quad4" if len(self.size) == 2 else "hex8")]

    def element_count(self, refine: float) -> int:
        """Return the number of cells."""
        return self.count_of_cells(math.prod(self.refined(count, refine) for count in self.elements))

    def mesh(self, at: Floats, refine: float) -> Mesh:
        """Return the mesh from its corner at `at`."""
        counts = [self.refined(count, refine) for count in self.elements]
        along = [
            size * np.arange(count + 1) / count if grading == 1.0 else places_of(lengths_of(size, count, grading), size)
            for size, count, grading in zip(self.size, counts, self.gradings, strict=True)
        ]
        nodes = at + np.stack(np.meshgrid(*along, indexing="ij"), axis=-1).reshape(-1, len(counts))
        number = np.arange(len(nodes)).reshape([count + 1 for count in counts])
        if len(counts) == 3:
            sides = {
                "left": (number[0].T, [-1.0, 0.0, 0.0]), "right": (number[-1], [1.0, 0.0, 0.0]),
                "front": (number[:, 0], [0.0, -1.0, 0.0]), "back": (number[:, -1].T, [0.0, 1.0, 0.0]),
                "bottom": (number[:, :, 0].T, [0.0, 0.0, -1.0]), "top": (number[:, :, -1], [0.0, 0.0, 1.0]),
            }  # fmt: skip
            boundary = {name: self.region(quadrilaterals_of(side), out) for name, (side, out) in sides.items()}
            return Mesh(nodes, self.as_cells(hexahedra_of(number)), boundary)
        # Edges run with the body on their left.
        regions = {
            "left": opened(number[0, ::-1], [-1.0, 0.0]),
            "right": opened(number[-1], [1.0, 0.0]),
            "bottom": opened(number[:, 0], [0.0, -1.0]),
            "top": opened(number[::-1, -1], [0.0, 1.0]),
        }
        return Mesh(nodes, self.as_cells(quadrilaterals_of(number)), regions)
