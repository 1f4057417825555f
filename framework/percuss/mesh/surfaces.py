"""The surface of a body at a region of its boundary: facets, their areas and normals, and the cells behind them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from percuss.methods.interfaces import Surface

if TYPE_CHECKING:
    from percuss.methods.interfaces import BodyMesh, Floats, Integers

# Volume of a cell over the area of a facet is the height of the cell for squares and cubes; a part of it for others.
PARTS_OF_HEIGHT = {"triangle": 2.0, "tetra": 3.0}


TINY = float(np.finfo(float).tiny)


class BodySurface(NamedTuple):
    """The surface of a body at a region, with what lies behind it.

    Attributes
    ----------
    surface
        As a pairing receives it.
    heights : (F,) array
        Height of the cell behind each facet over it [length].
    shares : (n,) array
        Share of each of its nodes in the area.
    outward : (n, dim) array
        Sum of the areas that belong to each node, along their normals out of the body [length^2].
    """

    surface: Surface
    heights: Floats
    shares: Floats
    outward: Floats


def surface_of(body: BodyMesh, region: str, start: int, volumes: Floats) -> BodySurface:
    """Return the surface of a body at a region of its boundary.

    Parameters
    ----------
    body, region
        The body and the name of the region.
    start
        Number in the model of the first node of the body.
    volumes : (elements,) array
        Volumes of its cells [length^3].
    """
    mesh = body.mesh
    facets = np.asarray(next(iter(mesh.regions[region].facets.values())))
    nodes, places = np.unique(facets, return_inverse=True)
    places = places.reshape(facets.shape)
    around = 2.0 * np.pi * mesh.nodes[nodes, 0] if body.plane == "axisymmetric" else None
    normals, of_nodes = _areas(mesh.nodes[facets], body.section)
    if around is not None:
        here = around[places]
        of_nodes = of_nodes.sum(axis=1)[:, None] * (2.0 * here + here[:, ::-1]) / 6.0
    areas = of_nodes.sum(axis=1)
    shares = np.bincount(places.ravel(), of_nodes.ravel(), nodes.size) / max(areas.sum(), TINY)
    ((kind, cells),) = mesh.cells.items()
    behind = volumes[_cells_behind(cells, facets, len(mesh.nodes))]
    heights = PARTS_OF_HEIGHT.get(kind, 1.0) * behind / np.maximum(areas, TINY)  # a facet on an axis has no area
    outward = np.zeros((nodes.size, normals.shape[1]))
    np.add.at(outward, places, of_nodes[..., None] * normals[:, None])
    surface = Surface(nodes + start, mesh.nodes[nodes], places, normals, areas, around)
    return BodySurface(surface, heights, shares, outward)


def _areas(corners: Floats, thickness: float) -> tuple[Floats, Floats]:
    """Return the unit normals of facets, (F, dim), and the area that belongs to each of their nodes, (F, nodes)."""
    count, dim = corners.shape[1:]
    if dim == 2:
        along = corners[:, 1] - corners[:, 0]
        length = np.linalg.norm(along, axis=1)
        normals = np.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
        return normals, np.repeat(0.5 * thickness * length[:, None], 2, axis=1)
    if count == 3:
        out = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        twice = np.linalg.norm(out, axis=1)
        return out / twice[:, None], np.repeat(twice[:, None] / 6.0, 3, axis=1)
    of_nodes, middle = np.zeros(corners.shape[:2]), np.zeros((len(corners), 3))
    place = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for point in place / np.sqrt(3.0):
        shape = 0.25 * (1.0 + point[0] * place[:, 0]) * (1.0 + point[1] * place[:, 1])
        by_xi = 0.25 * place[:, 0] * (1.0 + point[1] * place[:, 1])
        by_eta = 0.25 * place[:, 1] * (1.0 + point[0] * place[:, 0])
        out = np.cross(np.tensordot(corners, by_xi, (1, 0)), np.tensordot(corners, by_eta, (1, 0)))
        of_nodes += np.linalg.norm(out, axis=1)[:, None] * shape
        middle += out
    return middle / np.linalg.norm(middle, axis=1)[:, None], of_nodes


def _cells_behind(cells: Integers, facets: Integers, nodes: int) -> Integers:
    """Return the number of the cell behind each facet: the one that has all of its nodes."""
    from scipy.sparse import csr_array

    def incidence(of: Integers) -> csr_array:
        count, width = of.shape
        return csr_array((np.ones(of.size), of.ravel(), width * np.arange(count + 1)), shape=(count, nodes))

    shared = (incidence(facets) @ incidence(cells).T).tocsr()
    found = shared.data == facets.shape[1]
    rows = np.repeat(np.arange(len(facets)), np.diff(shared.indptr))[found]
    behind = np.full(len(facets), -1, dtype=np.int64)
    behind[rows] = shared.indices[found]
    return behind
