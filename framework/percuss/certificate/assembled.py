"""The operator of bodies of any dimension, assembled from the stiffness of their cells."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.certificate.lines import held_throughout, line_operator
from percuss.certificate.operator import Operator
from percuss.contact.contact_point import gap_rows
from percuss.mesh.loads import directions_at_nodes

if TYPE_CHECKING:
    from percuss.march.model import Model
    from percuss.methods.interfaces import Floats

SAME_DIRECTION = 1e-9  # length below which what supports leave of a direction is round-off


def operator_of(model: Model, *, tied: bool = True) -> Operator:
    """Return the operator of a stretch of a run: of all motions that supports leave free, and the ties too if `tied`.

    It is banded for bars, and sparse for any other bodies.
    """
    if model.bodies.of_lines:
        return line_operator(model, tied=tied)
    from scipy.sparse import block_diag, csr_array, diags_array

    basis = free_motions(model)
    stiffness = csr_array(block_diag([body.stiffness_matrix() for body in model.bodies.values()], format="csr"))
    rows = gap_rows(model.contact_points, model.bodies.n_nodes * model.dim, model.dim)
    if tied and model.tied_points:
        basis = basis @ _without(rows[:, list(model.tied_points)].T @ basis)
    mass = diags_array(model.bodies.mass_of_dofs)
    return Operator(*map(csr_array, (basis.T @ stiffness @ basis, basis.T @ mass @ basis, basis.T @ rows)))


def rigid_motions(model: Model) -> Floats:
    """Return the motions of bodies as a whole that supports allow, one a column, (nodes * dim, k).

    A bar moves along its axis. Displacements of other bodies are small, so that a rotation moves a node across its
    distance from the middle of the body.
    """
    from scipy.linalg import null_space

    dim, held, columns = model.dim, directions_at_nodes(held_throughout(model)), []
    for body in model.bodies.values():
        inside = slice(body.start, body.stop)
        arm = model.bodies.nodes[inside] - model.bodies.nodes[inside].mean(axis=0)
        axes = np.eye(dim) if body.mesh.line is None else body.mesh.direction[None]
        fields = [np.tile(axis, (len(arm), 1)) for axis in axes]
        for first, second in itertools.combinations(range(dim if body.mesh.line is None else 0), 2):
            turned = np.zeros_like(arm)
            turned[:, first], turned[:, second] = -arm[:, second], arm[:, first]
            fields.append(turned / np.abs(arm).max())
        motions = np.zeros((len(fields), model.bodies.n_nodes, dim))
        motions[:, inside] = fields
        nodes = [node for node in held if body.start <= node < body.stop]
        caught = np.array([motions[:, node] @ direction for node in nodes for direction in held[node]])
        caught = caught[np.abs(caught).max(axis=1) > SAME_DIRECTION] if nodes else caught
        allowed = null_space(caught) if caught.size else np.eye(len(fields))
        columns.append(motions.reshape(len(fields), -1).T @ allowed)
    return np.concatenate(columns, axis=1)


def free_motions(model: Model) -> Any:
    """Return the motions that supports and drives leave free, one a column, sparse and orthonormal.

    A node of a bar moves along it, and in every direction if it is in contact.
    """
    from scipy.sparse import csr_array

    held, dim = directions_at_nodes(held_throughout(model)), model.dim
    touched = {node for contact_point in model.contact_points for node in contact_point.nodes}
    columns: list[tuple[int, Floats]] = []
    for body in model.bodies.values():
        axes = [*np.eye(dim)] if body.mesh.line is None else [body.mesh.direction]
        for node in range(body.start, body.stop):
            if node not in held and (node not in touched or body.mesh.line is None):
                columns += [(node, axis) for axis in axes]
                continue
            kept: list[Floats] = []
            for axis in (*axes, *np.eye(dim)) if node in touched else axes:
                rest = axis
                for direction in (*held.get(node, ()), *kept):
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
