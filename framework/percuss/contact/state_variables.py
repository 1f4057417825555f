"""Where the state variables of contact laws and of materials lie: in two arrays of one number each."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from percuss.contact.bound_law import BoundLaw
    from percuss.contact.model import Model
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats, Integers


@dataclass(frozen=True, eq=False)
class StateVariables:
    """All state variables of a run: those of the laws, then those of the bodies, each of them point by point.

    Attributes
    ----------
    before, after : (size,)
        Their values as the last step has left them, and as the present step leaves them.
    stored, dissipated : (size,) or (0,)
        For a variable that is an energy per volume, stored or dissipated, the volume of its point; else 0. Empty
        where no material has such a variable.
    stored_by_laws : (size,) or (0,)
        1 for a variable that is energy stored by a contact law, else 0. Empty where no law has such a variable.
    places
        First and last index, plus 1, of the variables of each body that has any, by its number.
    laws
        Number of variables of the laws.
    """

    before: Floats
    after: Floats
    stored: Floats
    dissipated: Floats
    stored_by_laws: Floats
    places: Mapping[int, tuple[int, int]]
    laws: int

    @staticmethod
    def of(model: Model, kernel_laws: Sequence[BoundLaw]) -> StateVariables:
        """Return the state variables of a run, all zeros; bodies of the same kind stand one after the other."""
        laws = sum(len(bound_law.where) * bound_law.law.state for bound_law in kernel_laws)
        bodies = sorted(
            (body for body in model.bodies.values() if body.spec.material.state > 0),
            key=lambda body: (_kind(body), body.number),
        )
        sizes = [body.volumes.size * body.spec.material.state for body in bodies]
        edges = list(itertools.accumulate(sizes, initial=laws))
        places = {body.number: place for body, place in zip(bodies, itertools.pairwise(edges), strict=True)}
        of_bodies = [(body.spec.material, places[body.number], body.volumes.ravel()) for body in bodies]
        of_laws, first, size = [], 0, edges[-1]
        for bound_law in kernel_laws:
            stop = first + len(bound_law.where) * bound_law.law.state
            of_laws.append((bound_law.law, (first, stop), 1.0))
            first = stop

        def weights(fact: str, owners: Sequence[tuple[Any, tuple[int, int], Any]]) -> Floats:
            out = np.zeros(size if any(getattr(owner, fact) is not None for owner, _, _ in owners) else 0)
            for owner, (start, stop), weight in owners:
                if (variable := getattr(owner, fact)) is not None:
                    out[start + variable : stop : owner.state] = weight
            return out

        stored, dissipated = weights("stored_in", of_bodies), weights("dissipated_in", of_bodies)
        stored_by_laws = weights("stored_in", of_laws)
        return StateVariables(np.zeros(size), np.zeros(size), stored, dissipated, stored_by_laws, places, laws)

    def of_laws(self) -> tuple[Floats, Floats]:
        """Return the variables of the laws, before and after the present step."""
        return self.before[: self.laws], self.after[: self.laws]

    def of_bodies(self, bodies: Sequence[Body]) -> tuple[Floats, Floats]:
        """Return the variables of bodies of one kind, (points, variables) each; `before` is read-only."""
        state = bodies[0].spec.material.state
        points = sum(body.volumes.size for body in bodies)
        if state == 0:
            return np.zeros((points, 0)), np.zeros((points, 0))
        start = self.places[bodies[0].number][0]
        before, after = (
            array[start : start + points * state].reshape(points, state) for array in (self.before, self.after)
        )
        before.flags.writeable = False
        return before, after

    def of_elements(self, model: Model, elements: Mapping[str, Integers]) -> Integers:
        """Return the indices of the variables of some elements of each body, in the order of the bodies."""
        indices = [np.zeros(0, dtype=np.int64)]
        for name, numbers in elements.items():
            body = model.bodies[name]
            if body.number in self.places:
                state = body.spec.material.state * body.volumes.shape[1]
                first = self.places[body.number][0] + numbers * state
                indices.append((first[:, None] + np.arange(state)).ravel())
        return np.concatenate(indices)


def _kind(body: Body) -> str:
    """Return a text that is the same for bodies of one group: of one kind of element and material.

    Bodies of cells are in one group if their elements have the same options too.
    """
    options = f" {body.spec.element!r}" if body.of_cells else ""
    return options + " ".join(
        f"{kind.__module__}.{kind.__qualname__}" for kind in map(type, (body.spec.element, body.spec.material))
    )
