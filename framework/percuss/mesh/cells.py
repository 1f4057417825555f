"""Meshes and kernels of elements of more than two nodes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.jit import Filled
from percuss.mesh import cell_kernels
from percuss.mesh.cell_kernels import Cells
from percuss.mesh.materials import MaterialPoints, material_slots, solid_slots
from percuss.methods import slots
from percuss.methods.interfaces import BodyMesh, CellElement, Lumping, Mesh, SolidElement, SolidMaterial
from percuss.methods.plugin_calls import answer, read_only

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.methods.interfaces import Element, Floats, Integers, Material, Region

PROBING_STRAIN = 1e-7  # far below any strain at which the stiffness of a material or an element changes


def has_cells(element: Element | type[Element]) -> bool:
    """Return whether an element, or its class, sees one cell at a time (`CellElement`)."""
    return issubclass(element if isinstance(element, type) else type(element), CellElement)


def is_solid(element: Element | type[Element]) -> bool:
    """Return whether an element, or its class, asks the material for the stress of a gradient (`SolidElement`)."""
    return issubclass(element if isinstance(element, type) else type(element), SolidElement)


def slots_of_material(element: Any, material: Any) -> dict[Any, Any]:
    """Return the slots of the kernels of an element, or its class, that a material, or its class, fills."""
    return solid_slots(material, element.dimension) if is_solid(element) else material_slots(material)


def solid_parameters(material: SolidMaterial, plane: str, dt: float = math.inf) -> Floats:
    """Return the numbers that the kernels of a solid material need, (k,): the time step last, if they ask for it."""
    numbers = answer(material, "solid_parameters", plane)
    return np.array([*numbers, dt] if material.needs_step else numbers, dtype=float)


def parameters_of(element: Element, material: Material, body: BodyMesh, dt: float = math.inf) -> Floats:
    """Return the numbers that the kernels of a material need with an element of a body, in a step of `dt`, (k,)."""
    if isinstance(material, SolidMaterial) and isinstance(element, SolidElement):
        return solid_parameters(material, body.plane_of_material if element.dimension == 2 else "", dt)
    return np.array(answer(material, "parameters"), dtype=float)


def points_at_rest(element: Element, material: Material, body: BodyMesh, dt: float = math.inf) -> MaterialPoints:
    """Return the material of a body as the kernels of its elements pass it on, with state variables of zero."""
    before = np.zeros((volumes_of(element, body).size, material.state))
    return MaterialPoints(read_only(parameters_of(element, material, body, dt)), read_only(before), before.copy())


def mesh_of_element(element: Element, mesh: Mesh) -> Mesh:
    """Return the mesh of a body: that of its shape, with the nodes that its element has between its ends.

    Parameters
    ----------
    element
        The element of the body.
    mesh
        The mesh as the shape made it; along a line a row of two-node cells.
    """
    if not isinstance(element, CellElement) or mesh.line is None:
        return mesh
    places = np.asarray(answer(element, "reference_nodes"), dtype=float)
    order, count = places.size - 1, mesh.lengths.size
    along = np.argsort(places)  # the nodes of a cell in the order in which they stand along the line
    nodes = np.empty((count, order, mesh.nodes.shape[1]))
    for k, place in enumerate(places[along[:-1]]):
        nodes[:, k] = (1.0 - place) * mesh.nodes[:-1] + place * mesh.nodes[1:]
    cells = np.empty((count, order + 1), dtype=np.int64)
    cells[:, along] = order * np.arange(count)[:, None] + np.arange(order + 1)
    return mesh._replace(
        nodes=np.concatenate([nodes.reshape(-1, mesh.nodes.shape[1]), mesh.nodes[-1:]]),
        regions={name: _moved(region, order) for name, region in mesh.regions.items()},
        cells={element.cell: cells},
    )


def _moved(region: Region, order: int) -> Region:
    return region._replace(
        nodes=tuple(order * node for node in region.nodes),
        facets={kind: order * np.asarray(nodes) for kind, nodes in region.facets.items()},
    )


def cells_of(mesh: Mesh) -> Integers:
    """Return the nodes of each element, (elements, nodes of a cell)."""
    return next(iter(mesh.cells.values()))


def extents_of(nodes: Floats, cells: Integers) -> Floats:
    """Return how far each cell reaches along each axis, (cells, dim), without an array of all corners."""
    low = high = nodes[cells[:, 0]]
    for corner in cells.T[1:]:
        low, high = np.minimum(low, nodes[corner]), np.maximum(high, nodes[corner])
    return high - low


def pieces_of(mesh: Mesh) -> Integers:
    """Return the piece of each cell, (cells,), numbered from 0; pieces have no common node."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    cells, size = cells_of(mesh), len(mesh.nodes)
    ends = np.repeat(cells[:, 0], cells.shape[1] - 1), cells[:, 1:].ravel()
    piece = connected_components(csr_array((np.ones(ends[0].size), ends), shape=(size, size)), directed=False)[1]
    return np.unique(piece[cells[:, 0]], return_inverse=True)[1].ravel()


