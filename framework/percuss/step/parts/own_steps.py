"""Bodies with time steps of their own: their internal forces act in every m-th step alone, m times as strong.

A body whose forces act is advanced by m steps then, and left as it is in the steps between, in which none of its nodes
changes its velocity but for those of the boundary. These are written back after every step.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from percuss.contact.features import EVERY_STEP, Feature, Question, Reason
from percuss.jit import called
from percuss.record_arrays import Records
from percuss.step.actions import AFTER_STRAIN_ENERGY, BEFORE_STRAIN_ENERGY, SNAPSHOT, Action
from percuss.step.bulk import (
    Bulk,
    add_momentum,
    add_strain_energy,
    advance_block,
    advance_body,
    energy_of_body,
)
from percuss.step.part import Part, Setting

if TYPE_CHECKING:
    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats, Integers

# Relative round-off of the ratio of two frequencies: equal bodies in other units have the same step.
TOLERANCE = 1e-9
# Largest number of steps until all bodies act together of which the amplification matrix is computed.
LONGEST_PERIOD = 256


class Ahead(NamedTuple):
    """The steps by which nodes are advanced at a time."""

    of_boundary: Integers  # of the body of each boundary degree of freedom
    u: Floats  # work space: displacement of each of these
    of_field: Integers  # of each recorded degree of freedom, 1 on the boundary
    field: Floats  # recorded displacements, `percuss.step.record.Record.field`
    field_dof: Integers
    boundary: Records  # percuss.step.records.BOUNDARY_DOF
    now: Records  # percuss.step.records.NOW


class OfBlock(NamedTuple):
    """The bodies of a block, and the steps from one action of their internal forces to the next."""

    bulk: Bulk
    own_step: Integers  # (bodies,)


class OwnSteps(Part[Ahead]):
    """The part of a step with bodies that have steps of their own."""

    def __init__(self, own_steps: Integers, of_nodes: Integers, data: Ahead) -> None:
        super().__init__(data)
        self.own_steps, self.of_nodes = own_steps, of_nodes

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None where the internal forces of all bodies act in every step."""
        model, record, dim = setting.model, setting.record, setting.model.dim
        if model.period == 1:
            return None
        own_steps = np.array(model.leaps, dtype=np.int64)
        boundary = setting.step.boundary
        of_nodes = np.repeat(own_steps, [body.mass.size * dim for body in model.bodies.values()])
        of_boundary, field_dof = of_nodes[boundary["dof"]], record.field_dof
        of_nodes[boundary["dof"]] = 1  # the boundary is advanced in every step, whatever its body
        now, of_field = setting.step.now, of_nodes[field_dof]
        data = Ahead(of_boundary, np.zeros(boundary.size), of_field, record.field, field_dof, boundary, now)
        return cls(own_steps, of_nodes, data)

    def actions(self) -> Iterator[Action]:
        """Yield the actions of a step."""
        yield Action(BEFORE_STRAIN_ENERGY, move_to_next_action, self.data)
        yield Action(AFTER_STRAIN_ENERGY, move_back, self.data)
        yield Action(SNAPSHOT, shift_snapshot_back, self.data)

    def displacement(self, step: int, u: Floats, v: Floats) -> Floats | None:
        """Return the displacement before a step, of nodes that are ahead of it too, (nodes * dim,)."""
        return u - -step % self.of_nodes * float(self.data.now["dt"][0]) * v

    def changed(self, action: Action) -> Action | None:
        """Return the update and the energy of a block with the steps of its bodies."""
        kernels = {advance_block: advance_due_bodies, add_strain_energy: add_strain_energy_between_actions}
        if action.kernel not in kernels:
            return action
        data = OfBlock(action.data, self.own_steps[action.data.block.body])
        return replace(action, kernel=kernels[action.kernel], data=data)


