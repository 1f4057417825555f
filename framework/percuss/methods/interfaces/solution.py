"""The interface of a reference solution: what the exact motion of a case is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from percuss.methods.interfaces.base import Component, Floats


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
        """Intervals (start, stop) in which the contact presses."""

    @abstractmethod
    def largest_force(self, start: float, stop: float) -> float:
        """Return the least upper bound of the force between two times: no sample may exceed it [force]."""

    def mean_force(self, start: Floats, stop: Floats) -> Floats:
        """Return the force averaged from `start` to `stop` [force]; zero force before t = 0."""
        return (self.impulse(stop) - self.impulse(start)) / (np.asarray(stop) - np.asarray(start))


class Exact(ABC):
    """The exact solution of a case, evaluated at any time up to `reached`.

    Attributes
    ----------
    reached
        Time up to which it holds.
    fronts
        How many fronts it took.
    contacts
        `ExactContact` of each contact by name.
    stopped
        Why it holds no farther than `reached`, in words; empty where that is the end asked for.
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
        """Return kinetic and elastic energy."""

    @abstractmethod
    def largest_energy(self) -> float:
        """Return the least upper bound of kinetic and elastic energy together from 0 to `reached` [energy]."""

    @abstractmethod
    def work(self, time: float) -> float:
        """Return the work of loads, supports and drives from 0 to `time` [energy]."""

    @abstractmethod
    def momentum(self, time: float) -> float:
        """Return the momentum along the direction of the first body [mass length/time]."""

    @abstractmethod
    def impulse(self, time: float) -> float:
        """Return the impulse of loads, supports, drives and walls along the same direction [force time]."""


class Solution(Component, contract="solutions"):
    """An exact solution of a class of cases.

    It is handed a `percuss.solver.model.Model`, of which it must not use the mesh beyond the ends of its bodies.

    Attributes
    ----------
    linear_bodies_only
        Whether it holds for linear bodies alone (`Material.linear`, `Element.linear`). It is then not asked about any
        other case: no run with a body that is not linear is held against it.
    """

    linear_bodies_only: ClassVar[bool] = True

    @abstractmethod
    def covers(self, model: Any) -> str | None:
        """Return why the case is not covered, or None where it is."""

    @abstractmethod
    def solve(self, model: Any, end: float) -> Exact:
        """Return the exact solution up to `end`, or up to an earlier time and then why, in `Exact.stopped`."""
