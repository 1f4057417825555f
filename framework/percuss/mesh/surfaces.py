"""Surfaces of a body: its facets at a region, with their areas and the cells behind them, and its whole boundary."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from percuss.methods.interfaces import REFERENCE_CELLS, Surface

if TYPE_CHECKING:
    from percuss.methods.interfaces import BodyMesh, Floats, Integers

# Volume of a cell over the area of a facet is the height of the cell for squares and cubes; a part of it for others.
PARTS_OF_HEIGHT = {"triangle": 2.0, "tetra": 3.0}


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
    """Return the facets that bound cells of a kind, or the ends of edges and the rims of faces, each in one of them.

    A facet is told by the sum of random numbers of its nodes: that two facets of ten million have the same sum has a
    chance of 1e-5.
    """
    of_cell = REFERENCE_CELLS[kind].facets
    random = np.random.default_rng(0).integers(1 << 63, size=int(cells.max()) + 1, dtype=np.uint64)
    told = np.empty((len(of_cell), len(cells)), dtype=np.uint64)
    for k, corners in enumerate(of_cell.tolist()):
        told[k] = sum(random[cells[:, corner]] for corner in corners)
    _, first, count = np.unique(told, return_index=True, return_counts=True)
    of, cell = np.divmod(first[count == 1], len(cells))
    facets: Integers = cells[cell[:, None], of_cell[of]]
    return facets[np.lexsort(np.sort(facets, axis=1).T[::-1])]


def whole_surface(body: BodyMesh, start: int) -> Surface:
    """Return the whole boundary of a body, whatever its regions are; `start` is the number of its first node."""
    ((kind, cells),) = body.mesh.cells.items()
    return _surface(body, boundary_of(kind, cells), start)[0]


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
    surface, of_nodes, size = _surface(body, facets, start)
    # On the axis of revolution rings have no area: there their lengths count.
    means = of_nodes if surface.areas.any() else surface._replace(areas=size, around=None).of_nodes()
    shares = np.bincount(surface.facets.ravel(), means.ravel(), surface.nodes.size) / means.sum()
    ((kind, cells),) = mesh.cells.items()
    behind = _cells_behind(cells, facets, len(mesh.nodes))
    # The height of a ring is that of its section.
    of_ring = surface.around is not None
    over = _sections(mesh.nodes[cells[behind]]) / size if of_ring else volumes[behind] / surface.areas
    heights = PARTS_OF_HEIGHT.get(kind, 1.0) * over
    outward = np.zeros_like(surface.positions)
    np.add.at(outward, surface.facets, of_nodes[..., None] * surface.normals[:, None])
    return BodySurface(surface, heights, shares, outward)


def _surface(body: BodyMesh, facets: Integers, start: int) -> tuple[Surface, Floats, Floats]:
    """Return a surface of facets, their areas that belong to each of their nodes, and their sizes in the section."""
    nodes, places = np.unique(facets, return_inverse=True)
    places, positions = places.reshape(facets.shape), body.mesh.nodes[nodes]
    around = 2.0 * np.pi * positions[:, 0] if body.plane == "axisymmetric" else None
    surface = Surface(nodes + start, positions, places, np.zeros((0, 0)), np.zeros(0), around)
    out = surface.outward(np.arange(len(facets)), np.full(facets.shape, 1.0 / facets.shape[1]))
    size = np.linalg.norm(out, axis=1)
    areas = size * (body.section if around is None else around[places].mean(axis=1))
    surface = surface._replace(normals=out / size[:, None], areas=areas)
    of_nodes = surface.of_nodes()
    return surface._replace(areas=of_nodes.sum(axis=1)), of_nodes, size


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

    is_here, here = np.zeros(nodes, dtype=bool), np.zeros(len(cells), dtype=np.int64)
    is_here[facets] = True
    for corner in cells.T:
        here += is_here[corner]
    near = np.flatnonzero(here >= facets.shape[1])
    facet, cell = (incidence(facets) @ incidence(cells[near]).T == facets.shape[1]).nonzero()
    behind: Integers = near[cell[np.argsort(facet)]]
    return behind
