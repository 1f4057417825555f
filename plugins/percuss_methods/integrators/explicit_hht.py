"""The explicit predictor-corrector form of the alpha method of Hilber, Hughes and Taylor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from percuss import Doc, Ge, Integrator, Le, Stages, Unit, accelerations
from percuss_methods.integrators._reasons import DAMPING_SWINGS, reason_against_overlap

if TYPE_CHECKING:
    from percuss import Floats


class Weights(NamedTuple):
    """Shift of the balance, weights of the new acceleration, and of the old one in the velocity that contact sees."""

    alpha: float
    beta: float
    gamma: float
    shown: float


@dataclass(frozen=True)
class ExplicitHHT(Integrator):
    """Alpha method with the forces at a predicted displacement, so that it needs no solution of equations.

    Formula: ``u*_{n+1} = u_n + dt v_n + (1/2 - beta) dt^2 a_n``, ``v*_{n+1} = v_n + (1 - gamma) dt a_n``,
    ``a_{n+1} = M^-1 (f_ext - f_int(U) + N lambda)`` at ``U = (1 + alpha) u*_{n+1} - alpha u_n`` and the time
    t_{n+1+alpha}, ``u_{n+1} = u*_{n+1} + beta dt^2 a_{n+1}``, ``v_{n+1} = v*_{n+1} + gamma dt a_{n+1}``, with
    beta = (1 - alpha)^2/4 and gamma = 1/2 - alpha.

    The old displacement in U is the corrected one, u_n: with the predicted one, u*_n, low frequencies would grow.
    Stable without contact up to ``omega dt = 2 / sqrt(1 - alpha - 2 alpha^2 - alpha^3)``, a Courant number of .9618 for
    alpha = -.1. With alpha = 0 the displacements u* are those of `central-difference`. Laws evaluated at the current
    state see U, laws evaluated at the end of the step the U of the step that follows.
    """

    name = "explicit-hht"
    summary = "Alpha method of Hilber, Hughes and Taylor, explicit by its predictor"
    references = (
        "Hilber, Hughes, Taylor: Improved numerical dissipation for time integration algorithms in structural "
        "dynamics, Earthq. Eng. Struct. Dyn. 5 (1977) 283-292, doi 10.1002/eqe.4290050306",
        "Miranda, Ferencz, Hughes: An improved implicit-explicit time integration method for structural dynamics, "
        "Earthq. Eng. Struct. Dyn. 18 (1989) 643-653, doi 10.1002/eqe.4290180505",
    )
    order = 2
    conserves = ("momentum",)
    critical_courant = 0.9618
    kept = 1
    expected_failures = DAMPING_SWINGS

    alpha: Annotated[float, Ge(-1 / 3), Le(0.0), Unit("1"), Doc("0 does not damp, -1/3 damps the most")] = -0.1

    def bind(self, dt: float) -> Stages:
        """Return the stage at t_{n+1+alpha}, with the prediction of the displacement of the stage that follows."""
        alpha = self.alpha
        beta, gamma = 0.25 * (1.0 - alpha) ** 2, 0.5 - alpha
        ahead = beta + (1.0 + alpha) * (0.5 + gamma - beta)
        shown = (1.0 + alpha) * (1.0 - gamma) - alpha * (0.5 - beta)
        return Stages(
            times=(1.0 + alpha,),
            numbers=Weights(alpha, beta, gamma, shown),
            end=((dt, ahead * dt**2, ahead * dt),),
        )

    def refuses(self, law: Any) -> str | None:
        """Refuse laws that guarantee "no penetration"."""
        return reason_against_overlap(
            law,
            "it keeps a contact closed at a displacement within the step: the bodies overlap a little at its end",
        )

    @staticmethod
    def step(numbers: Weights, system: Any, u: Floats, v: Floats, kept: Floats, dt: float) -> None:
        """Advance u, v and the acceleration in place."""
        alpha, beta, gamma, shown = numbers
        a = kept[0]
        increment = dt * v + (0.5 - beta) * dt**2 * a
        # The displacement of the next stage depends on the old acceleration too: contact sees a velocity with its part.
        ahead = v + shown * dt * a
        v += (1.0 - gamma) * dt * a
        accelerations(system, 0, u + (1.0 + alpha) * increment, ahead, a)
        u += increment + beta * dt**2 * a
        v += gamma * dt * a
