"""What the contact points of solids do not see: nodes inside another body, contacts at a distance, points that slid.

Pairing and normals are those of the start, and a contact knows its bodies at its points alone. A run goes on where a
corner has come between two points, where a body without a contact is in the way, or where faces have left each other.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from itertools import permutations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.contact.pairs import walls_of
from percuss.mesh.surfaces import whole_surface
from percuss.methods.interfaces import Surface
from percuss.methods.interfaces.nearest import EVEN, nearest_places, places_on

if TYPE_CHECKING:
    from percuss.contact.model import Model
    from percuss.march.march import March, Outcome
    from percuss.methods.interfaces import Floats, Integers, Wall

TOLD = 1e-3  # of a facet: a node that lies deeper inside another body is told
APART = 1e-2  # of a facet: a larger distance of surfaces that press is told; means over facets err by less
FIRST_MOTIONS = 20  # times before the first contact at which `check` looks at bodies that keep their first velocities
OF_THE_START = (
    "pairing and normals are those of the start. Do not trust the forces from then on: shorten the run, or let the "
    "bodies slide and turn less"
)


class Sight(NamedTuple):
    """The model at one time: displacement of all nodes, (nodes, dim), and multiplier of each contact point, (P,)."""

    time: float
    displacement: Floats
    multiplier: Floats


class Inside(NamedTuple):
    """The node of a body that lies deepest inside another body or behind a wall, and since when one of them does."""

    node: int  # of the body
    depth: float
    time: float
    since: float


class Solids:
    """Solids and their contact points at some times, as encounters are looked for in them.

    Parameters
    ----------
    model
        A model of bodies that are no bars.
    sights
        The model at these times.
    """

    def __init__(self, model: Model, sights: Sequence[Sight]) -> None:
        from scipy.sparse import csr_array

        self.model, self.sights = model, sights
        points = model.contact_points
        self.facet, self.contact = points.facet, points.contact
        shape = len(points), model.bodies.n_nodes
        self.shares: Any = csr_array((points.share, (points.point, points.node)), shape=shape)
        relative = [np.asarray(self.shares @ sight.displacement) for sight in sights]
        self.gaps = [points.gap + (each * points.normal).sum(axis=1) for each in relative]

    @cached_property
    def seen(self) -> Any:
        """Whether a contact point sees each node where it is: it has a force there, or no gap, (times, nodes)."""
        at_points = abs(self.shares).T.tocsr()
        sees = [(sight.multiplier != 0.0) | (gap <= TOLD * self.facet) for sight, gap in self]
        return np.array([at_points @ each.astype(float) > 0.0 for each in sees])

    def __iter__(self) -> Iterator[tuple[Sight, Floats]]:
        """Yield the times, with the gap that each contact point sees, (P,)."""
        return zip(self.sights, self.gaps, strict=True)

    @cached_property
    def skins(self) -> dict[str, Surface]:
        """The boundary of each body."""
        return {body.name: whole_surface(body.view, body.start) for body in self.model.bodies.values()}

    @cached_property
    def walls(self) -> dict[str, Wall]:
        """The walls by the names of their contacts."""
        return walls_of(self.model.case, self.model.bodies)

    @cached_property
    def moved(self) -> dict[str, Floats]:
        """Places of the boundary of each body, (dim, times, nodes)."""

        def places(skin: Surface) -> Floats:
            return np.array([(skin.positions + sight.displacement[skin.nodes]).T for sight in self.sights])

        return {name: places(skin).swapaxes(0, 1) for name, skin in self.skins.items()}

    # -- nodes inside another body ---------------------------------------------------------------------------

    def inside(self, body: str, other: str) -> Inside | None:
        """Return the node of a body that lies deepest inside another one, where no contact point sees it.

        None where bodies overlap at the start: such bodies have no contact with each other.
        """
        skin, target = self.skins[body], self.skins[other]
        if _deepest(*_in_box(skin.positions, target.positions), target) is not None:
            return None
        near, places = ~self.seen[:, skin.nodes], zip(self.moved[body], self.moved[other], strict=True)
        for own, others in places:
            near &= (own > others.min(axis=1, keepdims=True)) & (own < others.max(axis=1, keepdims=True))
        found = {}
        for time in np.flatnonzero(near.any(axis=1)):
            (nodes,) = np.nonzero(near[time])
            there = target._replace(positions=self.moved[other][:, time].T)
            if (deepest := _deepest(nodes, self.moved[body][:, time, nodes].T, there)) is not None:
                found[int(time)] = deepest
        return self._first_and_deepest(body, found)

    def behind(self, contact: str) -> Inside | None:
        """Return the node of a body that lies deepest behind the wall of a contact, where no contact point sees it.

        Nodes that lie there at the start are left out.
        """
        body, wall = self.model.case.contacts[contact].sides[0].body, self.walls[contact]
        skin, least = self.skins[body], TOLD * self.model.bodies[body].shortest
        depth = wall.point @ wall.normal - np.tensordot(wall.normal, self.moved[body], 1)
        depth[self.seen[:, skin.nodes] | ((wall.point - skin.positions) @ wall.normal > least)] = 0.0
        times = np.flatnonzero(depth.max(axis=1) > least).tolist()
        return self._first_and_deepest(body, {t: (int(depth[t].argmax()), float(depth[t].max())) for t in times})

    def _first_and_deepest(self, body: str, found: Mapping[int, tuple[int, float]]) -> Inside | None:
        """Return the deepest of the nodes found at some times, each with its depth, and the first of these times."""
        if not found:
            return None
        time = max(found, key=lambda time: found[time][1])
        node, depth = found[time]
        number = int(self.skins[body].nodes[node]) - self.model.bodies[body].start
        return Inside(number, depth, self.sights[time].time, self.sights[min(found)].time)

    # -- contacts at a distance ------------------------------------------------------------------------------

    def apart(self, contact: int) -> tuple[float, float, float] | None:
        """Return when a contact first presses at a distance, the distance of its surfaces, and the gap that it sees.

        The distance is more than the gap of the strongest point.
        """
        sides = list(self.model.case.contacts.values())[contact].sides
        surfaces = [self.model.bodies[side.body].surface(side.region).surface for side in sides]
        pressing = [np.where(self.contact == contact, sight.multiplier, 0.0) for sight, _ in self]
        times = [time for time, force in enumerate(pressing) if force.max(initial=0.0) > 0.0]
        strongest = [int(pressing[time].argmax()) for time in times]
        near = self._near(surfaces, times, strongest)
        for time, point, at_point in zip(times, strongest, near, strict=True):
            gap, facet = float(self.gaps[time][point]), float(self.facet[point])
            allowed = abs(gap) + APART * facet
            if at_point <= allowed:
                continue
            moved = [one._replace(positions=self._places(one, time)) for one in surfaces]
            least = min(_least_distance(one, other, at_point) for one, other in (moved, moved[::-1]))
            least = min(least, _least_between_edges(moved[0], moved[1], least)) if self.model.dim == 3 else least
            if least > allowed:
                return self.sights[time].time, least, gap
        return None

    def _places(self, surface: Surface, time: int) -> Floats:
        places: Floats = surface.positions + self.sights[time].displacement[surface.nodes]
        return places

    def _near(self, surfaces: Sequence[Surface], times: Sequence[int], points: Sequence[int]) -> Floats:
        """Return the least distance of the nodes of a point from the facets of its other side, at each of some times.

        That is an upper bound of the distance of the surfaces.
        """
        least = np.full(len(times), np.inf)
        known: dict[int, Any] = {}
        for side in (0, 1):  # cells may be of two kinds, so that facets of the sides have other numbers of nodes
            at, corners, number = [np.zeros((0, self.model.dim))], [], [np.zeros(0, dtype=np.int64)]
            for k, (time, point) in enumerate(zip(times, points, strict=True)):
                if point not in known:
                    nodes = self.shares.indices[self.shares.indptr[point] : self.shares.indptr[point + 1]]
                    of = [np.flatnonzero(np.isin(surface.nodes, nodes)) for surface in surfaces]
                    known[point] = [
                        (own, one.facets[np.isin(one.facets, own).any(axis=1)])
                        for one, own in zip(surfaces, of, strict=True)
                    ]
                (own, _), (_, near) = known[point][side], known[point][1 - side]
                at.append(np.repeat(self._places(surfaces[side], time)[own], len(near), axis=0))
                corners.append(np.tile(self._places(surfaces[1 - side], time)[near], (len(own), 1, 1)))
                number.append(np.full(len(at[-1]), k))
            if corners:
                distance, _ = places_on(np.concatenate(at), np.concatenate(corners))
                np.minimum.at(least, np.concatenate(number), distance)
        return least


def _in_box(at: Floats, others: Floats) -> tuple[Integers, Floats]:
    """Return the numbers and places of the points that lie in the box round others."""
    (near,) = np.nonzero(((at > others.min(axis=0)) & (at < others.max(axis=0))).all(axis=1))
    return near, at[near]


def _deepest(nodes: Integers, at: Floats, skin: Surface) -> tuple[int, float] | None:
    """Return that of some points which lies deepest inside a body with a given boundary, and its depth."""
    if not len(nodes):
        return None
    facet, shares = skin.nearest(at)
    corners = skin.positions[skin.facets]
    vector = at - np.einsum("pa,pad->pd", shares, corners[facet])
    depth = np.linalg.norm(vector, axis=1)
    size = np.ptp(corners, axis=1).max(axis=1)[facet]
    deepest = [p for p in np.argsort(-depth).tolist() if depth[p] > TOLD * size[p]]
    # All facets that meet at the nearest place look away from a point inside, also where they meet at an edge.
    meetings = skin.facets_at(skin.facets[facet[p]][shares[p] > EVEN] for p in deepest)
    for p, meeting in zip(deepest, meetings, strict=True):
        middle = np.full((meeting.size, skin.facets.shape[1]), 1.0 / skin.facets.shape[1])
        if (skin.outward(meeting, middle) @ vector[p] < 0.0).all():
            return int(nodes[p]), float(depth[p])
    return None


def _least_distance(one: Surface, other: Surface, below: float) -> float:
    """Return the least distance of the nodes of a surface from another one, if it is below a value; else the value."""
    corners = other.positions[other.facets]
    ends = corners.min(axis=1) - below, corners.max(axis=1) + below
    at = one.positions[((one.positions >= ends[0].min(axis=0)) & (one.positions <= ends[1].max(axis=0))).all(axis=1)]
    if len(at):
        corners = corners[((ends[1] >= at.min(axis=0)) & (ends[0] <= at.max(axis=0))).all(axis=1)]
    if not len(at) or not len(corners):
        return below
    facet, shares = nearest_places(at, corners)
    apart = np.linalg.norm(at - np.einsum("pa,pad->pd", shares, corners[facet]), axis=1)
    return min(below, float(apart.min()))


def _least_between_edges(one: Surface, other: Surface, below: float) -> float:
    """Return the least distance of two edges that pass each other between their ends, if it is below a value."""
    edges = []
    for surface in (one, other):
        pairs = np.stack([surface.facets, np.roll(surface.facets, -1, axis=1)], axis=2).reshape(-1, 2)
        edges.append(surface.positions[np.unique(np.sort(pairs, axis=1), axis=0)])
    for k in (0, 1):  # those that the box round the others has
        low, high = edges[1 - k].min(axis=(0, 1)) - below, edges[1 - k].max(axis=(0, 1)) + below
        edges[k] = edges[k][((edges[k].max(axis=1) >= low) & (edges[k].min(axis=1) <= high)).all(axis=1)]
        if not len(edges[k]):
            return below
    starts, along = [of[:, 0] for of in edges], [of[:, 1] - of[:, 0] for of in edges]
    for start, way in zip(starts[0], along[0], strict=True):
        apart, ways = start - starts[1], along[1]
        a, b, c = way @ way, ways @ way, (ways**2).sum(axis=1)
        d, e = apart @ way, (apart * ways).sum(axis=1)
        det = a * c - b * b
        crossing = det > EVEN * a * c
        s, t = (np.divide(of, det, out=np.full(len(c), -1.0), where=crossing) for of in (b * e - c * d, a * e - b * d))
        inside = (s > 0.0) & (s < 1.0) & (t > 0.0) & (t < 1.0)
        vectors = apart[inside] + s[inside, None] * way - t[inside, None] * ways[inside]
        below = min(below, float(np.linalg.norm(vectors, axis=1).min(initial=below)))
    return below


# -- notes of a run ------------------------------------------------------------------------------------------


def notes_of_solids(march: March, outcome: Outcome) -> list[str]:
    """Return notes on what the contact points of solids did not see, at the snapshots and at the end of the run."""
    solids = Solids(march.model, list(_sights(march, outcome)))
    notes = []
    for body, where, contact, inside in _all_inside(solids):
        notes.append(
            f"node {inside.node} of '{body}' lies {inside.depth:.3g} {where} at time {inside.time:.6g}, with no "
            f"force on it (from time {inside.since:.6g} on): {_why_not_seen(solids, body, contact)}"
        )
    for number, name in enumerate(march.model.case.contacts):
        if name in solids.walls:
            continue
        if (found := solids.apart(number)) is not None:
            time, distance, gap = found
            notes.append(
                f"contact '{name}' presses at time {time:.6g} although its surfaces are {distance:.3g} apart (its "
                f"points see {gap:.3g}): {OF_THE_START}"
            )
        slid, since = outcome.histories["slid"][number]
        if slid > 1.0:
            notes.append(
                f"contact '{name}' presses from time {since:.6g} on at points that have slid along their surface by "
                f"more than a facet, by {slid:.3g} facets at most: {OF_THE_START}"
            )
    return notes


def _sights(march: March, outcome: Outcome) -> Iterator[Sight]:
    """Yield the snapshots of a run that have the forces of the points, and its end."""
    model, record = march.model, outcome.record
    shape, pressures = model.bodies.nodes.shape, outcome.histories.get("field_pressure", np.zeros((0, 0)))
    if pressures.size:
        weight = model.contact_points.weight
        for n in range(-(-outcome.done // record.field_every)):
            moved = record.field[n].reshape(shape)
            yield Sight(n * record.field_every * model.dt, moved, pressures[n] * weight)
    yield Sight(outcome.done * model.dt, outcome.final_displacement.reshape(shape), outcome.multipliers)


def _all_inside(solids: Solids) -> Iterator[tuple[str, str, str | None, Inside]]:
    """Yield bodies with a node inside another one or behind a wall: body, place in words, contact, and node."""
    contacts = solids.model.case.contacts
    between = {frozenset(side.body for side in spec.sides): name for name, spec in contacts.items()}
    for body, other in permutations(solids.model.bodies, 2):
        if (inside := solids.inside(body, other)) is not None:
            yield body, f"inside '{other}'", between.get(frozenset((body, other))), inside
    for contact in solids.walls:
        if (inside := solids.behind(contact)) is not None:
            yield contacts[contact].sides[0].body, f"behind the wall of contact '{contact}'", contact, inside


def _why_not_seen(solids: Solids, body: str, contact: str | None) -> str:
    """Return why no contact point sees a node of a body, and what to do."""
    if contact is None:
        return "no contact is declared between them; declare one"
    sides = solids.model.case.contacts[contact].sides
    if len(sides) == 1:
        return f"it is not in {sides[0]}. Give the contact a region that has it"
    unseen = f"the points of contact '{contact}', on {sides[0]}, do not see it"
    other = "try another pairing, or make the cells finer"
    return (
        f"{unseen}. {f'{other[0].upper()}{other[1:]}' if sides[0].body == body else f'Name {sides[1]} first, {other}'}"
    )


# -- what `check` foresees -------------------------------------------------------------------------------------


def foreseen_of_solids(model: Model) -> list[str]:
    """Return one sentence for each thing that contact points will not see, if bodies keep their first velocities."""
    velocity = np.concatenate([body.nodal_velocity for body in model.bodies.values()])
    points = model.contact_points
    closing = -np.bincount(points.point, np.vecdot(points.value, velocity[points.node]), len(points))
    meets = np.divide(points.gap, closing, out=np.full(len(points), np.inf), where=closing > 0.0)
    end = model.steps * model.dt
    first = [float(meets[points.contact == k].min(initial=end)) for k in range(len(model.case.contacts))]
    last = min([end, *first])  # later a contact may have changed the velocities
    sentences = []
    if last > 0.0 and np.any(velocity):
        times = np.linspace(0.0, last, FIRST_MOTIONS + 1)[1:].tolist()
        solids = Solids(model, [Sight(t, t * velocity, np.zeros(len(meets))) for t in times])
        sentences += [
            f"node {inside.node} of '{body}' will be {inside.depth:.3g} {where} at time {inside.time:.6g} if bodies "
            f"keep their first velocities, and no contact point will see it: {_why_not_seen(solids, body, contact)}"
            for body, where, contact, inside in _all_inside(solids)
        ]
    for k, (name, spec) in enumerate(model.case.contacts.items()):
        if len(spec.sides) == 2 and first[k] < end:
            touching = (points.contact == k) & (meets <= first[k])
            found = Solids(model, [Sight(first[k], first[k] * velocity, touching.astype(float))]).apart(k)
            if found is not None:
                sentences.append(
                    f"contact '{name}' will press at time {found[0]:.6g} if its bodies keep their first velocities, "
                    f"although its surfaces are then {found[1]:.3g} apart"
                )
    return sentences
