"""Bodies as bars: bars themselves, and prisms that move along their axis alone, which are bars in all but their cells.

A solid is a prism if it is in one piece, its boundary is two equal plane faces across the axis and sides along it, and
nothing moves across: the material does not contract, or rollers hold the sides. Its modulus is that of a strain along
the axis alone. What acts on a face acts on all of it, and faces in contact cover each other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.case.type_words import found
from percuss.contact.walls import round_or_moving
from percuss.mesh.cells import pieces_of, solid_parameters
from percuss.mesh.surfaces import boundary_of
from percuss.methods.blame import plain_function

if TYPE_CHECKING:
    from percuss.contact.model import Model
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats, Integers, Surface

ROUND_OFF = 1e-9  # relative, of directions, lengths, areas and stresses
STRAIN = 1e-6  # of a material that is not linear


class NotARowOfPrisms(Exception):
    """Why a case is no row of prisms along one axis."""


class Prism(NamedTuple):
    """A body as a bar along an axis."""

    body: Body
    axis: Floats
    start: float  # place of its start along the axis
    length: float
    area: float
    modulus: float | None  # None of a bar, whose material has it

    def at_start(self, region: str, used: str) -> bool:
        """Return whether a region is the face at the start; `used` says what for."""
        if self.body.is_bar:
            return self.body.node(region) == self.body.start
        surface = self.body.surface(region).surface
        looks, place = _looks(surface, self.axis), (surface.positions @ self.axis - self.start) / self.length
        said = f"'{self.body.name}.{region}', which is {used}, "
        if not (looks == looks[0]).all() or looks[0] == 0.0 or np.ptp(place) > ROUND_OFF:
            raise NotARowOfPrisms(f"{said}is no face across the axis")
        if abs(float(surface.areas.sum()) - self.area) > ROUND_OFF * self.area:
            raise NotARowOfPrisms(f"{said}has not the area of its face")
        return bool(looks[0] < 0.0)

    def check_recorded(self, region: str) -> None:
        """Refuse a region of a prism that is recorded and is neither one of its faces nor on its sides."""
        if not self.body.is_bar and (_looks(self.body.surface(region).surface, self.axis) != 0.0).any():
            self.at_start(region, "recorded")

    def along(self, vector: Floats, load: str) -> Floats:
        """Return the vector of a load along the axis; that on a bar may have any direction."""
        if self.body.is_bar:
            return vector
        if _across(vector, self.axis) > ROUND_OFF * np.linalg.norm(vector):
            raise NotARowOfPrisms(f"load '{load}' acts across the axis")
        along: Floats = (vector @ self.axis) * self.axis
        return along


def prisms_of(model: Model) -> dict[str, Prism]:
    """Return the bodies of a model as bars, by name.

    Raises
    ------
    NotARowOfPrisms
        If a solid is no prism, a body is damped, or a wall is round or moves.
    """
    if walls := list(round_or_moving(model.case)):
        raise NotARowOfPrisms(f"the wall of contact '{walls[0]}' is no plane at rest")
    if damped := [body.name for body in model.bodies.values() if body.spec.damping is not None]:
        raise NotARowOfPrisms(f"body '{damped[0]}' is damped")
    if model.bodies.of_lines:
        return {body.name: _bar(body) for body in model.bodies.values()}
    axis = _axis(model)
    held = {(one.node, int(one.direction.argmax())) for one in model.loads.constraints if one.load is None}
    return {body.name: _prism(body, axis, held) for body in model.bodies.values()}


def _bar(body: Body) -> Prism:
    axis, length = body.mesh.direction, float(body.mesh.lengths.sum())
    return Prism(body, axis, float(body.mesh.nodes[0] @ axis), length, body.spec.section, None)


def _axis(model: Model) -> Floats:
    """Return the direction in which the case moves: of its contacts, its velocities or its loads."""
    normals = list(model.contact_points.normal)
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


def _prism(body: Body, axis: Floats, held: set[tuple[int, int]]) -> Prism:
    """Return a body as a prism along an axis; `held` are the nodes of the model that supports hold, and along what."""
    if np.any(body.spec.spin):
        raise NotARowOfPrisms(f"body '{body.name}' turns")
    if _across(body.velocity, axis) > ROUND_OFF * np.linalg.norm(body.velocity):
        raise NotARowOfPrisms(f"body '{body.name}' moves across the axis")
    if (pieces := int(pieces_of(body.mesh).max()) + 1) > 1:
        raise NotARowOfPrisms(f"body '{body.name}' is in {pieces} pieces")
    place = body.mesh.nodes @ axis
    start, length = float(place.min()), float(np.ptp(place))
    volume = float(body.volumes_of_cells.sum())
    surface = body.boundary
    looks = _looks(surface, axis)
    apart = surface.positions[surface.facets] @ axis - start - np.where(looks > 0.0, length, 0.0)[:, None]
    area = float(surface.areas[looks == -1.0].sum())
    is_prism = np.isfinite(looks).all() and np.abs(apart[looks != 0.0]).max(initial=0.0) <= ROUND_OFF * length
    if not is_prism or abs(area * length - volume) > ROUND_OFF * volume:
        raise NotARowOfPrisms(f"body '{body.name}' is no prism along the axis")
    sides = (looks == 0.0) & (surface.areas > 0.0)  # a side of no area is the axis of revolution
    modulus = _modulus(body, surface, sides, axis, held)
    return Prism(body, axis, start, length, area, modulus)


def _looks(surface: Surface, axis: Floats) -> Floats:
    """Return -1 and 1 of facets across an axis, by the way they look, 0 of those along it, nan of others."""
    width, every = surface.facets.shape[1], np.arange(len(surface.facets))
    corners = np.stack([surface.outward(every, np.tile(corner, (every.size, 1))) for corner in np.eye(width)], axis=1)
    cosines = corners @ axis / np.linalg.norm(corners, axis=2)
    looks: Floats = np.round(cosines[:, 0])
    looks[np.abs(cosines - looks[:, None]).max(axis=1) > ROUND_OFF] = np.nan
    return looks


def _modulus(body: Body, surface: Surface, sides: Integers, axis: Floats, held: set[tuple[int, int]]) -> float:
    """Return the modulus of a body that moves along the axis alone, whose facets `sides` are free or roll."""
    stress, pull = stress_along(body, axis)
    modulus = float(pull @ stress @ pull)
    if np.abs(stress @ pull - modulus * pull).max() > ROUND_OFF * modulus:
        raise NotARowOfPrisms(f"body '{body.name}' shears if it is strained along the axis")
    across = np.eye(pull.size) - np.outer(pull, pull)
    if np.abs(across @ stress @ across).max() <= ROUND_OFF * modulus:
        return modulus  # it does not contract
    for facet, normal in zip(surface.nodes[surface.facets[sides]], np.abs(surface.normals[sides]), strict=True):
        rolls = {(int(node), int(normal.argmax())) for node in facet} <= held
        if not rolls or normal.max() < 1.0 - ROUND_OFF:
            place = found(np.round(body.mesh.nodes[facet - body.start].mean(axis=0), 9).tolist())
            raise NotARowOfPrisms(f"body '{body.name}' contracts, and no rollers hold its side at {place}")
    return modulus


def stress_along(body: Body, axis: Floats) -> tuple[Floats, Floats]:
    """Return the stress of a body over a small strain along an axis alone, (d, d), and the axis, (d,).

    A body of revolution, or of a material with kernels in space alone, has stresses in three dimensions, d = 3.
    """
    element: Any = body.spec.element
    material: Any = body.spec.material
    flat = element.dimension == 2 and material.stress_2d is not None
    pull = np.zeros(2 if flat else 3)
    pull[: axis.size] = axis
    strain = STRAIN if not material.linear else 1.0
    kernel = plain_function(material.stress_2d if flat else material.stress_3d)
    parameters = solid_parameters(material, body.view.plane_of_material if flat else "")
    at_rest = [np.zeros(material.state)] * 2 if material.state else []
    stress = kernel(parameters, tuple((strain * np.outer(pull, pull)).ravel().tolist()), *at_rest)
    return np.reshape(stress, (pull.size, pull.size)) / strain, pull


def check_faces(contact: str, sides: tuple[tuple[Prism, str], ...]) -> None:
    """Refuse a contact of the faces of two prisms, by prism and region, that do not cover each other."""
    if len({prism.at_start(region, "in contact") for prism, region in sides}) != len(sides):
        raise NotARowOfPrisms(f"the faces of contact '{contact}' look the same way")
    if len(sides) > 1 and not _cover(sides):
        raise NotARowOfPrisms(f"the faces of contact '{contact}' do not cover each other")


def _cover(sides: tuple[tuple[Prism, str], ...]) -> bool:
    """Return whether two faces across an axis cover each other: whether they have the same rim.

    The rim of a face is the edges of its facets that no other of them has, in a plane their ends.
    """
    axis = sides[0][0].axis
    plane = np.linalg.svd(axis[None])[2][1:].T
    rims = []
    for prism, region in sides:
        ((kind, facets),) = prism.body.mesh.regions[region].facets.items()
        rims.append(prism.body.mesh.nodes[boundary_of(kind, np.asarray(facets))] @ plane)
    size = ROUND_OFF * max(float(np.abs(rim).max()) for rim in rims)
    if axis.size == 2:
        one, other = (np.sort(rim, axis=None) for rim in rims)
        return one.size == other.size and bool(np.abs(one - other).max() <= size)
    return all(_lies_on(one, other, size) for one, other in (rims, rims[::-1]))


def _lies_on(edges: Floats, others: Floats, slack: float) -> bool:
    """Return whether edges in a plane, (E, 2, 2), lie on others, each part of them once."""
    ahead = edges[:, 1] - edges[:, 0]
    length = np.linalg.norm(ahead, axis=1)
    ahead /= length[:, None]
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    places, on = [], np.ones((len(edges), len(others)), dtype=bool)
    for end in others.swapaxes(0, 1):
        on &= np.abs(aside @ end.T - (aside * edges[:, 0]).sum(axis=1)[:, None]) <= slack
        places.append(np.clip(ahead @ end.T - (ahead * edges[:, 0]).sum(axis=1)[:, None], 0.0, length[:, None]))
    shared = (np.abs(places[1] - places[0]) * on).sum(axis=1)
    return bool(np.abs(shared - length).max() <= slack)
