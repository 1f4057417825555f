"""A compressible neo-Hookean material."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from percuss_methods.materials._hyperelastic import Hyperelastic

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class NeoHookean(Hyperelastic):
    """A compressible neo-Hookean material, for large strains and turns, as of rubber.

    Formula: ``P = mu (F - F^-T) + lambda ln J F^-T``, ``F = I + H``, ``J = det F``; the stored energy is ``mu (F : F -
    3) / 2 - mu ln J + lambda (ln J)^2 / 2``; lambda and mu as of `elastic`. In plane strain the stretch across is 1.

    The energy grows without bound as the volume goes to nothing.
    """

    name = "neo-hookean"
    summary = "Compressible neo-Hookean, for large strains"
    references = (
        "Bonet, Wood: Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed., Cambridge 2008, ch. 6.4.3, "
        "doi 10.1017/CBO9780511755446",
    )
    examples = ({"young": 1.0, "density": 1.0, "poisson": 0.3},)

    @staticmethod
    def stress_2d(parameters: Floats, gradient: tuple[float, ...]) -> tuple[float, ...]:
        """Return P of a displacement gradient in plane strain, (xx, xy, yx, yy)."""
        xx, xy, yx, yy = 1.0 + gradient[0], gradient[1], gradient[2], 1.0 + gradient[3]
        second, volume = parameters[1], xx * yy - xy * yx
        push = (parameters[0] * math.log(volume) - second) / volume
        return second * xx + push * yy, second * xy - push * yx, second * yx - push * xy, second * yy + push * xx

    @staticmethod
    def stored_2d(parameters: Floats, gradient: Floats) -> float:
        """Return the stored energy per volume in plane strain."""
        xx, xy, yx, yy = 1.0 + gradient[0], gradient[1], gradient[2], 1.0 + gradient[3]
        log = math.log(xx * yy - xy * yx)
        squares = xx * xx + xy * xy + yx * yx + yy * yy
        energy: float = parameters[1] * (0.5 * (squares - 2.0) - log) + 0.5 * parameters[0] * log * log
        return energy

    @staticmethod
    def stress_3d(parameters: Floats, gradient: tuple[float, ...]) -> tuple[float, ...]:
        """Return P of a displacement gradient, row by row."""
        xx, xy, xz = 1.0 + gradient[0], gradient[1], gradient[2]
        yx, yy, yz = gradient[3], 1.0 + gradient[4], gradient[5]
        zx, zy, zz = gradient[6], gradient[7], 1.0 + gradient[8]
        by_xx, by_xy, by_xz = yy * zz - yz * zy, yz * zx - yx * zz, yx * zy - yy * zx  # dJ / dF
        by_yx, by_yy, by_yz = xz * zy - xy * zz, xx * zz - xz * zx, xy * zx - xx * zy
        by_zx, by_zy, by_zz = xy * yz - xz * yy, xz * yx - xx * yz, xx * yy - xy * yx
        second, volume = parameters[1], xx * by_xx + xy * by_xy + xz * by_xz
        push = (parameters[0] * math.log(volume) - second) / volume
        return (
            second * xx + push * by_xx, second * xy + push * by_xy, second * xz + push * by_xz,
            second * yx + push * by_yx, second * yy + push * by_yy, second * yz + push * by_yz,
            second * zx + push * by_zx, second * zy + push * by_zy, second * zz + push * by_zz,
        )  # fmt: skip

    @staticmethod
    def stored_3d(parameters: Floats, gradient: Floats) -> float:
        """Return the stored energy per volume."""
        xx, xy, xz = 1.0 + gradient[0], gradient[1], gradient[2]
        yx, yy, yz = gradient[3], 1.0 + gradient[4], gradient[5]
        zx, zy, zz = gradient[6], gradient[7], 1.0 + gradient[8]
        log = math.log(xx * (yy * zz - yz * zy) + xy * (yz * zx - yx * zz) + xz * (yx * zy - yy * zx))
        squares = xx * xx + xy * xy + xz * xz + yx * yx + yy * yy + yz * yz + zx * zx + zy * zy + zz * zz
        energy: float = parameters[1] * (0.5 * (squares - 3.0) - log) + 0.5 * parameters[0] * log * log
        return energy
