"""The loop over steps of schemes that are no leap-frog: accelerations in stages, and the accounts of whole steps.

Displacement and velocity stand at t_n before a step and at t_{n+1} behind it. Behind the degrees of freedom of the
nodes the arrays have an entry for each contact point, each hold and each column of loads, whose acceleration is the
multiplier, the reaction, the amplitude. A scheme combines all entries in the same way, so that what becomes of the
velocity of such an entry in a step is the impulse of that step, whatever the scheme's weights; with it kinetic energy
and momentum change by ``impulse (v_n + v_{n+1}) / 2`` and ``impulse`` exactly. No function here allocates.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.methods.slots import accelerations, internal_force
from percuss.solver.compiled.bulk import Bulk, Group, kinetic
from percuss.solver.compiled.leapfrog_loop import (
    NOISE,
    Boundary,
    Record,
    contact_energy,
    elastic,
    find_contact_states,
    find_multipliers,
    save_state,
    snapshot,
    take_strain_energy,
    work_of_nodal_forces,
)
from percuss.solver.compiled.marks import called

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integers

# an acceleration of whole bodies: `axes` from `axis` on at amplitude 1, on the nodes from `start` to `stop`
BODY_FORCE = np.dtype([("start", "i8"), ("stop", "i8"), ("axis", "i8"), ("column", "i8"), ("momentum", "f8")])


class System(NamedTuple):
    """What `accelerations` needs; the last five are written in every step."""

    groups: Any
    masses: Bulk
    boundary: Boundary  # with all constraints of the model
    bound: Any
    body_forces: Any  # BODY_FORCE
    pull_axes: Floats
    acts: Integers  # (constraints,) 1 where the constraint is in force
    responses: Floats  # (stages, points) w of each point
    ends: Floats  # (stages, 3) r_v, r_a, s_a
    times: Floats  # (stages,) fractions of the step
    dim: int
    amplitude: Floats  # (stages, columns)
    speed: Floats  # (2, columns) prescribed velocities at t_n and t_{n+1}
    effective: Floats  # (1, columns) amplitude of each load over the step
    given: Floats  # (columns,) sum of the effective amplitudes
    clock: Floats  # (3,) t_n, dt, and 1 while all contact equations were solved


class Given(NamedTuple):
    """Amplitudes of the loads for a run of T steps."""

    force: Floats  # (T, stages, columns)
    speed: Floats  # (T, 2, columns) velocities at t_n and t_{n+1}


@called
def take_step(numbers: Any, system: System, u: Floats, v: Floats, kept: Floats, dt: float) -> None:
    """Slot: the integrator's own step."""
    raise NotImplementedError


# ------------------------------------------------------------------------------------------------- forces of bodies


@called
def force_group(group: Group, u: Floats, force: Floats, dim: int) -> None:
    """Set `force` to the internal force of the bodies of one group."""
    for b in range(group.body.size):
        lo = group.start[b] * dim
        hi = group.stop[b] * dim
        internal_force(group.element, group.parameters[b], group.first[b], dim, u[lo:hi], force[lo:hi])


@called
def force_head(group: Any, u: Floats, force: Floats, dim: int) -> None:
    """Slot: forces of the first group of bodies."""
    raise NotImplementedError


@called
def force_tail(group: Any, u: Floats, force: Floats, dim: int) -> None:
    """Slot: forces of the other groups."""
    raise NotImplementedError


@called
def force_chain(groups: Any, u: Floats, force: Floats, dim: int) -> None:
    """Set the forces of a pair (group, other groups)."""
    force_head(groups[0], u, force, dim)
    force_tail(groups[1], u, force, dim)


@called
def forces(groups: Any, u: Floats, force: Floats, dim: int) -> None:
    """Slot: set `force` to the internal force of all bodies."""
    raise NotImplementedError


# ------------------------------------------------------------------------------------------------------- one stage


