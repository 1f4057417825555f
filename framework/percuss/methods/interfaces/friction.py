"""Interface of a friction: the largest force along the surfaces that a contact point bears."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Gt

from percuss.methods.interfaces.base import Component, Doc, Floats, Unit

Stiffness = (
    Annotated[float, Gt(0), Unit("force/length"), Doc("stiffness of stick, per area: a number, exact or auto")]
    | Literal["exact", "auto"]
    | None
)


@dataclass(frozen=True)
class FrictionPoints:
    """The data of its contact points that a friction can use; arrays are read-only, with one value per point.

    Attributes
    ----------
    names : tuple of str
        Name of the contact of each point in the case.
    weight : (P,) array
        Area of the contact surface that belongs to the point.
    """

    names: tuple[str, ...]
    weight: Floats


class Friction(Component, contract="frictions"):
    """A friction between surfaces of bodies that are no bars.

    A point sticks, or it slides: the force along the surfaces is then as large as the friction allows, and opposes the
    slip. Stick, slip and the direction of the force are the framework's, in any dimension; a friction says how large
    the force may be. A friction with state variables has a second kernel, the static method
    ``renew(data, point, force, rate, before, after)``, which writes those after a step. It is called once a step, with
    the normal force found.

    Attributes
    ----------
    state
        Number of state variables of each point; zeros in the first step.
    stiffness
        How stick is held: ``"exact"`` lets a sticking point not slip at all, a number is the stiffness of a spring per
        area, ``"auto"`` derives it from that of the contact law. None is exact where the law has no stiffness, else
        auto. A friction that lets its user choose has an option of this name, with the type `percuss.Stiffness`.
    """

    state: ClassVar[int] = 0
    stiffness: Stiffness = None

    @property
    def acts(self) -> bool:
        """Whether there is any friction."""
        return True

    @abstractmethod
    def bind(self, points: FrictionPoints, dt: float) -> Any:
        """Return the numbers and arrays that the kernels read, a NamedTuple, at `points` for the time step `dt`."""

    @staticmethod
    @abstractmethod
    def bound(data: Any, point: int, force: float, rate: float, before: Floats) -> float:
        """Return the largest force of a point along the surfaces [force]; a kernel.

        It is at least 0, does not fall as the normal force grows, and is 0 without one.

        Parameters
        ----------
        data
            What `bind` has returned.
        point
            Number of the point among those of `bind`.
        force
            Its normal force, at least 0 [force].
        rate
            Its slip rate half a step before, at least 0 [length/time].
        before : (state,) array
            Its state variables as the last step has left them.
        """
