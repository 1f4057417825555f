"""The bulk update: all bodies advance by a step without contact, in blocks of nodes.

Every function of the loop runs compiled and as plain Python, from the same source. The arrays of displacement and
velocity are flat, node by node with `dim` components each, with displacement at t_n and velocity at t_n - dt/2. Arrays
called `boundary_dofs` hold the same for the few nodes with contacts, supports, drives, end loads or probes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from percuss.compiler.marks import called
from percuss.mesh.cell_kernels import add_up_forces
from percuss.mesh.materials import MaterialPoints
from percuss.methods.slots import energy, internal_force, unbound

if TYPE_CHECKING:
    from percuss.mesh.block import Group
    from percuss.methods.interfaces import Floats, Integers

BLOCK = 1024  # nodes in a block, whose displacement, velocity, mass and force stay in the first-level cache


class Bulk(NamedTuple):
    """Nodal masses, and work space for the forces of the bulk update."""

    mass: Floats  # (nodes * dim,)
    inverse_mass: Floats  # (nodes * dim,)
    force: Floats  # ((BLOCK + 2) * dim,) work space
    viscous_time: float  # time by which internal forces look ahead along the velocity of half a step before
    ahead: Floats  # ((BLOCK + 2) * dim,) work space for that, or (0,) without viscosity
    # Of masses that couple nodes, else empty, as `percuss.mesh.coupled_masses.arrays_for_the_loop` has them.
    stride: int  # number of degrees of freedom of a node
    coupling: Floats  # (2 k + 1, nodes * dim) M^-1 diag(m) - I
    factor: Floats  # (k + 1, nodes * dim) 1/D and L of M^-1 = L D L^T
    correction: Floats  # (nodes * dim,) work space
    before: Floats  # (nodes * dim,) displacements before the step, or (0,)
    change: Floats  # (nodes * dim,) change of the velocities that `mass` alone would give, or (0,)
    number: Integers  # (1,) number of the present step
    body_acceleration: Floats  # (dim,) work space
    momentum: Floats  # (bodies * dim,) of each body at n + 1/2, empty where no load acts on whole bodies


def is_due(own_step: int, number: int) -> bool:
    """Return whether the internal forces of a body act in a step."""
    return own_step == 1 or number % own_step == 0


def advance_bodies(group: Group, bulk: Bulk, u: Floats, v: Floats, body_acceleration: Floats, dt: float) -> None:
    """Advance the bodies of one group by a step without contact, in place, block by block.

    The element between two blocks belongs to the first of them; its force on the first node of the next block is
    carried over. `body_acceleration` is that of each body by loads on the whole body, (bodies * dim,). The
    momentum of each body after the update is added to `Bulk.momentum`, where that is not empty.

    A body whose internal forces act in every m-th step alone is advanced by m steps then, and left as it is in the
    steps between, in which none of its nodes changes its velocity but for those of the boundary. These are written
    back after every step.
    """
    force, dim = bulk.force, bulk.stride
    # The force kernel overwrites the forces of all nodes of a block; the carried force is stored after them.
    storage = (BLOCK + 1) * dim
    for b in range(group.body.size):
        lo = group.start[b]
        stop = group.stop[b]
        material = MaterialPoints(group.parameters[b], group.before, group.after)
        offset = group.first[b] - lo
        body = group.body[b] * dim
        if not is_due(group.own_step[b], bulk.number[0]):
            add_momentum_of_row(bulk, body, lo * dim, stop * dim, v, dim)
            continue
        for d in range(dim):
            bulk.body_acceleration[d] = body_acceleration[body + d] / group.own_step[b]
            force[d] = 0.0
        while lo < stop:
            hi = min(lo + BLOCK, stop)
            count = hi - lo - 1 if hi == stop else hi - lo
            if count > 0:
                for d in range(dim):
                    force[storage + d] = force[d]
                first, after = lo * dim, (lo + count + 1) * dim
                set_force(group, material, bulk, offset + lo, dim, u[first:after], v[first:after])
                for d in range(dim):
                    force[d] += force[storage + d]
            advance_nodes(group, bulk, force[: (hi - lo) * dim], lo * dim, u, v, dim, group.own_step[b] * dt)
            if count > 0:
                for d in range(dim):
                    force[d] = force[count * dim + d]
            add_momentum_of_row(bulk, body, lo * dim, hi * dim, v, dim)
            lo = hi


def advance_nodes(
    group: Group, bulk: Bulk, force: Floats, first: int, u: Floats, v: Floats, dim: int, dt: float
) -> None:
    """Advance consecutive nodes by forces on them, v += dt (M^-1 f + b) and u += dt v, and add the internal work."""
    stop = first + force.size
    add_internal_work(group.work, force, v[first:stop], dt)
    if dim == 1:
        update_line(bulk.inverse_mass[first:stop], force, u[first:stop], v[first:stop], bulk.body_acceleration[0], dt)
    else:
        for i in range(force.size // dim):
            for d in range(dim):
                j = first + i * dim + d
                v[j] += dt * (bulk.inverse_mass[j] * force[i * dim + d] + bulk.body_acceleration[d])
                u[j] += dt * v[j]
    add_internal_work(group.work, force, v[first:stop], dt)


def update_line(inverse_mass: Floats, force: Floats, u: Floats, v: Floats, body_acceleration: float, dt: float) -> None:
    """Advance consecutive nodes in one dimension, where the compiler handles several nodes at a time."""
    for i in range(u.size):
        v[i] += dt * (inverse_mass[i] * force[i] + body_acceleration)
        u[i] += dt * v[i]


def set_force(group: Group, material: Any, bulk: Bulk, first: int, dim: int, u: Floats, v: Floats) -> None:
    """Set the first entries of `bulk.force` to the internal force of elements from `first` on, of a few nodes.

    With viscosity it is the force of the displacement that lies ahead by its time, along the velocity.
    """
    strained = u
    if bulk.ahead.size > 0:
        strained = bulk.ahead[: u.size]
        for i in range(u.size):
            strained[i] = u[i] + bulk.viscous_time * v[i]
    internal_force(group.element, material, first, dim, strained, bulk.force[: u.size])


def add_internal_work(work: Floats, force: Floats, v: Floats, dt: float) -> None:
    """Add half of a step's internal work, by forces on consecutive nodes; it is called before and after the update."""
    if work.size > 0:
        work[0] -= 0.5 * dt * power(force, v)


