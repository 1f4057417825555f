"""A disk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from percuss import Doc, Ge, Gt, Mesh, Region, Shape, Unit

if TYPE_CHECKING:
    from percuss import Floats, Integers

CORE = 0.5  # distance of the middle of a side of the core from the centre, over the radius
BULGE = 0.15  # by which part of their distance the corners of the core are nearer than those of a square


@dataclass(frozen=True)
class Disk(Shape):
    """A disk about a point, of a core of rows and columns and of layers around it.

    Formula: half of the cells across the diameter lie in the core, a square with curved sides, and as many layers
    around it as fill the rest. The nodes of the skin lie on the circle, so that the area is that of a polygon:
    ``n sin(2 pi / n) / (2 pi)`` of the disk, with n edges around.

    Core and layers are refined together. With a single layer between core and circle the mesh would not converge.
    """

    name = "disk"
    summary = "A disk of quadrilaterals or triangles"
    regions = ("skin",)
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
        across, layers = self._counts(refine)
        return (across**2 + 4 * across * layers) * (2 if self.cells == "tri3" else 1)

    def _counts(self, refine: float) -> tuple[int, int]:
        """Return the number of cells across the core, an even one, and that of layers around it."""
        across = 2 * max(1, round(self.refined(self.elements, refine) / 4))
        return across, max(1, round((self.refined(self.elements, refine) - across) / 2))

    def mesh(self, at: Floats, refine: float) -> Mesh:
        """Return the mesh of the disk about `at`."""
        across, layers = self._counts(refine)
        place = 2.0 * np.arange(across + 1) / across - 1.0
        x, y = np.meshgrid(place, place, indexing="ij")
        # The sides of the core bulge: the three cells that meet at a corner share the angle there.
        core = CORE * np.stack([x, y], axis=-1) * (1.0 - BULGE * x**2 * y**2)[..., None]
        number = np.arange((across + 1) ** 2).reshape(across + 1, across + 1)
        rim = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
        angle = -0.75 * np.pi + 2.0 * np.pi * np.arange(rim.size) / rim.size
        start, circle = core.reshape(-1, 2)[rim], np.stack([np.cos(angle), np.sin(angle)], axis=1)
        rings = [start + (circle - start) * k / layers for k in range(1, layers + 1)]
        nodes = at + self.radius * np.concatenate([core.reshape(-1, 2), *rings])
        around = np.concatenate([rim[None], number.size + np.arange(layers * rim.size).reshape(layers, -1)])
        inner = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)
        nearer, next_one = around[:-1], np.roll(around, -1, axis=1)
        outer = np.stack([nearer, around[1:], next_one[1:], next_one[:-1]], axis=-1)
        cells = np.concatenate([inner.reshape(-1, 4), outer.reshape(-1, 4)])
        if self.cells == "tri3":
            cells = cells[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
        return Mesh(nodes, {self.cell: cells}, {"skin": closed(around[-1])})


def closed(nodes: Integers) -> Region:
    """Return the region of a closed line of nodes, the body on its left; it has no single vector out of the body."""
    return Region(tuple(nodes.tolist()), np.zeros(2), {"line": np.stack([nodes, np.roll(nodes, -1)], axis=1)})
