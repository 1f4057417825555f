"""The motions of the bodies of a stretch that supports leave free, and mass, stiffness and contact rows of these.

All motions are combinations of nodal displacements. Bars stretch along their axes only, so that the displacements along
these are all of their motions with stiffness. Some bodies need more than that:

- An end without mass moves with the node beside it. While it is open its element has no stress; while it is closed the
  element is a spring in series with the contact (`percuss.certificate.closed_laws`).
- Internal forces that act m-fold in every m-th step are stable where m^2 K is in every step.
- A spring at an end adds to the stiffness there.
- Bodies that are tied throughout a stretch are one. The step without the tie is never made, and a body that is part of
  a larger one may vibrate more slowly than it would alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import null_space
from scipy.sparse import block_diag, csr_array, diags_array, eye_array, hstack, kron
from scipy.sparse.csgraph import connected_components

from percuss.certificate.operator import Operator
from percuss.mesh.loads import directions_at_nodes

if TYPE_CHECKING:
    from collections.abc import Iterable

    from percuss.contact.model import Model
    from percuss.mesh.loads import Constraint
    from percuss.methods.interfaces import Floats

SAME_DIRECTION = 1e-9  # length below which what supports leave of a direction is round-off


def held_throughout(model: Model) -> list[Constraint]:
    """Return the supports and drives that act in the first step and in the last; others count as absent."""
    first, last = 0.5 * model.dt, (model.steps - 0.5) * model.dt
    return [support for support in model.loads.constraints if support.active(first) and support.active(last)]


def operator_of(model: Model) -> Operator:
    """Return the operator of a stretch of a run: of all motions that supports and ties leave free.

    Of a whole run, a drive that is off at any time counts as absent.
    """
    if along_x(model):
        return _of_bars_along_x(model)
    basis = free_motions(model, across=not model.bodies.of_lines)
    rows = model.contact_points.matrix(model.bodies.n_nodes)
    ties = rows[:, list(model.tied_points)] if model.tied_points and model.period == 1 else None
    if ties is not None:
        basis = basis @ motions_without(ties.T @ basis)
    transposed = csr_array(basis.T)
    stiffness, normals = transposed @ _stiffness(model) @ basis, csr_array(transposed @ rows)
    if not model.bodies.couples_nodes:
        weighted = transposed.copy()
        weighted.data *= model.bodies.mass_of_dofs[transposed.indices]
        return Operator(stiffness, weighted @ basis, normals, basis).banded()
    inverse = _inverse_mass(model, basis, ties)
    stiffness, normals = csr_array(inverse @ stiffness @ inverse), csr_array(inverse @ normals)
    return Operator(stiffness, inverse, normals, basis).banded()


def along_x(model: Model) -> bool:
    """Return whether a model has bars in one dimension alone, whose nodes have masses of their own and are not tied."""
    free = not model.tied_points and not model.facts.springs(model)
    return free and model.dim == 1 and not model.bodies.couples_nodes and bool((model.bodies.mass > 0.0).all())


def _of_bars_along_x(model: Model) -> Operator:
    """Return the operator of bars along x: each node is held, or moves along x."""
    free = np.ones(model.bodies.n_nodes, dtype=bool)
    free[list(directions_at_nodes(held_throughout(model)))] = False
    number, bodies = np.cumsum(free, dtype=np.int32) - 1, model.bodies.values()
    entries = [
        (leap**2 * values, body.start + row, body.start + column)
        for body, leap in zip(bodies, model.leaps, strict=True)
        for values, row, column in (body.axial_entries,)
    ]
    values, row, column = map(np.concatenate, zip(*entries, strict=True))
    del entries  # of a million elements they would stand beside all that follows
    kept, size, points = free[row] & free[column], int(free.sum()), model.contact_points
    stiffness = csr_array((values[kept], (number[row[kept]], number[column[kept]])), shape=(size, size))
    on = free[points.node]
    rows = csr_array((points.value[on, 0], (number[points.node[on]], points.point[on])), shape=(size, len(points)))
    each = np.arange(size + 1, dtype=np.int32)
    mass = csr_array((model.bodies.mass[free], each[:-1], each), shape=(size, size))
    motions = csr_array((np.ones(size), each[:-1], np.append(number - free, number[-1]) + 1), shape=(free.size, size))
    return Operator(stiffness, mass, rows, motions)


def _stiffness(model: Model) -> Any:
    """Return the stiffness of all bodies and of springs at their ends, (nodes * dim, nodes * dim)."""
    bodies = model.bodies.values()
    stiffness = block_diag(
        [body.stiffness_matrix() * float(model.leaps[body.number] ** 2) for body in bodies], format="csr"
    )
    if springs := model.facts.springs(model):
        axes = [np.sqrt(spring) * model.bodies.at(node).mesh.direction for node, spring in springs.items()]
        columns = columns_at_nodes(model, list(springs), axes)
        stiffness = stiffness + columns @ columns.T
    return stiffness


def columns_at_nodes(model: Model, nodes: Any, vectors: Any) -> Any:
    """Return (k, dim) vectors at k nodes as the columns of a sparse matrix, (nodes * dim, k)."""
    dim, nodes = model.dim, np.array(nodes, dtype=np.int32)  # 64 bits would double all that follows
    dofs = (nodes[:, None] * dim + np.arange(dim, dtype=np.int32)).ravel()
    columns = np.repeat(np.arange(nodes.size, dtype=np.int32), dim)
    values = np.array(vectors, dtype=float).ravel()
    matrix = csr_array((values, (dofs, columns)), shape=(model.bodies.n_nodes * dim, nodes.size))
    matrix.eliminate_zeros()
    return matrix


def free_motions(model: Model, *, across: bool = True) -> Any:
    """Return the motions that supports and drives leave free, one a column, sparse and orthonormal.

    Where an end has no mass, the length of the motion of the node beside it is that of this node alone.

    Parameters
    ----------
    model
        A stretch of a run.
    across
        Whether the nodes of bars in contact move in every direction, and not along the bar alone.
    """
    dim, held = model.dim, directions_at_nodes(held_throughout(model))
    touched = set(model.contact_points.node.tolist()) if across else set()
    carrier = np.arange(model.bodies.n_nodes)
    found: list[tuple[Any, Floats]] = []
    for body in model.bodies.values():
        line = body.mesh.line is not None
        axes = body.mesh.direction[None] if line else np.eye(dim)
        nodes = np.arange(body.start, body.stop)
        some = nodes[np.isin(nodes, [*held, *(touched if line else ())])].tolist()
        without_mass = nodes[body.mass == 0.0].tolist()
        carrier[without_mass] = [body.carrier(node) for node in without_mass]
        others = np.setdiff1d(nodes, [*some, *without_mass])
        found.append((np.repeat(others, len(axes)), np.tile(axes, (others.size, 1))))
        for node in some:
            if node not in without_mass:
                of_node = [*axes, *(np.eye(dim) if node in touched else ())]
                free = _directions(of_node, held.get(node, ()), dim)
                found.append((np.full(len(free), node), free))
    nodes, directions = (np.concatenate(part) for part in zip(*found, strict=True))
    order = np.argsort(nodes, kind="stable")
    matrix = columns_at_nodes(model, nodes[order], directions[order])
    if (carrier != np.arange(carrier.size)).any():
        matrix = matrix[(carrier[:, None] * dim + np.arange(dim)).ravel()]
    return matrix


def _directions(axes: Iterable[Floats], held: Iterable[Floats], dim: int) -> Floats:
    """Return what `held` directions leave of some axes, orthonormal rows."""
    kept: list[Floats] = []
    for axis in axes:
        rest = axis
        for direction in (*held, *kept):
            rest = rest - (rest @ direction) * direction
        if np.linalg.norm(rest) > SAME_DIRECTION:
            kept.append(rest / np.linalg.norm(rest))
    return np.array(kept).reshape(-1, dim)


def motions_without(ties: Any) -> Any:
    """Return the motions that leave the rows `ties` at zero, one a column: most of them move one degree of freedom."""
    ties = csr_array(ties)
    count = ties.shape[1]
    touched, place = np.unique(ties.indices, return_inverse=True)
    alone = np.setdiff1d(np.arange(count), touched)
    rows, columns, values = [alone], [np.arange(alone.size)], [np.ones(alone.size)]
    next_column = alone.size
    # Ties that move no node together are looked at apart, as a row of many bars has many of them.
    joined = csr_array((ties.data, place, ties.indptr), shape=(ties.shape[0], touched.size)).tocsc()
    labels = connected_components(joined.T @ joined, directed=False)[1]
    for members in np.split(np.argsort(labels, kind="stable"), np.cumsum(np.bincount(labels))[:-1]):
        among = joined[:, members].toarray()
        together = null_space(among[among.any(axis=1)])
        rows.append(np.repeat(touched[members], together.shape[1]))
        columns.append(np.tile(next_column + np.arange(together.shape[1]), members.size))
        values.append(together.ravel())
        next_column += together.shape[1]
    places = np.concatenate(rows), np.concatenate(columns)
    return csr_array((np.concatenate(values), places), shape=(count, next_column))


def _inverse_mass(model: Model, basis: Any, ties: Any) -> Any:
    """Return the inverse of the mass of the motions `basis`, where the mass couples nodes.

    With C = M^-1 and R the directions that supports and ties take away, it is
    ``C - C R (R^T C R)^-1 R^T C`` for these motions: C is sparse and M is not.
    """
    bodies = model.bodies.values()
    blocks = [body.inverse if body.inverse is not None else diags_array(1.0 / body.mass) for body in bodies]
    inverse = kron(block_diag(blocks), eye_array(model.dim), format="csr")
    held = held_throughout(model)
    taken = columns_at_nodes(model, [one.node for one in held], [one.direction for one in held])
    if ties is not None:
        taken = hstack([taken, ties])
    reached = csr_array(inverse @ taken)
    middle = np.linalg.pinv((taken.T @ reached).toarray(), hermitian=True)
    within = basis.T @ reached
    return csr_array(basis.T @ inverse @ basis - within @ csr_array(middle) @ within.T)
