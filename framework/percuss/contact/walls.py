"""Rigid walls: planes, circles, spheres and cylinders, at rest or moved by a load of prescribed velocity."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.case.specs import RigidWall
from percuss.mesh.loads import acts_at, amplitude
from percuss.methods.interfaces import PairedPoints, Wall

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.case.specs import ContactSpec, LoadSpec
    from percuss.errors import Problem
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats, Integers, Places, Surface

PLANE, BALL, CYLINDER = 0, 1, 2  # kinds of walls; in two dimensions a ball is a circle
ON_AXIS = 1e-9  # of the radius of a sphere, to which its centre is on an axis


class WallShape(NamedTuple):
    """A rigid wall as it is at the start.

    Attributes
    ----------
    kind
        PLANE, BALL or CYLINDER.
    point : (dim,) array
        A point of a plane, the centre of a ball, or a point of the axis of a cylinder [length].
    axis : (dim,) array
        Unit vector: normal of a plane, to the side where the body is, or axis of a cylinder; zeros of a ball.
    across : (dim,) array
        Unit vector across the axis: the normal at the centre, from which no direction is the nearest.
    radius
        Zero of a plane [length].
    side
        1 where the body is outside, -1 where it is inside.
    """

    kind: int
    point: Floats
    axis: Floats
    across: Floats
    radius: float = 0.0
    side: float = 1.0

    @property
    def plane(self) -> Wall:
        """The wall if it is a plane, as pairings know it."""
        return Wall(self.point, self.axis)

    @property
    def entries(self) -> list[Any]:
        """What describes it in a file: point and normal of a plane, else all attributes."""
        of_it = (self.point, self.axis) if self.kind == PLANE else self
        return [np.asarray(one).tolist() for one in of_it]

    @classmethod
    def of_entries(cls, entries: list[Any]) -> WallShape:
        """Return the wall that some entries describe."""
        if len(entries) == 2:
            return plane_of(*map(np.array, entries))
        kind, point, axis, across, radius, side = entries
        return cls(kind, np.array(point), np.array(axis), np.array(across), radius, side)

    def moved(self, displacement: Floats) -> WallShape:
        """Return the wall after a displacement, (dim,)."""
        return self._replace(point=self.point + displacement)

    def meet(self, at: Floats) -> tuple[Floats, Floats]:
        """Return the gaps of places, (P, dim), and the unit normals out of the wall there: (P,), (P, dim)."""
        vector = at - self.point
        along = vector @ self.axis
        if self.kind == PLANE:
            return along, np.tile(self.axis, (len(at), 1))
        vector = vector - along[:, None] * self.axis
        distance = np.linalg.norm(vector, axis=1)
        out = np.tile(self.across, (len(at), 1))
        np.divide(vector, distance[:, None], out=out, where=distance[:, None] > 0.0)
        return self.side * (distance - self.radius), self.side * out


def meet_wall(shape: WallShape, centre: Floats, at: Floats, out: Floats) -> float:
    """Return the gap of one place, and write the unit normal there: `WallShape.meet` as a kernel.

    `centre` is where the point of the wall is now.
    """
    along, square, dim = 0.0, 0.0, at.size
    for d in range(dim):
        along += (at[d] - centre[d]) * shape.axis[d]
    if shape.kind == PLANE:
        for d in range(dim):
            out[d] = shape.axis[d]
        return along
    for d in range(dim):
        out[d] = at[d] - centre[d] - along * shape.axis[d]
        square += out[d] * out[d]
    distance = np.sqrt(square)
    for d in range(dim):
        out[d] = shape.side * (out[d] / distance if distance > 0.0 else shape.across[d])
    return shape.side * (distance - shape.radius)  # type: ignore[no-any-return]


def plane_of(point: Floats, normal: Floats) -> WallShape:
    """Return a plane through a point, by a normal that has any length."""
    axis = normal / np.linalg.norm(normal)
    return WallShape(PLANE, point, axis, np.zeros(axis.size))


def shape_of(wall: RigidWall) -> WallShape:
    """Return the shape of a wall that a case gives by its geometry."""
    if wall.point is not None and wall.normal is not None:
        return plane_of(np.array(wall.point), np.array(wall.normal))
    side = -1.0 if wall.inside else 1.0
    if (ball := wall.circle or wall.sphere) is not None:
        centre = np.array(ball.centre)
        return WallShape(BALL, centre, np.zeros(centre.size), np.eye(centre.size)[-1], ball.radius, side)
    tube: Any = wall.cylinder
    axis = np.array(tube.axis) / np.linalg.norm(tube.axis)
    across = np.eye(axis.size)[np.abs(axis).argmin()]
    across -= (across @ axis) * axis
    return WallShape(CYLINDER, np.array(tube.point), axis, across / np.linalg.norm(across), tube.radius, side)


def points_at_wall(places: Places, first: Surface, wall: WallShape) -> PairedPoints:
    """Return all points of a surface against a wall that is round or moves.

    The entries of a point are those of its own nodes, and room for the wall.
    """
    own = first.facets[places.facets]
    gap, out = wall.meet(np.einsum("pa,pad->pd", places.shares, first.positions[own]))
    room = np.ones((len(own), 1), dtype=bool)
    kept = np.concatenate([places.shares != 0.0, room], axis=1)
    shares = np.concatenate([places.shares, 0.0 * room], axis=1)
    largest = np.take_along_axis(own, places.shares.argmax(axis=1)[:, None], axis=1)
    node = first.nodes[np.concatenate([own, largest], axis=1)]
    start = np.concatenate([[0], np.cumsum(kept.sum(axis=1))])
    facets = np.stack([places.facets, np.full(len(own), -1)], axis=1)
    return PairedPoints(gap, places.weight, -out, facets, start, node[kept], (shares[..., None] * out[:, None])[kept])


# ------------------------------------------------------------------------------------------------------------- motion


def round_or_moving(case: Case) -> dict[str, tuple[WallShape, LoadSpec | None]]:
    """Return the walls of a case that are round or move, each with the load that moves it, by their contacts."""
    walls = {name: spec.wall for name, spec in case.contacts.items() if isinstance(spec.wall, RigidWall)}
    return {
        name: (shape_of(wall), case.loads[wall.moving] if wall.moving is not None else None)
        for name, wall in walls.items()
        if not wall.stays
    }


def velocities(load: LoadSpec | None, midpoints: Floats, dt: float) -> Floats:
    """Return the velocity of a wall along its direction in the steps around some times; 0 while its load is off."""
    if load is None:
        return np.zeros(midpoints.size)
    on = acts_at(midpoints, load.start, load.stop)
    return np.where(on, amplitude(load, midpoints, dt, average=False), 0.0)


def direction_of(load: LoadSpec | None, dim: int) -> Floats:
    """Return the unit vector along which a wall moves, (dim,); zeros of a wall at rest."""
    if load is None or load.direction is None:
        return np.zeros(dim)
    direction: Floats = np.array(load.direction)
    direction /= np.linalg.norm(direction)
    return direction


def displacements(load: LoadSpec | None, steps: Integers, dt: float, dim: int) -> Floats:
    """Return the displacement of a wall before some steps, (steps, dim)."""
    midpoints = np.arange(steps.max(initial=0)) + 0.5
    ways = np.concatenate([[0.0], np.cumsum(dt * velocities(load, midpoints * dt, dt))])
    moved: Floats = ways[steps][:, None] * direction_of(load, dim)
    return moved


def before_the_start(load: LoadSpec | None, dt: float, dim: int) -> Floats:
    """Return the velocity of a wall half a step before t = 0, (dim,): that of its first half step goes on."""
    first = velocities(load, np.array([0.5 * dt]), dt)[0]
    at_start = amplitude(load, np.zeros(1), dt, average=False)[0] if load is not None and first != 0.0 else 0.0
    velocity: Floats = (2.0 * at_start - first) * direction_of(load, dim)
    return velocity


# ----------------------------------------------------------------------------------------------------------- refusals


def wrong_with(case: Case, spec: ContactSpec, body: Body) -> Problem | None:
    """Return why a body cannot meet a wall that is round or moves; None if it can."""
    wall: Any = spec.wall
    for path, message, advice in _wrong(case, wall, body):
        return case.problem(("contacts", spec.name, "wall", *path), message, advice)
    return None


def _wrong(case: Case, wall: RigidWall, body: Body) -> Iterator[tuple[tuple[str, ...], str, str]]:
    about, kind = body.view.plane == "axisymmetric", wall.shape
    if body.is_bar:
        advice = "Of bars, drive the end of another bar."
        yield (), f"expected a plane at rest for a bar, found a {kind}{' that moves' if wall.moving else ''}", advice
    where = "a body of revolution" if about else f"a body in {case.dimension} dimensions"
    suits = {"plane": True, "circle": case.dimension == 2 and not about, "cylinder": case.dimension == 3}
    suits["sphere"] = about or case.dimension == 3
    if not suits[kind]:
        others = " or ".join(f"`{name}`" for name, good in suits.items() if good and name != "plane")
        yield (kind,), f"expected another wall for {where}, found a {kind}", f"Write {others}, or a plane."
    if about and wall.sphere is not None and abs(wall.sphere.centre[0]) > ON_AXIS * wall.sphere.radius:
        place = wall.sphere.centre[0]
        yield ("sphere", "centre"), f"expected a sphere centred on the axis of revolution, found x = {place:g}", ""
    if wall.moving is None:
        return
    load = case.loads[wall.moving]
    if load.acts_as != "velocity":
        yield ("moving",), f"expected a load of prescribed velocity, found '{wall.moving}', a {load.acts_as}", ""
    elif load.direction is None:
        advice = f"Add `along:` or `direction:` to loads.{wall.moving}."
        yield ("moving",), f"expected a load with a direction, found '{wall.moving}' without", advice
    elif about and load.direction[0] != 0.0:
        yield ("moving",), f"expected a wall that moves along the axis of revolution, found '{wall.moving}'", ""
