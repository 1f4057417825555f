"""The one-step scheme of Tchamwa and Wielgosz, which damps the frequencies that the mesh cannot resolve."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np

from percuss import Doc, Ge, Integrator, Le, Stages, Unit, accelerations
from percuss_methods.integrators._reasons import DAMPING_SWINGS

if TYPE_CHECKING:
    from percuss import Floats


class Weights(NamedTuple):
    """Weight of the acceleration in the displacement."""

    phi: float


@dataclass(frozen=True)
class TchamwaWielgosz(Integrator):
    """One-step scheme that damps the highest frequencies most and needs only the state at t_n.

    Formula: ``a_n = M^-1 (f_ext - f_int(u_n) + N lambda)``, ``u_{n+1} = u_n + dt v_n + phi dt^2 a_n``,
    ``v_{n+1} = v_n + dt a_n``.

    First order, also for phi = 1, whose displacements are those of a central difference that starts with
    ``v_{-1/2} = v_0``; a load that acts at t = 0 counts for half a step too long. The two roots meet at
    ``omega dt = 2 / phi`` with the least spectral radius, ``2 / phi - 1``; stable without contact up to
    ``omega dt = 2 / sqrt(2 phi - 1)``, which is larger: a Courant number of .9685 for phi = 1.033. Laws evaluated at
    the current state see u_n, laws evaluated at the end of the step u_{n+1}.
    """

    name = "tchamwa-wielgosz"
    summary = "Tchamwa-Wielgosz: one step, first order, damps high frequencies for phi above 1"
    references = (
        "Tchamwa, Conway, Wielgosz: An accurate explicit direct time integration method, ASME PVP 398 (1999)",
    )
    order = 1
    conserves = ("momentum",)
    critical_courant = 0.9685
    expected_failures = DAMPING_SWINGS

    phi: Annotated[float, Ge(1.0), Le(2.0), Unit("1"), Doc("weight of the acceleration; 1 does not damp")] = 1.033

    def bind(self, dt: float) -> Stages:
        """Return the stage at t_n, with the prediction of the displacement at t_{n+1}."""
        return Stages(times=(0.0,), numbers=Weights(self.phi), end=((dt, self.phi * dt**2, self.phi * dt),))

    @staticmethod
    def step(numbers: Weights, system: Any, u: Floats, v: Floats, kept: Floats, dt: float) -> None:  # noqa: ARG004
        """Advance u and v in place."""
        a = np.empty_like(u)
        accelerations(system, 0, u, v, a)
        u += dt * v + numbers.phi * dt**2 * a
        v += dt * a
