"""Friction: forces of contact points along the surfaces, which stick or slide.

A point has a row of T for each direction along the surfaces: the shares of its nodes times that tangent. Its
multipliers follow from a line, as that of the normal does, and are then shortened to the largest force that the
friction allows. Normal and tangential rows are solved together, point by point, in sweeps that move velocities: S is
not built. Where a point sticks with a stiffness, its elastic slip s is a state: ``lambda_t = -s / sigma_t``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, Self, cast

import numpy as np

from percuss.contact.features import Feature
from percuss.contact.frictions import frictional, frictions_of, tangents_of, with_stick
from percuss.contact.moving_rows import mobilities
from percuss.contact.points import FROM_LINE, Points
from percuss.contact.walls import round_or_moving
from percuss.record_arrays import Records, Row, empty_records, record_array
from percuss.step.actions import AFTER_CONTACT, BEFORE_ACCOUNT, CONTACT_EQUATION, LAWS, RECORD, Action
from percuss.step.equation import is_active, right_side
from percuss.step.loads import react
from percuss.step.part import Part, Setting
from percuss.step.records import SHARE, Loads

if TYPE_CHECKING:
    from percuss.contact.frictions import BoundFriction
    from percuss.contact.model import Model
    from percuss.methods.interfaces import Array, Floats, Friction, Integers

OPEN, STICKS, SLIDES, ALONE = 0, 1, 2, 3  # states of a point; it is alone where it meets nothing
# A contact point with friction.
TANGENT = np.dtype(
    [
        # what no step changes
        ("point", "i8"),  # index in the loop
        ("number", "i8"),  # in the model
        ("compliance", "f8"),  # of stick, with the area of which the law is bound
        ("response", "f8"),  # w_t, the factor of S
        ("diagonal", "f8"),  # largest eigenvalue of the block of S of its rows
        ("predicted", "i8"),  # 1 if slip is taken after the bulk update, 0 if at t_n
        ("moves", "i8"),  # 1 if a step writes its row
        # what a step changes
        ("width", "i8"),  # number of its nodes
        ("free", "i8"),  # 1 if a force moves each of its nodes in its own direction
        ("sigma", "f8"),  # compliance of stick
        ("rate", "f8"),  # slip rate at n - 1/2
        ("state", "i8"),  # OPEN, STICKS or SLIDES
        ("held", "f8"),  # minus the product of its force along the surfaces and its elastic slip after the step
        ("before", "f8"),  # the same of the last step
        ("path", "f8"),  # length of its slide so far while it presses
    ]
)


# A node of a point: index of its first boundary degree of freedom, its share in the motion of the point relative to
# what it meets, and that share over its mass, of a node that nothing holds.
NODE = np.dtype([("place", "i8"), ("share", "f8"), ("response", "f8")])


class Rows(NamedTuple):
    """All contact points of a step with their rows of N and T, and what friction sums up."""

    points: Points
    boundary: Records  # percuss.step.records.BOUNDARY_DOF
    loads: Loads
    now: Records  # percuss.step.records.NOW
    totals: Records  # percuss.step.records.TOTAL
    tangents: Records  # (F,) TANGENT
    nodes: Records  # (F, nodes of a point) NODE
    seen: Floats  # (dim,) motion of a point relative to what it meets
    change: Floats  # (dim,) of the force of a point, or its motion after the bulk update
    along: Floats  # (F, dim - 1, dim) unit tangents
    pushed: Floats  # (boundary,) accelerations by the contact forces found so far
    multiplier: Floats  # (F, dim - 1) of the rows of T
    rate: Floats  # (F, dim - 1) slip rate at n - 1/2
    slip: Floats  # (F, dim - 1) elastic slip
    trial: Floats  # (F, dim - 1) slip without the forces of the step
    last: Floats  # (F, dim - 1) multipliers before the present sweep
    impulse: Floats  # (points of the model, dim) along the surfaces
    moving: Integers  # index in the loop of each point whose rows a step writes
    turned: Floats  # (F, dim) normals across which the tangents are
    mobility: Floats  # (nodes, dim, dim) acceleration by a force
    loose: Integers  # (nodes,) 1 where nothing holds the node
    force: Floats  # (nodes * dim) on nodes along the surfaces, and all of the points whose rows move
    held: Records  # SHARE, of supports and drives: the node, as a point, has a force
    walls: Integers  # (W, 2) first boundary degree of freedom and contact of each wall that is round or moves
    pushes: Floats  # (nodes * dim) impulse of the points whose rows move
    wall_work: Floats  # (contacts,) of the motion of walls so far
    work: Floats  # (contacts,) of friction so far
    stored: Floats  # (contacts,) energy that stick stores


class Group(NamedTuple):
    """The points of one friction, or those without any."""

    rows: Rows
    which: Integers  # index in the loop of each point
    first: int  # number of its first tangent
    friction: Any  # what the kernels of the friction read
    before: Floats  # (points, state)
    after: Floats


class History(NamedTuple):
    """Where friction is recorded."""

    rows: Rows
    work: Floats  # (R, contacts)
    stored: Floats  # (R, contacts)
    slid: Floats  # (R, contacts) longest slide of a point so far
    sticking: Floats  # (R, contacts) area
    sliding: Floats  # (R, contacts) area
    force: Floats  # (R, contacts, dim) on the first body
    wall: Floats  # (R, contacts) work of the motion of walls
    every: int  # steps between two snapshots, 0 for none
    order: Integers  # (points of the loop,) number in the model
    # of snapshots, with the points as in the model
    traction: Floats  # (snapshots, points, dim) on the first body
    slip: Floats  # (snapshots, points) length of the slide so far
    status: Floats  # (snapshots, points) OPEN, STICKS, SLIDES or ALONE


class Frictions(Part[History]):
    """The part of a step with friction.

    Parameters
    ----------
    data
        What is recorded, with all rows.
    groups
        The points of each friction, and last those without any, whose friction is None.
    """

    def __init__(self, data: History, groups: list[tuple[Group, Friction | None]]) -> None:
        super().__init__(data)
        self.groups = groups

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None without friction where all rows stay."""
        bound = frictions_of(setting.model)
        if not bound and not setting.model.contact_points.slides.any():
            return None
        history = _history(setting, bound, before.data if before is not None else None)
        return cls(history, list(_groups(setting, bound, history.rows, before.groups if before is not None else [])))

    def changed(self, action: Action) -> Action | None:
        """Return no contact equation: friction solves it with its own rows."""
        return None if action.place == CONTACT_EQUATION else action

    def actions(self) -> Iterator[Action]:
        """Yield the actions of a step."""
        rows = self.data.rows
        if rows.moving.size:
            yield Action(LAWS, turn, rows, order=1)
        yield Action(LAWS, begin, rows, order=1)
        for group, friction in self.groups:
            if friction is None:
                yield Action(CONTACT_EQUATION, sweep_normals, group)
                continue
            slots: dict[Any, Any] = {bound_of: type(friction).bound}
            about: Any = {"of_plugin": True, "allocates": friction.allocates, "name": f"friction {friction.name}"}
            yield Action(CONTACT_EQUATION, sweep, group, slots, **about)
            if friction.state:
                slots = {renew: type(friction).renew}  # type: ignore[attr-defined]
                yield Action(AFTER_CONTACT, renew_states, group, slots, order=1, **about)
        yield Action(AFTER_CONTACT, push_along, rows)
        if rows.moving.size or rows.held.size:
            yield Action(AFTER_CONTACT, push_nodes, rows, order=1)
        yield Action(BEFORE_ACCOUNT, account_for, rows)
        yield Action(RECORD, record, self.data)
        if self.data.traction.size:
            yield Action(BEFORE_ACCOUNT, record_points, self.data, order=1)

    def changing_arrays(self) -> list[Array]:
        """Return the forces, slips, sums and states of the points."""
        rows = self.data.rows
        own = [rows.tangents, rows.multiplier, rows.slip, rows.impulse, rows.work, rows.stored]
        own += [rows.along, rows.turned, rows.pushes, rows.wall_work]
        return own + [group.before for group, _ in self.groups if group.before.size]

    def results(self) -> Mapping[str, Floats]:
        """Return works, energies, slides, areas and forces of the contacts."""
        data = self.data
        return {
            "friction_work": data.work,
            "friction_stored": data.stored,
            "contact_slip": data.slid,
            "sticking_area": data.sticking,
            "sliding_area": data.sliding,
            "contact_force_vector": data.force,
            **({"wall_work": data.wall} if len(data.rows.walls) else {}),
            "point_traction": data.traction,
            "point_slip": data.slip,
            "point_status": data.status,
        }

    def sums(self) -> Mapping[str, Floats]:
        """Return the impulses along the surfaces, (P, dim), and those on boundary nodes of points whose rows move."""
        return {"friction_impulse": self.data.rows.impulse, "pushes": self.data.rows.pushes}


