"""Interfaces of the components of a body: shape, material, element and mass."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from percuss.methods.interfaces.base import Component, Floats, Integers

AT_A_TIME = 20_000  # cells whose coordinates are looked at together, which stay in the cache
SAME_SHAPE = 11  # decimal digits of the coordinates of a cell, over its length, by which cells are told apart


class Region(NamedTuple):
    """A named part of a body's boundary: its nodes, the unit vector that points out of the body at them, its facets.

    Attributes
    ----------
    nodes
        Numbers of its nodes in the mesh.
    outward : (dim,) array
        Unit vector out of the body.
    facets
        Nodes of each facet, (facets, nodes of a facet), by kind of facet; kinds have the names of cells, and
        ``vertex`` for a single node. Empty where every node is a facet of its own, as at the end of a line.
    """

    nodes: tuple[int, ...]
    outward: Floats
    facets: Mapping[str, Integers] = MappingProxyType({})


class Line(NamedTuple):
    """What a body along a line knows of it beside its nodes.

    Attributes
    ----------
    lengths : (n,) array
        Element lengths [length].
    direction : (dim,) array
        Unit vector along the line.
    """

    lengths: Floats
    direction: Floats


class Mesh(NamedTuple):
    """The mesh of a body: nodes, cells between them, and named regions of its boundary.

    A shape along a line makes a row of two-node cells, `of_line`. Where the element of the body has more nodes, percuss
    adds them between those of the shape, numbers all nodes along the line, and writes down the cells. Any other shape
    makes all nodes and cells itself.

    Attributes
    ----------
    nodes : (nodes, dim) array
        Positions [length].
    cells
        Node numbers of each cell, (cells, nodes of a cell), by kind of cell. Kinds have the names and the order of
        nodes of VTK and meshio: ``line``, ``line3``, ``line4``, ... (the ends first, then the nodes between them),
        ``triangle``, ``quad``, ``tetra``, ``hexahedron``.
    regions
        Named parts of the boundary; a case refers to places of a body only as ``BODY.REGION``.
    line
        Lengths and direction of a body along a line; None for any other body.
    """

    nodes: Floats
    cells: Mapping[str, Integers]
    regions: Mapping[str, Region]
    line: Line | None = None

    @classmethod
    def of_line(cls, nodes: Floats, lengths: Floats, direction: Floats, regions: Mapping[str, Region]) -> Mesh:
        """Return a row of two-node cells along a line, where cell i joins nodes i and i + 1.

        Parameters
        ----------
        nodes : (n + 1, dim) array
            Positions [length].
        lengths : (n,) array
            Element lengths [length].
        direction : (dim,) array
            Unit vector along the line.
        regions
            Named ends.
        """
        first = np.arange(np.size(lengths), dtype=np.int64)
        return cls(nodes, {"line": np.stack([first, first + 1], axis=1)}, regions, Line(lengths, direction))

    def turned(self, angle: float, axis: Sequence[float] = (0.0, 0.0, 1.0)) -> Mesh:
        """Return the mesh turned about the middle of its extent, anticlockwise by an angle [rad] about an axis."""
        x, y, z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
        across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        matrix = math.cos(angle) * np.eye(3) + math.sin(angle) * across
        matrix += (1.0 - math.cos(angle)) * np.outer((x, y, z), (x, y, z))
        matrix = matrix[: self.nodes.shape[1], : self.nodes.shape[1]]
        middle = 0.5 * (self.nodes.min(axis=0) + self.nodes.max(axis=0))
        regions = {name: region._replace(outward=matrix @ region.outward) for name, region in self.regions.items()}
        return self._replace(nodes=middle + (self.nodes - middle) @ matrix.T, regions=regions)

    @property
    def lengths(self) -> Floats:
        """Element lengths of a body along a line, (n,)."""
        return self._along.lengths

    @property
    def direction(self) -> Floats:
        """Unit vector along the line, (dim,)."""
        return self._along.direction

    @property
    def _along(self) -> Line:
        if self.line is None:
            raise TypeError(f"a mesh of {', '.join(self.cells)} cells is not along a line")
        return self.line


class Shape(Component, contract="shapes"):
    """The geometry of a body; the name of the shape is a key in the body's mapping.

    Attributes
    ----------
    regions
        Names of the parts of the boundary, the ends of a body along a line: a class attribute, or a property where it
        depends on the options.
    no_regions
        Names that a case may take for regions, each with the reason why it is none.
    cell
        Kind of the cells that it makes; ``line`` for a body along a line.
    """

    regions: ClassVar[tuple[str, ...]]
    no_regions: ClassVar[Mapping[str, str]] = MappingProxyType({})
    cell: ClassVar[str] = "line"

    @abstractmethod
    def dimension(self) -> int | None:
        """Return the number of space dimensions that the options imply, or None if any number is possible."""

    @abstractmethod
    def mesh(self, at: Floats, refine: float) -> Mesh:
        """Return the mesh of the body that starts at `at`, with `refine` times the number of elements in the options.

        Parameters
        ----------
        at : (dim,) array
            Start of the body [length].
        refine
            Factor on the number of elements, below 1 for a coarser mesh; `refined` makes it a whole number.

        Raises
        ------
        OptionError
            If there is no such mesh with `refine`.
        """

    @staticmethod
    def refined(elements: int, refine: float) -> int:
        """Return `refine` times a number of elements: the nearest whole number, and at least 1."""
        return max(1, round(elements * refine))

    def element_count(self, refine: float) -> int | None:  # noqa: ARG002
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

    A material whose stress depends on the past declares ``state = k``, and its kernel is ``stress(parameters, strain,
    before, after)``: it finds k state variables of the point in `before`, as the last step has left them, zeros in the
    first step, and writes them to `after`, which begins as a copy of `before`. The framework owns them and carries them
    over once a step. One of them is the energy that the material stores; no `energy_density` is needed::

        state = 3
        stored_in, dissipated_in = 1, 2

        @staticmethod
        def stress(parameters, strain, before, after):  # elastic, perfectly plastic
            young, limit = parameters[0], parameters[1]
            trial = young * (strain - before[0])
            value = min(max(trial, -limit), limit)
            after[0] = strain - value / young
            after[1] = 0.5 * value**2 / young
            after[2] = before[2] + value * (after[0] - before[0])
            return value

    Attributes
    ----------
    state
        Number of state variables of each point at which an element evaluates the stress.
    stored_in, dissipated_in
        Numbers, from 0, of the state variables that are the energy stored per volume, and the energy dissipated so far
        per volume [energy/length^3]; the latter is None if the material does not say.
    plastic_in
        Number of the state variable that is the equivalent plastic strain, a field of results; None without one.
    linear
        Whether the stress is `modulus` times the strain for any strain. A body is linear if its element and its
        material are both declared linear. Exact solutions, certificates, energy guarantees and the energy identity to
        round-off hold for linear bodies; for any other body percuss reports them as unknown. The conformance kit
        compares the declaration with the kernels.
    """

    linear: ClassVar[bool] = False
    state: ClassVar[int] = 0
    stored_in: ClassVar[int | None] = None
    dissipated_in: ClassVar[int | None] = None
    plastic_in: ClassVar[int | None] = None

    @property
    def elsewhere(self) -> str:
        """What to take for bodies for which it is not, in a sentence; empty if nothing is to be said."""
        return ""

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
    def energy_density(parameters: Floats, before: float, after: float) -> float:
        """Return the staggered strain-energy density of two consecutive strains [energy/length^3]; a kernel.

        A material with state variables needs none.
        """
        raise NotImplementedError


