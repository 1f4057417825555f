"""The work of the internal forces, where the strain energy of a body does not follow from its displacements.

The ledger counts it instead of the elastic energy (`percuss.contact.model.Model.sums_internal_work`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, Self

from percuss.record_arrays import Records
from percuss.step.actions import AFTER_STEP, Action
from percuss.step.bulk import Bulk, add_internal_work, advance_block, power
from percuss.step.part import Part, Setting

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats


class OnBoundary(NamedTuple):
    """What the work of the internal forces on the boundary is computed from."""

    boundary: Records  # percuss.step.records.BOUNDARY_DOF
    accelerations: Floats  # (bodies * dim,) by loads on whole bodies
    totals: Records  # percuss.step.records.TOTAL
    dt: float


class InternalWork(Part[OnBoundary]):
    """The part of a step that sums up the work of the internal forces."""

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None where the elastic energy is that work."""
        step = setting.step
        if not setting.model.sums_internal_work:
            return None
        return cls(OnBoundary(step.boundary, step.loads.accelerations, step.totals, setting.model.dt))

    def actions(self) -> Iterator[Action]:
        """Yield the action of a step."""
        yield Action(AFTER_STEP, add_work_on_corrections, self.data)

    def changed(self, action: Action) -> Action | None:
        """Return the update of a block with the sum of the work."""
        if action.kernel is not advance_block:
            return action
        return replace(action, slots={**action.slots, add_internal_work: add_half_of_work})


def add_half_of_work(data: Bulk, force: Floats, v: Floats, dt: float) -> None:
    """Add half of a step's internal work, by forces on consecutive nodes, before and after their update."""
    data.totals[0].internal_work -= 0.5 * dt * power(force, v)


def add_work_on_corrections(data: OnBoundary, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the internal work on the corrections of the boundary velocities, which the bulk update did not know."""
    for i in range(data.boundary.size):
        q = data.boundary[i]
        force = q.mass * (q.change / data.dt - data.accelerations[q.body])
        data.totals[0].internal_work -= 0.5 * data.dt * force * (q.new_v - q.bulk_v)
