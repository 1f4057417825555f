"""The stiffness of a solid as rows of differences: the force on a node from the motions of its neighbours against it.

A motion of a whole body makes no force, so that ``f_i = -sum of K_ij (u_j - u_i)`` over the neighbours j of a node i,
without a diagonal. A body that has moved by many times its size keeps the digits of its forces and of its energy, which
``-K u`` loses: there the force is a small difference of large products.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.jit import Kernel, called, compiled_function, each, fused
from percuss.mesh.cells import cells_of

if TYPE_CHECKING:
    from percuss.methods.interfaces import BodyMesh, Floats, Integers


class StiffnessRows(NamedTuple):
    """Rows of differences of a body with linear element and material.

    A row about an axis has besides the force of a motion of all nodes away from it, which is no motion of the whole.
    """

    edges: Integers  # (nodes + 1,) first pair of each node, and the number of all pairs
    node: Integers  # (pairs,) the neighbour, in rising order; numbers without sign: none counts from the end
    pairs: Floats  # (pairs, dim, dim) minus the stiffness between the node and its neighbour [force/length]
    outward: Floats  # (nodes, dim) stiffness against a motion of all nodes away from the axis; (0, dim) of other bodies

    def near(self, nodes: Integers, steps: int) -> Integers:
        """Return the nodes that are at most so many neighbours away from some nodes, in rising order."""
        is_near, last = np.zeros(len(self.edges) - 1, dtype=bool), nodes
        is_near[nodes] = True
        for _ in range(steps):
            neighbours = self.node[in_order(self.edges, last)[1]]
            last = np.unique(neighbours[~is_near[neighbours]])
            is_near[last] = True
        return np.flatnonzero(is_near)

    def among(self, nodes: Integers) -> StiffnessRows:
        """Return the rows of some nodes in rising order; all others are one more node, the last one, without a row."""
        edges, entry = in_order(self.edges, nodes)
        number: Integers = np.full(len(self.edges) - 1, len(nodes), dtype=np.uint32)
        number[nodes] = np.arange(len(nodes))
        outward = self.outward[nodes] if self.outward.size else self.outward
        return StiffnessRows(np.append(edges, edges[-1]), number[self.node[entry]], self.pairs[entry], outward)

    def hold(self, motion: Floats, forces: Floats) -> None:
        """Set the forces that hold a motion about rest, (nodes * dim,)."""
        compiled_forces(self.pairs.shape[1])(self, motion, forces)
        np.negative(forces, out=forces)

    def matrix(self) -> Any:
        """Return the stiffness as a sparse array, (nodes * dim, nodes * dim) [force/length]."""
        from scipy.sparse import bsr_array, csr_array

        count, dim, pairs = len(self.edges) - 1, self.pairs.shape[1], len(self.node)
        size, numbers = (count * dim, count * dim), np.arange(count + 1, dtype=np.int32)
        sums = csr_array((np.ones(pairs), np.arange(pairs), self.edges), shape=(count, pairs))
        own = (sums @ self.pairs.reshape(pairs, dim * dim)).reshape(count, dim, dim)
        if self.outward.size:
            own[:, :, 0] += self.outward
        own = 0.5 * (own + own.swapaxes(1, 2))  # it is symmetric but for round-off
        between = bsr_array((-self.pairs, self.node.astype(np.int32), self.edges), shape=size)
        return between + bsr_array((own, numbers[:-1], numbers), shape=size)


def in_order(start: Integers, order: Integers) -> tuple[Integers, Integers]:
    """Return where the entries of each row start, and which these are, with the rows in another order."""
    count = np.diff(start)[order]
    new = np.concatenate([[0], np.cumsum(count)])
    return new, np.arange(new[-1]) + np.repeat(start[order] - new[:-1], count)


class Assembly:
    """The rows of a solid, to which the stiffness of its cells is added, some cells at a time in their order.

    Attributes
    ----------
    rows
        The rows of differences, complete once all cells are added.
    """

    def __init__(self, body: BodyMesh) -> None:
        cells: Integers = cells_of(body.mesh).astype(np.uint32)
        count, dim = body.mesh.nodes.shape
        first = np.concatenate([[0], np.cumsum(np.bincount(cells.ravel(), minlength=count))])
        at: Integers = np.empty(cells.size, dtype=np.uint32)
        edges, work = np.zeros(count + 1, dtype=np.int64), first[:-1].copy()
        compiled_function(find_neighbours)(cells, first, at, edges, work)
        node, outward = np.empty(edges[-1], dtype=np.uint32), np.zeros((count * (body.plane == "axisymmetric"), dim))
        compiled_function(sort_neighbours)(cells, first, at, edges, node, work)
        self.rows = StiffnessRows(edges, node, np.zeros((edges[-1], dim, dim)), outward)
        self._cells, self._first, self._at, self._work = cells, first, at, work

    def add(self, start: int, kind: Integers, matrices: Floats) -> None:
        """Add the stiffness of the cells from `start` on: the kind of each, and the stiffness of each kind."""
        add = compiled_function(add_pairs)
        add(start, kind, matrices, self._cells, self._first, self._at, self._work, *self.rows)


# --------------------------------------------------------------------------------------------------- assembly


def find_neighbours(cells: Integers, first: Integers, at: Integers, edges: Integers, work: Integers) -> None:
    """Set the cells `at` each node, in rising order, and the `edges` of `StiffnessRows`.

    The cells at a node i stand from ``first[i]`` on, which is in ``work[i]`` too.
    """
    nodes = cells.shape[1]
    for e in range(len(cells)):
        for a in range(nodes):
            i = cells[e, a]
            at[work[i]] = e
            work[i] += 1
    for i in range(work.size):
        work[i] = -1
    for i in range(work.size):
        edges[i + 1], work[i] = edges[i], i
        for p in range(first[i], first[i + 1]):
            for b in range(nodes):
                j = cells[at[p], b]
                if work[j] != i:
                    work[j] = i
                    edges[i + 1] += 1


def sort_neighbours(
    cells: Integers, first: Integers, at: Integers, edges: Integers, node: Integers, place: Integers
) -> None:
    """Set the neighbours of each node in rising order; the last place of a node among them is kept in `place`."""
    nodes = cells.shape[1]
    for i in range(len(place)):
        place[i] = -1
    for i in range(len(place)):
        found = edges[i]
        for p in range(first[i], first[i + 1]):
            for b in range(nodes):
                j = cells[at[p], b]
                if j != i and not edges[i] <= place[j] < found:
                    sort_in(j, node, edges[i], found, place)
                    found += 1


def sort_in(j: int, node: Integers, first: int, count: int, place: Integers) -> None:
    """Put node j among the neighbours from `first` to `count`, which rise, and keep where each of them is."""
    q = count
    while q > first and node[q - 1] > j:
        node[q] = node[q - 1]
        place[node[q]] = q
        q -= 1
    node[q] = j
    place[j] = q


def add_pairs(
    start: int, kind: Integers, matrices: Floats, cells: Integers, first: Integers, at: Integers, place: Integers,
    edges: Integers, node: Integers, pairs: Floats, outward: Floats,
) -> None:  # fmt: skip
    """Add what the cells from `start` on say of each pair of nodes, in the order of the cells."""
    dim, stop = pairs.shape[1], start + len(kind)
    for i in range(len(place)):
        if first[i] == first[i + 1] or at[first[i]] >= stop or at[first[i + 1] - 1] < start:
            continue
        for q in range(edges[i], edges[i + 1]):
            place[node[q]] = q
        for p in range(first[i], first[i + 1]):
            e, a = at[p], 0
            if start <= e < stop:
                while cells[e, a] != i:
                    a += 1
                add_rows(matrices[kind[e - start], a * dim : (a + 1) * dim], cells[e], i, pairs, outward, place)


def add_rows(rows: Floats, cell: Integers, i: int, pairs: Floats, outward: Floats, place: Integers) -> None:
    """Add the rows of node i in the stiffness of a cell to its pairs."""
    dim = pairs.shape[1]
    for b in range(cell.size):
        j = cell[b]
        for c in range(dim):
            if j != i:
                for d in range(dim):
                    pairs[place[j], c, d] -= rows[c, b * dim + d]
            if len(outward) > 0:
                outward[i, c] += rows[c, b * dim]


# ------------------------------------------------------------------------------------------------------ kernels


@fused
def force_in_plane(edges: Integers, node: Integers, pairs: Floats, u: Floats, i: int) -> tuple[float, float]:
    """Return the sum of the forces of a node's neighbours on it, in two dimensions, in their one order."""
    x, y = 0.0, 0.0
    for p in range(edges[i], edges[i + 1]):
        other, pair = 2 * node[p], pairs[p]
        along, across = u[other] - u[2 * i], u[other + 1] - u[2 * i + 1]
        x += pair[0, 0] * along
        y += pair[1, 0] * along
        x += pair[0, 1] * across
        y += pair[1, 1] * across
    return x, y