class SolidMaterial(Material, contract="materials"):
    """A material of bodies in two and three dimensions; of bars too where it has a `stress`.

    Its kernels give the first Piola-Kirchhoff stress P as a function of the displacement gradient H, ``H_ij = d u_i / d
    X_j``, both row by row, as numbers in a tuple: (xx, xy, yx, yy) in two dimensions. A material for small strains uses
    the symmetric part of H, and P is then symmetric too. It may have kernels for two dimensions, for three, or both.

    A material that is not `linear` is one of finite strain: it is not asked where ``det(I + H)`` is not positive. It
    gives the energy that it stores per volume too, by `stored_2d` or `stored_3d`, or as a state variable. Of a linear
    one that is half the product of stress and gradient. With state variables the kernels take ``before`` and ``after``
    too, as `Material.stress` does; `stress_3d` alone then serves plane strain, with zeros across.

    Attributes
    ----------
    needs_step
        Whether the kernels need the time step, as those of a stress that depends on the rate of strain: it then stands
        behind the numbers of `solid_parameters` [time]. It is infinite where nothing moves in time, as in the checks of
        the kit and in the stiffness at rest, so that a rate is zero there. A scheme of stages is refused.
    """

    needs_step: ClassVar[bool] = False
    stress: Any = None
    stress_2d: Any = None
    stress_3d: Any = None
    stored_2d: Any = None
    stored_3d: Any = None

    @property
    def modulus(self) -> float:
        """Largest tangent modulus of a bar [force/length^2]; only of a material that has a `stress`."""
        raise NotImplementedError

    def parameters(self) -> tuple[float, ...]:
        """Return the numbers that `stress` needs; only of a material that has one."""
        return ()

    @abstractmethod
    def wave_modulus(self, plane: str) -> float:
        """Return the largest tangent modulus of a longitudinal wave, ``rho c^2`` [force/length^2].

        Parameters
        ----------
        plane
            ``"strain"`` or ``"stress"`` in two dimensions, empty in three and of bodies of revolution.
        """

    @abstractmethod
    def solid_parameters(self, plane: str) -> tuple[float, ...]:
        """Return the numbers that the kernels for two or three dimensions need; `plane` as of `wave_modulus`."""


