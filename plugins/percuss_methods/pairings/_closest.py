"""The points of a surface against the nearest facets of another one, or against a wall."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss import PairedPoints, Wall
from percuss_methods.elements.quad4 import CORNERS, bilinear
from percuss_methods.elements.tri3 import Tri3

if TYPE_CHECKING:
    from percuss import Floats, Integers, Surface

AT_AN_END = 1e-8  # of the size of a facet: a point that lies so far beyond the end of a surface is still inside
FIRST_TRIED = 8  # facets whose middles are nearest to a point
NEWTON, FARTHEST = 12, 3.0  # steps of the search for a place, and how far from the middle of a facet it may go


def paired(first: Surface, second: Surface | Wall, facets: Integers, shares: Floats, weight: Floats) -> PairedPoints:
    """Return the contact points of a surface that have a partner on the other one.

    Parameters
    ----------
    first, second
        The surface of the points, and the surface or the wall that they meet.
    facets : (P,) array
        Facet of the first surface on which each point lies.
    shares : (P, nodes of a facet) array
        Shape functions of that facet at the point.
    weight : (P,) array
        Area that belongs to each point.
    """
    at = np.einsum("pa,pad->pd", shares, first.positions[first.facets[facets]])
    own = first.nodes[first.facets[facets]]
    if isinstance(second, Wall):
        gap, normal = (at - second.point) @ second.normal, np.tile(-second.normal, (len(at), 1))
        return _as_rows(gap, weight, normal, np.stack([facets, np.full(len(at), -1)], axis=1), own, shares, None, None)
    facet, other = closest(at, second)
    met = np.einsum("pa,pad->pd", other, second.positions[second.facets[facet]])
    outward = second.outward(facet, other)
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    gap = np.einsum("pd,pd->p", at - met, outward)
    beside = np.linalg.norm(at - met - gap[:, None] * outward, axis=1)
    size = np.ptp(second.positions[second.facets[facet]], axis=1).max(axis=1)
    inside = (beside <= AT_AN_END * size) | ~_at_the_end(second, facet, other)
    return _as_rows(
        gap[inside], weight[inside], -outward[inside], np.stack([facets, facet], axis=1)[inside], own[inside],
        shares[inside], second.nodes[second.facets[facet[inside]]], other[inside],
    )  # fmt: skip


def closest(at: Floats, surface: Surface) -> tuple[Integers, Floats]:
    """Return the facet nearest to each point, and its shape functions at the nearest place of it.

    Parameters
    ----------
    at : (P, dim) array
        The points.
    surface
        Edges, or triangles and quadrilaterals, which need not be plane.

    Returns
    -------
    (P,) and (P, nodes of a facet) arrays
    """
    from scipy.spatial import cKDTree

    corners = surface.positions[surface.facets]
    middles = corners.mean(axis=1)
    radius = float(np.linalg.norm(corners - middles[:, None], axis=2).max())
    tree, some = cKDTree(middles), FIRST_TRIED
    facet, shares = np.zeros(len(at), dtype=np.int64), np.zeros((len(at), corners.shape[1]))
    left = np.arange(len(at))
    while left.size:  # no facet whose middle is farther away than the nearest place and a radius can be nearer
        some = min(some, len(corners))
        apart, tried = (found.reshape(left.size, some) for found in tree.query(at[left], some))
        distance, places = _places(np.repeat(at[left], some, axis=0), corners[tried.ravel()])
        distance, rows = distance.reshape(left.size, some), np.arange(left.size)
        # Of facets that are equally near, as two at a corner between them, the first of the surface counts.
        nearest = distance.min(axis=1)
        even = distance <= nearest[:, None] + AT_AN_END * radius
        best = np.where(even, tried, len(corners)).argmin(axis=1)
        facet[left], shares[left] = tried[rows, best], places.reshape(left.size, some, -1)[rows, best]
        left = left[(some < len(corners)) & (apart[:, -1] <= nearest + radius)]
        some *= 4
    return facet, shares


def _places(at: Floats, corners: Floats) -> tuple[Floats, Floats]:
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
    width = corners.shape[1]
    place = np.zeros((len(at), 2))
    for _ in range(1 if width == 3 else NEWTON):
        shares, slopes = _shapes(place, width)
        tangents = np.einsum("pai,pad->pid", slopes, corners)
        apart = at - np.einsum("pa,pad->pd", shares, corners)
        matrix = np.einsum("pid,pjd->pij", tangents, tangents)
        if width == 4:
            twist = 0.25 * np.einsum("a,pad->pd", CORNERS.prod(axis=1), corners)
            matrix[:, [0, 1], [1, 0]] -= np.einsum("pd,pd->p", apart, twist)[:, None]
        right = np.einsum("pid,pd->pi", tangents, apart)
        sound = np.abs(np.linalg.det(matrix)) > 1e-12 * np.trace(matrix, axis1=1, axis2=2) ** 2
        matrix[~sound] = np.eye(2)
        step = np.where(sound[:, None], np.linalg.solve(matrix, right[..., None])[..., 0], 0.0)
        place = np.clip(place + step, -FARTHEST, FARTHEST)
    shares, _ = _shapes(place, width)
    outside = np.abs(place).max(axis=1) > 1.0 if width == 4 else np.zeros(len(at), dtype=bool)
    shares[outside, 0] = -1.0
    return shares


def _shapes(place: Floats, width: int) -> tuple[Floats, Floats]:
    """Return shape functions and their slopes at places of triangles or of quadrilaterals."""
    if width == 4:
        return bilinear(place)
    x, y = place.T
    return np.stack([1.0 - x - y, x, y], axis=1), np.repeat(Tri3.slopes, len(place), axis=0)


def _at_the_end(surface: Surface, facet: Integers, shares: Floats) -> Any:
    """Return whether places of facets, given by shape functions, lie on the rim of an open surface."""
    if surface.facets.shape[1] == 2:
        ends, counts = np.unique(surface.facets, return_counts=True)
        on_rim = np.zeros(len(surface.nodes), dtype=bool)
        on_rim[ends[counts == 1]] = True
        return (on_rim[surface.facets[facet]] & (shares == 1.0)).any(axis=1)
    edges = np.stack([surface.facets, np.roll(surface.facets, -1, axis=1)], axis=2)
    _, number, counts = np.unique(
        np.sort(edges, axis=2).reshape(-1, 2), axis=0, return_inverse=True, return_counts=True
    )
    alone = (counts == 1)[number].reshape(surface.facets.shape)
    corners = np.zeros(len(surface.nodes), dtype=bool)
    corners[edges[alone].ravel()] = True
    held = shares > 0.0
    on_edge = held.sum(axis=1) == 2
    rim = (held & (held.sum(axis=1) == 1)[:, None] & corners[surface.facets[facet]]).any(axis=1)
    for a in range(surface.facets.shape[1]):
        rim |= on_edge & alone[facet, a] & held[:, a] & np.roll(held, -1, axis=1)[:, a]
    return rim


def _as_rows(
    gap: Floats,
    weight: Floats,
    normal: Floats,
    facets: Integers,
    own: Integers,
    shares: Floats,
    other: Integers | None,
    of_other: Floats | None,
) -> PairedPoints:
    nodes, values = own, -shares[..., None] * normal[:, None]
    if other is not None and of_other is not None:
        nodes = np.concatenate([own, other], axis=1)
        values = np.concatenate([values, of_other[..., None] * normal[:, None]], axis=1)
    kept = np.abs(np.concatenate([shares] if of_other is None else [shares, of_other], axis=1)) > 0.0
    start = np.concatenate([[0], np.cumsum(kept.sum(axis=1))])
    return PairedPoints(gap, weight, normal, facets, start, nodes[kept], values[kept])
