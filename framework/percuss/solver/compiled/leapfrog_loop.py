"""The loop over steps, as it is compiled: templates whose slots `percuss.solver.march` binds.

What acts on few nodes is kept in record arrays: in compiled code and in plain Python alike ``p = points[i]`` is a view
whose fields are read and written by name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.solver.compiled.bulk import Bulk, kinetic
from percuss.solver.compiled.contact_equation import BY_CURRENT, NOTHING, rounded, solve, stored
from percuss.solver.compiled.marks import called

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integers

# Relative threshold: work below this fraction of the largest energy that a single force could add in one step is
# round-off.
NOISE = 1e-8

SWEEPS_BETWEEN_LAWS = 1000
TOLERANCE_BETWEEN_LAWS = 1e-13  # of the largest multiplier

# a degree of freedom of the few nodes at which more than the bulk acts
BOUNDARY_DOF = np.dtype(
    [
        ("dof", "i8"),  # place in the flat global arrays
        ("mass", "f8"),
        ("body", "i8"),  # its entry in the bodies' momenta
        ("old_u", "f8"),  # displacement at n
        ("old_v", "f8"),  # velocity at n - 1/2
        ("bulk_v", "f8"),  # velocity right after the bulk update
        ("new_v", "f8"),  # velocity as loads, supports and contacts correct it, in the end that at n + 1/2
    ]
)
# a direction (`axes` from `axis` on) in which a node's velocity is prescribed; `reaction` is the sum over steps
CONSTRAINT = np.dtype([("place", "i8"), ("axis", "i8"), ("mass", "f8"), ("column", "i8"), ("reaction", "f8")])
# the part of a contact force that a hold bears
SHARE = np.dtype([("hold", "i8"), ("point", "i8"), ("value", "f8")])
# a force on a single node: `axes` from `axis` on is the force at amplitude 1
NODAL_FORCE = np.dtype([("place", "i8"), ("axis", "i8"), ("inverse_mass", "f8"), ("column", "i8")])
# works so far, and what the watch compares them with
TOTAL = np.dtype(
    [
        ("external_work", "f8"),
        ("contact_work", "f8"),
        ("largest_work", "f8"),  # largest absolute external work so far
        ("energy_before", "f8"),  # before the first step: kinetic energy, to which that step adds the strain energy
        ("began_with", "f8"),  # the larger of the energy before the first step and the kinetic energy at t = 0
        ("growth", "f8"),  # contact work allowed, over all energy put in
        ("floor", "f8"),  # contact work that is noise
        ("step_energy", "f8"),  # largest energy that a contact or a hold by itself would bring in one step
        ("stored", "f8"),  # energy that the contacts store at n + 1/2
        ("least", "f8"),  # smallest contact work with what is stored so far
        ("rise", "f8"),  # largest rise above it
        ("rise_step", "i8"),  # step at whose end that was
        ("drift", "f8"),  # sum of the changes in steps in which a point judged at its current gap does not switch
        ("largest_drift", "f8"),
        ("drift_step", "i8"),
        ("round_off", "f8"),  # sum over steps: times the rounding unit, what rounding may have done
    ]
)


class Boundary(NamedTuple):
    """The nodes at which more than the bulk acts: contacts, constraints, nodal forces, and their sums."""

    boundary_dofs: Any  # BOUNDARY_DOF
    points: Any  # percuss.solver.compiled.contact_equation.POINT
    entries: Any  # percuss.solver.compiled.contact_equation.ENTRY
    others: Any  # percuss.solver.compiled.contact_equation.OTHER
    constraints: Any  # CONSTRAINT
    shares: Any  # SHARE
    nodal_forces: Any  # NODAL_FORCE
    axes: Floats
    totals: Any  # TOTAL, one
    momentum: Floats  # (bodies * dim,) at n + 1/2, empty where no load acts on whole bodies
    before: Floats  # (bodies * dim,) at n - 1/2, or empty


class Drive(NamedTuple):
    """Amplitudes of the loads for a run of T steps."""

    force: Floats  # (T, columns) at t_n
    velocity: Floats  # (T, columns) at t_n+1/2
    pull: Floats  # (T, bodies * dim) acceleration of each body at t_n


class Record(NamedTuple):
    """What is kept: R records, every `every` steps and at the last step."""

    every: int
    last: int  # step of the last record
    multiplier: Floats  # (R, P)
    gap: Floats  # (R, P)
    end_force: Floats  # (R, P)
    displacement: Floats  # (R, probes * dim)
    velocity: Floats  # (R, probes * dim)
    probe: Integers  # (probes * dim,) places among the boundary degrees of freedom
    energy: Floats  # (R, 5) kinetic, elastic, external work, contact work, energy the contacts store, at n + 1/2
    field_every: int  # 0: no field is kept
    field: Floats  # (F, nodes kept * dim) displacement
    field_dof: Integers  # (nodes kept * dim,)


def bulk(
    groups: Any,
    masses: Bulk,
    u: Floats,
    v: Floats,
    pull: Floats,
    momentum: Floats,
    dim: int,
    dt: float,
) -> None:
    """Slot: advance all bodies by a step without contact."""
    raise NotImplementedError


def elastic(groups: Any, u: Floats, v: Floats, dim: int, dt: float) -> float:
    """Slot: the strain energy of all bodies."""
    raise NotImplementedError


def own_laws(bound: Any, points: Any, others: Any, dt: float, time: float, response: tuple[float, float]) -> None:
    """Slot: the multipliers of laws that are not rows; nothing to do where there is none."""


def find_multipliers(
    bound: Any, points: Any, others: Any, dt: float, time: float, response: tuple[float, float], span: float
) -> bool:
    """Find the multipliers of all points in a step or stage; return whether they were found.

    Laws with a kernel come first, one after the other, and the rows are solved with their forces. Where a kernel that
    takes account of others shares an end with another law, both are repeated until no multiplier moves.

    Parameters
    ----------
    bound
        What `percuss.solver.compiled.custom_laws.nest` returned.
    points, others
        Contact points, and the entries of S off its diagonal.
    dt, time
        Step, and time of the state.
    response
        What a multiplier of 1/s adds to the predicted gap and to the predicted rate.
    span
        Time between the two gap rates of a point.
    """
    in_turn = bound[0] == 1
    if in_turn:
        for i in range(points.size):
            points[i].multiplier = 0.0
    for sweep in range(SWEEPS_BETWEEN_LAWS):
        own_laws(bound, points, others, dt, time, response)
        sound = solve(points, others, span)
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
    groups: Any,
    masses: Bulk,
    boundary: Boundary,
    bound: Any,
    drive: Drive,
    record: Record,
    u: Floats,
    v: Floats,
    dim: int,
    dt: float,
    first: int,
    count: int,
) -> int:
    """March `count` steps from step `first`; return how many were done when one was not sound, else `count`."""
    boundary_dofs, points, totals = boundary.boundary_dofs, boundary.points, boundary.totals
    for s in range(count):
        n = first + s
        if record.field_every > 0 and n % record.field_every == 0:
            snapshot(record, u, n)
        if n == 0:
            take_strain_energy(groups, totals[0], u, v, dim, dt)
        save_state(boundary_dofs, u, v)
        for i in range(boundary.momentum.size):
            boundary.momentum[i] = 0.0
        bulk(groups, masses, u, v, drive.pull[s], boundary.momentum, dim, dt)
        for i in range(boundary_dofs.size):
            q = boundary_dofs[i]
            q.bulk_v = v[q.dof]
            q.new_v = q.bulk_v
        apply_nodal_forces(boundary, drive, s, dim, dt)
        work = impose_velocity(boundary, drive, s, dim, dt)
        sound = True
        if points.size > 0:
            find_contact_states(points, boundary.entries, boundary_dofs, dt)
            sound = find_multipliers(bound, points, boundary.others, dt, n * dt, (dt * dt, dt), dt)
            correct(points, boundary.entries, boundary_dofs, dt)
        work += add_contact_reactions(boundary, drive, s, dim, dt)
        work += work_of_loads(boundary, drive, s, dim, dt)
        write_back(boundary_dofs, u, v, dt)
        total = totals[0]
        total.external_work += work
        total.largest_work = max(total.largest_work, abs(total.external_work))
        contact_energy(points, boundary.entries, boundary_dofs, totals, n, dt)
        if n % record.every == 0 or n == record.last:
            keep(groups, masses, boundary, record, u, v, dim, dt, n)
        limit = total.growth * (total.began_with + total.largest_work) + total.floor + NOISE * total.step_energy
        # the comparison fails for a work that is no number, too
        if not (sound and total.contact_work <= limit):
            return s
    return count


def take_strain_energy(groups: Any, total: Any, u: Floats, v: Floats, dim: int, dt: float) -> None:
    """Add the strain energy before the first step to the energy that the run begins with."""
    total.energy_before += elastic(groups, u, v, dim, dt)
    total.began_with = max(total.began_with, total.energy_before)


def save_state(boundary_dofs: Any, u: Floats, v: Floats) -> None:
    """Note the state before the step."""
    for i in range(boundary_dofs.size):
        q = boundary_dofs[i]
        q.old_u = u[q.dof]
        q.old_v = v[q.dof]


def write_back(boundary_dofs: Any, u: Floats, v: Floats, dt: float) -> None:
    """Write the corrected velocity, and the displacement that follows from it."""
    for i in range(boundary_dofs.size):
        q = boundary_dofs[i]
        v[q.dof] = q.new_v
        u[q.dof] = q.old_u + dt * q.new_v


def no_loads(boundary: Boundary, drive: Drive, s: int, dim: int, dt: float) -> float:
    """Stand in for each of the next four where a model has no loads, or no supports and drives."""
    return 0.0


def apply_nodal_forces(boundary: Boundary, drive: Drive, s: int, dim: int, dt: float) -> float:
    """Let forces on single nodes change their velocity; return 0."""
    for i in range(boundary.nodal_forces.size):
        f = boundary.nodal_forces[i]
        scale = dt * f.inverse_mass * drive.force[s, f.column]
        for d in range(dim):
            boundary.boundary_dofs[f.place + d].new_v += scale * boundary.axes[f.axis + d]
    return 0.0


def impose_velocity(boundary: Boundary, drive: Drive, s: int, dim: int, dt: float) -> float:
    """Prescribe velocities of supports and drives; return the work of the reactions this takes."""
    boundary_dofs, axes, total = boundary.boundary_dofs, boundary.axes, boundary.totals[0]
    work = 0.0
    for i in range(boundary.constraints.size):
        h = boundary.constraints[i]
        now = 0.0
        before = 0.0
        for d in range(dim):
            now += axes[h.axis + d] * boundary_dofs[h.place + d].new_v
            before += axes[h.axis + d] * boundary_dofs[h.place + d].old_v
        wanted = drive.velocity[s, h.column]
        for d in range(dim):
            boundary_dofs[h.place + d].new_v += (wanted - now) * axes[h.axis + d]
        reaction = h.mass * (wanted - now) / dt
        h.reaction += reaction
        total.step_energy = max(total.step_energy, h.mass * (wanted - now) ** 2)
        work += reaction * (before + wanted)
    return 0.5 * dt * work


def add_contact_reactions(boundary: Boundary, drive: Drive, s: int, dim: int, dt: float) -> float:
    """Let supports and drives bear the contact forces on their nodes; return the work this takes."""
    work = 0.0
    for i in range(boundary.shares.size):
        share = boundary.shares[i]
        h = boundary.constraints[share.hold]
        before = 0.0
        for d in range(dim):
            before += boundary.axes[h.axis + d] * boundary.boundary_dofs[h.place + d].old_v
        reaction = -share.value * boundary.points[share.point].multiplier
        h.reaction += reaction
        work += reaction * (before + drive.velocity[s, h.column])
    return 0.5 * dt * work


def work_of_loads(boundary: Boundary, drive: Drive, s: int, dim: int, dt: float) -> float:
    """Return the work of the forces on single nodes and of those on whole bodies."""
    boundary_dofs, momentum = boundary.boundary_dofs, boundary.momentum
    work = work_of_nodal_forces(boundary.nodal_forces, boundary_dofs, boundary.axes, drive.force, s, dim, dt)
    if momentum.size == 0:
        return work
    for i in range(boundary_dofs.size):
        q = boundary_dofs[i]
        momentum[q.body] += q.mass * (q.new_v - q.bulk_v)
    of_bodies = 0.0
    for i in range(momentum.size):
        of_bodies += drive.pull[s, i] * (momentum[i] + boundary.before[i])
        boundary.before[i] = momentum[i]
    return work + 0.5 * dt * of_bodies


def work_of_nodal_forces(
    nodal_forces: Any, boundary_dofs: Any, axes: Floats, amplitude: Floats, s: int, dim: int, dt: float
) -> float:
    """Return the work of forces on single nodes: half of force times u_{n+1} - u_{n-1}."""
    work = 0.0
    for i in range(nodal_forces.size):
        f = nodal_forces[i]
        for d in range(dim):
            q = boundary_dofs[f.place + d]
            work += amplitude[s, f.column] * axes[f.axis + d] * (q.old_v + q.new_v)
    return 0.5 * dt * work


def find_contact_states(points: Any, entries: Any, boundary_dofs: Any, dt: float) -> None:
    """Find gap and gap rate of each point, as they are and as the bulk update predicts them."""
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


def correct(points: Any, entries: Any, boundary_dofs: Any, dt: float) -> None:
    """Let the multipliers change the velocity of the nodes they act on: the contact accelerations."""
    for i in range(points.size):
        p = points[i]
        if p.multiplier != 0.0:
            for k in range(p.start, p.stop):
                boundary_dofs[entries[k].place].new_v += dt * entries[k].response * p.multiplier


def contact_energy(points: Any, entries: Any, boundary_dofs: Any, totals: Any, n: int, dt: float) -> None:
    """Sum what the contacts do in a step: their work, what they store, and how the two of them go."""
    total = totals[0]
    work = 0.0
    held = 0.0
    steady = 0.0
    busy = False
    for i in range(points.size):
        p = points[i]
        coupled = p.stores != NOTHING and (p.gap < 0.0 or p.other_start < p.other_stop)
        if p.multiplier != 0.0 or p.active == 1 or coupled:
            busy = True
            rate = 0.0
            reach = 0.0
            for k in range(p.start, p.stop):
                q = boundary_dofs[entries[k].place]
                rate += entries[k].normal * q.new_v
                reach = max(reach, abs(q.old_u) + dt * abs(q.new_v))
            done = 0.5 * dt * p.multiplier * (p.rate + rate)
            energy = stored(p, rate, dt)
            active = 1 if p.multiplier != 0.0 or energy != 0.0 else 0
            if p.stores == BY_CURRENT and p.active == active:
                steady += done + energy - p.stored
            total.round_off += rounded(p, rate, reach, dt)
            held += energy
            work += done
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
    if busy:
        total.contact_work += work
        total.stored = held  # of points that are not looked at nothing is stored
        total.round_off += abs(total.contact_work)
        track_growth(total, steady, n)


def track_growth(total: Any, steady: float, n: int) -> None:
    """Note how far contact work with what is stored has risen above its smallest value so far.

    A start in touch under load finds the gap of the step before t = 0 closed, which no contact force had answered:
    what that brings, once, is no growth, and the watch begins behind it.
    """
    now = total.contact_work + total.stored
    if n == 0:
        total.least = now
        return
    total.least = min(total.least, now)
    if now - total.least > total.rise:
        total.rise = now - total.least
        total.rise_step = n
    total.drift += steady
    if abs(total.drift) > total.largest_drift:
        total.largest_drift = abs(total.drift)
        total.drift_step = n


@called
def snapshot(record: Record, u: Floats, n: int) -> None:
    """Keep the displacements from which the stress field follows."""
    r = n // record.field_every
    for k in range(record.field_dof.size):
        record.field[r, k] = u[record.field_dof[k]]


@called
def keep(
    groups: Any, masses: Bulk, boundary: Boundary, record: Record, u: Floats, v: Floats, dim: int, dt: float, n: int
) -> None:
    """Write the record of step n."""
    boundary_dofs = boundary.boundary_dofs
    r = n // record.every if n % record.every == 0 else record.energy.shape[0] - 1
    for i in range(boundary.points.size):
        p = boundary.points[i]
        record.multiplier[r, i] = p.multiplier
        record.gap[r, i] = p.gap
        after = p.initial_gap
        for k in range(p.start, p.stop):
            q = boundary_dofs[boundary.entries[k].place]
            after += boundary.entries[k].normal * (q.old_u + dt * q.new_v)
        record.end_force[r, i] = p.end_stiffness * max(-after, 0.0)
    for k in range(record.probe.size):
        q = boundary_dofs[record.probe[k]]
        record.displacement[r, k] = q.old_u
        record.velocity[r, k] = 0.5 * (q.old_v + q.new_v)
    record.energy[r, 0] = kinetic(masses.mass, v)
    record.energy[r, 1] = elastic(groups, u, v, dim, dt)
    record.energy[r, 2] = boundary.totals[0].external_work
    record.energy[r, 3] = boundary.totals[0].contact_work
    record.energy[r, 4] = boundary.totals[0].stored
