"""The step of multi-stage schemes: accelerations in stages, then work and energies of the step.

Displacement and velocity are those at t_n before a step and at t_{n+1} after it. Their arrays are longer than those of
the nodes: after the nodal degrees of freedom follow one entry for each contact point, each constraint and each column
of loads, whose acceleration is the multiplier, the reaction and the amplitude. A scheme combines all entries of an
array in the same way, so that the change of velocity of such an entry in a step is the impulse of that step, whatever
the weights of the scheme. Kinetic energy and momentum then change by exactly ``impulse (v_n + v_{n+1}) / 2`` and
``impulse``. No function here allocates memory.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from percuss.jit import called
from percuss.methods.slots import accelerations
from percuss.record_arrays import Records, Row
from percuss.step.account import account
from percuss.step.actions import (
    AFTER_FORCES,
    AFTER_STEP,
    AFTER_SUPPORTS,
    BEFORE_LOADS,
    INTERNAL_FORCES,
    INTERNAL_FORCES_ASIDE,
    LOADS_OF_A_STAGE,
    perform,
)
from percuss.step.equation import find_multipliers, see
from percuss.step.loads import work_along
from percuss.step.loop import keep
from percuss.step.record import Record, count_start, find_energies, is_recorded, snapshot, write_record
from percuss.step.records import Loads, Step

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integers

# An acceleration of the nodes from `start` to `stop`, which at amplitude 1 is `body_force_axes` from index `axis` on;
# `momentum` is that of these nodes along the acceleration at the beginning of the step.
BEFORE, AFTER = (cast("bool", np.bool_(after)) for after in (False, True))  # no constants of Python: see `PLACES`
BODY_FORCE = np.dtype([("start", "i8"), ("stop", "i8"), ("axis", "i8"), ("column", "i8"), ("momentum", "f8")])


class System(NamedTuple):
    """The arguments of `accelerations` and `internal`; the last four arrays are written in every step."""

    step: Step  # with all constraints of the model, active or not
    mass: Floats  # (nodes * dim,) nodal masses
    inverse_mass: Floats  # (nodes * dim,)
    body_forces: Records  # BODY_FORCE
    body_force_axes: Floats  # accelerations of the bodies at amplitude 1
    active_constraints: Integers  # (constraints,) 1 if the constraint is active, else 0
    responses: Floats  # (stages, points) w of each point
    ends: Floats  # (stages, 3) r_v, r_a, s_a, as in `percuss.methods.interfaces.Stages`
    times: Floats  # (stages,) fractions of the step
    amplitude: Floats  # (stages, columns) amplitude of each load at the times of the stages
    speed: Floats  # (2, columns) prescribed velocities at t_n and t_{n+1}
    amplitude_sums: Floats  # (columns,) sums of the effective amplitudes over the steps
    clock: Floats  # (1,) t_n


class StageAmplitudes(NamedTuple):
    """Amplitudes of the loads for T consecutive steps, one column for each load; column 0 is zero."""

    force: Floats  # (T, stages, columns) at the times of the stages
    speed: Floats  # (T, 2, columns) prescribed velocities at t_n and t_{n+1}


def take_step(numbers: object, system: System, u: Floats, v: Floats, kept: Floats, dt: float) -> None:
    """Make one step of the integrator (slot for its kernel)."""
    raise NotImplementedError


# ------------------------------------------------------------------------------------------------------- one stage


@called
def accelerate(system: System, stage: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set `a` to ``M^-1 (f_ext - f_int(u) + N lambda)``, followed by multipliers, reactions and amplitudes."""
    step, loads, now = system.step, system.step.loads, system.step.now[0]
    boundary, actions = step.boundary, step.actions
    nodal = system.mass.size
    now.time = system.clock[0] + system.times[stage] * now.dt
    for i in range(system.amplitude.shape[1]):
        loads.amplitudes[i] = system.amplitude[stage, i]
    perform(actions, INTERNAL_FORCES, stage, u, v, a)
    for i in range(nodal):
        a[i] *= system.inverse_mass[i]
    perform(actions, AFTER_FORCES, stage, u, v, a)
    for i in range(system.body_forces.size):
        body_force = system.body_forces[i]
        for j in range(body_force.start, body_force.stop):
            for d in range(now.dim):
                a[j * now.dim + d] += loads.amplitudes[body_force.column] * system.body_force_axes[body_force.axis + d]
    perform(actions, BEFORE_LOADS, stage, u, v, a)
    for i in range(loads.nodal_forces.size):
        nodal_force = loads.nodal_forces[i]
        for d in range(now.dim):
            a[boundary[nodal_force.place + d].dof] += (
                loads.amplitudes[nodal_force.column] * nodal_force.inverse_mass * loads.axes[nodal_force.axis + d]
            )
    perform(actions, LOADS_OF_A_STAGE, stage, u, v, a)
    # A constraint replaces the acceleration along it by the mean acceleration of the prescribed velocity in the step.
    first = nodal + step.points.law.size  # index of the first constraint
    for i in range(loads.constraints.size):
        constraint = loads.constraints[i]
        a[first + i] = 0.0
        if system.active_constraints[i] == 1:
            current = component_along(constraint, boundary, loads.axes, a, now.dim)
            prescribed = (system.speed[1, constraint.column] - system.speed[0, constraint.column]) / now.dt
            a[first + i] = constraint.mass * (prescribed - current)
            add_along(constraint, boundary, loads.axes, a, prescribed - current, now.dim)
    perform(actions, AFTER_SUPPORTS, stage, u, v, a)
    # Contact comes last, so that the acceleration it starts from contains loads and constraints.
    if step.points.law.size > 0:
        solve_contact(system, stage, u, v, a)
    for i in range(loads.amplitudes.size):
        a[first + loads.constraints.size + i] = loads.amplitudes[i]


