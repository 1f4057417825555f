"""Interfaces of the components of a body: shape, material, element and mass."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from percuss.methods.interfaces.base import Component, Floats


class Region(NamedTuple):
    """A named part of a body's boundary: its nodes, and the unit vector that points out of the body at them."""

    nodes: tuple[int, ...]
    outward: Floats


class Mesh(NamedTuple):
    """The mesh of a body along a line: element i joins nodes i and i + 1.

    Attributes
    ----------
    nodes : (n + 1, dim) array
        Positions [length].
    lengths : (n,) array
        Element lengths [length].
    direction : (dim,) array
        Unit vector along the line.
    regions
        Named ends; a case refers to places of a body only as ``BODY.REGION``.
    """

    nodes: Floats
    lengths: Floats
    direction: Floats
    regions: Mapping[str, Region]


class Shape(Component, contract="shapes"):
    """The geometry of a body; the name of the shape is a key in the body's mapping.

    Attributes
    ----------
    regions
        Names of the ends of the body.
    without_mesh
        Options that only control the mesh, with the values used if only an exact solution is computed and the case
        leaves these options out.
    """

    regions: ClassVar[tuple[str, ...]]
    without_mesh: ClassVar[Mapping[str, Any]] = {}

    @abstractmethod
    def dimension(self) -> int | None:
        """Return the number of space dimensions that the options imply, or None if any number is possible."""

    @abstractmethod
    def mesh(self, at: Floats, refine: int) -> Mesh:
        """Return the mesh of the body that starts at `at`, with `refine` times the number of elements in the options.

        Parameters
        ----------
        at : (dim,) array
            Start of the body [length].
        refine
            Factor on the number of elements.
        """

    def element_count(self, refine: int) -> int | None:  # noqa: ARG002
        """Return the number of elements of `mesh` without making it, or None where only the mesh tells.

        A case whose elements do not fit into memory is refused by this number; without it the mesh is made first.
        """
        return None


class Material(Component, contract="materials"):
    """A one-dimensional material law: stress as a function of strain.

    The kernel ``stress(parameters, strain)`` takes the (k,) array that `parameters` returned and a float, and returns a
    float. ``energy_density(parameters, before, after)`` returns the staggered strain energy per volume for the strains
    at t_n and t_n+1; for a linear material it is half the product of the stress at one time and the strain at the
    other.

    Attributes
    ----------
    linear
        Whether the stress is `modulus` times the strain for any strain. A body is linear if its element and its
        material are both declared linear. Exact solutions, certificates, energy guarantees and the energy identity to
        round-off hold for linear bodies; for any other body percuss reports them as unknown. The conformance kit
        compares the declaration with the kernels.
    """

    linear: ClassVar[bool] = False

    @property
    @abstractmethod
    def rho(self) -> float:
        """Mass density [mass/length^3]."""

    @property
    @abstractmethod
    def modulus(self) -> float:
        """Largest tangent modulus, which sets wave speed, time step and penalty scales [force/length^2]."""

    @abstractmethod
    def parameters(self) -> tuple[float, ...]:
        """Return the numbers that the kernels need."""

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
    """The data of a body that an element of it can use.

    Attributes
    ----------
    mesh : Mesh
        Nodes, element lengths and direction.
    area : float
        Area of the cross-section [length^2].
    """

    mesh: Mesh
    area: float


class Element(Component, contract="elements"):
    """A two-node line element.

    Both kernels work on consecutive elements; `first` is the number of the first of them in the bound arrays.
    Displacement, velocity and force are flat arrays, node by node, with `dim` components per node.

    ``internal_force(element, parameters, first, dim, displacement, force)`` *sets* `force` to the forces of the
    stretched elements on their nodes. ``energy(element, parameters, first, dim, displacement, velocity, dt)`` returns
    their staggered strain energy, where `displacement` is at n + 1 and ``displacement - dt * velocity`` at n. Both call
    the material by the slots `percuss.stress` and `percuss.energy_density`, with the strain measure of the element.

    The element stress in a result is the mean of the values that `stress` returned while `internal_force` computed the
    force of that element alone. It is therefore the stress behind the force for any strain measure.

    Attributes
    ----------
    linear
        Whether the strain passed to the material is linear in the displacement and the direction of the force is
        constant: the force is then proportional to the displacement if the material is linear too. A body is linear if
        its element and its material are both declared linear (see `Material`). The conformance kit compares the
        declaration with the kernels.
    """

    linear: ClassVar[bool] = False

    @abstractmethod
    def bind(self, body: BodyMesh) -> Any:
        """Return the element data of one body for the kernels: a NamedTuple of (elements, ...) float arrays."""

    @abstractmethod
    def axial_stiffness(self, body: BodyMesh, modulus: float) -> Floats:
        """Return the axial stiffness of each element, (elements,) [force/length]."""

    @abstractmethod
    def highest_frequency(self, body: BodyMesh, wave_speed: float) -> Floats:
        """Return an upper bound of the angular frequency of each element with lumped mass, (elements,) [1/time]."""

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
    """A rule that turns element masses into nodal masses; the mass matrix is always diagonal."""

    @abstractmethod
    def nodal(self, element_mass: Floats) -> Floats:
        """Return the (n + 1,) nodal masses [mass] for the (n,) element masses of a line mesh."""
