"""The contact points of a model as arrays, and the records of contacts and points that a step reads and writes.

A row of N has entries over the boundary degrees of freedom (`percuss.step.records`), as many as it needs: one or two at
the ends of bars, more where a point lies on a facet of several nodes.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.jsonable import Entries
from percuss.record_arrays import Records

if TYPE_CHECKING:
    from percuss.methods.interfaces import ContactLaw, Floats, Integers


TOUCHING = 1e-9  # fraction of an element length; a smaller initial gap or overlap is set to zero


@dataclass(frozen=True, eq=False)
class PointArrays:
    """The contact points of a model: one value a point, contact after contact in the order of the case.

    Stiffness, frequency, mass, `equal_sides` and weight are as `percuss.methods.interfaces.ContactPoints` defines them.

    Attributes
    ----------
    names, laws
        Name of the contact of each point, and its law.
    contact : (P,) array
        Number of its contact in the case.
    count : (P,) array
        Number of nodes that its gap depends on: its entries follow one another in `node` and `value`.
    node : (E,) array
        Node of each entry.
    value : (E, dim) array
        Derivative of the gap by the displacement of that node.
    normal : (P, dim) array
        Unit vector from the first side to the second, or to the wall.
    at_wall : (P,) bool array
    gap : (P,) array
        Gap at the start.
    stiffness, frequency, mass, equal_sides, weight : (P,) arrays
    facet : (P,) array
        Size of the facet that the point met at the start, at a wall of its own; infinite at the end of a bar [length].
    """

    names: tuple[str, ...]
    laws: tuple[ContactLaw, ...]
    contact: Integers
    count: Integers
    node: Integers
    value: Floats
    normal: Floats
    at_wall: Any
    gap: Floats
    stiffness: Floats
    frequency: Floats
    mass: Floats
    equal_sides: Any
    weight: Floats
    facet: Floats

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def start(self) -> Integers:
        """First entry of each point, and the number of all entries, (P + 1,)."""
        return np.concatenate([[0], np.cumsum(self.count)])

    @cached_property
    def point(self) -> Integers:
        """Point of each entry, (E,)."""
        return np.repeat(np.arange(len(self)), self.count)

    @cached_property
    def share(self) -> Floats:
        """Component of each entry along the normal of its point, (E,): what its node has in the motion of the gap."""
        share: Floats = np.vecdot(self.value, self.normal[self.point])
        return share

    def nodes_of(self, point: int) -> list[int]:
        """Return the nodes that the gap of a point depends on."""
        nodes: list[int] = self.node[self.start[point] : self.start[point + 1]].tolist()
        return nodes

    def matrix(self, nodes: int) -> Any:
        """Return N as a sparse array, (nodes * dim, P)."""
        from scipy.sparse import csr_array

        dim = self.value.shape[1]
        dof = self.node[:, None] * dim + np.arange(dim)
        place = dof.ravel(), np.repeat(self.point, dim)
        return csr_array((self.value.ravel(), place), shape=(nodes * dim, len(self)))


def joined(parts: Sequence[PointArrays]) -> PointArrays:
    """Return the points of several contacts one after the other."""
    values = {field.name: [getattr(part, field.name) for part in parts] for field in dataclasses.fields(PointArrays)}
    whole: Entries = {name: tuple(itertools.chain(*values.pop(name))) for name in ("names", "laws")}
    whole |= {name: np.concatenate(arrays) for name, arrays in values.items()}
    return PointArrays(**whole)


def no_points(dim: int) -> PointArrays:
    """Return the points of no contact."""
    whole, flags, real, vectors = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=bool), np.zeros(0), np.zeros((0, dim))
    return PointArrays(
        names=(), laws=(), contact=whole, count=whole, node=whole, value=vectors, normal=vectors, at_wall=flags,
        gap=real, stiffness=real, frequency=real, mass=real, equal_sides=flags, weight=real, facet=real,
    )  # fmt: skip


# How a closed contact stores energy at half steps. BY_END: the force follows from the gap at the end of the step, and
# the contact is a spring whose energy is the mean of those at both ends of the step. BY_CURRENT: the force follows from
# the current gap, and the energy is that of a stiffness and an inertia between two steps.
NOTHING, BY_END, BY_CURRENT = 0, 1, 2
NEVER = -1  # value of `always` for a law outside its intervals of time, which is active at no gap

# Where the multiplier of a point comes from: from its linear law, from the kernel of its law, or from a part of the
# step, which also moves the ends.
FROM_LINE, FROM_KERNEL, FROM_PART = 0, 1, 2

# The coefficients of the law of each point: what no step changes.
LAW = np.dtype(
    [
        ("weight_gap", "f8"),
        ("weight_rate", "f8"),
        ("weight_acceleration", "f8"),
        ("sigma", "f8"),
        ("response", "f8"),  # w, the factor of S in the contact equation
        ("end_stiffness", "f8"),  # 1/sigma of explicit laws, nan for other laws
        ("sees_predicted_gap", "i8"),  # 1 if the law uses the predicted gap, 0 for the current gap
        ("sees_predicted_rate", "i8"),  # 1 if the law uses the predicted gap rate, 0 for the current rate
        ("sees_acceleration", "i8"),  # 1 if the law uses the bulk acceleration of the gap
        ("always", "i8"),  # 1 if the law is active at any gap, 0 if only at a negative one, or NEVER
        ("never_pulls", "i8"),  # 1 if the multiplier must not be negative
        ("source", "i8"),  # where the multiplier comes from: FROM_LINE, FROM_KERNEL or FROM_PART
        ("stores", "i8"),  # how the contact stores energy: NOTHING, BY_END or BY_CURRENT
        ("surplus", "f8"),  # w minus its value for the gap at the end of the step
        ("contact", "i8"),  # number of its contact in the case
    ]
)
# The row of each point: what a part of a step may renew.
ROW = np.dtype(
    [
        ("initial_gap", "f8"),  # the gap is this plus N u
        ("response", "f8"),  # that of its law, in a multi-stage scheme that of the present stage
        ("delassus", "f8"),  # diagonal of S
        ("kappa", "f8"),  # effective stiffness, force over overlap at the end of the step, of points that store BY_END
        ("start", "i8"),  # its entries of N are those from start to stop
        ("stop", "i8"),
        ("other_start", "i8"),  # its off-diagonal entries of S are those from other_start to other_stop
        ("other_stop", "i8"),
    ]
)
# The state of each point in a step.
STATE = np.dtype(
    [
        ("gap", "f8"),  # at t_n
        ("predicted_gap", "f8"),  # after the bulk update
        ("rate", "f8"),  # at n - 1/2
        ("predicted_rate", "f8"),  # after the bulk update
        ("multiplier", "f8"),
    ]
)
# What is summed up over the steps of a run, or is carried from one step to the next.
SUMS = np.dtype(
    [
        ("stored", "f8"),  # stored energy at n - 1/2, after the step that at n + 1/2
        ("active", "i8"),  # 1 if the contact had a force or stored energy in the step before
        ("impulse", "f8"),
        ("deepest", "f8"),  # largest overlap
    ]
)
# A contact of the case, with all its points.
CONTACT = np.dtype(
    [
        # in the present step
        ("force", "f8"),  # sum of the multipliers
        ("gap", "f8"),  # the smallest one
        ("pressing", "i8"),  # 1 if a point has a force
        # over the steps of a run
        ("peak", "f8"),  # largest force
        ("overlap", "f8"),  # sum of the largest overlaps of the steps
        ("closed", "i8"),  # number of steps with a force
        ("first", "i8"),  # first step with a force, -1 if there was none
        ("last", "i8"),  # last step with a force, -1 if there was none
    ]
)
ENTRY = np.dtype([("place", "i8"), ("normal", "f8"), ("response", "f8")])  # index of a boundary dof, N, M^-1 N
OTHER = np.dtype([("point", "i8"), ("value", "f8")])  # off-diagonal entries of S


class Points(NamedTuple):
    """The contact points of a step: a record of each kind for each, their contacts, the entries of N and S."""

    law: Any  # (P,) LAW
    row: Any  # (P,) ROW
    state: Any  # (P,) STATE
    sums: Any  # (P,) SUMS
    contacts: Records  # CONTACT
    entries: Records  # ENTRY
    others: Records  # OTHER
