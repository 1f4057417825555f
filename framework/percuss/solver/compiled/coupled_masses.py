"""Masses that couple neighbouring nodes, in the time loop.

The bulk update advances all bodies with their nodal masses m, which changes the velocities by ``dt diag(m)^-1 f``. With
``M^-1 diag(m)``, whose rows have the sum 1, this becomes ``dt M^-1 f``; body forces, which accelerate all nodes alike,
are left as they are. What acts on an end moves the nodes beside it too: `carry_to_neighbours`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats
    from percuss.solver.compiled.bulk import Bulk

# A node beside an end on which a load, a support or a drive acts, one record for each direction.
NEIGHBOUR = np.dtype(
    [
        ("place", "i8"),  # index in `boundary_dofs`
        ("end", "i8"),  # that of the end
        ("share", "f8"),  # of the change of velocity of the end by a force there
    ]
)


def keep_state(masses: Bulk, u: Floats, v: Floats) -> None:
    """Keep displacements and velocities before the bulk update."""
    for i in range(masses.change.size):
        masses.change[i] = v[i]
        masses.before[i] = u[i]


def couple_nodes(masses: Bulk, u: Floats, v: Floats, internal_work: Floats, dim: int, dt: float) -> None:
    """Turn the bulk update with nodal masses into that with M, in place; `masses.change` is its change of velocity."""
    change, coupling, mass = masses.change, masses.coupling, masses.mass
    nodes, width = coupling.shape
    reach = width // 2
    for i in range(change.size):
        change[i] = v[i] - change[i]
    work = 0.0
    for i in range(nodes):
        first = max(reach - i, 0)
        stop = min(width, nodes - i + reach)
        for d in range(dim):
            coupled = 0.0
            for k in range(first, stop):
                coupled += coupling[i, k] * change[(i + k - reach) * dim + d]
            j = i * dim + d
            correction = coupled - change[j]
            v[j] += correction
            u[j] = masses.before[j] + dt * v[j]  # a correction of u would be rounded twice, to one side
            work += mass[j] * change[j] * correction
    if internal_work.size > 0:  # body forces do no work on corrections, which leave the momentum as it is
        internal_work[0] -= 0.5 * work


def carry_to_neighbours(neighbours: Any, boundary_dofs: Any) -> None:
    """Change the velocities beside ends on which loads, supports and drives act: that of the end has been changed."""
    for i in range(neighbours.size):
        neighbour = neighbours[i]
        q = boundary_dofs[neighbour.end]
        boundary_dofs[neighbour.place].new_v += neighbour.share * (q.new_v - q.bulk_v)


def couple_accelerations(masses: Bulk, a: Floats, dim: int) -> None:
    """Turn the accelerations of nodal masses, ``diag(m)^-1 f``, into ``M^-1 f``, in place, if masses couple nodes."""
    change, coupling = masses.change, masses.coupling
    if change.size == 0:
        return
    nodes, width = coupling.shape
    reach = width // 2
    for i in range(change.size):
        change[i] = a[i]
    for i in range(nodes):
        for d in range(dim):
            coupled = 0.0
            for k in range(max(reach - i, 0), min(width, nodes - i + reach)):
                coupled += coupling[i, k] * change[(i + k - reach) * dim + d]
            a[i * dim + d] = coupled


def keep_ends(neighbours: Any, boundary_dofs: Any, values: Floats) -> None:
    """Keep a nodal quantity of the ends on which loads, supports and drives are about to act."""
    for i in range(neighbours.size):
        q = boundary_dofs[neighbours[i].end]
        q.bulk_v = values[q.dof]


def move_neighbours(neighbours: Any, boundary_dofs: Any, values: Floats) -> None:
    """Change a nodal quantity beside the ends where it has changed since `keep_ends`."""
    for i in range(neighbours.size):
        neighbour = neighbours[i]
        q = boundary_dofs[neighbour.end]
        values[boundary_dofs[neighbour.place].dof] += neighbour.share * (values[q.dof] - q.bulk_v)


def coupled_kinetic(masses: Bulk, v: Floats, work_space: Floats, dim: int) -> float:
    """Return the kinetic energy ``v M v / 2`` by forward substitution with the Cholesky factor L of M^-1.

    It is half the square of ``L^-1 v``, which is left in `work_space`.
    """
    factor = masses.factor
    bands, nodes = factor.shape
    total = 0.0
    for i in range(nodes):
        for d in range(dim):
            value = v[i * dim + d]
            for k in range(1, min(bands, i + 1)):
                value -= factor[k, i - k] * work_space[(i - k) * dim + d]
            value /= factor[0, i]
            work_space[i * dim + d] = value
            total += value * value
    return 0.5 * total
