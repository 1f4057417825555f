"""What is recorded of bodies that are no bars: velocities and contact pressures of snapshots, contact areas."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from percuss.compiler.record_arrays import Records
from percuss.contact.points import Points
from percuss.step.actions import BEFORE_ACCOUNT, RECORD, SNAPSHOT, Action
from percuss.step.part import Part, Setting

if TYPE_CHECKING:
    from collections.abc import Mapping

    from percuss.methods.interfaces import Floats, Integers


class Surfaces(NamedTuple):
    """Contact points with their areas, and where they are recorded."""

    points: Points
    number: Integers  # of each point in the model
    weight: Floats  # area of each point [length^2]
    area: Floats  # (R, contacts) sum of the areas of points with a force
    pressure: Floats  # (F, points) as in the model; (F, 0) where it is not recorded
    velocity: Floats  # (F, nodes * dim)
    every: int  # steps between two snapshots, 0 for none
    lags: int  # 1 where velocities lag behind displacements by a step, else 0
    now: Records  # percuss.step.records.NOW


class SurfacesRecorded(Part[Surfaces]):
    """The part of a step that records surfaces."""

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None of bars."""
        model, step, record = setting.model, setting.step, setting.record
        if model.bodies.of_lines:
            return None
        if before is not None:
            return cls(before.data._replace(points=step.points, now=step.now))
        number = np.array(setting.order, dtype=np.int64)
        weight = np.array([model.contact_points[point].weight for point in setting.order], dtype=float)
        snapshots, dofs = record.field.shape
        pressed = weight.size if model.case.record.pressure else 0
        shapes = record.gap.shape, (snapshots, pressed), (snapshots, dofs)
        areas, pressures, velocities = (np.full(shape, np.nan) for shape in shapes)
        lags = int(not model.multistage)
        return cls(
            Surfaces(step.points, number, weight, areas, pressures, velocities, record.field_every, lags, step.now)
        )

    def actions(self) -> Iterator[Action]:
        """Yield the actions of a step."""
        if self.data.every:
            yield Action(SNAPSHOT, record_velocities, self.data)
            yield Action(BEFORE_ACCOUNT, record_pressures, self.data)
        if self.data.weight.size:
            yield Action(RECORD, record_areas, self.data)

    def results(self) -> Mapping[str, Floats]:
        """Return the contact areas, and of the snapshots velocities and contact pressures."""
        data = self.data
        return {"contact_area": data.area, "field_velocity": data.velocity, "field_pressure": data.pressure}


def record_velocities(data: Surfaces, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Record the velocities before the step."""
    r = data.now[0].row
    for i in range(data.velocity.shape[1]):
        data.velocity[r, i] = v[i]


def record_pressures(data: Surfaces, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Record the pressures of the step; velocities that lag become the mean of those before and after it."""
    if n % data.every == 0:
        r = n // data.every
        for i in range(data.pressure.shape[1]):
            data.pressure[r, data.number[i]] = data.points.state[i].multiplier / data.weight[i]
        if data.lags == 1:
            for i in range(data.velocity.shape[1]):
                data.velocity[r, i] = 0.5 * (data.velocity[r, i] + v[i])


def record_areas(data: Surfaces, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Record the area of each contact that has a force."""
    r = data.now[0].row
    for i in range(data.area.shape[1]):
        data.area[r, i] = 0.0
    for i in range(data.weight.size):
        if data.points.state[i].multiplier != 0.0:
            data.area[r, data.points.law[i].contact] += data.weight[i]
