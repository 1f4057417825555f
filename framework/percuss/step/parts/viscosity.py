"""Stiffness-proportional viscosity: internal forces are those of the displacement that lies ahead by a time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from percuss.contact.features import ELASTIC, Feature
from percuss.mesh.materials import MaterialPoints
from percuss.methods.slots import internal_force
from percuss.step.actions import Action
from percuss.step.bulk import Bulk, advance_block, force_of_cells, force_of_elements, internal_force_of_cells
from percuss.step.part import Part, Setting

if TYPE_CHECKING:
    from percuss.contact.model import Model
    from percuss.errors import Problem
    from percuss.methods.interfaces import Floats


class Lead(NamedTuple):
    """By how much internal forces look ahead."""

    time: float
    displacement: Floats  # work space of the size of `Bulk.force`


class Viscosity(Part[float]):
    """The part of a step with viscous bodies; its data is the time by which their internal forces look ahead."""

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None where the scheme has no viscosity."""
        model, viscosity = setting.model, viscosity_of(setting.model)
        return cls(viscosity * model.dt) if viscosity else None

    def changed(self, action: Action) -> Action | None:
        """Return the update of a block with forces that look ahead."""
        if action.kernel is not advance_block:
            return action
        data = action.data._replace(part=Lead(self.data, np.zeros(action.data.force.size)))
        filled = {force_of_elements: force_of_elements_ahead, force_of_cells: force_of_cells_ahead}
        return replace(action, data=data, slots={**action.slots, **filled})


def look_ahead(lead: Lead, u: Floats, v: Floats) -> None:
    """Set the displacement that lies ahead along the velocity of half a step before."""
    for i in range(u.size):
        lead.displacement[i] = u[i] + lead.time * v[i]


def force_of_elements_ahead(
    data: Bulk, material: MaterialPoints, first: int, u: Floats, v: Floats, force: Floats
) -> None:
    """Set the internal force of two-node elements from `first` on, at the displacement that lies ahead."""
    look_ahead(data.part, u, v)
    internal_force(data.block.element, material, first, data.dim, data.part.displacement[: u.size], force)


def force_of_cells_ahead(data: Bulk, material: MaterialPoints, b: int, u: Floats, v: Floats, force: Floats) -> None:
    """Set the internal force of the cells of body `b`, at the displacement that lies ahead."""
    look_ahead(data.part, u, v)
    internal_force_of_cells(data.block.element, material, b, data.part.displacement[: u.size], force)


def viscosity_of(model: Model) -> float:
    """Return the time of the viscosity of a leap-frog scheme over the step, `percuss.LeapFrog.viscosity`."""
    return 0.0 if model.multistage else model.tables[0].viscosity


def feature(model: Model) -> Feature | None:
    """Return what is to know of viscous bodies; None where the scheme has no viscosity.

    With ``v += dt f, u += dt v`` and ``f = -omega^2 (u + viscosity dt v)`` the step has the trace
    ``2 - x (1 + viscosity)`` and the determinant ``1 - x viscosity``, x = (omega dt)^2. It is stable while
    1 + trace + determinant is positive, ``x (1 + 2 viscosity) < 4``.
    """
    viscosity, name = viscosity_of(model), model.case.method.integrator.name
    if not viscosity:
        return None
    return Feature(
        name=name,
        alters=ELASTIC,
        limit_ratio=1.0 / math.sqrt(1.0 + 2.0 * viscosity),
        no_row_kernel=True,
        sums_internal_work=True,
        dissipates=True,
        reasons={
            "energy": "viscosity takes energy in every step: no balance of elastic and kinetic energy is kept",
            "springs": (
                f"{name} is viscous in the bodies and not in their contacts, so that a closed contact does not act as "
                "a stiffness"
            ),
            "plain bars": f"{name} is viscous",
        },
    )


def refusals(model: Model) -> Iterator[Problem]:
    """Yield a problem where bodies are not linear: the viscosity is that of a stiffness."""
    if viscosity_of(model) and model.bodies.why_not_linear:
        name = model.case.method.integrator.name
        message = f"expected linear bodies with the viscous {name}, found that {model.bodies.why_not_linear}"
        advice = "Its viscosity is that of a stiffness, which these bodies do not have: take central-difference."
        yield model.case.problem(("method", "integrator"), message, advice)
