"""The rows of N and S of all contact points of a model, for the supports and drives that act at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from percuss.contact.contact_rows import Side, delassus_rows
from percuss.mesh.loads import directions_at_nodes

if TYPE_CHECKING:
    from percuss.contact.contact_point import ContactPoint
    from percuss.mesh.bodies import Bodies
    from percuss.mesh.loads import Constraint
    from percuss.methods.interfaces import Floats


class ContactRows(NamedTuple):
    """The rows of N and S of all contact points.

    Attributes
    ----------
    sides
        The sides of each contact point, one at a wall.
    diagonal : (P,) array
        Diagonal of S [1/mass].
    others
        The other entries of each row of S, as `percuss.contact.contact_rows.delassus_rows` returns them.
    """

    sides: list[list[Side]]
    diagonal: Floats
    others: list[dict[int, float]]


class PointRows:
    """The rows of the contact points of a model, made once for each set of active supports and drives.

    Parameters
    ----------
    bodies, constraints, contact_points, dt
        Those of the model.
    """

    def __init__(
        self, bodies: Bodies, constraints: Sequence[Constraint], contact_points: Sequence[ContactPoint], dt: float
    ) -> None:
        self._bodies, self._constraints, self._contact_points, self._dt = bodies, constraints, contact_points, dt
        self._known: dict[tuple[int, ...], ContactRows] = {}

    def at(self, midpoint: float) -> ContactRows:
        """Return N and S = N^T M^-1 N for the supports and drives active at `midpoint`."""
        active = tuple(k for k, constraint in enumerate(self._constraints) if constraint.active(midpoint))
        if active not in self._known:
            sides = self._sides([self._constraints[k] for k in active])
            self._known[active] = ContactRows(sides, *delassus_rows(sides))
        return self._known[active]

    def normals(self) -> Floats:
        """Return N of all contact points, (nodes * dim, P)."""
        bodies = self._bodies
        normals = np.zeros((bodies.n_nodes, bodies.dim, len(self._contact_points)))
        for p, contact_point in enumerate(self._contact_points):
            for node, normal in contact_point.gradient:
                normals[node, :, p] += normal
        return normals.reshape(bodies.n_nodes * bodies.dim, -1)

    def _sides(self, active: Sequence[Constraint]) -> list[list[Side]]:
        directions = directions_at_nodes(active)
        sides = []
        for contact_point in self._contact_points:
            pair_sides = []
            for node, normal in contact_point.gradient:
                free = normal.copy()
                for direction in directions.get(node, ()):
                    free -= (direction @ free) * direction
                pair_sides += self._sides_of(node, normal, free)
            sides.append(pair_sides)
        return sides

    def _sides_of(self, node: int, normal: Floats, free: Floats) -> list[Side]:
        """Return a side of a contact point, with `free` the part of its normal along which no constraint holds it.

        Where the mass couples nodes, those that a force on the side moves too follow, with no normal of their own.
        """
        body = self._bodies.at(node)
        if (beside := body.carrier(node)) != node:
            bar = self._bodies.bar_at(node)
            stiffness = float(bar.stiffness[bar.end_element(node)])
            return [Side(node, normal, free / (stiffness * self._dt**2), beside)]
        if body.inverse is not None:
            return [
                Side(moved, normal if moved == node else np.zeros_like(normal), free * response)
                for moved, response in body.response(node).items()
            ]
        return [Side(node, normal, free / self._bodies.mass[node])]