@called
def internal_accelerations(system: System, stage: int, u: Floats, f: Floats) -> None:
    """Set `f` to ``M^-1 f_int(u)``, with supports and drives held at no acceleration, followed by their reactions.

    What it sets is minus what `accelerate` would set without contacts, loads and changes of prescribed velocities, in
    every entry: reactions and impulses remain right in any sum of both. Contact does no work here.
    """
    step, loads, dim = system.step, system.step.loads, system.step.now[0].dim
    nodal = system.mass.size
    first = nodal + step.points.law.size  # index of the first constraint
    perform(step.actions, INTERNAL_FORCES_ASIDE, stage, u, u, f)
    for i in range(nodal):
        f[i] *= -system.inverse_mass[i]  # the kernels of elements return the force on the nodes, which is -f_int
    perform(step.actions, AFTER_FORCES, stage, u, u, f)
    for i in range(nodal, f.size):
        f[i] = 0.0
    perform(step.actions, BEFORE_LOADS, stage, u, u, f)
    for i in range(loads.constraints.size):
        constraint = loads.constraints[i]
        if system.active_constraints[i] == 1:
            current = component_along(constraint, step.boundary, loads.axes, f, dim)
            f[first + i] = -constraint.mass * current
            add_along(constraint, step.boundary, loads.axes, f, -current, dim)
    perform(step.actions, AFTER_SUPPORTS, stage, u, u, f)


def component_along(constraint: Row, boundary: Records, axes: Floats, values: Floats, dim: int) -> float:
    """Return the component of a nodal quantity along a constraint."""
    total = 0.0
    for d in range(dim):
        total += axes[constraint.axis + d] * values[boundary[constraint.place + d].dof]
    return total


def add_along(constraint: Row, boundary: Records, axes: Floats, values: Floats, increment: float, dim: int) -> None:
    """Add an increment along a constraint to a nodal quantity."""
    for d in range(dim):
        values[boundary[constraint.place + d].dof] += increment * axes[constraint.axis + d]


