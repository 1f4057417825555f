"""Linear elasticity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from percuss import Doc, Gt, Lt, OptionError, SolidMaterial, Unit

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class Elastic(SolidMaterial):
    """Hooke's law.

    Formula: of a bar ``stress = young strain``, waves run at ``c = sqrt(young / density)``; of a body in two or three
    dimensions ``stress = lambda tr(strain) I + 2 mu strain``, ``lambda = young nu / ((1 + nu)(1 - 2 nu))``, ``mu =
    young / (2 (1 + nu))``, and longitudinal waves run at ``sqrt((lambda + 2 mu) / density)``. In plane stress lambda is
    ``young nu / (1 - nu^2)``.

    A bar has no use for Poisson's ratio nu; any other body needs it. Strains are small.
    """

    name = "elastic"
    summary = "Linear elastic"
    linear = True
    examples = ({"young": 100.0, "density": 0.01}, {"young": 100.0, "density": 0.01, "poisson": 0.3})

    young: Annotated[float, Gt(0), Unit("force/length^2"), Doc("Young's modulus")]
    density: Annotated[float, Gt(0), Unit("mass/length^3"), Doc("density")]
    poisson: Annotated[float, Gt(-1), Lt(0.5), Unit("1"), Doc("Poisson's ratio, of bodies that are no bars")] | None = (
        None
    )

    @property
    def rho(self) -> float:
        """Density."""
        return self.density

    @property
    def modulus(self) -> float:
        """Young's modulus."""
        return self.young

    def wave_modulus(self, plane: str) -> float:
        """Return lambda + 2 mu."""
        first, second = self.solid_parameters(plane)
        return first + 2.0 * second

    def parameters(self) -> tuple[float, ...]:
        """Return (young,)."""
        return (self.young,)

    def solid_parameters(self, plane: str) -> tuple[float, ...]:
        """Return (lambda, mu)."""
        if self.poisson is None:
            raise OptionError("missing (a body that is no bar needs Poisson's ratio)", "poisson")
        nu = self.poisson
        first = self.young * nu / ((1.0 - nu**2) if plane == "stress" else (1.0 + nu) * (1.0 - 2.0 * nu))
        return first, 0.5 * self.young / (1.0 + nu)

    @staticmethod
    def stress(parameters: Floats, strain: float) -> float:
        """Return ``young * strain``."""
        return parameters[0] * strain

    @staticmethod
    def energy_density(parameters: Floats, before: float, after: float) -> float:
        """Return half the product of the two strains times Young's modulus."""
        return 0.5 * parameters[0] * before * after

    @staticmethod
    def stress_2d(parameters: Floats, gradient: tuple[float, ...]) -> tuple[float, ...]:
        """Return the stress of the symmetric part of a displacement gradient, (xx, xy, yx, yy)."""
        xx, xy, yx, yy = gradient
        mean, twice = parameters[0] * (xx + yy), 2.0 * parameters[1]
        shear = parameters[1] * (xy + yx)
        return mean + twice * xx, shear, shear, mean + twice * yy

    @staticmethod
    def stress_3d(parameters: Floats, gradient: tuple[float, ...]) -> tuple[float, ...]:
        """Return the stress of the symmetric part of a displacement gradient, row by row."""
        xx, xy, xz, yx, yy, yz, zx, zy, zz = gradient
        mean, second = parameters[0] * (xx + yy + zz), parameters[1]
        s_xy, s_xz, s_yz = second * (xy + yx), second * (xz + zx), second * (yz + zy)
        return (
            mean + 2.0 * second * xx, s_xy, s_xz, s_xy, mean + 2.0 * second * yy, s_yz, s_xz, s_yz,
            mean + 2.0 * second * zz,
        )  # fmt: skip
