"""What contacts do not see: bodies that pass through each other, contacts that press at a distance or have slid off.

Pairing and normals are those of the start, a contact knows its bodies at its points alone, and bodies without a contact
do not know each other: a run goes on with forces that no body would feel, and its notes say so.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np

from percuss.contact.model import Model
from percuss.contact.pairs import walls_of
from percuss.contact.points import TOUCHING
from percuss.jsonable import Entries
from percuss.march.march import March, Outcome
from percuss.march.recording import probe_nodes
from percuss.mesh.body import Body
from percuss.mesh.surfaces import whole_surface
from percuss.methods.interfaces import Floats, Surface
from percuss.methods.interfaces.nearest import EVEN, places_on

NOT_DECLARED = "no contact is declared between them"
TOLD = 1e-3  # of a facet: a node that lies deeper inside another body is told
APART = 1e-2  # of a facet: a larger distance of surfaces that press is told; means over facets err by less
FIRST_MOTIONS = 20  # times before the first contact at which `check` looks at bodies that keep their first velocities
OF_THE_START = (
    "pairing and normals are those of the start. Do not trust the forces from then on: shorten the run, or let the "
    "bodies slide and turn less"
)


# -- ends of bars -----------------------------------------------------------------------------------------------


class End(NamedTuple):
    """An end of a body: its address in a case, its node in the model, its normal out of the body and its position."""

    name: str
    body: Body
    node: int
    outward: Floats
    position: Floats


def _ends(model: Model) -> Iterator[End]:
    """Yield the ends of all bodies."""
    for body in model.bodies.values():
        for region, (nodes, outward, _) in body.mesh.regions.items():
            if len(nodes) == 1:
                yield End(f"{body.name}.{region}", body, body.start + nodes[0], outward, body.mesh.nodes[nodes[0]])


def _touching(end: End) -> float:
    """Return the distance below which another end touches an end."""
    return TOUCHING * float(end.body.mesh.lengths[end.body.end_element(end.node)])


def undeclared_pairs(model: Model) -> list[tuple[End, End, float]]:
    """Return the neighbouring ends on one line that face each other without a contact, and their initial distance.

    Ends that both have a contact with another partner are left out: several experiments may lie on one line.
    """
    in_contact, ends, pairs = set(model.contact_points.node.tolist()), list(_ends(model)), []
    outward, position = (np.array([getattr(end, name) for end in ends]) for name in ("outward", "position"))
    for end in ends:
        if next(part for part in end.outward.tolist() if abs(part) > 1e-9) < 0.0:  # the other end of a pair
            continue
        along = (position - end.position) @ end.outward
        beside = np.linalg.norm(position - end.position - np.outer(along, end.outward), axis=1)
        on_line = beside < 1e-6 * float(end.body.mesh.lengths.sum())
        facing = on_line & (outward @ end.outward < 1e-9 - 1.0) & (along >= -_touching(end))
        if facing.any():
            nearest = int(np.where(facing, along, np.inf).argmin())
            other, gap = ends[nearest], float(along[nearest])
            if other.body is not end.body and not {end.node, other.node} <= in_contact:
                pairs.append((end, other, 0.0 if gap <= _touching(end) else gap))
    return pairs


def expected_meetings(model: Model) -> list[str]:
    """Return one sentence for each meeting that no contact will see, if bodies keep their first velocities.

    Of bars those are pairs of ends without a contact that touch or meet.
    """
    if not model.bodies.of_lines:
        return foreseen_of_solids(model)
    sentences = []
    for end, other, gap in undeclared_pairs(model):
        closing = float(end.outward @ (end.body.velocity - other.body.velocity))
        if gap == 0.0:
            sentences.append(f"{end.name} and {other.name} touch, and {NOT_DECLARED}")
        elif closing * model.steps * model.dt > gap:
            sentences.append(
                f"{end.name} and {other.name} will meet at time {gap / closing:.6g} if their bodies keep their first "
                f"velocities, and {NOT_DECLARED}"
            )
    return sentences


def encounters(march: March, outcome: Outcome, arrays: Entries) -> list[str]:
    """Return notes on bodies that passed through each other, and on contacts that pressed beside their ends.

    They are seen where the motion of the ends is recorded, and at the end of the run.
    """
    model = march.model
    if outcome.done == 0:
        return []
    if not model.bodies.of_lines:
        return notes_of_solids(march, outcome) if outcome.status != "unstable" else []
    notes = []
    for end, other, gap in undeclared_pairs(model):
        depth = -float((gap + _relative(march, outcome, arrays, end.node, other.node) @ end.outward).min())
        if depth > _touching(end):
            notes.append(f"{end.name} passes through {other.name}, by {depth:.3g} at most: {NOT_DECLARED}")
    points = model.contact_points
    for p in np.flatnonzero(~points.at_wall).tolist() if model.dim > 1 else ():
        normal, nodes = points.normal[p], points.nodes_of(p)
        relative = _relative(march, outcome, arrays, *nodes)
        beside = np.linalg.norm(relative - np.outer(relative @ normal, normal), axis=1)
        pressing = arrays["contact_force"][-beside.size :, p] != 0.0
        # The faces are taken as squares: they have no point in common beyond half the sum of their sides.
        width = 0.5 * sum(model.bodies.at(node).spec.section ** 0.5 for node in nodes)
        if (off := np.flatnonzero(pressing & (beside > width))).size:
            since = arrays["time"][-beside.size :][off[0]]
            notes.append(
                f"contact '{points.names[p]}' presses from time {since:.6g} on although its ends have slid off each "
                f"other: they are {beside[off].max():.3g} apart sideways, and {width:.3g} wide; a contact of two ends "
                "knows only their distance along its normal"
            )
    return notes


def _relative(march: March, outcome: Outcome, arrays: Entries, first: int, second: int) -> Floats:
    """Return the displacement of one node relative to another where it is known, (times, dim)."""
    probes = [node for (node, _), *_ in probe_nodes(march.model)]
    if first in probes and second in probes:
        of_probes = {node: arrays["displacement"][:, probes.index(node)] for node in (first, second)}
        relative: Floats = of_probes[second] - of_probes[first]
        return relative
    last: Floats = outcome.final_displacement.reshape(-1, march.dim)
    return last[[second]] - last[[first]]


# -- solids -----------------------------------------------------------------------------------------------------


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

    Attributes
    ----------
    gaps
        The gap that each contact point sees, at each time.
    unseen
        Whether no contact point sees each node, at each time: none has a force there, or no gap.
    skins
        The boundary of each body.
    walls
        The walls by the names of their contacts.
    """

    def __init__(self, model: Model, sights: Sequence[Sight]) -> None:
        from scipy.sparse import csr_array

        self.model, self.sights, points = model, sights, model.contact_points
        shape = len(points), model.bodies.n_nodes
        self.shares: Any = csr_array((points.share, (points.point, points.node)), shape=shape)
        relative = [self.shares @ sight.displacement for sight in sights]
        self.gaps = [points.gap + (each * points.normal).sum(axis=1) for each in relative]
        closed = [gap <= TOLD * points.facet for gap in self.gaps]
        sees = [(sight.multiplier != 0.0) | each for sight, each in zip(sights, closed, strict=True)]
        at_points = abs(self.shares).T.tocsr()
        self.unseen = [at_points @ each.astype(float) == 0.0 for each in sees]
        self.skins = {body.name: whole_surface(body.view, body.start) for body in model.bodies.values()}
        self.walls = walls_of(model.case, model.bodies)

    def moved(self, surface: Surface, time: int) -> Surface:
        """Return a surface where it is at one of the times."""
        return surface._replace(positions=surface.positions + self.sights[time].displacement[surface.nodes])

    def inside(self, body: str, other: str) -> Inside | None:
        """Return the node of a body that lies deepest inside another one, where no contact point sees it.

        None where bodies overlap at the start: such bodies have no contact with each other.
        """
        skin, target = self.skins[body], self.skins[other]
        if _deepest(skin, target, np.ones(len(skin.nodes), dtype=bool)) is not None:
            return None
        moved = ((self.moved(skin, time), self.moved(target, time)) for time in range(len(self.sights)))
        found = [_deepest(*both, unseen[skin.nodes]) for both, unseen in zip(moved, self.unseen, strict=True)]
        return self._first_and_deepest(body, found)

    def behind(self, contact: str) -> Inside | None:
        """Return the node of a body that lies deepest behind the wall of a contact, where no contact point sees it.

        Nodes that lie there at the start are left out.
        """
        body, wall = self.model.case.contacts[contact].sides[0].body, self.walls[contact]
        skin, least = self.skins[body], TOLD * self.model.bodies[body].shortest
        before = (wall.point - skin.positions) @ wall.normal <= least
        found: list[tuple[int, float] | None] = []
        for time, unseen in enumerate(self.unseen):
            depth = (wall.point - self.moved(skin, time).positions) @ wall.normal
            depth[~(before & unseen[skin.nodes])] = 0.0
            found.append((int(depth.argmax()), float(depth.max())) if depth.max() > least else None)
        return self._first_and_deepest(body, found)

    def _first_and_deepest(self, body: str, found: Sequence[tuple[int, float] | None]) -> Inside | None:
        """Return the deepest of the nodes found at the times, each with its depth, and the first of these times."""
        times = [sight.time for sight, one in zip(self.sights, found, strict=True) if one is not None]
        if not times:
            return None
        depth, time, node = max((one[1], -t, one[0]) for one, t in zip(filter(None, found), times, strict=True))
        return Inside(int(self.skins[body].nodes[node]) - self.model.bodies[body].start, depth, -time, times[0])

    def apart(self, contact: int) -> tuple[float, float, float] | None:
        """Return when a contact first presses at a distance, the distance of its surfaces, and the gap that it sees.

        The distance is more than the gap of the strongest point.
        """
        sides, points = list(self.model.case.contacts.values())[contact].sides, self.model.contact_points
        surfaces = [self.model.bodies[side.body].surface(side.region).surface for side in sides]
        for time, sight in enumerate(self.sights):
            force = np.where(points.contact == contact, sight.multiplier, 0.0)
            if not force.max(initial=0.0) > 0.0:
                continue
            point = int(force.argmax())
            nodes = self.shares.indices[self.shares.indptr[point] : self.shares.indptr[point + 1]]
            gap, moved = float(self.gaps[time][point]), [self.moved(one, time) for one in surfaces]
            allowed = abs(gap) + APART * float(points.facet[point])
            of_sides = [one.positions[np.isin(one.nodes, nodes)] for one in moved]
            if any(_is_within(at, one, allowed) for at, one in zip(of_sides, moved[::-1], strict=True)):
                continue
            least = min(_distance(*moved), _distance(*moved[::-1]))
            if least > allowed:
                return sight.time, least, gap
        return None


