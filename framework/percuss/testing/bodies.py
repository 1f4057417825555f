"""Small bodies of unlike elements, with the kernels of their elements in plain Python, for checks of their methods."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from percuss.jit import plain
from percuss.mesh.cell_kernels import add_up_forces, energy_of_cells
from percuss.mesh.cells import (
    cell_arrays,
    cells_of,
    element_slots,
    has_cells,
    is_solid,
    mesh_of_element,
    points_at_rest,
    slots_of_material,
)
from percuss.mesh.element_probe import ElementProbe
from percuss.methods.interfaces import BodyMesh, Floats, Mesh, Region, SolidMaterial
from percuss.methods.plugin_calls import answer
from percuss.methods.registry import Registry
from percuss.testing.subject import CheckFailed, NotApplicable

SECTION = 1.3
STEP = 1e-6  # of the difference quotients of energies
CLOSE = 1e-9  # largest error over the largest force
# What `block` calls the cells that fill it, and the dimensions of their block.
BLOCKS = {"quad": ("quad4", 2), "triangle": ("tri3", 2), "hexahedron": ("hex8", 3), "tetra": ("tet4", 3)}


def line(count: int, dim: int = 1) -> Mesh:
    """Return a line mesh of unlike elements, along an oblique direction in two and three dimensions."""
    direction = np.array([1.0, 2.0, -2.0][:dim])
    direction /= np.linalg.norm(direction)
    lengths = 0.1 * (1.0 + 0.2 * np.cos(np.arange(count)))
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    regions = {"left": Region((0,), -direction), "right": Region((count,), direction)}
    return Mesh.of_line(along[:, None] * direction, lengths, direction, regions)


def patch(cell: str, registry: Registry) -> Mesh:
    """Return two by two cells of uneven sizes in a block round a node inside, its middle one; in space two in each way.

    Raises
    ------
    NotApplicable
        If there is no block of such cells.
    """
    kind, dim = BLOCKS.get(cell, ("", 0))
    if not kind or ("shapes", "block") not in registry.components:
        raise NotApplicable(f"the kit has no block of {cell} cells")
    block: Any = registry.components["shapes", "block"]
    shape = block(size=(1.2, 1.1, 1.3)[:dim], elements=(2, 2, 2)[:dim], cells=kind, grading=(1.4, 0.7, 1.2)[:dim])
    mesh: Mesh = shape.mesh(np.zeros(dim), 1)
    nodes = mesh.nodes.copy()
    nodes[len(nodes) // 2] += np.array([0.08, -0.05, 0.06])[:dim]
    return Mesh(nodes, mesh.cells, {})


def uneven(*shape: int) -> Floats:
    """Return an array of numbers between -1 and 1 without any order."""
    return np.asarray(np.cos(np.arange(math.prod(shape)) ** 2.0).reshape(shape), dtype=float)


def slopes(function: Callable[[Floats], Any], at: Floats, step: float) -> Floats:
    """Return the symmetric difference quotients of a function by the entries of its argument, which come first."""
    steps = step * np.eye(at.size).reshape(-1, *at.shape)
    found = np.array([function(at + one) - function(at - one) for one in steps]) / (2.0 * step)
    return found.reshape(*at.shape, *found.shape[1:])


class SolidKernels(NamedTuple):
    """A material of bodies that are no bars, in one plane or in space.

    Attributes
    ----------
    dim, plane
        Number of dimensions, and the plane, empty in space.
    modulus
        What `wave_modulus` says.
    stress, energy
        Stress, (dim, dim), and stored energy per volume as functions of the displacement gradient, (dim, dim).
    """

    dim: int
    plane: str
    modulus: float
    stress: Callable[[Floats], Floats]
    energy: Callable[[Floats], float]


def solid_kernels(material: Any) -> Iterator[SolidKernels]:
    """Yield the kernels of a material in each plane, and in space, in which it works."""
    for dim, plane in ((2, "strain"), (2, "stress"), (3, "")):
        kernel, stored = (getattr(material, f"{what}_{dim}d", None) for what in ("stress", "stored"))
        if kernel is None:
            continue
        try:
            parameters = np.array(answer(material, "solid_parameters", plane))
        except ValueError:  # of a bar alone, or not in this plane
            continue
        stress = partial(_stress_of, kernel, parameters)
        energy = partial(_half_the_product, stress) if stored is None else partial(_stored, stored, parameters)
        yield SolidKernels(dim, plane, float(answer(material, "wave_modulus", plane)), stress, energy)


def _stress_of(kernel: Any, parameters: Floats, gradient: Floats) -> Floats:
    return np.array(kernel(parameters, tuple(gradient.ravel().tolist()))).reshape(gradient.shape)


def _stored(kernel: Any, parameters: Floats, gradient: Floats) -> float:
    return float(kernel(parameters, gradient.ravel()))


def _half_the_product(stress: Callable[[Floats], Floats], gradient: Floats) -> float:
    return 0.5 * float((stress(gradient) * gradient).sum())


@dataclass(frozen=True)
class FiniteStrain(SolidMaterial):
    """Hooke's law of Green's strain: no rotation of the body gives stress.

    Formula: ``P = F (tr(E) I + 2 E)``, ``E = (F^T F - I) / 2``, ``F = I + H``.
    """

    name = "finite-strain"
    summary = "Hooke's law of Green's strain"
    rho = 3.0

    def wave_modulus(self, plane: str) -> float:  # noqa: ARG002
        """Return 3."""
        return 3.0

    def solid_parameters(self, plane: str) -> tuple[float, ...]:  # noqa: ARG002
        """Return nothing."""
        return ()

    @staticmethod
    def stress_2d(parameters: Floats, gradient: tuple[float, ...]) -> tuple[float, ...]:  # noqa: ARG004
        """Return the stress of a displacement gradient."""
        deformed, strain = _strained(gradient)
        return tuple((deformed @ (np.trace(strain) * np.eye(len(strain)) + 2.0 * strain)).ravel().tolist())

    @staticmethod
    def stored_2d(parameters: Floats, gradient: Floats) -> float:  # noqa: ARG004
        """Return the stored energy per volume."""
        _, strain = _strained(gradient)
        return float(0.5 * np.trace(strain) ** 2 + (strain**2).sum())

    stress_3d, stored_3d = stress_2d, stored_2d


def _strained(gradient: Any) -> tuple[Floats, Floats]:
    """Return deformation gradient and Green's strain of a displacement gradient."""
    identity = np.eye(math.isqrt(np.size(gradient)))
    deformed = identity + np.reshape(gradient, identity.shape)
    return deformed, 0.5 * (deformed.T @ deformed - identity)


