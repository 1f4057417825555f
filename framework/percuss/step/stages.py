"""The compiled loop over the steps of multi-stage schemes: accelerations in stages, then work and energies of the step.

Displacement and velocity are those at t_n before a step and at t_{n+1} after it. Their arrays are longer than those of
the nodes: after the nodal degrees of freedom follow one entry for each contact point, each constraint and each column
of loads, whose acceleration is the multiplier, the reaction and the amplitude. A scheme combines all entries of an
array in the same way, so that the change of velocity of such an entry in a step is the impulse of that step, whatever
the weights of the scheme. Kinetic energy and momentum then change by exactly ``impulse (v_n + v_{n+1}) / 2`` and
``impulse``. No function here allocates memory. In the functions, `p` is the record of a contact point and `q` that of a
boundary degree of freedom.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.compiler.marks import called
from percuss.mesh.block import Group
from percuss.mesh.materials import MaterialPoints
from percuss.methods.slots import accelerations, internal_force
from percuss.step.bulk import Bulk
from percuss.step.loop import (
    Boundary,
    Record,
    add_initial_strain_energy,
    add_up_work,
    elastic,
    find_contact_states,
    find_multipliers,
    following_forces,
    is_recorded,
    keep_state_variables,
    kinetic_of,
    save_state,
    snapshot,
    work_of_nodal_forces,
    write_record,
)
from percuss.step.parts.coupled_masses import couple_accelerations, keep_ends, move_neighbours

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integers

# An acceleration of the nodes from `start` to `stop`, which at amplitude 1 is `body_force_axes` from index `axis` on;
# `momentum` is that of these nodes along the acceleration at the beginning of the step.
BODY_FORCE = np.dtype([("start", "i8"), ("stop", "i8"), ("axis", "i8"), ("column", "i8"), ("momentum", "f8")])


class System(NamedTuple):
    """The arguments of `accelerations` and `internal`; the last five arrays are written in every step."""

    groups: Any
    groups_aside: Any  # the same bodies, but what their materials remember of `internal` is written aside
    masses: Bulk
    boundary: Boundary  # with all constraints of the model, active or not
    laws: Any  # contact laws with a kernel, as returned by `percuss.step.law_kernels.nest`
    loads: Any  # loads that follow the motion, as returned by `percuss.step.parts.followers.nest`
    body_forces: Any  # BODY_FORCE
    body_force_axes: Floats  # accelerations of the bodies at amplitude 1
    active_constraints: Integers  # (constraints,) 1 if the constraint is active, else 0
    responses: Floats  # (stages, points) w of each point
    ends: Floats  # (stages, 3) r_v, r_a, s_a, as in `percuss.methods.interfaces.Stages`
    velocities: Floats  # (stages,) c, as in `percuss.methods.interfaces.Stages`
    times: Floats  # (stages,) fractions of the step
    dim: int
    amplitude: Floats  # (stages, columns) amplitude of each load at the times of the stages
    speed: Floats  # (2, columns) prescribed velocities at t_n and t_{n+1}
    effective: Floats  # (1, columns) effective amplitude of each load over the step, its impulse over dt
    amplitude_sums: Floats  # (columns,) sums of the effective amplitudes over the steps
    clock: Floats  # (3,) t_n, dt, and 1 if all contact equations of the step were solved, else 0


class StageAmplitudes(NamedTuple):
    """Amplitudes of the loads for T consecutive steps, one column for each load; column 0 is zero."""

    force: Floats  # (T, stages, columns) at the times of the stages
    speed: Floats  # (T, 2, columns) prescribed velocities at t_n and t_{n+1}


@called
def take_step(numbers: Any, system: System, u: Floats, v: Floats, kept: Floats, dt: float) -> None:
    """Make one step of the integrator (slot for its kernel)."""
    raise NotImplementedError


# ------------------------------------------------------------------------------------------------- forces of bodies


@called
def force_group(group: Group, u: Floats, force: Floats, dim: int) -> None:
    """Set `force` to the internal force on the nodes of the bodies of one group."""
    for b in range(group.body.size):
        lo = group.start[b] * dim
        hi = group.stop[b] * dim
        material = MaterialPoints(group.parameters[b], group.before, group.after)
        internal_force(group.element, material, group.first[b], dim, u[lo:hi], force[lo:hi])


@called
def forces(groups: Any, u: Floats, force: Floats, dim: int) -> None:
    """Set `force` to the internal force on the nodes of all bodies (slot)."""
    raise NotImplementedError


# ------------------------------------------------------------------------------------------------------- one stage


@called
def accelerate(system: System, stage: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set `a` to ``M^-1 (f_ext - f_int(u) + N lambda)``, followed by multipliers, reactions and amplitudes."""
    boundary, inverse_mass, dim = system.boundary, system.masses.inverse_mass, system.dim
    boundary_dofs, points = boundary.boundary_dofs, boundary.points
    amplitude = system.amplitude[stage]
    nodal = inverse_mass.size
    forces(system.groups, u, a, dim)
    for i in range(nodal):
        a[i] *= inverse_mass[i]
    couple_accelerations(system.masses, a)
    for i in range(system.body_forces.size):
        body_force = system.body_forces[i]
        for j in range(body_force.start, body_force.stop):
            for d in range(dim):
                a[j * dim + d] += amplitude[body_force.column] * system.body_force_axes[body_force.axis + d]
    keep_ends(boundary.neighbours, boundary_dofs, a)
    for i in range(boundary.nodal_forces.size):
        nodal_force = boundary.nodal_forces[i]
        for d in range(dim):
            a[boundary_dofs[nodal_force.place + d].dof] += (
                amplitude[nodal_force.column] * nodal_force.inverse_mass * boundary.axes[nodal_force.axis + d]
            )
    if boundary.followers.size > 0:
        accelerate_followers(system, stage, u, v, a)
    # A constraint replaces the acceleration along it by the mean acceleration of the prescribed velocity in the step.
    first = nodal + points.size  # index of the first constraint
    for i in range(boundary.constraints.size):
        constraint = boundary.constraints[i]
        a[first + i] = 0.0
        if system.active_constraints[i] == 1:
            current = component_along(constraint, boundary_dofs, boundary.axes, a, dim)
            prescribed = (system.speed[1, constraint.column] - system.speed[0, constraint.column]) / system.clock[1]
            a[first + i] = constraint.mass * (prescribed - current)
            add_along(constraint, boundary_dofs, boundary.axes, a, prescribed - current, dim)
    move_neighbours(boundary.neighbours, boundary_dofs, a)
    # Contact comes last, so that the acceleration it starts from contains loads and constraints.
    if points.size > 0:
        solve_contact(system, stage, u, v, a, nodal)
    for i in range(amplitude.size):
        a[first + boundary.constraints.size + i] = amplitude[i]
    for i in range(boundary.followers.size):
        follower = boundary.followers[i]
        a[first + boundary.constraints.size + follower.column] = follower.force


