"""Explicit generalised alpha."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from percuss import Ge, Integrator, Le, Stages, Unit, accelerations


@dataclass(frozen=True)
class Alpha(Integrator):
    """Explicit generalised alpha of Hulbert and Chung (1996), doi 10.1016/S0045-7825(96)01036-5."""

    name = "alpha"
    summary = "explicit generalised alpha"
    order = 2
    kept = 1

    rho: Annotated[float, Ge(0.0), Le(1.0), Unit("1")] = 0.8

    def bind(self, dt):
        alpha = (2.0 * self.rho - 1.0) / (1.0 + self.rho)
        beta = (5.0 - 3.0 * self.rho) / ((1.0 + self.rho) ** 2 * (2.0 - self.rho))
        return Stages((0.0,), (alpha, beta, 1.5 - alpha))

    @staticmethod
    def step(numbers, system, u, v, kept, dt):
        alpha, beta, gamma = numbers
        a = kept[0]
        now = np.empty_like(u)
        accelerations(system, 0, u, v, now)
        after = (now - alpha * a) / (1.0 - alpha)
        u += dt * v + dt * dt * ((0.5 - beta) * a + beta * after)
        v += dt * ((1.0 - gamma) * a + gamma * after)
        a[:] = after
