"""Dual mortar: contact points at nodes, each of which sees all of the other surface around it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from percuss import PairedPoints, Pairing, Wall
from percuss_methods.pairings._closest import AT_AN_END
from percuss_methods.pairings._covered import between, covered
from percuss_methods.pairings._edges_that_move import renew
from percuss_methods.pairings.node_to_segment import NodeToSegment

if TYPE_CHECKING:
    from percuss import Places, Surface

SHARP = 0.5**0.5  # cosine of the angle between the mean normal and that of a facet beyond which they make an edge


@dataclass(frozen=True)
class Mortar(Pairing):
    """The nodes of the first surface against means of the second one, by functions dual to those of the nodes.

    Formula: ``g_j = integral of psi_j m_j . (y - x) / D_j``, ``w_j = D_j = integral of phi_j`` over what the second
    surface covers of the facets at node j. The point y of the second surface is met by the normal of a facet at its
    point x; m_j is the normalised integral of phi_j times the normal into the second surface at y. On each facet
    ``psi = D M^-1 phi`` with ``M = integral of phi phi^T`` and ``D = diag(integral of phi)`` over its covered part, so
    that ``psi_j phi_k`` integrates to 0 for two nodes.

    A facet that is covered in part has a dual mean that goes on beyond that part. The gap at the start is therefore at
    least the smallest of ``m_j . (y - x)`` over the corners of the pieces that node j sees, and equal to it where one
    of the facets that it sees is turned by more than 45 degrees from m_j: a mean would pass over that edge.

    A uniform pressure between any two meshes is transmitted exactly: each facet is cut by those of the second surface
    as they project onto it. In three dimensions that holds for triangles and parallelograms; on other quadrilaterals
    the integrals have an error, below 1e-8 of the pressure where nodes are moved by a sixth of an edge along each axis.
    The nodes of the second surface may have negative shares in a gap. At a wall the points are nodes.

    In two dimensions surfaces may slide far: each step cuts the edges anew. Edges that are turned by more than 60
    degrees from facing each other then do not meet, and a gap is the mean, or the least one where that is larger. So a
    corner of the second surface, both sides of which are in it, closes late by a part of a facet of the first one.
    """

    name = "mortar"
    summary = "Dual mortar: nodes of the first surface against means of the second one"
    references = (
        "Popp, Gee, Wall: A finite deformation mortar contact formulation using a primal-dual active set strategy, "
        "Int. J. Numer. Methods Engrg. 79 (2009), doi 10.1002/nme.2614",
        "Cichosz, Bischoff: Consistent treatment of boundaries with mortar contact formulations using dual Lagrange "
        "multipliers, Comput. Methods Appl. Mech. Engrg. 200 (2011), doi 10.1016/j.cma.2010.11.004",
        "Puso, Laursen: A mortar segment-to-segment contact method for large deformation solid mechanics, "
        "Comput. Methods Appl. Mech. Engrg. 193 (2004), doi 10.1016/j.cma.2003.10.010",
        "Popp, Gitterle, Gee, Wall: A dual mortar approach for 3D finite deformation contact with consistent "
        "linearization, Int. J. Numer. Methods Engrg. 83 (2010), doi 10.1002/nme.2866",
    )
    passes_patch_test = True
    convex = False
    renews = (2,)
    # The points see an L2 projection q of the motion, which is linear on each edge: the sum of D_j q_j^2 of an edge is
    # at most three times the integral of q^2, and this one at most that of the motion.
    mean_bound = 3.0
    renew = staticmethod(renew)

    def places(self, first: Surface, second: Surface | Wall) -> Places | None:
        """Return the nodes at a wall; points that meet a surface keep no places."""
        return NodeToSegment().places(first, second) if isinstance(second, Wall) else None

    def points(self, first: Surface, second: Surface | Wall) -> PairedPoints:
        """Return the nodes of the first surface of which the second one covers a part."""
        if isinstance(second, Wall):
            return NodeToSegment().points(first, second)
        at = covered(first, second)
        count, (facets, width), dim = len(first.nodes), first.facets.shape, first.positions.shape[1]
        of_facet, matrix = np.zeros((facets, width)), np.zeros((facets, width, width))
        np.add.at(of_facet, at.facet, at.area[:, None] * at.share)
        np.add.at(matrix, at.facet, at.area[:, None, None] * at.basis[:, :, None] * at.basis[:, None])
        inverse = at.at_nodes[at.facet] @ np.linalg.solve(matrix[at.facet], at.basis[..., None])
        dual = at.area[:, None] * of_facet[at.facet] * inverse[..., 0]
        nodes, others = first.facets[at.facet], second.facets[at.other]
        vectors = between(first, at.facet, second, at.other, at.share, at.other_share)
        into = second.outward(at.other, at.other_share)
        into /= -np.linalg.norm(into, axis=1)[:, None]
        weight, apart, normal = np.zeros(count), np.zeros((count, dim)), np.zeros((count, dim))
        np.add.at(weight, first.facets, of_facet)
        np.add.at(apart, nodes, dual[..., None] * vectors[:, None])
        np.add.at(normal, nodes, (at.area[:, None] * at.share)[..., None] * into[:, None])
        found = np.flatnonzero(weight > 0.0)
        normal[found] /= np.linalg.norm(normal[found], axis=1)[:, None]
        sharp = np.zeros(count, dtype=bool)
        sharp[nodes[np.einsum("pad,pd->pa", normal[nodes], into) < SHARP]] = True
        facets_seen = np.zeros((count, 2), dtype=np.int64)
        facets_seen[nodes] = np.stack([at.facet, at.other], axis=1)[:, None]  # any two that a node sees serve
        pairs, number = np.unique(nodes[:, :, None] * len(second.nodes) + others[:, None], return_inverse=True)
        seen = np.bincount(number.ravel(), (dual[:, :, None] * at.other_share[:, None]).ravel(), pairs.size)
        by, other = np.divmod(pairs[seen != 0.0], len(second.nodes))
        value = np.concatenate([-normal[found], (seen[seen != 0.0] / weight[by])[:, None] * normal[by]])
        point = np.concatenate([found, by])
        order = np.argsort(point, kind="stable")
        start = np.searchsorted(point[order], [*found, count])
        node = np.concatenate([first.nodes[found], second.nodes[other]])[order]
        at_corners, least = first.facets[at.cornered], np.full(count, np.inf)
        np.minimum.at(least, at_corners, np.einsum("cad,cd->ca", normal[at_corners], at.apart))
        # Where the surfaces overlap, which a case is refused for, the depth is theirs.
        overlap = least[found] < -AT_AN_END * float(np.ptp(first.positions, axis=0).max())
        mean = np.einsum("jd,jd->j", apart, normal)[found] / weight[found]
        gap = np.where(overlap | sharp[found], least[found], np.maximum(mean, least[found]))
        return PairedPoints(gap, weight[found], normal[found], facets_seen[found], start, node, value[order])