def power(force: Floats, v: Floats) -> float:
    """Return the power of forces on consecutive nodes."""
    total = 0.0
    for i in range(force.size):
        total += force[i] * v[i]
    return total


power.reduction = True  # type: ignore[attr-defined]


def momentum_along(mass: Floats, v: Floats, component: int, dim: int) -> float:
    """Return the momentum of consecutive nodes along one component."""
    total = 0.0
    for i in range(component, v.size, dim):
        total += mass[i] * v[i]
    return total


momentum_along.reduction = True  # type: ignore[attr-defined]


def add_momentum(momentum: Floats, first: int, mass: Floats, v: Floats, dim: int) -> None:
    """Add the momentum of consecutive nodes to the entries from `first` on; do nothing where no momenta are kept."""
    if momentum.size > 0:
        for d in range(dim):
            momentum[first + d] += momentum_along(mass, v, d, dim)


def add_momentum_of_row(bulk: Bulk, body: int, first: int, stop: int, v: Floats, dim: int) -> None:
    """Add the momentum of consecutive nodes to that of a body, in one dimension several nodes at a time."""
    if dim > 1:
        add_momentum(bulk.momentum, body, bulk.mass[first:stop], v[first:stop], dim)
    elif bulk.momentum.size > 0:
        bulk.momentum[body] += momentum_along(bulk.mass[first:stop], v[first:stop], 0, 1)


def kinetic(mass: Floats, v: Floats) -> float:
    """Return the kinetic energy ``v M v / 2``."""
    total = 0.0
    for i in range(v.size):
        total += mass[i] * v[i] * v[i]
    return 0.5 * total


kinetic.reduction = True  # type: ignore[attr-defined]


def advance_cells(group: Group, bulk: Bulk, u: Floats, v: Floats, body_acceleration: Floats, dt: float) -> None:
    """Advance the bodies of one group by a step without contact, in place, as `advance_bodies` does."""
    dim, momentum = bulk.stride, bulk.momentum
    for b in range(group.body.size):
        lo, hi = group.start[b] * dim, group.stop[b] * dim
        body = group.body[b] * dim
        if not is_due(group.own_step[b], bulk.number[0]):
            add_momentum(momentum, body, bulk.mass[lo:hi], v[lo:hi], dim)
            continue
        for d in range(dim):
            bulk.body_acceleration[d] = body_acceleration[body + d] / group.own_step[b]
        force = group.element.body_force[: hi - lo]
        material = MaterialPoints(group.parameters[b], group.before, group.after)
        velocity = v[lo:hi] if bulk.ahead.size > 0 else v[:0]
        add_up_forces(group.element, material, b, dim, u[lo:hi], velocity, bulk.viscous_time, force)
        advance_nodes(group, bulk, force, lo, u, v, dim, group.own_step[b] * dt)
        add_momentum(momentum, body, bulk.mass[lo:hi], v[lo:hi], dim)


@called
def elastic_group(group: Group, u: Floats, v: Floats, dim: int, dt: float) -> float:
    """Return the staggered strain energy of the bodies of one group, ``u_n K u_{n+1} / 2`` of a linear body.

    The two displacements are those one step of the body apart, along its velocities.
    """
    total = 0.0
    for b in range(group.body.size):
        lo = group.start[b] * dim
        hi = group.stop[b] * dim
        material = MaterialPoints(group.parameters[b], group.before, group.after)
        total += energy(group.element, material, group.first[b], dim, u[lo:hi], v[lo:hi], group.own_step[b] * dt)
    return total


# Groups of another element or material have compiled code of their own: pairs of a group and the groups behind it.


def first_group(group: Any, *arguments: Any) -> Any:
    """Treat the first group of bodies (slot)."""
    unbound()


def other_groups(groups: Any, *arguments: Any) -> Any:
    """Treat the other groups (slot)."""
    unbound()


def each_group(groups: Any, *arguments: Any) -> None:
    """Treat a pair (group, other groups)."""
    first_group(groups[0], *arguments)
    other_groups(groups[1], *arguments)


def sum_over_groups(groups: Any, *arguments: Any) -> float:
    """Return the sum of a quantity over a pair (group, other groups)."""
    return first_group(groups[0], *arguments) + other_groups(groups[1], *arguments)  # type: ignore[no-any-return]
