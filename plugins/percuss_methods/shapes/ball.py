"""A ball."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import Doc, Ge, Gt, Mesh, Unit
from percuss_methods.shapes._cells import FilledShape, SolidCells, hexahedra_of, quadrilaterals_of
from percuss_methods.shapes._round import CORE, Grading, counts, expect_moderate, graded

if TYPE_CHECKING:
    from percuss import Floats, Integers

ROUND = 0.6  # by how much the core is a ball: 0 leaves a cube


@dataclass(frozen=True)
class Ball(FilledShape):
    """A ball about a point, of a core of rows, columns and layers, and of shells around it.

    Formula: half of the cells across the diameter lie in the core, a cube with curved sides, and as many shells around
    it as fill the rest. The nodes of the skin lie on the sphere, in equal angles along each edge of the cube; the
    volume is that of the polyhedron. `grading` draws the cells together at the lowest point, that of least z, by the
    map of `disk` in each plane through the axis, which is conformal in space too.

    Core and shells are refined together. With a single shell between core and sphere the mesh would not converge.
    """

    name = "ball"
    summary = "A ball of hexahedra or tetrahedra"
    regions = ("skin",)
    examples = (
        {"radius": 1.0, "elements": 8},
        {"radius": 0.5, "elements": 4, "cells": "tet4"},
        {"radius": 1.0, "elements": 8, "grading": 4.0},
    )

    radius: Annotated[float, Gt(0), Unit("length"), Doc("radius")]
    elements: Annotated[int, Ge(4), Unit("1"), Doc("number of cells across the diameter, before `refine`")]
    cells: SolidCells = "hex8"
    grading: Grading = 1.0

    def __post_init__(self) -> None:
        expect_moderate(self.grading, self.elements)

    def element_count(self, refine: float) -> int:
        """Return the number of cells."""
        across, shells = counts(self.refined(self.elements, refine))
        return self.count_of_cells(across**3 + 6 * across**2 * shells)

    def mesh(self, at: Floats, refine: float) -> Mesh:
        """Return the mesh of the ball about `at`."""
        nodes, cells, skin = ball_mesh(self.refined(self.elements, refine))
        return Mesh(at + self.radius * graded(nodes, self.grading), self.as_cells(cells), {"skin": self.region(skin)})


def ball_mesh(elements: int) -> tuple[Floats, Integers, Integers]:
    """Return nodes and hexahedra of a ball of radius 1, and the quadrilaterals of its skin as seen from outside."""
    across, shells = counts(elements)
    place = 2.0 * np.arange(across + 1) / across - 1.0
    cube = np.stack(np.meshgrid(place, place, place, indexing="ij"), axis=-1).reshape(-1, 3)
    far, length = np.abs(cube).max(axis=1, keepdims=True), np.linalg.norm(cube, axis=1, keepdims=True)
    rounded = np.divide(far, length, out=np.ones_like(far), where=length > 0.0)
    core = CORE * cube * (1.0 + ROUND * far * (rounded - 1.0))
    number = np.arange(len(cube)).reshape(across + 1, across + 1, across + 1)
    sides = [number[0].T, number[-1], number[:, 0], number[:, -1].T, number[:, :, 0].T, number[:, :, -1]]
    faces = np.concatenate([quadrilaterals_of(side).reshape(-1, 4) for side in sides])
    rim, on_rim = np.unique(faces, return_inverse=True)
    angles = np.tan(0.25 * np.pi * cube[rim])
    sphere = angles / np.linalg.norm(angles, axis=1, keepdims=True)
    nodes = [core, *(core[rim] + (sphere - core[rim]) * k / shells for k in range(1, shells + 1))]
    numbers = np.concatenate([rim[None], len(cube) + np.arange(shells * rim.size).reshape(shells, -1)])
    around = numbers[:, on_rim.reshape(faces.shape)]
    outer = np.concatenate([around[:-1], around[1:]], axis=-1)
    cells = np.concatenate([hexahedra_of(number).reshape(-1, 8), outer.reshape(-1, 8)])
    return np.concatenate(nodes), cells, around[-1]
