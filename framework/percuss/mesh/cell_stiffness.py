"""The stiffness of bodies of cells about rest, from the kernels of their element and material."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.compiler.fingerprint import layout
from percuss.compiler.machine_code import jit_disabled
from percuss.compiler.specialise import Specialiser, compile_error
from percuss.errors import PluginError
from percuss.mesh.cell_kernels import probe_cells
from percuss.mesh.cells import (
    PROBING_STRAIN,
    SAME_SHAPE,
    cells_of,
    element_masses,
    lumping_of,
    slots_of_material,
    volumes_of,
)
from percuss.mesh.element_probe import ElementProbe
from percuss.mesh.material_points import points_at_rest
from percuss.methods import slots
from percuss.methods.interfaces import CellElement
from percuss.methods.plugin_calls import answer

if TYPE_CHECKING:
    from percuss.methods.interfaces import BodyMesh, Element, Floats, Integers, Material

MANY = 200  # cells of different shape from which on plain Python takes longer than to load the compiler


class CellStiffness(NamedTuple):
    """The stiffness of the cells of a body about rest; cells of the same shape and size are asked once.

    Attributes
    ----------
    matrices : (kinds, nodes * dim, nodes * dim) array
        Stiffness of a cell of each kind [force/length].
    kind : (elements,) array
        Kind of each cell.
    first : (kinds,) array
        The first cell of each kind.
    """

    matrices: Floats
    kind: Integers
    first: Integers


def cell_stiffness(element: Element, material: Material, body: BodyMesh) -> CellStiffness:
    """Return the stiffness of the cells of a body about rest."""
    nodes, cells = body.mesh.nodes, cells_of(body.mesh)
    relative = nodes[cells] - nodes[cells[:, :1]]
    size = float(np.abs(relative).max())
    if body.plane == "axisymmetric":  # where the distance from the axis tells cells apart, too
        relative[..., 0] = nodes[cells, 0]
    kinds, kind = np.unique(np.round(relative / size, SAME_SHAPE).reshape(len(cells), -1), axis=0, return_inverse=True)
    first = np.zeros(len(kinds), dtype=np.int64)
    first[kind.ravel()[::-1]] = np.arange(len(cells))[::-1]
    return CellStiffness(_stiffness(element, material, body, first, PROBING_STRAIN * size), kind.ravel(), first)


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

    No frequency of the body is above the largest of them, by the theorem of Irons. All are nan where a node of a cell
    has no mass, as in a cell that is turned inside out.
    """
    masses = element_masses(element, body, material.rho)[:, None] * lumping_of(element, body).shares
    if not (masses > 0.0).all():
        return np.full(len(masses), np.nan)
    found, dim = cell_stiffness(element, material, body), body.mesh.nodes.shape[1]
    root = np.repeat(np.sqrt(masses[found.first]), dim, axis=1)
    scaled = found.matrices / root[:, :, None] / root[:, None, :]
    frequencies: Floats = np.sqrt(np.linalg.eigvalsh(scaled)[:, -1])[found.kind]
    return frequencies


def _stiffness(element: Element, material: Material, body: BodyMesh, chosen: Integers, size: float) -> Floats:
    """Return the stiffness of cells by differences of their forces about rest, (cells, nodes * dim, nodes * dim)."""
    shape = cells_of(body.mesh).shape[1], body.mesh.nodes.shape[1]
    count = shape[0] * shape[1]
    forces = np.zeros((len(chosen), count, 2, count))
    if not _compiled_probe(element, material, body, chosen, size, forces.reshape(-1, count, 2, *shape)):
        probe = ElementProbe(element, material, body)
        for cell, of_cell in zip(chosen.tolist(), forces, strict=True):
            for step, of_step in zip(size * np.eye(count), of_cell, strict=True):
                of_step[:] = probe.force(cell, -step), probe.force(cell, step)
    matrices = (forces[:, :, 0] - forces[:, :, 1]).transpose(0, 2, 1) / (2.0 * size)
    for cell, cause in np.argwhere(~np.isfinite(matrices).all(axis=1))[:1]:
        moved = size * np.eye(count)[cause]
        fault, place = ElementProbe(element, material, body).fault(int(chosen[cell]), moved)
        raise PluginError(f"{fault or 'the forces are not finite'}, in cell {chosen[cell]}", place)
    return 0.5 * (matrices + matrices.transpose(0, 2, 1))


def _compiled_probe(
    element: Element, material: Material, body: BodyMesh, chosen: Integers, size: float, forces: Floats
) -> bool:
    """Set the forces of many cells as `probe_cells` does, in compiled code; return whether that was done."""
    if len(chosen) < MANY or not isinstance(element, CellElement) or jit_disabled():
        return False
    points, rule = points_at_rest(element, material, body), answer(element, "rule")
    geometry, points_of_cell = answer(element, "geometry", body), volumes_of(element, body).shape[1]
    filled = {**slots_of_material(type(element), type(material)), slots.cell_force: type(element).force}
    maker = Specialiser(filled, counting=True, about=layout((rule, points)))
    rest = np.zeros(forces.shape[3:])
    try:
        probe = maker.bind(probe_cells, entry=True)
        probe(rule, points, chosen, points_of_cell, body.section, geometry, size, rest, forces)
    except compile_error():  # the march says why, where it cannot compile the kernels either
        return False
    return True
