"""The points of a surface against the nearest facets of another one, or against a wall."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from percuss import PairedPoints, Wall

if TYPE_CHECKING:
    from percuss import Floats, Integers, Surface

AT_AN_END = 1e-8  # of the length of an edge: a point that lies so far beyond the end of a surface is still inside


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
    count, dim = at.shape
    own = first.nodes[first.facets[facets]]
    if isinstance(second, Wall):
        gap, normal = (at - second.point) @ second.normal, np.tile(-second.normal, (count, 1))
        return _as_rows(gap, weight, normal, np.stack([facets, np.full(count, -1)], axis=1), own, shares, None, None)
    if dim != 2:
        raise ValueError(f"it pairs edges in two dimensions, found surfaces in {dim}")
    edge, place = _nearest_edges(at, second)
    inside = np.abs(place - 0.5) <= 0.5 + AT_AN_END
    edge, place = edge[inside], np.clip(place[inside], 0.0, 1.0)
    facets, shares, weight, own, at = facets[inside], shares[inside], weight[inside], own[inside], at[inside]
    other = np.stack([1.0 - place, place], axis=1)
    met = np.einsum("pa,pad->pd", other, second.positions[second.facets[edge]])
    outward = second.normals[edge]
    gap = np.einsum("pd,pd->p", at - met, outward)
    both = np.stack([facets, edge], axis=1)
    return _as_rows(gap, weight, -outward, both, own, shares, second.nodes[second.facets[edge]], other)


def _nearest_edges(at: Floats, surface: Surface) -> tuple[Integers, Floats]:
    """Return the nearest edge of a surface to each point, and the place of the point along it, 0 to 1 on the edge.

    Beyond an end that is open the place is outside of 0 to 1.
    """
    start, stop = (surface.positions[surface.facets[:, k]] for k in (0, 1))
    along = stop - start
    length = np.einsum("fd,fd->f", along, along)
    place = np.einsum("pfd,fd->pf", at[:, None] - start, along) / length
    nearest = start + np.clip(place, 0.0, 1.0)[..., None] * along
    edge = np.argmin(np.einsum("pfd,pfd->pf", at[:, None] - nearest, at[:, None] - nearest), axis=1)
    rows = np.arange(len(at))
    found = place[rows, edge]
    ends, counts = np.unique(surface.facets, return_counts=True)
    open_ends = ends[counts == 1]
    at_start = ~np.isin(surface.facets[edge, 0], open_ends) & (found < 0.0)
    at_stop = ~np.isin(surface.facets[edge, 1], open_ends) & (found > 1.0)
    found[at_start], found[at_stop] = 0.0, 1.0  # the point lies over a corner between two edges
    return edge, found


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
