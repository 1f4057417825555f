"""The interfaces that make a body: shape, material, element and mass."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from percuss.methods.interfaces.base import Component, Floats


class Region(NamedTuple):
    """A named part of a body's boundary: its nodes, and the unit vector that points out of the body there."""

    nodes: tuple[int, ...]
    outward: Floats


class Mesh(NamedTuple):
    """A body's line mesh: element i joins nodes i and i + 1.

    Attributes
    ----------
    nodes : (n + 1, dim) array
        Positions [length].
    lengths : (n,) array
        Element lengths [length].
    direction : (dim,) array
        Unit vector along the line.
    regions
        Named ends; ``BODY.REGION`` is the only address there is.
    """

    nodes: Floats
    lengths: Floats
    direction: Floats
    regions: Mapping[str, Region]


class Shape(Component, contract="shapes"):
    """The geometry of a body; its name is the key in the body's mapping.

    Attributes
    ----------
    regions
        Names of its ends.
    without_mesh
        Options that say nothing but how it is meshed, with the value that is taken where an exact solution alone is
        asked for and a case leaves them out.
    """

    regions: ClassVar[tuple[str, ...]]
    without_mesh: ClassVar[Mapping[str, Any]] = {}

    @abstractmethod
    def dimension(self) -> int | None:
        """Return the number of dimensions the options imply, or None where any will do."""

    @abstractmethod
    def mesh(self, at: Floats, refine: int) -> Mesh:
        """Return the mesh of the body whose start is `at`, with `refine` times the elements asked for.

        Parameters
        ----------
        at : (dim,) array
            Start of the body [length].
        refine
            Factor on the number of elements.
        """


class Material(Component, contract="materials"):
    """A one-dimensional material: stress from strain.

    The kernel ``stress(parameters, strain)`` gets the (k,) array that `parameters` returned and a float, and
    returns a float. ``energy_density(parameters, before, after)`` is the staggered strain energy per volume of the
    strains at t_n and t_n+1; for a linear material half the product of the one's stress and the other's strain.

    Attributes
    ----------
    linear
        Whether the stress is `modulus` times the strain, whatever the strain. A body is linear if its element and its
        material both say so. Exact solutions, certificates, the guarantees of energy and the energy identity to
        round-off are for linear bodies; of any other body percuss says that it does not know. The conformance kit
        holds the declaration against the kernels.
    """

    linear: ClassVar[bool] = False

    @property
    @abstractmethod
    def rho(self) -> float:
        """Density [mass/length^3]."""

    @property
    @abstractmethod
    def modulus(self) -> float:
        """Largest tangent modulus, from which wave speed, step and penalty scales follow [force/length^2]."""

    @abstractmethod
    def parameters(self) -> tuple[float, ...]:
        """Return what the kernels need, as plain numbers."""

    @staticmethod
    @abstractmethod
    def stress(parameters: Floats, strain: float) -> float:
        """Return the stress at `strain` [force/length^2]; a kernel."""

    @staticmethod
    @abstractmethod
    def energy_density(parameters: Floats, before: float, after: float) -> float:
        """Return the staggered strain-energy density of two consecutive strains [energy/length^3]; a kernel."""


@dataclass(frozen=True)
class BodyMesh:
    """What an element may know of the body it fills.

    Attributes
    ----------
    mesh : Mesh
        Nodes, element lengths and direction.
    area : float
        Cross-section [length^2].
    """

    mesh: Mesh
    area: float


class Element(Component, contract="elements"):
    """A two-node line element.

    Both kernels work on a run of consecutive elements, of which `first` is the number of the first in the bound
    arrays; displacement, velocity and force are flat, node by node, `dim` components each.

    ``internal_force(element, parameters, first, dim, displacement, force)`` *sets* `force` to what the stretched
    elements do to their nodes. ``energy(element, parameters, first, dim, displacement, velocity, dt)`` returns their
    staggered strain energy, where `displacement` is at n + 1 and ``displacement - dt * velocity`` at n. They call the
    material by the slots `percuss.stress` and `percuss.energy_density`, with the strain of the element's own measure.

    The stress that a result shows of an element is what `stress` returned when `internal_force` was asked for the force
    of that element alone, the mean over its calls: whatever the strain measure, it is that of the force.

    Attributes
    ----------
    linear
        Whether the strain that is handed to the material, and the direction of the force, are linear in the
        displacement: the force is then proportional to the displacement wherever the material is linear too. A body is
        linear if its element and its material both say so (see `Material`). The conformance kit holds the declaration
        against the kernels.
    """

    linear: ClassVar[bool] = False

    @abstractmethod
    def bind(self, body: BodyMesh) -> Any:
        """Return a NamedTuple of (elements, ...) float arrays for one body."""

    @abstractmethod
    def axial_stiffness(self, body: BodyMesh, modulus: float) -> Floats:
        """Return the stiffness of each element along the line, (elements,) [force/length]."""

    @abstractmethod
    def highest_frequency(self, body: BodyMesh, wave_speed: float) -> Floats:
        """Return an upper bound of each element's own angular frequency with lumped mass, (elements,) [1/time]."""

    @staticmethod
    @abstractmethod
    def internal_force(
        element: Any, parameters: Floats, first: int, dim: int, displacement: Floats, force: Floats
    ) -> None:
        """Set `force` to the internal force of the elements on their nodes; a kernel."""

    @staticmethod
    @abstractmethod
    def energy(
        element: Any,
        parameters: Floats,
        first: int,
        dim: int,
        displacement: Floats,
        velocity: Floats,
        dt: float,
    ) -> float:
        """Return the staggered strain energy of the elements; a kernel."""


class Mass(Component, contract="masses"):
    """How element masses become nodal masses; always diagonal."""

    @abstractmethod
    def nodal(self, element_mass: Floats) -> Floats:
        """Return the (n + 1,) nodal masses of a line of (n,) element masses [mass]."""
