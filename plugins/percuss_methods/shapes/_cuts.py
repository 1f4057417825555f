"""Cells of a mesh cut into equal parts; cells that share a face have the same nodes on it."""

from __future__ import annotations

from itertools import permutations, product
from typing import TYPE_CHECKING

import numpy as np

from percuss import REFERENCE_CELLS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from percuss import Floats, Integers


def cut(nodes: Floats, cells: Mapping[str, Integers], parts: int) -> tuple[Floats, dict[str, Integers]]:
    """Cut each edge into `parts` equal parts, and each cell into as many cells of its kind as that gives.

    Parameters
    ----------
    nodes : (n, dim) array
        Positions [length].
    cells
        Cells of each kind, (cells, corners), and facets among them.
    parts
        Parts of an edge; a cell in d dimensions has ``parts**d`` of them.

    Returns
    -------
    nodes : (m, dim) array
        Positions [length].
    cells
        Parts of each cell, (cells, parts of a cell, corners), which count their corners in the sense of the cell.

    Notes
    -----
    A simplex is cut by planes parallel to its faces, and what is left inside along one diagonal: Freudenthal's
    triangulation, whose trace on a face depends on the face alone (doi.org/10.2307/1968813).
    """
    if parts == 1:
        return nodes, {kind: corners[:, None] for kind, corners in cells.items()}
    width = max(corners.shape[1] for corners in cells.values())
    keys, shapes = [], {}
    for kind, corners in cells.items():
        weights, within = _pattern(kind, parts)
        shapes[kind] = (len(corners), len(weights), within)
        # A point is known by the corners that it lies between and by their weights, the largest sum of which is 1.
        ids = np.where(weights > 0, corners[:, None], -1).reshape(-1, corners.shape[1])
        shares = np.tile(weights * (parts**3 // weights[0].sum()), (len(corners), 1))
        order = np.argsort(ids, axis=1)
        of_kind = np.full((len(ids), 2, width), [[-1], [0]], dtype=np.int64)
        of_kind[:, 0, -ids.shape[1] :] = np.take_along_axis(ids, order, axis=1)
        of_kind[:, 1, -ids.shape[1] :] = np.take_along_axis(shares, order, axis=1)
        keys.append(of_kind.reshape(len(ids), -1))
    points, number = np.unique(np.concatenate(keys), axis=0, return_inverse=True)
    ids, shares = points[:, :width], points[:, width:] / parts**3
    positions: Floats = (shares[..., None] * nodes[ids]).sum(axis=1)
    found, first = {}, 0
    for kind, (count, each, within) in shapes.items():
        last = first + count * each
        found[kind] = number.ravel()[first:last].reshape(count, each)[:, within]
        first = last
    return positions, found


def _pattern(kind: str, parts: int) -> tuple[Integers, Integers]:
    """Return the weights of the corners at each point of a cell, (points, corners), and the points of each part."""
    dim = REFERENCE_CELLS[kind].corners.shape[1]
    lattice = np.array(list(product(range(parts + 1), repeat=dim)))
    place = {tuple(point): k for k, point in enumerate(lattice.tolist())}
    starts = lattice[(lattice < parts).all(axis=1)]
    if kind not in {"triangle", "tetra"}:
        corners = (REFERENCE_CELLS[kind].corners > 0.0).astype(np.int64)
        ways = [corners]
        ahead = np.where(corners, lattice[:, None], parts - lattice[:, None])
        weights, inside = ahead.prod(axis=2), np.ones(len(lattice), dtype=bool)
    else:
        # A simplex in the cube: x_1 >= x_2 >= ..., whose corner k has the first k coordinates 1 and the others 0.
        bounded = np.column_stack([np.full(len(lattice), parts), lattice, np.zeros(len(lattice), dtype=np.int64)])
        weights = bounded[:, :-1] - bounded[:, 1:]
        inside = (weights >= 0).all(axis=1)
        ways = []
        for order in permutations(range(dim)):
            corners = np.array([[axis in order[:k] for axis in range(dim)] for k in range(dim + 1)], dtype=np.int64)
            positive = np.linalg.det(np.diff(corners, axis=0)) > 0.0
            ways.append(corners if positive else corners[[*range(dim - 1), dim, dim - 1]])
    rows = [[place[tuple(point)] for point in (start + way).tolist()] for start in starts for way in ways]
    within = np.array(rows)
    renumbered = np.cumsum(inside) - 1
    return weights[inside], renumbered[within[inside[within].all(axis=1)]]
