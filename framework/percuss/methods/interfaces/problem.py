"""The problem that an exact solution solves: bodies, contacts, supports and loads, without mesh and time step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

from percuss.methods.interfaces.base import Floats
from percuss.methods.interfaces.body import Material, Shape
from percuss.methods.interfaces.load import Load


class BodyEnd(NamedTuple):
    """An end of a body: the name of the body, and whether the end is the one at which its axis begins."""

    body: str
    at_start: bool


@dataclass(frozen=True, eq=False)
class ProblemBody:
    """A uniform body along a line.

    Attributes
    ----------
    name
        Name of the body in the case.
    shape
        Its shape, with the options of the case.
    material
        Its material, with the density `rho` and the `modulus`.
    area
        Area of the cross-section [length^2].
    length
        Length along its axis [length].
    direction : (dim,) array
        Unit vector along its axis, from its start.
    velocity : (dim,) array
        Velocity of all its points at t = 0 [length/time].
    modulus
        Of a prism that is no bar, the modulus of its waves along the axis; None of a bar, whose material has it
        [force/length^2]. Solutions that declare `of_prisms` receive such bodies.
    """

    name: str
    shape: Shape
    material: Material
    area: float
    length: float
    direction: Floats
    velocity: Floats
    modulus: float | None = None

    @property
    def wave_modulus(self) -> float:
        """Modulus of the waves along the axis [force/length^2]."""
        return self.material.modulus if self.modulus is None else self.modulus


@dataclass(frozen=True, eq=False)
class ProblemContact:
    """A contact of two ends, or of one end and a rigid wall.

    Attributes
    ----------
    name
        Name of the contact in the case.
    ends
        The two ends, or the only one at a wall.
    normal : (dim,) array
        Unit vector from the first end to the second one, or to the wall.
    gap
        Distance along the normal at t = 0; 0 where the ends touch [length].
    """

    name: str
    ends: tuple[BodyEnd, ...]
    normal: Floats
    gap: float


@dataclass(frozen=True, eq=False)
class ProblemLoad:
    """A load on an end of a body or on a whole body: a force, an acceleration or a prescribed velocity.

    Attributes
    ----------
    name
        Name of the load in the case.
    load
        The load, which gives the amplitude at each time since `start` (since t = 0 if `start` is not finite).
    body
        Name of the body.
    end
        The end at which the load acts; None if it acts on the whole body.
    acts_as
        Quantity of the amplitude; that of a load on a whole body is always ``"acceleration"``.
    vector : (dim,) array
        The quantity at amplitude 1.
    start, stop
        Times between which the load acts, -inf and inf where the case gives none.
    """

    name: str
    load: Load
    body: str
    end: BodyEnd | None
    acts_as: Literal["force", "acceleration", "velocity"]
    vector: Floats
    start: float
    stop: float


@dataclass(frozen=True, eq=False)
class ContactProblem:
    """The mechanical problem of a case, of which an exact solution is sought; its arrays are read-only.

    Attributes
    ----------
    bodies
        The bodies by name, in the order of the case.
    contacts
        The contacts in the order of the case.
    fixed
        The ends that do not move.
    loads
        The loads in the order of the case; a load on several ends or bodies is listed once for each of them.
    """

    bodies: Mapping[str, ProblemBody]
    contacts: tuple[ProblemContact, ...]
    fixed: tuple[BodyEnd, ...]
    loads: tuple[ProblemLoad, ...]

    def __getstate__(self) -> dict[str, object]:
        """Return what is copied or stored, in which a read-only mapping has no place."""
        return {**vars(self), "bodies": dict(self.bodies)}
