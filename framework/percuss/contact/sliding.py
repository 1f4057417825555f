"""Contacts whose surfaces slide far: which they are, their points at the start, and what holds at every position."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.specs import RigidWall
from percuss.contact.limits import LARGEST_COURANT
from percuss.contact.walls import WallShape, points_at_wall
from percuss.methods.interfaces import PairedPoints, Places, RenewedPoints
from percuss.methods.plugin_calls import answer

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.case.specs import ContactSpec
    from percuss.contact.points import PointArrays
    from percuss.mesh.bodies import Bodies
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats, Surface

SHARP = 0.75  # cosine of the least turn of a corner, of 41 degrees
LEADS_AWAY = 0.1  # least sine of the angle at which a facet leads away


def slides(spec: ContactSpec) -> bool:
    """Return whether a step writes the rows of a contact anew, at the places of this step.

    At a plane wall at rest they stay as they are, however far a body slides; at other walls they are always written.
    """
    if spec.wall is None:
        return spec.sliding == "large"
    return isinstance(spec.wall, RigidWall) and not spec.wall.stays


def sliding(case: Case) -> dict[str, ContactSpec]:
    """Return the contacts of a case whose rows a step writes anew."""
    return {name: spec for name, spec in case.contacts.items() if slides(spec)}


def turning(case: Case) -> dict[str, ContactSpec]:
    """Return those of them whose rows change from step to step: at a plane that moves they do not."""
    known = sliding(case).items()
    return {name: spec for name, spec in known if not isinstance(spec.wall, RigidWall) or spec.wall.shape != "plane"}


def renews(spec: ContactSpec, dim: int) -> bool:
    """Return whether the pairing of a contact that slides writes its points anew in each step, with their areas."""
    return spec.wall is None and spec.pairing is not None and dim in spec.pairing.renews


def surfaces_of(spec: ContactSpec, bodies: Mapping[str, Body]) -> list[Surface]:
    """Return both surfaces of a contact of two bodies, or that of the body that meets a wall."""
    return [bodies[side.body].surface(side.region).surface for side in spec.sides]


def points_that_move(pairing: Any, first: Surface, second: Surface | WallShape) -> PairedPoints | None:
    """Return all points of a surface whose rows a step writes, as a pairing finds them; None if it does not slide.

    The entries of a point are those of its own nodes, and room for all that it may meet.
    """
    if isinstance(second, WallShape):
        places = answer(pairing, "places", first, second.plane)
        return points_at_wall(places, first, second) if places else None
    if places := answer(pairing, "places", first, second):
        return points_at_the_start(places, first, second)
    if first.positions.shape[1] in pairing.renews:
        return points_at_nodes(answer(pairing, "points", first, second), first, second)
    return None


def points_at_nodes(found: PairedPoints, first: Surface, second: Surface) -> PairedPoints:
    """Return the points at all nodes of a first surface, with their whole areas and with room for what they may meet.

    Those that were not `found` have the rows of the nearest place of the second surface.
    """
    facet, local = np.zeros((2, len(first.nodes)), dtype=np.int64)
    for k, nodes in enumerate(first.facets.T):  # any facet at a node serves
        facet[nodes], local[nodes] = np.arange(len(first.facets)), k
    area: Floats = np.bincount(first.facets.ravel(), first.of_nodes().ravel(), facet.size).astype(float)
    nearest = points_at_the_start(Places(facet, np.eye(first.facets.shape[1])[local], area), first, second)
    gap, normal, other = nearest.gap, nearest.normal, nearest.facets[:, 1]
    own, point = np.isin(found.node, first.nodes), np.repeat(np.arange(found.gap.size), np.diff(found.start))
    at = np.searchsorted(first.nodes, found.node[own])  # the node of each point that was found
    at, by, met, value = at[np.argsort(point[own])], point[~own], found.node[~own], found.value[~own]
    width = second.facets.shape[1]
    room = max(_room(first, second), int(np.bincount(by, minlength=1).max()), width)
    node, shares = np.tile(first.nodes[:, None], room + 1), np.zeros((facet.size, room + 1))
    node[:, : 1 + width] = nearest.node.reshape(facet.size, -1)
    shares[:, : 1 + width] = np.vecdot(nearest.value.reshape(facet.size, 1 + width, -1), normal[:, None])
    gap[at], normal[at], other[at] = found.gap, found.normal, found.facets[:, 1]
    node[at, 1:], shares[at, 1:] = first.nodes[at, None], 0.0
    order = np.argsort(by, kind="stable")
    place = np.arange(by.size) - np.searchsorted(by[order], by[order])
    node[at[by[order]], 1 + place] = met[order]
    shares[at[by[order]], 1 + place] = np.vecdot(value, found.normal[by])[order]
    return PairedPoints(
        gap, area, normal, np.stack([facet, other], axis=1), np.arange(facet.size + 1) * (room + 1), node.ravel(),
        (shares[..., None] * normal[:, None]).reshape(-1, normal.shape[1]),
    )  # fmt: skip


def late_corners(case: Case, bodies: Mapping[str, Body]) -> Iterator[str]:
    """Yield a note on each contact whose second surface comes with a corner that the first one may see late.

    Its points see means over facets, so that a corner closes as late as the middle of a facet lies behind it. At the
    end of a region the points see half a facet alone, and the corner in time.
    """
    for name, spec in sliding(case).items():
        first, *others = surfaces_of(spec, bodies)
        if renews(spec, first.positions.shape[1]) and (corner := _corner_that_points(first, *others)) is not None:
            at = ", ".join(f"{x:.6g}" for x in others[0].positions[corner])
            yield (
                f"the corner of {spec.sides[1]} at [{at}] points at {spec.sides[0]}, whose points see means over "
                f"facets: contact '{name}' may close late there, by a part of a facet. Name {spec.sides[1]} first"
            )


def normals_of_the_start(case: Case, bodies: Mapping[str, Body]) -> Iterator[str]:
    """Yield a note on each contact of bodies of finite strain whose points do not find what they meet in each step."""
    for name, spec in case.contacts.items():
        sides = [bodies[side.body] for side in spec.sides]
        finite = [body.name for body in sides if not (body.is_bar or body.of_small_strains)]
        if spec.sliding == "small" and spec.wall is None and finite:
            yield (
                f"contact '{name}' slides small: its normals and partners are those of the start, and '{finite[0]}' "
                "may turn and deform far"
            )


def _corner_that_points(first: Surface, second: Surface) -> int | None:
    """Return the node of a second surface nearest to a first one if its two edges turn and lead away from there."""
    facet, share = first.nearest(second.positions)
    out = first.outward(facet, share)
    there = np.einsum("pa,pad->pd", share, first.positions[first.facets[facet]])
    distance = np.vecdot(second.positions - there, out) / np.linalg.norm(out, axis=1)
    nearest = int(np.abs(distance).argmin())
    beside = np.flatnonzero((second.facets == nearest).any(axis=1))
    if beside.size < 2 or second.normals[beside[0]] @ second.normals[beside[1]] > SHARP:
        return None
    ends = second.facets[beside][second.facets[beside] != nearest]
    away = np.linalg.norm(second.positions[ends] - second.positions[nearest], axis=1)
    return nearest if (distance[ends] - distance[nearest] > LEADS_AWAY * away).all() else None


def half_size(surface: Surface) -> float:
    """Return half of the diagonal of the box around a surface."""
    return 0.5 * float(np.linalg.norm(np.ptp(surface.positions, axis=0)))


def renewed_points(first: Surface, room: int) -> RenewedPoints:
    """Return empty points at the nodes of a first surface, with room for so many nodes that each of them meets."""
    count, dim = first.positions.shape
    return RenewedPoints(
        gap=np.zeros(count), area=np.zeros(count), normal=np.zeros((count, dim)), meets=np.zeros(count, dtype=np.int64),
        node=np.zeros((count, room), dtype=np.int64), share=np.zeros((count, room)),
        of_facets=np.zeros((len(first.facets), 2 * room + 2, 6)), of_points=np.zeros((count, 3)),
    )  # fmt: skip


def _room(first: Surface, second: Surface) -> int:
    """Return how many nodes of a second surface a node may meet: twice what two of its largest facets have before them.

    That is where those of the second surface are as narrow as the narrowest one.
    """
    sizes = [np.linalg.norm(np.ptp(one.positions[one.facets], axis=1), axis=1) for one in (first, second)]
    ratio = float(sizes[0].max() / sizes[1].min())
    return min(len(second.nodes), 8 + math.ceil(4.0 * math.pow(ratio, first.positions.shape[1] - 1)))


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
    point, w at most. At the end of a line of nodes that is half of the area that is taken here. Where a pairing renews
    the points, the term of the second surface is its `mean_bound` times ``A_b / m_b``, for facets that are covered as a
    whole.
    """
    where = points.of_contact(name)
    first, *others = surfaces_of(case.contacts[name], bodies)
    of_point = where[points.point] & np.isin(points.node, first.nodes)
    share = np.abs(points.share[of_point]) * points.weight[points.point[of_point]]
    area = np.bincount(points.node[of_point], share, bodies.n_nodes)[first.nodes]
    mass = bodies.mass
    of_first = float((area / mass[first.nodes]).max())
    if not others:  # nothing moves a wall
        return of_first
    (second,) = others
    of_nodes = np.bincount(second.facets.ravel(), second.of_nodes().ravel(), len(second.nodes))
    widest = float(points.weight[where].max())
    spec: Any = case.contacts[name]
    renewed = renews(spec, first.positions.shape[1])
    of_second = spec.pairing.mean_bound * of_nodes if renewed else of_nodes + widest
    return of_first + float((of_second / mass[second.nodes]).max())


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
    stiffness of each contact adds at most, by the sums of the rows of S at every position. A longer step than the cells
    bear has the limit of nearly the longest one.
    """
    step = min(dt, LARGEST_COURANT * 2.0 / bodies.omega)
    total = sum((sums * points.weight)[points.contact == number].max() for number in np.unique(points.contact))
    limits: Floats = points.weight * ((4.0 / step**2 - bodies.omega**2) / total)
    return limits
