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

# A law or a material, the number of its points, and the weight of each of these in an energy.
Owner = tuple[Any, int, Any]


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
        bodies = sorted(
            (body for body in model.bodies.values() if body.spec.material.state > 0),
            key=lambda body: (_kind(body), body.number),
        )
        of_laws: list[Owner] = [(one.law, len(one.where), 1.0) for one in kernel_laws]
        of_bodies: list[Owner] = [(body.spec.material, body.volumes.size, body.volumes.ravel()) for body in bodies]
        edges = list(itertools.accumulate((n * one.state for one, n, _ in (*of_laws, *of_bodies)), initial=0))
        first, size = edges[len(of_laws)], edges[-1]
        places = dict(zip((body.number for body in bodies), itertools.pairwise(edges[len(of_laws) :]), strict=True))

        def weights(fact: str, owners: Sequence[Owner], start: int) -> Floats:
            out = np.zeros(size if any(getattr(owner, fact) is not None for owner, _, _ in owners) else 0)
            for owner, points, weight in owners:
                stop = start + points * owner.state
                if (variable := getattr(owner, fact)) is not None:
                    out[start + variable : stop : owner.state] = weight
                start = stop
            return out

        return StateVariables(
            before=np.zeros(size),
            after=np.zeros(size),
            stored=weights("stored_in", of_bodies, first),
            dissipated=weights("dissipated_in", of_bodies, first),
            stored_by_laws=weights("stored_in", of_laws, 0),
            places=places,
            laws=first,
        )

    def of_laws(self) -> tuple[Floats, Floats]:
        """Return the variables of the laws, before and after the present step."""
        return self.before[: self.laws], self.after[: self.laws]

    def of_bodies(self, bodies: Sequence[Body]) -> tuple[Floats, Floats]:
        """Return the variables of bodies of one kind, (points, variables) each; `before` is read-only."""
        state, points = bodies[0].spec.material.state, sum(body.volumes.size for body in bodies)
        start, _ = self.places.get(bodies[0].number, (0, 0))
        place = slice(start, start + points * state)
        before, after = (array[place].reshape(points, state) for array in (self.before, self.after))
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