# ------------------------------------------------------------------------------------------------------------ its data


def _history(setting: Setting, bound: list[BoundFriction], before: History | None) -> History:
    model, step = setting.model, setting.step
    order, points = np.array(setting.order, dtype=np.int64), model.contact_points
    where = np.concatenate([np.zeros(0, dtype=np.int64), *(one.where for one in bound)])
    along, count, dim = tangents_of(points.normal[where]), len(where), model.dim
    constraints = [model.loads.constraints[k] for k in model.active_constraints(setting.midpoint)]
    tangents = empty_records(count, TANGENT)
    tangents["point"], tangents["number"] = np.argsort(order)[where], where
    for name in ("compliance", "response", "predicted"):
        tangents[name] = np.concatenate([np.zeros(0), *(getattr(one, name) for one in bound)])
    tangents["sigma"] = tangents["compliance"]
    tangents["moves"] = points.slides[where]
    tangents["width"] = points.count[where]
    most = int(points.count[where].max(initial=0))
    held = [(i, setting.place[one.node], 1.0) for i, one in enumerate(constraints) if one.node in setting.place]
    mobility = mobilities(model, setting.place, setting.midpoint)
    loose = np.ones(len(mobility), dtype=np.int64)
    loose[[place // dim for _, place, _ in held]] = 0
    contacts, moved = len(model.case.contacts), round_or_moving(model.case)
    numbers = [number for number, name in enumerate(model.case.contacts) if name in moved]
    walls = [((len(setting.place) + k) * dim, number) for k, number in enumerate(numbers)]
    records = setting.record.energy.size
    per_axis = {name: np.zeros((count, dim - 1)) for name in ("multiplier", "rate", "slip", "trial", "last")}
    rows_now = Rows(
        step.points, step.boundary, step.loads, step.now, step.totals, tangents,
        cast("Records", empty_records(count * most, NODE).reshape(count, most)), np.zeros(dim), np.zeros(dim), along,
        np.zeros(step.boundary.size), **per_axis, impulse=np.zeros((len(points), dim)), work=np.zeros(contacts),
        stored=np.zeros(contacts), moving=np.flatnonzero(points.slides[order]), turned=points.normal[where],
        mobility=mobility, loose=loose, force=np.zeros(mobility.size // dim), held=record_array(held, SHARE),
        pushes=np.zeros(mobility.size // dim), wall_work=np.zeros(contacts),
        walls=np.array(walls, dtype=np.int64).reshape(-1, 2),
    )  # fmt: skip
    for j in range(count):
        write_nodes(rows_now, j)
    if before is not None:
        for name in ("sigma", "rate", "state", "held", "before", "path"):
            tangents[name] = before.rows.tangents[name]
        names = ("multiplier", "slip", "impulse", "work", "stored", "along", "turned", "pushes", "wall_work")
        kept = {name: getattr(before.rows, name) for name in names}
        return before._replace(rows=rows_now._replace(**kept))
    empty = np.full((records, contacts), np.nan)
    copies = (empty, empty.copy(), empty.copy(), empty.copy(), empty.copy())
    snapshots = setting.record.field.shape[0] if model.case.record.pressure else 0
    force, traction = np.full((records, contacts, dim), np.nan), np.full((snapshots, len(points), dim), np.nan)
    of_points = np.full((snapshots, len(points)), np.nan)
    return History(
        rows_now, *copies, force, empty.copy(), setting.record.field_every, order, traction, of_points,
        of_points.copy(),
    )  # fmt: skip


def _groups(
    setting: Setting, bound: list[BoundFriction], rows: Rows, before: list[tuple[Group, Friction | None]]
) -> Iterator[tuple[Group, Friction | None]]:
    """Yield the points of each friction, and those without any."""
    loop, first = np.argsort(np.array(setting.order, dtype=np.int64)), 0
    for k, one in enumerate(bound):
        states = np.zeros((one.where.size, one.friction.state))
        known = before[k][0].before if before else states
        yield Group(rows, loop[one.where], first, one.data, known, states.copy()), one.friction
        first += one.where.size
    others = np.setdiff1d(np.arange(loop.size), rows.tangents["point"])
    yield Group(rows, others, first, (), np.zeros((0, 0)), np.zeros((0, 0))), None


# ------------------------------------------------------------------------------------------------------------- kernels


def bound_of(friction: object, point: int, force: float, rate: float, before: Floats) -> float:
    """Return the largest force of a point along the surfaces (slot for the kernel of the friction)."""
    raise NotImplementedError


def renew(friction: object, point: int, force: float, rate: float, before: Floats, after: Floats) -> None:
    """Write the state variables of a point after a step (slot for the kernel of the friction)."""
    raise NotImplementedError


def turn(rows: Rows, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Turn the tangents of points whose normals have turned, by the least rotation, and write their nodes.

    The components of forces and slips along them stay as they are, and so do their lengths.
    """
    points, axes, dim = rows.points, rows.slip.shape[1], rows.turned.shape[1]
    for j in range(rows.tangents.size):
        tangent = rows.tangents[j]
        row, cosine = points.row[tangent.point], 1.0
        if tangent.moves == 0:
            continue
        tangent.width = (row.stop - row.start) // dim
        if tangent.width == 0:  # it meets nothing, and moves no node
            continue
        for d in range(dim):
            cosine += rows.turned[j, d] * points.normal[tangent.point, d]
        for k in range(axes):
            off, square = 0.0, 0.0
            for d in range(dim):
                off += rows.along[j, k, d] * points.normal[tangent.point, d]
            for d in range(dim):
                both = rows.turned[j, d] + points.normal[tangent.point, d]
                rows.along[j, k, d] -= off / cosine * both if cosine > 0.0 else 0.0
                square += rows.along[j, k, d] * rows.along[j, k, d]
            for d in range(dim):
                rows.along[j, k, d] /= np.sqrt(square)
        for d in range(dim):
            rows.turned[j, d] = points.normal[tangent.point, d]
        tangent.sigma = tangent.compliance * (points.law[tangent.point].weight / row.weight)
        write_nodes(rows, j)


def write_nodes(rows: Rows, j: int) -> None:
    """Write the nodes of a point from its row of N, and the largest eigenvalue of the block of S of its tangents."""
    tangent, axes, dim = rows.tangents[j], rows.slip.shape[1], rows.turned.shape[1]
    start, one, other = rows.points.row[tangent.point].start, rows.along[j, 0], rows.along[j, axes - 1]
    first, cross, last = 0.0, 0.0, 0.0
    tangent.free = 1
    for k in range(tangent.width):
        place, share = rows.points.entries[start + k * dim].place, 0.0
        for d in range(dim):
            share += rows.points.entries[start + k * dim + d].normal * rows.turned[j, d]
        node, mobility = rows.nodes[j, k], rows.mobility[place // dim]
        node.place, node.share, node.response = place, share, share * mobility[0, 0]
        if rows.loose[place // dim] == 0:
            tangent.free = 0
        for c in range(dim):
            for d in range(dim):
                first += share * share * one[c] * mobility[c, d] * one[d]
                cross += share * share * one[c] * mobility[c, d] * other[d]
                last += share * share * other[c] * mobility[c, d] * other[d]
    tangent.diagonal = 0.5 * (first + last) + np.sqrt(0.25 * (first - last) * (first - last) + cross * cross)
    if axes == 1:
        tangent.diagonal = first


def push_nodes(rows: Rows, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Let supports and walls react to the forces along the surfaces, and to all of the points whose rows move.

    The impulses of the latter on their nodes are added up.
    """
    now, dim = rows.now[0], rows.turned.shape[1]
    for i in range(rows.force.size):
        rows.force[i] = 0.0
    for k in range(rows.moving.size):
        i = rows.moving[k]
        row, force = rows.points.row[i], rows.points.state[i].multiplier
        for e in range(row.start, row.stop):
            rows.force[rows.points.entries[e].place] += force * rows.points.entries[e].normal
    force_along(rows, 1)
    for i in range(rows.force.size):
        rows.pushes[i] += now.dt * rows.force[i]
    force_along(rows, 0)
    work = 0.0
    for i in range(rows.held.size):
        share, along = rows.held[i], 0.0
        for d in range(dim):
            along += rows.loads.axes[rows.loads.constraints[share.hold].axis + d] * rows.force[share.point + d]
        work += react(rows.loads, share, along, rows.boundary, now)
    for w in range(len(rows.walls)):
        power = 0.0
        for k in range(rows.walls[w, 0], rows.walls[w, 0] + dim):
            power -= rows.force[k] * (rows.boundary[k].old_v + rows.boundary[k].new_v)
        rows.wall_work[rows.walls[w, 1]] += 0.5 * now.dt * power
        work += power
    rows.totals[0].work_of_parts += 0.5 * now.dt * work


def force_along(rows: Rows, moves: int) -> None:
    """Add the forces along the surfaces of points whose rows move, or stay, to those of their nodes."""
    for j in range(rows.tangents.size):
        if rows.tangents[j].moves == moves:
            set_force(rows, j)
            for k in range(rows.tangents[j].width):
                node = rows.nodes[j, k]
                for d in range(rows.change.size):
                    rows.force[node.place + d] += node.share * rows.change[d]


def set_force(rows: Rows, j: int) -> None:
    """Set `change` to the force of a point along the surfaces."""
    for d in range(rows.change.size):
        rows.change[d] = 0.0
        for k in range(rows.slip.shape[1]):
            rows.change[d] += rows.multiplier[j, k] * rows.along[j, k, d]


def component(rows: Rows, j: int, k: int, vector: Floats) -> float:
    """Return the component of a vector along one of the tangents of a point."""
    total = 0.0
    for d in range(vector.size):
        total += rows.along[j, k, d] * vector[d]
    return total


def begin(rows: Rows, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Begin the sweeps of a step with the multipliers of the last one; find slips and slip rates without new forces."""
    points, dt = rows.points, rows.now[0].dt
    for i in range(rows.pushed.size):
        rows.pushed[i] = 0.0
    for i in range(points.law.size):
        state = points.state[i]
        if points.law[i].source == FROM_LINE and not is_active(points.law[i], state):
            state.multiplier = 0.0
        push_by(rows.pushed, points.entries, points.row[i].start, points.row[i].stop, state.multiplier)
    for j in range(rows.tangents.size):
        tangent = rows.tangents[j]
        square = 0.0
        see_rates(rows, j)
        for k in range(rows.slip.shape[1]):
            rate, predicted = component(rows, j, k, rows.seen), component(rows, j, k, rows.change)
            square += rate * rate
            rows.rate[j, k] = rate
            rows.trial[j, k] = rows.slip[j, k] + dt * (predicted if tangent.predicted == 1 else rate)
        set_force(rows, j)
        push_point(rows, j)
        tangent.rate = np.sqrt(square)
        tangent.before = tangent.held


def see_rates(rows: Rows, j: int) -> None:
    """Set `seen` and `change` to the velocity of a point relative to what it meets, before and after the update."""
    for d in range(rows.seen.size):
        rows.seen[d], rows.change[d] = 0.0, 0.0
        for k in range(rows.tangents[j].width):
            q, share = rows.boundary[rows.nodes[j, k].place + d], rows.nodes[j, k].share
            rows.seen[d] += share * q.old_v
            rows.change[d] += share * q.new_v


def push_by(pushed: Floats, entries: Records, start: int, stop: int, force: float) -> None:
    """Add the accelerations by a force on the entries of a row."""
    if force != 0.0:
        for e in range(start, stop):
            pushed[entries[e].place] += entries[e].response * force


def along(pushed: Floats, entries: Records, start: int, stop: int) -> float:
    """Return the acceleration of what a row measures."""
    total = 0.0
    for e in range(start, stop):
        total += entries[e].normal * pushed[entries[e].place]
    return total


def sweep_normals(group: Group, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Sweep once over the normal rows of points without friction."""
    for j in range(group.which.size):
        press(group.rows, group.which[j], False)


def sweep(group: Group, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Sweep once over the points of one friction, of each the normal row first."""
    rows = group.rows
    for j in range(group.which.size):
        i, t = group.which[j], group.first + j
        free = rows.tangents[t].free == 1
        if free:  # its tangents do not see its own normal force
            see_point(rows, t)
        press(rows, i, free)
        if not free:
            see_point(rows, t)
        force, limit = rows.points.state[i].multiplier, 0.0
        if force > 0.0:
            limit = bound_of(group.friction, j, force, rows.tangents[t].rate, group.before[j])
            if not limit >= 0.0:
                raise ValueError("the largest force of a point along the surfaces is negative, or no number")
        stick_or_slide(rows, t, limit)
        push_point(rows, t)


def see_point(rows: Rows, j: int) -> None:
    """Find the acceleration of a point relative to what it meets, by the contact forces found so far."""
    for d in range(rows.seen.size):
        rows.seen[d] = 0.0
        rows.change[d] = 0.0
    for k in range(rows.tangents[j].width):
        node = rows.nodes[j, k]
        for d in range(rows.seen.size):
            rows.seen[d] += node.share * rows.pushed[node.place + d]


def push_point(rows: Rows, j: int) -> None:
    """Add the accelerations by a change of the force of a point."""
    for k in range(rows.tangents[j].width):
        node = rows.nodes[j, k]
        for d in range(rows.change.size):
            rows.pushed[node.place + d] += moved(rows, node, d)


def moved(rows: Rows, node: Row, d: int) -> float:
    """Return a component of the acceleration of a node by a change of the force of its point."""
    r, total = node.place // rows.change.size, 0.0
    if rows.loose[r] == 1:
        return node.response * rows.change[d]  # type: ignore[no-any-return]
    for c in range(rows.change.size):
        total += rows.mobility[r, d, c] * rows.change[c]
    return node.share * total  # type: ignore[no-any-return]


def press(rows: Rows, i: int, free: bool) -> None:
    """Find the normal multiplier of a point, with all other multipliers as they are; `free` as of `TANGENT`."""
    points, now = rows.points, rows.now[0]
    law, row, state = points.law[i], points.row[i], points.state[i]
    before = state.multiplier
    if law.source == FROM_LINE and is_active(law, state):
        residual = right_side(law, state, now.span) - row.sigma * before
        if free:
            for d in range(rows.seen.size):
                residual -= row.response * points.normal[i, d] * rows.seen[d]
        else:
            residual -= row.response * along(rows.pushed, points.entries, row.start, row.stop)
        value = before + residual / (row.sigma + row.response * row.delassus)
        if value < 0.0 and law.never_pulls == 1:
            value = 0.0
        state.multiplier = value
        now.moved = max(now.moved, abs(value - before))
        if free:
            for d in range(rows.seen.size):
                rows.change[d] += (value - before) * points.normal[i, d]
        else:
            push_by(rows.pushed, points.entries, row.start, row.stop, value - before)
    now.largest = max(now.largest, abs(before), abs(state.multiplier))


def stick_or_slide(rows: Rows, j: int, limit: float) -> None:
    """Find the multipliers of a point along the surfaces, as if it stuck, and shorten them to the largest force."""
    tangent, now = rows.tangents[j], rows.now[0]
    stiff = tangent.sigma + tangent.response * tangent.diagonal
    square, drawn, axes = 0.0, 0.0, rows.trial.shape[1]
    for k in range(axes):
        rows.last[j, k] = rows.multiplier[j, k]
        drawn += rows.trial[j, k] * rows.trial[j, k]
    for k in range(axes):
        value = 0.0
        if limit > 0.0 and stiff > 0.0:
            pushed = component(rows, j, k, rows.seen)
            residual = -rows.trial[j, k] - tangent.sigma * rows.last[j, k] - tangent.response * pushed
            value = rows.last[j, k] + residual / stiff
        elif limit > 0.0 and drawn > 0.0:  # no force moves it: it is drawn along the surface, and slides
            value = -2.0 * limit * rows.trial[j, k] / np.sqrt(drawn)
        rows.multiplier[j, k] = value
        square += value * value
    tangent.state = STICKS if limit > 0.0 else OPEN
    if square > limit * limit:
        tangent.state = SLIDES
        for k in range(axes):
            rows.multiplier[j, k] *= limit / np.sqrt(square)
    for k in range(axes):
        change = rows.multiplier[j, k] - rows.last[j, k]
        now.moved = max(now.moved, abs(change))
        for d in range(rows.change.size):
            rows.change[d] += change * rows.along[j, k, d]


def push_along(rows: Rows, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the velocity changes by the forces along the surfaces.

    The elastic slip after the step is that of the force, with what the corrector of the scheme moves after the law was
    asked.
    """
    now, boundary = rows.now[0], rows.boundary
    for j in range(rows.tangents.size):
        tangent = rows.tangents[j]
        tangent.held = 0.0
        see_point(rows, j)
        for k in range(rows.slip.shape[1]):
            force = rows.multiplier[j, k]
            slip = -tangent.sigma * force
            if tangent.predicted == 1:
                slip += (now.dt * now.dt - tangent.response) * component(rows, j, k, rows.seen)
            rows.slip[j, k] = slip if tangent.state != OPEN and tangent.sigma > 0.0 else 0.0
            tangent.held -= force * rows.slip[j, k]
        set_force(rows, j)
        for k in range(tangent.width):
            for d in range(rows.change.size):
                boundary[rows.nodes[j, k].place + d].new_v += now.dt * moved(rows, rows.nodes[j, k], d)


def renew_states(group: Group, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Let a friction renew the state variables of its points."""
    for j in range(group.which.size):
        force = max(group.rows.points.state[group.which[j]].multiplier, 0.0)
        for k in range(group.after.shape[1]):
            group.after[j, k] = group.before[j, k]
        renew(group.friction, j, force, group.rows.tangents[group.first + j].rate, group.before[j], group.after[j])
        for k in range(group.after.shape[1]):
            group.before[j, k] = group.after[j, k]


def account_for(rows: Rows, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add up the work and the impulses of friction, and the energy that stick stores.

    The work is ``lambda_t T^T (u_{n+1} - u_{n-1}) / 2``. What follows the bulk update stores
    ``-(lambda_n s_n + lambda_n-1 s_n-1) / 4`` with the slips after the steps, ``sigma_t / 4 (|lambda_n|^2 + ...)`` at
    the end of the step. What follows the present slip stores half of the product of the slips before and after the
    step over sigma_t.
    """
    dt = rows.now[0].dt
    for c in range(rows.stored.size):
        rows.stored[c] = 0.0
    for j in range(rows.tangents.size):
        tangent, state = rows.tangents[j], rows.points.state[rows.tangents[j].point]
        contact = rows.points.law[tangent.point].contact
        product, square = 0.0, 0.0
        see_rates(rows, j)
        for k in range(rows.slip.shape[1]):
            force, rate = rows.multiplier[j, k], component(rows, j, k, rows.change)
            rows.work[contact] += 0.5 * dt * force * (rows.rate[j, k] + rate)
            for d in range(rows.along.shape[2]):
                rows.impulse[tangent.number, d] += dt * force * rows.along[j, k, d]
            product -= force * (dt * rate - tangent.sigma * force)
            square += rate * rate
        if tangent.predicted == 1:
            rows.stored[contact] += 0.25 * (tangent.held + tangent.before)
        else:
            rows.stored[contact] += 0.5 * product
        if state.multiplier > 0.0:
            tangent.path += dt * np.sqrt(square)


def record(data: History, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Record works, energies, slides, areas and forces of the step."""
    rows, r = data.rows, data.rows.now[0].row
    for c in range(rows.work.size):
        data.work[r, c] = rows.work[c]
        data.stored[r, c] = rows.stored[c]
        data.slid[r, c] = 0.0
        data.sticking[r, c] = 0.0
        data.sliding[r, c] = 0.0
        data.wall[r, c] = rows.wall_work[c]
        for d in range(data.force.shape[2]):
            data.force[r, c, d] = 0.0
    for i in range(rows.points.law.size):
        for d in range(data.force.shape[2]):
            data.force[r, rows.points.law[i].contact, d] -= rows.points.normal[i, d] * rows.points.state[i].multiplier
    for j in range(rows.tangents.size):
        tangent = rows.tangents[j]
        c = rows.points.law[tangent.point].contact
        data.slid[r, c] = max(data.slid[r, c], tangent.path)
        if tangent.state == STICKS:
            data.sticking[r, c] += rows.points.row[tangent.point].weight
        elif tangent.state == SLIDES:
            data.sliding[r, c] += rows.points.row[tangent.point].weight
        for k in range(rows.slip.shape[1]):
            for d in range(data.force.shape[2]):
                data.force[r, c, d] -= rows.along[j, k, d] * rows.multiplier[j, k]


def record_points(data: History, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Record traction, slide and status of each point in a snapshot."""
    if n % data.every != 0:
        return
    rows, r = data.rows, n // data.every
    for i in range(data.order.size):
        p = data.order[i]
        data.slip[r, p] = 0.0
        data.status[r, p] = OPEN if rows.points.state[i].multiplier == 0.0 else SLIDES
        for d in range(data.traction.shape[2]):
            data.traction[r, p, d] = (
                -rows.points.normal[i, d] * rows.points.state[i].multiplier / rows.points.law[i].weight
            )
    for j in range(rows.tangents.size):
        tangent = rows.tangents[j]
        data.slip[r, tangent.number] = tangent.path
        data.status[r, tangent.number] = tangent.state
        for k in range(rows.slip.shape[1]):
            for d in range(data.traction.shape[2]):
                force = rows.along[j, k, d] * rows.multiplier[j, k]
                data.traction[r, tangent.number, d] -= force / rows.points.law[tangent.point].weight
    for k in range(rows.moving.size):
        row = rows.points.row[rows.moving[k]]
        if row.start == row.stop:
            data.status[r, data.order[rows.moving[k]]] = ALONE


# ------------------------------------------------------------------------------------------------------- what it says

SLIDING = "while points slide, their equations have no symmetric stiffness, and nothing is known of the step"


def feature(model: Model) -> Feature | None:
    """Return what is to know of friction; None without any."""
    if not (names := dict.fromkeys(friction.name for friction in frictional(model).values())):
        return None
    return Feature(
        name=f"friction {' and '.join(names)}",
        held=with_stick,
        held_words=("While they stick", "sticking", "sliding"),
        reasons={"certificate": SLIDING, "plain bars": "surfaces with friction are no bars"},
    )
