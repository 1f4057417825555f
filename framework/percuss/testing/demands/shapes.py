"""Demands on shapes: meshes of lines and of cells."""

from __future__ import annotations

from typing import Any

import numpy as np

from percuss.mesh.cells import cells_of
from percuss.mesh.surfaces import surface_of
from percuss.methods.interfaces import BodyMesh, Floats, Integers, Mesh, Region, Surface
from percuss.methods.plugin_calls import answer
from percuss.testing.subject import CheckFailed, Subject, demand

CLOSE = 1e-9
SLIVER = 5.0  # degrees


@demand("shapes")
def check_mesh(subject: Subject) -> None:
    """The mesh is a straight line of elements, or cells that its regions close.

    Of a line lengths, nodes, unit direction and unit outward normals are consistent. Of other bodies cells have
    positive volumes and no angle below five degrees; the regions together are the whole boundary, and their facets turn
    outwards. `element_count` is the number of elements. `refine` moves no region, but for the height of an arc over its
    chord, and divides the size of elements. The body starts where the case places it.
    """
    for _, shape in subject.made():
        start = np.array([0.3, -0.7, 0.2])[: shape.dimension() or 2]
        meshes = [answer(shape, "mesh", start, refine) for refine in (1, 2)]
        for refine, mesh in zip((1, 2), meshes, strict=True):
            told, cells = shape.element_count(refine), cells_of(mesh)
            if told not in {None, len(cells)}:
                words = f"`element_count` is {told} with `refine` {refine}, and the mesh has {len(cells)} elements"
                raise CheckFailed(words)
            if mesh.line is not None:
                _check_line(mesh)
            else:
                _check_cells(shape, mesh, cells)
                _check_boundary(subject, shape, mesh)
        longest = [float(np.ptp(mesh.nodes[cells_of(mesh)], axis=1).max()) for mesh in meshes]
        if not 0.35 <= longest[1] / longest[0] <= 0.7:
            raise CheckFailed(f"the largest element is {longest[0]:.6g} long, and {longest[1]:.6g} with `refine` 2")
        # The nodes of a round region lie on it, and its outermost point between two of them as far as an arc is high.
        arc = 0.0 if mesh.line is not None else longest[0] ** 2 / (4.0 * float(np.ptp(mesh.nodes, axis=0).min()))
        for name in shape.regions:
            places = [mesh.nodes[_nodes_of(mesh.regions[name])] for mesh in meshes]
            coarse, fine = ([at.min(axis=0), at.max(axis=0)] for at in places)
            if not np.allclose(coarse, fine, rtol=0.0, atol=CLOSE + arc):
                raise CheckFailed(f"refinement moves the region '{name}'")
        if not np.allclose(answer(shape, "mesh", start + 1.0, 2).nodes - meshes[1].nodes, 1.0, rtol=0.0, atol=1e-12):
            raise CheckFailed("the body does not start where the case places it")


def _check_line(mesh: Mesh) -> None:
    """Raise `CheckFailed` unless a mesh is a straight line."""
    if abs(np.linalg.norm(mesh.direction) - 1.0) > 1e-12:
        raise CheckFailed(f"`direction` is {mesh.direction}, expected a unit vector")
    steps, ahead = np.diff(mesh.nodes, axis=0), mesh.lengths[:, None] * mesh.direction
    if not (mesh.lengths > 0).all() or not np.allclose(steps, ahead, rtol=1e-9, atol=1e-12 * mesh.lengths.sum()):
        raise CheckFailed("nodes, lengths and direction contradict each other")
    for name, region in mesh.regions.items():
        if not region.nodes or not all(0 <= node <= mesh.lengths.size for node in region.nodes):
            raise CheckFailed(f"region '{name}' has the nodes {region.nodes} of {mesh.lengths.size + 1}")
        if abs(abs(float(region.outward @ mesh.direction)) - 1.0) > 1e-12:
            raise CheckFailed(f"the outward normal of region '{name}' is {region.outward}")


def _nodes_of(region: Region) -> list[int]:
    """Return the nodes of a region and of its facets."""
    return [*region.nodes, *(int(node) for facets in region.facets.values() for node in np.ravel(facets))]


def _check_cells(shape: Any, mesh: Mesh, cells: Integers) -> None:
    """Raise `CheckFailed` unless each region has facets and each node a cell, and no cell is a sliver."""
    if empty := [name for name in shape.regions if not sum(map(np.size, mesh.regions[name].facets.values()))]:
        raise CheckFailed(f"the region '{empty[0]}' has no facets")
    if lonely := sorted(set(range(len(mesh.nodes))) - set(cells.ravel().tolist())):
        raise CheckFailed(f"the node {lonely[0]} at {mesh.nodes[lonely[0]].tolist()} belongs to no cell")
    if shape.dimension() == 2:
        corners = mesh.nodes[cells]
        ahead, behind = (np.roll(corners, -way, axis=1) - corners for way in (1, -1))
        area = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]
        sine = area / np.linalg.norm(ahead, axis=2) / np.linalg.norm(behind, axis=2)
        smallest = float(np.degrees(np.arcsin(sine.min())))
        if not smallest >= SLIVER:
            raise CheckFailed(
                f"a cell has an angle of {smallest:.3g} degrees to its sides or to a straight line: it is negative "
                "where corners run clockwise"
            )


def _check_boundary(subject: Subject, shape: Any, mesh: Mesh) -> None:
    """Raise `CheckFailed` unless the regions of a mesh of cells enclose its volume."""
    elements = (subject.registry.get("elements", name) for name in subject.registry.names("elements"))
    element = next(made for made in elements if getattr(made, "cell", "") == shape.cell)()
    body = BodyMesh(mesh, 1.3, "strain") if shape.dimension() == 2 else BodyMesh(mesh, 1.0)
    volumes = np.asarray(answer(element, "volumes_of_cells", body))
    surfaces = [surface_of(body, name, 0, volumes).surface for name in shape.regions]
    vectors = [_vector_areas(surface) for surface in surfaces]
    closed = sum(of_region.sum(axis=0) for of_region in vectors)
    # Of a closed surface the fluxes of x, y and z are its volume each.
    flux = sum(
        (of_region * s.positions[s.facets].mean(axis=1)).sum(axis=0)
        for of_region, s in zip(vectors, surfaces, strict=True)
    )
    if np.abs(closed).max() > CLOSE or np.abs(np.asarray(flux) - volumes.sum()).max() > 1e-2 * volumes.sum():
        raise CheckFailed(f"its regions do not enclose its volume {volumes.sum():.6g}: they flow {flux}")


def _vector_areas(surface: Surface) -> Floats:
    """Return the integral of the normal over each facet, which is shorter than the area if the facet is not plane."""
    if surface.positions.shape[1] == 2:
        return surface.areas[:, None] * surface.normals
    count, corners = surface.facets.shape
    return surface.outward(np.arange(count), np.full((count, corners), 1.0 / corners))
