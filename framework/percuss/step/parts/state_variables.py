"""State variables of contact laws and of materials: kept from step to step, summed up as energies, recorded."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from percuss.record_arrays import Records
from percuss.step.actions import AFTER_STEP, BEFORE_ACCOUNT, RECORD, SNAPSHOT, STRAIN_ENERGY, Action
from percuss.step.part import Part, Setting

if TYPE_CHECKING:
    from collections.abc import Mapping

    from percuss.methods.interfaces import Floats, Integers


class Remembered(NamedTuple):
    """The state variables of a run, and where they are recorded."""

    before: Floats  # as the last step has left them
    after: Floats  # as the present step leaves them
    stored: Floats  # for each the volume in which it is stored energy, else 0; empty if none is
    dissipated: Floats  # the same for dissipated energy
    stored_by_laws: Floats  # for each 1 if it is energy that a contact law stores, else 0; empty if none is
    of_laws: Floats  # (R, variables of the laws) recorded
    of_elements: Floats  # (F, variables of the recorded elements)
    recorded: Integers  # indices of the latter
    totals: Records  # percuss.step.records.TOTAL
    now: Records  # percuss.step.records.NOW


class StateVariablesKept(Part[Remembered]):
    """The part of a step with state variables."""

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None where nothing has a state variable."""
        variables, record, step = setting.variables, setting.record, setting.step
        if variables.before.size == 0:
            return None
        if before is not None:
            return cls(before.data._replace(totals=step.totals, now=step.now))
        recorded = (
            variables.of_elements(setting.model, setting.recorded)
            if record.field_every
            else np.zeros(0, dtype=np.int64)
        )
        of_laws = np.full((record.energy.size, variables.laws), np.nan)
        of_elements = np.full((record.field.shape[0], recorded.size), np.nan)
        arrays = variables.before, variables.after, variables.stored, variables.dissipated, variables.stored_by_laws
        return cls(Remembered(*arrays, of_laws, of_elements, recorded, step.totals, step.now))

    def actions(self) -> Iterator[Action]:
        """Yield the actions of a step."""
        yield Action(SNAPSHOT, record_elements, self.data)
        yield Action(AFTER_STEP, carry_over, self.data)
        yield Action(BEFORE_ACCOUNT, add_stored_by_laws, self.data)
        yield Action(STRAIN_ENERGY, add_energies, self.data)
        yield Action(RECORD, record_laws, self.data)

    def changing_arrays(self) -> list[Any]:
        """Return the state variables before a step."""
        return [self.data.before]

    def results(self) -> Mapping[str, Floats]:
        """Return the recorded state variables of the laws, and those of the recorded elements."""
        return {"contact_state": self.data.of_laws, "field_state": self.data.of_elements}


def record_elements(data: Remembered, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Record the state variables from which the stress field is computed."""
    r = data.now[0].row
    for k in range(data.recorded.size):
        data.of_elements[r, k] = data.before[data.recorded[k]]


def carry_over(data: Remembered, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Carry the state variables over to the next step."""
    for i in range(data.before.size):
        data.before[i] = data.after[i]


def add_stored_by_laws(data: Remembered, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set the energy that contact laws store in state variables."""
    if data.stored_by_laws.size > 0:
        data.totals[0].any_contact = 1
        data.totals[0].stored_by_laws = sum_of_products(data.stored_by_laws, data.after)


def add_energies(data: Remembered, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the energies that materials store in state variables, and that they have dissipated."""
    data.totals[0].elastic_energy += sum_of_products(data.stored, data.after)
    data.totals[0].dissipated_energy += sum_of_products(data.dissipated, data.after)


def record_laws(data: Remembered, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Record the state variables of the laws after the step."""
    r = data.now[0].row
    for i in range(data.of_laws.shape[1]):
        data.of_laws[r, i] = data.after[i]


def sum_of_products(weights: Floats, values: Floats) -> float:
    """Return the sum of the products of weights and values."""
    total = 0.0
    for i in range(weights.size):
        total += weights[i] * values[i]
    return total
