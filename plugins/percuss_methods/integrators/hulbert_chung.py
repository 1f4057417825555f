"""The explicit generalised alpha method of Hulbert and Chung, with a prescribed damping of high frequencies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np

from percuss import Doc, Ge, Integrator, Le, Stages, Unit, accelerations
from percuss_methods.integrators._reasons import DAMPING_SWINGS, reason_against_pulling

if TYPE_CHECKING:
    from percuss import Floats


class Weights(NamedTuple):
    """Weight of the old acceleration in the balance, and of the new one in displacement and velocity."""

    alpha: float
    beta: float
    gamma: float


@dataclass(frozen=True)
class HulbertChung(Integrator):
    """Explicit generalised alpha method: the spectral radius where the roots meet, rho_b, is chosen.

    Formula: ``(1 - alpha) a_{n+1} + alpha a_n = M^-1 (f_ext - f_int(u_n) + N lambda)``,
    ``u_{n+1} = u_n + dt v_n + dt^2 ((1/2 - beta) a_n + beta a_{n+1})``,
    ``v_{n+1} = v_n + dt ((1 - gamma) a_n + gamma a_{n+1})``, with alpha = (2 rho_b - 1)/(1 + rho_b),
    beta = (5 - 3 rho_b)/((1 + rho_b)^2 (2 - rho_b)) and gamma = 3/2 - alpha.

    The roots meet at ``omega dt = (1 + rho_b) sqrt(2 - rho_b)``; stable without contact up to ``omega dt = sqrt(12 (1 +
    rho_b) (2 - rho_b) / (10 - 5 rho_b + rho_b^2))``, a Courant number of .9075 for rho_b = .4. The leading error of the
    period vanishes at rho_b = .3665. With rho_b = 1/2 the scheme is `chung-lee` with beta = 28/27; with rho_b = 1 the
    displacements are those of `central-difference`, and a disturbance of the velocity changes its sign in every step
    and never decays. The reported contact force is the impulse of a step over dt, a sum of the multipliers of this step
    and of earlier steps with weights of both signs: it may pull after a contact has opened. Laws evaluated at the
    current state see u_n, laws evaluated at the end of the step u_{n+1}.
    """

    name = "hulbert-chung"
    summary = "Hulbert-Chung: explicit generalised alpha, damping chosen by rho_b"
    references = (
        "Hulbert, Chung: Explicit time integration algorithms for structural dynamics with optimal numerical "
        "dissipation, CMAME 137 (1996) 175-188, doi 10.1016/S0045-7825(96)01036-5",
    )
    examples = ({}, {"rho_b": 0.8})
    order = 2
    conserves = ("momentum",)
    critical_courant = 0.9075
    kept = 1
    expected_failures = DAMPING_SWINGS

    rho_b: Annotated[float, Ge(0.0), Le(1.0), Unit("1"), Doc("least spectral radius; 1 does not damp")] = 0.4

    def bind(self, dt: float) -> Stages:
        """Return the stage at t_n, with the prediction of the displacement at t_{n+1}."""
        rho = self.rho_b
        alpha = (2.0 * rho - 1.0) / (1.0 + rho)
        beta = (5.0 - 3.0 * rho) / ((1.0 + rho) ** 2 * (2.0 - rho))
        ahead = beta / (1.0 - alpha)
        return Stages(times=(0.0,), numbers=Weights(alpha, beta, 1.5 - alpha), end=((dt, ahead * dt**2, ahead * dt),))

    def refuses(self, law: Any) -> str | None:
        """Refuse laws that guarantee "never pulls"."""
        return reason_against_pulling(law)

    @staticmethod
    def step(numbers: Weights, system: Any, u: Floats, v: Floats, kept: Floats, dt: float) -> None:
        """Advance u, v and the acceleration in place."""
        alpha, beta, gamma = numbers
        a = np.empty_like(u)
        # The coming displacement depends on the kept acceleration too: it goes into the velocity that contact sees.
        accelerations(system, 0, u, v + (0.5 - beta - beta * alpha / (1.0 - alpha)) * dt * kept[0], a)
        a -= alpha * kept[0]
        a /= 1.0 - alpha
        u += dt * v + dt**2 * ((0.5 - beta) * kept[0] + beta * a)
        v += dt * ((1.0 - gamma) * kept[0] + gamma * a)
        kept[0] = a
