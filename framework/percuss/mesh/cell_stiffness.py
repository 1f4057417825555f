"""The stiffness of cells and of bodies of cells about rest, from the kernels of their element and material."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.mesh.cells import PROBING_STRAIN, cells_of, element_masses, lumping_of
from percuss.mesh.element_probe import ElementProbe
from percuss.mesh.stiffness_rows import StiffnessRows, stiffness_rows

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


def cell_stiffness(element: Element, material: Material, body: BodyMesh) -> CellStiffness:
    """Return the stiffness of the cells of a body about rest, of a bar along it with a linear material.

    Raises
    ------
    PluginError
        If a force is not finite.
    """
    modulus = None if body.mesh.line is None else material.modulus
    first, kind = body.kinds
    probed, numbers = (body, first) if body.mesh.line is not None else (body.of_each_kind, np.arange(len(first)))
    size = PROBING_STRAIN * float(np.ptp(body.mesh.nodes[cells_of(probed.mesh)], axis=1).max())
    probe = ElementProbe(element, material, probed, modulus)
    return CellStiffness(probe.stiffness(numbers, size, first), kind, first)


def rows_of_solid(element: Element, material: Material, body: BodyMesh) -> StiffnessRows:
    """Return the stiffness of a body that is no bar, about rest, as rows of differences."""
    found, cells = cell_stiffness(element, material, body), cells_of(body.mesh)
    about_axis = body.plane == "axisymmetric"
    return stiffness_rows(cells, found.kind, found.matrices, len(body.mesh.nodes), about_axis=about_axis)


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
