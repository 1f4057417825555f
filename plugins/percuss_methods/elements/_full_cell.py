"""Cells with full integration, whose geometry is stored: slopes of the shape functions and volume of each point."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from percuss import Floats, SolidElement, stress_2d, stress_3d

if TYPE_CHECKING:
    from percuss import BodyMesh


class Nothing(NamedTuple):
    """A rule without arrays: all that a kernel reads of a cell is its geometry."""


class FullCell(SolidElement, contract="elements"):
    """A cell by its quadrature points in the reference cell.

    Attributes
    ----------
    shapes : (points, nodes) array
        Shape functions at the points.
    slopes : (points, nodes, dim) array
        Slopes of the shape functions at the points.
    weights : (points,) array
        Weights of the points.
    """

    shapes: ClassVar[Floats]
    slopes: ClassVar[Floats]
    weights: ClassVar[Floats]

    def rule(self) -> Nothing:
        """Return nothing: slopes and volumes differ from cell to cell."""
        return Nothing()

    def geometry(self, body: BodyMesh) -> Floats:
        """Return of each point the slopes of each node by each coordinate, then the volume.

        Returns
        -------
        (cells, points, nodes * dim + 1) array
        """
        by_place = np.einsum("cqdi,qai->cqad", np.linalg.inv(self._jacobian(body)), self.slopes)
        volume = self._volumes(body)
        return np.concatenate([by_place.reshape(*volume.shape, -1), volume[..., None]], axis=-1)

    def _jacobian(self, body: BodyMesh) -> Floats:
        """Return the slopes of the place by the coordinates of a cell at each point, (cells, points, dim, dim)."""
        corners = body.mesh.nodes[body.mesh.cells[self.cell]]
        jacobian: Floats = np.einsum("qai,cad->cqid", self.slopes, corners)
        return jacobian

    def _volumes(self, body: BodyMesh) -> Floats:
        """Return the volume of each point of the full rule, (cells, points)."""
        volumes: Floats = body.section * self.weights * np.linalg.det(self._jacobian(body))
        return volumes

    def volumes(self, body: BodyMesh) -> Floats:
        """Return the volume of each point."""
        return self._volumes(body)

    def mass_shares(self, body: BodyMesh) -> Floats:
        """Return the integrals of the shape functions over the volume of the cell."""
        if len(self.shapes) == 1:
            return self.shapes[0]
        volumes = self.volumes(body)
        shares: Floats = volumes @ self.shapes / volumes.sum(axis=1)[:, None]
        return shares


class RingCell(FullCell, contract="elements"):
    """A `FullCell` of a body of revolution: a ring about the axis x = 0, with the hoop strain ``u_x / x``."""

    dimension = 3
    about_axis = True

    def geometry(self, body: BodyMesh) -> Floats:
        """Return of each point slopes, shape functions over the radius, then the volume on the ring.

        Returns
        -------
        (cells, points, 3 nodes + 1) array
        """
        flat = super().geometry(body)
        return np.concatenate([flat[..., :-1], self.shapes / self._radius(body)[..., None], flat[..., -1:]], axis=-1)

    def _radius(self, body: BodyMesh) -> Floats:
        """Return the distance of each point from the axis, (cells, points)."""
        radius: Floats = body.mesh.nodes[body.mesh.cells[self.cell], 0] @ self.shapes.T
        return radius

    def _volumes(self, body: BodyMesh) -> Floats:
        """Return the volume of each point on its ring, (cells, points)."""
        return 2.0 * np.pi * self._radius(body) * super()._volumes(body)


def plane_gradient(of_point: Floats, displacement: Floats) -> tuple[float, float, float, float]:
    """Return the displacement gradient in the plane at a point of a cell, (xx, xy, yx, yy)."""
    xx, xy = displacement[0, 0] * of_point[0], displacement[0, 0] * of_point[1]
    yx, yy = displacement[0, 1] * of_point[0], displacement[0, 1] * of_point[1]
    for a in range(1, displacement.shape[0]):
        by_x, by_y = of_point[2 * a], of_point[2 * a + 1]
        xx += displacement[a, 0] * by_x
        xy += displacement[a, 0] * by_y
        yx += displacement[a, 1] * by_x
        yy += displacement[a, 1] * by_y
    return xx, xy, yx, yy


def plane_stress_at(material: Any, point: int, of_point: Floats, displacement: Floats) -> tuple[float, ...]:
    """Return minus the volume of a point of a cell times its stress, (xx, xy, yx, yy)."""
    stress = stress_2d(material, point, plane_gradient(of_point, displacement))
    volume = -of_point[2 * displacement.shape[0]]
    return volume * stress[0], volume * stress[1], volume * stress[2], volume * stress[3]


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
    xx, xy, yx, yy = plane_stress_at(material, first, geometry[0], displacement)
    for a in range(count):
        force[a, 0] = xx * geometry[0, 2 * a] + xy * geometry[0, 2 * a + 1]
        force[a, 1] = yx * geometry[0, 2 * a] + yy * geometry[0, 2 * a + 1]
    for q in range(1, geometry.shape[0]):
        xx, xy, yx, yy = plane_stress_at(material, first + q, geometry[q], displacement)
        for a in range(count):
            force[a, 0] += xx * geometry[q, 2 * a] + xy * geometry[q, 2 * a + 1]
            force[a, 1] += yx * geometry[q, 2 * a] + yy * geometry[q, 2 * a + 1]


def ring_stress_at(material: Any, point: int, of_point: Floats, displacement: Floats) -> tuple[float, ...]:
    """Return minus the volume of a point of a ring times its stress, (xx, xy, yx, yy, around)."""
    count, hoop = displacement.shape[0], 0.0
    xx, xy, yx, yy = plane_gradient(of_point, displacement)
    for a in range(count):
        hoop += displacement[a, 0] * of_point[2 * count + a]
    stress = stress_3d(material, point, (xx, xy, 0.0, yx, yy, 0.0, 0.0, 0.0, hoop))
    volume = -of_point[3 * count]
    return volume * stress[0], volume * stress[1], volume * stress[3], volume * stress[4], volume * stress[8]


def ring_forces(
    rule: Any,  # noqa: ARG001
    material: Any,
    first: int,
    section: float,  # noqa: ARG001 - the volumes contain the circumference
    geometry: Floats,
    displacement: Floats,
    force: Floats,
) -> None:
    """Set `force` as `plane_forces` does, of a ring; the hoop strain is the third direction of the gradient."""
    count = displacement.shape[0]
    for a in range(count):
        force[a, 0] = force[a, 1] = 0.0
    for q in range(geometry.shape[0]):
        xx, xy, yx, yy, hoop = ring_stress_at(material, first + q, geometry[q], displacement)
        for a in range(count):
            by_x, by_y = geometry[q, 2 * a], geometry[q, 2 * a + 1]
            force[a, 0] += xx * by_x + xy * by_y + hoop * geometry[q, 2 * count + a]
            force[a, 1] += yx * by_x + yy * by_y


def solid_gradient(of_point: Floats, displacement: Floats) -> tuple[float, ...]:
    """Return the displacement gradient at a point of a cell in three dimensions, row by row."""
    xx = xy = xz = yx = yy = yz = zx = zy = zz = 0.0
    for a in range(displacement.shape[0]):
        by_x, by_y, by_z = of_point[3 * a], of_point[3 * a + 1], of_point[3 * a + 2]
        x, y, z = displacement[a, 0], displacement[a, 1], displacement[a, 2]
        xx += x * by_x
        xy += x * by_y
        xz += x * by_z
        yx += y * by_x
        yy += y * by_y
        yz += y * by_z
        zx += z * by_x
        zy += z * by_y
        zz += z * by_z
    return xx, xy, xz, yx, yy, yz, zx, zy, zz


def solid_stress_at(material: Any, point: int, of_point: Floats, displacement: Floats) -> tuple[float, ...]:
    """Return minus the volume of a point of a cell times its stress in three dimensions, row by row."""
    s = stress_3d(material, point, solid_gradient(of_point, displacement))
    v = -of_point[3 * displacement.shape[0]]
    return v * s[0], v * s[1], v * s[2], v * s[3], v * s[4], v * s[5], v * s[6], v * s[7], v * s[8]


def solid_forces(
    rule: Any,  # noqa: ARG001
    material: Any,
    first: int,
    section: float,  # noqa: ARG001 - it is 1
    geometry: Floats,
    displacement: Floats,
    force: Floats,
) -> None:
    """Set `force` as `plane_forces` does, in three dimensions."""
    count = displacement.shape[0]
    for a in range(count):
        force[a, 0] = force[a, 1] = force[a, 2] = 0.0
    for q in range(geometry.shape[0]):
        xx, xy, xz, yx, yy, yz, zx, zy, zz = solid_stress_at(material, first + q, geometry[q], displacement)
        for a in range(count):
            by_x, by_y, by_z = geometry[q, 3 * a], geometry[q, 3 * a + 1], geometry[q, 3 * a + 2]
            force[a, 0] += xx * by_x + xy * by_y + xz * by_z
            force[a, 1] += yx * by_x + yy * by_y + yz * by_z
            force[a, 2] += zx * by_x + zy * by_y + zz * by_z
