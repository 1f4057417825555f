"""The stiffness of bodies of cells about rest, from the kernels of their element and material."""

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
    matrices : (kinds, nodes * dim, nodes * dim) array
        Stiffness of a cell of each kind [force/length].
    kind : (elements,) array
        Kind of each cell.
    """

    matrices: Floats
    kind: Integers


def cell_stiffness(element: Element, material: Material, body: BodyMesh) -> CellStiffness:
    """Return the stiffness of the cells of a body about rest."""
    nodes, cells = body.mesh.nodes, cells_of(body.mesh)
    relative = nodes[cells] - nodes[cells[:, :1]]
    size = float(np.abs(relative).max())
    kinds, kind = np.unique(np.round(relative / size, SAME_SHAPE).reshape(len(cells), -1), axis=0, return_inverse=True)
    first = np.zeros(len(kinds), dtype=np.int64)
    first[kind.ravel()[::-1]] = np.arange(len(cells))[::-1]
    probe = ElementProbe(element, material, body)
    count = cells.shape[1] * nodes.shape[1]
    return CellStiffness(
        np.array([_stiffness(probe, int(cell), PROBING_STRAIN * size, count) for cell in first]), kind.ravel()
    )


def stiffness_of_cells(element: Element, material: Material, body: BodyMesh) -> Any:
    """Return the stiffness of a body as a sparse array, (nodes * dim, nodes * dim) [force/length]."""
    from scipy.sparse import csr_array

    cells, (count, dim) = cells_of(body.mesh), body.mesh.nodes.shape
    found = cell_stiffness(element, material, body)
    dofs = (cells[:, :, None] * dim + np.arange(dim)).reshape(len(cells), -1)
    values = found.matrices[found.kind]
    row, column = (np.broadcast_to(d, values.shape).ravel() for d in (dofs[:, :, None], dofs[:, None, :]))
    return csr_array((values.ravel(), (row, column)), shape=(count * dim, count * dim))


def frequencies_of_cells(element: Element, material: Material, body: BodyMesh) -> Floats:
    """Return the highest angular frequency of each cell by itself with its share of the lumped mass, (elements,).

    No frequency of the body is above the largest of them, by the theorem of Irons.
    """
    found, dim = cell_stiffness(element, material, body), body.mesh.nodes.shape[1]
    masses = element_masses(element, body, material.rho)[:, None] * lumping_of(element, body).shares
    root = np.repeat(np.sqrt(masses), dim, axis=1)
    scaled = found.matrices[found.kind] / root[:, :, None] / root[:, None, :]
    frequencies: Floats = np.sqrt(np.linalg.eigvalsh(scaled)[:, -1])
    return frequencies


def _stiffness(probe: ElementProbe, cell: int, size: float, count: int) -> Floats:
    """Return the stiffness of a cell by differences of its forces about rest, (count, count)."""
    columns = [probe.force(cell, -step) - probe.force(cell, step) for step in size * np.eye(count)]
    matrix = np.array(columns).T / (2.0 * size)
    return 0.5 * (matrix + matrix.T)
