"""The moments of contacts, supports, loads and damping about the centre of mass at the start, with finite strain.

The angular momentum ``sum of x_n x m v_n+1/2`` changes in a step by ``dt sum of x_n x f``, with the places x_n before
the step: internal forces have no moment there, as no turn of the body changes its energy. Those of a linear body have
none with the places at the start, which count for its nodes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from percuss.contact.points import Points
from percuss.mesh.bodies import TURNS
from percuss.record_arrays import Records
from percuss.step.actions import AFTER_STEP, Action
from percuss.step.part import Part, Setting
from percuss.step.parts import damping, friction
from percuss.step.records import Loads

if TYPE_CHECKING:
    from collections.abc import Mapping

    from percuss.contact.model import Model
    from percuss.methods.interfaces import Array, Floats, Integers


class Moments(NamedTuple):
    """What has moments, and their sums over the steps."""

    boundary: Records  # percuss.step.records.BOUNDARY_DOF
    points: Points
    loads: Loads
    now: Records  # percuss.step.records.NOW
    arm: Floats  # (nodes * dim,) place at the start less the centre
    moves: Floats  # (nodes * dim,) 1 on bodies of finite strain, 0 on linear ones
    turns: Integers  # (2, m) components of which the moments are made
    mass: Floats  # (bodies,) where loads act on whole bodies
    middle: Floats  # (bodies * dim,) mass times the place of the middle of each body less the centre
    moving: Floats  # (bodies * dim,) 1 of bodies of finite strain, 0 of linear ones
    contacts: Floats  # (contacts, m)
    supports: Floats  # (m,)
    of_loads: Floats  # (m,)
    of_damping: Floats  # (m,)


class MomentsSummed(Part[Moments]):
    """The part of a step that adds up moments where bodies are of finite strain.

    Parameters
    ----------
    data
        The sums.
    rows
        The contact points with friction, None without any.
    damped
        The damped nodes, None without any.
    """

    def __init__(self, data: Moments, rows: Any, damped: damping.Damped | None) -> None:
        super().__init__(data)
        self.rows, self.damped = rows, damped

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None where no body is of finite strain, or not all are solids in the plane or in space."""
        model, step = setting.model, setting.step
        if not keeps_angular_momentum(model):
            return None
        rows = next((part.data.rows for part in setting.made if isinstance(part, friction.Frictions)), None)
        damped = next((part.data for part in setting.made if isinstance(part, damping.Damping)), None)
        if before is not None:
            now = before.data._replace(boundary=step.boundary, points=step.points, loads=step.loads, now=step.now)
            return cls(now, rows, damped)
        bodies, turns = model.bodies, np.array(TURNS[model.dim], dtype=np.int64)
        finite = np.array([float(not body.of_small_strains) for body in bodies.values()])
        moves = np.repeat(finite, [body.mass.size * model.dim for body in bodies.values()])
        mass = np.array([body.mass.sum() for body in bodies.values()])
        middles = np.array([body.mass @ (body.mesh.nodes - bodies.centre) for body in bodies.values()])
        contacts, size = len(model.case.contacts), turns.shape[1]
        data = Moments(
            step.boundary, step.points, step.loads, step.now, (bodies.nodes - bodies.centre).ravel(), moves, turns,
            mass, middles.ravel(), np.repeat(finite, model.dim), np.zeros((contacts, size)), np.zeros(size),
            np.zeros(size), np.zeros(size),
        )  # fmt: skip
        return cls(data, rows, damped)

    def actions(self) -> Iterator[Action]:
        """Yield the actions of a step."""
        yield Action(AFTER_STEP, add_moments, self.data)
        if self.rows is not None:
            yield Action(AFTER_STEP, add_moments_along, Along(self.data, self.rows))
        if self.damped is not None:
            yield Action(AFTER_STEP, add_moments_of_damping, Slowed(self.data, self.damped))

    def changing_arrays(self) -> list[Array]:
        """Return the sums."""
        data = self.data
        return [data.middle, data.contacts, data.supports, data.of_loads, data.of_damping]

    def sums(self) -> Mapping[str, Floats]:
        """Return the moments of impulses so far: of each contact, of supports, loads and damping."""
        data = self.data
        return {
            "moments_of_contacts": data.contacts, "moment_of_supports": data.supports, "moment_of_loads": data.of_loads,
            "moment_of_damping": data.of_damping,
        }  # fmt: skip


