"""Penalty with a soft start: the force begins before the bodies touch and grows exponentially."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np

from percuss import ContactLaw, ContactPoints, Doc, Gt, Unit
from percuss_methods.contacts._auto import quarter_stiffness, refuse_several

if TYPE_CHECKING:
    from percuss import Floats, Trial

HALVINGS = 60
WHY_ENERGY_MAY_GROW = "a force whose slope changes within a step adds or removes energy"


class Softened(NamedTuple):
    """Numbers of the law, (P,) each."""

    clearance: Floats  # c
    scale: Floats  # pressure / (e - 1)
    stiffness: Floats  # eps_s, of the line
    limit: Floats  # value of x at which the line begins


def steepness(x: Any) -> Any:
    """Return the derivative of ``x (exp(x) - 1)``."""
    return np.expm1(x) + x * np.exp(x)


@dataclass(frozen=True)
class SoftenedPenalty(ContactLaw):
    """Penalty with the exponential soft start of commercial codes, and a largest stiffness.

    Formula: ``lambda = p x (exp(x) - 1) / (e - 1)`` with ``x = 1 - g/c``, for x > 0; where its slope would exceed eps_s
    the force goes on along the tangent, with the slope eps_s.

    The force is zero at a gap of c, and p where the bodies touch, unless the tangent begins before that. It has no
    kink where it begins, so that an impact excites less vibration than with a penalty of the same stiffness, which it
    reaches later. With central difference a contact on the line lowers the critical step as a penalty of eps_s does;
    the black box examines it there.
    """

    name = "softened-penalty"
    summary = "Penalty with an exponential soft start from a clearance on"
    references = (
        "Abaqus Analysis User's Guide, Contact pressure-overclosure relationships: exponential pressure-overclosure",
        "Belytschko, Liu, Moran, Elkhodary: Nonlinear Finite Elements, Wiley 2014, ch. 10",
    )
    examples = ({"clearance": 1e-3, "pressure": 0.01}, {"clearance": 0.1, "pressure": 1e-4, "beta_s": 0.1})
    expected_failures = {
        "exact-impact": "clearance and pressure are given in units and do not shrink with the mesh",
        "energy-never-grows with central-difference": WHY_ENERGY_MAY_GROW,
        "energy-never-grows with wu-predictor-corrector": WHY_ENERGY_MAY_GROW,
    }
    stiffening = ("beta_s", "epsilon_s")
    guarantees = ("never pulls",)
    state = 1  # energy stored
    stored_in = 0

    clearance: Annotated[float, Gt(0), Unit("length"), Doc("c, the gap at which the force begins")]
    pressure: Annotated[float, Gt(0), Unit("force"), Doc("p, the force where the bodies touch")]
    beta_s: Annotated[float, Gt(0), Unit("1"), Doc("eps_s over EA/h, softer side; 1/4 unless given")] | None = None
    epsilon_s: Annotated[float, Gt(0), Unit("force/length"), Doc("stiffness; instead of beta_s")] | None = None

    def __post_init__(self) -> None:
        refuse_several(self, ("beta_s", "epsilon_s"), "stiffness")

    def bind(self, points: ContactPoints, dt: float) -> Softened:  # noqa: ARG002
        """Return the numbers of the law, with the place at which the line begins."""
        stiffness = np.asarray(quarter_stiffness(self, points), dtype=float)
        scale = self.pressure * points.weight / math.expm1(1.0)
        wanted = stiffness * self.clearance / scale
        low, high = np.zeros(wanted.size), np.log1p(wanted)  # steepness(x) >= exp(x) - 1
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            below = steepness(middle) < wanted
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return Softened(np.full(wanted.size, self.clearance), scale, stiffness, high)

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:  # noqa: ARG002
        """Return the largest stiffness eps_s."""
        return {"epsilon_s": quarter_stiffness(self, points)}

    @staticmethod
    def multipliers(bound: Softened, trial: Trial, multiplier: Floats) -> None:
        """Set the force of each point and the energy that it stores."""
        for p in range(multiplier.size):
            c, scale, limit = bound.clearance[p], bound.scale[p], bound.limit[p]
            x = max(1.0 - trial.gap[p] / c, 0.0)
            soft = min(x, limit)
            force = scale * soft * math.expm1(soft)
            energy = scale * c * ((soft - 1.0) * math.exp(soft) - 0.5 * soft**2 + 1.0)
            beyond = c * (x - soft)  # overlap along the tangent
            multiplier[p] = force + bound.stiffness[p] * beyond
            trial.after[p, 0] = energy + beyond * (force + 0.5 * bound.stiffness[p] * beyond)
