"""The interface of a load: an amplitude in time, and what it acts on."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Literal

from percuss.methods.interfaces.base import Component, Floats


class Load(Component, contract="loads"):
    """An amplitude over time. Where it acts, when, along what and as what quantity, the case says.

    Attributes
    ----------
    acts_as
        What the amplitude is unless the case says otherwise (`as`).
    everywhere
        Whether it acts on all bodies unless the case says where (`on`).
    """

    acts_as: ClassVar[Literal["force", "acceleration", "velocity"]] = "force"
    everywhere: ClassVar[bool] = False

    @abstractmethod
    def amplitude(self, time: Floats) -> Floats:
        """Return the amplitude at each `time`, which counts from the moment the load is switched on.

        Parameters
        ----------
        time : (T,) array
            Times since the load's `from`, not negative.

        Returns
        -------
        (T,) array
            Amplitude [force, acceleration or velocity, as the case says].
        """

    def kinks(self) -> tuple[float, ...] | None:
        """Return the times, from its start, at which the amplitude is not smooth; None where that is not known.

        A load that says so can be part of an exact solution.
        """
        return None

    def vector(self) -> tuple[float, ...] | None:
        """Return the direction the load itself gives, or None where the case or the body gives it."""
        return None
