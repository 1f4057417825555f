"""Masses that couple neighbouring nodes, in the time loop.

The bulk update advances all bodies with their nodal masses m, which changes the velocities by ``dt diag(m)^-1 f``. With
``M^-1 diag(m)``, whose rows have the sum 1, this becomes ``dt M^-1 f``; body forces, which accelerate all nodes alike,
are left as they are. What acts on an end moves the nodes beside it too: `carry_to_neighbours`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.errors import refuse_if_any

if TYPE_CHECKING:
    from percuss.contact.model_arrays import ModelArrays
    from percuss.methods.interfaces import Floats
    from percuss.step.bulk import Bulk

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


def couple_nodes(masses: Bulk, u: Floats, v: Floats, internal_work: Floats, dt: float) -> None:
    """Turn the bulk update with nodal masses into that with M, in place; `masses.change` is its change of velocity."""
    change = masses.change
    for i in range(change.size):
        change[i] = v[i] - change[i]
    set_correction(masses)
    # Displacements are made anew: a correction of them would round twice, to one side.
    correct(masses.correction, masses.before, u, v, dt)
    if internal_work.size > 0:  # body forces do no work on corrections, which leave the momentum as it is
        for i in range(change.size):
            internal_work[0] -= 0.5 * masses.mass[i] * change[i] * masses.correction[i]


def set_correction(masses: Bulk) -> None:
    """Set `masses.correction` to ``(M^-1 diag(m) - I)`` times `masses.change`, one diagonal after the other."""
    change, coupling, correction = masses.change, masses.coupling, masses.correction
    size = change.size
    reach = coupling.shape[0] // 2
    stride = masses.stride
    for i in range(size):
        correction[i] = coupling[reach, i] * change[i]
    for k in range(1, reach + 1):
        shift = min(k * stride, size)
        add_products(coupling[reach + k, : size - shift], change[shift:], correction[: size - shift])
        add_products(coupling[reach - k, shift:], change[: size - shift], correction[shift:])


def add_products(coefficients: Floats, values: Floats, sums: Floats) -> None:
    """Add the products of coefficients and values to sums."""
    for i in range(sums.size):
        sums[i] += coefficients[i] * values[i]


def correct(correction: Floats, before: Floats, u: Floats, v: Floats, dt: float) -> None:
    """Add a correction to the velocities, and make the displacements from them."""
    for i in range(v.size):
        v[i] += correction[i]
        u[i] = before[i] + dt * v[i]


def carry_to_neighbours(neighbours: Any, boundary_dofs: Any) -> None:
    """Change the velocities beside ends on which loads, supports and drives act: that of the end has been changed."""
    for i in range(neighbours.size):
        neighbour = neighbours[i]
        q = boundary_dofs[neighbour.end]
        boundary_dofs[neighbour.place].new_v += neighbour.share * (q.new_v - q.bulk_v)


def couple_accelerations(masses: Bulk, a: Floats) -> None:
    """Turn the accelerations of nodal masses, ``diag(m)^-1 f``, into ``M^-1 f``, in place, if masses couple nodes."""
    change = masses.change
    if change.size == 0:
        return
    for i in range(change.size):
        change[i] = a[i]
    set_correction(masses)
    for i in range(change.size):
        a[i] += masses.correction[i]


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


def coupled_kinetic(masses: Bulk, v: Floats, work_space: Floats) -> float:
    """Return the kinetic energy ``v M v / 2`` by forward substitution, with ``M^-1 = L D L^T``.

    It is ``y D^-1 y / 2`` of ``y = L^-1 v``, which is left in `work_space`.
    """
    factor, stride = masses.factor, masses.stride
    bands = factor.shape[0]
    total = 0.0
    for i in range(v.size):
        value = v[i]
        for k in range(1, bands):
            j = i - k * stride
            if j >= 0:
                value -= factor[k, j] * work_space[j]
        work_space[i] = value
        total += factor[0, i] * value * value
    return 0.5 * total


def refuse_coupled_ends(model: ModelArrays) -> None:
    """Refuse supports, drives and loads on an end whose motion the mass couples to the other end of its body.

    Raises
    ------
    InputError
        With one problem for each such body.
    """
    problems = []
    for body in model.bodies.values():
        reach, count = body.inverse.shape[0] - 1, body.stiffness.size
        if count <= reach and not {body.start, body.stop - 1}.isdisjoint(model.acted_nodes):
            name = model.case.method.mass.name
            message = f"expected more than {reach} elements in body '{body.name}', found {count}"
            advice = (
                f"The mass {name} couples both of its ends, and a support, a drive or a load acts on one: take more."
            )
            problems.append(model.case.problem(("bodies", body.name), message, advice))
    refuse_if_any(problems)
