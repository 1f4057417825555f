"""Augmented Lagrangian by Uzawa's iteration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np

from percuss import ContactLaw, ContactPoints, Doc, Ge, Le, Trial, Unit, coupled_gap
from percuss_methods.contacts import _auto

if TYPE_CHECKING:
    from percuss import Floats


class Bound(NamedTuple):
    """Stiffness eps_s of each point, and number of iterations."""

    stiffness: Floats
    iterations: int


@dataclass(frozen=True)
class Uzawa(ContactLaw):
    """Augmented Lagrangian: a fixed number of Uzawa's iterations on the gap at the end of the step.

    Formula: ``lambda^0 = 0``, ``lambda^{k+1} = <lambda^k - eps_s g(u_{n+1}(lambda^k))>`` for all contacts at once;
    lambda_n is the last iterate. ``eps_s = beta_s EA/h`` on the softer side.

    The first iterate is the penalty force at the predicted gap, as with Wu's predictor-corrector and `penalty`. At ends
    in no other contact the distance to the multiplier of `lagrange` shrinks by ``1 - theta`` in each iteration,
    ``theta = dt^2 eps_s s``, so that the last iterate is a penalty force of stiffness ``(1 - (1 - theta)^k) / (dt^2
    s)``. In a leap-frog scheme that is stable with closed contacts up to theta = 1 for an odd number of iterations. For
    an even one it is so up to theta = 2, above which the last iterate is zero and nothing holds the bodies apart. Of
    contacts that share an end theta is dt^2 times the largest eigenvalue of ``S diag(eps_s)``. ``beta_s: auto`` keeps
    theta at 0.8 or less, contacts at the same ends included. Multipliers start from zero in each step: there is none
    kept from the step before.
    """

    name = "uzawa"
    summary = "Augmented Lagrangian: some of Uzawa's iterations from penalty towards Lagrange"
    references = (
        "Simo, Laursen: An augmented Lagrangian treatment of contact problems involving friction, Computers & "
        "Structures 42 (1992), doi 10.1016/0045-7949(92)90540-G",
        "Arrow, Hurwicz, Uzawa: Studies in Linear and Non-linear Programming, Stanford University Press 1958",
    )
    uses_coupling = True
    guarantees = ("never pulls",)
    stiffening = ("beta_s", "epsilon_s")
    headline = ("beta_s", "iterations")

    beta_s: _auto.BetaS = None
    epsilon_s: _auto.EpsilonS = None
    iterations: Annotated[int, Ge(1), Le(10_000), Unit("1"), Doc("number of iterations in each step")] = 10

    def __post_init__(self) -> None:
        _auto.refuse_several(self, ("beta_s", "epsilon_s"), "stiffness")

    def bind(self, points: ContactPoints, dt: float) -> Bound:
        """Return the stiffness of each point, and the number of iterations."""
        return Bound(_auto.limited_stiffness(self, points, dt), self.iterations)

    @staticmethod
    def multipliers(bound: Bound, trial: Trial, multiplier: Floats) -> None:
        """Set the multipliers to the last iterate."""
        multiplier[:] = 0.0
        gap = np.empty(multiplier.size)
        for _ in range(bound.iterations):
            for p in range(multiplier.size):
                gap[p] = coupled_gap(trial, multiplier, p)
            for p in range(multiplier.size):
                multiplier[p] = max(multiplier[p] - bound.stiffness[p] * gap[p], 0.0)

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:
        """Return the stiffness in both forms, and theta; of contacts that share an end a bound of it."""
        stiffness = _auto.limited_stiffness(self, points, dt)
        theta = dt**2 * stiffness * points.delassus * points.coupling
        return {**_auto.both_forms(stiffness, points), "theta": theta}

    def chosen(self, points: ContactPoints, dt: float) -> Mapping[str, str]:
        """Return the automatic beta_s with the reason for it, in words."""
        return _auto.limited_stiffness_described(self, points, dt)
