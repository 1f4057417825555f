"""Damping in proportion to the mass: a force -alpha m v on each node, v the mean velocity before and after the step.

With ``c = alpha dt / 2`` a node follows ``(1 + c) v_{n+1/2} = (1 - c) v_{n-1/2} + dt f / m``. So forces meet an inertia
``(1 + c) m``, those of contacts and loads too, and a step takes the energy ``alpha dt m v^2``, which is never negative.
The limit of the step stays that of the undamped bodies: a motion that changes its sign in each step has no mean
velocity. Nodes that supports or drives move, and ends with forces that depend on the motion, are not damped.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from percuss.contact.features import Feature
from percuss.record_arrays import Records
from percuss.step.actions import BEFORE_ACCOUNT, BEFORE_SUPPORTS, BULK, RECORD, Action
from percuss.step.part import Part, Setting
from percuss.step.records import Loads

if TYPE_CHECKING:
    from collections.abc import Mapping

    from percuss.contact.model import Model
    from percuss.errors import Problem
    from percuss.methods.interfaces import Array, Floats, Integers


class Damped(NamedTuple):
    """The degrees of freedom of damped bodies."""

    dof: Integers  # (D,)
    body: Integers  # (D,) index of its body and direction in the momenta of the bodies
    half: Floats  # (at least nodes * dim,) alpha dt / 2 of each degree of freedom, and zeros
    mass: Floats  # (nodes * dim,)
    before: Floats  # (D,) velocity before the step
    sums: int  # 1 where the internal work is summed up
    loads: Loads
    boundary: Records  # percuss.step.records.BOUNDARY_DOF
    totals: Records  # percuss.step.records.TOTAL
    now: Records  # percuss.step.records.NOW
    taken: Floats  # (1,) energy that damping has taken so far
    history: Floats  # (R,) of it


class Damping(Part[Damped]):
    """The part of a step with damped bodies."""

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None where no body is damped."""
        model, dim, step = setting.model, setting.model.dim, setting.step
        half = np.repeat(model.slowing - 1.0, dim)
        if not half.any():
            return None
        (dof,) = np.nonzero(half)
        half = np.append(half, np.zeros(step.boundary.size))  # walls, which are not damped, lie behind the nodes
        bodies = model.bodies.values()
        number = np.repeat(np.arange(len(bodies)), [body.mass.size for body in bodies])
        taken, history = np.zeros(1), np.full(setting.record.energy.size, np.nan)
        taken, history = (taken, history) if before is None else (before.data.taken, before.data.history)
        body, sums = number[dof // dim] * dim + dof % dim, int(model.sums_internal_work)
        mass, now = model.bodies.mass_of_dofs, step.now
        return cls(
            Damped(
                dof, body, half, mass, np.zeros(dof.size), sums, step.loads, step.boundary, step.totals, now, taken,
                history,
            )
        )  # fmt: skip

    def actions(self) -> Iterator[Action]:
        """Yield the actions of a step."""
        yield Action(BULK, keep_velocities, self.data, order=-1)
        yield Action(BULK, damp, self.data, order=1)
        if self.data.sums:
            yield Action(BEFORE_SUPPORTS, change_by_forces, self.data)
        yield Action(BEFORE_ACCOUNT, take_energy, self.data)
        yield Action(RECORD, record, self.data)

    def changing_arrays(self) -> list[Array]:
        """Return the energy that damping has taken."""
        return [self.data.taken]

    def results(self) -> Mapping[str, Floats]:
        """Return the history of the energy that damping has taken."""
        return {"damped_energy": self.data.history}


def keep_velocities(data: Damped, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Keep the velocities before the step."""
    for i in range(data.dof.size):
        data.before[i] = v[data.dof[i]]


def damp(data: Damped, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Correct what the bulk update did without damping: velocities, displacements, momenta, and internal work."""
    dt, work, loaded = data.now[0].dt, 0.0, data.loads.momentum.size > 0
    for i in range(data.dof.size):
        k = data.dof[i]
        half = data.half[k]
        undamped = v[k]
        v[k] = (undamped - half * data.before[i]) / (1.0 + half)
        change = v[k] - undamped
        u[k] += dt * change
        if loaded:
            data.loads.momentum[data.body[i]] += data.mass[k] * change
        if data.sums == 1:
            by_force = (undamped - data.before[i]) / dt - data.loads.accelerations[data.body[i]]
            work += data.mass[k] * by_force * change
    data.totals[0].internal_work -= 0.5 * dt * work


def change_by_forces(data: Damped, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set the change of the velocities of boundary degrees of freedom to that by their forces alone."""
    for i in range(data.boundary.size):
        q = data.boundary[i]
        half = data.half[q.dof]
        q.change = (1.0 + half) * q.bulk_v - (1.0 - half) * q.old_v


def take_energy(data: Damped, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the energy that damping takes in the step."""
    taken = 0.0
    for i in range(data.dof.size):
        k = data.dof[i]
        both = data.before[i] + v[k]
        taken += data.half[k] * data.mass[k] * both * both
    data.taken[0] += 0.5 * taken


def record(data: Damped, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Record the energy that damping has taken."""
    data.history[data.now[0].row] = data.taken[0]


def feature(model: Model) -> Feature | None:
    """Return what is to know of damped bodies; None where none is."""
    if not any(body.spec.damping is not None for body in model.bodies.values()):
        return None
    return Feature(name="damping", no_row_kernel=True, reasons={"plain bars": "bodies are damped"})


def refusals(model: Model) -> Iterator[Problem]:
    """Yield what does not go with damped bodies."""
    for name, body in model.bodies.items():
        if body.spec.damping is None:
            continue
        integrator = model.case.method.integrator.name
        found = (
            (model.multistage, f"a leap-frog scheme, found {integrator}", "Take central-difference."),
            (model.period > 1, f"steps that all bodies share, found {integrator}", "Take central-difference."),
            (
                model.bodies.couples_nodes or bool((model.bodies.mass == 0.0).any()),
                f"a mass at each node for itself, found the mass {model.case.method.mass.name}",
                "Take `method: {mass: lumped}`.",
            ),
        )
        yield from model.case.first_problem(("bodies", name, "damping"), found)
