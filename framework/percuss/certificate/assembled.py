"""The operator of bodies of any dimension, assembled from the stiffness of their cells."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.certificate.lines import held_directions, line_operator
from percuss.certificate.operator import Operator
from percuss.contact.contact_point import gap_rows

if TYPE_CHECKING:
    from percuss.march.model import Model
    from percuss.methods.interfaces import Floats

SAME_DIRECTION = 1e-9  # length below which what supports leave of a direction is round-off


def assembled_operator(model: Model, *, tied: bool = True) -> Operator:
    """Return the operator of all motions that the supports of a stretch leave free, and the ties too if `tied`."""
    from scipy.sparse import block_diag, csr_array, diags_array

    basis = free_motions(model)
    stiffness = csr_array(block_diag([body.stiffness_matrix() for body in model.bodies.values()], format="csr"))
    rows = gap_rows(model.contact_points, model.bodies.n_nodes * model.dim, model.dim)
    if tied and model.tied_points:
        basis = basis @ _without(rows[:, list(model.tied_points)].T @ basis)
    mass = diags_array(model.bodies.mass_of_dofs)
    return Operator(
        csr_array(basis.T @ stiffness @ basis), csr_array(basis.T @ mass @ basis), csr_array(basis.T @ rows)
    )


def operator_of(model: Model) -> Operator:
    """Return the operator of a stretch of a run: banded for bars, sparse for any other bodies."""
    return line_operator(model) if model.bodies.of_lines else assembled_operator(model)


def rigid_motions(model: Model) -> Floats:
    """Return the motions of bodies without strain that supports allow, one a column, (nodes * dim, k).

    Displacements are small, so that a rotation moves a node across its distance from the middle of the body.
    """
    from scipy.linalg import null_space

    dim, held, columns = model.dim, held_directions(model), []
    for body in model.bodies.values():
        inside = slice(body.start, body.stop)
        arm = model.bodies.nodes[inside] - model.bodies.nodes[inside].mean(axis=0)
        fields = [np.tile(axis, (len(arm), 1)) for axis in np.eye(dim)]
        for first in range(dim):
            for second in range(first + 1, dim):
                turned = np.zeros_like(arm)
                turned[:, first], turned[:, second] = -arm[:, second], arm[:, first]
                fields.append(turned / np.abs(arm).max())
        motions = np.zeros((len(fields), model.bodies.n_nodes, dim))
        motions[:, inside] = fields
        nodes = [node for node in held if body.start <= node < body.stop]
        caught = [motions[:, node] @ direction for node in nodes for direction in held[node]]
        allowed = null_space(np.array(caught)) if caught else np.eye(len(fields))
        columns.append(motions.reshape(len(fields), -1).T @ allowed)
    return np.concatenate(columns, axis=1)


def free_motions(model: Model) -> Any:
    """Return the motions that supports and drives leave free, one a column, sparse and orthonormal."""
    from scipy.sparse import csr_array

    held, dim = held_directions(model), model.dim
    columns: list[tuple[int, Floats]] = []
    for node in range(model.bodies.n_nodes):
        if node not in held:
            columns += [(node, axis) for axis in np.eye(dim)]
            continue
        kept: list[Floats] = []
        for axis in np.eye(dim):
            rest = axis.copy()
            for direction in (*held[node], *kept):
                rest = rest - (rest @ direction) * direction
            if np.linalg.norm(rest) > SAME_DIRECTION:
                kept.append(rest / np.linalg.norm(rest))
        columns += [(node, axis) for axis in kept]
    nodes = np.array([node for node, _ in columns], dtype=np.int64)
    values = np.array([axis for _, axis in columns]).reshape(-1, dim)
    dofs = (nodes[:, None] * dim + np.arange(dim)).ravel()
    matrix = csr_array(
        (values.ravel(), (dofs, np.repeat(np.arange(nodes.size), dim))), shape=(model.bodies.n_nodes * dim, nodes.size)
    )
    matrix.eliminate_zeros()
    return matrix


def _without(ties: Any) -> Any:
    """Return the motions that leave the rows `ties` at zero, one a column: most of them move one degree of freedom."""
    from scipy.linalg import null_space
    from scipy.sparse import csr_array, hstack

    ties = csr_array(ties)
    count = ties.shape[1]
    touched = np.unique(ties.indices)
    rest = np.setdiff1d(np.arange(count), touched)
    alone = csr_array((np.ones(rest.size), (rest, np.arange(rest.size))), shape=(count, rest.size))
    together = null_space(ties[:, touched].toarray())
    row = np.repeat(touched, together.shape[1])
    column = np.tile(np.arange(together.shape[1]), touched.size)
    return hstack([alone, csr_array((together.ravel(), (row, column)), shape=(count, together.shape[1]))]).tocsr()