def solve_contact(system: System, stage: int, u: Floats, v: Floats, a: Floats) -> None:
    """Solve the contact equation of a stage, and add the accelerations and reactions by its multipliers."""
    step, loads, now = system.step, system.step.loads, system.step.now[0]
    boundary, points, nodal = step.boundary, step.points, system.mass.size
    end = system.ends[stage]
    for i in range(points.law.size):
        row, state, sums = points.row[i], points.state[i], points.sums[i]
        gap = row.initial_gap
        rate = 0.0
        acceleration = 0.0
        for k in range(row.start, row.stop):
            entry = points.entries[k]
            dof = boundary[entry.place].dof
            gap += entry.normal * u[dof]
            rate += entry.normal * v[dof]
            acceleration += entry.normal * a[dof]
        sums.deepest = max(sums.deepest, -gap)
        state.gap = gap
        state.rate = rate
        state.predicted_gap = gap + end[0] * rate + end[1] * acceleration
        state.predicted_rate = rate + end[2] * acceleration
        row.response = system.responses[stage, i]
    # Laws obtain the bulk acceleration as the difference of the two gap rates over the time s_a between them.
    now.gap_response = end[1]
    now.rate_response = end[2]
    now.span = end[2]
    find_multipliers(now, step.actions, stage, u, v)
    for i in range(points.law.size):
        row, multiplier = points.row[i], points.state[i].multiplier
        for k in range(row.start, row.stop):
            entry = points.entries[k]
            a[boundary[entry.place].dof] += entry.response * multiplier
        a[nodal + i] = multiplier
    for i in range(loads.shares.size):
        share = loads.shares[i]
        a[nodal + points.law.size + share.hold] -= share.value * points.state[share.point].multiplier


@called
def begin(system: System, stage: int, u: Floats, v: Floats, kept: Floats) -> int:
    """Set the arrays kept between steps to the acceleration of the present state, evaluated as in the given stage."""
    for i in range(kept.shape[0]):
        accelerations(system, stage, u, v, kept[i])
    return kept.shape[0]  # type: ignore[no-any-return]


# ------------------------------------------------------------------------------------------------------ whole steps


class State(NamedTuple):
    """Displacement, velocity and the arrays kept between steps; the degrees of freedom of the nodes come first."""

    u: Floats  # (size,)
    v: Floats  # (size,)
    kept: Floats  # (kept, size)


@called
def advance(
    system: System,
    numbers: object,
    record: Record,
    amplitudes: StageAmplitudes,
    state: State,
    first: int,
    count: int,
) -> int:
    """Make `count` steps from step `first`; return `count`, or the number of steps before the first that failed.

    A step fails if a contact equation was not solved, or if the contact work exceeds its limit or is nan.
    """
    step, total, now = system.step, system.step.totals[0], system.step.now[0]
    u, v = state.u, state.v
    for s in range(count):
        n = first + s
        snapshot(record, step, n, u, v)
        if n == 0:
            count_start(step, u, v)
        keep(step.boundary, u, v)
        prepare_step(system, amplitudes, s, n, u, v)
        impose_velocities(system, u, v, BEFORE)
        take_step(numbers, system, u, v, state.kept, now.dt)
        impose_velocities(system, u, v, AFTER)
        total.work_of_parts = 0.0
        work = work_of_impulses(system, v)
        perform(step.actions, AFTER_STEP, n, u, v, v)
        sound = account(step, work + total.work_of_parts, n, u, v)
        if is_recorded(record, n):
            find_energies(step, n, u, v)
            write_record(record, step, n, u, v, 0.0)
        if not (sound and now.solved == 1):
            return s
    return count


def work_of_impulses(system: System, v: Floats) -> float:
    """Return the work of loads and supports in a step, and find the contact forces of the step.

    Work and energies follow from the impulses, as if constant forces, impulse over dt, had acted.
    """
    step, loads, points, now = system.step, system.step.loads, system.step.points, system.step.now[0]
    boundary, nodal = step.boundary, system.mass.size
    for i in range(boundary.size):
        boundary[i].new_v = v[boundary[i].dof]
    see(points, boundary, now.dt)
    for i in range(points.law.size):
        points.state[i].multiplier = v[nodal + i] / now.dt
    work = sum_reactions(system, v)
    start = nodal + points.law.size + loads.constraints.size
    for i in range(system.amplitude_sums.size):
        loads.amplitudes[i] = v[start + i] / now.dt
        system.amplitude_sums[i] += loads.amplitudes[i]
    work += work_along(loads.nodal_forces, loads, boundary, now)
    return work + work_of_body_forces(system, loads, v)


