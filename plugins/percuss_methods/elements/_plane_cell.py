"""Cells in two dimensions with full integration, whose geometry is stored."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss import stress_2d

if TYPE_CHECKING:
    from percuss import BodyMesh, Floats


class Nothing(NamedTuple):
    """A rule without arrays: all that a kernel reads of a cell is its geometry."""


def plane_geometry(body: BodyMesh, kind: str, slopes: Floats, weights: Floats) -> Floats:
    """Return slopes of the shape functions and the volume of each quadrature point of each cell.

    Parameters
    ----------
    body, kind
        The body, and the kind of its cells.
    slopes : (points, nodes, 2) array
        Slopes of the shape functions in the reference cell.
    weights : (points,) array
        Weights of the points in the reference cell.

    Returns
    -------
    (cells, points, 2 nodes + 1) array
        Of each point the slopes of each node by x and by y, then its volume.
    """
    corners = body.mesh.nodes[body.mesh.cells[kind]]
    jacobian = np.einsum("qai,cad->cqid", slopes, corners)
    by_place = np.einsum("cqdi,qai->cqad", np.linalg.inv(jacobian), slopes)
    volume = body.section * weights * np.linalg.det(jacobian)
    return np.concatenate([by_place.reshape(*volume.shape, -1), volume[..., None]], axis=-1)


def gradient_at(point: Floats, displacement: Floats) -> tuple[float, float, float, float]:
    """Return the displacement gradient at a point, (xx, xy, yx, yy), from what `plane_geometry` returned of it."""
    xx, xy = displacement[0, 0] * point[0], displacement[0, 0] * point[1]
    yx, yy = displacement[0, 1] * point[0], displacement[0, 1] * point[1]
    for a in range(1, displacement.shape[0]):
        by_x, by_y = point[2 * a], point[2 * a + 1]
        xx += displacement[a, 0] * by_x
        xy += displacement[a, 0] * by_y
        yx += displacement[a, 1] * by_x
        yy += displacement[a, 1] * by_y
    return xx, xy, yx, yy


def plane_forces(
    rule: Any,  # noqa: ARG001
    material: Any,
    first: int,
    section: float,  # noqa: ARG001 - the volumes contain it
    geometry: Floats,
    displacement: Floats,
    force: Floats,
) -> None:
    """Set `force` to the forces of a cell: minus the volume of each point times its stress times the slopes."""
    count = displacement.shape[0]
    for a in range(count):
        force[a, 0] = 0.0
        force[a, 1] = 0.0
    for q in range(geometry.shape[0]):
        volume = geometry[q, 2 * count]
        stress = stress_2d(material, first + q, gradient_at(geometry[q], displacement))
        xx, xy, yx, yy = volume * stress[0], volume * stress[1], volume * stress[2], volume * stress[3]
        for a in range(count):
            by_x, by_y = geometry[q, 2 * a], geometry[q, 2 * a + 1]
            force[a, 0] -= xx * by_x + xy * by_y
            force[a, 1] -= yx * by_x + yy * by_y


def forces_of_one_point(
    rule: Any,  # noqa: ARG001
    material: Any,
    first: int,
    section: float,  # noqa: ARG001 - the volumes contain it
    geometry: Floats,
    displacement: Floats,
    force: Floats,
) -> None:
    """Set `force` as `plane_forces` does, of a cell with a single point; it does not have to add up anything."""
    count = displacement.shape[0]
    volume = -geometry[0, 2 * count]
    stress = stress_2d(material, first, gradient_at(geometry[0], displacement))
    xx, xy, yx, yy = volume * stress[0], volume * stress[1], volume * stress[2], volume * stress[3]
    for a in range(count):
        by_x, by_y = geometry[0, 2 * a], geometry[0, 2 * a + 1]
        force[a, 0] = xx * by_x + xy * by_y
        force[a, 1] = yx * by_x + yy * by_y
