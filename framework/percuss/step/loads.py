"""Loads on nodes and bodies, supports and drives: what they change in a step, and their work."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from percuss.record_arrays import Records, Row

if TYPE_CHECKING:
    from percuss.step.records import Loads


def push_by_loads(loads: Loads, boundary: Records, now: Row) -> None:
    """Add the velocity change by forces on single nodes."""
    for i in range(boundary.size):
        boundary[i].load = 0.0
    for i in range(loads.nodal_forces.size):
        nodal_force = loads.nodal_forces[i]
        amplitude = loads.amplitudes[nodal_force.column]
        scale = now.dt * nodal_force.inverse_mass * amplitude
        for d in range(now.dim):
            q = boundary[nodal_force.place + d]
            q.load += amplitude * loads.axes[nodal_force.axis + d]
            q.new_v += scale * loads.axes[nodal_force.axis + d]


def hold(loads: Loads, boundary: Records, total: Row, now: Row) -> float:
    """Set the velocities prescribed by supports and drives, add up their reactions and return the work of these.

    Contact forces are not known yet; `react_to_contact` adds the reactions to them.
    """
    work = 0.0
    for i in range(loads.constraints.size):
        constraint = loads.constraints[i]
        current = 0.0
        previous = 0.0
        for d in range(now.dim):
            current += loads.axes[constraint.axis + d] * boundary[constraint.place + d].new_v
            previous += loads.axes[constraint.axis + d] * boundary[constraint.place + d].old_v
        prescribed = loads.amplitudes[constraint.column]
        change = prescribed - current
        for d in range(now.dim):
            boundary[constraint.place + d].new_v += change * loads.axes[constraint.axis + d]
        reaction = constraint.mass * change / now.dt
        constraint.force = reaction
        constraint.reaction += reaction
        total.step_energy = max(total.step_energy, constraint.mass * (change * change))
        work += reaction * (previous + prescribed)
    return 0.5 * now.dt * work  # type: ignore[no-any-return]


def react_to_contact(loads: Loads, states: Records, boundary: Records, now: Row) -> float:
    """Add the reactions of supports and drives to the contact forces on their nodes; return their work."""
    work = 0.0
    for i in range(loads.shares.size):
        work += react(loads, loads.shares[i], states[loads.shares[i].point].multiplier, boundary, now)
    return 0.5 * now.dt * work  # type: ignore[no-any-return]


def react(loads: Loads, share: Row, force: float, boundary: Records, now: Row) -> float:
    """Add the reaction of a support or drive to its share of a contact force; return twice its work over dt."""
    constraint = loads.constraints[share.hold]
    previous = 0.0
    for d in range(now.dim):
        previous += loads.axes[constraint.axis + d] * boundary[constraint.place + d].old_v
    reaction = -share.value * force
    constraint.force += reaction
    constraint.reaction += reaction
    return reaction * (previous + loads.amplitudes[constraint.column])  # type: ignore[no-any-return]


def work_along(forces: Any, loads: Loads, boundary: Records, now: Row) -> float:
    """Return the work of forces on single nodes, which is force times (u_{n+1} - u_{n-1}) / 2.

    `forces` are the records of forces that have a place, an axis and a column of the amplitudes.
    """
    work = 0.0
    for i in range(forces.size):
        force = forces[i]
        for d in range(now.dim):
            q = boundary[force.place + d]
            work += loads.amplitudes[force.column] * loads.axes[force.axis + d] * (q.old_v + q.new_v)
    return 0.5 * now.dt * work  # type: ignore[no-any-return]


def work_on_bodies(loads: Loads, boundary: Records, now: Row) -> float:
    """Return the work of loads on whole bodies, and update the momenta of the bodies."""
    if loads.momentum.size == 0:
        return 0.0
    # The bulk update has summed the momenta; the corrections of the boundary velocities are added.
    for i in range(boundary.size):
        q = boundary[i]
        loads.momentum[q.body] += q.mass * (q.new_v - q.bulk_v)
    work = 0.0
    for i in range(loads.momentum.size):
        work += loads.accelerations[i] * (loads.momentum[i] + loads.momentum_before[i])
        loads.momentum_before[i] = loads.momentum[i]
        loads.momentum[i] = 0.0
    return 0.5 * now.dt * work  # type: ignore[no-any-return]
