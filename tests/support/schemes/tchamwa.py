"""The scheme of Tchamwa and Wielgosz."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from percuss import Gt, Integrator, Le, Stages, Unit, accelerations


@dataclass(frozen=True)
class Tchamwa(Integrator):
    """Tchamwa and Wielgosz; rho is the spectral radius where the scheme bifurcates."""

    name = "tchamwa"
    summary = "Tchamwa-Wielgosz"
    order = 1

    rho: Annotated[float, Gt(0.0), Le(1.0), Unit("1")] = 0.5

    def bind(self, dt):
        phi = 2.0 / (1.0 + self.rho)
        return Stages(times=(0.0,), numbers=(phi,), end=((dt, phi * dt * dt, phi * dt),))

    @staticmethod
    def step(numbers, system, u, v, kept, dt):
        a = np.empty_like(u)
        accelerations(system, 0, u, v, a)
        u += dt * v + numbers[0] * dt * dt * a
        v += dt * a
