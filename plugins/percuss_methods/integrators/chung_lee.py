"""The explicit scheme of Chung and Lee, second order with damping of high frequencies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np

from percuss import Doc, Ge, Integrator, Le, Stages, Unit, accelerations
from percuss_methods.integrators._reasons import DAMPING_SWINGS, reason_against_pulling

if TYPE_CHECKING:
    from percuss import Floats


class Weights(NamedTuple):
    """Weight of the acceleration in the displacement."""

    beta: float


@dataclass(frozen=True)
class ChungLee(Integrator):
    """Second-order scheme with damping, from the accelerations of the present and the last step.

    Formula: ``a_n = M^-1 (f_ext - f_int(u_n) + N lambda)``,
    ``u_{n+1} = u_n + dt v_n + dt^2 ((1/2 - beta) a_{n-1} + beta a_n)``,
    ``v_{n+1} = v_n + dt (3/2 a_n - 1/2 a_{n-1})``, started with a_{-1} = a_0. In the paper a_n is called a_{n+1}.

    With beta = 1 its displacements are those of `central-difference`, without damping. Stable without contact up to
    ``omega dt = 2 / sqrt(4 beta - 3)``, a Courant number of .9333 for beta = 28/27, the largest: there the spectral
    radius falls to 1/2, where all three roots meet, at ``omega dt = sqrt(27/8)``. The reported contact force is the
    impulse of a step over dt, ``3/2 lambda_n - 1/2 lambda_{n-1}``; it may pull after a contact has opened. Laws
    evaluated at the current state see u_n, laws evaluated at the end of the step u_{n+1}.
    """

    name = "chung-lee"
    summary = "Chung-Lee: second order, damps high frequencies for beta above 1"
    references = (
        "Chung, Lee: A new family of explicit time integration methods for linear and non-linear structural dynamics, "
        "IJNME 37 (1994) 3961-3976, doi 10.1002/nme.1620372303",
    )
    order = 2
    conserves = ("momentum",)
    critical_courant = 0.9333
    kept = 1
    expected_failures = DAMPING_SWINGS

    beta: Annotated[float, Ge(1.0), Le(28 / 27), Unit("1"), Doc("1 does not damp, 28/27 damps the most")] = 28 / 27

    def bind(self, dt: float) -> Stages:
        """Return the stage at t_n, with the prediction of the displacement at t_{n+1}."""
        return Stages(times=(0.0,), numbers=Weights(self.beta), end=((dt, self.beta * dt**2, self.beta * dt),))

    def refuses(self, law: Any) -> str | None:
        """Refuse laws that guarantee "never pulls"."""
        return reason_against_pulling(law)

    @staticmethod
    def step(numbers: Weights, system: Any, u: Floats, v: Floats, kept: Floats, dt: float) -> None:
        """Advance u, v and the acceleration of the last step in place."""
        a = np.empty_like(u)
        # The coming displacement depends on the kept acceleration too: it goes into the velocity that contact sees.
        ahead = v + (0.5 - numbers.beta) * dt * kept[0]
        accelerations(system, 0, u, ahead, a)
        u += dt * ahead + numbers.beta * dt**2 * a
        v += dt * (1.5 * a - 0.5 * kept[0])
        kept[0] = a
