"""The contact points of a case: where ends of bars meet, and surfaces as a pairing finds them.

A bar end meets one other end, or a wall, at one point. Surfaces of solids meet at the points that their pairing makes.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from percuss.case.specs import RigidWall
from percuss.case.type_words import found
from percuss.contact.points import TOUCHING, PointArrays, added_up, joined, no_points
from percuss.contact.sliding import points_that_move, slides
from percuss.contact.walls import WallShape, plane_of, shape_of, wrong_with
from percuss.errors import Problem
from percuss.mesh.loads import ROUND_OFF
from percuss.methods.interfaces import PairedPoints
from percuss.methods.plugin_calls import answer

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from percuss.case.case import Case
    from percuss.case.specs import ContactSpec
    from percuss.mesh.body import Body
    from percuss.mesh.loads import Held
    from percuss.mesh.surfaces import BodySurface
    from percuss.methods.interfaces import Floats, Integers, Surface

ROUND_OFF_SHARE = 1e-12  # of the largest share of a node in a gap; a smaller one is round-off and left out


def points_of(case: Case, bodies: Mapping[str, Body], held: Held, problems: list[Problem]) -> PointArrays:
    """Return the contact points of a case, without those of contacts whose geometry is wrong, told in `problems`.

    A side whose nodes are `held` throughout is rigid: stiffness, mass and frequency are those of the other.
    """
    parts = [no_points(case.dimension)]
    for number, spec in enumerate(case.contacts.values()):
        sides = [bodies[side.body] for side in spec.sides]
        if spec.sliding == "large" and any(body.is_bar for body in sides):
            message, advice = "expected solids that slide, found bars, which meet along one line", "Drop `sliding`."
            problems.append(case.problem(("contacts", spec.name, "sliding"), message, advice))
            continue
        if spec.wall is not None and slides(spec) and (problem := wrong_with(case, spec, sides[0])) is not None:
            problems.append(problem)
            continue
        meet = _ends_that_meet if all(body.is_bar for body in sides) else _surfaces_that_meet
        paired = meet(case, spec, sides)
        if isinstance(paired, PairedPoints):
            parts.append(_points_of(number, spec, sides, paired, held))
        else:
            problems.append(paired)
    return joined(parts)


def _points_of(number: int, spec: ContactSpec, sides: Sequence[Body], paired: PairedPoints, held: Held) -> PointArrays:
    """Return the paired points of a contact as arrays, with the properties of the sides that yield."""
    surfaces, points = _surfaces_of(spec, sides), paired.gap.size
    yields = np.stack(
        [
            ~held.along(one.surface.nodes[one.surface.facets[facets]], paired.normal)
            for one, facets in zip(surfaces, paired.facets.T, strict=False)
        ]
    )
    yields |= ~yields.any(axis=0)
    behind = [_behind(*side) for side in zip(sides, surfaces, paired.facets.T, strict=False)]
    stiffness, frequency = np.swapaxes(behind, 0, 1)
    (softest, soft), (slowest, slow) = (_smallest(values, yields) for values in (stiffness, frequency))
    # rho A h / 2 = 2 (EA/h) / omega^2; of two sides of the same stiffness that of the lighter one
    mass, _ = _smallest(2.0 * stiffness * paired.weight / frequency**2, yields & soft)
    count, node, value = _entries(paired)
    if moves := slides(spec):  # which needs all of its entries
        count, node, value = np.diff(paired.start), paired.node, paired.value
    met = surfaces[-1].surface
    return PointArrays(
        names=(spec.name,) * points,
        laws=(spec.law,) * points,
        contact=np.full(points, number),
        count=count,
        node=node,
        value=value,
        normal=paired.normal,
        at_wall=np.full(points, len(surfaces) == 1),
        gap=np.where(paired.gap <= TOUCHING * _height(surfaces), 0.0, paired.gap),
        stiffness=softest * paired.weight,
        frequency=slowest,
        mass=mass,
        equal_sides=(soft & slow | ~yields).all(axis=0),
        weight=paired.weight,
        facet=np.ptp(met.positions[met.facets], axis=1).max(axis=1)[paired.facets[:, len(surfaces) - 1]],
        slides=np.full(points, moves),
    )


def _surfaces_of(spec: ContactSpec, sides: Sequence[Body]) -> list[BodySurface]:
    return [body.surface(side.region) for body, side in zip(sides, spec.sides, strict=True)]


def _height(surfaces: Sequence[BodySurface]) -> float:
    """Return the height of the lowest cell behind surfaces."""
    return min(float(surface.heights.min()) for surface in surfaces)


def _behind(body: Body, surface: BodySurface, facets: Integers) -> tuple[Floats, Floats]:
    """Return EA/h, that of an area of 1 of a solid, and 2c/h of the cells behind facets, one for each facet."""
    if body.is_bar:
        (node,) = surface.surface.nodes.tolist()
        return np.array([body.end_stiffness(node)]), body.frequency[[body.end_element(node)]]
    heights = surface.heights[facets]
    return body.modulus / heights, 2.0 * math.sqrt(body.modulus / body.spec.material.rho) / heights


def _smallest(values: Floats, yields: Any) -> tuple[Floats, Any]:
    """Return the smallest value of the sides of each point that yield, (P,), and which sides have it, (sides, P)."""
    smallest: Floats = np.where(yields, values, np.inf).min(axis=0)
    return smallest, values <= smallest * (1.0 + ROUND_OFF)


def _entries(paired: PairedPoints) -> tuple[Integers, Integers, Floats]:
    """Return the number of nodes of each point, and node and value of each, one entry a node of a point."""
    points = paired.gap.size
    point = np.repeat(np.arange(points), np.diff(paired.start))
    nodes = int(paired.node.max(initial=0)) + 1
    key, value = added_up(point * nodes + paired.node, paired.value)
    point, node = np.divmod(key, nodes)
    # A share of round-off couples points that share no node, or not, as the units have it.
    size, largest = np.abs(value).max(axis=1), np.zeros(points)
    np.maximum.at(largest, point, size)
    kept = size >= ROUND_OFF_SHARE * largest[point]
    return np.bincount(point[kept], minlength=points), node[kept], value[kept]


# ------------------------------------------------------------------------------------------------------- ends of bars


def _ends_that_meet(case: Case, spec: ContactSpec, sides: Sequence[Body]) -> PairedPoints | Problem:
    """Return the point at which two ends meet, or an end and a wall; or why they cannot."""
    path = ("contacts", spec.name)
    normal = sides[0].mesh.regions[spec.sides[0].region].outward
    nodes = [body.node(side.region) for body, side in zip(sides, spec.sides, strict=True)]
    positions = [body.mesh.nodes[node - body.start] for body, node in zip(sides, nodes, strict=True)]
    if len(nodes) == 1:
        if isinstance(spec.wall, RigidWall) and float(normal @ shape_of(spec.wall).axis) > -1.0 + 1e-9:
            message = f"expected a wall across the bar, found one of the normal {found(spec.wall.normal)}"
            advice = f"Write `normal: {found(tuple((-normal).tolist()))}`."
            return case.problem((*path, "wall", "normal"), message, advice)
        gap = _wall_gap(spec, positions[0], normal, sides[0].mesh.direction)
    else:
        opposite = sides[1].mesh.regions[spec.sides[1].region].outward
        if float(normal @ opposite) > -1.0 + 1e-9:
            angle = math.degrees(math.acos(max(-1.0, min(1.0, -float(normal @ opposite)))))
            message = (
                f"expected two ends that face each other, found {spec.sides[0]} and {spec.sides[1]} "
                f"turned by {angle:.6g} degrees"
            )
            advice = "Contact is between bars along one line: a right end meets a left end."
            return case.problem((*path, "between"), message, advice)
        gap = float(normal @ (positions[1] - positions[0]))
        offset = float(np.linalg.norm(positions[1] - positions[0] - gap * normal))
        if offset > 1e-6 * min(float(body.mesh.lengths.sum()) for body in sides):
            message = f"expected two ends on one line, found {spec.sides[1]} {offset:.6g} beside {spec.sides[0].body}"
            advice = "Move one of the bodies (`at`) or turn it (`direction`)."
            return case.problem((*path, "between"), message, advice)
    if gap < -TOUCHING * _height(_surfaces_of(spec, sides)):
        advice = f"Move them apart by {-gap:.12g}, or drop the contact."
        facing = _facing_ends(sides, spec)
        message = f"expected bodies apart or touching, found an overlap of {-gap:.6g}"
        return case.problem(path, message, f"Did you mean the ends [{', '.join(facing)}]?" if facing else advice)
    return PairedPoints(
        gap=np.array([gap]),
        weight=np.ones(1),
        normal=normal[None],
        facets=np.zeros((1, 2), dtype=np.int64),
        start=np.array([0, len(nodes)]),
        node=np.array(nodes),
        value=np.array([-normal, normal])[: len(nodes)],
    )


def _facing_ends(sides: Sequence[Body], spec: ContactSpec) -> list[str]:
    """Return the other ends of two bars that overlap, if these are apart or touch, else nothing."""
    ends = [
        (f"{side.body}.{name}", body.mesh.nodes[region.nodes[0]], region.outward)
        for body, side in zip(sides, spec.sides, strict=True)
        for name, region in body.mesh.regions.items()
        if name != side.region
    ]
    if len(ends) != 2:
        return []
    (first, start, outward), (second, end, _) = ends
    return [first, second] if float(outward @ (end - start)) >= -TOUCHING * float(np.abs(end).max()) else []


def _wall_gap(spec: ContactSpec, position: Floats, normal: Floats, direction: Floats) -> float:
    wall = np.asarray(spec.wall.point if isinstance(spec.wall, RigidWall) else spec.wall, dtype=float)
    if wall.ndim == 1:
        return float(normal @ (wall - position))
    # A wall given as a number is a coordinate along the bar; for a bar on the x axis it is x, whichever way the bar
    # points.
    axis = np.abs(direction) if abs(direction[0]) == 1.0 else direction
    return float((wall - position @ axis) * (axis @ normal))


# ----------------------------------------------------------------------------------------------- surfaces of solids


def _surfaces_that_meet(case: Case, spec: ContactSpec, sides: Sequence[Body]) -> PairedPoints | Problem:
    """Return the contact points of two surfaces, or of a surface and a wall; or what is wrong with them."""
    path = ("contacts", spec.name)
    if any(body.is_bar for body in sides):
        message = f"expected two bars or two other bodies, found {spec.sides[0]} and {spec.sides[1]}"
        return case.problem(path, message, "Contact of a bar with another body is not built.")
    surfaces = _surfaces_of(spec, sides)
    first, pairing = surfaces[0].surface, cast("Any", spec.pairing)
    if (problem := _why_not_paired(case, spec, surfaces)) is not None:
        return problem
    second = surfaces[1].surface if len(surfaces) > 1 else wall_of(spec, first)
    moving = points_that_move(pairing, first, second) if slides(spec) else None
    if slides(spec) and moving is None:
        message = f"expected a pairing that slides in {case.dimension} dimensions, found {pairing.name}"
        at, advice = ("sliding", "It slides small. ") if spec.wall is None else ("wall", "")
        return case.problem((*path, at), message, f"{advice}Take node-to-segment or gauss-points.")
    if not isinstance(second, WallShape):
        paired: PairedPoints = answer(pairing, "points", first, second)
    else:
        paired = moving or answer(pairing, "points", first, second.plane)
    if not (paired.gap.size or moving):
        return case.problem(path, "expected surfaces that face each other, found no point of one that meets the other")
    deepest = float(paired.gap.min(initial=0.0))
    if spec.overlap == "refuse" and deepest < -TOUCHING * _height(surfaces):
        place = found(np.round(_place_of(paired, int(paired.gap.argmin()), first), 9).tolist())
        message = (
            f"expected bodies apart or touching, found an overlap of {-deepest:.6g} at {place} (by {pairing.name})"
        )
        other = "add `overlap: keep`" if slides(spec) else "drop the contact"
        return case.problem(path, message, f"Move them apart by {-deepest:.12g}, or {other}.")
    return moving or paired


def _why_not_paired(case: Case, spec: ContactSpec, surfaces: Sequence[BodySurface]) -> Problem | None:
    """Return why the pairing of a contact cannot be asked for its points, None if it can."""
    path, first, pairing = ("contacts", spec.name), surfaces[0].surface, spec.pairing
    for side, surface in zip(spec.sides, surfaces, strict=True):
        if not surface.surface.areas.any():
            message = f"expected a surface with an area, found {side} on the axis of revolution"
            return case.problem(path, message, "Nothing meets a body there.")
    if isinstance(spec.wall, tuple) and _is_closed(first):
        advice = "Write `wall: {point: ..., normal: ...}`."
        message = f"expected a wall with a normal, as {spec.sides[0]} looks to all sides, found a point"
        return case.problem((*path, "wall"), message, advice)
    if pairing is not None and (dim := first.positions.shape[1]) not in pairing.dimensions:
        message = f"expected a pairing of surfaces in {dim} dimensions, found {pairing.name}"
        return case.problem(path, message, "`percuss plugins` lists the others.")
    return None


def unlike_sides(case: Case, bodies: Mapping[str, Body]) -> list[str]:
    """Return a note on each contact of two plane bodies that differ in thickness or plane."""
    notes = []
    for name, spec in case.contacts.items():
        sides = [bodies[side.body] for side in spec.sides]
        planes = [body.view.plane for body in sides]
        if len(sides) < 2 or not {"strain", "stress"}.issuperset(planes):
            continue
        sections = [f"{body.spec.section:.6g}" for body in sides]
        for what, (one, other), why in (
            ("thickness", sections, "its area is that of the first, and no body in the plane has an edge across it"),
            ("plane", planes, "one widens across the plane and the other does not"),
        ):
            if one != other:
                pair = f"{one} of '{sides[0].name}' and {other} of '{sides[1].name}'"
                notes.append(f"contact '{name}' is between bodies of unequal {what}, {pair}: {why}")
    return notes


def _place_of(paired: PairedPoints, point: int, first: Surface) -> Floats:
    """Return where a contact point lies on the first surface, (dim,)."""
    entries = slice(paired.start[point], paired.start[point + 1])
    node, share = paired.node[entries], -paired.value[entries] @ paired.normal[point]
    on_first = np.isin(node, first.nodes)
    place: Floats = share[on_first] @ first.positions[np.searchsorted(first.nodes, node[on_first])]
    return place


def walls_of(case: Case, bodies: Mapping[str, Body]) -> dict[str, WallShape]:
    """Return the walls that bodies which are no lines meet, by their contacts."""
    sides = ((name, spec, spec.sides[0]) for name, spec in case.contacts.items() if spec.wall is not None)
    return {
        name: wall_of(spec, bodies[side.body].surface(side.region).surface)
        for name, spec, side in sides
        if not bodies[side.body].is_bar
    }


def wall_of(spec: ContactSpec, surface: Surface) -> WallShape:
    """Return the wall that a surface meets: by its geometry, or a plane at a number along x or across the surface."""
    if isinstance(spec.wall, RigidWall):
        return shape_of(spec.wall)
    place, out = np.atleast_1d(np.asarray(spec.wall, dtype=float)), surface.areas @ surface.normals
    if isinstance(spec.wall, tuple):
        return plane_of(place, -out)
    normal = np.zeros(surface.positions.shape[1])
    into = surface.positions[:, 0].mean() - place[0] if _is_closed(surface) else -out[0]
    normal[0] = math.copysign(1.0, into)
    return plane_of(np.concatenate([place, np.zeros(normal.size - 1)]), normal)


def _is_closed(surface: Surface) -> bool:
    """Return whether a surface looks to all sides alike."""
    return bool(np.linalg.norm(surface.areas @ surface.normals) < ROUND_OFF * surface.areas.sum())