@called
def internal_accelerations(system: System, stage: int, u: Floats, f: Floats) -> None:
    """Set `f` to ``M^-1 f_int(u)``, with supports and drives held at no acceleration, followed by their reactions.

    What it sets is minus what `accelerate` would set without contacts, loads and changes of prescribed velocities, in
    every entry: reactions and impulses remain right in any sum of both. Contact does no work here.
    """
    boundary, inverse_mass, dim = system.boundary, system.masses.inverse_mass, system.dim
    nodal = inverse_mass.size
    first = nodal + boundary.points.size  # index of the first constraint
    forces(system.groups_aside, u, f, dim)
    for i in range(nodal):
        f[i] *= -inverse_mass[i]  # the kernels of elements return the force on the nodes, which is -f_int
    couple_accelerations(system.masses, f)
    for i in range(nodal, f.size):
        f[i] = 0.0
    keep_ends(boundary.neighbours, boundary.boundary_dofs, f)
    for i in range(boundary.constraints.size):
        constraint = boundary.constraints[i]
        if system.active_constraints[i] == 1:
            current = component_along(constraint, boundary.boundary_dofs, boundary.axes, f, dim)
            f[first + i] = -constraint.mass * current
            add_along(constraint, boundary.boundary_dofs, boundary.axes, f, -current, dim)
    move_neighbours(boundary.neighbours, boundary.boundary_dofs, f)


