"""Contact laws that shift the ends of their contacts after a step."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from percuss.compiler.record_arrays import Records
from percuss.contact.features import SOLIDS, Feature
from percuss.contact.points import Points
from percuss.step.actions import AFTER_CONTACT, AFTER_STEP, AFTER_STRAIN_ENERGY, BEFORE_STRAIN_ENERGY, Action
from percuss.step.part import Part, Setting
from percuss.step.records import Loads

if TYPE_CHECKING:
    from percuss.contact.model_arrays import ModelArrays
    from percuss.methods.interfaces import Floats


class Shifting(NamedTuple):
    """The shifts of a step, and what they act on."""

    after: Floats  # shift of each boundary degree of freedom after the present step
    before: Floats  # the same after the step before
    speed: Floats  # work space: velocity of each boundary degree of freedom
    points: Points
    boundary: Records  # percuss.step.records.BOUNDARY_DOF
    loads: Loads
    totals: Records  # percuss.step.records.TOTAL
    now: Records  # percuss.step.records.NOW
    sums_work: bool  # whether the internal work is summed up


class Shifts(Part[Shifting]):
    """The part of a step with laws that shift the ends of their contacts."""

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None where no law shifts."""
        model, step = setting.model, setting.step
        if not _law_that_shifts(model):
            return None
        count = step.boundary.size
        after, previous, speed = (np.zeros(count) for _ in range(3))
        sums_work = model.sums_internal_work
        data = Shifting(
            after,
            previous,
            speed,
            step.points,
            step.boundary,
            step.loads,
            step.totals,
            step.now,
            sums_work,
        )
        if before is not None:
            data = data._replace(after=before.data.after, before=before.data.before)
        return cls(data)

    def actions(self) -> Iterator[Action]:
        """Yield the actions of a step."""
        yield Action(AFTER_CONTACT, find_shifts, self.data)
        yield Action(AFTER_STEP, add_work_and_shift, self.data)
        yield Action(BEFORE_STRAIN_ENERGY, move_along, self.data)
        yield Action(AFTER_STRAIN_ENERGY, move_back, self.data)

    def changing_arrays(self) -> list[Any]:
        """Return the shifts of the boundary degrees of freedom."""
        return [self.data.after]


def _law_that_shifts(model: ModelArrays) -> str:
    return next((contact_point.law.name for contact_point in model.contact_points if contact_point.law.shifts), "")


def feature(model: ModelArrays) -> Feature | None:
    """Return what is to know of laws that shift the ends of their contacts; None where no law does."""
    law = _law_that_shifts(model)
    if not law:
        return None
    why = {"ends without mass": f"{law} shifts displacements after that", SOLIDS: f"{law} shifts the ends of contacts"}
    return Feature(name="shifts", goes_without=why, no_row_kernel=True)


def find_shifts(data: Shifting, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set the shifts of the boundary degrees of freedom from those of the points, and keep those of the last step."""
    for i in range(data.after.size):
        data.before[i] = data.after[i]
        data.after[i] = 0.0
    for i in range(data.points.law.size):
        law = data.points.law[i]
        for k in range(law.start, law.stop):
            entry = data.points.entries[k]
            data.after[entry.place] += entry.response * data.points.state[i].shift


def add_work_and_shift(data: Shifting, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Shift the displacements u_{n+1}; add the work of that to the contact work, and that of the loads on it.

    The strain energy between u_n and the shifted u_{n+1} is ``u_n K u_{n+1} / 2``. A shift changes it by half its
    product with the internal force at u_n, and the step that follows changes it by half the product with that at
    u_{n+1} beyond the work of the velocities. Each step therefore counts its own shift and that of the step before.
    """
    total, dt = data.totals[0], data.now[0].dt
    on_bodies = 0.0
    work = 0.0
    for i in range(data.after.size):
        q = data.boundary[i]
        moved = data.before[i] + data.after[i]
        body_force = q.mass * data.loads.accelerations[q.body]
        on_bodies += (body_force - q.mass * q.change / dt) * moved
        work += body_force * moved
    for i in range(data.after.size):
        work += data.boundary[i].load * (data.before[i] + data.after[i])
    total.contact_work += 0.5 * (on_bodies - work)
    if data.sums_work:
        total.internal_work += 0.5 * on_bodies
    total.work_of_parts += 0.5 * work
    for i in range(data.after.size):
        u[data.boundary[i].dof] += data.after[i]


def move_along(data: Shifting, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Give the boundary the velocities that take u_n to the shifted u_{n+1}, between which the strain energy lies."""
    for i in range(data.after.size):
        dof = data.boundary[i].dof
        data.speed[i] = v[dof]
        v[dof] += data.after[i] / data.now[0].dt


def move_back(data: Shifting, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Give the boundary its velocities back."""
    for i in range(data.after.size):
        v[data.boundary[i].dof] = data.speed[i]