def _deepest(skin: Surface, target: Surface, candidates: Any) -> tuple[int, float] | None:
    """Return that of some nodes of a boundary which lies deepest inside a body with another one, and its depth."""
    low, high = target.positions.min(axis=0), target.positions.max(axis=0)
    (nodes,) = np.nonzero(candidates & ((skin.positions > low) & (skin.positions < high)).all(axis=1))
    if not len(nodes):
        return None
    facet, shares = target.nearest(skin.positions[nodes])
    corners = target.positions[target.facets[facet]]
    vector = skin.positions[nodes] - np.einsum("pa,pad->pd", shares, corners)
    depth = np.linalg.norm(vector, axis=1)
    least = TOLD * np.ptp(corners, axis=1).max(axis=1)
    deepest = [p for p in np.argsort(-depth).tolist() if depth[p] > least[p]]
    # All facets that meet at the nearest place look away from a point inside, also where they meet at an edge.
    meetings = target.facets_at(target.facets[facet[p]][shares[p] > EVEN] for p in deepest)
    for p, meeting in zip(deepest, meetings, strict=True):
        middle = np.full((meeting.size, target.facets.shape[1]), 1.0 / target.facets.shape[1])
        if (target.outward(meeting, middle) @ vector[p] < 0.0).all():
            return int(nodes[p]), float(depth[p])
    return None


def _is_within(at: Floats, surface: Surface, within: float) -> bool:
    """Return whether a surface is within a distance of one of a few points."""
    corners = surface.positions[surface.facets]
    low, high = corners.min(axis=1) - within, corners.max(axis=1) + within
    point, facet = np.nonzero(((at[:, None] >= low) & (at[:, None] <= high)).all(axis=2))
    return bool((places_on(at[point], corners[facet])[0] <= within).any())


def _distance(one: Surface, other: Surface) -> float:
    """Return the least distance of the nodes of a surface from another one."""
    facet, shares = other.nearest(one.positions)
    apart = one.positions - np.einsum("pa,pad->pd", shares, other.positions[other.facets[facet]])
    return float(np.linalg.norm(apart, axis=1).min())


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
