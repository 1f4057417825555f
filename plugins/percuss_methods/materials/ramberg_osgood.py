"""The curve of Ramberg and Osgood."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from percuss import Doc, Gt, Material, Unit

if TYPE_CHECKING:
    from percuss import Floats

MOST_ITERATIONS = 100  # of Newton's method; far fewer are needed with any parameters


def reduced_stress(alpha: float, exponent: float, reduced_strain: float) -> float:
    """Return the solution ``x >= 0`` of ``x + alpha x^exponent = y`` for a number ``y >= 0``.

    The left side is convex. Newton's method from a number above the solution therefore falls towards it and never
    passes it; the two numbers of which it begins at the smaller are those at which one of the two terms alone is y.
    """
    if reduced_strain == 0.0:
        return 0.0
    x = min(reduced_strain, (reduced_strain / alpha) ** (1.0 / exponent))
    for _ in range(MOST_ITERATIONS):
        power = alpha * x ** (exponent - 1.0)
        following = x - (x + power * x - reduced_strain) / (1.0 + exponent * power)
        if not following < x:  # No further fall: what is left is round-off.
            break
        x = following
    return x


@dataclass(frozen=True)
class RambergOsgood(Material):
    """A curve of stress and strain that bends over smoothly, the same while loading and unloading.

    Formula: ``strain = stress / E + alpha (stress / E) (|stress| / s_0)^(exponent - 1)``; at the stress s_0 the second
    part is alpha times the first one.

    This is the deformation theory: non-linear elastic, a model of plasticity while the strain grows. Unloading follows
    the same curve back and dissipates nothing. The stress for a strain is found by Newton's method to round-off. Waves
    run at ``sqrt(E_t / density)`` with the tangent modulus ``E_t = E / (1 + alpha exponent (|stress| / s_0)^(exponent -
    1))``, which falls from E: where the stress grows, waves spread out, and where it falls they steepen. The energy
    density is the exact integral ``stress^2 / (2 E) + alpha exponent / (exponent + 1) (|stress| / s_0)^(exponent - 1)
    stress^2 / E``.
    """

    name = "ramberg-osgood"
    summary = "Curve of Ramberg and Osgood, non-linear elastic"
    references = (
        "Ramberg, Osgood: Description of stress-strain curves by three parameters, NACA Technical Note 902 (1943)",
    )
    examples = (
        {"young": 100.0, "density": 0.01, "yield_stress": 0.02},
        {"young": 100.0, "density": 0.01, "yield_stress": 0.05, "alpha": 0.5, "exponent": 2.5},
    )

    young: Annotated[float, Gt(0), Unit("force/length^2"), Doc("E, the slope at rest")]
    density: Annotated[float, Gt(0), Unit("mass/length^3"), Doc("density")]
    yield_stress: Annotated[float, Gt(0), Unit("force/length^2"), Doc("s_0, about which the curve bends over")]
    alpha: Annotated[float, Gt(0), Unit("1"), Doc("additional strain at s_0, over s_0 / E")] = 3.0 / 7.0
    exponent: Annotated[float, Gt(1), Unit("1"), Doc("the larger, the sharper the bend")] = 5.0

    @property
    def rho(self) -> float:
        """Density."""
        return self.density

    @property
    def modulus(self) -> float:
        """Modulus at rest, which is the largest."""
        return self.young

    def parameters(self) -> tuple[float, ...]:
        """Return E, s_0, alpha and the exponent."""
        return (self.young, self.yield_stress, self.alpha, self.exponent)

    @staticmethod
    def stress(parameters: Floats, strain: float) -> float:
        """Return the stress on the curve at a strain."""
        young, scale, alpha, exponent = parameters
        value = scale * reduced_stress(alpha, exponent, young * abs(strain) / scale)
        return value if strain > 0.0 else -value

    @staticmethod
    def energy_density(parameters: Floats, before: float, after: float) -> float:
        """Return the mean of the integrals at both strains, less a quarter of the product of both differences.

        That is what the internal work of the steps, as the ledger counts it, adds up to.
        """
        young, scale, alpha, exponent = parameters
        first = reduced_stress(alpha, exponent, young * abs(before) / scale)
        second = reduced_stress(alpha, exponent, young * abs(after) / scale)
        share = alpha * exponent / (exponent + 1.0)
        mean = 0.5 * (0.5 * first**2 + share * first ** (exponent + 1.0))
        mean += 0.5 * (0.5 * second**2 + share * second ** (exponent + 1.0))
        change = (second if after > 0.0 else -second) - (first if before > 0.0 else -first)
        return scale**2 / young * mean - 0.25 * scale * change * (after - before)
