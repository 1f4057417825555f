"""Friction that falls with the slip rate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple

from percuss import Doc, Friction, FrictionPoints, Ge, Stiffness, Unit


class Decay(NamedTuple):
    """The numbers of the friction."""

    static: float
    kinetic: float
    decay: float


@dataclass(frozen=True)
class ExponentialDecay(Friction):
    """Friction whose coefficient falls from a static to a kinetic value as the slip rate grows.

    Formula: ``|lambda_t| <= mu(r) lambda_n`` with ``mu(r) = mu_kinetic + (mu_static - mu_kinetic) exp(-decay r)`` and
    r the slip rate half a step before.
    """

    name = "exponential-decay"
    summary = "Friction that falls from a static to a kinetic coefficient with the slip rate"
    references = (
        "Oden, Martins: Models and computational methods for dynamic friction phenomena, CMAME 52 (1985), "
        "doi 10.1016/0045-7825(85)90009-X",
    )
    examples = ({"mu_static": 0.4, "mu_kinetic": 0.2, "decay": 3.0},)

    mu_static: Annotated[float, Ge(0), Unit("1"), Doc("coefficient of friction at rest")]
    mu_kinetic: Annotated[float, Ge(0), Unit("1"), Doc("coefficient of friction at a high slip rate")]
    decay: Annotated[float, Ge(0), Unit("time/length"), Doc("how fast it falls with the slip rate")]
    stiffness: Stiffness = None

    def bind(self, points: FrictionPoints, dt: float) -> Decay:  # noqa: ARG002
        """Return the numbers of the friction."""
        return Decay(self.mu_static, self.mu_kinetic, self.decay)

    @staticmethod
    def bound(data, point, force, rate, before) -> float:  # noqa: ARG004
        """Return ``mu(r) lambda_n``."""
        return (data.kinetic + (data.static - data.kinetic) * math.exp(-data.decay * rate)) * force
