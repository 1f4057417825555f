"""Bodies of cells with any number of nodes: gather, the kernel of the element for one cell, scatter.

Rows of two-node bars have loops of their own (`percuss.step.bulk`), without an array of connectivity.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.jit import called
from percuss.mesh.materials import MaterialPoints
from percuss.methods.slots import cell_force, energy_density, unbound

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integers


class Block(NamedTuple):
    """The bodies that share one element class and one material class, as a step reads them."""

    element: Any  # `Cells`, or of two-node elements a NamedTuple of (elements, ...) arrays
    parameters: Floats  # (bodies, k) material parameters
    body: Integers  # (bodies,) number of the body in the case
    start: Integers  # (bodies,) first node
    stop: Integers  # (bodies,) the number after the last node
    first: Integers  # (bodies,) index of the first element in the arrays of `element`
    before: Floats  # (points, state variables) as the last step has left them
    after: Floats  # (points, state variables) as the present step leaves them


class Cells(NamedTuple):
    """The cells of a block of bodies, body by body, and work space for one cell."""

    rule: Any  # NamedTuple of arrays that the kernel of the element reads, or works in
    cells: Integers  # (elements, nodes of a cell) numbers within the body, without sign: none counts from the end
    geometry: Floats  # (elements, ...) what the kernel reads of each
    section: Floats  # (elements,)
    volumes: Floats  # (elements, points) volume of each quadrature point
    edges: Integers  # (bodies + 1,) first element of each body, and the number of all elements
    corners: tuple[int, ...]  # 0, 1, 2, ... for each node of a cell; the compiler knows how many there are
    axes: tuple[int, ...]  # 0, 1, ... for each dimension
    hourglass_points: int  # the last points of each, which only hold hourglass modes
    strains: Floats  # (2, points) work space, of displacement gradients (2, points, dim * dim)


def cell_strain(*arguments: object) -> None:
    """Set the strains of one cell; a slot for the kernel of its element with `record_strain` in its slot `stress`."""
    unbound()


def record_strain(material: Floats, point: int, strain: float) -> float:
    """Keep the strain at a point in the array `material`."""
    material[point] = strain
    return 0.0


def record_gradient(material: Floats, point: int, gradient: tuple[float, ...]) -> tuple[float, ...]:
    """Keep the displacement gradient at a point in the array `material`."""
    for k in range(len(gradient)):
        material[point, k] = gradient[k]
    return gradient


def room(rows: tuple[int, ...], columns: tuple[int, ...]) -> Floats:
    """Return an array for a number for each pair of an entry of two tuples.

    Compiled code takes room of a size that the compiler knows, in registers where it can (`percuss.step.linked.room`).
    """
    return np.full((len(rows), len(columns)), np.nan)


def gather(cells: Cells, e: int, displacement: Floats, velocity: Floats, dt: float, of_cell: Floats) -> None:
    """Set `of_cell` to ``u - dt v`` of the nodes of a cell."""
    dim = len(cells.axes)
    for a in range(len(cells.corners)):
        first = cells.cells[e, a] * dim
        for d in range(dim):
            of_cell[a, d] = displacement[first + d] - dt * velocity[first + d]


@called
def add_up_forces(cells: Cells, material: MaterialPoints, body: int, displacement: Floats, force: Floats) -> None:
    """Set `force` to the internal force on the nodes of a body."""
    points, nodes, dim = cells.volumes.shape[1], len(cells.corners), len(cells.axes)
    of_cell, force_of_cell = room(cells.corners, cells.axes), room(cells.corners, cells.axes)
    for i in range(force.size):
        force[i] = 0.0
    for e in range(cells.edges[body], cells.edges[body + 1]):
        for a in range(nodes):
            first = cells.cells[e, a] * dim
            for d in range(dim):
                of_cell[a, d] = displacement[first + d]
        cell_force(cells.rule, material, e * points, cells.section[e], cells.geometry[e], of_cell, force_of_cell)
        for a in range(nodes):
            first = cells.cells[e, a] * dim
            for d in range(dim):
                force[first + d] += force_of_cell[a, d]


@called
def energy_of_cells(cells: Cells, material: MaterialPoints, body: int, u: Floats, v: Floats, dt: float) -> float:
    """Return the staggered strain energy of a body: of its displacements u, and of those a time `dt` before."""
    return energy_of_points(cells, material, body, 0, u, v, dt)


def energy_of_points(
    cells: Cells, material: MaterialPoints, body: int, start: int, u: Floats, v: Floats, dt: float
) -> float:
    """Return the staggered strain energy of a body in the points of its cells from `start` on."""
    total = 0.0
    points = cells.volumes.shape[1]
    of_cell, unused = room(cells.corners, cells.axes), room(cells.corners, cells.axes)
    for e in range(cells.edges[body], cells.edges[body + 1]):
        for k in range(2):
            gather(cells, e, u, v, dt if k == 0 else 0.0, of_cell)
            cell_strain(cells.rule, cells.strains[k], 0, cells.section[e], cells.geometry[e], of_cell, unused)
        for q in range(start, points):
            density = energy_density(material, e * points + q, cells.strains[0, q], cells.strains[1, q])
            total += cells.volumes[e, q] * density
    return total