def prepare_step(system: System, amplitudes: StageAmplitudes, s: int, n: int, u: Floats, v: Floats) -> None:
    """Set amplitudes, prescribed velocities and time of the step, and reset the entries that collect its impulses."""
    now = system.step.now[0]
    for k in range(system.times.size):
        for i in range(system.amplitude_sums.size):
            system.amplitude[k, i] = amplitudes.force[s, k, i]
    for k in range(2):
        for i in range(system.amplitude_sums.size):
            system.speed[k, i] = amplitudes.speed[s, k, i]
    system.clock[0] = n * now.dt
    now.solved = 1
    for i in range(system.mass.size, u.size):
        u[i] = 0.0
        v[i] = 0.0
    for i in range(system.body_forces.size):
        body_force = system.body_forces[i]
        body_force.momentum = momentum(system, body_force, v)


def momentum(system: System, body_force: Row, v: Floats) -> float:
    """Return the scalar product of a body force's acceleration at amplitude 1 and the momentum of its nodes."""
    total = 0.0
    dim = system.step.now[0].dim
    for j in range(body_force.start, body_force.stop):
        for d in range(dim):
            k = j * dim + d
            total += system.mass[k] * v[k] * system.body_force_axes[body_force.axis + d]
    return total


def impose_velocities(system: System, u: Floats, v: Floats, after: bool) -> None:
    """Set the velocities prescribed by supports and drives before or after the step; add the impulse to the reaction.

    After the step, the displacement along a constraint is set too, from the mean of the prescribed velocities.
    """
    step, loads, now = system.step, system.step.loads, system.step.now[0]
    boundary, dim = step.boundary, now.dim
    first = system.mass.size + step.points.law.size
    perform(step.actions, BEFORE_LOADS, 0, u, v, v)
    for i in range(loads.constraints.size):
        constraint = loads.constraints[i]
        if system.active_constraints[i] == 1:
            prescribed = system.speed[1 if after else 0, constraint.column]
            correction = prescribed - component_along(constraint, boundary, loads.axes, v, dim)
            add_along(constraint, boundary, loads.axes, v, correction, dim)
            v[first + i] += constraint.mass * correction
            if after:
                displacement = 0.5 * now.dt * (system.speed[0, constraint.column] + system.speed[1, constraint.column])
                for d in range(dim):
                    displacement += loads.axes[constraint.axis + d] * boundary[constraint.place + d].old_u
                moved = displacement - component_along(constraint, boundary, loads.axes, u, dim)
                add_along(constraint, boundary, loads.axes, u, moved, dim)
    perform(step.actions, AFTER_SUPPORTS, 0, u, v, v)


def sum_reactions(system: System, v: Floats) -> float:
    """Add up the reactions of the step; return their work."""
    step, loads, now = system.step, system.step.loads, system.step.now[0]
    work, first = 0.0, system.mass.size + step.points.law.size
    for i in range(loads.constraints.size):
        constraint = loads.constraints[i]
        impulse = v[first + i]
        constraint.force = impulse / now.dt
        if impulse != 0.0:
            constraint.reaction += constraint.force
            step.totals[0].step_energy = max(step.totals[0].step_energy, impulse * impulse / constraint.mass)
            for d in range(now.dim):
                q = step.boundary[constraint.place + d]
                work += 0.5 * impulse * loads.axes[constraint.axis + d] * (q.old_v + q.new_v)
    return work


def work_of_body_forces(system: System, loads: Loads, v: Floats) -> float:
    """Return the work of the body forces in the step."""
    work = 0.0
    for i in range(system.body_forces.size):
        body_force = system.body_forces[i]
        both = body_force.momentum + momentum(system, body_force, v)
        work += 0.5 * system.step.now[0].dt * loads.amplitudes[body_force.column] * both
    return work
