"""The histories of a run, as a step writes them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from percuss.step.actions import (
    AFTER_STRAIN_ENERGY,
    BEFORE_STRAIN_ENERGY,
    KINETIC_ENERGY,
    RECORD,
    SNAPSHOT,
    STRAIN_ENERGY,
    perform,
)

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integers
    from percuss.step.records import Step

# The energies of a record, at n + 1/2 in a leap-frog scheme; each has the name of the total that it is.
ENERGIES = np.dtype(
    [
        ("kinetic_energy", "f8"),
        ("elastic_energy", "f8"),  # with what materials store in state variables
        ("external_work", "f8"),
        ("contact_work", "f8"),
        ("contact_energy", "f8"),
        ("internal_work", "f8"),
        ("dissipated_energy", "f8"),
        ("hourglass_energy", "f8"),
    ]
)


class Record(NamedTuple):
    """Recorded histories: R rows, one for every `every`-th step and one for the last step; contacts as in the case."""

    every: int
    last: int  # step of the last record
    contact_force: Floats  # (R, contacts)
    gap: Floats  # (R, contacts) of the point with the smallest one
    end_force: Floats  # (R, contacts)
    displacement: Floats  # (R, probes * dim)
    velocity: Floats  # (R, probes * dim)
    probe_start: Integers  # (probes * dim + 1,) the first boundary degree of freedom of each motion of a probe
    probe: Integers  # indices of boundary degrees of freedom
    probe_share: Floats  # share of each in the motion of its probe
    energy: Any  # (R,) ENERGIES
    field_every: int  # steps between two snapshots, 0 for none
    field: Floats  # (F, recorded nodes * dim) displacement
    field_dof: Integers  # (recorded nodes * dim,)


BEFORE_FIRST = cast("int", np.int64(-1))  # the step before the first one, no integer of Python: see `PLACES`

# The histories that have a column for each contact, and for each component of the motion of each probe.
OF_CONTACTS, OF_PROBES = Record._fields[2:5], Record._fields[5:7]


def is_recorded(record: Record, n: int) -> bool:
    """Return whether a record is written for step n."""
    return n % record.every == 0 or n == record.last


def find_energies(step: Step, n: int, u: Floats, v: Floats) -> None:
    """Sum up the energies of all bodies after step n in the totals."""
    total = step.totals[0]
    total.kinetic_energy = 0.0
    total.elastic_energy = 0.0
    total.dissipated_energy = 0.0
    total.hourglass_energy = 0.0
    perform(step.actions, KINETIC_ENERGY, n, u, v, v)
    perform(step.actions, BEFORE_STRAIN_ENERGY, n, u, v, v)
    perform(step.actions, STRAIN_ENERGY, n, u, v, v)
    perform(step.actions, AFTER_STRAIN_ENERGY, n, u, v, v)


def count_start(step: Step, u: Floats, v: Floats) -> None:
    """Add the strain energy before the first step to the energy at the beginning of the run."""
    total = step.totals[0]
    find_energies(step, BEFORE_FIRST, u, v)
    total.energy_before += total.elastic_energy
    total.began_with = max(total.began_with, total.energy_before)


def snapshot(record: Record, step: Step, n: int, u: Floats, v: Floats) -> None:
    """Record the displacements from which the stress field is computed."""
    if record.field_every > 0 and n % record.field_every == 0:
        r = n // record.field_every
        for k in range(record.field_dof.size):
            record.field[r, k] = u[record.field_dof[k]]
        step.now[0].row = r
        perform(step.actions, SNAPSHOT, n, u, v, v)


def write_record(record: Record, step: Step, n: int, u: Floats, v: Floats, lag: float) -> None:
    """Write the record of step n: state at t_n, multipliers, and energies after the step.

    Where velocities lag behind displacements, the velocity at t_n is the mean of those before and after the step. The
    end force is the stiffness of an explicit law times the overlap at the end of the step. `lag` is the time by which
    velocities lag behind displacements: dt in a leap-frog scheme, 0 in a multi-stage scheme.
    """
    points, boundary, total = step.points, step.boundary, step.totals[0]
    r = n // record.every if n % record.every == 0 else record.energy.size - 1
    for i in range(points.contacts.size):
        record.contact_force[r, i] = points.contacts[i].force
        record.gap[r, i] = points.contacts[i].gap
        record.end_force[r, i] = 0.0
    for i in range(points.law.size):
        law, row = points.law[i], points.row[i]
        after = row.initial_gap
        for k in range(row.start, row.stop):
            after += points.entries[k].normal * u[boundary[points.entries[k].place].dof]
        record.end_force[r, law.contact] += row.weight / law.weight * law.end_stiffness * max(-after, 0.0)
    for k in range(record.probe_start.size - 1):
        displacement = 0.0
        velocity = 0.0
        for e in range(record.probe_start[k], record.probe_start[k + 1]):
            q = boundary[record.probe[e]]
            displacement += record.probe_share[e] * q.old_u
            velocity += record.probe_share[e] * (0.5 * (q.old_v + q.new_v) if lag > 0.0 else q.old_v)
        record.displacement[r, k] = displacement
        record.velocity[r, k] = velocity
    energy = record.energy[r]
    energy.kinetic_energy = total.kinetic_energy
    energy.elastic_energy = total.elastic_energy
    energy.external_work = total.external_work
    energy.contact_work = total.contact_work
    energy.contact_energy = total.contact_energy
    energy.internal_work = total.internal_work
    energy.dissipated_energy = total.dissipated_energy
    energy.hourglass_energy = total.hourglass_energy
    step.now[0].row = r
    perform(step.actions, RECORD, n, u, v, v)
