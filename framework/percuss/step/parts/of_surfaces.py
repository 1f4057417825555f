"""What is recorded of solids: velocities and contact pressures of snapshots, contact areas, slides of points."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from percuss.contact.points import Points
from percuss.mesh.stiffness_rows import in_order
from percuss.record_arrays import Records
from percuss.step.actions import BEFORE_ACCOUNT, RECORD, SNAPSHOT, Action
from percuss.step.part import Part, Setting

if TYPE_CHECKING:
    from collections.abc import Mapping

    from percuss.methods.interfaces import Array, Floats, Integers


class Slides(NamedTuple):
    """How far contact points that press slide along the surface that they met at the start."""

    points: Points
    start: Integers  # (P + 1,) first entry of each point
    node: Integers  # of the model, of each entry
    share: Floats  # in the motion of the point relative to what it met
    normal: Floats  # (P, dim)
    facet: Floats  # (P,) size of the facet that each point met [length]
    slid: Floats  # (contacts, 2) largest slide over the size of the facet, and time at which it first exceeded 1
    now: Records  # percuss.step.records.NOW


class Surfaces(NamedTuple):
    """Contact points, and where their areas and pressures are recorded."""

    points: Points
    number: Integers  # of each point in the model
    area: Floats  # (R, contacts) sum of the areas of points with a force
    pressure: Floats  # (F, points) as in the model; (F, 0) where it is not recorded
    velocity: Floats  # (F, nodes * dim)
    every: int  # steps between two snapshots, 0 for none
    lags: int  # 1 where velocities lag behind displacements by a step, else 0
    now: Records  # percuss.step.records.NOW


class SurfacesRecorded(Part[Surfaces]):
    """The part of a step that records surfaces.

    Parameters
    ----------
    data
        What is recorded of areas and snapshots.
    slides
        What is recorded of slides.
    """

    def __init__(self, data: Surfaces, slides: Slides) -> None:
        super().__init__(data)
        self.slides = slides

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None of bars."""
        model, step, record = setting.model, setting.step, setting.record
        if model.bodies.of_lines:
            return None
        if before is not None:
            slides = before.slides._replace(points=step.points, now=step.now)
            return cls(before.data._replace(points=step.points, now=step.now), slides)
        number = np.array(setting.order, dtype=np.int64)
        snapshots, dofs = record.field.shape
        pressed = number.size if model.case.record.pressure else 0
        shapes = record.gap.shape, (snapshots, pressed), (snapshots, dofs)
        areas, pressures, velocities = (np.full(shape, np.nan) for shape in shapes)
        lags = int(not model.multistage)
        data = Surfaces(step.points, number, areas, pressures, velocities, record.field_every, lags, step.now)
        return cls(data, _slides(setting, len(model.case.contacts)))

    def actions(self) -> Iterator[Action]:
        """Yield the actions of a step."""
        if self.data.every:
            yield Action(SNAPSHOT, record_velocities, self.data)
            yield Action(BEFORE_ACCOUNT, record_pressures, self.data)
        if self.data.number.size:
            yield Action(RECORD, record_areas, self.data)
            yield Action(RECORD, record_slides, self.slides)

    def changing_arrays(self) -> list[Array]:
        """Return the slides: they are no histories."""
        return [self.slides.slid]

    def results(self) -> Mapping[str, Floats]:
        """Return the contact areas, and of the snapshots velocities and contact pressures."""
        data = self.data
        return {
            "contact_area": data.area,
            "field_velocity": data.velocity,
            "field_pressure": data.pressure,
            "slid": self.slides.slid,
        }


def _slides(setting: Setting, contacts: int) -> Slides:
    points, order = setting.model.contact_points, np.array(setting.order, dtype=np.int64)
    start, entry = in_order(points.start, order)
    return Slides(
        points=setting.step.points,
        start=start,
        node=points.node[entry],
        share=points.share[entry],
        normal=points.normal[order],
        facet=np.where(points.at_wall | points.slides, np.inf, points.facet)[order],
        slid=np.tile([0.0, np.nan], (contacts, 1)),
        now=setting.step.now,
    )


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
            data.pressure[r, data.number[i]] = data.points.state[i].multiplier / data.points.law[i].weight
        if data.lags == 1:
            for i in range(data.velocity.shape[1]):
                data.velocity[r, i] = 0.5 * (data.velocity[r, i] + v[i])


def record_areas(data: Surfaces, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Record the area of each contact that has a force."""
    r = data.now[0].row
    for i in range(data.area.shape[1]):
        data.area[r, i] = 0.0
    for i in range(data.number.size):
        if data.points.state[i].multiplier != 0.0:
            data.area[r, data.points.law[i].contact] += data.points.row[i].weight


def record_slides(data: Slides, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Record how far points that press have slid along the surface that they met; at a plane wall that is nothing."""
    dim = data.normal.shape[1]
    for i in range(data.facet.size):
        if data.points.state[i].multiplier > 0.0 and data.facet[i] < np.inf:
            whole, along = 0.0, 0.0
            for d in range(dim):
                relative = 0.0
                for k in range(data.start[i], data.start[i + 1]):
                    relative += data.share[k] * u[data.node[k] * dim + d]
                whole += relative * relative
                along += relative * data.normal[i, d]
            slid = np.sqrt(max(whole - along * along, 0.0)) / data.facet[i]
            contact = data.points.law[i].contact
            data.slid[contact, 0] = max(data.slid[contact, 0], slid)
            if slid > 1.0 and not data.slid[contact, 1] >= 0.0:
                data.slid[contact, 1] = (n + 1) * data.now[0].dt  # displacements are those after the step
