"""The records that a step reads and writes beside those of the contact points.

In compiled code and in plain Python alike ``q = boundary[i]`` is a view whose fields are read and written by name. In
the functions of this room `law`, `state` and `sums` are the records of a contact point, and `q` is that of a boundary
degree of freedom.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.contact.points import Points
from percuss.record_arrays import Records

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats

# A boundary degree of freedom, which belongs to a node with contacts, loads, constraints or a probe.
BOUNDARY_DOF = np.dtype(
    [
        ("dof", "i8"),  # index in the global arrays of displacement and velocity
        ("mass", "f8"),
        ("body", "i8"),  # index of its body and direction in the momenta of the bodies
        ("old_u", "f8"),  # displacement at n
        ("old_v", "f8"),  # velocity at n - 1/2
        ("bulk_v", "f8"),  # velocity after the bulk update
        ("change", "f8"),  # change of the velocity in the bulk update by the mass of its node alone
        ("load", "f8"),  # force of the loads on its node
        ("new_v", "f8"),  # velocity corrected by loads, constraints and contacts, at the end that at n + 1/2
    ]
)
# A constraint prescribes the velocity of a node along a direction, which is `axes` from index `axis` on; `column` is
# that of its velocity in the amplitudes, `force` is its reaction in the present step and `reaction` the sum of these
# over the steps.
CONSTRAINT = np.dtype(
    [("place", "i8"), ("axis", "i8"), ("mass", "f8"), ("column", "i8"), ("force", "f8"), ("reaction", "f8")]
)
# The share of a contact force that a constraint takes: `hold` is the index of the constraint, `value` the component of
# the contact normal along it.
SHARE = np.dtype([("hold", "i8"), ("point", "i8"), ("value", "f8")])
# A force on a single node, which at amplitude 1 is `axes` from index `axis` on.
NODAL_FORCE = np.dtype([("place", "i8"), ("axis", "i8"), ("inverse_mass", "f8"), ("column", "i8")])
# The step itself, a single record.
NOW = np.dtype(
    [
        ("time", "f8"),  # t_n, or the time of the stage
        ("dt", "f8"),
        ("gap_response", "f8"),  # change of the predicted gap by a multiplier of 1/s
        ("rate_response", "f8"),  # the same of the predicted gap rate
        ("span", "f8"),  # time between the two gap rates of a point
        ("dim", "i8"),
        ("row", "i8"),  # of the records or snapshots that is being written
        ("solved", "i8"),  # 1 while all contact equations of the step were solved
        ("moved", "f8"),  # largest change of a multiplier in the present sweep, 0 where all were found at once
        ("largest", "f8"),  # largest multiplier before or after it
    ]
)
# Sums over the steps and of the step, the bounds for them, and the energy growth; a single record.
TOTAL = np.dtype(
    [
        ("external_work", "f8"),
        ("contact_work", "f8"),
        ("internal_work", "f8"),  # of the internal forces, where it is summed up
        ("largest_work", "f8"),  # largest absolute external work so far
        ("energy_before", "f8"),  # kinetic and strain energy before the first step
        ("began_with", "f8"),  # the larger of the energy before the first step and the kinetic energy at t = 0
        ("growth", "f8"),  # largest contact work allowed, over the energy put in
        ("floor", "f8"),  # contact work that counts as round-off
        ("step_energy", "f8"),  # largest energy that a contact or a constraint by itself would add in one step
        ("contact_energy", "f8"),  # energy stored in the contacts at n + 1/2
        ("least", "f8"),  # smallest sum of contact work and stored energy so far
        ("rise", "f8"),  # largest rise of that sum above its smallest value so far
        ("rise_step", "i8"),  # step at the end of which it occurred
        ("drift", "f8"),  # sum of the changes at points with BY_CURRENT, in steps in which they neither open nor close
        ("largest_drift", "f8"),  # largest absolute value of `drift`
        ("drift_step", "i8"),  # step at the end of which it occurred
        ("round_off", "f8"),  # bound on the sum of the round-off errors of the energies, over the rounding unit
        # of the present step
        ("work_of_parts", "f8"),  # external work beside that of loads and supports
        ("work_of_contacts", "f8"),
        ("stored_by_points", "f8"),
        ("stored_by_laws", "f8"),  # in state variables of contact laws
        ("steady_change", "f8"),
        ("any_contact", "i8"),  # 1 if a contact had a force, or may store energy
        # of the present record
        ("kinetic_energy", "f8"),
        ("elastic_energy", "f8"),
        ("hourglass_energy", "f8"),  # the part of it that holds hourglass modes
        ("dissipated_energy", "f8"),
    ]
)


class Loads(NamedTuple):
    """Supports, drives and loads on nodes and bodies, and their amplitudes in the present step."""

    constraints: Records  # CONSTRAINT
    shares: Records  # SHARE
    nodal_forces: Records  # NODAL_FORCE
    axes: Floats  # directions of the constraints, then of the forces on nodes, each at amplitude 1
    amplitudes: Floats  # (columns,) of the forces, the prescribed velocities, then the acceleration of each body
    accelerations: Floats  # (bodies * dim,) the last of these
    momentum: Floats  # (bodies * dim,) of each body at n + 1/2, empty where no load acts on whole bodies
    momentum_before: Floats  # the same at n - 1/2


class Step(NamedTuple):
    """What the steps of one stretch of a run work on; another stretch has other supports, drives or laws."""

    boundary: Records  # BOUNDARY_DOF
    points: Points
    loads: Loads
    totals: Records  # TOTAL
    now: Records  # NOW
    actions: Any  # of each place, as `percuss.step.actions.perform` performs them
