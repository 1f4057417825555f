"""Spring and dashpot between an end and the ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from percuss import Doc, FollowingLoad, Ge, LoadedEnd, Unit


@dataclass(frozen=True)
class SpringDashpot(FollowingLoad):
    """A spring and a dashpot side by side, from the end to the ground along the direction of the load.

    Formula: ``F = -k u - c u'``; at t = 0 the spring carries no force.

    The dashpot takes energy at any step of a leap-frog scheme, unless a contact acts on the same end: its force is made
    of the velocity without that of the contact, and may then give some in single steps. The spring is explicit: of a
    node of mass m by itself it asks for ``dt <= 2 sqrt(m/k)``.
    """

    name = "spring-dashpot"
    summary = "Spring and dashpot from the end to the ground"
    references = ("Hughes: The Finite Element Method, Dover 2000, ch. 9",)
    examples = ({"stiffness": 1.0, "damping": 0.5}, {"damping": 1.0})

    stiffness: Annotated[float, Ge(0), Unit("force/length"), Doc("k")] = 0.0
    damping: Annotated[float, Ge(0), Unit("force*time/length"), Doc("c")] = 0.0

    def numbers(self, end: LoadedEnd) -> tuple[float, ...]:  # noqa: ARG002
        """Return k and c."""
        return (self.stiffness, self.damping)

    @staticmethod
    def follow(numbers: tuple[float, ...], time: float, displacement: float, velocity: float) -> float:  # noqa: ARG004
        """Return the force; a kernel."""
        return -numbers[0] * displacement - numbers[1] * velocity