class Along(NamedTuple):
    """The moments, and contact points with friction."""

    moments: Moments
    rows: friction.Rows


class Slowed(NamedTuple):
    """The moments, and the damped nodes."""

    moments: Moments
    damped: damping.Damped


def keeps_angular_momentum(model: Model) -> bool:
    """Return whether angular momentum is counted with the places of each step: where a body is of finite strain."""
    bodies = model.bodies.values()
    finite = not any(body.is_bar for body in bodies) and not all(body.of_small_strains for body in bodies)
    return finite and not model.bodies.about_axis and not model.multistage


# ------------------------------------------------------------------------------------------------------------- kernels


def add_moment(data: Moments, total: Floats, place: int, d: int, impulse: float) -> None:
    """Add the moment of a component of an impulse at a boundary node, by the place before the step; none at a wall."""
    if data.boundary[place].mass == 0.0:
        return
    node = data.boundary[place].dof
    for k in range(data.turns.shape[1]):
        first, second = data.turns[0, k], data.turns[1, k]
        if d == second:
            moved = data.moves[node + first] * data.boundary[place + first].old_u
            total[k] += (data.arm[node + first] + moved) * impulse
        elif d == first:
            moved = data.moves[node + second] * data.boundary[place + second].old_u
            total[k] -= (data.arm[node + second] + moved) * impulse


def add_moments(data: Moments, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the moments of contacts along their normals, of supports and of loads."""
    points, loads, now, dim = data.points, data.loads, data.now[0], data.now[0].dim
    for i in range(points.law.size):
        row, force = points.row[i], points.state[i].multiplier
        if force != 0.0:
            for e in range(row.start, row.stop):
                place, d = points.entries[e].place, points.entries[e].place % dim
                impulse = now.dt * force * points.entries[e].normal
                add_moment(data, data.contacts[points.law[i].contact], place - d, d, impulse)
    for i in range(loads.constraints.size):
        held = loads.constraints[i]
        for d in range(dim):
            add_moment(data, data.supports, held.place, d, now.dt * held.force * loads.axes[held.axis + d])
    for i in range(loads.nodal_forces.size):
        load = loads.nodal_forces[i]
        for d in range(dim):
            impulse = now.dt * loads.amplitudes[load.column] * loads.axes[load.axis + d]
            add_moment(data, data.of_loads, load.place, d, impulse)
    if loads.momentum.size == 0:
        return
    for b in range(data.mass.size):
        for k in range(data.turns.shape[1]):
            one, two = b * dim + data.turns[0, k], b * dim + data.turns[1, k]
            data.of_loads[k] += now.dt * data.middle[one] * loads.accelerations[two]
            data.of_loads[k] -= now.dt * data.middle[two] * loads.accelerations[one]
    for i in range(data.middle.size):
        data.middle[i] += data.moving[i] * now.dt * loads.momentum_before[i]


def add_moments_along(data: Along, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the moments of friction."""
    moments, rows = data.moments, data.rows
    for j in range(rows.tangents.size):
        friction.set_force(rows, j)
        contact = rows.points.law[rows.tangents[j].point].contact
        for k in range(rows.tangents[j].width):
            node = rows.nodes[j, k]
            for d in range(rows.change.size):
                impulse = rows.now[0].dt * node.share * rows.change[d]
                add_moment(moments, moments.contacts[contact], node.place, d, impulse)


def add_moments_of_damping(data: Slowed, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the moments of damping, by the places before the step."""
    moments, damped, now = data.moments, data.damped, data.moments.now[0]
    for i in range(damped.dof.size):
        dof = damped.dof[i]
        impulse = -damped.half[dof] * damped.mass[dof] * (damped.before[i] + v[dof])
        node = dof - dof % now.dim
        for k in range(moments.turns.shape[1]):
            first, second = node + moments.turns[0, k], node + moments.turns[1, k]
            other, sign = (first, 1.0) if dof == second else (second, -1.0)
            if dof in (first, second):
                place = moments.arm[other] + moments.moves[other] * (u[other] - now.dt * v[other])
                moments.of_damping[k] += sign * place * impulse
