"""Absorbing end: the force of a wave that leaves and does not come back."""

from __future__ import annotations

from dataclasses import dataclass

from percuss import FollowingLoad, LoadedEnd


@dataclass(frozen=True)
class Absorbing(FollowingLoad):
    """The end behaves as if the bar were infinitely long: a dashpot with the impedance of the bar.

    Formula: ``F = -rho c A u'``, of the end element.

    Exact for the bar itself; its elements reflect a part of the waves that are as short as they are. At a Courant
    number of 1 they reflect nothing: central difference then solves the wave equation of a uniform bar exactly, and the
    end with it. The work of the load is minus the energy that has left through the end.
    """

    name = "absorbing"
    summary = "Absorbing end, as if the bar went on: a dashpot of its impedance"
    references = (
        "Lysmer, Kuhlemeyer: Finite dynamic model for infinite media, J. Eng. Mech. Div. ASCE 95 (1969) 859-877",
    )

    def numbers(self, end: LoadedEnd) -> tuple[float, ...]:
        """Return the impedance."""
        return (end.impedance,)

    @staticmethod
    def follow(numbers: tuple[float, ...], time: float, displacement: float, velocity: float) -> float:  # noqa: ARG004
        """Return the force; a kernel."""
        return -numbers[0] * velocity
