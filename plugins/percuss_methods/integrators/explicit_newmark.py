"""The explicit member of Newmark's family, with numerical damping for gamma above 1/2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from percuss import Doc, Ge, Integrator, Le, Stages, Unit, accelerations
from percuss_methods.integrators._reasons import ENERGY_SWINGS

if TYPE_CHECKING:
    from percuss import Floats


class Weights(NamedTuple):
    """Weight of the new acceleration in the velocity."""

    gamma: float


@dataclass(frozen=True)
class ExplicitNewmark(Integrator):
    """Newmark's family with beta = 0, which needs no solution of equations.

    Formula: ``u_{n+1} = u_n + dt v_n + dt^2/2 a_n``, ``a_{n+1} = M^-1 (f_ext - f_int(u_{n+1}) + N lambda)``,
    ``v_{n+1} = v_n + dt ((1 - gamma) a_n + gamma a_{n+1})``.

    With gamma = 1/2 it is `velocity-verlet`, of second order and without damping. A larger gamma damps all frequencies
    and makes the scheme first order (`order` is that of the default). Stable without contact for
    ``omega dt <= sqrt(2 / gamma)``, a Courant number of ``1 / sqrt(2 gamma)``; the modes of ``omega dt`` up to
    ``2 / (gamma + 1/2)`` oscillate. Laws evaluated at the current state see u_{n+1}, laws evaluated at the end of the
    step the displacement u_{n+2}, and u_1 in the acceleration at t = 0.
    """

    name = "explicit-newmark"
    summary = "Newmark's family with beta = 0; damps for gamma above 1/2"
    references = (
        "Newmark: A method of computation for structural dynamics, J. Eng. Mech. Div. ASCE 85 (1959) 67-94",
        "Hughes: The Finite Element Method, Prentice-Hall 1987",
    )
    order = 2
    conserves = ("momentum",)
    critical_courant = 1.0
    kept = 1
    expected_failures = ENERGY_SWINGS

    gamma: Annotated[float, Ge(0.5), Le(1.0), Unit("1"), Doc("weight of the new acceleration; 1/2 does not damp")] = 0.5

    def bind(self, dt: float) -> Stages:
        """Return the stage at t_{n+1}, with the prediction of the displacement of the step that follows."""
        ahead = self.gamma + 0.5
        end = ((dt, ahead * dt**2, ahead * dt),)
        return Stages(times=(1.0,), numbers=Weights(self.gamma), end=end, start=(dt, 0.5 * dt**2, 0.5 * dt))

    @staticmethod
    def step(numbers: Weights, system: Any, u: Floats, v: Floats, kept: Floats, dt: float) -> None:
        """Advance u, v and the acceleration in place."""
        a = kept[0]
        u += dt * v + 0.5 * dt**2 * a
        v += (1.0 - numbers.gamma) * dt * a
        accelerations(system, 0, u, v, a)
        v += numbers.gamma * dt * a
