"""Cells with one quadrature point, whose hourglass modes are held by some points more of the same material."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from percuss import Doc, Floats, Gt, Unit, stress_2d, stress_3d
from percuss_methods.elements._full_cell import FullCell, plane_gradient, solid_gradient

if TYPE_CHECKING:
    from percuss import BodyMesh


@dataclass(frozen=True)
class OnePointCell(FullCell, contract="elements"):
    """A cell whose strain is the mean over it, and which has the hourglass vectors of Flanagan and Belytschko.

    The slopes are means over the cell, so that the force of a uniform stress is that of the full rule. The
    control asks the material for the stress of a shear in proportion to the length of the hourglass displacement: it
    follows any material, and its stiffness is in the shear modulus.

    Attributes
    ----------
    modes : (modes, nodes) array
        Hourglass modes of the reference cell, each of 1 and -1; the kernels have these signs written out.
    """

    modes: ClassVar[Floats]

    hourglass: Annotated[float, Gt(0), Unit("1"), Doc("stiffness of the hourglass control")] = 0.05

    def geometry(self, body: BodyMesh) -> Floats:
        """Return the mean slopes of each node by each coordinate, the volume, and what makes the hourglass vectors.

        The vector of a mode h is ``s h_a - k . grad N_a``, with a size s and the vector ``k = s sum of h_b x_b``, which
        is zero in a parallelogram or parallelepiped.

        Returns
        -------
        (cells, nodes * dim + 2 + modes * dim) array
        """
        full, corners = super().geometry(body), body.mesh.nodes[body.mesh.cells[self.cell]]
        whole = full[..., -1].sum(axis=1)[:, None]
        mean = (full[..., -1:] * full[..., :-1]).sum(axis=1) / whole
        size = np.sqrt(self.hourglass * (mean**2).sum(axis=1))[:, None] / self.modes.shape[1]
        uneven = size * np.einsum("mn,cni->cmi", self.modes, corners).reshape(len(mean), -1)
        return np.concatenate([mean, whole, size, uneven], axis=1)

    def volumes(self, body: BodyMesh) -> Floats:
        """Return the volume of the cell for its point, and for each of those that hold an hourglass mode."""
        return np.tile(self.volumes_of_cells(body)[:, None], 1 + len(self.modes))

    def volumes_of_cells(self, body: BodyMesh) -> Floats:
        """Return the volume of each cell."""
        volumes: Floats = self._volumes(body).sum(axis=1)
        return volumes

    def mass_shares(self, body: BodyMesh) -> Floats:
        """Return those of the full rule."""
        volumes = self._volumes(body)
        shares: Floats = volumes @ self.shapes / volumes.sum(axis=1)[:, None]
        return shares


def plane_forces(
    rule: Any,  # noqa: ARG001
    material: Any,
    first: int,
    section: float,  # noqa: ARG001 - the volume contains it
    geometry: Floats,
    displacement: Floats,
    force: Floats,
) -> None:
    """Set `force` to the forces of a quadrilateral: those of its mean strain and of its hourglass mode."""
    volume, size, by_x, by_y, u = -geometry[8], geometry[9], geometry[10], geometry[11], displacement
    gradient = plane_gradient(geometry, u)
    mean = stress_2d(material, first, gradient)
    x = size * (u[0, 0] - u[1, 0] + (u[2, 0] - u[3, 0])) - (by_x * gradient[0] + by_y * gradient[1])
    y = size * (u[0, 1] - u[1, 1] + (u[2, 1] - u[3, 1])) - (by_x * gradient[2] + by_y * gradient[3])
    # The energy of such a shear depends on x^2 + y^2 alone if the material is isotropic: it turns with the cell.
    stress = stress_2d(material, first + 1, (x, y, y, -x))
    along, across = volume * (stress[0] - stress[3]), volume * (stress[1] + stress[2])
    xx, xy = volume * mean[0] - along * by_x, volume * mean[1] - along * by_y
    yx, yy = volume * mean[2] - across * by_x, volume * mean[3] - across * by_y
    for a in range(4):
        held = size if a % 2 == 0 else -size
        force[a, 0] = xx * geometry[2 * a] + xy * geometry[2 * a + 1] + along * held
        force[a, 1] = yx * geometry[2 * a] + yy * geometry[2 * a + 1] + across * held


def solid_forces(
    rule: Any,  # noqa: ARG001
    material: Any,
    first: int,
    section: float,  # noqa: ARG001 - it is 1
    geometry: Floats,
    displacement: Floats,
    force: Floats,
) -> None:
    """Set `force` as `plane_forces` does, in three dimensions: a shear for each of four hourglass modes."""
    v = -geometry[24]
    g = solid_gradient(geometry, displacement)
    s = stress_3d(material, first, g)
    x, y, z = modes_of(displacement, 0), modes_of(displacement, 1), modes_of(displacement, 2)
    a = shear_of_mode(material, first + 1, geometry, 26, g, (x[0], y[0], z[0]))
    b = shear_of_mode(material, first + 2, geometry, 29, g, (x[1], y[1], z[1]))
    c = shear_of_mode(material, first + 3, geometry, 32, g, (x[2], y[2], z[2]))
    d = shear_of_mode(material, first + 4, geometry, 35, g, (x[3], y[3], z[3]))
    set_component(force, 0, geometry, (v * s[0], v * s[1], v * s[2]), (a[0], b[0], c[0], d[0]))
    set_component(force, 1, geometry, (v * s[3], v * s[4], v * s[5]), (a[1], b[1], c[1], d[1]))
    set_component(force, 2, geometry, (v * s[6], v * s[7], v * s[8]), (a[2], b[2], c[2], d[2]))


def modes_of(u: Floats, d: int) -> tuple[float, float, float, float]:
    """Return the sums of a component of the displacement over the corners with the signs of each of the four modes."""
    # of the edges along xi at (eta, zeta) = (-, -), (+, -), (-, +) and (+, +) the sum and the difference
    one, two, three, four = u[0, d] + u[1, d], u[3, d] + u[2, d], u[4, d] + u[5, d], u[7, d] + u[6, d]
    p, q, r, s = u[1, d] - u[0, d], u[2, d] - u[3, d], u[5, d] - u[4, d], u[6, d] - u[7, d]
    return (one - two) - (three - four), (r + s) - (p + q), (q + s) - (p + r), (p - q) - (r - s)


def shear_of_mode(
    material: Any, point: int, geometry: Floats, at: int, g: tuple[float, ...], along: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return what a mode adds to the forces along its vector: minus the volume times the stress of a shear."""
    volume, size, by_x, by_y, by_z = -geometry[24], geometry[25], geometry[at], geometry[at + 1], geometry[at + 2]
    x = size * along[0] - (by_x * g[0] + by_y * g[1] + by_z * g[2])
    y = size * along[1] - (by_x * g[3] + by_y * g[4] + by_z * g[5])
    z = size * along[2] - (by_x * g[6] + by_y * g[7] + by_z * g[8])
    length = np.sqrt(x * x + y * y + z * z)
    if length == 0.0:
        return 0.0, 0.0, 0.0
    # The energy of such a shear depends on the length alone: it turns with the cell.
    s = stress_3d(material, point, (0.0, length, 0.0, length, 0.0, 0.0, 0.0, 0.0, 0.0))
    held = volume * (s[1] + s[3]) / length
    return held * x, held * y, held * z


def set_component(
    force: Floats, i: int, geometry: Floats, row: tuple[float, float, float], push: tuple[float, float, float, float]
) -> None:
    """Set a component of the forces: of a row of the stress, and of a force along the vector of each mode."""
    a, b, c, d = push
    x = row[0] - (a * geometry[26] + b * geometry[29] + c * geometry[32] + d * geometry[35])
    y = row[1] - (a * geometry[27] + b * geometry[30] + c * geometry[33] + d * geometry[36])
    z = row[2] - (a * geometry[28] + b * geometry[31] + c * geometry[34] + d * geometry[37])
    for n in range(8):
        force[n, i] = x * geometry[3 * n] + y * geometry[3 * n + 1] + z * geometry[3 * n + 2]
    a, b, c, d = geometry[25] * a, geometry[25] * b, geometry[25] * c, geometry[25] * d
    one, two, three, four = d - (b + c), c - (b + d), b - (c + d), (b + c) + d  # along xi, of the edges in turn
    force[0, i] += a - one
    force[1, i] += a + one
    force[3, i] -= a + two
    force[2, i] += two - a
    force[4, i] -= a + three
    force[5, i] += three - a
    force[7, i] += a - four
    force[6, i] += a + four