class BodyKernels:
    """Force and energy of a body, from the kernels of its element and material in plain Python.

    Parameters
    ----------
    element, material
        The methods of the body.
    mesh
        Its mesh as a shape makes it; all three are attributes too.

    Attributes
    ----------
    body
        The body as its element receives it.
    probe
        The force of single elements.
    about_axis
        Whether it is a body of revolution.
    """

    def __init__(self, element: Any, material: Any, mesh: Mesh) -> None:
        self.element, self.material, self.mesh = element, material, mesh
        self.about_axis = bool(getattr(element, "about_axis", False))
        flat = is_solid(element) and mesh.nodes.shape[1] == 2
        plane = "axisymmetric" if self.about_axis else "strain" if flat else ""
        section = 1.0 if self.about_axis or (is_solid(element) and not flat) else SECTION
        self.body = BodyMesh(mesh_of_element(element, mesh), section, plane)
        self.probe = ElementProbe(element, material, self.body)
        points = points_at_rest(element, material, self.body)
        slots = {**slots_of_material(element, material), **element_slots(element)}
        if has_cells(element):
            kernels: Any = (add_up_forces, energy_of_cells)
            cells = cell_arrays(element, [self.body])
            arguments: tuple[Any, ...] = (cells, points, 0)
        else:
            kernels = (element.internal_force, element.energy)
            arguments = (element.bind(self.body), points, 0, mesh.nodes.shape[1])
        self._force, self._energy = (partial(plain(kernel, slots), *arguments) for kernel in kernels)

    @property
    def motion(self) -> Floats:
        """Small displacements without any order, (nodes, dim)."""
        return 1e-3 * uneven(*self.body.mesh.nodes.shape)

    def force(self, displacement: Floats) -> Floats:
        """Return the internal force on the nodes, (nodes, dim); nan where the kernel leaves an entry unset."""
        force = np.full(displacement.size, np.nan)
        self._force(displacement.ravel(), force)
        return force.reshape(displacement.shape)

    def energy(self, displacement: Floats) -> float:
        """Return the strain energy at rest."""
        return float(self._energy(displacement.ravel(), np.zeros(displacement.size), 0.0))

    def checked_force(self) -> Floats:
        """Return the force of `motion`, (nodes, dim).

        Raises
        ------
        CheckFailed
            Unless it is minus the slope of the energy, has no resultant, is the same in another place, and is the sum
            of the forces of single elements.
        """
        u, dim = self.motion, self.body.mesh.nodes.shape[1]
        force = self.force(u)
        size = float(np.abs(force).max())
        if np.isnan(force).any():
            kernel = "force" if has_cells(self.element) else "internal_force"
            raise CheckFailed(f"`{kernel}` leaves an entry unset: it must set every entry, not add to it")
        slope = slopes(self.energy, u, STEP)
        if np.abs(force + slope).max() > 1e-6 * size:
            i = int(np.argmax(np.abs(force + slope)))
            message = (
                f"entry {i} of the force is {force.flat[i]:.6g}, minus the slope of the energy {-slope.flat[i]:.6g}"
            )
            raise CheckFailed(message)
        rigid = np.arange(1.0, dim + 1.0)
        rigid[: int(self.about_axis)] = 0.0  # a ring moves along its axis alone
        if np.abs(force.sum(axis=0))[rigid > 0.0].max() > CLOSE * size:
            raise CheckFailed(f"the sum of the internal forces is not zero in {dim} dimensions")
        if np.abs(self.force(u + 1e-3 * rigid) - force).max() > CLOSE * size:
            raise CheckFailed("a translation of the body changes its internal force")
        of_elements = np.zeros(u.shape)
        for number, nodes in enumerate(cells_of(self.body.mesh)):
            of_elements[nodes] += self.probe.force(number, u[nodes].ravel()).reshape(-1, dim)
        if np.abs(of_elements - force).max() > CLOSE * size:
            raise CheckFailed("the forces of single elements, from `first` on, do not add up to that of the whole body")
        return force
