"""The moments of contacts, supports and loads on bodies of finite strain, about the centre of mass at the start.

The angular momentum ``sum of x_n x m v_n+1/2`` changes in a step by ``dt sum of x_n x f``, with the places x_n before
the step: internal forces have no moment there, as no turn of the body changes its energy.
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
from percuss.step.parts import friction
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
    arm: Floats  # (boundary degrees of freedom,) place at the start less the centre
    turns: Integers  # (2, m) components of which the moments are made
    mass: Floats  # (bodies,) where loads act on whole bodies
    middle: Floats  # (bodies * dim,) mass times the place of the middle of each body less the centre
    contacts: Floats  # (contacts, m)
    supports: Floats  # (m,)
    of_loads: Floats  # (m,)


class MomentsSummed(Part[Moments]):
    """The part of a step that adds up moments of bodies of finite strain.

    Parameters
    ----------
    data
        The sums.
    rows
        The contact points with friction, None without any.
    """

    def __init__(self, data: Moments, rows: Any) -> None:
        super().__init__(data)
        self.rows = rows

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None where not all bodies are solids of finite strain in the plane or in space."""
        model, step = setting.model, setting.step
        if not keeps_angular_momentum(model):
            return None
        rows = next((part.data.rows for part in setting.made if isinstance(part, friction.Frictions)), None)
        if before is not None:
            now = before.data._replace(boundary=step.boundary, points=step.points, loads=step.loads, now=step.now)
            return cls(now, rows)
        bodies, turns = model.bodies, np.array(TURNS[model.dim], dtype=np.int64)
        arm = np.zeros(step.boundary.size)
        arm[: len(setting.place) * model.dim] = (bodies.nodes[list(setting.place)] - bodies.centre).ravel()
        mass = np.array([body.mass.sum() for body in bodies.values()])
        middles = np.array([body.mass @ (body.mesh.nodes - bodies.centre) for body in bodies.values()])
        contacts, size = len(model.case.contacts), turns.shape[1]
        data = Moments(
            step.boundary, step.points, step.loads, step.now, arm, turns, mass, middles.ravel(),
            np.zeros((contacts, size)), np.zeros(size), np.zeros(size),
        )  # fmt: skip
        return cls(data, rows)

    def actions(self) -> Iterator[Action]:
        """Yield the actions of a step."""
        yield Action(AFTER_STEP, add_moments, self.data)
        if self.rows is not None:
            yield Action(AFTER_STEP, add_moments_along, Along(self.data, self.rows))

    def changing_arrays(self) -> list[Array]:
        """Return the sums."""
        data = self.data
        return [data.middle, data.contacts, data.supports, data.of_loads]

    def sums(self) -> Mapping[str, Floats]:
        """Return the moments of impulses so far: of each contact, of supports and of loads."""
        data = self.data
        return {
            "moments_of_contacts": data.contacts, "moment_of_supports": data.supports, "moment_of_loads": data.of_loads,
        }  # fmt: skip


class Along(NamedTuple):
    """The moments, and contact points with friction."""

    moments: Moments
    rows: friction.Rows


def keeps_angular_momentum(model: Model) -> bool:
    """Return whether angular momentum is counted with the places of each step: of bodies of finite strain alone."""
    bodies = model.bodies.values()
    finite = not any(body.is_bar or body.of_small_strains or body.spec.damping is not None for body in bodies)
    return finite and not model.bodies.about_axis and not model.multistage


# ------------------------------------------------------------------------------------------------------------- kernels


def add_moment(data: Moments, total: Floats, place: int, d: int, impulse: float) -> None:
    """Add the moment of a component of an impulse at a boundary node, by the place before the step; none at a wall."""
    if data.boundary[place].mass == 0.0:
        return
    for k in range(data.turns.shape[1]):
        first, second = data.turns[0, k], data.turns[1, k]
        if d == second:
            total[k] += (data.arm[place + first] + data.boundary[place + first].old_u) * impulse
        elif d == first:
            total[k] -= (data.arm[place + second] + data.boundary[place + second].old_u) * impulse


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
        data.middle[i] += now.dt * loads.momentum_before[i]


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
