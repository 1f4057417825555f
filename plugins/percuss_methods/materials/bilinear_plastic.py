"""Bilinear plasticity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from percuss import Doc, Ge, Gt, Le, Lt, Material, Unit

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class BilinearPlastic(Material):
    """Elastic up to a yield stress, then plastic with linear hardening.

    Formula: ``stress = E (strain - p)``; the plastic strain p changes only where ``|stress - k| = Y + i``, such that
    the tangent modulus is ``E_t = tangent E``. Of the hardening modulus ``H = E E_t / (E - E_t)`` the share `kinematic`
    moves the elastic range, ``k = kinematic H p``, and the rest widens it, ``i = (1 - kinematic) H |dp|`` summed up.

    Each step returns to the yield stress exactly, as both hardenings are linear. Elastic waves run at ``c = sqrt(E /
    density)``, plastic ones at ``sqrt(E_t / density)``. The stored energy is the elastic energy ``stress^2 / (2 E)``
    and that of kinematic hardening, ``kinematic H p^2 / 2``; the rest of the plastic work is dissipated.
    """

    name = "bilinear-plastic"
    summary = "Elastic, plastic with linear hardening"
    references = ("Simo, Hughes: Computational Inelasticity, Springer 1998, ch. 1, doi 10.1007/b98904",)
    examples = (
        {"young": 100.0, "density": 0.01, "yield_stress": 0.02},
        {"young": 100.0, "density": 0.01, "yield_stress": 0.02, "tangent": 0.2, "kinematic": 0.0},
    )
    state = 4  # plastic strain, its sum without sign, energy stored and energy dissipated per volume
    stored_in = 2
    dissipated_in = 3

    young: Annotated[float, Gt(0), Unit("force/length^2"), Doc("Young's modulus")]
    density: Annotated[float, Gt(0), Unit("mass/length^3"), Doc("density")]
    yield_stress: Annotated[float, Gt(0), Unit("force/length^2"), Doc("Y, at which plastic strain begins")]
    tangent: Annotated[float, Ge(0), Lt(1), Unit("1"), Doc("E_t over E")] = 0.1
    kinematic: Annotated[float, Ge(0), Le(1), Unit("1"), Doc("share of kinematic hardening")] = 1.0

    @property
    def rho(self) -> float:
        """Density."""
        return self.density

    @property
    def modulus(self) -> float:
        """Young's modulus."""
        return self.young

    @property
    def elsewhere(self) -> str:
        """What to take for solids."""
        hardening = self.young * self.tangent / (1.0 - self.tangent)
        return f"Take j2-plastic with `hardening: {hardening:.6g}`, E t / (1 - t) of the tangent t, and a `poisson`."

    def parameters(self) -> tuple[float, ...]:
        """Return E, Y, and the moduli of kinematic and of isotropic hardening."""
        hardening = self.young * self.tangent / (1.0 - self.tangent)
        return (self.young, self.yield_stress, self.kinematic * hardening, (1.0 - self.kinematic) * hardening)

    @staticmethod
    def stress(parameters: Floats, strain: float, before: Floats, after: Floats) -> float:
        """Return the stress, and set plastic strain and energies."""
        young, limit, kinematic, isotropic = parameters
        relative = young * (strain - before[0]) - kinematic * before[0]
        excess = abs(relative) - limit - isotropic * before[1]
        plastic, total = before[0], before[1]
        if excess > 0.0:
            increment = excess / (young + kinematic + isotropic)
            plastic += increment if relative > 0.0 else -increment
            total += increment
        value = young * (strain - plastic)
        # Of the plastic work ``stress dp`` the part ``k dp`` is stored; both grow linearly between the ends of a step.
        work = (limit + 0.5 * isotropic * (before[1] + total)) * (total - before[1])
        after[0] = plastic
        after[1] = total
        after[2] = 0.5 * value**2 / young + 0.5 * kinematic * plastic**2
        after[3] = before[3] + work
        return value
