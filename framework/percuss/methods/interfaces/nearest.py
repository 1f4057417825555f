"""The places of a surface that are nearest to points, on edges, triangles and quadrilaterals."""

from __future__ import annotations

import numpy as np

from percuss.methods.interfaces.base import Floats, Integers
from percuss.methods.interfaces.cells import REFERENCE_CELLS

EVEN = 1e-8  # of the size of a facet: places whose distances differ by less are equally near
FEW = 10_000  # pairs of a point and a facet that are all tried, as that takes less time than a search
FIRST_TRIED = 8  # facets whose middles are nearest to a point
NEWTON, FARTHEST = 12, 3.0  # steps of the search for a place, and how far from the middle of a facet it may go
FOUND = 1e-12  # step after which a place is found, as each step squares the distance to it


def nearest_places(at: Floats, corners: Floats) -> tuple[Integers, Floats]:
    """Return the facet nearest to each point, and its shape functions at the nearest place of it.

    Parameters
    ----------
    at : (P, dim) array
        The points.
    corners : (F, nodes of a facet, dim) array
        Corners of edges, or of triangles and quadrilaterals, which need not be plane.

    Returns
    -------
    (P,) and (P, nodes of a facet) arrays
    """
    middles = corners.mean(axis=1)
    reach = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
    radius = float(reach.max())
    facet, shares = np.zeros(len(at), dtype=np.int64), np.zeros((len(at), corners.shape[1]))
    left, some = np.arange(len(at)), FIRST_TRIED
    if few := len(at) * len(corners) <= FEW:
        some = len(corners)
    else:
        from scipy.spatial import cKDTree

        tree = cKDTree(middles)
    while left.size:  # no facet whose middle is farther away than the nearest place and a radius can be nearer
        some = min(some, len(corners))
        near, rows = np.ones((left.size, some), dtype=bool), np.arange(left.size)
        if few:
            apart = tried = np.tile(np.arange(some), (left.size, 1))
        else:
            apart, tried = (found.reshape(left.size, some) for found in tree.query(at[left], some))
            # Where cells are graded most facets are too small to reach as near as the nearest middle is.
            near = apart - reach[tried] <= apart[:, :1] + EVEN * radius
        distance, places = np.full(near.shape, np.inf), np.zeros((*near.shape, corners.shape[1]))
        distance[near], places[near] = places_on(at[left[near.nonzero()[0]]], corners[tried[near]])
        # Of facets that are equally near, as two at a corner between them, the first of the surface counts.
        nearest = distance.min(axis=1)
        even = distance <= nearest[:, None] + EVEN * radius
        best = np.where(even, tried, len(corners)).argmin(axis=1)
        facet[left], shares[left] = tried[rows, best], places[rows, best]
        left = left[(some < len(corners)) & (apart[:, -1] <= nearest + radius)]
        some *= 4
    return facet, shares


def places_on(at: Floats, corners: Floats) -> tuple[Floats, Floats]:
    """Return the distance of each point from its facet, and the shape functions of the facet at the nearest place.

    Parameters
    ----------
    at : (P, dim) array
        The points.
    corners : (P, nodes of a facet, dim) array
        Corners of the facet of each.
    """
    width = corners.shape[1]
    found = []
    for a in range(1 if width == 2 else width):  # the edges
        b = (a + 1) % width
        along = corners[:, b] - corners[:, a]
        part = np.clip(np.einsum("pd,pd->p", at - corners[:, a], along) / np.einsum("pd,pd->p", along, along), 0.0, 1.0)
        shares = np.zeros((len(at), width))
        shares[:, a], shares[:, b] = 1.0 - part, part
        found.append(shares)
    if width > 2:
        found.append(_inside(at, corners))
    apart = [np.linalg.norm(at - np.einsum("pa,pad->pd", shares, corners), axis=1) for shares in found]
    if width > 2:
        apart[-1][found[-1].min(axis=1) < 0.0] = np.inf
    best, rows = np.argmin(apart, axis=0), np.arange(len(at))
    return np.array(apart)[best, rows], np.array(found)[best, rows]


def _inside(at: Floats, corners: Floats) -> Floats:
    """Return the shape functions of facets where the vector to each point is across; one is negative if it is outside.

    Newton's method for quadrilaterals, with the curvature of the facet; of triangles its first step is exact.
    """
    width, left = corners.shape[1], np.arange(len(at))
    cell, place = REFERENCE_CELLS["triangle" if width == 3 else "quad"], np.zeros((len(at), 2))
    for _ in range(1 if width == 3 else NEWTON):
        shares, slopes = cell.shape_functions(place[left])
        tangents = np.swapaxes(slopes, 1, 2) @ corners[left]
        apart = at[left] - np.einsum("pa,pad->pd", shares, corners[left])
        matrix = tangents @ np.swapaxes(tangents, 1, 2)
        if width == 4:
            twist = 0.25 * np.einsum("a,pad->pd", cell.corners.prod(axis=1), corners[left])
            matrix[:, [0, 1], [1, 0]] -= np.einsum("pd,pd->p", apart, twist)[:, None]
        right = np.einsum("pid,pd->pi", tangents, apart)
        sound = np.abs(np.linalg.det(matrix)) > 1e-12 * np.trace(matrix, axis1=1, axis2=2) ** 2
        matrix[~sound] = np.eye(2)
        step = np.where(sound[:, None], np.linalg.solve(matrix, right[..., None])[..., 0], 0.0)
        found = np.clip(place[left] + step, -FARTHEST, FARTHEST)
        moves = np.abs(found - place[left]).max(axis=1) > FOUND
        place[left] = found
        left = left[moves]
    shares, _ = cell.shape_functions(place)
    outside = np.abs(place).max(axis=1) > 1.0 if width == 4 else np.zeros(len(at), dtype=bool)
    shares[outside, 0] = -1.0
    return shares
