"""The checked parts of a case: what the rest of percuss works with."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from percuss.case.yaml_text import KeyPath
from percuss.methods.interfaces import ContactLaw, Element, Load, Material, Shape

__all__ = ["Address", "BodySpec", "ContactSpec", "Expectation", "LoadSpec", "RecordSpec"]

Vector = tuple[float, ...]
ActsAs = Literal["force", "acceleration", "velocity"]


@dataclass(frozen=True)
class Address:
    """A body, or one end of it: ``BODY`` or ``BODY.REGION``; `region` is empty for the whole body."""

    body: str
    region: str = ""

    def __str__(self) -> str:
        return f"{self.body}.{self.region}" if self.region else self.body


@dataclass(frozen=True)
class BodySpec:
    """A body of a case.

    Attributes
    ----------
    at
        Its start, one number a dimension [length].
    area
        Cross-section [length^2].
    velocity
        As given: a number along the body's direction, or a vector [length/time].
    fixed
        Ends that do not move.
    """

    name: str
    shape: Shape
    at: Vector
    material: Material
    element: Element
    area: float
    velocity: float | Vector
    fixed: tuple[str, ...]


@dataclass(frozen=True)
class ContactSpec:
    """A contact between two ends, or of one end with a rigid wall.

    Attributes
    ----------
    sides
        Two ends, or one where there is a wall.
    wall
        Position of the wall as given, a number along x or a point [length]; None between two ends.
    law
        The contact's own law, or that of the method.
    own_law
        Whether it has one of its own.
    """

    name: str
    sides: tuple[Address, ...]
    wall: float | Vector | None
    law: ContactLaw
    own_law: bool = False


@dataclass(frozen=True)
class LoadSpec:
    """A load: what, where, when and along what.

    Attributes
    ----------
    on
        Bodies or ends; empty means every body.
    acts_as
        Which quantity the amplitude is.
    direction
        Vector along which it acts, not of unit length; None means the direction of the body.
    start, stop
        It acts for ``start <= t < stop``; -inf and inf where not given.
    """

    name: str
    load: Load
    on: tuple[Address, ...]
    acts_as: ActsAs
    direction: Vector | None
    start: float = -math.inf
    stop: float = math.inf


@dataclass(frozen=True)
class RecordSpec:
    """What a run records.

    Attributes
    ----------
    probes
        Ends whose motion is recorded; None means all ends in contact.
    """

    every: int = 1
    probes: tuple[Address, ...] | None = None
    fields: int = 0


@dataclass(frozen=True)
class Expectation:
    """What a run of the case is expected to give.

    Attributes
    ----------
    contact, probe
        Whose quantity; None where the quantity is the run's.
    component
        Of a displacement or velocity.
    during, at
        Times it is taken over, or the time it is taken at; None means the whole run.
    statistic
        What is made of the history: mean, max, min, final, integral or value.
    value, within, relative
        Expected value and how far off it may be, as a share of the value where `relative`.
    source
        ``exact``, ``paper`` or ``frozen on YYYY-MM-DD``.
    path
        Where it stands in the case.
    """

    quantity: str
    contact: str | None
    probe: Address | None
    component: int
    during: tuple[float, float] | None
    at: float | None
    statistic: str
    value: float
    within: float
    relative: bool
    source: str
    path: KeyPath

    @property
    def allowed(self) -> float:
        """Largest difference from the value that is allowed, in the unit of the quantity."""
        return self.within * abs(self.value) if self.relative else self.within
