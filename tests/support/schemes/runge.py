"""Runge-Kutta."""

from dataclasses import dataclass

import numpy as np

from percuss import Integrator, Stages, accelerations


@dataclass(frozen=True)
class Runge(Integrator):
    """The classical scheme of Runge and Kutta."""

    name = "runge"
    summary = "Runge-Kutta of order 4"
    order = 4

    def bind(self, dt):
        return Stages((0.0, 0.5, 0.5, 1.0))

    @staticmethod
    def step(numbers, system, u, v, kept, dt):
        a1, a2, a3, a4 = np.empty_like(u), np.empty_like(u), np.empty_like(u), np.empty_like(u)
        v2, v3, v4 = np.empty_like(u), np.empty_like(u), np.empty_like(u)
        accelerations(system, 0, u, v, a1)
        v2[:] = v + 0.5 * dt * a1
        accelerations(system, 1, u + 0.5 * dt * v, v2, a2)
        v3[:] = v + 0.5 * dt * a2
        accelerations(system, 2, u + 0.5 * dt * v2, v3, a3)
        v4[:] = v + dt * a3
        accelerations(system, 3, u + dt * v3, v4, a4)
        u += dt / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
        v += dt / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