@called
def accelerate_followers(system: System, stage: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the accelerations by the forces that follow the motion of an end.

    They act at the velocity ``v + c a`` of the stage, to which each of them adds ``c / m`` of its own force.
    """
    ahead = system.velocities[stage]
    followers, boundary_dofs, axes = system.boundary.followers, system.boundary.boundary_dofs, system.boundary.axes
    for i in range(followers.size):
        follower = followers[i]
        follower.displacement = component_along(follower, boundary_dofs, axes, u, system.dim)
        follower.velocity = component_along(follower, boundary_dofs, axes, v, system.dim)
        follower.response = 0.0
        if ahead > 0.0:
            follower.velocity += ahead * component_along(follower, boundary_dofs, axes, a, system.dim)
            follower.response = ahead * follower.inverse_mass
        follower.share = system.amplitude[stage, follower.column]
    following_forces(system.loads, followers, system.clock[0] + system.times[stage] * system.clock[1])
    for i in range(followers.size):
        follower = followers[i]
        add_along(follower, boundary_dofs, axes, a, follower.inverse_mass * follower.force, system.dim)


@called
def component_along(constraint: Any, boundary_dofs: Any, axes: Floats, values: Floats, dim: int) -> float:
    """Return the component of a nodal quantity along a constraint, or a load that follows the motion."""
    total = 0.0
    for d in range(dim):
        total += axes[constraint.axis + d] * values[boundary_dofs[constraint.place + d].dof]
    return total


@called
def add_along(constraint: Any, boundary_dofs: Any, axes: Floats, values: Floats, increment: float, dim: int) -> None:
    """Add an increment along a constraint, or a load that follows the motion, to a nodal quantity."""
    for d in range(dim):
        values[boundary_dofs[constraint.place + d].dof] += increment * axes[constraint.axis + d]


@called
def solve_contact(system: System, stage: int, u: Floats, v: Floats, a: Floats, nodal: int) -> None:
    """Solve the contact equation of a stage, and add the accelerations and reactions by its multipliers."""
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
        p.deepest = max(p.deepest, -gap)
        p.gap = gap
        p.rate = rate
        p.predicted_gap = gap + end[0] * rate + end[1] * acceleration
        p.predicted_rate = rate + end[2] * acceleration
        p.response = system.responses[stage, i]
    time = system.clock[0] + system.times[stage] * system.clock[1]
    # Laws obtain the bulk acceleration as the difference of the two gap rates over the time s_a between them.
    if not find_multipliers(system.laws, points, boundary.others, system.clock[1], time, (end[1], end[2]), end[2]):
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
def begin(system: System, stage: int, u: Floats, v: Floats, kept: Floats) -> None:
    """Set the arrays kept between steps to the acceleration of the present state, evaluated as in the given stage."""
    for i in range(kept.shape[0]):
        accelerations(system, stage, u, v, kept[i])


# ------------------------------------------------------------------------------------------------------ whole steps


@called
def advance(
    system: System,
    numbers: Any,
    amplitudes: StageAmplitudes,
    record: Record,
    u: Floats,
    v: Floats,
    kept: Floats,
    dt: float,
    first: int,
    count: int,
) -> int:
    """Make `count` steps from step `first`; return `count`, or the number of steps before the first that failed.

    A step fails if a contact equation was not solved, or if the contact work exceeds its limit or is nan.
    """
    boundary, nodal = system.boundary, system.masses.mass.size
    boundary_dofs, points, totals = boundary.boundary_dofs, boundary.points, boundary.totals
    for s in range(count):
        n = first + s
        if record.field_every > 0 and n % record.field_every == 0:
            snapshot(record, boundary, u, v, dt, n)
        if n == 0:
            add_initial_strain_energy(system.groups, totals[0], u, v, system.dim, 0.0)
        save_state(boundary_dofs, u, v)
        prepare_step(system, amplitudes, s, n, u, v, dt)
        impose_velocities(system, u, v, dt, False)
        take_step(numbers, system, u, v, kept, dt)
        impose_velocities(system, u, v, dt, True)
        keep_state_variables(boundary)
        # Work and energies of the step follow from its impulses, as if constant forces, impulse over dt, had acted.
        for i in range(boundary_dofs.size):
            boundary_dofs[i].new_v = v[boundary_dofs[i].dof]
        find_contact_states(points, boundary.entries, boundary_dofs, dt)
        for i in range(points.size):
            points[i].multiplier = v[nodal + i] / dt
        work = sum_reactions(system, v, dt)
        start = nodal + points.size + boundary.constraints.size
        for i in range(system.amplitude_sums.size):
            system.effective[0, i] = v[start + i] / dt
            system.amplitude_sums[i] += system.effective[0, i]
        if boundary.nodal_forces.size > 0:
            work += work_of_nodal_forces(
                boundary.nodal_forces, boundary_dofs, boundary.axes, system.effective, 0, system.dim, dt
            )
        if boundary.followers.size > 0:
            work += work_of_nodal_forces(
                boundary.followers, boundary_dofs, boundary.axes, system.effective, 0, system.dim, dt
            )
        work += work_of_body_forces(system, v, dt)
        sound = add_up_work(boundary, work, n, dt)
        if is_recorded(record, n):
            kinetic_energy = kinetic_of(system.masses, v[:nodal])
            strain_energy = elastic(system.groups, u, v[:nodal], system.dim, 0.0)
            write_record(kinetic_energy, strain_energy, boundary, record, u, 0.0, n)
        if not (sound and system.clock[2] == 1.0):
            return s
    return count


@called
def prepare_step(system: System, amplitudes: StageAmplitudes, s: int, n: int, u: Floats, v: Floats, dt: float) -> None:
    """Set amplitudes, prescribed velocities and time of the step, and reset the entries that collect its impulses."""
    stages = system.times.size
    for k in range(stages):
        for i in range(system.amplitude_sums.size):
            system.amplitude[k, i] = amplitudes.force[s, k, i]
    for k in range(2):
        for i in range(system.amplitude_sums.size):
            system.speed[k, i] = amplitudes.speed[s, k, i]
    system.clock[0] = n * dt
    system.clock[1] = dt
    system.clock[2] = 1.0
    for i in range(system.masses.mass.size, u.size):
        u[i] = 0.0
        v[i] = 0.0
    for i in range(system.body_forces.size):
        body_force = system.body_forces[i]
        body_force.momentum = momentum(system, body_force, v)


@called
def momentum(system: System, body_force: Any, v: Floats) -> float:
    """Return the scalar product of a body force's acceleration at amplitude 1 and the momentum of its nodes."""
    total = 0.0
    for j in range(body_force.start, body_force.stop):
        for d in range(system.dim):
            k = j * system.dim + d
            total += system.masses.mass[k] * v[k] * system.body_force_axes[body_force.axis + d]
    return total


@called
def impose_velocities(system: System, u: Floats, v: Floats, dt: float, after: bool) -> None:
    """Set the velocities prescribed by supports and drives before or after the step; add the impulse to the reaction.

    After the step, the displacement along a constraint is set too, from the mean of the prescribed velocities.
    """
    boundary, dim = system.boundary, system.dim
    first = system.masses.mass.size + boundary.points.size
    keep_ends(boundary.neighbours, boundary.boundary_dofs, v)
    for i in range(boundary.constraints.size):
        constraint = boundary.constraints[i]
        if system.active_constraints[i] == 1:
            prescribed = system.speed[1 if after else 0, constraint.column]
            correction = prescribed - component_along(constraint, boundary.boundary_dofs, boundary.axes, v, dim)
            add_along(constraint, boundary.boundary_dofs, boundary.axes, v, correction, dim)
            v[first + i] += constraint.mass * correction
            if after:
                displacement = 0.5 * dt * (system.speed[0, constraint.column] + system.speed[1, constraint.column])
                for d in range(dim):
                    displacement += (
                        boundary.axes[constraint.axis + d] * boundary.boundary_dofs[constraint.place + d].old_u
                    )
                add_along(
                    constraint,
                    boundary.boundary_dofs,
                    boundary.axes,
                    u,
                    displacement - component_along(constraint, boundary.boundary_dofs, boundary.axes, u, dim),
                    dim,
                )
    move_neighbours(boundary.neighbours, boundary.boundary_dofs, v)


@called
def sum_reactions(system: System, v: Floats, dt: float) -> float:
    """Add up the reactions of the step; return their work."""
    boundary, work = system.boundary, 0.0
    first = system.masses.mass.size + boundary.points.size
    for i in range(boundary.constraints.size):
        constraint = boundary.constraints[i]
        impulse = v[first + i]
        if impulse != 0.0:
            constraint.reaction += impulse / dt
            boundary.totals[0].step_energy = max(boundary.totals[0].step_energy, impulse**2 / constraint.mass)
            for d in range(system.dim):
                q = boundary.boundary_dofs[constraint.place + d]
                work += 0.5 * impulse * boundary.axes[constraint.axis + d] * (q.old_v + q.new_v)
    return work


@called
def work_of_body_forces(system: System, v: Floats, dt: float) -> float:
    """Return the work of the body forces in the step."""
    work = 0.0
    for i in range(system.body_forces.size):
        body_force = system.body_forces[i]
        work += (
            0.5 * dt * system.effective[0, body_force.column] * (body_force.momentum + momentum(system, body_force, v))
        )
    return work
