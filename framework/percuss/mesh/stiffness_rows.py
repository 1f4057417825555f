"""The stiffness of a solid as rows of differences: the force on a node from the motions of its neighbours against it.

A motion of a whole body makes no force, so that ``f_i = -sum of K_ij (u_j - u_i)`` over the neighbours j of a node i,
without a diagonal. A body that has moved by many times its size keeps the digits of its forces and of its energy, which
``-K u`` loses: there the force is a small difference of large products.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.jit import called, compiled_function, fused
from percuss.mesh.cell_kernels import room

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integers


class StiffnessRows(NamedTuple):
    """Rows of differences of a body with linear element and material.

    A row about an axis has besides the force of a motion of all nodes away from it, which is no motion of the whole.
    """

    edges: Integers  # (nodes + 1,) first pair of each node, and the number of all pairs
    node: Integers  # (pairs,) the neighbour, in rising order; numbers without sign: none counts from the end
    pairs: Floats  # (pairs, dim, dim) minus the stiffness between the node and its neighbour [force/length]
    outward: Floats  # (nodes, dim) stiffness against a motion of all nodes away from the axis; (0, dim) of other bodies
    axes: tuple[int, ...]  # 0, 1, ... for each dimension; the compiler knows how many there are
    row: tuple[int, ...]  # 0

    def matrix(self) -> Any:
        """Return the stiffness as a sparse array, (nodes * dim, nodes * dim) [force/length]."""
        from scipy.sparse import bsr_array, csr_array

        count, dim, pairs = len(self.edges) - 1, len(self.axes), len(self.node)
        size, numbers = (count * dim, count * dim), np.arange(count + 1, dtype=np.int32)
        sums = csr_array((np.ones(pairs), np.arange(pairs), self.edges), shape=(count, pairs))
        own = (sums @ self.pairs.reshape(pairs, dim * dim)).reshape(count, dim, dim)
        if self.outward.size:
            own[:, :, 0] += self.outward
        own = 0.5 * (own + own.swapaxes(1, 2))  # it is symmetric but for round-off
        between = bsr_array((-self.pairs, self.node.astype(np.int32), self.edges), shape=size)
        return between + bsr_array((own, numbers[:-1], numbers), shape=size)


def stiffness_rows(cells: Integers, kind: Integers, matrices: Floats, count: int, *, about_axis: bool) -> StiffnessRows:
    """Return the rows of differences of a body.

    Parameters
    ----------
    cells : (elements, nodes of a cell) array
        Nodes of each cell.
    kind, matrices
        Kind of each cell, and the stiffness of each kind, as `percuss.mesh.cell_stiffness.CellStiffness` has them.
    count
        Number of nodes.
    about_axis
        Whether it is a body of revolution, about the axis x = 0.
    """
    cells, dim = cells.astype(np.uint32), matrices.shape[1] // cells.shape[1]
    first = np.concatenate([[0], np.cumsum(np.bincount(cells.ravel(), minlength=count))])
    at, edges, work = np.empty(cells.size, dtype=np.int64), np.zeros(count + 1, dtype=np.int64), first[:-1].copy()
    compiled_function(find_neighbours)(cells, first, at, edges, work)
    node, pairs = np.empty(edges[-1], dtype=np.uint32), np.zeros((edges[-1], dim, dim))
    outward = np.zeros((count if about_axis else 0, dim))
    compiled_function(add_pairs)(cells, kind, matrices, first, at, edges, node, pairs, outward, work)
    return StiffnessRows(edges, node, pairs, outward, tuple(range(dim)), (0,))


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


def add_pairs(
    cells: Integers, kind: Integers, matrices: Floats, first: Integers, at: Integers, edges: Integers, node: Integers,
    pairs: Floats, outward: Floats, place: Integers,
) -> None:  # fmt: skip
    """Set the neighbours of each node, and the sums of what its cells say of each pair, in the order of the cells.

    The last place of a node among the neighbours is kept in `place`.
    """
    nodes, dim = cells.shape[1], pairs.shape[1]
    for i in range(len(place)):
        place[i] = -1
    for i in range(len(place)):
        found = edges[i]
        for p in range(first[i], first[i + 1]):
            for b in range(nodes):
                j = cells[at[p], b]
                if j != i and not edges[i] <= place[j] < found:
                    q = found
                    while q > edges[i] and node[q - 1] > j:
                        node[q] = node[q - 1]
                        place[node[q]] = q
                        q -= 1
                    node[q] = j
                    place[j] = q
                    found += 1
        for p in range(first[i], first[i + 1]):
            e, a = at[p], 0
            while cells[e, a] != i:
                a += 1
            for b in range(nodes):
                j = cells[e, b]
                for c in range(dim):
                    for d in range(dim):
                        stiffness = matrices[kind[e], a * dim + c, b * dim + d]
                        if j != i:
                            pairs[place[j], c, d] -= stiffness
                        if d == 0 and len(outward) > 0:
                            outward[i, c] += stiffness


# ------------------------------------------------------------------------------------------------------ kernels


@fused
def force_of_row(rows: StiffnessRows, i: int, displacement: Floats, sums: Floats) -> None:
    """Set `sums` to the internal force on a node, (1, dim)."""
    dim = len(rows.axes)
    for c in range(dim):
        sums[0, c] = 0.0
    for p in range(rows.edges[i], rows.edges[i + 1]):
        other = rows.node[p] * dim
        for d in range(dim):
            apart = displacement[other + d] - displacement[i * dim + d]
            for c in range(dim):
                sums[0, c] += rows.pairs[p, c, d] * apart
    if len(rows.outward) > 0:
        for c in range(dim):
            sums[0, c] -= rows.outward[i, c] * displacement[i * dim]


@called
def set_forces_of_rows(rows: StiffnessRows, displacement: Floats, force: Floats) -> None:
    """Set `force` to the internal force on the nodes of a body."""
    dim, sums = len(rows.axes), room(rows.row, rows.axes)
    for i in range(len(rows.edges) - 1):
        force_of_row(rows, i, displacement, sums)
        for d in range(dim):
            force[i * dim + d] = sums[0, d]


@called
def energy_of_rows(rows: StiffnessRows, u: Floats, v: Floats, dt: float) -> float:
    """Return the staggered strain energy of a body: minus half the product of force and displacement before.

    Displacements are taken relative to those of its first node, but for those away from an axis: the forces of a body
    add up to zero to round-off alone, which a body that has moved far would multiply with all of its way.
    """
    dim, sums, total = len(rows.axes), room(rows.row, rows.axes), 0.0
    for i in range(len(rows.edges) - 1):
        force_of_row(rows, i, u, sums)
        for d in range(dim):
            before = u[i * dim + d] - dt * v[i * dim + d]
            if d > 0 or len(rows.outward) == 0:
                before -= u[d] - dt * v[d]
            total -= sums[0, d] * before
    return 0.5 * total