@called
def accelerate(system: System, stage: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set `a` to ``M^-1 (f_ext - f_int(u) + N lambda)``, behind it multipliers, reactions and amplitudes."""
    boundary, inverse_mass, dim = system.boundary, system.masses.inverse_mass, system.dim
    boundary_dofs, points = boundary.boundary_dofs, boundary.points
    amplitude = system.amplitude[stage]
    nodal = inverse_mass.size
    forces(system.groups, u, a, dim)
    for i in range(nodal):
        a[i] *= inverse_mass[i]
    for i in range(system.body_forces.size):
        p = system.body_forces[i]
        for j in range(p.start, p.stop):
            for d in range(dim):
                a[j * dim + d] += amplitude[p.column] * system.pull_axes[p.axis + d]
    for i in range(boundary.nodal_forces.size):
        f = boundary.nodal_forces[i]
        for d in range(dim):
            a[boundary_dofs[f.place + d].dof] += amplitude[f.column] * f.inverse_mass * boundary.axes[f.axis + d]
    first = nodal + points.size  # of the constraints
    for i in range(boundary.constraints.size):
        h = boundary.constraints[i]
        a[first + i] = 0.0
        if system.acts[i] == 1:
            now = along(h, boundary_dofs, boundary.axes, a, dim)
            wanted = (system.speed[1, h.column] - system.speed[0, h.column]) / system.clock[1]
            a[first + i] = h.mass * (wanted - now)
            add_along(h, boundary_dofs, boundary.axes, a, wanted - now, dim)
    if points.size > 0:
        touch(system, stage, u, v, a, nodal)
    for i in range(amplitude.size):
        a[first + boundary.constraints.size + i] = amplitude[i]


@called
def along(h: Any, boundary_dofs: Any, axes: Floats, values: Floats, dim: int) -> float:
    """Return the component of a nodal quantity along a hold."""
    total = 0.0
    for d in range(dim):
        total += axes[h.axis + d] * values[boundary_dofs[h.place + d].dof]
    return total


@called
def add_along(h: Any, boundary_dofs: Any, axes: Floats, values: Floats, more: float, dim: int) -> None:
    """Add to a nodal quantity along a hold."""
    for d in range(dim):
        values[boundary_dofs[h.place + d].dof] += more * axes[h.axis + d]


@called
def touch(system: System, stage: int, u: Floats, v: Floats, a: Floats, nodal: int) -> None:
    """Solve the contact equation of a stage, and let the multipliers act."""
    boundary, entries, points = system.boundary, system.boundary.entries, system.boundary.points
    end = system.ends[stage]
    for i in range(points.size):
        p = points[i]
        gap = p.initial_gap
        rate = 0.0
        acceleration = 0.0
        for k in range(p.start, p.stop):
            dof = boundary.boundary_dofs[entries[k].place].dof
            gap += entries[k].normal * u[dof]
            rate += entries[k].normal * v[dof]
            acceleration += entries[k].normal * a[dof]
        p.gap = gap
        p.rate = rate
        p.predicted_gap = gap + end[0] * rate + end[1] * acceleration
        p.predicted_rate = rate + end[2] * acceleration
        p.response = system.responses[stage, i]
    time = system.clock[0] + system.times[stage] * system.clock[1]
    # the bulk acceleration is read from the rates, which lie s_a apart
    if not find_multipliers(system.bound, points, boundary.others, system.clock[1], time, (end[1], end[2]), end[2]):
        system.clock[2] = 0.0
    for i in range(points.size):
        p = points[i]
        for k in range(p.start, p.stop):
            a[boundary.boundary_dofs[entries[k].place].dof] += entries[k].response * p.multiplier
        a[nodal + i] = p.multiplier
    for i in range(boundary.shares.size):
        share = boundary.shares[i]
        a[nodal + points.size + share.hold] -= share.value * points[share.point].multiplier


@called
def begin(system: System, u: Floats, v: Floats, kept: Floats) -> None:
    """Set what is kept between steps to the acceleration of the present state, as the last stage sees it."""
    for i in range(kept.shape[0]):
        accelerations(system, system.times.size - 1, u, v, kept[i])


# ------------------------------------------------------------------------------------------------------ whole steps


@called
def advance(
    system: System,
    numbers: Any,
    given: Given,
    record: Record,
    u: Floats,
    v: Floats,
    kept: Floats,
    dt: float,
    first: int,
    count: int,
) -> int:
    """March `count` steps from step `first`; return how many were done when one was not sound, else `count`."""
    boundary, nodal = system.boundary, system.masses.mass.size
    boundary_dofs, points, totals = boundary.boundary_dofs, boundary.points, boundary.totals
    for s in range(count):
        n = first + s
        if record.field_every > 0 and n % record.field_every == 0:
            snapshot(record, u, n)
        if n == 0:
            take_strain_energy(system.groups, totals[0], u, v, system.dim, 0.0)
        save_state(boundary_dofs, u, v)
        set_out(system, given, s, n, u, v, dt)
        prescribe(system, u, v, dt, False)
        take_step(numbers, system, u, v, kept, dt)
        prescribe(system, u, v, dt, True)
        for i in range(boundary_dofs.size):
            boundary_dofs[i].new_v = v[boundary_dofs[i].dof]
        find_contact_states(points, boundary.entries, boundary_dofs, dt)
        for i in range(points.size):
            points[i].multiplier = v[nodal + i] / dt
        work = settle_holds(system, v, dt)
        start = nodal + points.size + boundary.constraints.size
        for i in range(system.given.size):
            system.effective[0, i] = v[start + i] / dt
            system.given[i] += system.effective[0, i]
        if boundary.nodal_forces.size > 0:
            work += work_of_nodal_forces(
                boundary.nodal_forces, boundary_dofs, boundary.axes, system.effective, 0, system.dim, dt
            )
        work += work_of_body_forces(system, v, dt)
        total = totals[0]
        total.external_work += work
        total.largest_work = max(total.largest_work, abs(total.external_work))
        contact_energy(points, boundary.entries, boundary_dofs, totals, n, dt)
        if n % record.every == 0 or n == record.last:
            keep(system, record, u, v, n)
        limit = total.growth * (total.began_with + total.largest_work) + total.floor + NOISE * total.step_energy
        # the comparison fails for a work that is no number, too
        if not (system.clock[2] == 1.0 and total.contact_work <= limit):
            return s
    return count


@called
def set_out(system: System, given: Given, s: int, n: int, u: Floats, v: Floats, dt: float) -> None:
    """Write what holds in this step alone, and begin the accounts of its impulses."""
    stages = system.times.size
    for k in range(stages):
        for i in range(system.given.size):
            system.amplitude[k, i] = given.force[s, k, i]
    for k in range(2):
        for i in range(system.given.size):
            system.speed[k, i] = given.speed[s, k, i]
    system.clock[0] = n * dt
    system.clock[1] = dt
    system.clock[2] = 1.0
    for i in range(system.masses.mass.size, u.size):
        u[i] = 0.0
        v[i] = 0.0
    for i in range(system.body_forces.size):
        p = system.body_forces[i]
        p.momentum = momentum(system, p, v)


@called
def momentum(system: System, p: Any, v: Floats) -> float:
    """Return the momentum of pulled bodies along the pull, times its size."""
    total = 0.0
    for j in range(p.start, p.stop):
        for d in range(system.dim):
            k = j * system.dim + d
            total += system.masses.mass[k] * v[k] * system.pull_axes[p.axis + d]
    return total


@called
def prescribe(system: System, u: Floats, v: Floats, dt: float, after: bool) -> None:
    """Impose the velocities of supports and drives before or after the step; what that takes is reaction."""
    boundary, dim = system.boundary, system.dim
    first = system.masses.mass.size + boundary.points.size
    for i in range(boundary.constraints.size):
        h = boundary.constraints[i]
        if system.acts[i] == 1:
            wanted = system.speed[1 if after else 0, h.column]
            missing = wanted - along(h, boundary.boundary_dofs, boundary.axes, v, dim)
            add_along(h, boundary.boundary_dofs, boundary.axes, v, missing, dim)
            v[first + i] += h.mass * missing
            if after:
                place = 0.5 * dt * (system.speed[0, h.column] + system.speed[1, h.column])
                for d in range(dim):
                    place += boundary.axes[h.axis + d] * boundary.boundary_dofs[h.place + d].old_u
                add_along(
                    h,
                    boundary.boundary_dofs,
                    boundary.axes,
                    u,
                    place - along(h, boundary.boundary_dofs, boundary.axes, u, dim),
                    dim,
                )


@called
def settle_holds(system: System, v: Floats, dt: float) -> float:
    """Sum the reactions of the step; return their work."""
    boundary, work = system.boundary, 0.0
    first = system.masses.mass.size + boundary.points.size
    for i in range(boundary.constraints.size):
        h = boundary.constraints[i]
        impulse = v[first + i]
        if impulse != 0.0:
            h.reaction += impulse / dt
            boundary.totals[0].step_energy = max(boundary.totals[0].step_energy, impulse**2 / h.mass)
            for d in range(system.dim):
                q = boundary.boundary_dofs[h.place + d]
                work += 0.5 * impulse * boundary.axes[h.axis + d] * (q.old_v + q.new_v)
    return work


@called
def work_of_body_forces(system: System, v: Floats, dt: float) -> float:
    """Return the work of the body forces."""
    work = 0.0
    for i in range(system.body_forces.size):
        p = system.body_forces[i]
        work += 0.5 * dt * system.effective[0, p.column] * (p.momentum + momentum(system, p, v))
    return work


@called
def keep(system: System, record: Record, u: Floats, v: Floats, n: int) -> None:
    """Write the record of step n: state at t_n, forces over the step, energies at t_{n+1}."""
    boundary, nodal = system.boundary, system.masses.mass.size
    r = n // record.every if n % record.every == 0 else record.energy.shape[0] - 1
    for i in range(boundary.points.size):
        p = boundary.points[i]
        record.multiplier[r, i] = p.multiplier
        record.gap[r, i] = p.gap
        after = p.initial_gap
        for k in range(p.start, p.stop):
            after += boundary.entries[k].normal * u[boundary.boundary_dofs[boundary.entries[k].place].dof]
        record.end_force[r, i] = p.end_stiffness * max(-after, 0.0)
    for k in range(record.probe.size):
        q = boundary.boundary_dofs[record.probe[k]]
        record.displacement[r, k] = q.old_u
        record.velocity[r, k] = q.old_v
    record.energy[r, 0] = kinetic(system.masses.mass, v[:nodal])
    record.energy[r, 1] = elastic(system.groups, u, v, system.dim, 0.0)
    record.energy[r, 2] = boundary.totals[0].external_work
    record.energy[r, 3] = boundary.totals[0].contact_work
    record.energy[r, 4] = boundary.totals[0].stored
