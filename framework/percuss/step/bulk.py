"""The bulk update: the bodies of a block advance by a step without contact.

The arrays of displacement and velocity are flat, node by node with `dim` components each, with displacement at t_n and
velocity at t_n - dt/2. Rows of two-node elements are advanced in pieces of some nodes, which stay in the first-level
cache; bodies of cells of any kind gather, call the kernel of their element, scatter, and then advance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from percuss.jit import Kernel, called, each, reduction, shared
from percuss.mesh.cell_kernels import Block, add_up_forces, energy_of_cells, energy_of_points
from percuss.mesh.materials import MaterialPoints
from percuss.mesh.stiffness_rows import SET_FORCES, StiffnessRows, energy_of_rows
from percuss.methods.slots import energy, internal_force, unbound
from percuss.record_arrays import Records

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats

PIECE = 1024  # nodes in a piece of a row, whose displacement, velocity, mass and force stay in the first-level cache


class Bulk(NamedTuple):
    """The bodies of a block, and what their update reads and writes."""

    block: Block
    mass: Floats  # (nodes * dim,) nodal masses
    inverse_mass: Floats  # (nodes * dim,)
    force: Floats  # ((PIECE + 2) * dim,) work space, or for bodies of cells (nodes of the largest * dim,)
    accelerations: Floats  # (bodies * dim,) of each body by loads in the present step
    acceleration: Floats  # (dim,) work space
    momentum: Floats  # (bodies * dim,) of each body at n + 1/2, empty where no load acts on whole bodies
    totals: Records  # percuss.step.records.TOTAL
    dim: int
    dt: float
    lag: float  # time by which velocities lag behind displacements
    part: Any  # arrays and numbers of a part of the step that fills one of the slots below


# ---------------------------------------------------------------------------------------------------------- slots


def advance_body(data: Bulk, b: int, steps: int, u: Floats, v: Floats) -> None:
    """Advance body `b` of a block by some steps at a time (slot for `advance_row` or `advance_cells`)."""
    unbound()


def energy_of_body(data: Bulk, b: int, u: Floats, v: Floats, dt: float) -> float:
    """Return the strain energy of body `b` of a block (slot for `energy_of_row` or `energy_of_cell_body`)."""
    unbound()


def force_of_elements(data: Bulk, material: MaterialPoints, first: int, u: Floats, v: Floats, force: Floats) -> None:
    """Set the internal force of two-node elements from `first` on; a part of the step may fill this slot."""
    internal_force(data.block.element, material, first, data.dim, u, force)


def force_of_cells(data: Bulk, material: MaterialPoints, b: int, u: Floats, v: Floats, force: Floats) -> None:
    """Set the internal force of the cells of body `b`; a part of the step may fill this slot."""
    internal_force_of_cells(data.block.element, material, b, u, force)


def internal_force_of_cells(element: Any, material: MaterialPoints, b: int, u: Floats, force: Floats) -> None:
    """Set the internal force of the cells of body `b` (a slot, see `of_linear_solids`)."""
    add_up_forces(element, material, b, u, force)


def add_internal_work(data: Bulk, force: Floats, v: Floats, dt: float) -> None:
    """Add half of the internal work on some nodes, before and after their update; nothing, if no part fills this."""


def add_momentum(data: Bulk, body: int, first: int, stop: int, v: Floats) -> None:
    """Add the momentum of nodes to that of a body; nothing without loads on whole bodies (see `OF_LOADED_BODIES`)."""


def move_nodes(data: Bulk, force: Floats, first: int, u: Floats, v: Floats, dt: float) -> None:
    """Advance consecutive nodes of bodies without loads on whole bodies (a slot, see `OF_LOADED_BODIES`)."""
    stop = first + force.size
    update_line(data.inverse_mass[first:stop], force, u[first:stop], v[first:stop], data.acceleration[0], dt)


# -------------------------------------------------------------------------------------------- actions of the blocks


def advance_block(data: Bulk, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Advance the bodies of a block by a step without contact, in place.

    The momentum of each body after the update is added to `Bulk.momentum`, where that is not empty.
    """
    for b in range(data.block.body.size):
        advance_body(data, b, 1, u, v)


