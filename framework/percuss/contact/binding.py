"""What the contact laws of a model receive of their points over the whole run, and the laws bound to these points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contact.bound_law import BoundLaw, bind_law
from percuss.contact.stiffness_limits import stiffness_limits
from percuss.contact.surface_limits import SurfaceLimits
from percuss.errors import Problem, refuse_if_any
from percuss.methods.blame import said_by
from percuss.methods.interfaces import ContactLaw, ContactPoints, Floats

if TYPE_CHECKING:
    from percuss.contact.contact_rows import Side
    from percuss.contact.model_arrays import ModelArrays
    from percuss.contact.point_rows import ContactRows


class Binding:
    """The properties of the contact points of a model, as laws receive them, and the laws bound to the points.

    Parameters
    ----------
    model
        The model of the whole run; its laws may still be missing.
    """

    def __init__(self, model: ModelArrays) -> None:
        self.model = model
        self.contact_points = model.contact_points

    def points(self, where: Sequence[int], dt: float) -> ContactPoints:
        """Return the properties of the contact points `where` that a law receives for a time step `dt`."""

        def column(values: Any, dtype: type = float) -> Any:
            array: Any = np.array(values, dtype=dtype)
            array.flags.writeable = False
            return array

        contact_points = [self.contact_points[p] for p in where]
        delassus, coupling = self._largest_delassus
        return ContactPoints(
            names=tuple(contact_point.name for contact_point in contact_points),
            stiffness=column([contact_point.stiffness for contact_point in contact_points]),
            frequency=column([contact_point.frequency for contact_point in contact_points]),
            mass=column([contact_point.mass for contact_point in contact_points]),
            equal_sides=column([contact_point.equal_sides for contact_point in contact_points], bool),
            delassus=column(delassus[list(where)]),
            coupling=column(coupling[list(where)]),
            weight=column([contact_point.weight for contact_point in contact_points]),
            limits=lambda: column(self._stiffness_limits(dt)[list(where)]),
        )

    def laws(self, dt: float) -> tuple[BoundLaw, ...]:
        """Return the laws bound for a time step `dt`: linear laws before laws with a kernel, in the order of points.

        Raises
        ------
        InputError
            If the options of a law do not fit, or a kernel that solves coupled contacts together has only some of them.
        """
        groups: dict[ContactLaw, list[int]] = {}
        for p, contact_point in enumerate(self.contact_points):
            groups.setdefault(contact_point.law, []).append(p)
        problems: list[Problem] = []
        laws = []
        for law, where in groups.items():
            try:
                laws.append(bind_law(law, tuple(where), self.points(where, dt), dt))
            except ValueError as error:
                problems.append(self.model.case.problem(("method", "contact"), said_by(error)))
        refuse_if_any(problems)
        coupled = [bound_law for bound_law in laws if bound_law.linear is None and bound_law.law.uses_coupling]
        refuse_if_any([problem for bound_law in coupled for problem in self._shared_with_others(bound_law)])
        return tuple(sorted(laws, key=lambda bound_law: (bound_law.linear is None, bound_law.where)))

    @cached_property
    def neighbours(self) -> list[set[int]]:
        """The contact points that are coupled with each at some time of the run."""
        neighbours: list[set[int]] = [set() for _ in self.contact_points]
        for rows in self._over_the_run():
            neighbours = [near.union(row) for near, row in zip(neighbours, rows.others, strict=True)]
        return neighbours

    def _shared_with_others(self, bound_law: BoundLaw) -> Iterator[Problem]:
        """Yield each contact that shares an end with one of a law, whose kernel solves them together, and has another.

        The kernel would not know its force.
        """
        name = bound_law.law.name
        shared = {q: p for p in bound_law.where for q in self.neighbours[p].difference(bound_law.where)}
        for q, p in sorted(shared.items()):
            one, other = self.contact_points[p], self.contact_points[q]
            found = other.law.name if other.law.name != name else "other options"
            message = (
                f"expected {name} with the options of contact '{one.name}', as both act on one end and the kernel of "
                f"{name} solves all contacts there together; found {found}"
            )
            advice = "Give both the same law and options, or take laws without such a kernel."
            yield self.model.case.problem(("contacts", other.name), message, advice, any_inside=True)

    def _over_the_run(self) -> Iterator[ContactRows]:
        """Yield the rows of each stretch of the run in which other supports or drives act."""
        for start, _ in self.model.segments(laws=False):
            yield self.model.rows.at((start + 0.5) * self.model.dt)

    @cached_property
    def _largest_delassus(self) -> tuple[Floats, Floats]:
        """The largest diagonal entry s of S over the run, and the largest absolute row sum of S over s, (P,) each."""
        largest, sums = np.zeros(len(self.contact_points)), np.zeros(len(self.contact_points))
        for _, diagonal, others in self._over_the_run():
            largest = np.maximum(largest, diagonal)
            sums = np.maximum(sums, diagonal + np.array([sum(map(abs, row.values())) for row in others]))
        return largest, sums / largest

    def _stiffness_limits(self, dt: float) -> Floats:
        bodies = self.model.bodies
        if not bodies.of_lines:
            return self._surface_limits.at(dt)
        return stiffness_limits(bodies.bars.values(), self.contact_points, self._moved_nodes, dt)

    @cached_property
    def _surface_limits(self) -> SurfaceLimits:
        return SurfaceLimits(self.model.bodies.values(), self.contact_points, self._moved_nodes)

    @cached_property
    def _moved_nodes(self) -> list[list[int]]:
        """Nodes of each contact point that its force moves at some time of the run: not always fixed or driven."""
        moved: list[set[int]] = [set() for _ in self.contact_points]
        for rows in self._over_the_run():
            for nodes, sides in zip(moved, rows.sides, strict=True):
                nodes.update(side.node for side in sides if _moves(side, self.model.bodies.mass))
        return [sorted(nodes) for nodes in moved]


def _moves(side: Side, mass: Floats) -> bool:
    """Return whether a contact force moves a side of its point."""
    # Round-off may be left of the direction of a drive that is oblique to the axes.
    return side.beside is not None or bool(side.normal @ side.response * mass[side.node] > 1e-12)
