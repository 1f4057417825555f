"""Explicit Newmark."""

from dataclasses import dataclass
from typing import Annotated

from percuss import Ge, Integrator, Stages, Unit, accelerations


@dataclass(frozen=True)
class Newmark(Integrator):
    """Explicit Newmark with gamma above 1/2."""

    name = "newmark"
    summary = "explicit Newmark"
    order = 1
    kept = 1

    gamma: Annotated[float, Ge(0.5), Unit("1")] = 0.6

    def bind(self, dt):
        return Stages((1.0,), (self.gamma,))

    @staticmethod
    def step(numbers, system, u, v, kept, dt):
        u += dt * v + 0.5 * dt * dt * kept[0]
        v += dt * (1.0 - numbers[0]) * kept[0]
        accelerations(system, 0, u, v, kept[0])
        v += dt * numbers[0] * kept[0]