def of_kinds(element: Element, question: str, body: BodyMesh) -> Floats:
    """Return what an element answers about each cell; of a solid it is asked about one cell of each kind."""
    if body.mesh.line is not None:
        return np.asarray(answer(element, question, body), dtype=float)
    found: Floats = np.asarray(answer(element, question, body.of_each_kind), dtype=float)[body.kinds[1]]
    return found


def lumping_of(element: Element, body: BodyMesh) -> Lumping:
    """Return how the elements of a body share their mass among their nodes."""
    if not isinstance(element, CellElement):
        return Lumping.of_line(len(cells_of(body.mesh)))
    cells, asked = cells_of(body.mesh), body if body.mesh.line is not None else body.of_each_kind
    shares = np.asarray(answer(element, "mass_shares", asked), dtype=float)
    if asked is not body and shares.ndim == 2:
        shares = shares[body.kinds[1]]
    return Lumping(np.broadcast_to(shares, cells.shape), cells, body.mesh.nodes.shape[0])


def element_masses(element: Element, body: BodyMesh, density: float) -> Floats:
    """Return the mass of each element of a body, (elements,)."""
    if body.mesh.line is not None:
        return density * body.section * body.mesh.lengths
    masses: Floats = density * of_kinds(element, "volumes_of_cells", body)
    return masses


def volumes_of(element: Element, body: BodyMesh) -> Floats:
    """Return the volume of each quadrature point of each element, (elements, points) [length^3]; one of a bar."""
    if not isinstance(element, CellElement):
        return (body.section * body.mesh.lengths)[:, None]
    return of_kinds(element, "volumes", body)


def cell_arrays(element: CellElement, bodies: Sequence[BodyMesh]) -> Cells:
    """Return the cells of bodies of one element for the loop."""
    cells = [cells_of(body.mesh) for body in bodies]
    volumes = [volumes_of(element, body) for body in bodies]
    nodes_of_cell, dim = cells[0].shape[1], bodies[0].mesh.nodes.shape[1]
    gradient = (element.dimension**2,) if isinstance(element, SolidElement) else ()
    shared = Cells(
        rule=answer(element, "rule"),
        cells=np.concatenate(cells).astype(np.uint32),
        geometry=np.concatenate([of_kinds(element, "geometry", body) for body in bodies]),
        section=np.repeat([float(body.section) for body in bodies], [len(of_body) for of_body in cells]),
        volumes=np.concatenate(volumes),
        edges=np.cumsum([0, *map(len, cells)], dtype=np.int64),
        corners=tuple(range(nodes_of_cell)),
        axes=tuple(range(dim)),
        hourglass_points=getattr(element, "hourglass_points", 0),
        strains=np.zeros((0, 0)),
    )
    locked: Cells = read_only(shared)
    return locked._replace(rule=answer(element, "rule"), strains=np.zeros((2, volumes[0].shape[1], *gradient)))


def element_slots(element: Any) -> dict[Any, Any]:
    """Return the slots that an element, or its class, fills with its kernels.

    The strain energy of cells needs their strains, from the kernel of the force.
    """
    if has_cells(element):
        recorded: tuple[Any, Any] = (slots.stress, cell_kernels.record_strain)
        if is_solid(element):
            recorded = slots.stress_2d if element.dimension == 2 else slots.stress_3d, cell_kernels.record_gradient
        strain = Filled(element.force, (recorded,))
        return {slots.cell_force: element.force, cell_kernels.cell_strain: strain}
    return {slots.internal_force: element.internal_force, slots.energy: element.energy}
