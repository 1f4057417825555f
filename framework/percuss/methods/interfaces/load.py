"""Interfaces of loads: of those given in time by an amplitude, and of those that follow the motion of an end."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from percuss.methods.interfaces.base import Component, Floats


class Load(Component, contract="loads"):
    """An amplitude over time; the case sets place, time, direction and quantity of the load.

    Attributes
    ----------
    acts_as
        Quantity of the amplitude, unless the case sets it (`as`).
    everywhere
        Whether the load acts on all bodies, unless the case sets the place (`on`).
    """

    acts_as: ClassVar[Literal["force", "acceleration", "velocity"]] = "force"
    everywhere: ClassVar[bool] = False

    @abstractmethod
    def amplitude(self, time: Floats) -> Floats:
        """Return the amplitude at each `time`, counted from the moment at which the load is switched on.

        Parameters
        ----------
        time : (T,) array
            Times since the load's `from`, not negative.

        Returns
        -------
        (T,) array
            Amplitude [force, acceleration or velocity, depending on the case].
        """

    def kinks(self) -> tuple[float, ...] | None:
        """Return the times, from the start of the load, at which the amplitude is not smooth; None if not known.

        Only a load with known times can be part of an exact solution.
        """
        return None

    def vector(self) -> tuple[float, ...] | None:
        """Return the direction that the load itself defines, or None if the case or the body defines it."""
        return None


class LoadedEnd(NamedTuple):
    """The end of a body on which a load acts that follows its motion.

    Attributes
    ----------
    mass
        Mass of the node [mass].
    stiffness
        EA/h of the end element, as `percuss.methods.interfaces.ContactPoints` has it [force/length].
    impedance
        rho c A of the end element [force time/length], the force per velocity in a wave that runs one way.
    """

    mass: float
    stiffness: float
    impedance: float


class FollowingLoad(Load, contract="loads"):
    """A force on an end that depends on the displacement and the velocity of this end along the load's direction.

    In a leap-frog scheme, the displacement is that at t_n, and the velocity the mean of those half a step before and
    after, of which the latter contains the force itself, but no force of a contact at that end: percuss solves for
    the force, so that a dashpot takes energy at any step. In a stage of a multi-stage scheme, both are what the scheme
    hands to `percuss.accelerations`; most hand over a velocity of another time, so that a dashpot makes them first
    order and lowers their critical step. An end has one load that follows its motion.
    """

    acts_as: ClassVar[Literal["force", "acceleration", "velocity"]] = "force"

    def amplitude(self, time: Floats) -> Floats:
        """Return 1: the force is not given in time."""
        return np.ones_like(time)

    @abstractmethod
    def numbers(self, end: LoadedEnd) -> tuple[float, ...]:
        """Return the numbers that the kernel `follow` reads, for the end on which the load acts."""

    @staticmethod
    @abstractmethod
    def follow(numbers: tuple[float, ...], time: float, displacement: float, velocity: float) -> float:
        """Return the force along the direction of the load; a kernel.

        Parameters
        ----------
        numbers
            What `numbers` returned.
        time
            Time since the load was switched on.
        displacement, velocity
            Motion of the end along the direction of the load.
        """
