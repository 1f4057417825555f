"""How bodies in two and three dimensions come onto a page: the view, and the faces of cells that are seen."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.methods.interfaces import REFERENCE_CELLS
from percuss.reporting.figures import FAINT, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from percuss.methods.interfaces import Floats, Integers

# A camera far away, to the right of the y axis and above, which looks along y: x runs to the right and z up.
ACROSS, ABOVE = np.radians(28.0), np.radians(22.0)
TO_CAMERA = np.array([np.sin(ACROSS) * np.cos(ABOVE), -np.cos(ACROSS) * np.cos(ABOVE), np.sin(ABOVE)])
RIGHT = np.array([np.cos(ACROSS), np.sin(ACROSS), 0.0])
PAGE = np.stack([RIGHT, np.cross(TO_CAMERA, RIGHT)], axis=1)  # (3, 2)
# The faces of cells by the number of their corners.
FACES: Mapping[int, list[list[int]]] = {
    len(REFERENCE_CELLS[kind].corners): REFERENCE_CELLS[kind].facets.tolist() for kind in ("tetra", "hexahedron")
}
SHARP = 0.8  # largest cosine between two faces that meet in an edge which is drawn


def on_page(vectors: Floats) -> Floats:
    """Return points or vectors, (..., dim), as they are seen, (..., 2)."""
    seen: Floats = vectors if vectors.shape[-1] == 2 else vectors @ PAGE
    return seen


class Faces(NamedTuple):
    """Faces of cells that may be seen: cells in two dimensions, the boundary of the bodies in three.

    Attributes
    ----------
    corners : (faces, corners) array
        Nodes, the last one repeated where others have more corners.
    cell : (faces,) array
        The cell of each.
    sizes : (faces,) array
        Number of corners of each.
    rims : (edges, 2) array
        Nodes of each edge of them.
    beside : (edges, 2) array
        The two faces at each edge, one twice where there is no other.
    """

    corners: Integers
    cell: Integers
    sizes: Integers
    rims: Integers
    beside: Integers

    @classmethod
    def of(cls, cells: Integers, dim: int) -> Faces:
        """Return those of cells, whose nodes end with -1 where others have more."""
        counts = (cells >= 0).sum(axis=1)
        found, owner = [], []
        for count in np.unique(counts):
            (numbers,) = np.nonzero(counts == count)
            faces = FACES[int(count)] if dim == 3 else [list(range(count))]
            found.append(cells[numbers][:, faces].reshape(-1, len(faces[0])))
            owner.append(np.repeat(numbers, len(faces)))
        most = max(each.shape[1] for each in found)
        corners = np.concatenate([np.pad(each, ((0, 0), (0, most - each.shape[1])), mode="edge") for each in found])
        cell, sizes = np.concatenate(owner), np.repeat([each.shape[1] for each in found], [len(each) for each in found])
        kept = np.argsort(cell, kind="stable")
        if dim == 3:
            alone = np.where(np.arange(most) < sizes[:, None], corners, -1)  # the same for both cells at a face
            _, first, times = np.unique(np.sort(alone, axis=1), axis=0, return_index=True, return_counts=True)
            kept = np.sort(first[times == 1])
        corners = corners[kept]
        edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2)
        (real,) = np.nonzero(edges[:, 0] != edges[:, 1])
        edges, face = edges[real], real // most
        _, first, of = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_inverse=True)
        last = np.zeros_like(first)
        last[of.ravel()] = face  # of the faces at an edge the last one stays
        return cls(corners, cell[kept], sizes[kept], edges[first], np.stack([face[first], last], axis=1))

    def polygons(self, numbers: Integers, nodes: Floats) -> list[Floats]:
        """Return the corners of some faces on the page, each (corners, 2)."""
        page = on_page(nodes)
        return [
            page[corners[:count]] for corners, count in zip(self.corners[numbers], self.sizes[numbers], strict=True)
        ]

    def seen(self, nodes: Floats) -> Integers:
        """Return the numbers of the faces that look to the camera, those that are farther away first."""
        if nodes.shape[1] == 2:
            return np.arange(len(self.cell))
        at = nodes[self.corners]
        (front,) = np.nonzero(_normals(at) @ TO_CAMERA > 0.0)
        order: Integers = front[np.argsort(at[front].mean(axis=1) @ TO_CAMERA, kind="stable")]
        return order

    def edges(self, nodes: Floats) -> Integers:
        """Return the edges of the boundary in two dimensions; in three the sharp ones that are seen, (edges, 2)."""
        if nodes.shape[1] == 2:
            alone: Integers = self.rims[self.beside[:, 0] == self.beside[:, 1]]
            return alone
        one, two = np.moveaxis(_normals(nodes[self.corners])[self.beside], 1, 0)
        looks = np.maximum(one @ TO_CAMERA, two @ TO_CAMERA) > 0.0
        sharp: Integers = self.rims[looks & (np.einsum("ed,ed->e", one, two) < SHARP)]
        return sharp


def _normals(corners: Floats) -> Floats:
    """Return unit normals of faces, (faces, 3), from two diagonals or, of triangles, two sides."""
    out = np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1])
    unit: Floats = out / np.maximum(np.linalg.norm(out, axis=1), np.finfo(float).tiny)[:, None]
    return unit


def draw_walls(axes: Axes, walls: Mapping[str, Any], middle: Floats, size: float) -> None:
    """Draw walls: as lines with hatches on their far side, in three dimensions as squares.

    Parameters
    ----------
    axes
        The panel.
    walls
        Point and normal of each.
    middle : (dim,) array
        Middle of what is shown.
    size
        Half of the length of a wall.
    """
    for point, normal in walls.values():
        out = np.asarray(normal, dtype=float)
        foot = middle - out * float(out @ (middle - np.asarray(point, dtype=float)))
        if out.size == 2:
            along = size * np.array([-out[1], out[0]])
            ends = np.array([foot - along, foot + along])
            far = ends[::-1] - 0.035 * size * out
            axes.fill(*np.concatenate([ends, far]).T, facecolor="#f3f3f3", edgecolor=FAINT, hatch="////", linewidth=0)
            axes.plot(*ends.T, color=INK, linewidth=1.2)
            continue
        first = np.cross(out, np.eye(3)[int(np.abs(out).argmin())])
        first *= 0.6 * size / np.linalg.norm(first)
        second = np.cross(out, first)
        corners = np.array([foot + a * first + b * second for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
        behind = bool(out @ TO_CAMERA > 0.0)  # the camera and the bodies are on one side
        colour = "#f3f3f3" if behind else "#e8e8e855"
        axes.fill(*on_page(corners).T, facecolor=colour, edgecolor=FAINT, zorder=0 if behind else 3)
