"""The stiffness of bodies of cells about rest, from the kernels of their element and material."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.mesh.cells import PROBING_STRAIN, SAME_SHAPE, cells_of
from percuss.mesh.element_probe import ElementProbe

if TYPE_CHECKING:
    from percuss.methods.interfaces import BodyMesh, Element, Floats, Material


def stiffness_of_cells(element: Element, material: Material, body: BodyMesh) -> Any:
    """Return the stiffness of a body as a sparse array, (nodes * dim, nodes * dim) [force/length].

    Cells of the same shape and size are asked once.
    """
    from scipy.sparse import csr_array

    nodes, cells = body.mesh.nodes, cells_of(body.mesh)
    dim, width = nodes.shape[1], cells.shape[1]
    relative = nodes[cells] - nodes[cells[:, :1]]
    size = float(np.abs(relative).max())
    kinds, kind = np.unique(np.round(relative / size, SAME_SHAPE).reshape(len(cells), -1), axis=0, return_inverse=True)
    first = np.zeros(len(kinds), dtype=np.int64)
    first[kind.ravel()[::-1]] = np.arange(len(cells))[::-1]
    probe = ElementProbe(element, material, body)
    matrices = np.array([_stiffness(probe, int(cell), PROBING_STRAIN * size, width * dim) for cell in first])
    dofs = (cells[:, :, None] * dim + np.arange(dim)).reshape(len(cells), -1)
    values = matrices[kind.ravel()]
    row, column = (np.broadcast_to(d, values.shape).ravel() for d in (dofs[:, :, None], dofs[:, None, :]))
    return csr_array((values.ravel(), (row, column)), shape=(nodes.size, nodes.size))


def _stiffness(probe: ElementProbe, cell: int, size: float, count: int) -> Floats:
    """Return the stiffness of a cell by differences of its forces about rest, (count, count)."""
    columns = [probe.force(cell, -step) - probe.force(cell, step) for step in size * np.eye(count)]
    matrix = np.array(columns).T / (2.0 * size)
    return 0.5 * (matrix + matrix.T)
