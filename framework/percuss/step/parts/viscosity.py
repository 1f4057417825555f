"""Stiffness-proportional viscosity: internal forces are those of the displacement that lies ahead by a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from percuss.step.actions import Action
from percuss.step.bulk import Bulk, advance_block, strained
from percuss.step.part import Part, Setting

if TYPE_CHECKING:
    from percuss.contact.model_arrays import ModelArrays
    from percuss.errors import Problem
    from percuss.methods.interfaces import Floats


class Lead(NamedTuple):
    """By how much internal forces look ahead."""

    time: float
    displacement: Floats  # work space of the size of `Bulk.force`


class Viscosity(Part):
    """The part of a step with viscous bodies."""

    def __init__(self, time: float) -> None:
        self.time = time

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None where the scheme has no viscosity."""
        model = setting.model
        return cls(model.viscosity * model.dt) if model.viscosity else None

    def changed(self, action: Action) -> Action | None:
        """Return the update of a block with forces that look ahead."""
        if action.kernel is not advance_block:
            return action
        data = action.data._replace(part=Lead(self.time, np.zeros(action.data.force.size)))
        return replace(action, data=data, slots={**action.slots, strained: strained_ahead})


def strained_ahead(data: Bulk, u: Floats, v: Floats) -> Floats:
    """Return the displacement that lies ahead along the velocity of half a step before."""
    ahead: Floats = data.part.displacement[: u.size]
    for i in range(u.size):
        ahead[i] = u[i] + data.part.time * v[i]
    return ahead


def refusals(model: ModelArrays) -> Iterator[Problem]:
    """Yield a problem where bodies are not linear: the viscosity is that of a stiffness."""
    if model.viscosity and model.why_not_linear:
        name = model.case.method.integrator.name
        message = f"expected linear bodies with the viscous {name}, found that {model.why_not_linear}"
        advice = "Its viscosity is that of a stiffness, which these bodies do not have: take central-difference."
        yield model.case.problem(("method", "integrator"), message, advice)
