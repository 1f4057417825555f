"""Laws that read the bulk acceleration, weigh the gap rate or have no compliance; an integrator that shows less."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from percuss import (
    ContactLaw,
    ContactState,
    Doc,
    Gt,
    Integrator,
    LeapFrog,
    LinearLaw,
    Stages,
    Unit,
    accelerations,
    end_of_step,
)


class Bound(NamedTuple):
    gamma: np.ndarray


@dataclass(frozen=True)
class NitscheKernel(ContactLaw):
    """The built-in `nitsche` by a kernel.

    Formula: ``lambda = [-gamma g - A {sigma}]_+``.
    """

    name = "nitsche-kernel"
    summary = "Nitsche, theta = 0, as a kernel"
    references = ("Chouly, Renard: Explicit Verlet time-integration for a Nitsche-based approximation, AMSES 5 (2018)",)

    gamma0: Annotated[float, Gt(0), Unit("1"), Doc("Nitsche parameter over EA/h of the softer side")] = 1.0

    def bind(self, points, dt):
        return Bound(self.gamma0 * points.stiffness)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            stress = (trial.predicted_rate[p] - trial.rate[p]) / (trial.rate_response * trial.delassus[p])
            multiplier[p] = max(-bound.gamma[p] * trial.gap[p] - stress, 0.0)


@dataclass(frozen=True)
class Row(ContactLaw):
    """A line with weights of all kinds.

    Formula: ``sigma lambda = -g - rate g' - acceleration g''``.
    """

    name = "row"
    summary = "Any line"
    references = ("none",)

    epsilon_s: Annotated[float, Gt(0), Unit("1"), Doc("stiffness over EA/h")] = 0.5
    rate: Annotated[float, Unit("time"), Doc("weight of the gap rate")] = 0.0
    acceleration: Annotated[float, Unit("time^2"), Doc("weight of the gap acceleration")] = 0.0
    at_end: Annotated[bool, Doc("judged at the end of the step")] = False

    def bind(self, points, dt):
        return LinearLaw(
            at="end" if self.at_end else "explicit",
            sigma=1.0 / (self.epsilon_s * points.stiffness),
            rate=self.rate,
            acceleration=self.acceleration,
        )


@dataclass(frozen=True)
class Blind(Integrator):
    """Contact judged at the predicted gap, whose acceleration is neither shown nor changed.

    Formula: ``g = g(u*)``.
    """

    name = "blind"
    summary = "Shows no acceleration and lets none be changed"
    references = ("none",)
    order = 2

    def bind(self, dt):
        return LeapFrog(ContactState("predicted", "predicted", "none", (dt * dt, dt, 0.0)), end_of_step(dt))


@dataclass(frozen=True)
class ForwardEuler(Integrator):
    """The explicit scheme of Euler, which amplifies every oscillation at any step.

    Formula: ``u_{n+1} = u_n + dt v_n``, ``v_{n+1} = v_n + dt a_n``.
    """

    name = "forward-euler"
    summary = "Unstable at any step"
    references = ("none",)
    order = 1
    kept = 1

    def bind(self, dt):
        return Stages(times=(1.0,), end=((dt, dt * dt, dt),))

    @staticmethod
    def step(numbers, system, u, v, kept, dt):
        a = kept[0]
        u += dt * v
        v += dt * a
        accelerations(system, 0, u, v, a)
