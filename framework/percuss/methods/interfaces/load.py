"""Interface of a load: its amplitude in time, its quantity and its direction."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Literal

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
