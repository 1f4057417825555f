"""Why the result of a run is in doubt: sentences for its notes, of which `check` tells those that can be foreseen.

Meshes may be in pieces or too stiff, and bodies of small strains must not turn. Pairing and normals of contacts are
those of the start, a contact knows its bodies at its points alone, and bodies without a contact do not know each other:
a run goes on with forces that no body would feel.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise, permutations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.case.quantities import percent
from percuss.certificate.verdict import SHARE_OF_CRITICAL_STEP
from percuss.contact.pairs import wall_of, walls_of
from percuss.contact.points import TOUCHING
from percuss.contact.sliding import points_that_move, slides, sliding, surfaces_of
from percuss.contact.walls import WallShape, displacements, round_or_moving
from percuss.march.recording import probe_nodes
from percuss.mesh.body import turn_of
from percuss.mesh.cells import cells_of, is_solid, pieces_of
from percuss.methods.interfaces import REFERENCE_CELLS
from percuss.methods.interfaces.body import some_at_a_time
from percuss.methods.interfaces.nearest import EVEN

if TYPE_CHECKING:
    from percuss.contact.model import Model
    from percuss.jsonable import Data, Entries
    from percuss.march.march import March, Outcome
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats, Integers, Surface

FEWER_STEPS = 0.7  # of those of the run, from which on a longer step is worth a word
SAME_FOR_ALL_CELLS = 1.2  # Courant number of the critical step up to which its cells are much alike
MOST_TURNED = 0.05  # rad, which stretches a body of small strains by 0.12 %
NEARLY_INCOMPRESSIBLE = 3.79  # modulus of longitudinal waves over Young's at a Poisson's ratio of .45
SLENDER = 5.0  # length over thickness of a body that is expected to bend
MOST_TOO_STIFF = 0.1  # in bending
SAME_LINE = 1e-6  # of the direction and of the length of a bar, to which two bars are on one line
NOT_DECLARED = "no contact is declared between them"
STOPS = 2.0  # damping times the step from which on a free node turns back
TOLD = 1e-3  # of a facet: a node that lies deeper inside another body is told
APART = 1e-2  # of a facet: a larger distance of surfaces that press is told; means over facets err by less
OF_THE_START = (
    "pairing and normals are those of the start. Do not trust the forces from then on: give the contact "
    "`sliding: large`, shorten the run, or let the bodies slide and turn less"
)
OF_FACETS = "its points do not see what lies between them. Do not trust the forces from then on: make the cells finer"


def doubts(march: March, outcome: Outcome, arrays: Entries) -> Iterator[str]:
    """Yield the notes on a run: meshes and motions of its bodies, and what its contacts did not see.

    Bodies that pass through each other are seen where their motion is recorded, and at the end of the run.
    """
    model, moved = march.model, outcome.final_displacement.reshape(-1, march.dim)
    for body in model.bodies.values():
        turn = turned_by(body, moved[body.start : body.stop]) if body.of_small_strains else 0.0
        yield from doubts_about(body, turn)
        if body.spec.damping is not None and (strength := body.spec.damping.mass * model.dt) > STOPS:
            yield (
                f"a node of body '{body.name}' that nothing pushes turns back in each step: its damping times the step "
                f"is {strength:.3g}, {STOPS:g} at most is right. Take a shorter step"
            )
    if model.bodies.of_lines:
        yield from _seen_of_bars(march, outcome, arrays)
    elif outcome.status != "unstable":
        sights = list(_sights(march, outcome))
        for body in model.bodies.values():
            notes = (_inside_out(body, one.displacement[body.start : body.stop], one.time) for one in sights)
            yield from filter(None, [next(filter(None, notes), "")])
        if outcome.done > 0:
            known = [one for one in sights if one.multiplier is not None]
            yield from _unseen_by_contacts(model, known, outcome.histories["slid"])


# -- meshes and motions of solids -------------------------------------------------------------------------------


def slow_step(model: Model, certificate: Data) -> Iterator[str]:
    """Yield that a far longer step would be stable, where one fast cell of a solid sets the Courant number."""
    critical, free = certificate["dt_critical"], certificate["dt_critical_free"]
    longest, alone = (free, " without contact") if critical is None else (critical, "")
    if certificate["stable"] != "yes" or longest in {None, 0.0, math.inf} or model.bodies.of_lines or model.multistage:
        return
    fast_cell = longest * model.bodies.omega > 2.0 * SAME_FOR_ALL_CELLS
    if fast_cell and model.dt < FEWER_STEPS * SHARE_OF_CRITICAL_STEP * longest:
        of_it = f"{model.courant:.3g} is {model.dt / longest:.3g} of the longest stable step{alone}"
        auto = f"`courant: auto` takes {percent(SHARE_OF_CRITICAL_STEP)} of that"
        yield f"one fast cell sets the Courant number: {of_it}, and {auto}"


def doubts_about(body: Body, turn: float) -> Iterator[str]:
    """Yield what is known against the mesh of a body, and against its material where it turns by an angle [rad]."""
    if not is_solid(body.spec.element):
        return
    counts = np.bincount(pieces_of(body.mesh))
    if counts.size > 1:
        yield (
            f"body '{body.name}' is in {counts.size} pieces without a common node, which move each for itself: the "
            f"smallest has {counts.min()} of {counts.sum()} cells"
        )
    if why := _why_too_stiff(body):
        yield why
    if body.of_small_strains and abs(turn) > MOST_TURNED:
        yield (
            f"The strains of body '{body.name}' are linear. Its turn of {abs(turn):.2g} rad is seen as a stretch of "
            f"{percent(math.hypot(1.0, turn) - 1.0, 2)}: the result is wrong. Use a material for large rotations."
        )


def _why_too_stiff(body: Body) -> str:
    """Return why the cells of a body are stiffer than the body itself; empty if no reason is known."""
    element, said = body.spec.element, f"body '{body.name}' is"
    if not getattr(element, "locks", False):
        return ""
    material = body.spec.material
    if material.state > 0:
        return (
            f"{said} of a material that flows without a change of volume, where {element.name} locks: it is too stiff"
        )
    if material.stress is not None and body.modulus / material.modulus > NEARLY_INCOMPRESSIBLE:
        return f"{said} almost incompressible, where {element.name} locks: it is too stiff"
    long = _length_of_cells_over_thickness(body)
    # Cells that cannot bend shear instead: G (l/h)^2 / E of plane stress, and G / E is a quarter at least.
    share = long**2 / 4.0
    if not share > MOST_TOO_STIFF:
        return ""
    return (
        f"{said} slender, and its cells are {long:.2g} times as long as it is thick: if it bends, {element.name} "
        f"locks, and it is too stiff by {percent(share, 2)} or more"
    )


def _length_of_cells_over_thickness(body: Body) -> float:
    """Return the mean length of cells along a body over its thickness; 0 of a body that is not slender."""
    nodes = body.mesh.nodes - body.mesh.nodes.mean(axis=0)
    along = nodes @ np.linalg.eigh(nodes.T @ nodes)[1]  # the last axis is that of its length
    extents = np.ptp(along, axis=0)
    if getattr(body.spec.element, "about_axis", False) or extents[-1] < SLENDER * extents.min():
        return 0.0
    return float(np.ptp(along[cells_of(body.mesh), -1], axis=1).mean() / extents.min())


def turned_by(body: Body, displacement: Floats) -> float:
    """Return the angle by which displacements of its nodes, (nodes, dim), turn a body in the mean [rad]."""
    return float(np.linalg.norm(turn_of(body.mass, body.mesh.nodes - body.centre, displacement)))


def _inside_out(body: Body, displacement: Floats, time: float) -> str:
    """Return which cells of a solid a displacement of its nodes turns inside out; empty if none."""
    ((kind, cells),) = body.mesh.cells.items()
    nodes, turned = body.mesh.nodes + displacement, np.zeros(len(cells), dtype=bool)
    for these in some_at_a_time(len(cells)):
        turned[these] = ~(_spans(nodes[cells[these]], REFERENCE_CELLS[kind].beside) > 0.0).all(axis=1)
    if not turned.any():
        return ""
    place = ", ".join(f"{value + 0.0:.6g}" for value in nodes[cells[turned.argmax()]].mean(axis=0))
    return (
        f"body '{body.name}' has cells turned inside out, {turned.sum()} of {turned.size} at t = {time:.4g}, the "
        f"first about ({place}): no body moves so. Take a lower velocity or load, or a stiffer material"
    )


def _spans(corners: Floats, beside: Integers) -> Floats:
    """Return what the edges at each corner of cells span, an area or a volume, (cells, corners)."""
    x = np.moveaxis(corners, 2, 0)
    a, b, *c = (x[:, :, beside[:, k]] - x[:, :, : len(beside)] for k in range(beside.shape[1]))
    spans: Floats = a[0] * b[1] - a[1] * b[0]  # quicker than the determinants of LAPACK
    if c:
        spans = spans * c[0][2] + (a[1] * b[2] - a[2] * b[1]) * c[0][0] + (a[2] * b[0] - a[0] * b[2]) * c[0][1]
    return spans


# -- ends of bars -----------------------------------------------------------------------------------------------


class End(NamedTuple):
    """An end of a bar: its place along the line of the bar, its address in a case, its node in the model, the bar."""

    place: float
    name: str
    node: int
    body: Body


def _undeclared_pairs(model: Model) -> Iterator[tuple[End, End, float, Floats]]:
    """Yield the ends of neighbouring bars on one line that face each other without a contact, their gap, and the line.

    Ends that both have a contact with another partner are left out: several experiments may lie on one line.
    """
    lines: dict[bytes, tuple[Floats, list[list[End]]]] = {}
    for body in model.bodies.values() if model.bodies.of_lines else ():
        direction, nodes, length = body.mesh.direction, body.mesh.nodes, float(body.mesh.lengths.sum())
        axis = direction * np.sign(direction[np.abs(direction) > SAME_LINE][0])
        beside = nodes[0] - (nodes[0] @ axis) * axis
        of_line = np.round(np.append(axis, beside / length) / SAME_LINE) + 0.0  # which makes 0 of -0
        found = ((name, region.nodes[0]) for name, region in body.mesh.regions.items())
        ends = sorted(End(float(nodes[n] @ axis), f"{body.name}.{name}", body.start + n, body) for name, n in found)
        lines.setdefault(of_line.tobytes(), (axis, []))[1].append(ends)
    in_contact = set(model.contact_points.node.tolist())
    for axis, bars in lines.values():
        for (_, end), (other, _) in pairwise(sorted(bars)):
            gap, touching = other.place - end.place, TOUCHING * end.body.shortest
            if gap >= -touching and not {end.node, other.node} <= in_contact:
                yield end, other, 0.0 if gap <= touching else gap, axis


def expected_meetings(model: Model) -> Iterator[str]:
    """Yield one sentence for each pair of ends of bars that will meet without a contact at their first velocities."""
    for end, other, gap, axis in _undeclared_pairs(model):
        closing = float((end.body.velocity - other.body.velocity) @ axis)
        if gap == 0.0:
            yield f"{end.name} and {other.name} touch, and {NOT_DECLARED}"
        elif closing * model.steps * model.dt > gap:
            yield (
                f"{end.name} and {other.name} will meet at time {gap / closing:.6g} if their bodies keep their first "
                f"velocities, and {NOT_DECLARED}"
            )


def _seen_of_bars(march: March, outcome: Outcome, arrays: Entries) -> Iterator[str]:
    """Yield notes on bars that passed through each other, and on contacts whose ends had slid off each other."""
    model, points = march.model, march.model.contact_points
    probes = {node: place for place, ((node, _), *_) in enumerate(probe_nodes(model))}
    last = outcome.final_displacement.reshape(1, -1, march.dim)

    def apart(first: int, second: int) -> Floats:
        """Return how far two nodes moved apart, (T, dim): over the run where that is recorded, else at its end."""
        recorded = first in probes and second in probes
        moved, places = (arrays["displacement"], probes) if recorded else (last, {first: first, second: second})
        return np.asarray(moved[:, places[second]] - moved[:, places[first]])

    for end, other, gap, axis in _undeclared_pairs(model):
        depth = -float((gap + apart(end.node, other.node) @ axis).min(initial=0.0))
        if depth > TOUCHING * end.body.shortest:
            yield f"{end.name} passes through {other.name}, by {depth:.3g} at most: {NOT_DECLARED}"
    for p in np.flatnonzero(~points.at_wall).tolist() if model.dim > 1 and outcome.done > 0 else ():
        normal, nodes = points.normal[p], points.nodes_of(p)
        relative = apart(*nodes)
        beside = np.linalg.norm(relative - np.outer(relative @ normal, normal), axis=1)
        pressing = arrays["contact_force"][-beside.size :, p] != 0.0
        # The faces are taken as squares: they have no point in common beyond half the sum of their sides.
        width = 0.5 * sum(model.bodies.at(node).spec.section ** 0.5 for node in nodes)
        if (off := np.flatnonzero(pressing & (beside > width))).size:
            yield (
                f"contact '{points.names[p]}' presses from time {arrays['time'][-beside.size :][off[0]]:.6g} on "
                f"although its ends have slid off each other: they are {beside[off].max():.3g} apart sideways, and "
                f"{width:.3g} wide; a contact of two ends knows only their distance along its normal"
            )


# -- contacts of solids -----------------------------------------------------------------------------------------


class Sight(NamedTuple):
    """The model at one time: displacement of all nodes, (nodes, dim), and multiplier of each contact point, (P,).

    The multipliers are None where the case does not record them.
    """

    time: float
    displacement: Floats
    multiplier: Any


def _sights(march: March, outcome: Outcome) -> Iterator[Sight]:
    """Yield the snapshots of a run, and its end."""
    model, record = march.model, outcome.record
    shape, pressures = model.bodies.nodes.shape, outcome.histories.get("field_pressure", np.zeros((0, 0)))
    for n in range(-(-outcome.done // record.field_every) if record.field_every else 0):
        known = pressures[n] * model.contact_points.weight if pressures.size else None
        yield Sight(n * record.field_every * model.dt, record.field[n].reshape(shape), known)
    yield Sight(outcome.done * model.dt, outcome.final_displacement.reshape(shape), outcome.multipliers)


def _unseen_by_contacts(model: Model, sights: Sequence[Sight], slid: Floats) -> Iterator[str]:
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
    points, contacts, unseen, gaps = model.contact_points, model.case.contacts, [], []
    for sight in sights:
        seen = _seen(model, sight)
        sees = (sight.multiplier != 0.0) | (seen.gap <= TOLD * points.facet)
        touched = np.bincount(seen.node, seen.share * sees[seen.point], model.bodies.n_nodes)
        unseen.append(touched == 0.0)
        gaps.append(seen.gap)
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
                    f"(its points see {gap[strongest]:.3g}): {OF_FACETS if slides(spec) else OF_THE_START}"
                )
                break
        if slid[number, 0] > 1.0:
            yield (
                f"contact '{name}' presses from time {slid[number, 1]:.6g} on at points that have slid along their "
                f"surface by more than a facet, by {slid[number, 0]:.3g} facets at most: {OF_THE_START}"
            )


class Seen(NamedTuple):
    """What the contact points of a model see at one time: the nodes of each, its share in each of them, and its gap."""

    node: Integers  # (E,)
    point: Integers  # (E,)
    share: Floats  # (E,) without its sign
    gap: Floats  # (P,)


def _seen(model: Model, sight: Sight) -> Seen:
    """Return what contact points see at one time, of surfaces that slide far by what they meet then."""
    points = model.contact_points
    along = np.vecdot(points.share[:, None] * sight.displacement[points.node], points.normal[points.point])
    gap, stays = points.gap + np.bincount(points.point, along, len(points)), ~points.slides[points.point]
    parts = [(points.node[stays], points.point[stays], np.abs(points.share[stays]))]
    for name, spec in sliding(model.case).items():
        first, *others = (_moved(surface, sight) for surface in surfaces_of(spec, model.bodies))
        met = others[0] if others else _wall_at(model, name, wall_of(spec, first), sight)
        paired: Any = points_that_move(spec.pairing, first, met)
        where = np.flatnonzero(points.of_contact(name))
        gap[where] = paired.gap
        share = np.linalg.norm(paired.value, axis=1)
        parts.append((paired.node, np.repeat(where, np.diff(paired.start)), share))
    node, point, shares = (np.concatenate(one) for one in zip(*parts, strict=True))
    return Seen(node, point, shares, gap)


def _hidden_nodes(model: Model, sights: Sequence[Sight], unseen: Sequence[Any]) -> Iterator[str]:
    """Yield a note for each body with nodes inside another one, or behind a wall, where no contact point sees them.

    Bodies that overlap at the start, or lie behind a wall there, have no contact with each other.
    """
    contacts = model.case.contacts
    between = {frozenset(side.body for side in spec.sides): name for name, spec in contacts.items()}
    skins = {body.name: body.boundary for body in model.bodies.values()}
    partners: list[tuple[str, str, str, Surface | WallShape]] = [
        (body, f"inside '{other}'", between.get(frozenset((body, other)), ""), skins[other])
        for body, other in permutations(skins, 2)
    ]
    for name, wall in walls_of(model.case, model.bodies).items():
        partners.append((contacts[name].sides[0].body, f"behind the wall of contact '{name}'", name, wall))
    for body, where, contact, partner in partners:
        skin = skins[body]
        if _deepest(skin, partner, np.ones(len(skin.nodes), dtype=bool)):
            continue
        found: list[tuple[float, int, float]] = []  # depth, node and time
        for sight, hidden in zip(sights, unseen, strict=True):
            there = _now(model, contact, partner, sight)
            if deepest := _deepest(_moved(skin, sight), there, hidden[skin.nodes]):
                found.append((*deepest, sight.time))
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


def _now(model: Model, contact: str, target: Surface | WallShape, sight: Sight) -> Surface | WallShape:
    """Return a surface, or the wall of a contact, where it is at a time."""
    return _wall_at(model, contact, target, sight) if isinstance(target, WallShape) else _moved(target, sight)


def _wall_at(model: Model, contact: str, wall: WallShape, sight: Sight) -> WallShape:
    """Return the wall of a contact where it is at a time."""
    _, load = round_or_moving(model.case).get(contact, (wall, None))
    step = np.array([round(sight.time / model.dt)])
    return wall.moved(displacements(load, step, model.dt, model.dim)[0])


def _deepest(skin: Surface, target: Surface | WallShape, candidates: Any) -> tuple[float, int] | None:
    """Return how deep one of some nodes of a boundary lies inside a body or behind a wall, and which lies deepest."""
    if isinstance(target, WallShape):
        behind = np.where(candidates, -target.meet(skin.positions)[0], 0.0)
        node = int(behind.argmax())
        facets = np.ptp(skin.positions[skin.facets], axis=1)
        return (float(behind[node]), node) if behind[node] > TOLD * facets.max() else None
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
    from scipy.spatial import cKDTree

    corners = other.positions[other.facets]
    middles = corners.mean(axis=1)
    far = cKDTree(middles).query(one.positions)[0]  # no node is farther away than that, or nearer by more than a radius
    near = one.positions[far <= far.min() + np.linalg.norm(corners - middles[:, None], axis=2).max()]
    facet, shares = other.nearest(near)
    apart = near - np.einsum("pa,pad->pd", shares, corners[facet])
    return float(np.linalg.norm(apart, axis=1).min())
