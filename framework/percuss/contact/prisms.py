"""Prisms that move along their axis alone: bars in all but their cells, whose contact problem is that of bars.

A body is one if its boundary is two equal plane faces across the axis and sides along it, and if nothing moves across:
the material does not contract, or rollers hold the sides. Its modulus is that of a strain along the axis alone.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.methods.blame import plain_function
from percuss.methods.interfaces import BodyEnd, ContactProblem, ProblemBody, ProblemContact, ProblemLoad
from percuss.methods.plugin_calls import answer, read_only

if TYPE_CHECKING:
    from collections.abc import Iterator

    from percuss.contact.model_arrays import ModelArrays
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats

ROUND_OFF = 1e-9  # relative, of directions, lengths, areas and stresses
STRAIN = 1e-6  # of a material that is not linear


class NotARowOfPrisms(Exception):
    """Why a case is no row of prisms along one axis."""


class Prism(NamedTuple):
    """A body as a bar."""

    start: float  # place of its start along the axis
    length: float
    area: float
    modulus: float
    ends: dict[str, bool]  # regions that are its faces across the axis, and whether each is at the start
    across: Floats  # (2, dim) least and largest coordinates of its faces, those along the axis set to 0


def prism_problem(model: ModelArrays) -> ContactProblem | str:
    """Return the contact problem of a case as that of bars, or why it is none."""
    try:
        axis = _axis(model)
        prisms = {body.name: _prism(body, axis) for body in model.bodies.values()}
        return ContactProblem(
            bodies=MappingProxyType(
                {
                    body.name: ProblemBody(
                        name=body.name,
                        shape=body.spec.shape,
                        material=body.spec.material,
                        area=prisms[body.name].area,
                        length=prisms[body.name].length,
                        direction=read_only(axis),
                        velocity=read_only(body.velocity),
                        modulus=prisms[body.name].modulus,
                    )
                    for body in model.bodies.values()
                }
            ),
            contacts=tuple(_contacts(model, prisms, axis)),
            fixed=tuple(_fixed(model, prisms, axis)),
            loads=tuple(_loads(model, prisms, axis)),
        )
    except NotARowOfPrisms as reason:
        return str(reason)


def _axis(model: ModelArrays) -> Floats:
    """Return the direction in which the case moves: of its contacts, its velocities or its loads."""
    normals = [point.normal for point in model.contact_points]
    velocities = [body.velocity for body in model.bodies.values() if body.velocity.any()]
    forces = [force.force for force in model.loads.on_nodes] + [force.acceleration for force in model.loads.body_forces]
    drives = [constraint.direction for constraint in model.loads.constraints if constraint.load is not None]
    for name, vectors in (("contact", normals), ("velocity", velocities), ("load", [*forces, *drives])):
        for vector in vectors:
            axis: Floats = vector / np.linalg.norm(vector)
            if any(_across(other, axis) > ROUND_OFF * np.linalg.norm(other) for other in vectors):
                raise NotARowOfPrisms(f"the case has a {name} along more than one line")
            return -axis if axis[np.argmax(np.abs(axis))] < 0.0 else axis
    raise NotARowOfPrisms("nothing moves")


def _across(vector: Floats, axis: Floats) -> float:
    """Return the length of the part of a vector across an axis."""
    return float(np.linalg.norm(vector - (vector @ axis) * axis))


def _prism(body: Body, axis: Floats) -> Prism:
    """Return a body as a prism along an axis."""
    place = body.mesh.nodes @ axis
    start, length = float(place.min()), float(np.ptp(place))
    ends, sides, faces, boundary = {}, [], [], []
    for region in body.mesh.regions:
        surface = body.surface(region).surface
        along = np.round(surface.normals @ axis)  # -1 and 1 of the faces at the start and at the end, 0 of a side
        if np.abs(surface.normals @ axis - along).max() > ROUND_OFF:
            raise NotARowOfPrisms(f"'{body.name}.{region}' is neither across the axis nor along it")
        corners = surface.positions[surface.facets]
        apart = corners @ axis - start - np.where(along > 0.0, length, 0.0)[:, None]
        if np.abs(apart[along != 0.0]).max(initial=0.0) > ROUND_OFF * length:
            raise NotARowOfPrisms(f"'{body.name}.{region}' is not at an end of its body")
        if (along == 0.0).all():
            sides.append(region)
        elif np.ptp(along) == 0.0:
            ends[region] = bool(along[0] < 0.0)
        face = corners[along != 0.0].reshape(-1, axis.size)
        faces.append(face - np.outer(face @ axis, axis))
        boundary.append((np.sort(surface.nodes[surface.facets], axis=1), along, surface.areas))
    facets, looks, areas = map(np.concatenate, zip(*boundary, strict=True))
    first = np.unique(facets, axis=0, return_index=True)[1]  # a facet may lie in several regions
    area, opposite = (float(areas[first][looks[first] == way].sum()) for way in (-1.0, 1.0))
    volume = float(body.volumes_of_cells.sum())
    if not ends or max(abs(one * length - volume) for one in (area, opposite)) > ROUND_OFF * volume:
        raise NotARowOfPrisms(f"body '{body.name}' is no prism along the axis")
    if _across(body.velocity, axis) > ROUND_OFF * np.linalg.norm(body.velocity):
        raise NotARowOfPrisms(f"body '{body.name}' moves across the axis")
    if np.any(body.spec.spin):
        raise NotARowOfPrisms(f"body '{body.name}' turns")
    modulus = _modulus(body, sides, set(body.mesh.regions) - {*sides, *ends}, axis)
    points = np.concatenate(faces)
    return Prism(start, length, area, modulus, ends, np.array([points.min(axis=0), points.max(axis=0)]))


def _modulus(body: Body, sides: list[str], mixed: set[str], axis: Floats) -> float:
    """Return the modulus of a body that moves along the axis alone; `mixed` regions have several of its sides."""
    rolls = set()
    for region, along in body.spec.supports:
        if region in mixed:
            raise NotARowOfPrisms(f"'{body.name}.{region}', which is held, has several sides of its body")
        if region not in sides:
            continue
        if along is None or abs(axis[along]) > ROUND_OFF:
            raise NotARowOfPrisms(f"the side '{body.name}.{region}' is held along the axis")
        rolls.add((region, along))
    stress, pull = _stress_along(body, axis)
    modulus = float(pull @ stress @ pull)
    if np.abs(stress @ pull - modulus * pull).max() > ROUND_OFF * modulus:
        raise NotARowOfPrisms(f"body '{body.name}' shears if it is strained along the axis")
    across = np.eye(pull.size) - np.outer(pull, pull)
    if np.abs(across @ stress @ across).max() <= ROUND_OFF * modulus:
        return modulus  # it does not contract
    for region in [*sides, *sorted(mixed)]:
        normals = np.abs(body.surface(region).surface.normals)
        if (region, int(normals[0].argmax())) not in rolls or normals.max(axis=1).min() < 1.0 - ROUND_OFF:
            raise NotARowOfPrisms(f"body '{body.name}' contracts, and no rollers hold its side '{region}'")
    return modulus


def _stress_along(body: Body, axis: Floats) -> tuple[Floats, Floats]:
    """Return the stress of a body over a small strain along an axis alone, (d, d), and the axis, (d,).

    A body of revolution has stresses in three dimensions, d = 3; the axis is that of revolution.
    """
    element: Any = body.spec.element
    material: Any = body.spec.material
    pull = np.zeros(element.dimension)
    pull[: axis.size] = axis
    strain = STRAIN if not material.linear else 1.0
    kernel = plain_function(material.stress_2d if pull.size == 2 else material.stress_3d)
    parameters = np.array(answer(material, "solid_parameters", body.view.plane_of_material), dtype=float)
    stress = kernel(parameters, tuple((strain * np.outer(pull, pull)).ravel().tolist()))
    return np.reshape(stress, (pull.size, pull.size)) / strain, pull


def _contacts(model: ModelArrays, prisms: dict[str, Prism], axis: Floats) -> Iterator[ProblemContact]:
    """Yield the contacts of faces that cover each other, and of faces with walls across the axis."""
    for name, spec in model.case.contacts.items():
        points = [point for point in model.contact_points if point.name == name]
        ends = [BodyEnd(side.body, _end(prisms, side.body, side.region)) for side in spec.sides]
        faces = [prisms[side.body].across for side in spec.sides]
        size = float(np.abs(np.ptp(faces[0], axis=0)).max())
        if np.abs(faces[0] - faces[-1]).max() > ROUND_OFF * max(size, float(np.abs(faces).max())):
            raise NotARowOfPrisms(f"the faces of contact '{name}' do not cover each other")
        if len({end.at_start for end in ends}) != len(ends):
            raise NotARowOfPrisms(f"the faces of contact '{name}' look the same way")
        normal = -axis if ends[0].at_start else axis
        yield ProblemContact(name, tuple(ends), read_only(normal), points[0].gap)


def _end(prisms: dict[str, Prism], body: str, region: str) -> bool:
    """Return whether a region is the face at the start of its body."""
    if region not in prisms[body].ends:
        raise NotARowOfPrisms(f"'{body}.{region}' is no face across the axis")
    return prisms[body].ends[region]


def _fixed(model: ModelArrays, prisms: dict[str, Prism], axis: Floats) -> Iterator[BodyEnd]:
    """Yield the faces that are held along the axis."""
    for body in model.bodies.values():
        for region, along in body.spec.supports:
            if region in prisms[body.name].ends and (along is None or abs(axis[along]) > ROUND_OFF):
                yield BodyEnd(body.name, prisms[body.name].ends[region])


def _loads(model: ModelArrays, prisms: dict[str, Prism], axis: Floats) -> Iterator[ProblemLoad]:
    """Yield the loads on faces and on whole bodies."""
    for spec in model.case.loads.values():
        vectors: dict[tuple[str, BodyEnd | None], tuple[Any, Floats]] = {}
        for address in spec.on:
            if address.region:
                body = model.bodies[address.body]
                end = BodyEnd(body.name, _end(prisms, body.name, address.region))
                nodes = {node for node, _ in body.places(address.region)}
                forces = [one.force for one in model.loads.on_nodes if one.load is spec and one.node in nodes]
                drives = [one.direction for one in model.loads.constraints if one.load is spec and one.node in nodes]
                quantity = spec.acts_as if spec.acts_as in {"velocity", "acceleration"} else "force"
                vectors[body.name, end] = quantity, drives[0] if drives else np.sum(forces, axis=0)
        for force in model.loads.body_forces:
            if force.load is spec:
                name = list(model.bodies)[force.body]
                vectors[name, None] = "acceleration", force.acceleration
        for (name, place), (quantity, vector) in vectors.items():
            if _across(vector, axis) > ROUND_OFF * np.linalg.norm(vector):
                raise NotARowOfPrisms(f"load '{spec.name}' acts across the axis")
            along = read_only((vector @ axis) * axis)
            yield ProblemLoad(spec.name, spec.load, name, place, quantity, along, spec.start, spec.stop)