@called
def add_strain_energy(data: Bulk, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the staggered strain energy of the bodies of a block, ``u_n K u_{n+1} / 2`` of a linear body.

    The two displacements are those one step of the body apart, along its velocities.
    """
    total = 0.0
    for b in range(data.block.body.size):
        total += energy_of_body(data, b, u, v, data.lag)
    data.totals[0].elastic_energy += total


@called
def add_dissipated_energy(data: Bulk, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add what materials with state variables dissipate to the middle of a step, `percuss.mesh.materials.rise`."""
    for b in range(data.block.body.size):
        data.totals[0].dissipated_energy += energy_of_body(data, b, u, v, data.lag)


@called
def add_hourglass_energy(data: Bulk, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the part of the strain energy that holds the hourglass modes of the cells of a block."""
    block, dim, total = data.block, data.dim, 0.0
    first = block.element.volumes.shape[1] - block.element.hourglass_points
    for b in range(block.body.size):
        lo, hi = block.start[b] * dim, block.stop[b] * dim
        material = MaterialPoints(block.parameters[b], block.before, block.after)
        total += energy_of_points(block.element, material, b, first, u[lo:hi], v[lo:hi], data.lag)
    data.totals[0].hourglass_energy += total


@called
def set_forces(data: Bulk, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set `a` to the internal force on the nodes of a block of rows of two-node elements."""
    block = data.block
    for b in range(block.body.size):
        lo = block.start[b] * data.dim
        hi = block.stop[b] * data.dim
        material = MaterialPoints(block.parameters[b], block.before, block.after)
        internal_force(block.element, material, block.first[b], data.dim, u[lo:hi], a[lo:hi])


@called
def set_forces_of_cells(data: Bulk, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set `a` to the internal force on the nodes of a block of cells."""
    block = data.block
    for b in range(block.body.size):
        lo, hi = block.start[b] * data.dim, block.stop[b] * data.dim
        material = MaterialPoints(block.parameters[b], block.before, block.after)
        internal_force_of_cells(block.element, material, b, u[lo:hi], a[lo:hi])


# ------------------------------------------------------------------------------------------- rows of two-node elements


def advance_row(data: Bulk, b: int, steps: int, u: Floats, v: Floats) -> None:
    """Advance a body that is a row of two-node elements, piece by piece.

    The element between two pieces belongs to the first of them; its force on the first node of the next piece is
    carried over.
    """
    block, force, dim = data.block, data.force, data.dim
    # The force kernel overwrites the forces of all nodes of a piece; the carried force is stored after them.
    storage = (PIECE + 1) * dim
    lo = block.start[b]
    stop = block.stop[b]
    material = MaterialPoints(block.parameters[b], block.before, block.after)
    offset = block.first[b] - lo
    body = block.body[b] * dim
    for d in range(dim):
        data.acceleration[d] = data.accelerations[body + d] / steps
        force[d] = 0.0
    while lo < stop:
        hi = min(lo + PIECE, stop)
        count = hi - lo - 1 if hi == stop else hi - lo
        if count > 0:
            for d in range(dim):
                force[storage + d] = force[d]
            first, after = lo * dim, (lo + count + 1) * dim
            force_of_elements(data, material, offset + lo, u[first:after], v[first:after], force[: after - first])
            for d in range(dim):
                force[d] += force[storage + d]
        advance_nodes(data, force[: (hi - lo) * dim], lo * dim, u, v, steps * data.dt)
        if count > 0:
            for d in range(dim):
                force[d] = force[count * dim + d]
        add_momentum(data, body, lo * dim, hi * dim, v)
        lo = hi


def energy_of_row(data: Bulk, b: int, u: Floats, v: Floats, dt: float) -> float:
    """Return the strain energy of a body that is a row of two-node elements."""
    block = data.block
    lo = block.start[b] * data.dim
    hi = block.stop[b] * data.dim
    material = MaterialPoints(block.parameters[b], block.before, block.after)
    return energy(block.element, material, block.first[b], data.dim, u[lo:hi], v[lo:hi], dt)


# ------------------------------------------------------------------------------------------------- bodies of cells


def advance_cells(data: Bulk, b: int, steps: int, u: Floats, v: Floats) -> None:
    """Advance a body of cells."""
    block, dim = data.block, data.dim
    lo, hi = block.start[b] * dim, block.stop[b] * dim
    body = block.body[b] * dim
    for d in range(dim):
        data.acceleration[d] = data.accelerations[body + d] / steps
    force = data.force[: hi - lo]
    material = MaterialPoints(block.parameters[b], block.before, block.after)
    force_of_cells(data, material, b, u[lo:hi], v[lo:hi], force)
    advance_nodes(data, force, lo, u, v, steps * data.dt)
    add_momentum(data, body, lo, hi, v)


def energy_of_cell_body(data: Bulk, b: int, u: Floats, v: Floats, dt: float) -> float:
    """Return the strain energy of a body of cells."""
    block = data.block
    lo, hi = block.start[b] * data.dim, block.stop[b] * data.dim
    material = MaterialPoints(block.parameters[b], block.before, block.after)
    return energy_of_cells(block.element, material, b, u[lo:hi], v[lo:hi], dt)


# --------------------------------------------------------------------------------------------------- linear solids


def set_forces_of_rows(rows: StiffnessRows, u: Floats, force: Floats) -> None:
    """Set `force` to the internal force on the nodes of a body (slot for one of `SET_FORCES`)."""
    unbound()


def internal_force_of_rows(rows: StiffnessRows, material: MaterialPoints, b: int, u: Floats, force: Floats) -> None:
    """Set the internal force of a linear solid, which is alone in its block."""
    set_forces_of_rows(rows, u, force)


def energy_of_linear_solid(data: Bulk, b: int, u: Floats, v: Floats, dt: float) -> float:
    """Return the strain energy of a linear solid, which is alone in its block."""
    lo, hi = data.block.start[b] * data.dim, data.block.stop[b] * data.dim
    set_forces_of_rows(data.block.element, u[lo:hi], data.force)
    return energy_of_rows(data.block.element, data.force, u[lo:hi], v[lo:hi], dt)


def of_linear_solids(dim: int, *, threads: bool) -> dict[Kernel, Kernel]:
    """Return the slots of a linear solid, whose `Block.element` has the rows of its stiffness, and what fills them."""
    filled: dict[Kernel, Kernel] = {
        internal_force_of_cells: internal_force_of_rows,
        energy_of_body: energy_of_linear_solid,
        set_forces_of_rows: SET_FORCES[dim],
    }
    return filled | (OF_THREADS[dim] if threads else {})


# ---------------------------------------------------------------------------------------------------------- nodes


def advance_nodes(data: Bulk, force: Floats, first: int, u: Floats, v: Floats, dt: float) -> None:
    """Advance consecutive nodes by forces on them, v += dt (M^-1 f + b) and u += dt v."""
    stop = first + force.size
    add_internal_work(data, force, v[first:stop], dt)
    move_nodes(data, force, first, u, v, dt)
    add_internal_work(data, force, v[first:stop], dt)


def move_loaded_nodes(data: Bulk, force: Floats, first: int, u: Floats, v: Floats, dt: float) -> None:
    """Advance consecutive nodes of bodies with an acceleration by loads (for `move_nodes`)."""
    stop, dim = first + force.size, data.dim
    alike = True
    for d in range(1, dim):
        alike = alike and data.acceleration[d] == data.acceleration[0]
    if alike:
        update_line(data.inverse_mass[first:stop], force, u[first:stop], v[first:stop], data.acceleration[0], dt)
    else:
        update_nodes(data.inverse_mass[first:stop], force, u[first:stop], v[first:stop], data.acceleration, dt)


def update_line(inverse_mass: Floats, force: Floats, u: Floats, v: Floats, acceleration: float, dt: float) -> None:
    """Advance degrees of freedom with the same acceleration, of which the compiler handles several at a time."""
    for i in each(u.size):
        v[i] += dt * (inverse_mass[i] * force[i] + acceleration)
        u[i] += dt * v[i]


def update_nodes(inverse_mass: Floats, force: Floats, u: Floats, v: Floats, acceleration: Floats, dt: float) -> None:
    """Advance nodes whose degrees of freedom have accelerations of their own."""
    dim = acceleration.size
    for i in each(u.size // dim):
        for d in range(dim):
            j = i * dim + d
            v[j] += dt * (inverse_mass[j] * force[j] + acceleration[d])
            u[j] += dt * v[j]


@reduction
def power(force: Floats, v: Floats) -> float:
    """Return the power of forces on consecutive nodes."""
    total = 0.0
    for i in range(force.size):
        total += force[i] * v[i]
    return total


@reduction
def momentum_along(mass: Floats, v: Floats, component: int, dim: int) -> float:
    """Return the momentum of consecutive nodes along one component."""
    total = 0.0
    for i in range(component, v.size, dim):
        total += mass[i] * v[i]
    return total


def add_momentum_of_nodes(data: Bulk, body: int, first: int, stop: int, v: Floats) -> None:
    """Add the momentum of consecutive nodes to that of a body (for `add_momentum`)."""
    if data.dim == 1:  # where the compiler handles several nodes at a time
        data.momentum[body] += momentum_along(data.mass[first:stop], v[first:stop], 0, 1)
    else:
        for d in range(data.dim):
            data.momentum[body + d] += momentum_along(data.mass[first:stop], v[first:stop], d, data.dim)


# The slots of bodies on which loads act as a whole, and what fills them.
OF_LOADED_BODIES: dict[Kernel, Kernel] = {move_nodes: move_loaded_nodes, add_momentum: add_momentum_of_nodes}


# What large bodies are advanced by where there are several threads.
OF_THREADS: dict[int, dict[Kernel, Kernel]] = {
    dim: {set_forces_of_rows: shared(forces), update_line: shared(update_line), update_nodes: shared(update_nodes)}
    for dim, forces in SET_FORCES.items()
}


class Masses(NamedTuple):
    """Nodal masses, and where the kinetic energy goes."""

    mass: Floats  # (nodes * dim,)
    totals: Records  # percuss.step.records.TOTAL


def add_kinetic_energy(data: Masses, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the kinetic energy ``v M v / 2`` of nodal masses."""
    data.totals[0].kinetic_energy += kinetic(data.mass, v[: data.mass.size])


@reduction
def kinetic(mass: Floats, v: Floats) -> float:
    """Return the kinetic energy ``v M v / 2``."""
    total = 0.0
    for i in range(v.size):
        total += mass[i] * v[i] * v[i]
    return 0.5 * total
