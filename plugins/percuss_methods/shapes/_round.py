"""The mesh of a disk of radius 1, of a core and of layers around it, and the map that grades disks and balls."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import Doc, Gt, Unit
from percuss_methods.shapes._cells import quadrilaterals_of

if TYPE_CHECKING:
    from percuss import Floats, Integers

Grading = Annotated[float, Gt(0), Unit("1"), Doc("size of cells at the highest point over that at the lowest")]

CORE = 0.5  # distance of the middle of a side of the core from the centre, over the radius
BULGE = 0.15  # by which part of their distance the corners of the core are nearer than those of a square


def counts(elements: int) -> tuple[int, int]:
    """Return the number of cells across the core, an even one, and that of layers around it."""
    across = 2 * max(1, round(elements / 4))
    return across, max(1, round((elements - across) / 2))


def expect_moderate(grading: float, elements: int) -> None:
    """Refuse a grading whose largest cells would be larger than the radius.

    Raises
    ------
    ValueError
        With the largest and the least value for the number of elements.
    """
    most = (0.5 * elements) ** 2
    if not 1.0 <= grading * most <= most**2:
        words = f"grading is {grading:g}: give {1.0 / most:.3g} to {most:.3g} with {elements} elements"
        raise ValueError(f"{words}, as others make cells larger than the radius")


def disk_mesh(elements: int, grading: float) -> tuple[Floats, Integers, Integers]:
    """Return nodes, quadrilaterals and the nodes of the skin, which begin at an angle of -135 degrees or near it."""
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
    outer = quadrilaterals_of(np.concatenate([around, around[:, :1]], axis=1))
    cells = np.concatenate([quadrilaterals_of(number).reshape(-1, 4), outer.reshape(-1, 4)])
    return graded(np.concatenate([core.reshape(-1, 2), *rings]), grading), cells, around[-1]


def graded(nodes: Floats, grading: float) -> Floats:
    """Return the nodes of a disk or a ball of radius 1 drawn together at the lowest point, by a map onto itself.

    The map ``(z - i a) / (1 + i a z)`` of a disk is conformal: it keeps the circle and all angles. It scales lengths by
    ``grading^(-1/2)`` at the lowest point and by ``grading^(1/2)`` at the highest one. In each plane through the axis
    of a ball it is the same map, and conformal in space too.
    """
    if grading == 1.0:
        return nodes
    a = (np.sqrt(grading) - 1.0) / (np.sqrt(grading) + 1.0)
    far = nodes[:, 0] if nodes.shape[1] == 2 else np.linalg.norm(nodes[:, :-1], axis=1)
    z = far + 1j * nodes[:, -1]
    z = (z - 1j * a) / (1.0 + 1j * a * z)
    if nodes.shape[1] == 2:
        return np.stack([z.real, z.imag], axis=1)
    scale = np.divide(z.real, far, out=np.ones_like(far), where=far > 0.0)
    return np.concatenate([scale[:, None] * nodes[:, :-1], z.imag[:, None]], axis=1)