@fused
def force_in_space(edges: Integers, node: Integers, pairs: Floats, u: Floats, i: int) -> tuple[float, float, float]:
    """Return the sum of the forces of a node's neighbours on it, in three dimensions, in their one order."""
    x, y, z = 0.0, 0.0, 0.0
    for p in range(edges[i], edges[i + 1]):
        other, pair = 3 * node[p], pairs[p]
        a, b, c = u[other] - u[3 * i], u[other + 1] - u[3 * i + 1], u[other + 2] - u[3 * i + 2]
        x += pair[0, 0] * a
        y += pair[1, 0] * a
        z += pair[2, 0] * a
        x += pair[0, 1] * b
        y += pair[1, 1] * b
        z += pair[2, 1] * b
        x += pair[0, 2] * c
        y += pair[1, 2] * c
        z += pair[2, 2] * c
    return x, y, z


@called
def set_forces_in_plane(rows: StiffnessRows, u: Floats, force: Floats) -> None:
    """Set `force` to the internal force on the nodes of a body in two dimensions."""
    edges, node, pairs = rows.edges, rows.node, rows.pairs
    for i in each(edges.size - 1):
        force[2 * i], force[2 * i + 1] = force_in_plane(edges, node, pairs, u, i)
    for i in range(len(rows.outward)):
        force[2 * i] -= rows.outward[i, 0] * u[2 * i]
        force[2 * i + 1] -= rows.outward[i, 1] * u[2 * i]