def some_at_a_time(count: int, most: int = AT_A_TIME) -> list[slice]:
    """Return the slices of so many cells of which none has more than `most`."""
    return [slice(start, start + most) for start in range(0, count, most)]


@dataclass(frozen=True)
class BodyMesh:
    """The data of a body that an element of it can use.

    Attributes
    ----------
    mesh : Mesh
        Nodes and cells.
    section : float
        Area of the cross-section of a body along a line [length^2]; the thickness of a body in two dimensions [length];
        1 in three.
    plane
        ``"strain"``, ``"stress"`` or ``"axisymmetric"`` in two dimensions, else empty.
    """

    mesh: Mesh
    section: float
    plane: str = ""

    @property
    def plane_of_material(self) -> str:
        """The plane as a material receives it; a body of revolution has stresses in three dimensions."""
        return "" if self.plane == "axisymmetric" else self.plane

    @cached_property
    def kinds(self) -> tuple[Integers, Integers]:
        """The first cell of each kind, (kinds,), and the kind of each cell, (cells,), by shape and size."""
        nodes, cells = self.mesh.nodes, next(iter(self.mesh.cells.values()))
        parts = some_at_a_time(len(cells))
        size = max(float(np.abs(nodes[cells[some]] - nodes[cells[some, :1]]).max()) for some in parts)
        weights = np.random.default_rng(0).integers(1 << 63, size=cells.shape[1] * nodes.shape[1], dtype=np.uint64)
        # one number of a kind
        mixed = np.concatenate([self._rounded(some, size).view(np.uint64) @ weights for some in parts])
        _, first, kind = np.unique(mixed, return_index=True, return_inverse=True)
        of_kinds = self._rounded(first, size)
        if not all(np.array_equal(of_kinds[kind[some]], self._rounded(some, size)) for some in parts):
            # two kinds were mixed to one number
            _, first, kind = np.unique(self._rounded(slice(None), size), axis=0, return_index=True, return_inverse=True)
        return first, kind.ravel()

    def _rounded(self, some: Any, size: float) -> Integers:
        """Return the places of the nodes of some cells relative to their first node, as whole numbers."""
        own, nodes = next(iter(self.mesh.cells.values()))[some], self.mesh.nodes
        relative = nodes[own] - nodes[own[:, :1]]
        if self.plane == "axisymmetric":  # where the distance from the axis tells cells apart, too
            relative[..., 0] = nodes[own, 0]
        rounded: Integers = np.rint(relative.reshape(len(own), -1) * (10.0**SAME_SHAPE / size)).astype(np.int64)
        return rounded

    @cached_property
    def of_each_kind(self) -> BodyMesh:
        """The first cell of each kind alone, among the nodes of the whole body."""
        ((name, cells),) = self.mesh.cells.items()
        return BodyMesh(self.mesh._replace(cells={name: cells[self.kinds[0]]}), self.section, self.plane)


