"""The step of leap-frog schemes, on one page.

A step takes displacements u_n and velocities v_{n-1/2} to u_{n+1} and v_{n+1/2}. It advances all bodies without contact
and then corrects the few degrees of freedom at which loads, supports, drives or contacts act. The kernels of bodies and
contact laws, and the optional parts of a step, are actions at its places (`percuss.step.actions`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from percuss.record_arrays import Records
from percuss.step.account import account
from percuss.step.actions import (
    AFTER_CONTACT,
    AFTER_STEP,
    BEFORE_CONTACT,
    BEFORE_SUPPORTS,
    BULK,
    perform,
)
from percuss.step.equation import find_multipliers, push, see
from percuss.step.loads import hold, push_by_loads, react_to_contact, work_along, work_on_bodies
from percuss.step.record import Record, count_start, find_energies, is_recorded, snapshot, write_record

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats
    from percuss.step.records import Step


def advance(step: Step, record: Record, amplitudes: Floats, u: Floats, v: Floats, first: int, count: int) -> int:
    """Make `count` steps from step `first`; return `count`, or the number of steps before the first that failed.

    A step fails if the contact equation was not solved, or if the contact work exceeds its limit or is nan.
    `amplitudes` has one row for each step, as `percuss.step.records.Loads` has it.
    """
    boundary, points, loads, actions = step.boundary, step.points, step.loads, step.actions
    total, now = step.totals[0], step.now[0]
    dt = now.dt
    for s in range(count):
        n = first + s
        for k in range(amplitudes.shape[1]):
            loads.amplitudes[k] = amplitudes[s, k]
        snapshot(record, step, n, u, v)
        if n == 0:
            count_start(step, u, v)
        now.time = n * dt
        now.solved = 1
        total.work_of_parts = 0.0
        keep(boundary, u, v)
        perform(actions, BULK, n, u, v, v)

        take(boundary, v)
        push_by_loads(loads, boundary, now)
        perform(actions, BEFORE_SUPPORTS, n, u, v, v)
        work = hold(loads, boundary, total, now)
        perform(actions, BEFORE_CONTACT, n, u, v, v)

        see(points, boundary, dt)
        find_multipliers(now, actions, n, u, v)
        push(points, boundary, dt)
        perform(actions, AFTER_CONTACT, n, u, v, v)

        work += react_to_contact(loads, points.state, boundary, now)
        work += work_along(loads.nodal_forces, loads, boundary, now) + work_on_bodies(loads, boundary, now)
        put_back(boundary, u, v, dt)
        perform(actions, AFTER_STEP, n, u, v, v)
        sound = account(step, work + total.work_of_parts, n, u, v) and now.solved == 1
        if is_recorded(record, n):
            find_energies(step, n, u, v)
            write_record(record, step, n, u, v, dt)
        if not sound:
            return s
    return count


def keep(boundary: Records, u: Floats, v: Floats) -> None:
    """Keep displacement and velocity of the boundary degrees of freedom before the step, as `old_u` and `old_v`."""
    for i in range(boundary.size):
        q = boundary[i]
        q.old_u = u[q.dof]
        q.old_v = v[q.dof]


def take(boundary: Records, v: Floats) -> None:
    """Take the velocities of the boundary degrees of freedom after the bulk update."""
    for i in range(boundary.size):
        q = boundary[i]
        q.bulk_v = v[q.dof]
        q.change = q.bulk_v - q.old_v
        q.new_v = q.bulk_v


def put_back(boundary: Records, u: Floats, v: Floats, dt: float) -> None:
    """Write the corrected velocities to the global array, and the displacements u_{n+1} = u_n + dt v_{n+1/2}."""
    for i in range(boundary.size):
        q = boundary[i]
        v[q.dof] = q.new_v
        u[q.dof] = q.old_u + dt * q.new_v
