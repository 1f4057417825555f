"""The points of a surface against the nearest facets of another one, or against a wall."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss import PairedPoints, Wall

if TYPE_CHECKING:
    from percuss import Floats, Integers, Surface

AT_AN_END = 1e-8  # of the size of a facet: a point that lies so far beyond the end of a surface is still inside


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
    facet, other, gap, outward, _, inside = _met(at, second)
    return _as_rows(
        gap[inside], weight[inside], -outward[inside], np.stack([facets, facet], axis=1)[inside], own[inside],
        shares[inside], second.nodes[second.facets[facet[inside]]], other[inside],
    )  # fmt: skip


def _met(at: Floats, surface: Surface) -> tuple[Integers, Floats, Floats, Floats, Any, Any]:
    """Return what points meet of a surface.

    Returns
    -------
    The facet nearest to each, its shape functions there, the gap, the normal, whether the place is on the rim of the
    surface, and whether the point has a partner there.
    """
    facet, other = surface.nearest(at)
    met = np.einsum("pa,pad->pd", other, surface.positions[surface.facets[facet]])
    outward = surface.outward(facet, other)
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    gap = np.einsum("pd,pd->p", at - met, outward)
    beside = np.linalg.norm(at - met - gap[:, None] * outward, axis=1)
    size = np.ptp(surface.positions[surface.facets[facet]], axis=1).max(axis=1)
    rim = _at_the_end(surface, facet, other)
    # Where facets meet, the gap is the distance, along the vector to the point; of points that touch along their mean.
    cornered = np.flatnonzero(~rim & (other <= AT_AN_END).any(axis=1))
    meetings = surface.facets_at(surface.facets[facet[p]][other[p] > AT_AN_END] for p in cornered)
    for p, meeting in zip(cornered, meetings, strict=True):
        vector, normals = at[p] - met[p], surface.normals[meeting]
        apart = float(np.linalg.norm(vector))
        if apart <= AT_AN_END * size[p]:
            outward[p] = normals.sum(axis=0) / np.linalg.norm(normals.sum(axis=0))
        elif (normals @ vector > 0.0).any():  # else the point lies inside
            outward[p], gap[p] = vector / apart, apart
    return facet, other, gap, outward, rim, (beside <= AT_AN_END * size) | ~rim


def areas_of_nodes(first: Surface, second: Surface | Wall) -> Floats:
    """Return the area of the nodes of a surface, (n,), as far as the other surface is there.

    Of a node at the rim of the other surface only those facets count that lie over it, so that the areas of two
    contacts side by side add up. A node that touches with a corner alone keeps its area.
    """
    of_nodes, count = first.of_nodes(), len(first.nodes)
    whole: Floats = np.bincount(first.facets.ravel(), of_nodes.ravel(), count)
    if isinstance(second, Wall):
        return whole
    *_, rim, inside = _met(first.positions, second)
    facet, place = np.nonzero((rim & inside)[first.facets])
    if not facet.size:
        return whole
    corners = first.positions[first.facets[facet]]
    part = 0.5 * (corners[np.arange(facet.size), place] + corners.mean(axis=1))
    beyond = ~_met(part, second)[-1]
    of_nodes[facet[beyond], place[beyond]] = 0.0
    covered = np.bincount(first.facets.ravel(), of_nodes.ravel(), count)
    return np.where(covered > 0.0, covered, whole)


def _at_the_end(surface: Surface, facet: Integers, shares: Floats) -> Any:
    """Return whether places of facets, given by shape functions, lie on the rim of an open surface."""
    (edges, corners), held = surface.rims(), shares > 0.0
    nodes = held.sum(axis=1)
    on_edge = held & np.roll(held, -1, axis=1) & (edges[facet] == 1)
    at_node = shares == 1.0 if held.shape[1] == 2 else held & (nodes == 1)[:, None]
    return (at_node & (corners[facet] == 1)).any(axis=1) | (on_edge.any(axis=1) & (nodes == 2))


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
