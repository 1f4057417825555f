"""The stiffness of cells and of bodies of cells about rest, from the kernels of their element and material."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.mesh.cells import PROBING_STRAIN, SAME_SHAPE, cells_of, element_masses, lumping_of
from percuss.mesh.element_probe import ElementProbe

if TYPE_CHECKING:
    from percuss.methods.interfaces import BodyMesh, Element, Floats, Integers, Material


class CellStiffness(NamedTuple):
    """The stiffness of the cells of a body about rest; cells of the same shape and size are asked once.

    Attributes
    ----------
    matrices : (kinds, nodes * m, nodes * m) array
        Stiffness of a cell of each kind in m directions: those of space, of a bar its own [force/length].
    kind : (elements,) array
        Kind of each cell.
    first : (kinds,) array
        The first cell of each kind.
    """

    matrices: Floats
    kind: Integers
    first: Integers


def kinds_of_cells(body: BodyMesh) -> tuple[Integers, Integers]:
    """Return the first cell of each kind, (kinds,), and the kind of each cell, (cells,), by shape and size."""
    nodes, cells = body.mesh.nodes, cells_of(body.mesh)
    relative = nodes[cells] - nodes[cells[:, :1]]
    size = np.abs(relative).max()
    if body.plane == "axisymmetric":  # where the distance from the axis tells cells apart, too
        relative[..., 0] = nodes[cells, 0]
    rounded = np.round(relative / size, SAME_SHAPE).reshape(len(cells), -1) + 0.0  # which makes 0 of -0
    as_bytes = rounded.view(f"V{rounded[0].nbytes}").ravel()  # which are sorted much faster than rows of numbers
    _, first, kind = np.unique(as_bytes, return_index=True, return_inverse=True)
    return first, kind


def cell_stiffness(element: Element, material: Material, body: BodyMesh) -> CellStiffness:
    """Return the stiffness of the cells of a body about rest, of a bar along it with a linear material.

    Raises
    ------
    PluginError
        If a force is not finite.
    """
    modulus = None if body.mesh.line is None else material.modulus
    size = PROBING_STRAIN * float(np.ptp(body.mesh.nodes[cells_of(body.mesh)], axis=1).max())
    first, kind = kinds_of_cells(body)
    matrices = ElementProbe(element, material, body, modulus).stiffness(first, size)
    return CellStiffness(matrices, kind, first)


def stiffness_of_cells(element: Element, material: Material, body: BodyMesh) -> Any:
    """Return the stiffness of a body as a sparse array [force/length], of a bar along it.

    It is an (n, n) array with n = nodes * dim, of a bar n = nodes.
    """
    from scipy.sparse import csr_array

    size = body.mesh.nodes.size if body.mesh.line is None else len(body.mesh.nodes)
    values, row, column = entries_of_cells(element, material, body)
    return csr_array((values, (row, column)), shape=(size, size))


def entries_of_cells(element: Element, material: Material, body: BodyMesh) -> tuple[Floats, Integers, Integers]:
    """Return the entries of the stiffness of a body, those at one place to be added up, with their rows and columns."""
    cells, found = cells_of(body.mesh), cell_stiffness(element, material, body)
    ways = found.matrices.shape[1] // cells.shape[1]  # of the motion of a node
    dofs = (cells[:, :, None] * ways + np.arange(ways)).reshape(len(cells), -1)
    return entries_of(found.matrices[found.kind], dofs)


def entries_of(matrices: Floats, dofs: Integers) -> tuple[Floats, Integers, Integers]:
    """Return the entries of matrices of cells, each at its degrees of freedom."""
    dofs = dofs.astype(np.int32)  # SciPy would copy wider numbers, which takes longer than all else
    row, column = (np.broadcast_to(d, matrices.shape).ravel() for d in (dofs[:, :, None], dofs[:, None, :]))
    return matrices.ravel(), row, column


def frequencies_of_cells(element: Element, material: Material, body: BodyMesh) -> Floats:
    """Return the highest angular frequency of each cell by itself with its share of the lumped mass, (elements,).

    No frequency of the body is above the largest of them, by the theorem of Irons. All are nan where a node of a cell
    has no mass, as in a cell that is turned inside out.
    """
    masses = element_masses(element, body, material.rho)[:, None] * lumping_of(element, body).shares
    if not (masses > 0.0).all():
        return np.full(len(masses), np.nan)
    found = cell_stiffness(element, material, body)
    ways = found.matrices.shape[1] // masses.shape[1]  # of the motion of a node: one along a line
    root = np.repeat(np.sqrt(masses[found.first]), ways, axis=1)
    scaled = found.matrices / root[:, :, None] / root[:, None, :]
    frequencies: Floats = np.sqrt(np.linalg.eigvalsh(scaled)[:, -1])[found.kind]
    return frequencies
