"""Isotropic materials of finite strain, which are Hooke's at rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from percuss import Doc, Gt, Lt, OptionError, SolidMaterial, Unit


@dataclass(frozen=True)
class Hyperelastic(SolidMaterial, contract="materials"):
    """A material of finite strain with the constants of Hooke's law at rest; in plane stress it does not work."""

    young: Annotated[float, Gt(0), Unit("force/length^2"), Doc("Young's modulus at rest")]
    density: Annotated[float, Gt(0), Unit("mass/length^3"), Doc("density at rest")]
    poisson: Annotated[float, Gt(-1), Lt(0.5), Unit("1"), Doc("Poisson's ratio at rest")]

    @property
    def rho(self) -> float:
        """Density at rest."""
        return self.density

    def wave_modulus(self, plane: str) -> float:
        """Return lambda + 2 mu."""
        first, second = self.solid_parameters(plane)
        return first + 2.0 * second

    def solid_parameters(self, plane: str) -> tuple[float, ...]:
        """Return (lambda, mu)."""
        if plane == "stress":
            raise OptionError("works in plane strain, in space and about an axis, not in plane stress", "name")
        nu = self.poisson
        return self.young * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), 0.5 * self.young / (1.0 + nu)
