"""Bodies that are tied throughout a stretch, as one body: the motions that leave the gaps of their ties unchanged.

A tie acts in every step, whatever the gap. The step without it is never made, and a body that is part of a larger one
may vibrate more slowly than it would alone. Tied ends, which face each other on one line, are one node of their common
mass; an end that is tied to a wall, or to an end that is held, is held too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.certificate.axial_matrix import AxialMatrix
from percuss.mesh.banded_matrices import times

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integers

# The sides of a tie that are not held: node and N along the axis of its body.
Tie = Sequence[tuple[int, float]]


class Part(NamedTuple):
    """Mass and stiffness of one body, or of bodies that are tied.

    Attributes
    ----------
    matrix
        Mass and stiffness of its free motions; of tied bodies `first` says nothing.
    nodes, rows, signs : (m,) arrays
        The nodes that move, the row of `matrix` by which each of them moves, and whether along its axis or against it.
    """

    matrix: AxialMatrix
    nodes: Integers
    rows: Integers
    signs: Floats

    def at(self, nodes: Integers) -> list[tuple[int, int, float]]:
        """Return node, row and sign of those of the given nodes, in ascending order, that move in this part."""
        place = np.minimum(np.searchsorted(nodes, self.nodes), nodes.size - 1)
        kept = np.flatnonzero(nodes[place] == self.nodes) if nodes.size else ()
        return [(int(self.nodes[k]), int(self.rows[k]), float(self.signs[k])) for k in kept]


def nodes_of(body: AxialMatrix) -> Integers:
    """Return the free nodes of a body."""
    return body.first + np.arange(body.mass.size)


def parts_of(bodies: Sequence[AxialMatrix], ties: Sequence[Tie]) -> list[Part]:
    """Return the bodies, with those that ties join as one part; the sides of a tie that are held stand in no body."""
    ends = {node for tie in ties for node, _ in tie}
    tied = [body for body in bodies if ends.intersection((body.first, body.first + body.mass.size - 1))]
    parts = [
        Part(body, nodes_of(body), np.arange(body.mass.size), np.ones(body.mass.size))
        for body in bodies
        if all(body is not other for other in tied)
    ]
    return [*parts, *_joined(tied, ties)] if tied else parts


def _joined(bodies: Sequence[AxialMatrix], ties: Sequence[Tie]) -> list[Part]:
    """Return tied bodies as parts that no tie joins."""
    from scipy.sparse import block_diag, csr_array
    from scipy.sparse.csgraph import connected_components, reverse_cuthill_mckee

    nodes = np.concatenate([nodes_of(body) for body in bodies])
    motion, signs = _motions(nodes, ties)
    moving = np.flatnonzero(signs)
    rows = np.unique(motion[moving], return_inverse=True)[1]
    basis: Any = csr_array((signs[moving], (moving, rows)), shape=(nodes.size, int(rows.max(initial=-1)) + 1))
    mass = np.abs(basis).T @ np.concatenate([body.mass for body in bodies])
    stiffness = basis.T @ csr_array(block_diag([body.full() for body in bodies])) @ basis
    count, part_of = connected_components(stiffness, directed=False) if moving.size else (0, rows)
    parts = []
    for number in range(count):
        order = np.flatnonzero(part_of == number)
        order = order[reverse_cuthill_mckee(csr_array(stiffness[order][:, order]), symmetric_mode=True)]
        here, size = np.isin(rows, order), order.size
        lower = _lower_bands(stiffness[order][:, order])
        off = lower[1:] if lower.shape[0] > 2 else lower[1:, : size - 1].sum(axis=0)
        coupled = np.zeros((2, 0, size))
        if any(body.coupled.size for body in bodies):
            full = basis.T @ np.linalg.inv(block_diag([_inverse(body) for body in bodies]).toarray()) @ basis
            inverse = np.linalg.inv(full[np.ix_(order, order)])
            product = inverse @ stiffness[order][:, order].toarray() @ inverse
            coupled = np.stack([_lower_bands(csr_array(matrix), size) for matrix in (inverse, product)])
        place = np.argsort(order)[np.searchsorted(np.sort(order), rows[here])]
        matrix = AxialMatrix(-1, mass[order], lower[0], off, coupled)
        parts.append(Part(matrix, nodes[moving[here]], place, signs[moving[here]]))
    return parts


def _inverse(body: AxialMatrix) -> Floats:
    """Return M^-1 of a body, (n, n)."""
    return times(body.coupled[0], np.eye(body.mass.size)) if body.coupled.size else np.diag(1.0 / body.mass)


def _motions(nodes: Integers, ties: Sequence[Tie]) -> tuple[Integers, Floats]:
    """Return the motion that each node makes and its sign there, 0 of a node that is held.

    Each node stands twice in a graph, along its axis and against it, and ties join what moves together: a node that is
    joined to its own opposite cannot move.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    row = {int(node): k for k, node in enumerate(nodes)}
    joined = []
    for tie in ties:
        (one, normal), (other, opposite) = ((row[node], along) for node, along in (tie[0], tie[-1]))
        against = nodes.size if normal * opposite > 0.0 else 0
        joined += [(one, other + against), (one + nodes.size, other + nodes.size - against)]
    first, second = np.array(joined).T
    graph = csr_array((np.ones(first.size), (first, second)), shape=(2 * nodes.size,) * 2)
    along, against = connected_components(graph, directed=False)[1].reshape(2, -1)
    return np.minimum(along, against), np.sign(against - along).astype(float)


def _lower_bands(matrix: Any, count: int = 0) -> Floats:
    """Return the diagonal of a sparse symmetric matrix and those below it, `count` of them at least."""
    entries = matrix.tocoo()
    below = entries.row - entries.col
    out = np.zeros((max(int(below.max(initial=0)) + 1, count), matrix.shape[0]))
    kept = below >= 0
    out[below[kept], entries.col[kept]] = entries.data[kept]
    return out
