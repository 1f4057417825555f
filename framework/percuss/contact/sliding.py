"""Contacts whose surfaces slide far: which they are, their points at the start, and what holds at every position."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from percuss.methods.interfaces import PairedPoints

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.case.specs import ContactSpec
    from percuss.contact.points import PointArrays
    from percuss.mesh.bodies import Bodies
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats, Places, Surface


def slides(spec: ContactSpec) -> bool:
    """Return whether the rows of a contact move. At a plane wall they stay as they are, however far a body slides."""
    return spec.sliding == "large" and spec.wall is None


def sliding(case: Case) -> dict[str, ContactSpec]:
    """Return the contacts of a case whose rows move."""
    return {name: spec for name, spec in case.contacts.items() if slides(spec)}


def surfaces_of(spec: ContactSpec, bodies: Mapping[str, Body]) -> tuple[Surface, Surface]:
    """Return both surfaces of a contact of two bodies."""
    first, second = (bodies[side.body].surface(side.region).surface for side in spec.sides)
    return first, second


def points_at_the_start(places: Places, first: Surface, second: Surface) -> PairedPoints:
    """Return all points of a surface that slides against the facets that are nearest at the start.

    Each has entries for its own nodes and for all nodes of a facet, which a step writes anew.
    """
    own = first.facets[places.facets]
    at = np.einsum("pa,pad->pd", places.shares, first.positions[own])
    facet, share = second.nearest(at)
    out = second.outward(facet, share)
    out /= np.linalg.norm(out, axis=1)[:, None]
    met = np.einsum("pa,pad->pd", share, second.positions[second.facets[facet]])
    value = np.concatenate([places.shares, -share], axis=1)[..., None] * out[:, None]
    node = np.concatenate([first.nodes[own], second.nodes[second.facets[facet]]], axis=1)
    kept = np.concatenate([places.shares != 0.0, np.ones(share.shape, dtype=bool)], axis=1)
    start = np.concatenate([[0], np.cumsum(kept.sum(axis=1))])
    gap = np.einsum("pd,pd->p", at - met, out)
    return PairedPoints(
        gap, places.weight, -out, np.stack([places.facets, facet], axis=1), start, node[kept], value[kept]
    )


def largest_response(case: Case, bodies: Bodies, points: PointArrays, name: str) -> float:
    """Return a bound of the largest eigenvalue of S W of a contact at every position [1/mass].

    W has the areas of its points.

    With convex shares it is ``max A_a / m_a + max (A_b + w) / m_b`` over the nodes a of the first surface and b of the
    second one, of areas A and masses m: the areas of points near a node add up to its own area, but for that of one
    point, w at most. At the end of a line of nodes that is half of the area that is taken here.
    """
    where = points.of_contact(name)
    first, second = surfaces_of(case.contacts[name], bodies)
    of_point = where[points.point] & np.isin(points.node, first.nodes)
    share = np.abs(points.share[of_point]) * points.weight[points.point[of_point]]
    area = np.bincount(points.node[of_point], share, bodies.n_nodes)[first.nodes]
    of_nodes = np.bincount(second.facets.ravel(), second.of_nodes().ravel(), len(second.nodes))
    mass = bodies.mass
    widest = float(points.weight[where].max())
    return float((area / mass[first.nodes]).max() + ((of_nodes + widest) / mass[second.nodes]).max())


def at_every_position(case: Case, bodies: Bodies, points: PointArrays, sums: Floats) -> Floats:
    """Return the sums of the rows of S, (P,), those of points that slide as the bound at every position has them."""
    found = sums.copy()
    for name in sliding(case):
        where = points.of_contact(name)
        bound = largest_response(case, bodies, points, name) / points.weight[where]
        found[where] = np.maximum(bound, sums[where])
    return found


def limits_at_every_position(bodies: Bodies, points: PointArrays, sums: Floats, dt: float) -> Floats:
    """Return the stiffness of each point for which central difference is stable at every position, (P,) [force/length].

    It is that of ``omega^2 + b <= 4 / dt^2``, omega the highest frequency of the cells and b the sum of what the
    stiffness of each contact adds at most, by the sums of the rows of S at every position.
    """
    total = sum((sums * points.weight)[points.contact == number].max() for number in np.unique(points.contact))
    limits: Floats = points.weight * (max(4.0 / dt**2 - bodies.omega**2, 0.0) / total)
    return limits
