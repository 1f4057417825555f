"""Surfaces of a body: its facets at a region, with their areas and the cells behind them, and its whole boundary."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from percuss.methods.interfaces import Region, Surface

if TYPE_CHECKING:
    from percuss.methods.interfaces import BodyMesh, Floats, Integers

# Volume of a cell over the area of a facet is the height of the cell for squares and cubes; a part of it for others.
PARTS_OF_HEIGHT = {"triangle": 2.0, "tetra": 3.0}
# Of each kind of cell and of facet, as seen from outside; edges of a plane cell have it on their left.
FACETS = {
    "line": [[0], [1]],
    "triangle": [[0, 1], [1, 2], [2, 0]],
    "quad": [[0, 1], [1, 2], [2, 3], [3, 0]],
    "tetra": [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
    "hexahedron": [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]],
}
KIND_OF_FACET = {"triangle": "line", "quad": "line", "tetra": "triangle", "hexahedron": "quad"}


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


def boundary_of(kind: str, cells: Integers) -> Integers:
    """Return the facets that bound cells of a kind, or the ends of edges and the rims of faces, each in one of them."""
    facets = cells[:, FACETS[kind]].reshape(-1, len(FACETS[kind][0]))
    _, first, count = np.unique(np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True)
    alone: Integers = facets[first[count == 1]]
    return alone


def whole_surface(body: BodyMesh, volumes: Floats) -> Surface:
    """Return the whole boundary of a body, whatever its regions are; parameters are those of `surface_of`."""
    ((kind, cells),) = body.mesh.cells.items()
    region = Region((), np.zeros(0), {KIND_OF_FACET[kind]: boundary_of(kind, cells)})
    return surface_of(replace(body, mesh=body.mesh._replace(regions={"": region})), "", 0, volumes).surface


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
    if mesh.line is not None:
        return _end_of(body, region, start)
    facets = np.asarray(next(iter(mesh.regions[region].facets.values())))
    nodes, places = np.unique(facets, return_inverse=True)
    places = places.reshape(facets.shape)
    around = 2.0 * np.pi * mesh.nodes[nodes, 0] if body.plane == "axisymmetric" else None
    surface = Surface(nodes + start, mesh.nodes[nodes], places, np.zeros((0, 0)), np.zeros(0), around)
    out = surface.outward(np.arange(len(facets)), np.full(facets.shape, 1.0 / facets.shape[1]))
    size = np.linalg.norm(out, axis=1)
    areas = size * (body.section if around is None else around[places].mean(axis=1))
    surface = surface._replace(normals=out / size[:, None], areas=areas)
    of_nodes = surface.of_nodes()
    areas = of_nodes.sum(axis=1)
    # On the axis of revolution rings have no area: there their lengths count.
    means = of_nodes if areas.any() else surface._replace(areas=size, around=None).of_nodes()
    shares = np.bincount(places.ravel(), means.ravel(), nodes.size) / means.sum()
    ((kind, cells),) = mesh.cells.items()
    behind = _cells_behind(cells, facets, len(mesh.nodes))
    # The height of a ring is that of its section.
    over = volumes[behind] / areas if around is None else _sections(mesh.nodes[cells[behind]]) / size
    heights = PARTS_OF_HEIGHT.get(kind, 1.0) * over
    outward = np.zeros((nodes.size, out.shape[1]))
    np.add.at(outward, places, of_nodes[..., None] * surface.normals[:, None])
    return BodySurface(surface._replace(areas=areas), heights, shares, outward)


def _end_of(body: BodyMesh, region: str, start: int) -> BodySurface:
    """Return the end of a bar as a surface of one node, over the element there."""
    node, outward = body.mesh.regions[region].nodes[0], body.mesh.regions[region].outward
    number, area, place = np.array([node + start]), np.array([body.section]), body.mesh.nodes[[node]]
    end = Surface(number, place, np.zeros((1, 1), dtype=np.int64), outward[None], area)
    height = body.mesh.lengths[[0 if node == 0 else -1]]
    return BodySurface(end, height, np.ones(1), body.section * outward[None])


def _sections(corners: Floats) -> Floats:
    """Return the areas of plane cells by their corners, (n, corners, 2)."""
    x, y = np.moveaxis(corners, 2, 0)
    sections: Floats = 0.5 * (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)
    return sections


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
