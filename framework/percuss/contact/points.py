"""The contact points of a model as arrays, their rows of N and S, and the records that a step reads and writes.

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
from percuss.mesh.loads import directions_at_nodes
from percuss.mesh.stiffness_rows import in_order
from percuss.methods.blame import breach
from percuss.methods.interfaces import ContactState, LeapFrog, LinearLaw
from percuss.record_arrays import Records, empty_records

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from percuss.contact.bound_law import BoundLaw
    from percuss.mesh.bodies import Bodies
    from percuss.mesh.loads import Constraint
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
        Size of the facet that the point met at the start, at a wall of its own; 0 at the end of a bar [length].
    slides : (P,) bool array
        Whether a step writes its entries anew.
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
    slides: Any

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

    def of_contact(self, name: str) -> Any:
        """Return which points are those of a contact, (P,)."""
        return self.contact == self.contact[self.names.index(name)]

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
        slides=flags,
    )  # fmt: skip


# ----------------------------------------------------------------------------------------------------- rows of N and S


class Rows(NamedTuple):
    """The rows of N and of S = N^T M^-1 N of contact points.

    The entries of a point follow one another: those of N from `start[p]` on, those of S beside the diagonal from
    `other_start[p]` on.

    Attributes
    ----------
    start : (P + 1,) array
    node : (E,) array
        Node of each entry of N.
    beside : (E,) array
        Of a node without mass the node beside it, which carries it; -1 of any other.
    normal, response : (E, dim) arrays
        The coefficients of N there, and those of M^-1 N. At an end without mass 1/m is replaced by ``1 / (k dt^2)``, k
        the stiffness of the end element.
    delassus : (P,) array
        Diagonal of S [1/mass].
    other_start : (P + 1,) array
    other : (K,) array
        Another point that shares a node with the point, or is coupled with it by a mass.
    coupling : (K,) array
        The entry of S of both [1/mass].
    """

    start: Integers
    node: Integers
    beside: Integers
    normal: Floats
    response: Floats
    delassus: Floats
    other_start: Integers
    other: Integers
    coupling: Floats

    @property
    def point(self) -> Integers:
        """Point of each entry of N, (E,)."""
        return np.repeat(np.arange(self.delassus.size), np.diff(self.start))

    @property
    def sums(self) -> Floats:
        """Sum of the absolute values in each row of S, (P,)."""
        one = np.repeat(np.arange(self.delassus.size), np.diff(self.other_start))
        sums: Floats = self.delassus + np.bincount(one, np.abs(self.coupling), self.delassus.size)
        return sums

    def matrix(self) -> Any:
        """Return S as a sparse array, (P, P), with entries that are 0: of points that share a node crosswise."""
        from scipy.sparse import csr_array

        points = np.arange(self.delassus.size)
        row, column = np.repeat(points, np.diff(self.other_start)), self.other
        place = np.concatenate([row, points]), np.concatenate([column, points])
        return csr_array((np.concatenate([self.coupling, self.delassus]), place), shape=(points.size,) * 2)

    def permuted(self, order: Sequence[int]) -> Rows:
        """Return the rows of the points in another order, which S numbers them by too."""
        points = np.array(order, dtype=np.int64)
        start, entry = in_order(self.start, points)
        other_start, other = in_order(self.other_start, points)
        number = np.argsort(points)
        return Rows(
            start, self.node[entry], self.beside[entry], self.normal[entry], self.response[entry],
            self.delassus[points], other_start, number[self.other[other]], self.coupling[other],
        )  # fmt: skip


def rows_of(
    points: PointArrays, bodies: Bodies, constraints: Iterable[Constraint], dt: float, slowing: Floats | None = None
) -> Rows:
    """Return the rows of contact points while some supports and drives act.

    `slowing` is what the inertia of each node is over its mass, (nodes,); 1 where it is None.
    """
    free, directions = points.value.copy(), directions_at_nodes(constraints)
    # A force moves its node along no direction in which a constraint holds it.
    for k in np.flatnonzero(np.isin(points.node, list(directions))):
        for direction in directions[int(points.node[k])]:
            free[k] -= (direction @ free[k]) * direction
    node, normal, beside, point = points.node, points.value, np.full(points.node.size, -1), points.point
    mass = (bodies.mass if slowing is None else bodies.mass * slowing)[node][:, None]
    response = np.divide(free, mass, out=np.zeros_like(free), where=mass > 0.0)
    for k in np.flatnonzero(mass == 0.0):
        body, end = bodies.at(int(node[k])), int(node[k])
        response[k] = free[k] / (float(body.stiffness[body.end_element(end)]) * dt**2)
        beside[k] = body.carrier(end)
    if any(body.inverse is not None for body in bodies.values()):
        # Those nodes follow that a force on a node moves too; they have no normal of their own.
        moved = [body.response(n) if (body := bodies.at(n)).inverse is not None else {n: np.nan} for n in node.tolist()]
        entry = np.repeat(np.arange(node.size), [len(one) for one in moved])
        by_force = np.array([value for one in moved for value in one.values()])[:, None]
        response = np.where(np.isnan(by_force), response[entry], free[entry] * by_force)
        node, own, beside, point = np.array([n for one in moved for n in one]), node[entry], beside[entry], point[entry]
        normal = np.where((node == own)[:, None], normal[entry], 0.0)
    start = np.searchsorted(point, np.arange(len(points) + 1))
    # A point with a side without mass has the response of such sides alone: what its force moves of the other side, and
    # of other points, comes a step later.
    balanced = np.zeros(len(points), dtype=bool)
    balanced[point[beside >= 0]] = True
    acts = ~balanced[point] | (beside >= 0)
    delassus = _delassus(len(points), point[acts], node[acts], normal[acts], response[acts])
    return Rows(start, node, beside, normal, response, *delassus)


def _delassus(
    points: int, point: Integers, node: Integers, normal: Floats, response: Floats
) -> tuple[Floats, Integers, Integers, Floats]:
    """Return S = N^T M^-1 N as its diagonal, and its other entries: their start in each row, their points and values.

    The sums run over the nodes in the order in which points meet them.
    """
    _, first, number = np.unique(node, return_index=True, return_inverse=True)
    mine, of_node = np.lexsort((first[number], point)), np.argsort(number, kind="stable")
    start = np.searchsorted(number[of_node], np.arange(first.size + 1))
    begin, meets = in_order(start, number[mine])
    one, other = np.repeat(mine, np.diff(begin)), of_node[meets]
    key, value = added_up(point[one] * points + point[other], np.vecdot(normal[one], response[other])[:, None])
    row, column = np.divmod(key, max(points, 1))
    own = row == column
    diagonal = np.zeros(points)
    diagonal[row[own]] = value[own, 0]
    return diagonal, np.searchsorted(row[~own], np.arange(points + 1)), column[~own], value[~own, 0]


def added_up(keys: Integers, values: Floats) -> tuple[Integers, Floats]:
    """Return the keys, each once in the order of its first place, and the sums of their values, added in order.

    Parameters
    ----------
    keys : (n,) array
    values : (n, k) array
    """
    distinct, first, number = np.unique(keys, return_index=True, return_inverse=True)
    sums: Floats = np.stack([np.bincount(number, column, distinct.size) for column in values.T], axis=1)
    order = np.argsort(first)
    return distinct[order], sums[order]


# ------------------------------------------------------------------------------------------------------------- records

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
        ("weight", "f8"),  # area with which the law is bound
    ]
)
# The row of each point: what a part of a step may renew.
ROW = np.dtype(
    [
        ("initial_gap", "f8"),  # the gap is this plus N u
        ("weight", "f8"),  # area that belongs to the point
        ("sigma", "f8"),  # compliance of its law at this area
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
    normal: Floats  # (P, dim) unit vectors from the first surface to the second, or to the wall


def law_records(bound_law: BoundLaw, table: LeapFrog, delassus: Floats) -> Any:
    """Return the (P,) `LAW` records of a bound law with an integrator, without the rows of their points.

    The records of a law with a kernel contain nothing but the mark for it.

    Parameters
    ----------
    bound_law
        The law.
    table
        The states at which the integrator evaluates explicit laws and laws at the end of the step.
    delassus : (P,) array
        Diagonal of S at the points of the law [1/mass].

    Raises
    ------
    PluginError
        If sigma and w are both zero, so that no force follows.
    """
    records = np.zeros(delassus.size, dtype=LAW)
    linear = bound_law.linear
    if linear is None:
        records["source"], records["end_stiffness"] = FROM_KERNEL, np.nan
        return records
    state: ContactState = getattr(table, linear.at)
    weights = linear.gap, linear.rate, linear.acceleration
    response = sum(weight * unit_response for weight, unit_response in zip(weights, state.response, strict=True))
    if np.any(linear.sigma + response * delassus <= 0):
        raise breach(
            bound_law.law,
            "bind",
            "sigma and the response of the state at which it is evaluated are both zero, so no force follows; give a "
            "compliance, or evaluate it at the end of the step",
        )
    records["weight_gap"], records["weight_rate"], records["weight_acceleration"] = weights
    sigma = records["sigma"] = linear.sigma
    records["response"] = response
    with np.errstate(divide="ignore"):
        records["end_stiffness"] = np.where((sigma > 0) & (linear.at == "explicit"), np.divide(1.0, sigma), np.nan)
    records["sees_predicted_gap"] = state.gap == "predicted"
    records["sees_predicted_rate"] = state.rate == "predicted"
    records["sees_acceleration"] = state.acceleration == "bulk"
    records["always"] = linear.active == "all"
    records["never_pulls"] = linear.sign == ">= 0"
    # With every leap-frog scheme a unit multiplier changes the gap at the end of the step by the same amount.
    records["surplus"] = response - linear.gap * table.end.response[0]
    records["stores"] = energy_storage(linear, state)
    return records


def energy_storage(linear: LinearLaw, state: ContactState) -> Any:
    """Return how the points of a linear law store energy, (P,): NOTHING, BY_END or BY_CURRENT."""
    has_inertia = (linear.acceleration != 0) & (state.acceleration == "bulk")
    elastic = (linear.rate == 0) & (linear.sigma > 0)
    if state.gap == "predicted":
        return np.where(elastic & np.logical_not(has_inertia), BY_END, NOTHING)
    full_response = (state.acceleration == "bulk" and state.response[2] == 1) | (linear.acceleration == 0)
    return np.where(elastic & full_response & (state.response[0] == 0), BY_CURRENT, NOTHING)


def point_records(laws: Any, points: PointArrays, order: Sequence[int], rows: Rows, place: Mapping[int, int]) -> Points:
    """Return the records of all contact points of a loop.

    Parameters
    ----------
    laws : (P,) LAW
        Records of the laws, in the order of the loop.
    points
        The contact points of the model.
    order
        Their numbers in the order of the loop.
    rows
        Their rows in this order.
    place
        Map from each boundary node to the index of its first boundary degree of freedom.
    """
    count, dim = rows.delassus.size, rows.normal.shape[1]
    law, row, state, sums = (empty_records(count, kind) for kind in (LAW, ROW, STATE, SUMS))
    law[:] = laws
    law["contact"], row["initial_gap"] = points.contact[list(order)], points.gap[list(order)]
    law["weight"] = row["weight"] = points.weight[list(order)]
    row["delassus"], row["response"], row["sigma"] = rows.delassus, laws["response"], laws["sigma"]
    compliance = laws["sigma"] + laws["surplus"] * rows.delassus
    is_spring = (laws["stores"] == BY_END) & (compliance > 0)
    row["kappa"] = np.divide(laws["weight_gap"], compliance, out=np.zeros(count), where=is_spring)
    row["start"], row["stop"] = rows.start[:-1] * dim, rows.start[1:] * dim
    row["other_start"], row["other_stop"] = rows.other_start[:-1], rows.other_start[1:]
    contacts = empty_records(int(points.contact.max(initial=-1)) + 1, CONTACT)
    contacts["first"] = contacts["last"] = -1
    entries, others = empty_records(rows.normal.size, ENTRY), empty_records(rows.other.size, OTHER)
    first = np.array([place[node] for node in rows.node.tolist()], dtype=np.int64)
    entries["place"] = (first[:, None] + np.arange(dim)).ravel()
    entries["normal"] = rows.normal.ravel()
    entries["response"] = np.where(rows.beside[:, None] < 0, rows.response, 0.0).ravel()
    others["point"], others["value"] = rows.other, rows.coupling
    row["other_stop"][points.slides[list(order)]] += 1  # any other point may share a node with one that slides
    return Points(law, row, state, sums, contacts, entries, others, points.normal[list(order)])


def carry_over(before: Points, after: Points) -> None:
    """Continue the sums of the points after a change of the active drives or laws.

    A node with prescribed velocity does not move under contact forces, so that the effective stiffness of a contact,
    and the energy stored in it, jump when a drive starts or ends. That jump counts as a change of energy like any
    other, because no work corresponds to it.

    Parameters
    ----------
    before, after
        The points before the change, and the new records after it, whose sums are set.
    """
    after.sums[:] = before.sums
    after.contacts[:] = before.contacts
    after.state["multiplier"] = before.state["multiplier"]