class Element(Component, contract="elements"):
    """A two-node line element.

    Both kernels work on consecutive elements; `first` is the number of the first of them in the bound arrays.
    Displacement, velocity and force are flat arrays, node by node, with `dim` components per node.

    ``internal_force(element, material, first, dim, displacement, force)`` *sets* `force` to the forces of the stretched
    elements on their nodes. ``energy(element, material, first, dim, displacement, velocity, dt)`` returns their
    staggered strain energy, where `displacement` is at n + 1 and ``displacement - dt * velocity`` at n. Both call the
    material by the slots ``percuss.stress(material, point, strain)`` and ``percuss.energy_density(material, point,
    before, after)``, with the strain measure of the element. `material` is only passed on; `point` is the number of the
    element in the bound arrays, ``first + i``.

    The element stress in a result is the mean of the values that `stress` returned while `internal_force` computed the
    force of that element alone. It is therefore the stress behind the force for any strain measure.

    Attributes
    ----------
    linear
        Whether the strain passed to the material is linear in the displacement and the direction of the force is
        constant: the force is then proportional to the displacement if the material is linear too. A body is linear if
        its element and its material are both declared linear (see `Material`). The conformance kit compares the
        declaration with the kernels.
    cell
        Kind of its cells. An element of any other kind than ``line`` is a `CellElement`.
    """

    linear: ClassVar[bool] = False
    cell: ClassVar[str] = "line"

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
    def internal_force(element: Any, material: Any, first: int, dim: int, displacement: Floats, force: Floats) -> None:
        """Set `force` to the internal force of the elements on their nodes; a kernel."""

    @staticmethod
    @abstractmethod
    def energy(
        element: Any,
        material: Any,
        first: int,
        dim: int,
        displacement: Floats,
        velocity: Floats,
        dt: float,
    ) -> float:
        """Return the staggered strain energy of the elements; a kernel."""


class CellElement(Element, contract="elements"):
    """An element of any number of nodes in any dimension, whose kernel sees one cell at a time.

    percuss gathers geometry and displacements of each cell, calls the kernel, and adds the forces that it sets to
    those of the neighbours. It makes the nodes of a cell along a line that lie between those of the shape. The kernel
    ``force(rule, material, first, section, geometry, displacement, force)`` *sets* `force` to the forces of the
    strained cell on its nodes. It calls the material once for each of its quadrature points by the slot
    ``percuss.stress(material, first + q, strain)``, with q from 0. The state variables of a material belong to these
    points.

    The strain energy of a cell is the sum over its points of their `volumes` times the energy density of the material
    at the strain with which the kernel calls `stress`. The element stress in a result is the mean of the stresses of
    its points, weighted with their volumes.

    Attributes
    ----------
    cell
        Kind of its cells, such as ``line3``: a class attribute, or a property where it depends on the options.
    linear
        As of `Element`.
    """

    @abstractmethod
    def rule(self) -> Any:
        """Return the arrays that the kernel reads of every cell: a NamedTuple that follows from the options.

        The kernel may write to them, as room to work in; cells are computed one after the other.
        """

    def reference_nodes(self) -> Floats:
        """Return the positions of the nodes along a cell, (nodes,): 0 and 1 of the ends, then those between them.

        It is asked of cells along a line alone.
        """
        raise NotImplementedError

    @abstractmethod
    def mass_shares(self, body: BodyMesh) -> Floats:
        """Return the share of each node in the mass of its cell, in the order of nodes of a cell.

        (nodes,) where it is the same in all cells, else (cells, nodes).
        """

    @abstractmethod
    def volumes(self, body: BodyMesh) -> Floats:
        """Return the volume of each quadrature point of each cell, (elements, points) [length^3]."""

    def geometry(self, body: BodyMesh) -> Floats:
        """Return what the kernel reads of each cell, (elements, ...); by default the coordinates of its nodes."""
        return body.mesh.nodes[body.mesh.cells[self.cell]]

    def volumes_of_cells(self, body: BodyMesh) -> Floats:
        """Return the volume of each cell, (elements,) [length^3]; by default the sum of those of its points."""
        volumes: Floats = np.sum(self.volumes(body), axis=1)
        return volumes

    @staticmethod
    @abstractmethod
    def force(
        rule: Any,
        material: Any,
        first: int,
        section: float,
        geometry: Floats,
        displacement: Floats,
        force: Floats,
    ) -> None:
        """Set `force` to the forces of one cell on its nodes; a kernel.

        Parameters
        ----------
        rule
            What `rule` returned.
        material
            Passed on to the slot `percuss.stress`.
        first
            Number of the first quadrature point of the cell.
        section
            That of the body, `BodyMesh.section`.
        geometry
            That of the cell, as `geometry` returned it.
        displacement, force : (nodes, dim) arrays
            Of the nodes of the cell.
        """

    def axial_stiffness(self, body: BodyMesh, modulus: float) -> Floats:
        """Return EA/h of each cell along a line, (elements,) [force/length]."""
        return modulus * body.section / body.mesh.lengths

    # `rule`, `volumes` and the mesh are all that percuss reads of a cell, and it adds up forces and energies itself.
    bind = internal_force = energy = None  # type: ignore[assignment]


