"""The contact points of a model; of bars one for each contact: two ends that face each other, or an end and a wall."""

from __future__ import annotations

import math
from itertools import compress
from typing import TYPE_CHECKING

import numpy as np

from percuss.case.specs import Plane
from percuss.case.type_words import found
from percuss.contact.contact_point import TOUCHING, ContactPoint
from percuss.contact.paired_surfaces import points_of_surfaces
from percuss.mesh.loads import ROUND_OFF

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from percuss.case.case import Case
    from percuss.case.specs import ContactSpec
    from percuss.errors import Problem
    from percuss.mesh.body import Body
    from percuss.mesh.loads import Held
    from percuss.methods.interfaces import Floats


def contact_points_of(
    case: Case, number: int, spec: ContactSpec, bodies: Mapping[str, Body], held: Held, problems: list[Problem]
) -> list[ContactPoint]:
    """Return the points of contact `number` of a case; none if its geometry is wrong, with the reason in `problems`.

    A side whose nodes are `held` throughout is rigid: stiffness, mass and frequency are those of the other.
    """
    sides = [bodies.get(side.body) for side in spec.sides]
    bars = [body for body in sides if body is not None and body.is_bar]
    if len(bars) == len(sides):
        point = _ends_that_meet(case, number, spec, bars, held, problems)
        return [point] if point is not None else []
    points = []
    for made in points_of_surfaces(case, number, spec, bodies, held):
        if isinstance(made, ContactPoint):
            points.append(made)
        else:
            problems.append(made)
    return points


def _ends_that_meet(
    case: Case, number: int, spec: ContactSpec, sides: Sequence[Body], held: Held, problems: list[Problem]
) -> ContactPoint | None:
    """Return the point at which two ends meet, or an end and a wall; None if they cannot, with a problem."""
    path = ("contacts", spec.name)

    def add_problem(at: tuple[str, ...], message: str, advice: str) -> None:
        problems.append(case.problem(at, message, advice))

    normal = sides[0].mesh.regions[spec.sides[0].region].outward
    nodes = tuple(body.node(side.region) for body, side in zip(sides, spec.sides, strict=True))
    positions = [body.mesh.nodes[node - body.start] for body, node in zip(sides, nodes, strict=True)]
    position = positions[0]
    if len(nodes) == 1:
        if isinstance(spec.wall, Plane):
            out = np.array(spec.wall.normal) / np.linalg.norm(spec.wall.normal)
            if float(normal @ out) > -1.0 + 1e-9:
                message = f"expected a wall across the bar, found one of the normal {found(spec.wall.normal)}"
                add_problem((*path, "wall", "normal"), message, f"Write `normal: {found(tuple((-normal).tolist()))}`.")
                return None
        gap = _wall_gap(spec, position, normal, sides[0].mesh.direction)
    else:
        opposite = sides[1].mesh.regions[spec.sides[1].region].outward
        if float(normal @ opposite) > -1.0 + 1e-9:
            angle = math.degrees(math.acos(max(-1.0, min(1.0, -float(normal @ opposite)))))
            add_problem(
                (*path, "between"),
                f"expected two ends that face each other, found {spec.sides[0]} and {spec.sides[1]} "
                f"turned by {angle:.6g} degrees",
                "Contact is between bars along one line: a right end meets a left end.",
            )
            return None
        gap = float(normal @ (positions[1] - position))
        offset = float(np.linalg.norm(positions[1] - position - gap * normal))
        if offset > 1e-6 * min(float(body.mesh.lengths.sum()) for body in sides):
            add_problem(
                (*path, "between"),
                f"expected two ends on one line, found {spec.sides[1]} {offset:.6g} beside {spec.sides[0].body}",
                "Move one of the bodies (`at`) or turn it (`direction`).",
            )
            return None
    elements = [body.end_element(node) for body, node in zip(sides, nodes, strict=True)]
    size = min(float(body.mesh.lengths[element]) for body, element in zip(sides, elements, strict=True))
    if gap < -TOUCHING * size:
        advice = f"Move them apart by {-gap:.12g}, or drop the contact."
        facing = _facing_ends(sides, spec)
        message = f"expected bodies apart or touching, found an overlap of {-gap:.6g}"
        add_problem(path, message, f"Did you mean the ends [{', '.join(facing)}]?" if facing else advice)
        return None
    yielding = [not held.along([node], normal) for node in nodes]
    yielding = yielding if any(yielding) else [True] * len(sides)
    stiffness = [body.end_stiffness(node) for body, node in compress(zip(sides, nodes, strict=True), yielding)]
    frequency = [float(body.frequency[end]) for body, end in compress(zip(sides, elements, strict=True), yielding)]
    softest = min(stiffness)
    alike = [k for k, value in enumerate(stiffness) if value <= softest * (1.0 + ROUND_OFF)]
    return ContactPoint(
        name=spec.name,
        contact=number,
        gradient=tuple((node, sign * normal) for node, sign in zip(nodes, (-1.0, 1.0), strict=False)),
        normal=normal,
        at_wall=len(nodes) == 1,
        gap=0.0 if gap <= TOUCHING * size else gap,
        law=spec.law,
        stiffness=softest,
        frequency=min(frequency),
        # rho A h / 2 = 2 (EA/h) / omega^2; of two sides of the same stiffness that of the lighter one
        mass=min(2.0 * stiffness[k] / frequency[k] ** 2 for k in alike),
        equal_sides=len(alike) == len(stiffness) and bool(np.ptp(frequency) <= ROUND_OFF * max(frequency)),
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
    wall = np.asarray(spec.wall.point if isinstance(spec.wall, Plane) else spec.wall, dtype=float)
    if wall.ndim == 1:
        return float(normal @ (wall - position))
    # A wall given as a number is a coordinate along the bar; for a bar on the x axis it is x, whichever way the bar
    # points.
    axis = np.abs(direction) if abs(direction[0]) == 1.0 else direction
    return float((wall - position @ axis) * (axis @ normal))