def advance_due_bodies(data: OfBlock, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Advance the bodies of a block whose internal forces act in step n, by the steps until they act again."""
    bulk = data.bulk
    for b in range(data.own_step.size):
        if n % data.own_step[b] == 0:
            advance_body(bulk, b, data.own_step[b], u, v)
        else:
            block, dim = bulk.block, bulk.dim
            add_momentum(bulk, block.body[b] * dim, block.start[b] * dim, block.stop[b] * dim, v)


@called
def add_strain_energy_between_actions(data: OfBlock, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the strain energy of the bodies of a block, each between two actions of its internal forces."""
    total = 0.0
    for b in range(data.own_step.size):
        total += energy_of_body(data.bulk, b, u, v, data.own_step[b] * data.bulk.dt)
    data.bulk.totals[0].elastic_energy += total


def move_to_next_action(data: Ahead, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Move the boundary after step n to the time of its bodies, along its velocities."""
    for i in range(data.of_boundary.size):
        if data.of_boundary[i] > 1:
            dof = data.boundary[i].dof
            data.u[i] = u[dof]
            u[dof] += (-n - 1) % data.of_boundary[i] * data.now[0].dt * v[dof]


def move_back(data: Ahead, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Move the boundary back to t_{n+1}."""
    for i in range(data.of_boundary.size):
        if data.of_boundary[i] > 1:
            u[data.boundary[i].dof] = data.u[i]


def shift_snapshot_back(data: Ahead, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Move the recorded displacements of nodes that are ahead of t_n back: they have moved at a constant velocity."""
    r = data.now[0].row
    for k in range(data.of_field.size):
        if data.of_field[k] > 1:
            data.field[r, k] -= (-n) % data.of_field[k] * data.now[0].dt * v[data.field_dof[k]]


# ------------------------------------------------------------------------------------------------------------- facts


def feature(model: Model) -> Feature | None:
    """Return what is to know of bodies with steps of their own; None where the scheme gives them none."""
    if model.multistage or not model.tables[0].own_steps:
        return None
    ratios = [model.bodies.omega / float(body.frequency.max()) for body in model.bodies.values()]
    leaps = tuple(max(1, int(ratio * (1.0 + TOLERANCE))) for ratio in ratios)
    name = model.case.method.integrator.name
    if max(leaps) == 1:
        return Feature(name=name, built_for_bars=True)
    steps = ", ".join(f"{number} in '{body}'" for body, number in zip(model.bodies, leaps, strict=True))
    of_contacts: dict[Question, Reason] = {
        "energy": (
            "bodies have steps of their own: internal forces that do not act in every step balance no contact in it"
        ),
        "critical step": f"with {name} steps resonate: a longer one may be stable, a shorter one not",
    }
    return Feature(
        name=name,
        alters=EVERY_STEP,
        leaps=leaps,
        no_row_kernel=True,
        built_for_bars=True,
        sums_internal_work=True,
        of_all_laws=True,
        reasons={
            "springs": f"{name} gives bodies steps of their own, so that a closed contact does not act as a stiffness",
            "plain bars": f"with {name} bodies have steps of their own",
            "criterion": _why_unknown,
            "cure": "take another step, or the same step in all bodies: steps of unlike length resonate",
            "lost energy": (
                f"{name} has not kept the energy: what its internal forces did and what the bodies store differ by"
            ),
            "step": (
                f"bodies have steps of their own: steps from one action of the internal forces to the next, {steps}; "
                "contacts and loads on ends act in every step"
            ),
            **(of_contacts if model.contact_points else {}),
        },
    )


def _why_unknown(model: Model) -> str:
    """Return why no criterion covers bodies with steps of their own; empty if one does."""
    name = model.case.method.integrator.name
    with_kernels = list(dict.fromkeys(bound.law.name for bound in model.laws if bound.linear is None))
    if with_kernels:
        laws = " and ".join(with_kernels)
        return (
            f"with {name} contacts are held closed over several steps, and {laws} has a kernel, which does not say so"
        )
    for force in model.facts.forces:
        at_end = "acts in every step at an end of a body whose internal forces may not"
        return f"load '{force.load.name}' {at_end}, under {name}"
    if model.contact_points and model.period > LONGEST_PERIOD:
        return (
            f"under {name} the bodies act together in every {model.period}-th step only, and periods of up to "
            f"{LONGEST_PERIOD} steps are examined"
        )
    return ""
