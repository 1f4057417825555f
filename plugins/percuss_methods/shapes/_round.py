"""The mesh of a disk of radius 1, of a core of rows and columns and of layers around it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from percuss import Region

if TYPE_CHECKING:
    from percuss import Floats, Integers

CORE = 0.5  # distance of the middle of a side of the core from the centre, over the radius
BULGE = 0.15  # by which part of their distance the corners of the core are nearer than those of a square


def counts(elements: int) -> tuple[int, int]:
    """Return the number of cells across the core, an even one, and that of layers around it."""
    across = 2 * max(1, round(elements / 4))
    return across, max(1, round((elements - across) / 2))


def disk_mesh(elements: int) -> tuple[Floats, Integers, Integers]:
    """Return nodes, quadrilaterals and the nodes of the skin, which begin at an angle of -135 degrees."""
    across, layers = counts(elements)
    place = 2.0 * np.arange(across + 1) / across - 1.0
    x, y = np.meshgrid(place, place, indexing="ij")
    # The sides of the core bulge: the three cells that meet at a corner share the angle there.
    core = CORE * np.stack([x, y], axis=-1) * (1.0 - BULGE * x**2 * y**2)[..., None]
    number = np.arange((across + 1) ** 2).reshape(across + 1, across + 1)
    rim = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
    angle = -0.75 * np.pi + 2.0 * np.pi * np.arange(rim.size) / rim.size
    start, circle = core.reshape(-1, 2)[rim], np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rings = [start + (circle - start) * k / layers for k in range(1, layers + 1)]
    around = np.concatenate([rim[None], number.size + np.arange(layers * rim.size).reshape(layers, -1)])
    inner = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)
    nearer, next_one = around[:-1], np.roll(around, -1, axis=1)
    outer = np.stack([nearer, around[1:], next_one[1:], next_one[:-1]], axis=-1)
    cells = np.concatenate([inner.reshape(-1, 4), outer.reshape(-1, 4)])
    return np.concatenate([core.reshape(-1, 2), *rings]), cells, around[-1]


def as_cells(quadrilaterals: Integers, cells: str) -> Integers:
    """Return quadrilaterals, or the two triangles in each of them."""
    return quadrilaterals if cells == "quad4" else quadrilaterals[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


def closed(nodes: Integers) -> Region:
    """Return the region of a closed line of nodes, the body on its left; it has no single vector out of the body."""
    return Region(tuple(nodes.tolist()), np.zeros(2), {"line": np.stack([nodes, np.roll(nodes, -1)], axis=1)})


def opened(nodes: Integers, outward: list[float]) -> Region:
    """Return the region of a line of nodes with two ends, the body on its left."""
    return Region(tuple(nodes.tolist()), np.array(outward), {"line": np.stack([nodes[:-1], nodes[1:]], axis=1)})