class SolidElement(CellElement, contract="elements"):
    """An element of cells whose kernel asks the material for the stress of a displacement gradient.

    It is a `CellElement` but for that: the kernel calls ``percuss.stress_2d(material, first + q, gradient)`` or
    ``percuss.stress_3d``, once for each quadrature point q, with a tuple of numbers as `SolidMaterial` has it.

    Attributes
    ----------
    dimension
        Number of dimensions of the gradient, 2 or 3.
    about_axis
        Whether it is of bodies of revolution, whose gradient has three dimensions: the third is around the axis x = 0.
    locks
        Whether it is too stiff where the material is almost incompressible, and where long cells bend; percuss warns.
    isochoric
        Whether it is the one for materials with state variables, which flow without a change of volume.
    hourglass_points
        Number of its quadrature points, the last ones, that only hold hourglass modes. They have no part in the
        element stress, and their part of the strain energy is recorded as ``hourglass_energy``.
    """

    dimension: ClassVar[int]
    about_axis: ClassVar[bool] = False
    locks: ClassVar[bool] = False
    isochoric: ClassVar[bool] = False
    hourglass_points: ClassVar[int] = 0

    def highest_frequency(self, body: BodyMesh, wave_speed: float) -> Floats:
        """Raise NotImplementedError: percuss finds the frequency of each cell from its stiffness and mass."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class Lumping:
    """The way in which the elements of a body share their mass among their nodes.

    Attributes
    ----------
    shares : (n, nodes of a cell) array
        Share of each node of each element in its mass; 1/2 and 1/2 for a two-node element.
    cells : (n, nodes of a cell) array
        Nodes of each element.
    nodes
        Number of nodes.
    """

    shares: Floats
    cells: Integers
    nodes: int

    @classmethod
    def of_line(cls, count: int) -> Lumping:
        """Return that of a line of two-node elements."""
        first = np.arange(count)
        return cls(np.full((count, 2), 0.5), np.stack([first, first + 1], axis=1), count + 1)

    def at_nodes(self, element_mass: Floats) -> Floats:
        """Return the (nodes,) masses that the (n,) masses of the elements leave at the nodes [mass]."""
        nodal = np.zeros(self.nodes)
        for shares, nodes in zip(self.shares.T, self.cells.T, strict=True):
            nodal += np.bincount(nodes, shares * element_mass, minlength=self.nodes)
        return nodal


class Mass(Component, contract="masses"):
    """A rule that turns element masses into nodal masses, and may couple neighbouring nodes.

    An explicit step needs the inverse of the mass matrix. Of `nodal` it is diagonal; a rule that overrides `inverse`
    gives a sparse one instead, as reciprocal mass matrices are.

    An end in contact may have no mass: such a rule overrides `nodal_in_contact`, and percuss keeps that end in static
    balance with its contact, in the same equation as all other contacts (`percuss.ContactPoints.delassus`).
    """

    @abstractmethod
    def nodal(self, element_mass: Floats, lumping: Lumping) -> Floats:
        """Return the (nodes,) nodal masses [mass].

        Parameters
        ----------
        element_mass : (n,) array
            Masses of the elements of a body.
        lumping
            How its elements share their mass among their nodes: ``lumping.at_nodes(element_mass)`` is row-sum lumping.
        """

    def nodal_in_contact(self, element_mass: Floats, lumping: Lumping, in_contact: NDArray[np.bool_]) -> Floats:  # noqa: ARG002
        """Return the (nodes,) nodal masses of a body with nodes in contact; by default `nodal`.

        It is asked of lines of two-node elements alone; with more nodes a mass that overrides it is refused.

        Parameters
        ----------
        element_mass, lumping
            As of `nodal`.
        in_contact : (nodes,) bool array
            Whether a node is in contact, and nothing else acts there: no support, no drive and no load. At least one
            is. The mass of such a node, and of no other, may be 0; the node beside it then has mass.
        """
        return self.nodal(element_mass, lumping)

    def inverse(self, element_mass: Floats, lumping: Lumping) -> Any:  # noqa: ARG002
        """Return M^-1 of a body as a sparse array of SciPy; None, as by default, if M is diagonal, as `nodal` says.

        It is asked of lines of two-node elements alone; with more nodes a mass that overrides it is refused.

        Parameters
        ----------
        element_mass, lumping
            As of `nodal`.

        Returns
        -------
        (nodes, nodes) sparse array or None
            The symmetric, positive definite matrix [1/mass]. ``M^-1 m = 1`` for the masses m of `nodal`: a body that
            moves as a whole has their sum, and falls as it would with them.
        """
        return None
