"""The parts of a model: bodies, contact pairs of their ends, constraints, and forces on nodes and bodies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from percuss.methods.interfaces import ContactLaw, Floats, Mesh

if TYPE_CHECKING:
    from percuss.case.specs import BodySpec, LoadSpec


@dataclass(frozen=True)
class Body:
    """One body: its mesh, masses and element properties, and its range of nodes in the model."""

    name: str
    number: int
    spec: BodySpec
    mesh: Mesh
    start: int  # its first node
    mass: Floats  # (n + 1,)
    stiffness: Floats  # (n,) EA/h
    frequency: Floats  # (n,) 2c/h
    velocity: Floats  # (dim,)

    @property
    def why_not_linear(self) -> str:
        """The reason why internal forces are not proportional to displacements; empty for a linear body."""
        parts = (("material", self.spec.material), ("element", self.spec.element))
        nonlinear = [f"{kind} {part.name}" for kind, part in parts if not part.linear]
        if not nonlinear:
            return ""
        verb = "does" if len(nonlinear) == 1 else "do"
        return f"body '{self.name}' is not linear: its {' and its '.join(nonlinear)} {verb} not declare `linear = True`"

    @property
    def stop(self) -> int:
        """The number after the body's last node."""
        return self.start + self.mass.size

    def node(self, region: str) -> int:
        """Return the node of the model at an end of the body."""
        return self.start + self.mesh.regions[region].nodes[0]

    def end_element(self, node: int) -> int:
        """Return the number within the body of the element at an end node."""
        return 0 if node == self.start else self.stiffness.size - 1


@dataclass(frozen=True)
class ContactPair:
    """A contact pair, which is one contact point: its nodes, unit normal and initial gap, its law and scales.

    The normal points from the first side to the second. Stiffness EA/h, frequency 2c/h and mass rho A h / 2 are those
    of the end elements, as `percuss.methods.interfaces.ContactPoints` defines them.
    """

    name: str
    nodes: tuple[int, ...]
    normal: Floats  # (dim,)
    gap: float
    law: ContactLaw
    stiffness: float
    frequency: float
    mass: float
    equal_sides: bool

    def gap_gradient(self) -> list[tuple[int, Floats]]:
        """Return the derivative of the gap by the displacement of each side: (node, minus or plus the normal)."""
        return [(node, sign * self.normal) for node, sign in zip(self.nodes, (-1.0, 1.0), strict=False)]


@dataclass(frozen=True)
class Constraint:
    """A direction in which the velocity of a node is prescribed, always (support) or during an interval (drive)."""

    node: int
    direction: Floats
    load: LoadSpec | None
    column: int

    def active(self, midpoint: float) -> bool:
        """Return whether the constraint is active in the step around `midpoint`."""
        return self.load is None or self.load.start < midpoint < self.load.stop


@dataclass(frozen=True)
class NodalForce:
    """A force on one node: its vector at amplitude 1, and the load whose amplitude it follows."""

    node: int
    force: Floats
    load: LoadSpec
    column: int


@dataclass(frozen=True)
class BodyForce:
    """An acceleration of a whole body: its vector at amplitude 1, and the load whose amplitude it follows."""

    body: int
    acceleration: Floats
    load: LoadSpec
