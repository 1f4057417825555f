"""What is recorded of supports and drives: the force of each on its body."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from percuss.record_arrays import Records
from percuss.step.actions import RECORD, Action
from percuss.step.part import Part, Setting
from percuss.step.records import Loads

if TYPE_CHECKING:
    from collections.abc import Mapping

    from percuss.methods.interfaces import Floats, Integers


class Supports(NamedTuple):
    """The supports and drives that constraints are part of, and where their forces are recorded."""

    loads: Loads
    support: Integers  # of each constraint of the loads
    first: int  # component with which forces begin: across the axis those on a ring cancel
    force: Floats  # (R, supports, dim) on the body
    now: Records  # percuss.step.records.NOW


class SupportsRecorded(Part[Supports]):
    """The part of a step that records the forces of supports and drives."""

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None without supports and drives."""
        model, step, constraints = setting.model, setting.step, setting.model.loads.constraints
        if not (names := model.loads.supports):
            return None
        acting = range(len(constraints)) if model.multistage else model.active_constraints(setting.midpoint)
        support = np.array([names.index(constraints[k].support) for k in acting], dtype=np.int64)
        force = np.full((setting.record.energy.size, len(names), model.dim), np.nan)
        force = force if before is None else before.data.force
        return cls(Supports(step.loads, support, int(model.bodies.about_axis), force, step.now))

    def actions(self) -> Iterator[Action]:
        """Yield the action of a step."""
        yield Action(RECORD, record, self.data)

    def results(self) -> Mapping[str, Floats]:
        """Return the forces of the supports and drives."""
        return {"support_force": self.data.force}


def record(data: Supports, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Record the forces of the step."""
    loads, r = data.loads, data.now[0].row
    for s in range(data.force.shape[1]):
        for d in range(data.force.shape[2]):
            data.force[r, s, d] = 0.0
    for i in range(data.support.size):
        constraint = loads.constraints[i]
        for d in range(data.first, data.force.shape[2]):
            data.force[r, data.support[i], d] += constraint.force * loads.axes[constraint.axis + d]
