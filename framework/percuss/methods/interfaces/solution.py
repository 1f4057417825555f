"""Interface of a reference solution: the exact motion of a case."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from percuss.methods.interfaces.base import Component, Floats
from percuss.methods.interfaces.problem import ContactProblem


class ExactContact(ABC):
    """The exact history of one contact; times are (T,) arrays or numbers."""

    @abstractmethod
    def force(self, time: Floats) -> Floats:
        """Return the contact force, compression positive [force]."""

    @abstractmethod
    def impulse(self, time: Floats) -> Floats:
        """Return the impulse of the contact force from 0 to `time`; 0 before [force time]."""

    @abstractmethod
    def gap(self, time: Floats) -> Floats:
        """Return the gap, open positive [length]."""

    @property
    @abstractmethod
    def closed(self) -> tuple[tuple[float, float], ...]:
        """Time intervals (start, stop) in which the contact is closed and presses."""

    @abstractmethod
    def largest_force(self, start: float, stop: float) -> float:
        """Return the least upper bound of the contact force between two times, which no sample may exceed [force]."""

    def mean_force(self, start: Floats, stop: Floats) -> Floats:
        """Return the mean contact force from `start` to `stop` [force]; the force is zero before t = 0."""
        return (self.impulse(stop) - self.impulse(start)) / (np.asarray(stop) - np.asarray(start))


class Exact(ABC):
    """The exact solution of a case, which can be evaluated at any time up to `reached`.

    Attributes
    ----------
    reached
        Time up to which the solution holds.
    fronts
        Number of wave fronts that the solution consists of.
    contacts
        `ExactContact` of each contact, by name.
    stopped
        Reason, in words, why the solution holds no farther than `reached`; empty if that is the end asked for.
    """

    reached: float
    fronts: int
    stopped: str = ""
    contacts: Mapping[str, ExactContact]

    @abstractmethod
    def displacement(self, body: str, x: Floats, time: Floats) -> Floats:
        """Return the displacement along the body at distance `x` from its start [length]."""

    @abstractmethod
    def velocity(self, body: str, x: Floats, time: Floats) -> Floats:
        """Return the velocity along the body [length/time]."""

    @abstractmethod
    def stress(self, body: str, x: Floats, time: Floats) -> Floats:
        """Return the stress, tension positive [force/length^2]."""

    @abstractmethod
    def energy(self, time: float) -> tuple[float, float]:
        """Return kinetic and elastic energy [energy]."""

    @abstractmethod
    def largest_energy(self) -> float:
        """Return the least upper bound of the sum of kinetic and elastic energy from 0 to `reached` [energy]."""

    @abstractmethod
    def work(self, time: float) -> float:
        """Return the work of loads, supports and drives from 0 to `time` [energy]."""

    @abstractmethod
    def momentum(self, time: float) -> float:
        """Return the momentum along the direction of the first body [mass length/time]."""

    @abstractmethod
    def impulse(self, time: float) -> float:
        """Return the impulse of loads, supports, drives and walls along the first body's direction [force time]."""


class Solution(Component, contract="solutions"):
    """An exact solution of a class of cases, each of which it receives as a `ContactProblem`.

    Attributes
    ----------
    linear_bodies_only
        Whether the solution holds only for linear bodies (`Material.linear`, `Element.linear`). It is then not used for
        any other case: no run with a nonlinear body is compared with it.
    of_prisms
        Whether it knows that a body may be a prism, whose modulus is `ProblemBody.wave_modulus`, not that of its
        material.
    """

    linear_bodies_only: ClassVar[bool] = True
    of_prisms: ClassVar[bool] = False

    @abstractmethod
    def covers(self, problem: ContactProblem) -> str | None:
        """Return the reason why the solution does not cover a problem, or None if it does."""

    def too_costly(self, problem: ContactProblem, end: float) -> str | None:  # noqa: ARG002
        """Return why a covered problem is not solved up to `end`, if it is known at once that it takes too much."""
        return None

    @abstractmethod
    def solve(self, problem: ContactProblem, end: float) -> Exact | str:
        """Return the exact solution up to `end`, or up to an earlier time, with the reason in `Exact.stopped`.

        A text says why there is none, as where it would take too long. Work that lasts tells its `percuss.progress`.
        """