@called
def set_forces_in_space(rows: StiffnessRows, u: Floats, force: Floats) -> None:
    """Set `force` to the internal force on the nodes of a body in three dimensions."""
    edges, node, pairs = rows.edges, rows.node, rows.pairs
    for i in each(edges.size - 1):
        force[3 * i], force[3 * i + 1], force[3 * i + 2] = force_in_space(edges, node, pairs, u, i)


SET_FORCES: dict[int, Kernel] = {2: set_forces_in_plane, 3: set_forces_in_space}


@functools.cache
def compiled_forces(dim: int) -> Any:
    """Return the compiled kernel of `SET_FORCES`."""
    return compiled_function(SET_FORCES[dim])


@called
def energy_of_rows(rows: StiffnessRows, force: Floats, u: Floats, v: Floats, dt: float) -> float:
    """Return the staggered strain energy of a body: minus half the product of its force and the displacement before.

    Displacements are taken relative to those of its first node, but for those away from an axis: the forces of a body
    add up to zero to round-off alone, which a body that has moved far would multiply with all of its way.
    """
    dim, total = rows.pairs.shape[1], 0.0
    for d in range(dim):
        first = 0.0 if d == 0 and len(rows.outward) > 0 else u[d] - dt * v[d]
        for k in range(d, u.size, dim):
            total -= force[k] * (u[k] - dt * v[k] - first)
    return 0.5 * total
