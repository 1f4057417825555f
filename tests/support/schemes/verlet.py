"""Velocity Verlet."""

from dataclasses import dataclass

from percuss import Integrator, Stages, accelerations


@dataclass(frozen=True)
class Verlet(Integrator):
    """Central difference with displacement and velocity at the same times."""

    name = "verlet"
    summary = "velocity Verlet"
    order = 2
    kept = 1

    def bind(self, dt):
        return Stages(times=(1.0,), end=((dt, dt * dt, dt),), start=(dt, 0.5 * dt * dt, 0.5 * dt))

    @staticmethod
    def step(numbers, system, u, v, kept, dt):
        v += 0.5 * dt * kept[0]
        u += dt * v
        accelerations(system, 0, u, v, kept[0])
        v += 0.5 * dt * kept[0]
