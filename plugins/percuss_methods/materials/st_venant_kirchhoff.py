"""Hooke's law of Green's strain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from percuss_methods.materials._hyperelastic import Hyperelastic

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class StVenantKirchhoff(Hyperelastic):
    """Hooke's law between Green's strain and the second Piola-Kirchhoff stress.

    Formula: ``P = F S``, ``S = lambda tr(E) I + 2 mu E``, ``E = (H + H^T + H^T H) / 2``, ``F = I + H``; the stored
    energy is ``lambda tr(E)^2 / 2 + mu E : E``; lambda and mu as of `elastic`. In plane strain the strain across is 0.

    It turns with a body, and suits large turns with small strains. Compressed below 0.577 of its length (1 over the
    root of 3) it gets softer the more it is compressed, and cells turn inside out.
    """

    name = "st-venant-kirchhoff"
    summary = "Hooke's law of Green's strain, for large turns with small strains"
    references = (
        "Bonet, Wood: Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed., Cambridge 2008, ch. 6, "
        "doi 10.1017/CBO9780511755446",
    )
    examples = ({"young": 1.0, "density": 1.0, "poisson": 0.3},)

    @staticmethod
    def stress_2d(parameters: Floats, gradient: tuple[float, ...]) -> tuple[float, ...]:
        """Return P of a displacement gradient in plane strain, (xx, xy, yx, yy)."""
        xx, xy, yx, yy = gradient
        e_xx, e_yy = xx + 0.5 * (xx * xx + yx * yx), yy + 0.5 * (xy * xy + yy * yy)
        mean, s_xy = parameters[0] * (e_xx + e_yy), parameters[1] * (xy + yx + xx * xy + yx * yy)
        s_xx, s_yy = mean + 2.0 * parameters[1] * e_xx, mean + 2.0 * parameters[1] * e_yy
        return (
            s_xx + xx * s_xx + xy * s_xy, s_xy + xx * s_xy + xy * s_yy,
            s_xy + yx * s_xx + yy * s_xy, s_yy + yx * s_xy + yy * s_yy,
        )  # fmt: skip

    @staticmethod
    def stored_2d(parameters: Floats, gradient: Floats) -> float:
        """Return the stored energy per volume in plane strain."""
        xx, xy, yx, yy = gradient[0], gradient[1], gradient[2], gradient[3]
        e_xx, e_yy = xx + 0.5 * (xx * xx + yx * yx), yy + 0.5 * (xy * xy + yy * yy)
        twice = xy + yx + xx * xy + yx * yy
        squares = e_xx * e_xx + e_yy * e_yy + 0.5 * twice * twice
        energy: float = 0.5 * parameters[0] * (e_xx + e_yy) ** 2 + parameters[1] * squares
        return energy

    @staticmethod
    def stress_3d(parameters: Floats, gradient: tuple[float, ...]) -> tuple[float, ...]:
        """Return P of a displacement gradient, row by row."""
        xx, xy, xz, yx, yy, yz, zx, zy, zz = gradient
        e_xx = xx + 0.5 * (xx * xx + yx * yx + zx * zx)
        e_yy = yy + 0.5 * (xy * xy + yy * yy + zy * zy)
        e_zz = zz + 0.5 * (xz * xz + yz * yz + zz * zz)
        mean, second = parameters[0] * (e_xx + e_yy + e_zz), parameters[1]
        s_xx, s_yy, s_zz = mean + 2.0 * second * e_xx, mean + 2.0 * second * e_yy, mean + 2.0 * second * e_zz
        s_xy = second * (xy + yx + xx * xy + yx * yy + zx * zy)
        s_xz = second * (xz + zx + xx * xz + yx * yz + zx * zz)
        s_yz = second * (yz + zy + xy * xz + yy * yz + zy * zz)
        return (
            s_xx + xx * s_xx + xy * s_xy + xz * s_xz, s_xy + xx * s_xy + xy * s_yy + xz * s_yz,
            s_xz + xx * s_xz + xy * s_yz + xz * s_zz, s_xy + yx * s_xx + yy * s_xy + yz * s_xz,
            s_yy + yx * s_xy + yy * s_yy + yz * s_yz, s_yz + yx * s_xz + yy * s_yz + yz * s_zz,
            s_xz + zx * s_xx + zy * s_xy + zz * s_xz, s_yz + zx * s_xy + zy * s_yy + zz * s_yz,
            s_zz + zx * s_xz + zy * s_yz + zz * s_zz,
        )  # fmt: skip

    @staticmethod
    def stored_3d(parameters: Floats, gradient: Floats) -> float:
        """Return the stored energy per volume."""
        trace, squares = 0.0, 0.0
        for i in range(3):
            for j in range(3):
                twice = gradient[3 * i + j] + gradient[3 * j + i]
                for k in range(3):
                    twice += gradient[3 * k + i] * gradient[3 * k + j]
                squares += 0.25 * twice * twice
                trace += 0.5 * twice if i == j else 0.0
        energy: float = 0.5 * parameters[0] * trace * trace + parameters[1] * squares
        return energy
