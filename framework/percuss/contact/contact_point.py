"""A contact point of a model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from percuss.methods.interfaces import ContactLaw, Floats

TOUCHING = 1e-9  # fraction of an element length; a smaller initial gap or overlap is set to zero


@dataclass(frozen=True)
class ContactPoint:
    """A contact point: the contact that it belongs to, its gap, its law and scales.

    Stiffness, frequency and mass are as `percuss.methods.interfaces.ContactPoints` defines them.
    """

    name: str  # of its contact
    contact: int  # number of its contact in the case
    gradient: tuple[tuple[int, Floats], ...]  # nodes, and the derivative of the gap by the displacement of each, (dim,)
    normal: Floats  # (dim,) from the first side to the second, or to the wall
    at_wall: bool
    gap: float
    law: ContactLaw
    stiffness: float
    frequency: float
    mass: float
    equal_sides: bool
    weight: float = 1.0

    @property
    def nodes(self) -> tuple[int, ...]:
        """The nodes that the gap depends on."""
        return tuple(node for node, _ in self.gradient)
