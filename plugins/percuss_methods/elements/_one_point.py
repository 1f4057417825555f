"""Cells with one quadrature point, whose hourglass modes are held by some points more of the same material."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from percuss import Doc, Floats, Gt, Unit, stress_2d, stress_3d
from percuss_methods.elements._full_cell import FullCell, plane_stress_at, solid_stress_at

if TYPE_CHECKING:
    from percuss import BodyMesh


@dataclass(frozen=True)
class OnePointCell(FullCell, contract="elements"):
    """A cell whose strain is the mean over it, and which has the hourglass vectors of Flanagan and Belytschko.

    The slopes are means over the cell, so that the force of a uniform stress is that of the full rule. The
    control asks the material for the stress of a shear that is proportional to the hourglass displacement: it
    follows any material, and its stiffness is in the shear modulus.

    Attributes
    ----------
    modes : (modes, nodes) array
        Hourglass modes of the reference cell, each of 1 and -1.
    """

    modes: ClassVar[Floats]

    hourglass: Annotated[float, Gt(0), Unit("1"), Doc("stiffness of the hourglass control")] = 0.05

    def geometry(self, body: BodyMesh) -> Floats:
        """Return the mean slopes of each node by each coordinate, the volume, and the scaled hourglass vectors.

        Returns
        -------
        (cells, nodes * dim + 1 + modes * nodes) array
        """
        full, corners = super().geometry(body), body.mesh.nodes[body.mesh.cells[self.cell]]
        whole = full[..., -1].sum(axis=1)[:, None]
        mean = (full[..., -1:] * full[..., :-1]).sum(axis=1) / whole
        uniform = np.einsum("mn,cni,cai->cma", self.modes, corners, mean.reshape(corners.shape))
        size = np.sqrt(self.hourglass * (mean**2).sum(axis=1))
        vectors = size[:, None, None] * (self.modes - uniform) / self.modes.shape[1]
        return np.concatenate([mean, whole, vectors.reshape(len(mean), -1)], axis=1)

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
    xx, xy, yx, yy = plane_stress_at(material, first, geometry, displacement)
    volume, x, y = geometry[8], 0.0, 0.0
    for a in range(4):
        x += geometry[9 + a] * displacement[a, 0]
        y += geometry[9 + a] * displacement[a, 1]
    # The energy of such a shear depends on x^2 + y^2 alone if the material is isotropic: it turns with the cell.
    stress = stress_2d(material, first + 1, (x, y, y, -x))
    along, across = -volume * (stress[0] - stress[3]), -volume * (stress[1] + stress[2])
    for a in range(4):
        by_x, by_y, held = geometry[2 * a], geometry[2 * a + 1], geometry[9 + a]
        force[a, 0] = xx * by_x + xy * by_y + along * held
        force[a, 1] = yx * by_x + yy * by_y + across * held


def solid_forces(
    rule: Any,  # noqa: ARG001
    material: Any,
    first: int,
    section: float,  # noqa: ARG001 - it is 1
    geometry: Floats,
    displacement: Floats,
    force: Floats,
) -> None:
    """Set `force` as `plane_forces` does, in three dimensions: three shears for each of four hourglass modes."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = solid_stress_at(material, first, geometry, displacement)
    volume = geometry[24]
    for a in range(8):
        by_x, by_y, by_z = geometry[3 * a], geometry[3 * a + 1], geometry[3 * a + 2]
        force[a, 0] = xx * by_x + xy * by_y + xz * by_z
        force[a, 1] = yx * by_x + yy * by_y + yz * by_z
        force[a, 2] = zx * by_x + zy * by_y + zz * by_z
    for mode in range(4):
        start, x, y, z = 25 + 8 * mode, 0.0, 0.0, 0.0
        for a in range(8):
            held = geometry[start + a]
            x += held * displacement[a, 0]
            y += held * displacement[a, 1]
            z += held * displacement[a, 2]
        stress = stress_3d(material, first + 1 + mode, (0.0, x, y, x, 0.0, z, y, z, 0.0))
        push = -volume * (stress[1] + stress[3])
        lift = -volume * (stress[2] + stress[6])
        turn = -volume * (stress[5] + stress[7])
        for a in range(8):
            held = geometry[start + a]
            force[a, 0] += push * held
            force[a, 1] += lift * held
            force[a, 2] += turn * held
