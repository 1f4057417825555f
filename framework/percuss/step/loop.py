"""The compiled loop over the steps of leap-frog schemes: templates whose slots `percuss.step.build` fills.

A step takes displacements u_n and velocities v_{n-1/2} to u_{n+1} and v_{n+1/2}. It advances all bodies without contact
and then corrects the few degrees of freedom at which loads, supports, drives or contacts act. These are kept in record
arrays: in compiled code and in plain Python alike ``p = points[i]`` is a view whose fields are read and written by
name. In the functions, `p` is the record of a contact point and `q` that of a boundary degree of freedom.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.compiler.marks import called
from percuss.contact.equation import (
    BY_CURRENT,
    NOTHING,
    WITH_MASS,
    WITHOUT_MASS,
    rounding_energy,
    solve,
    stored_energy,
)
from percuss.step.bulk import Bulk, kinetic
from percuss.step.parts.coupled_masses import (
    carry_to_neighbours,
    couple_nodes,
    coupled_kinetic,
    keep_state,
)
from percuss.step.parts.end_forces import show_end_forces, show_gaps, soften_end_elements, work_and_energy
from percuss.step.parts.ends_without_mass import (
    compress_elements,
    find_coming_multipliers,
    follow_bodies,
    push_ends_with_mass,
    recall_multipliers,
)
from percuss.step.uniform_rows import advance_whole, energies

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integers

# Work below this fraction of the largest energy that a single force could add in one step counts as round-off.
NOISE = 1e-8

SWEEPS_BETWEEN_LAWS = 1000
TOLERANCE_BETWEEN_LAWS = 1e-13  # of the largest multiplier

# A boundary degree of freedom, which belongs to a node with contacts, loads, constraints or a probe.
BOUNDARY_DOF = np.dtype(
    [
        ("dof", "i8"),  # index in the global arrays of displacement and velocity
        ("mass", "f8"),
        ("body", "i8"),  # index of its body and direction in the momenta of the bodies
        ("old_u", "f8"),  # displacement at n
        ("old_v", "f8"),  # velocity at n - 1/2
        ("bulk_v", "f8"),  # velocity after the bulk update
        (
            "new_v",
            "f8",
        ),  # velocity corrected by loads, constraints and contacts; at the end of the step that at n + 1/2
        ("own_step", "i8"),  # steps from one action of the internal forces of its body to the next
        ("new_u", "f8"),  # displacement at n + 1, while that at the next action of these forces takes its place
    ]
)
# A constraint prescribes the velocity of a node along a direction, which is `axes` from index `axis` on; `reaction` is
# the sum of its reactions over the steps.
CONSTRAINT = np.dtype([("place", "i8"), ("axis", "i8"), ("mass", "f8"), ("column", "i8"), ("reaction", "f8")])
# The share of a contact force that a constraint takes: `hold` is the index of the constraint, `value` the component of
# the contact normal along it.
SHARE = np.dtype([("hold", "i8"), ("point", "i8"), ("value", "f8")])
# A force on a single node, which at amplitude 1 is `axes` from index `axis` on.
NODAL_FORCE = np.dtype([("place", "i8"), ("axis", "i8"), ("inverse_mass", "f8"), ("column", "i8")])
# Sums of the work over the steps, the bounds for them, and the energy growth.
TOTAL = np.dtype(
    [
        ("external_work", "f8"),
        ("contact_work", "f8"),
        ("largest_work", "f8"),  # largest absolute external work so far
        ("energy_before", "f8"),  # kinetic and strain energy before the first step
        ("began_with", "f8"),  # the larger of the energy before the first step and the kinetic energy at t = 0
        ("growth", "f8"),  # largest contact work allowed, over the energy put in
        ("floor", "f8"),  # contact work that counts as round-off
        ("step_energy", "f8"),  # largest energy that a contact or a constraint by itself would add in one step
        ("stored", "f8"),  # energy stored in the contacts at n + 1/2
        ("least", "f8"),  # smallest sum of contact work and stored energy so far
        ("rise", "f8"),  # largest rise of that sum above its smallest value so far
        ("rise_step", "i8"),  # step at the end of which it occurred
        ("drift", "f8"),  # sum of the changes at points with BY_CURRENT, in steps in which they neither open nor close
        ("largest_drift", "f8"),  # largest absolute value of `drift`
        ("drift_step", "i8"),  # step at the end of which it occurred
        ("round_off", "f8"),  # bound on the sum of the round-off errors of the energies, over the rounding unit
    ]
)


class Boundary(NamedTuple):
    """Records of the contacts, constraints and nodal forces, and of the degrees of freedom on which they act."""

    boundary_dofs: Any  # BOUNDARY_DOF
    points: Any  # percuss.contact.equation.POINT
    entries: Any  # percuss.contact.equation.ENTRY
    others: Any  # percuss.contact.equation.OTHER
    ends_without_mass: Any  # percuss.step.parts.ends_without_mass.END_WITHOUT_MASS
    end_forces: Any  # percuss.step.parts.end_forces.END_FORCE
    end_force_entries: Any  # percuss.step.parts.end_forces.END_FORCE_ENTRY
    neighbours: Any  # percuss.step.parts.coupled_masses.NEIGHBOUR
    constraints: Any  # CONSTRAINT
    shares: Any  # SHARE
    nodal_forces: Any  # NODAL_FORCE
    followers: Any  # percuss.step.parts.followers.FOLLOWER
    axes: Floats  # directions of the constraints, then the nodal forces at amplitude 1, then directions of followers
    totals: Any  # TOTAL, a single record
    before: Floats  # (bodies * dim,) momentum of each body at n - 1/2, empty where no load acts on whole bodies
    state_before: Floats  # state variables of contact laws, then of materials, as the last step has left them
    state_after: Floats  # the same, as the present step leaves them
    stored: Floats  # for each state variable the volume in which it is stored energy, else 0; empty if none is
    dissipated: Floats  # the same for dissipated energy
    stored_by_laws: (
        Floats  # for each state variable 1 if it is energy that a contact law stores, else 0; empty if none is
    )
    internal_work: Floats  # (1,) sum of the internal work of the steps, or (0,) where it is not summed up
    shifts: Floats  # shift of each boundary degree of freedom after the present step, or (0,) where no law shifts
    shifts_before: Floats  # the same after the step before


class Loop(NamedTuple):
    """The arrays that the steps of one stretch of a run work on; another stretch has other supports, drives or laws."""

    groups: Any  # (group, (group, ...)): each contains the bodies that share element class and material class
    masses: Bulk
    boundary: Boundary
    laws: Any  # contact laws with a kernel, as returned by `percuss.step.law_kernels.nest`
    loads: Any  # loads that follow the motion, as returned by `percuss.step.parts.followers.nest`
    uniform: Any  # percuss.step.uniform_rows.UNIFORM_BAR
    dim: int
    midpoint: float  # time within the first step of the stretch


class LoadAmplitudes(NamedTuple):
    """Amplitudes of the loads for T consecutive steps, one column for each load; column 0 is zero."""

    force: Floats  # (T, columns) at t_n
    velocity: Floats  # (T, columns) prescribed velocity at t_n + dt/2
    body_acceleration: Floats  # (T, bodies * dim) acceleration of each body by loads at t_n


class Record(NamedTuple):
    """Recorded histories: R rows, one for every `every`-th step and one for the last step."""

    every: int
    last: int  # step of the last record
    multiplier: Floats  # (R, P)
    gap: Floats  # (R, P)
    end_force: Floats  # (R, P)
    contact_state: Floats  # (R, state variables of contact laws) after the step
    displacement: Floats  # (R, probes * dim)
    velocity: Floats  # (R, probes * dim)
    probe: Integers  # (probes * dim,) indices of boundary degrees of freedom
    energy: Floats  # (R, 7) kinetic, elastic, external work, contact work, stored contact energy, internal work and
    # dissipated energy, at n + 1/2
    field_every: int  # steps between two snapshots, 0 for none
    field: Floats  # (F, recorded nodes * dim) displacement
    field_dof: Integers  # (recorded nodes * dim,)
    field_own_step: Integers  # (recorded nodes * dim,) steps by which they are advanced at a time
    field_state: Floats  # (F, state variables of the materials of recorded elements)
    field_variable: Integers  # indices of these state variables


def bulk(groups: Any, masses: Bulk, u: Floats, v: Floats, body_acceleration: Floats, dt: float) -> None:
    """Advance all bodies by a step without contact (slot of the bulk update)."""
    raise NotImplementedError


def elastic(groups: Any, u: Floats, v: Floats, dim: int, dt: float) -> float:
    """Return the strain energy of all bodies (slot)."""
    raise NotImplementedError


def kernel_laws(laws: Any, points: Any, others: Any, dt: float, time: float, response: tuple[float, float]) -> None:
    """Set the multipliers of laws with a kernel (slot); do nothing where there is none."""


def following_forces(loads: Any, followers: Any, time: float) -> None:
    """Set the forces of loads that follow the motion of an end (slot); do nothing where there is none."""


def find_multipliers(
    laws: Any, points: Any, others: Any, dt: float, time: float, response: tuple[float, float], span: float
) -> bool:
    """Find the multipliers of all points in a step or stage; return whether the solution converged.

    Laws with a kernel set theirs first, one law after the other; the contact equation is then solved with these forces.
    Where a kernel that uses the coupling shares an end with another law, both are repeated in turn until no multiplier
    changes any more.

    Parameters
    ----------
    laws
        The laws with a kernel, as returned by `percuss.step.law_kernels.nest`.
    points, others
        The contact points, and the off-diagonal entries of S.
    dt, time
        Time step, and time of the state.
    response
        The change of the predicted gap and of the predicted gap rate by a multiplier of 1/s.
    span
        Time between the two gap rates of a point.
    """
    in_turn = laws[0] == 1
    if in_turn:
        for i in range(points.size):
            points[i].multiplier = 0.0
    for sweep in range(SWEEPS_BETWEEN_LAWS):
        kernel_laws(laws, points, others, dt, time, response)
        sound = solve(points, others, span, WITH_MASS)
        if not in_turn or not sound:
            return sound
        moved = 0.0
        largest = 0.0
        for i in range(points.size):
            p = points[i]
            if not np.isfinite(p.multiplier):
                return False
            moved = max(moved, abs(p.multiplier - p.found_before))
            largest = max(largest, abs(p.multiplier))
            p.found_before = p.multiplier
        if sweep > 0 and moved <= TOLERANCE_BETWEEN_LAWS * largest:
            return True
    return False


def advance(
    loop: Loop, amplitudes: LoadAmplitudes, record: Record, u: Floats, v: Floats, dt: float, first: int, count: int
) -> int:
    """Make `count` steps from step `first`; return `count`, or the number of steps before the first that failed.

    A step fails if the contact equation was not solved, or if the contact work exceeds its limit or is nan.
    """
    groups, boundary, dim = loop.groups, loop.boundary, loop.dim
    for s in range(count):
        n = first + s
        if record.field_every > 0 and n % record.field_every == 0:
            snapshot(record, boundary, u, v, dt, n)
        if n == 0:
            add_initial_strain_energy(groups, boundary.totals[0], u, v, dim, dt)
        sound = make_step(loop, amplitudes, u, v, dt, first, s)
        if is_recorded(record, n):
            if loop.uniform.size > 0:
                kinetic_energy, strain_energy = energies(loop.uniform, u, v, dt)
            else:
                kinetic_energy = kinetic_of(loop.masses, v)
                move_to_next_action(boundary, u, v, n + 1, dt)
                strain_energy = elastic(groups, u, v, dim, dt)
                move_back(boundary, u, v)
            write_record(kinetic_energy, strain_energy, boundary, record, u, dt, n)
        if not sound:
            return s
    return count


def kinetic_of(masses: Bulk, v: Floats) -> float:
    """Return the kinetic energy ``v M v / 2`` of all bodies."""
    if masses.factor.size > 0:
        return coupled_kinetic(masses, v, masses.correction)
    return kinetic(masses.mass, v)


def is_recorded(record: Record, n: int) -> bool:
    """Return whether a record is written for step n."""
    return n % record.every == 0 or n == record.last


def make_step(loop: Loop, amplitudes: LoadAmplitudes, u: Floats, v: Floats, dt: float, first: int, s: int) -> bool:
    """Make step ``first + s``; return whether it is sound."""
    masses, boundary, dim = loop.masses, loop.boundary, loop.dim
    boundary_dofs, points = boundary.boundary_dofs, boundary.points
    # Bulk update: internal forces and body forces advance all nodes as if nothing else acted.
    save_state(boundary_dofs, u, v)
    if loop.uniform.size > 0:
        advance_whole(loop.uniform, u, v, dt)
    else:
        for i in range(masses.momentum.size):
            masses.momentum[i] = 0.0
        keep_state(masses, u, v)
        masses.number[0] = first + s
        bulk(loop.groups, masses, u, v, amplitudes.body_acceleration[s], dt)
        if masses.change.size > 0:
            couple_nodes(masses, u, v, boundary.internal_work, dt)
    for i in range(boundary_dofs.size):
        q = boundary_dofs[i]
        q.bulk_v = v[q.dof]
        q.new_v = q.bulk_v
    # Loads and constraints correct the boundary velocities before contact, so that the predicted gaps contain them.
    apply_nodal_forces(boundary, amplitudes, s, dim, dt)
    apply_followers(boundary, loop.loads, amplitudes, s, (first + s) * dt, dim, dt)
    soften_end_elements(points, boundary.end_forces, boundary.end_force_entries, boundary_dofs, dt)
    work = impose_velocity(boundary, amplitudes, s, dim, dt)
    carry_to_neighbours(boundary.neighbours, boundary_dofs)
    # Contact: the multipliers follow from the current or the predicted state. They change the velocities except along
    # prescribed directions, where the constraints take the contact forces as reactions.
    sound = True
    if points.size > 0:
        if boundary.ends_without_mass.size > 0:
            # Their forces of this step are known; what they move of the ends with mass that they meet comes first.
            recall_multipliers(points)
            push_ends_with_mass(points, boundary.entries, boundary_dofs, dt)
        find_contact_states(points, boundary.entries, boundary_dofs, dt)
        show_end_forces(points, boundary.end_forces, boundary.end_force_entries, boundary_dofs, dt)
        sound = find_multipliers(loop.laws, points, boundary.others, dt, (first + s) * dt, (dt * dt, dt), dt)
        show_gaps(points, boundary.end_forces)
        apply_multipliers(points, boundary.entries, boundary_dofs, dt)
        find_shifts(boundary)
    work += add_contact_reactions(boundary, amplitudes, s, dim, dt)
    work += work_of_loads(boundary, masses.momentum, amplitudes, s, dim, dt)
    # The corrected velocities replace those of the bulk update, and the displacements follow from them.
    write_back(boundary_dofs, u, v, dt)
    if boundary.ends_without_mass.size > 0:
        sound = balance_ends_without_mass(boundary, u, v, dt) and sound
    if boundary.internal_work.size > 0:
        add_work_on_corrections(boundary, masses, amplitudes, s, dt)
    if boundary.shifts.size > 0:
        work += add_work_of_shifts(boundary, masses, amplitudes, s, dim, dt)
        apply_shifts(boundary, u)
    keep_state_variables(boundary)
    return add_up_work(boundary, work, first + s, dt) and sound


def add_initial_strain_energy(groups: Any, total: Any, u: Floats, v: Floats, dim: int, dt: float) -> None:
    """Add the strain energy before the first step to the energy at the beginning of the run."""
    total.energy_before += elastic(groups, u, v, dim, dt)
    total.began_with = max(total.began_with, total.energy_before)


def add_up_work(boundary: Boundary, work: float, n: int, dt: float) -> bool:
    """Add up the work and the contact energy of step n, and return whether the step is sound.

    Contact work far above the energy put in means an unstable step; a contact work of nan fails the comparison too.
    """
    total = boundary.totals[0]
    total.external_work += work
    total.largest_work = max(total.largest_work, abs(total.external_work))
    update_contact_energy(boundary, n, dt)
    limit = total.growth * (total.began_with + total.largest_work) + total.floor + NOISE * total.step_energy
    return total.contact_work <= limit  # type: ignore[no-any-return]


def save_state(boundary_dofs: Any, u: Floats, v: Floats) -> None:
    """Save displacement and velocity of the boundary degrees of freedom before the step, as `old_u` and `old_v`."""
    for i in range(boundary_dofs.size):
        q = boundary_dofs[i]
        q.old_u = u[q.dof]
        q.old_v = v[q.dof]


def write_back(boundary_dofs: Any, u: Floats, v: Floats, dt: float) -> None:
    """Write the corrected velocities to the global array, and the displacements u_{n+1} = u_n + dt v_{n+1/2}."""
    for i in range(boundary_dofs.size):
        q = boundary_dofs[i]
        v[q.dof] = q.new_v
        u[q.dof] = q.old_u + dt * q.new_v


def lumped_change(masses: Bulk, q: Any) -> float:
    """Return the change of a boundary velocity by the bulk update with nodal masses, from which the force follows."""
    if masses.change.size > 0:
        return masses.change[q.dof]  # type: ignore[no-any-return]
    return q.bulk_v - q.old_v  # type: ignore[no-any-return]


def add_work_on_corrections(boundary: Boundary, masses: Bulk, amplitudes: LoadAmplitudes, s: int, dt: float) -> None:
    """Add the internal work on the corrections of the boundary velocities, which the bulk update did not know."""
    for i in range(boundary.boundary_dofs.size):
        q = boundary.boundary_dofs[i]
        force = q.mass * (lumped_change(masses, q) / dt - amplitudes.body_acceleration[s, q.body])
        boundary.internal_work[0] -= 0.5 * dt * force * (q.new_v - q.bulk_v)


def find_shifts(boundary: Boundary) -> None:
    """Set the shifts of the boundary degrees of freedom from those of the points, and keep those of the last step."""
    for i in range(boundary.shifts.size):
        boundary.shifts_before[i] = boundary.shifts[i]
        boundary.shifts[i] = 0.0
    if boundary.shifts.size > 0:
        for i in range(boundary.points.size):
            p = boundary.points[i]
            for k in range(p.start, p.stop):
                boundary.shifts[boundary.entries[k].place] += boundary.entries[k].response * p.shift


def apply_shifts(boundary: Boundary, u: Floats) -> None:
    """Add the shifts to the displacements u_{n+1}."""
    for i in range(boundary.shifts.size):
        u[boundary.boundary_dofs[i].dof] += boundary.shifts[i]


def add_work_of_shifts(
    boundary: Boundary, masses: Bulk, amplitudes: LoadAmplitudes, s: int, dim: int, dt: float
) -> float:
    """Add the work of shifts to the contact work, and the internal work on them; return that of loads on them.

    The strain energy between u_n and the shifted u_{n+1} is ``u_n K u_{n+1} / 2``. A shift changes it by half its
    product with the internal force at u_n, and the step that follows changes it by half the product with that at
    u_{n+1} beyond the work of the velocities. Each step therefore counts its own shift and that of the step before.
    """
    work = 0.0
    on_bodies = 0.0
    for i in range(boundary.shifts.size):
        q = boundary.boundary_dofs[i]
        moved = boundary.shifts_before[i] + boundary.shifts[i]
        body_force = q.mass * amplitudes.body_acceleration[s, q.body]
        internal_force = body_force - q.mass * lumped_change(masses, q) / dt
        on_bodies += internal_force * moved
        work += body_force * moved
    for i in range(boundary.nodal_forces.size):
        nodal_force = boundary.nodal_forces[i]
        for d in range(dim):
            moved = boundary.shifts_before[nodal_force.place + d] + boundary.shifts[nodal_force.place + d]
            work += amplitudes.force[s, nodal_force.column] * boundary.axes[nodal_force.axis + d] * moved
    for i in range(boundary.followers.size):
        follower = boundary.followers[i]
        for d in range(dim):
            moved = boundary.shifts_before[follower.place + d] + boundary.shifts[follower.place + d]
            work += follower.force * boundary.axes[follower.axis + d] * moved
    boundary.totals[0].contact_work += 0.5 * (on_bodies - work)
    if boundary.internal_work.size > 0:
        boundary.internal_work[0] += 0.5 * on_bodies
    return 0.5 * work


def move_to_next_action(boundary: Boundary, u: Floats, v: Floats, n: int, dt: float) -> None:
    """Move boundary degrees of freedom from t_n to where the strain energy of their bodies is taken.

    The velocities become those that take u_n to the shifted u_{n+1}. A body whose internal forces do not act in every
    step has been advanced to the time at which they act next, and the boundary follows it along its velocities.
    """
    for i in range(boundary.shifts.size):
        v[boundary.boundary_dofs[i].dof] += boundary.shifts[i] / dt
    for i in range(boundary.boundary_dofs.size):
        q = boundary.boundary_dofs[i]
        if q.own_step > 1:
            q.new_u = u[q.dof]
            u[q.dof] += (-n) % q.own_step * dt * v[q.dof]


def move_back(boundary: Boundary, u: Floats, v: Floats) -> None:
    """Move boundary degrees of freedom back to t_n, and make their velocities what they were, to the last bit."""
    for i in range(boundary.shifts.size):
        v[boundary.boundary_dofs[i].dof] = boundary.boundary_dofs[i].new_v
    for i in range(boundary.boundary_dofs.size):
        q = boundary.boundary_dofs[i]
        if q.own_step > 1:
            u[q.dof] = q.new_u


def sum_of_products(weights: Floats, values: Floats) -> float:
    """Return the sum of the products of weights and values."""
    total = 0.0
    for i in range(weights.size):
        total += weights[i] * values[i]
    return total


def keep_state_variables(boundary: Boundary) -> None:
    """Carry the state variables of contact laws and materials over to the next step."""
    for i in range(boundary.state_before.size):
        boundary.state_before[i] = boundary.state_after[i]


def apply_nodal_forces(boundary: Boundary, amplitudes: LoadAmplitudes, s: int, dim: int, dt: float) -> None:
    """Add the velocity change by forces on single nodes."""
    for i in range(boundary.nodal_forces.size):
        nodal_force = boundary.nodal_forces[i]
        scale = dt * nodal_force.inverse_mass * amplitudes.force[s, nodal_force.column]
        for d in range(dim):
            boundary.boundary_dofs[nodal_force.place + d].new_v += scale * boundary.axes[nodal_force.axis + d]


def apply_followers(
    boundary: Boundary, loads: Any, amplitudes: LoadAmplitudes, s: int, time: float, dim: int, dt: float
) -> None:
    """Add the velocity change by the forces that follow the motion of an end."""
    followers, boundary_dofs, axes = boundary.followers, boundary.boundary_dofs, boundary.axes
    if followers.size == 0:
        return
    for i in range(followers.size):
        follower = followers[i]
        displacement = 0.0
        velocity = 0.0
        for d in range(dim):
            q = boundary_dofs[follower.place + d]
            displacement += axes[follower.axis + d] * q.old_u
            velocity += axes[follower.axis + d] * 0.5 * (q.old_v + q.new_v)
        follower.displacement = displacement
        follower.velocity = velocity
        follower.response = 0.5 * dt * follower.inverse_mass
        follower.share = amplitudes.force[s, follower.column]
    following_forces(loads, followers, time)
    for i in range(followers.size):
        follower = followers[i]
        follower.impulse += dt * follower.force
        scale = dt * follower.inverse_mass * follower.force
        for d in range(dim):
            boundary_dofs[follower.place + d].new_v += scale * axes[follower.axis + d]


def impose_velocity(boundary: Boundary, amplitudes: LoadAmplitudes, s: int, dim: int, dt: float) -> float:
    """Set the velocities prescribed by supports and drives, add up their reactions and return the work of these.

    Contact forces are not known yet; `add_contact_reactions` adds the reactions to them.
    """
    boundary_dofs, axes, total = boundary.boundary_dofs, boundary.axes, boundary.totals[0]
    work = 0.0
    for i in range(boundary.constraints.size):
        constraint = boundary.constraints[i]
        current = 0.0
        previous = 0.0
        for d in range(dim):
            current += axes[constraint.axis + d] * boundary_dofs[constraint.place + d].new_v
            previous += axes[constraint.axis + d] * boundary_dofs[constraint.place + d].old_v
        prescribed = amplitudes.velocity[s, constraint.column]
        for d in range(dim):
            boundary_dofs[constraint.place + d].new_v += (prescribed - current) * axes[constraint.axis + d]
        reaction = constraint.mass * (prescribed - current) / dt
        constraint.reaction += reaction
        total.step_energy = max(total.step_energy, constraint.mass * (prescribed - current) ** 2)
        work += reaction * (previous + prescribed)
    return 0.5 * dt * work


def add_contact_reactions(boundary: Boundary, amplitudes: LoadAmplitudes, s: int, dim: int, dt: float) -> float:
    """Add the reactions of supports and drives to the contact forces on their nodes; return their work."""
    work = 0.0
    for i in range(boundary.shares.size):
        share = boundary.shares[i]
        constraint = boundary.constraints[share.hold]
        previous = 0.0
        for d in range(dim):
            previous += boundary.axes[constraint.axis + d] * boundary.boundary_dofs[constraint.place + d].old_v
        reaction = -share.value * boundary.points[share.point].multiplier
        constraint.reaction += reaction
        work += reaction * (previous + amplitudes.velocity[s, constraint.column])
    return 0.5 * dt * work


def work_of_loads(
    boundary: Boundary, momentum: Floats, amplitudes: LoadAmplitudes, s: int, dim: int, dt: float
) -> float:
    """Return the work of forces on single nodes and on whole bodies, and update the momenta of the bodies."""
    boundary_dofs = boundary.boundary_dofs
    work = work_of_nodal_forces(boundary.nodal_forces, boundary_dofs, boundary.axes, amplitudes.force, s, dim, dt)
    for i in range(boundary.followers.size):
        follower = boundary.followers[i]
        for d in range(dim):
            q = boundary_dofs[follower.place + d]
            work += 0.5 * dt * follower.force * boundary.axes[follower.axis + d] * (q.old_v + q.new_v)
    if momentum.size == 0:
        return work
    # The bulk update has summed the momenta; the corrections of the boundary velocities are added.
    for i in range(boundary_dofs.size):
        q = boundary_dofs[i]
        momentum[q.body] += q.mass * (q.new_v - q.bulk_v)
    body_work = 0.0
    for i in range(momentum.size):
        body_work += amplitudes.body_acceleration[s, i] * (momentum[i] + boundary.before[i])
        boundary.before[i] = momentum[i]
    return work + 0.5 * dt * body_work


def work_of_nodal_forces(
    nodal_forces: Any, boundary_dofs: Any, axes: Floats, amplitude: Floats, s: int, dim: int, dt: float
) -> float:
    """Return the work of forces on single nodes, which is force times (u_{n+1} - u_{n-1}) / 2."""
    work = 0.0
    for i in range(nodal_forces.size):
        nodal_force = nodal_forces[i]
        for d in range(dim):
            q = boundary_dofs[nodal_force.place + d]
            work += amplitude[s, nodal_force.column] * axes[nodal_force.axis + d] * (q.old_v + q.new_v)
    return 0.5 * dt * work


def find_contact_states(points: Any, entries: Any, boundary_dofs: Any, dt: float) -> None:
    """Compute gap and gap rate of each point, the current values and those predicted without contact."""
    for i in range(points.size):
        p = points[i]
        gap = p.initial_gap
        predicted_gap = p.initial_gap
        rate = 0.0
        predicted_rate = 0.0
        for k in range(p.start, p.stop):
            normal = entries[k].normal
            q = boundary_dofs[entries[k].place]
            gap += normal * q.old_u
            predicted_gap += normal * (q.old_u + dt * q.new_v)
            rate += normal * q.old_v
            predicted_rate += normal * q.new_v
        p.gap = gap
        p.predicted_gap = predicted_gap
        p.rate = rate
        p.predicted_rate = predicted_rate


def balance_ends_without_mass(boundary: Boundary, u: Floats, v: Floats, dt: float) -> bool:
    """Move the ends without mass to their static balance after the step; return whether the solution converged."""
    points, ends, boundary_dofs = boundary.points, boundary.ends_without_mass, boundary.boundary_dofs
    follow_bodies(ends, boundary_dofs, u, dt)
    find_contact_states(points, boundary.entries, boundary_dofs, dt)
    sound = find_coming_multipliers(points, boundary.others, dt)
    compress_elements(points, ends, boundary_dofs, u, v, dt)
    return sound


def apply_multipliers(points: Any, entries: Any, boundary_dofs: Any, dt: float) -> None:
    """Add the velocity change dt M^-1 N lambda by the contact forces."""
    for i in range(points.size):
        p = points[i]
        if p.multiplier != 0.0 and p.source != WITHOUT_MASS:
            for k in range(p.start, p.stop):
                boundary_dofs[entries[k].place].new_v += dt * entries[k].response * p.multiplier


def update_contact_energy(boundary: Boundary, n: int, dt: float) -> None:
    """Add up work, stored energy, impulses and overlaps of the contacts in a step, and track the energy growth."""
    points, entries = boundary.points, boundary.entries
    boundary_dofs, total = boundary.boundary_dofs, boundary.totals[0]
    work = 0.0
    energy_sum = 0.0
    steady_change = 0.0
    any_contact = False
    if boundary.end_forces.size > 0:
        any_contact = True
        work, energy_sum, steady_change = work_and_energy(
            points, boundary.end_forces, boundary.end_force_entries, entries, boundary_dofs, total, dt
        )
    for i in range(points.size):
        p = points[i]
        # Without a force in this step and the one before, a contact may still store energy if its gap is closed, or if
        # other contacts act on its ends.
        may_store = p.stores != NOTHING and (p.gap < 0.0 or p.other_start < p.other_stop)
        if p.multiplier != 0.0 or p.active == 1 or may_store:
            any_contact = True
            rate = 0.0
            reach = 0.0
            for k in range(p.start, p.stop):
                q = boundary_dofs[entries[k].place]
                rate += entries[k].normal * q.new_v
                reach = max(reach, abs(q.old_u) + dt * abs(q.new_v))
            point_work = 0.5 * dt * p.multiplier * (p.rate + rate)
            energy = stored_energy(p, rate, dt)
            active = 1 if p.multiplier != 0.0 or energy != 0.0 else 0
            if p.stores == BY_CURRENT and p.active == active:
                steady_change += point_work + energy - p.stored
            total.round_off += rounding_energy(p, rate, reach, dt)
            energy_sum += energy
            work += point_work
            p.stored = energy
            p.active = active
        if p.multiplier != 0.0:
            p.impulse += dt * p.multiplier
            total.step_energy = max(total.step_energy, (dt * p.multiplier) ** 2 * p.delassus)
            p.peak = max(p.peak, p.multiplier)
            p.closed += 1
            if p.first < 0:
                p.first = n
            p.last = n
        if p.gap < 0.0:
            p.overlap -= p.gap
            p.deepest = max(p.deepest, -p.gap)
    if any_contact or boundary.stored_by_laws.size > 0:
        total.contact_work += work
        # Points that were left out store no energy, except in state variables.
        total.stored = energy_sum + sum_of_products(boundary.stored_by_laws, boundary.state_after)
        total.round_off += abs(total.contact_work)
        track_growth(total, steady_change, n)


def track_growth(total: Any, steady_change: float, n: int) -> None:
    """Update the largest rise of contact work plus stored energy above its smallest value so far, and the drift.

    Bodies that touch at the start under load had a closed gap without a contact force one step before t = 0. The energy
    change that this causes in the first step is no growth, so that tracking starts after that step.
    """
    energy = total.contact_work + total.stored
    if n == 0:
        total.least = energy
        return
    total.least = min(total.least, energy)
    if energy - total.least > total.rise:
        total.rise = energy - total.least
        total.rise_step = n
    total.drift += steady_change
    if abs(total.drift) > total.largest_drift:
        total.largest_drift = abs(total.drift)
        total.drift_step = n


@called
def snapshot(record: Record, boundary: Boundary, u: Floats, v: Floats, dt: float, n: int) -> None:
    """Record the displacements and state variables from which the stress field is computed.

    Nodes that are advanced by several steps at a time are ahead of t_n, and have moved at a constant velocity.
    """
    r = n // record.field_every
    for k in range(record.field_variable.size):
        record.field_state[r, k] = boundary.state_before[record.field_variable[k]]
    for k in range(record.field_dof.size):
        record.field[r, k] = u[record.field_dof[k]]
        if record.field_own_step[k] > 1:
            record.field[r, k] -= (-n) % record.field_own_step[k] * dt * v[record.field_dof[k]]


@called
def write_record(
    kinetic_energy: float, strain_energy: float, boundary: Boundary, record: Record, u: Floats, lag: float, n: int
) -> None:
    """Write the record of step n: state at t_n, multipliers, and energies after the step.

    Where velocities lag behind displacements, the velocity at t_n is the mean of those before and after the step. The
    end force is the stiffness of an explicit law times the overlap at the end of the step. `lag` is the time by which
    velocities lag behind displacements: dt in a leap-frog scheme, 0 in a multi-stage scheme.
    """
    boundary_dofs = boundary.boundary_dofs
    r = n // record.every if n % record.every == 0 else record.energy.shape[0] - 1
    for i in range(boundary.points.size):
        p = boundary.points[i]
        record.multiplier[r, i] = p.multiplier
        record.gap[r, i] = p.gap
        after = p.initial_gap
        for k in range(p.start, p.stop):
            after += boundary.entries[k].normal * u[boundary_dofs[boundary.entries[k].place].dof]
        record.end_force[r, i] = p.end_stiffness * max(-after, 0.0)
    for i in range(record.contact_state.shape[1]):
        record.contact_state[r, i] = boundary.state_after[i]
    for k in range(record.probe.size):
        q = boundary_dofs[record.probe[k]]
        record.displacement[r, k] = q.old_u
        record.velocity[r, k] = 0.5 * (q.old_v + q.new_v) if lag > 0.0 else q.old_v
    record.energy[r, 0] = kinetic_energy
    record.energy[r, 1] = strain_energy + sum_of_products(boundary.stored, boundary.state_after)
    record.energy[r, 2] = boundary.totals[0].external_work
    record.energy[r, 3] = boundary.totals[0].contact_work
    record.energy[r, 4] = boundary.totals[0].stored
    if boundary.internal_work.size > 0:
        record.energy[r, 5] = boundary.internal_work[0]
    record.energy[r, 6] = sum_of_products(boundary.dissipated, boundary.state_after)
