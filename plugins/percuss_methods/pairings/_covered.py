"""Quadrature over the parts of a surface that another one covers: edges by edges, facets by facets."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from percuss import REFERENCE_CELLS
from percuss_methods.pairings._closest import AT_AN_END
from percuss_methods.pairings.gauss_points import rule

if TYPE_CHECKING:
    from percuss import Floats, Integers, Surface

ROUND_OFF = 1e-14  # of the area of a facet: smaller pieces are left out
PAIRS = 1_000_000  # of facets that are looked at together
NEWTON = 30  # most steps of the search for a place
TRIANGLE, QUAD = REFERENCE_CELLS["triangle"], REFERENCE_CELLS["quad"]


class Quadrature(NamedTuple):
    """The quadrature points of the parts of a surface that another one covers."""

    facet: Integers  # of the first surface
    share: Floats  # (points, nodes of a facet) shape functions of that facet
    other: Integers  # facet of the second surface
    other_share: Floats  # (points, nodes of a facet) shape functions of that facet
    area: Floats  # of the first surface that belongs to the point
    basis: Floats  # (points, nodes of a facet) functions that span the shape functions of the facet
    at_nodes: Floats  # (facets, nodes of a facet, nodes of a facet) the same at the nodes of each facet
    cornered: Integers  # facet of the first surface to which each corner of a covered piece belongs
    apart: Floats  # (corners, dim) from the first surface to the second one there


def covered(first: Surface, second: Surface) -> Quadrature:
    """Return the quadrature points of the parts of the first surface that the second one covers."""
    return _on_edges(first, second) if first.facets.shape[1] == 2 else _on_facets(first, second)


def between(
    first: Surface, own: Integers, second: Surface, other: Integers, share: Floats, other_share: Floats
) -> Floats:
    """Return the vectors from points of facets of the first surface to points of facets of the second one, (P, dim)."""
    from_, to = (
        np.einsum("pa,pad->pd", of, surface.positions[surface.facets[facet]])
        for surface, facet, of in ((first, own, share), (second, other, other_share))
    )
    vectors: Floats = to - from_
    return vectors


# ------------------------------------------------------------------------------------------------------ edges


def _on_edges(first: Surface, second: Surface) -> Quadrature:
    """Return two Gauss points on each piece of an edge between neighbouring nodes of the surface that covers it."""
    edge, other, start, stop, ends = _pieces(first, second)
    place, weight = np.polynomial.legendre.leggauss(2)
    edge, other, ends = (np.repeat(array, 2, axis=0) for array in (edge, other, ends))

    def shares(on_edge: Floats) -> tuple[Floats, Floats]:
        on_other = (on_edge - ends[:, 0]) / (ends[:, 1] - ends[:, 0])
        share, other_share = (np.stack([1.0 - along, along], axis=1) for along in (on_edge, on_other))
        return share, other_share

    share, other_share = shares((0.5 * (start + stop)[:, None] + 0.5 * (stop - start)[:, None] * place).ravel())
    area = first.spread(edge, share) * (0.5 * (stop - start)[:, None] * weight).ravel()
    at_nodes = np.tile(np.eye(2), (len(first.facets), 1, 1))
    apart = between(first, edge, second, other, *shares(np.stack([start, stop], axis=1).ravel()))
    return Quadrature(edge, share, other, other_share, area, share, at_nodes, edge, apart)


def _pieces(first: Surface, second: Surface) -> tuple[Integers, Integers, Floats, Floats, Floats]:
    """Return the edges of two surfaces that face each other, piece by piece.

    Returns
    -------
    The edge of the first surface, that of the second one, where the piece starts and stops as parts of the former, and
    where the two ends of the latter project to.
    """
    half_size = 0.5 * float(np.linalg.norm(np.ptp(first.positions, axis=0)))
    begin, end = (second.positions[second.facets[:, k]] for k in (0, 1))
    found = []
    for edge, (a, b) in enumerate(first.facets):
        along, normal = first.positions[b] - first.positions[a], first.normals[edge]
        ends = np.stack([begin - first.positions[a], end - first.positions[a]], axis=1)
        places = ends @ along / (along @ along)
        low, high = places.min(axis=1), places.max(axis=1)
        near = (second.normals @ normal < 0.0) & (high > 0.0) & (low < 1.0)
        cuts = np.unique(np.clip(np.concatenate([[0.0, 1.0], places[near].ravel()]), 0.0, 1.0))
        cuts = np.concatenate([[0.0], cuts[1:-1][np.diff(cuts[1:]) > AT_AN_END], [1.0]])
        for start, stop in pairwise(cuts):
            middle = 0.5 * (start + stop)
            (over,) = np.nonzero(near & (low <= middle) & (high >= middle))
            part = (middle - places[over, 0]) / (places[over, 1] - places[over, 0])
            gap = (ends[over, 0] + part[:, None] * (ends[over, 1] - ends[over, 0])) @ normal
            # The far side of a closed body is behind the edge, too, by more than the body can overlap.
            over, gap = over[gap > -half_size], gap[gap > -half_size]
            if over.size:
                nearest = over[np.argmin(np.abs(gap))]
                found.append((edge, nearest, start, stop, places[nearest]))
    edges, others, starts, stops, ends_of_others = zip(*found, strict=True) if found else ((), (), (), (), ())
    return (
        np.array(edges, dtype=np.int64), np.array(others, dtype=np.int64), np.array(starts, dtype=float),
        np.array(stops, dtype=float), np.array(ends_of_others, dtype=float).reshape(-1, 2),
    )  # fmt: skip


# ----------------------------------------------------------------------------------------------------- facets


def _on_facets(first: Surface, second: Surface) -> Quadrature:
    """Return the points of a rule on the triangles into which facets of the second surface cut those of the first one.

    Both facets are projected onto the plane of the first one, along its normal. The rule is exact for triangles and
    parallelograms, whose shape functions are polynomials in that plane.
    """
    own, other = _near(first, second)
    normals = first.normals[own]
    along = first.positions[first.facets[:, 1]] - first.positions[first.facets[:, 0]]
    along -= np.einsum("fd,fd->f", along, first.normals)[:, None] * first.normals
    along /= np.linalg.norm(along, axis=1)[:, None]
    axes = np.stack([along, np.cross(first.normals, along)], axis=1)[own]
    middles, others = (surface.positions[surface.facets].mean(axis=1) for surface in (first, second))
    ours, theirs = (
        np.einsum("pad,pid->pai", surface.positions[surface.facets[which]] - middles[own, None], axes)
        for surface, which in ((first, own), (second, other))
    )
    backwards = theirs[:, ::-1]  # counter-clockwise, as seen against the normal of the first surface
    polygons = _cut(backwards, ours)
    fans = np.stack([np.broadcast_to(polygons[:, :1], polygons[:, 2:].shape), polygons[:, 1:-1], polygons[:, 2:]], 2)
    area, whole = _areas(fans), _areas(np.stack([ours[:, [0] * (ours.shape[1] - 2)], ours[:, 1:-1], ours[:, 2:]], 2))
    # A facet that is seen edge on, so that it is turned over or not convex in this plane, covers nothing.
    area[~(_is_convex(ours) & _is_convex(backwards))] = 0.0
    whole = whole.sum(axis=1)
    area[area <= ROUND_OFF * whole[:, None]] = 0.0
    pieces = area.sum(axis=1)
    centre = np.einsum("pt,ptd->pd", area, fans.mean(axis=2)) / np.maximum(pieces, np.finfo(float).tiny)[:, None]
    place, out = middles[own] + np.einsum("pi,pid->pd", centre, axes), second.normals[other]
    depth = np.einsum("pd,pd->p", others[other] - place, out) / np.einsum("pd,pd->p", normals, out)
    # The far side of a closed body is behind the facet, too, by more than the body can overlap.
    seen = (pieces > 0.0) & (depth > -0.5 * float(np.linalg.norm(np.ptp(first.positions, axis=0))))
    seen[seen] = ~_hidden(own[seen], centre[seen], backwards[seen], depth[seen])
    seen &= np.bincount(own, pieces * seen, len(first.facets))[own] > AT_AN_END * whole
    pair, fan = np.nonzero((area > 0.0) & seen[:, None])
    corner, cornered = fans[pair, fan].reshape(-1, 2), np.repeat(pair, 3)
    shares = _shares(corner, ours[cornered]), _shares(corner, theirs[cornered])
    apart = between(first, own[cornered], second, other[cornered], *shares)
    cornered = own[cornered]
    on_triangle, weight = rule(3, _points_along(first, second))
    place = np.einsum("qc,tcd->tqd", on_triangle, fans[pair, fan]).reshape(-1, 2)
    flat = np.outer(area[pair, fan], weight).ravel()
    pair = np.repeat(pair, weight.size)
    share, other_share = _shares(place, ours[pair]), _shares(place, theirs[pair])
    own = own[pair]
    vector = first.outward(own, share)
    flat *= np.linalg.norm(vector, axis=1) / np.einsum("pd,pd->p", vector, normals[pair])
    basis, at_nodes = _basis(own, share, flat, len(first.facets))
    return Quadrature(own, share, other[pair], other_share, flat, basis, at_nodes, cornered, apart)


def _near(first: Surface, second: Surface) -> tuple[Integers, Integers]:
    """Return the pairs of facets that face each other and whose circles overlap as seen along the normal of the first.

    Facets of the first surface come in their order.
    """
    corners = [surface.positions[surface.facets] for surface in (first, second)]
    middles = [of.mean(axis=1) for of in corners]
    radii = [
        np.linalg.norm(of - middle[:, None], axis=2).max(axis=1) for of, middle in zip(corners, middles, strict=True)
    ]
    found = []
    for start in range(0, len(first.facets), step := max(1, PAIRS // len(second.facets))):
        some = slice(start, start + step)
        normals = first.normals[some]
        apart = middles[1] - middles[0][some, None]
        along = np.einsum("ijd,id->ij", apart, normals)
        across = np.einsum("ijd,ijd->ij", apart, apart) - along**2
        near = (across <= (radii[0][some, None] + radii[1]) ** 2) & (normals @ second.normals.T < 0.0)
        own, other = np.nonzero(near)
        found.append((own + start, other))
    own, other = (np.concatenate(numbers) for numbers in zip(*found, strict=True))
    return own, other


def _cross(a: Floats, b: Floats) -> Floats:
    """Return the component of the product of plane vectors across the plane."""
    product: Floats = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def _areas(triangles: Floats) -> Floats:
    """Return the areas of triangles, (..., 3, 2), positive where they run counter-clockwise."""
    return 0.5 * _cross(triangles[..., 1, :] - triangles[..., 0, :], triangles[..., 2, :] - triangles[..., 0, :])


def _is_convex(polygons: Floats) -> Floats:
    """Return whether polygons run counter-clockwise and are convex."""
    ahead = np.roll(polygons, -1, axis=1) - polygons
    turns: Floats = (_cross(ahead, np.roll(ahead, -1, axis=1)) > 0.0).all(axis=1)
    return turns


def _cut(polygons: Floats, by: Floats) -> Floats:
    """Return what convex polygons have in common with others (Sutherland, Hodgman).

    Parameters
    ----------
    polygons, by : (P, corners, 2) arrays
        All of them counter-clockwise.

    Returns
    -------
    (P, corners of both, 2) array
        The last corner of a polygon is repeated as often as there are fewer.
    """
    for start, end in zip(by.swapaxes(0, 1), np.roll(by, -1, axis=1).swapaxes(0, 1), strict=True):
        side = _cross((end - start)[:, None], polygons - start[:, None])
        inside, following = side >= 0.0, np.roll(side, -1, axis=1)
        crossing = inside != (following >= 0.0)
        part = side / np.where(crossing, side - following, 1.0)
        on_line = polygons + part[..., None] * (np.roll(polygons, -1, axis=1) - polygons)
        pairs, twice = polygons.shape[0], 2 * polygons.shape[1]
        kept = np.stack([inside, crossing], axis=2).reshape(pairs, twice)
        order = np.argsort(~kept, axis=1, kind="stable")
        last = np.maximum(kept.sum(axis=1) - 1, 0)[:, None]
        chosen = np.take_along_axis(order, np.minimum(np.arange(polygons.shape[1] + 1), last), axis=1)
        corners = np.stack([polygons, on_line], axis=2).reshape(pairs, twice, 2)
        polygons = np.take_along_axis(corners, chosen[..., None], axis=1)
    return polygons


def _hidden(own: Integers, centre: Floats, corners: Floats, depth: Floats) -> Floats:
    """Return which pieces of facets have another facet of the second surface before them.

    Parameters
    ----------
    own : (P,) array
        Facet of the first surface, in ascending order.
    centre, corners, depth
        Centre of the piece, (P, 2), corners of the facet of the second surface, (P, nodes of a facet, 2), and its
        distance there, (P,).
    """
    hidden = np.zeros(own.size, dtype=bool)
    ahead, middle = np.roll(corners, -1, axis=1) - corners, corners.mean(axis=1)
    radius = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    for here in np.split(np.arange(own.size), np.flatnonzero(np.diff(own)) + 1):
        for some in np.array_split(here, 1 + here.size**2 // PAIRS):
            apart = np.abs(centre[some, None] - middle[here])
            near = (apart[..., 0] < radius[here]) & (apart[..., 1] < radius[here])
            near &= np.abs(depth[here]) < np.abs(depth[some, None])
            piece, other = np.nonzero(near)
            piece, other = some[piece], here[other]
            inside = (_cross(ahead[other], centre[piece, None] - corners[other]) > 0.0).all(axis=1)
            hidden[piece[inside]] = True
    return hidden


def _points_along(*surfaces: Surface) -> int:
    """Return how many points along a triangle integrate products of a shape function of each surface and a dual one."""
    corners = [surface.positions[surface.facets] for surface in surfaces if surface.facets.shape[1] == 4]
    if not corners:
        return 2
    bent = max(float(np.abs(of[:, 0] - of[:, 1] + of[:, 2] - of[:, 3]).max() / np.ptp(of)) for of in corners)
    return 3 if bent < ROUND_OFF else 6


def _shares(place: Floats, corners: Floats) -> Floats:
    """Return the shape functions of plane facets, (P, nodes of a facet, 2), at places in their plane, (P, 2)."""
    if corners.shape[1] == 3:
        parts = [_areas(np.stack([place, corners[:, a - 2], corners[:, a - 1]], axis=1)) for a in range(3)]
        return np.stack(parts, axis=1) / _areas(corners)[:, None]
    at = np.zeros_like(place)
    for _ in range(NEWTON):
        shares, slopes = QUAD.shape_functions(at)
        miss = place - np.einsum("pa,pad->pd", shares, corners)
        x, y = np.einsum("pai,pad->ipd", slopes, corners)
        step = np.stack([_cross(miss, y), _cross(x, miss)], axis=1) / _cross(x, y)[:, None]
        at += step
        if np.abs(step).max(initial=0.0) < ROUND_OFF:
            break
    return QUAD.shape_functions(at)[0]


def _basis(facet: Integers, share: Floats, area: Floats, facets: int) -> tuple[Floats, Floats]:
    """Return functions that span the shape functions of facets, at points and at the nodes of each facet.

    They are 1, s, t and, on a quadrilateral, s t, with the origin in the middle of the covered part and its size as
    unit: the matrix of their products is regular on a small part, where that of the shape functions is not.
    """
    corners = (TRIANGLE if share.shape[1] == 3 else QUAD).corners
    place = share @ corners
    whole = np.maximum(np.bincount(facet, area, facets), np.finfo(float).tiny)

    def mean(values: Floats) -> Floats:
        return np.stack([np.bincount(facet, area * value, facets) for value in values.T], axis=1) / whole[:, None]

    centre = mean(place)
    size = np.sqrt(mean((place - centre[facet]) ** 2))
    size[size == 0.0] = 1.0  # of facets that are not covered

    def functions(at: Floats) -> Floats:
        s, t = at[..., 0], at[..., 1]
        return np.stack([np.ones_like(s), s, t, s * t][: share.shape[1]], axis=-1)

    at_nodes = functions((corners - centre[:, None]) / size[:, None])
    return functions((place - centre[facet]) / size[facet]), at_nodes
