"""Cells of bodies of revolution with full integration, whose geometry is stored."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss import stress_3d
from percuss_methods.elements._plane_cell import plane_geometry

if TYPE_CHECKING:
    from percuss import BodyMesh, Floats


def ring_geometry(body: BodyMesh, kind: str, slopes: Floats, weights: Floats, shapes: Floats) -> Floats:
    """Return slopes, shape functions over the radius, and the volume of each quadrature point of each cell.

    Parameters
    ----------
    body, kind
        The body, and the kind of its cells.
    slopes : (points, nodes, 2) array
        Slopes of the shape functions in the reference cell.
    weights : (points,) array
        Weights of the points in the reference cell.
    shapes : (points, nodes) array
        Shape functions at the points.

    Returns
    -------
    (cells, points, 3 nodes + 1) array
        Of each point the slopes of each node by x and by y, the shape functions over x, then its volume on the ring.
    """
    flat = plane_geometry(body, kind, slopes, weights)
    radius = body.mesh.nodes[body.mesh.cells[kind], 0] @ shapes.T
    over_radius = shapes / radius[..., None]
    volume = 2.0 * np.pi * radius * flat[..., -1]
    return np.concatenate([flat[..., :-1], over_radius, volume[..., None]], axis=-1)


def ring_forces(
    rule: Any,  # noqa: ARG001
    material: Any,
    first: int,
    section: float,  # noqa: ARG001 - the volumes contain the circumference
    geometry: Floats,
    displacement: Floats,
    force: Floats,
) -> None:
    """Set `force` to the forces of a cell; the hoop strain ``u_x / x`` is the third direction of the gradient."""
    count = displacement.shape[0]
    for a in range(count):
        force[a, 0] = 0.0
        force[a, 1] = 0.0
    for q in range(geometry.shape[0]):
        xx = xy = yx = yy = hoop = 0.0
        for a in range(count):
            by_x, by_y = geometry[q, 2 * a], geometry[q, 2 * a + 1]
            xx += displacement[a, 0] * by_x
            xy += displacement[a, 0] * by_y
            yx += displacement[a, 1] * by_x
            yy += displacement[a, 1] * by_y
            hoop += displacement[a, 0] * geometry[q, 2 * count + a]
        stress = stress_3d(material, first + q, (xx, xy, 0.0, yx, yy, 0.0, 0.0, 0.0, hoop))
        volume = geometry[q, 3 * count]
        for a in range(count):
            by_x, by_y = geometry[q, 2 * a], geometry[q, 2 * a + 1]
            force[a, 0] -= volume * (stress[0] * by_x + stress[1] * by_y + stress[8] * geometry[q, 2 * count + a])
            force[a, 1] -= volume * (stress[3] * by_x + stress[4] * by_y)
