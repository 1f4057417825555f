"""Dual mortar: contact points at nodes, each of which sees all of the other surface around it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from percuss import PairedPoints, Pairing, Wall
from percuss_methods.pairings._closest import AT_AN_END
from percuss_methods.pairings.node_to_segment import NodeToSegment

if TYPE_CHECKING:
    from percuss import Floats, Integers, Surface


@dataclass(frozen=True)
class Mortar(Pairing):
    """The nodes of the first surface against means of the second one, by functions dual to those of the nodes.

    Formula: ``g_j = integral of psi_j n_j . (y - x) / D_j``, ``w_j = D_j = integral of phi_j`` over what the second
    surface covers of the edges at node j. The normal n_j is the normalised sum of those of these edges; y is the point
    of the second surface that the normal of an edge meets at its point x. On each edge ``psi = D M^-1 phi`` with ``M =
    integral of phi phi^T`` and ``D = diag(integral of phi)`` over its covered part, so that ``psi_j phi_k`` integrates
    to 0 for two nodes.

    A uniform pressure between any two meshes is transmitted exactly: each edge is cut where nodes of the second surface
    project onto it. The nodes of the second surface may have negative shares in a gap. A mean that is negative at the
    start, though the surfaces are apart, counts as 0. At a wall the points are nodes.
    """

    name = "mortar"
    summary = "Dual mortar: nodes of the first surface against means of the second one"
    references = (
        "Popp, Gee, Wall: A finite deformation mortar contact formulation using a primal-dual active set strategy, "
        "Int. J. Numer. Methods Engrg. 79 (2009), doi 10.1002/nme.2614",
        "Cichosz, Bischoff: Consistent treatment of boundaries with mortar contact formulations using dual Lagrange "
        "multipliers, Comput. Methods Appl. Mech. Engrg. 200 (2011), doi 10.1016/j.cma.2010.11.004",
    )
    dimensions = (2,)
    passes_patch_test = True
    convex = False

    def points(self, first: Surface, second: Surface | Wall) -> PairedPoints:
        """Return the nodes of the first surface of which the second one covers a part."""
        if isinstance(second, Wall):
            return NodeToSegment().points(first, second)
        at = _quadrature(first, second)
        count, edges = len(first.nodes), len(first.facets)
        of_edge, matrix = np.zeros((edges, 2)), np.zeros((edges, 2, 2))
        np.add.at(of_edge, at.edge, at.area[:, None] * at.share)
        np.add.at(matrix, at.edge, at.area[:, None, None] * at.share[:, :, None] * at.share[:, None])
        covered = of_edge[at.edge]
        dual = at.area[:, None] * covered * np.linalg.solve(matrix[at.edge], at.share[..., None])[..., 0]
        nodes, others = first.facets[at.edge], second.facets[at.other]
        between = np.einsum("pb,pbd->pd", at.other_share, second.positions[others]) - np.einsum(
            "pa,pad->pd", at.share, first.positions[nodes]
        )
        weight, apart, normal = np.zeros(count), np.zeros((count, 2)), np.zeros((count, 2))
        np.add.at(weight, first.facets, of_edge)
        np.add.at(apart, nodes, dual[..., None] * between[:, None])
        np.add.at(normal, first.facets, np.repeat(first.normals[:, None], 2, axis=1))
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        seen = np.zeros((count, len(second.nodes)))
        np.add.at(seen, (nodes[:, :, None], others[:, None]), dual[:, :, None] * at.other_share[:, None])
        facets = np.zeros((count, 2), dtype=np.int64)
        facets[nodes] = np.stack([at.edge, at.other], axis=1)[:, None]  # any two that a node sees serve
        (found,) = np.nonzero(weight > 0.0)
        start, node, value = [0], [first.nodes[:0]], [normal[:0]]
        for j in found:
            (sees,) = np.nonzero(seen[j])
            node += [first.nodes[[j]], second.nodes[sees]]
            value += [-normal[[j]], seen[j, sees, None] / weight[j] * normal[j]]
            start.append(start[-1] + 1 + sees.size)
        # The dual functions are negative in places: a mean may be so where the surfaces are apart. It counts as 0, as
        # contacts that begin with an overlap would add energy. Where the surfaces overlap, the depth is theirs.
        deepest = np.full(count, np.inf)
        np.minimum.at(deepest, nodes, np.einsum("pd,pd->p", between, first.normals[at.edge])[:, None])
        overlap = deepest[found] < -AT_AN_END * float(np.ptp(first.positions, axis=0).max())
        mean = np.einsum("jd,jd->j", apart, normal)[found] / weight[found]
        gap = np.where(overlap, deepest[found], np.maximum(mean, 0.0))
        return PairedPoints(
            gap, weight[found], normal[found], facets[found], np.array(start), np.concatenate(node),
            np.concatenate(value),
        )  # fmt: skip


class Quadrature(NamedTuple):
    """The quadrature points of the parts of a surface that another one covers."""

    edge: Integers  # of the first surface
    share: Floats  # (points, 2) shape functions of that edge
    other: Integers  # edge of the second surface
    other_share: Floats  # (points, 2) shape functions of that edge
    area: Floats  # of the first surface that belongs to the point


def _quadrature(first: Surface, second: Surface) -> Quadrature:
    """Return two Gauss points on each piece of an edge between neighbouring nodes of the surface that covers it."""
    edge, other, start, stop, ends = _pieces(first, second)
    place, weight = np.polynomial.legendre.leggauss(2)
    on_edge = (0.5 * (start + stop)[:, None] + 0.5 * (stop - start)[:, None] * place).ravel()
    edge, other, ends = (np.repeat(array, 2, axis=0) for array in (edge, other, ends))
    on_other = (on_edge - ends[:, 0]) / (ends[:, 1] - ends[:, 0])
    share, other_share = (np.stack([1.0 - along, along], axis=1) for along in (on_edge, on_other))
    area = first.spread(edge, share) * (0.5 * (stop - start)[:, None] * weight).ravel()
    return Quadrature(edge, share, other, other_share, area)


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
