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
from percuss.methods.interfaces import Floats, Surface, Wall
from percuss.methods.interfaces.nearest import EVEN

NOT_DECLARED = "no contact is declared between them"
TOLD = 1e-3  # of a facet: a node that lies deeper inside another body is told
APART = 1e-2  # of a facet: a larger distance of surfaces that press is told; means over facets err by less
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
    """Return one sentence for each pair of ends of bars that will meet without a contact.

    The bodies are taken to keep their first velocities.
    """
    sentences: list[str] = []
    if not model.bodies.of_lines:
        return sentences
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
        if outcome.status == "unstable":
            return []
        return list(notes_of_solids(model, list(_sights(march, outcome)), outcome.histories["slid"]))
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


def notes_of_solids(model: Model, sights: Sequence[Sight], slid: Floats) -> Iterator[str]:
    """Yield notes on what the contact points of solids did not see.

    Parameters
    ----------
    model
        A model of solids.
    sights
        The model at some times.
    slid : (contacts, 2) array
        Largest slide of a point of each contact over its facet, and the time at which one first exceeded 1.
    """
    from scipy.sparse import csr_array

    points, contacts = model.contact_points, model.case.contacts
    shares: Any = csr_array((points.share, (points.point, points.node)), shape=(len(points), model.bodies.n_nodes))
    gaps = [points.gap + ((shares @ sight.displacement) * points.normal).sum(axis=1) for sight in sights]
    seeing = [(one.multiplier != 0.0) | (gap <= TOLD * points.facet) for one, gap in zip(sights, gaps, strict=True)]
    unseen = [abs(shares).T @ sees.astype(float) == 0.0 for sees in seeing]
    yield from _hidden_nodes(model, sights, unseen)
    for number, (name, spec) in enumerate(contacts.items()):
        if spec.wall is not None:
            continue
        first, second = (model.bodies[side.body].surface(side.region).surface for side in spec.sides)
        for sight, gap in zip(sights, gaps, strict=True):
            force = np.where(points.contact == number, sight.multiplier, 0.0)
            if not force.max(initial=0.0) > 0.0:
                continue
            strongest, moved = int(force.argmax()), (_moved(first, sight), _moved(second, sight))
            distance = min(_distance(*moved), _distance(*moved[::-1]))
            if distance > abs(gap[strongest]) + APART * points.facet[strongest]:
                yield (
                    f"contact '{name}' presses at time {sight.time:.6g} although its surfaces are {distance:.3g} apart "
                    f"(its points see {gap[strongest]:.3g}): {OF_THE_START}"
                )
                break
        if slid[number, 0] > 1.0:
            yield (
                f"contact '{name}' presses from time {slid[number, 1]:.6g} on at points that have slid along their "
                f"surface by more than a facet, by {slid[number, 0]:.3g} facets at most: {OF_THE_START}"
            )


def _hidden_nodes(model: Model, sights: Sequence[Sight], unseen: Sequence[Any]) -> Iterator[str]:
    """Yield a note for each body with nodes inside another one, or behind a wall, where no contact point sees them.

    Bodies that overlap at the start have no contact with each other, and nodes behind a wall at the start are left out.
    """
    contacts = model.case.contacts
    between = {frozenset(side.body for side in spec.sides): name for name, spec in contacts.items()}
    skins = {body.name: whole_surface(body.view, body.start) for body in model.bodies.values()}
    partners: list[tuple[str, str, str, Surface | Wall]] = [
        (body, f"inside '{other}'", between.get(frozenset((body, other)), ""), skins[other])
        for body, other in permutations(skins, 2)
    ]
    for name, wall in walls_of(model.case, model.bodies).items():
        partners.append((contacts[name].sides[0].body, f"behind the wall of contact '{name}'", name, wall))
    for body, where, contact, partner in partners:
        skin, least = skins[body], TOLD * model.bodies[body].shortest
        candidates = np.ones(len(skin.nodes), dtype=bool)
        if isinstance(partner, Wall):
            candidates = _behind(skin, partner) <= least
        elif _deepest(skin, partner, candidates) is not None:
            continue
        found: list[tuple[float, int, float]] = []  # depth, node and time
        for sight, hidden in zip(sights, unseen, strict=True):
            moved, seen = _moved(skin, sight), candidates & hidden[skin.nodes]
            if isinstance(partner, Wall):
                depths = np.where(seen, _behind(moved, partner), 0.0)
                deepest = (float(depths.max()), int(depths.argmax())) if depths.max() > least else None
            else:
                deepest = _deepest(moved, _moved(partner, sight), seen)
            found += [(*deepest, sight.time)] if deepest else []
        if found:
            depth, node, time = max(found)
            yield (
                f"node {skin.nodes[node] - model.bodies[body].start} of '{body}' lies {depth:.3g} {where} at time "
                f"{time:.6g}, with no force on it (from time {found[0][2]:.6g} on): {_why_not_seen(model, contact)}"
            )


def _why_not_seen(model: Model, contact: str) -> str:
    """Return why no contact point sees a node, and what to do."""
    if not contact:
        return f"{NOT_DECLARED}; declare one"
    sides = model.case.contacts[contact].sides
    if len(sides) == 1:
        return f"it is not in {sides[0]}. Give the contact a region that has it"
    return (
        f"the points of contact '{contact}', on {sides[0]}, do not see it. Name {sides[1]} first, try another pairing, "
        "or make the cells finer"
    )


def _moved(surface: Surface, sight: Sight) -> Surface:
    """Return a surface where it is at a time."""
    return surface._replace(positions=surface.positions + sight.displacement[surface.nodes])


def _behind(skin: Surface, wall: Wall) -> Floats:
    """Return how deep each node of a boundary lies behind a wall."""
    depth: Floats = (wall.point - skin.positions) @ wall.normal
    return depth


def _deepest(skin: Surface, target: Surface, candidates: Any) -> tuple[float, int] | None:
    """Return how deep one of some nodes of a boundary lies inside a body with another one, and which lies deepest."""
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
            return float(depth[p]), int(nodes[p])
    return None


def _distance(one: Surface, other: Surface) -> float:
    """Return the least distance of the nodes of a surface from another one."""
    facet, shares = other.nearest(one.positions)
    apart = one.positions - np.einsum("pa,pad->pd", shares, other.positions[other.facets[facet]])
    return float(np.linalg.norm(apart, axis=1).min())
