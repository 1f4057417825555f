"""The contact points of surfaces of bodies that are no lines, as a pairing makes them."""

from __future__ import annotations

import math
from itertools import compress
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.specs import Plane
from percuss.case.type_words import found as words
from percuss.contact.contact_point import TOUCHING, ContactPoint
from percuss.mesh.loads import ROUND_OFF
from percuss.methods.interfaces import Surface, Wall
from percuss.methods.plugin_calls import answer

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from percuss.case.case import Case
    from percuss.case.specs import ContactSpec
    from percuss.errors import Problem
    from percuss.mesh.body import Body
    from percuss.mesh.loads import Held
    from percuss.mesh.surfaces import BodySurface
    from percuss.methods.interfaces import Floats, PairedPoints


ROUND_OFF_SHARE = 1e-12  # of the largest share of a node in a gap; a smaller one is round-off and left out


def points_of_surfaces(
    case: Case, number: int, spec: ContactSpec, bodies: Mapping[str, Body], held: Held
) -> Iterator[ContactPoint | Problem]:
    """Yield the contact points of two surfaces, or of a surface and a wall; or what is wrong with them."""
    path = ("contacts", spec.name)
    sides = [bodies[side.body] for side in spec.sides]
    if any(body.mesh.line is not None for body in sides):
        message = f"expected two bars or two other bodies, found {spec.sides[0]} and {spec.sides[1]}"
        yield case.problem(path, message, "Contact of a bar with another body is not built.")
        return
    surfaces = [body.surface(side.region) for body, side in zip(sides, spec.sides, strict=True)]
    first = surfaces[0].surface
    for side, surface in zip(spec.sides, surfaces, strict=True):
        if not surface.surface.areas.any():
            message = f"expected a surface with an area, found {side} on the axis of revolution"
            yield case.problem(path, message, "Nothing meets a body there.")
            return
    if isinstance(spec.wall, tuple) and _is_closed(first):
        advice = "Write `wall: {point: ..., normal: ...}`."
        message = f"expected a wall with a normal, as {spec.sides[0]} looks to all sides, found a point"
        yield case.problem((*path, "wall"), message, advice)
        return
    second = surfaces[1].surface if len(surfaces) > 1 else wall_of(spec, first)
    pairing: Any = spec.pairing
    if (dim := first.positions.shape[1]) not in pairing.dimensions:
        message = f"expected a pairing of surfaces in {dim} dimensions, found {pairing.name}"
        yield case.problem(path, message, "`percuss plugins` lists the others.")
        return
    found: PairedPoints = answer(pairing, "points", first, second)
    if not found.gap.size:
        yield case.problem(path, "expected surfaces that face each other, found no point of one that meets the other")
        return
    size = min(float(surface.heights.min()) for surface in surfaces)
    deepest = float(found.gap.min())
    if deepest < -TOUCHING * size:
        place = words(np.round(_place_of(found, int(found.gap.argmin()), first), 9).tolist())
        message = (
            f"expected bodies apart or touching, found an overlap of {-deepest:.6g} at {place} (by {pairing.name})"
        )
        yield case.problem(path, message, f"Move them apart by {-deepest:.12g}, or drop the contact.")
        return
    facets = surfaces[-1].surface.positions[surfaces[-1].surface.facets]
    facet_sizes = np.ptp(facets, axis=1).max(axis=1)[found.facets[:, len(surfaces) - 1]]
    for p in range(found.gap.size):
        gradient: dict[int, Floats] = {}
        for k in range(found.start[p], found.start[p + 1]):
            node = int(found.node[k])
            gradient[node] = gradient.get(node, 0.0) + found.value[k]
        # A share of round-off couples points that share no node, or not, as the units have it.
        shares = [max(map(abs, value.tolist())) for value in gradient.values()]
        least = ROUND_OFF_SHARE * max(shares, default=0.0)
        gradient = {node: value for (node, value), own in zip(gradient.items(), shares, strict=True) if own >= least}
        weight, gap = float(found.weight[p]), float(found.gap[p])
        yielding = [
            not held.along(one.surface.nodes[one.surface.facets[facet]], found.normal[p])
            for one, facet in zip(surfaces, found.facets[p], strict=False)
        ]
        which = yielding if any(yielding) else [True] * len(sides)
        stiffness, frequency, equal = _scales(*(list(compress(of, which)) for of in (sides, surfaces, found.facets[p])))
        yield ContactPoint(
            name=spec.name,
            contact=number,
            gradient=tuple(gradient.items()),
            normal=found.normal[p],
            at_wall=len(surfaces) == 1,
            gap=0.0 if gap <= TOUCHING * size else gap,
            law=spec.law,
            stiffness=stiffness * weight,
            frequency=frequency,
            mass=2.0 * stiffness * weight / frequency**2,
            equal_sides=equal,
            weight=weight,
            facet=float(facet_sizes[p]),
        )


def _place_of(found: PairedPoints, point: int, first: Surface) -> Floats:
    """Return where a contact point lies on the first surface, (dim,)."""
    entries = slice(found.start[point], found.start[point + 1])
    node, share = found.node[entries], -found.value[entries] @ found.normal[point]
    on_first = np.isin(node, first.nodes)
    place: Floats = share[on_first] @ first.positions[np.searchsorted(first.nodes, node[on_first])]
    return place


def walls_of(case: Case, bodies: Mapping[str, Body]) -> dict[str, Wall]:
    """Return the walls that bodies which are no lines meet, by their contacts."""
    sides = ((name, spec, spec.sides[0]) for name, spec in case.contacts.items() if spec.wall is not None)
    return {
        name: wall_of(spec, bodies[side.body].surface(side.region).surface)
        for name, spec, side in sides
        if bodies[side.body].mesh.line is None
    }


def wall_of(spec: ContactSpec, surface: Surface) -> Wall:
    """Return the plane wall that a surface meets: at a number along x, or through a point and across the surface."""
    if isinstance(spec.wall, Plane):
        normal = np.array(spec.wall.normal)
        return Wall(np.array(spec.wall.point), normal / np.linalg.norm(normal))
    place, out = np.atleast_1d(np.asarray(spec.wall, dtype=float)), surface.areas @ surface.normals
    if isinstance(spec.wall, tuple):
        return Wall(place, -out / np.linalg.norm(out))
    normal = np.zeros(surface.positions.shape[1])
    into = surface.positions[:, 0].mean() - place[0] if _is_closed(surface) else -out[0]
    normal[0] = math.copysign(1.0, into)
    return Wall(np.concatenate([place, np.zeros(normal.size - 1)]), normal)


def _is_closed(surface: Surface) -> bool:
    """Return whether a surface looks to all sides alike."""
    return bool(np.linalg.norm(surface.areas @ surface.normals) < ROUND_OFF * surface.areas.sum())


def _scales(
    bodies: Sequence[Body], surfaces: Sequence[BodySurface], facets: Sequence[int]
) -> tuple[float, float, bool]:
    """Return M/h_n of the softer side and the smaller 2c/h_n, and whether both sides are alike."""
    stiffness, frequency = [], []
    for body, surface, facet in zip(bodies, surfaces, facets, strict=False):
        modulus, height = body.modulus, float(surface.heights[facet])
        stiffness.append(modulus / height)
        frequency.append(2.0 * math.sqrt(modulus / body.spec.material.rho) / height)
    alike = all(np.ptp(values) <= ROUND_OFF * max(values) for values in (stiffness, frequency))
    return min(stiffness), min(frequency), bool(alike)
