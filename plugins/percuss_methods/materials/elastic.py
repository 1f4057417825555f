"""Linear elasticity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from percuss import Doc, Gt, Material, Unit

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class Elastic(Material):
    """Hooke's law.

    Formula: ``stress = young strain``; waves run at ``c = sqrt(young / density)``.
    """

    name = "elastic"
    summary = "Linear elastic"
    linear = True
    examples = ({"young": 100.0, "density": 0.01},)

    young: Annotated[float, Gt(0), Unit("force/length^2"), Doc("Young's modulus")]
    density: Annotated[float, Gt(0), Unit("mass/length^3"), Doc("density")]

    @property
    def rho(self) -> float:
        """Density."""
        return self.density

    @property
    def modulus(self) -> float:
        """Young's modulus."""
        return self.young

    def parameters(self) -> tuple[float, ...]:
        """Return (young,)."""
        return (self.young,)

    @staticmethod
    def stress(parameters: Floats, strain: float) -> float:
        """Return ``young * strain``."""
        return parameters[0] * strain

    @staticmethod
    def energy_density(parameters: Floats, before: float, after: float) -> float:
        """Return half the product of the two strains times Young's modulus."""
        return 0.5 * parameters[0] * before * after
