"""The stiffness of cells and of bodies of cells about rest, from the kernels of their element and material."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.mesh.cells import PROBING_STRAIN, cells_of, element_masses, extents_of, lumping_of
from percuss.mesh.element_probe import ElementProbe
from percuss.mesh.stiffness_rows import Assembly
from percuss.methods.interfaces import BodyMesh
from percuss.methods.interfaces.body import some_at_a_time

if TYPE_CHECKING:
    from collections.abc import Iterator

    from percuss.mesh.stiffness_rows import StiffnessRows
    from percuss.methods.interfaces import Element, Floats, Integers, Material

ALIKE = 8  # cells of a kind, on average, from which on each kind is asked once for the whole body
AT_A_TIME = 4_000_000  # numbers in the matrices of the cells that are asked at a time, where most are unlike


class CellStiffness(NamedTuple):
    """The stiffness of cells about rest; cells of the same shape and size are asked once.

    Attributes
    ----------
    cells
        The cells of the body that these are.
    matrices : (kinds, nodes * m, nodes * m) array
        Stiffness of a cell of each kind in m directions: those of space, of a bar its own [force/length].
    kind : (elements,) array
        Kind of each cell.
    first : (kinds,) array
        The first cell of each kind in the body.
    """

    cells: slice
    matrices: Floats
    kind: Integers
    first: Integers


def cell_stiffness(element: Element, material: Material, body: BodyMesh) -> Iterator[CellStiffness]:
    """Yield the stiffness of the cells of a body about rest, of a bar along it with a linear material.

    Cells of a solid that are mostly unlike are asked some at a time: together their matrices take more memory than all
    that a march needs.

    Raises
    ------
    PluginError
        If a force is not finite.
    """
    (first, kind), ((name, cells),) = body.kinds, body.mesh.cells.items()
    size = PROBING_STRAIN * float(extents_of(body.mesh.nodes, cells[first]).max())
    if body.mesh.line is not None:
        probe = ElementProbe(element, material, body, material.modulus)
        yield CellStiffness(slice(0, len(kind)), probe.stiffness(first, size, first), kind, first)
        return
    some = AT_A_TIME // (cells.shape[1] * body.mesh.nodes.shape[1]) ** 2
    step = some if ALIKE * len(first) > len(kind) else len(kind)
    for these in some_at_a_time(len(kind), step):
        kinds, own = np.unique(kind[these], return_inverse=True)
        probed = BodyMesh(body.mesh._replace(cells={name: cells[first[kinds]]}), body.section, body.plane)
        matrices = ElementProbe(element, material, probed).stiffness(np.arange(kinds.size), size, first[kinds])
        yield CellStiffness(these, matrices, own, first[kinds])


def rows_of_solid(element: Element, material: Material, body: BodyMesh) -> StiffnessRows:
    """Return the stiffness of a body that is no bar, about rest, as rows of differences."""
    assembly = Assembly(body)
    for part in cell_stiffness(element, material, body):
        assembly.add(part.cells.start, part.kind, part.matrices)
    return assembly.rows


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
    cells = cells_of(body.mesh)
    matrices = np.concatenate([part.matrices[part.kind] for part in cell_stiffness(element, material, body)])
    ways = matrices.shape[1] // cells.shape[1]  # of the motion of a node
    dofs = (cells[:, :, None] * ways + np.arange(ways)).reshape(len(cells), -1)
    return entries_of(matrices, dofs)


def entries_of(matrices: Floats, dofs: Integers) -> tuple[Floats, Integers, Integers]:
    """Return the entries of matrices of cells, each at its degrees of freedom."""
    dofs = dofs.astype(np.int32)  # SciPy would copy wider numbers, which takes longer than all else
    row, column = (np.broadcast_to(d, matrices.shape).ravel() for d in (dofs[:, :, None], dofs[:, None, :]))
    return matrices.ravel(), row, column


def frequencies_of_cells(
    element: Element, material: Material, body: BodyMesh, assembly: Assembly | None = None
) -> Floats:
    """Return the highest angular frequency of each cell by itself with its share of the lumped mass, (elements,).

    No frequency of the body is above the largest of them, by the theorem of Irons. All are nan where a node of a cell
    has no mass, as in a cell that is turned inside out. The stiffness of the cells is added to `assembly`, if there
    is one: each cell is asked once.
    """
    masses = element_masses(element, body, material.rho)[:, None] * lumping_of(element, body).shares
    frequencies = np.full(len(masses), np.nan)
    if not (masses > 0.0).all():
        return frequencies
    for part in cell_stiffness(element, material, body):
        ways = part.matrices.shape[1] // masses.shape[1]  # of the motion of a node: one along a line
        root = np.repeat(np.sqrt(masses[part.first]), ways, axis=1)
        scaled = part.matrices / root[:, :, None] / root[:, None, :]
        frequencies[part.cells] = np.sqrt(np.linalg.eigvalsh(scaled)[:, -1])[part.kind]
        if assembly is not None:
            assembly.add(part.cells.start, part.kind, part.matrices)
    return frequencies
