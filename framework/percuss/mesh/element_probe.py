"""The elements of a body one by one: their forces, stresses and stiffness, from the kernels that the loop uses.

What fills the slot of the material also keeps each answer. The stress of an element is therefore the one behind its
force, whatever strain the element measures and whatever it does with the stress. Few elements are asked in plain
Python, many in compiled code.
"""

from __future__ import annotations

import functools
import math
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.errors import PluginError
from percuss.jit import compile_error, compiled_function, jit_disabled, plain
from percuss.mesh.cells import cells_of, is_solid, points_at_rest, slots_of_material, solid_parameters, volumes_of
from percuss.mesh.materials import MaterialPoints
from percuss.methods import slots
from percuss.methods.blame import definition_place, described, line_in_plugin
from percuss.methods.interfaces import CellElement
from percuss.methods.plugin_calls import answer, read_only
from percuss.methods.slots import unbound

if TYPE_CHECKING:
    from percuss.jit import Kernel
    from percuss.methods.interfaces import BodyMesh, Floats, Integers

MANY = 2000  # calls of a kernel from which on plain Python takes longer than to load the compiler
TOGETHER = 150_000  # numbers of the forces that are found together, which stay in the cache
ACROSS = 4  # column of the stress across a plane, after those of the stress in it


class Elements(NamedTuple):
    """What the kernel of an element reads of a body, beside its material."""

    arrays: Any  # the rule of its cells, or the bound arrays of two-node elements
    geometry: Floats  # (cells, ...), of two-node elements without entries
    section: float
    points: int  # of each element


class Answers(NamedTuple):
    """The material of a body as its elements call it, and what it answers at each point."""

    points: MaterialPoints
    in_space: Floats  # (k,) parameters of the material in three dimensions
    calls: Integers  # (points,) number of calls
    stress: Floats  # (points, components) sum of the stresses of all calls, of a plane also of those across it
    strain: Floats  # (points, components) strain or displacement gradient of the last call


# ---------------------------------------------------------------------------------------------------- kernels


def force_of_element(elements: Elements, material: Any, number: int, displacement: Floats, force: Floats) -> None:
    """Set the force of an element on its nodes, (nodes, dim) (slot for one of the two functions below)."""
    unbound()


def force_of_cell(elements: Elements, material: Any, number: int, displacement: Floats, force: Floats) -> None:
    """Set the force of a cell on its nodes."""
    geometry, first = elements.geometry[number], number * elements.points
    slots.cell_force(elements.arrays, material, first, elements.section, geometry, displacement, force)


def force_of_line(elements: Elements, material: Any, number: int, displacement: Floats, force: Floats) -> None:
    """Set the force of a two-node element on its nodes."""
    dim, size = displacement.shape[1], displacement.size
    slots.internal_force(elements.arrays, material, number, dim, displacement.reshape(size), force.reshape(size))


def stress_of_material(points: MaterialPoints, point: int, strain: Any) -> Any:
    """Return the stress of a point (slot for what calls the kernel of the material)."""
    unbound()


def stress_in_space(parameters: Floats, gradient: tuple[float, ...]) -> tuple[float, ...]:
    """Return the stress of a displacement gradient in three dimensions (slot for the kernel of a material)."""
    unbound()


def keep_stress(material: Answers, point: int, strain: float) -> float:
    """Return the stress at a point of a bar, and keep it."""
    stress = stress_of_material(material.points, point, strain)
    material.calls[point] += 1
    material.stress[point, 0] += stress
    material.strain[point, 0] = strain
    return stress  # type: ignore[no-any-return]


def keep_tensor(material: Answers, point: int, gradient: tuple[float, ...]) -> tuple[float, ...]:
    """Return the stress at a point of a solid, and keep it."""
    stress = stress_of_material(material.points, point, gradient)
    material.calls[point] += 1
    for k in range(len(gradient)):
        material.stress[point, k] += stress[k]
        material.strain[point, k] = gradient[k]
    return stress  # type: ignore[no-any-return]


def keep_with_stress_across(material: Answers, point: int, gradient: tuple[float, ...]) -> tuple[float, ...]:
    """Return the stress at a point in plane strain, and keep it with the stress across the plane."""
    whole = (gradient[0], gradient[1], 0.0, gradient[2], gradient[3], 0.0, 0.0, 0.0, 0.0)
    material.stress[point, ACROSS] += stress_in_space(material.in_space, whole)[8]
    return keep_tensor(material, point, gradient)


def linear_stress(points: MaterialPoints, point: int, strain: float) -> float:
    """Return the stress of a linear material of bars, whose only parameter is its modulus."""
    return points.parameters[0] * strain  # type: ignore[no-any-return]


def find_forces(elements: Elements, material: Any, numbers: Integers, displacement: Floats, forces: Floats) -> None:
    """Set the forces of elements on their nodes at given displacements, (k, nodes, dim) arrays."""
    for k in range(numbers.size):
        first = numbers[k] * elements.points
        for point in range(first, first + elements.points):
            material.calls[point] = 0
            material.stress[point] = 0.0
        force_of_element(elements, material, numbers[k], displacement[k], forces[k])


# ------------------------------------------------------------------------------------------------------ probe


@functools.lru_cache(maxsize=64)
def _bound(filled: tuple[tuple[Kernel, Any], ...], *, jit: bool) -> Kernel:
    """Return `find_forces` with the kernels of element and material, compiled or plain; bound once a process."""
    return (compiled_function if jit else plain)(find_forces, dict(filled))


class ElementProbe:
    """Forces, stresses and stiffness of single elements of one body.

    Parameters
    ----------
    element, material
        The methods of the body.
    body
        The body as `Element.bind` receives it.
    modulus
        Modulus of a linear material that takes the place of that of a bar; None for the material itself.
    dt
        Time step; infinite where nothing moves in time.
    """

    def __init__(
        self, element: Any, material: Any, body: BodyMesh, modulus: float | None = None, dt: float = math.inf
    ) -> None:
        self._element, self._material = element, material
        self._plane, self._shape = body.plane, (cells_of(body.mesh).shape[1], body.mesh.nodes.shape[1])
        self._axes = np.eye(self._shape[1]) if body.mesh.line is None else body.mesh.direction[None]
        self._dimension = element.dimension if is_solid(element) else 0  # of its stresses
        self._slot: Any = {0: slots.stress, 2: slots.stress_2d, 3: slots.stress_3d}[self._dimension]
        self._weights = np.array(volumes_of(element, body))  # of the points, in the mean stress
        self._held = getattr(element, "hourglass_points", 0)
        self._weights[:, self._weights.shape[1] - self._held :] = 0.0
        points, in_space = points_at_rest(element, material, body, dt), np.zeros(0)
        filled, keep = slots_of_material(element, material), keep_tensor if self._dimension else keep_stress
        if modulus is not None:
            points, filled[self._slot] = points._replace(parameters=np.array([modulus])), linear_stress
        flat = self._dimension == 2 and body.plane == "strain"
        self._knows_across = flat and material.stress_3d is not None and material.state == 0
        if self._knows_across:
            in_space = solid_parameters(material, "", dt)
            keep, filled[stress_in_space] = keep_with_stress_across, material.stress_3d
        filled |= {self._slot: keep, stress_of_material: filled[self._slot]}
        if isinstance(element, CellElement):
            filled |= {force_of_element: force_of_cell, slots.cell_force: element.force}
            arrays, geometry = answer(element, "rule"), answer(element, "geometry", body)
        else:
            filled |= {force_of_element: force_of_line, slots.internal_force: element.internal_force}
            arrays, geometry = answer(element, "bind", body), np.zeros(0)
        self._elements = Elements(arrays, geometry, float(body.section), self._weights.shape[1])
        self._filled = tuple(filled.items())
        count, size = self._weights.size, max(1, self._dimension**2)
        stress, strain = np.zeros((count, size + (size == ACROSS))), np.zeros((count, size))
        self._answers = Answers(points, in_space, np.zeros(count, dtype=np.int64), stress, strain)
        self._views: tuple[Any, ...] = tuple(
            kept.reshape(*self._weights.shape, *kept.shape[1:]) for kept in self._answers[2:]
        )
        self._compiles = not jit_disabled()

    def force(self, number: int, displacement: Floats) -> Floats:
        """Return the force of an element on its nodes at their displacements, (nodes * dim,) both."""
        return self._forces(np.array([number]), np.reshape(displacement, (1, *self._shape))).ravel()

    def stiffness(self, numbers: Integers, size: float, called: Integers | None = None) -> Floats:
        """Return the symmetric stiffness of elements about rest, by differences of their forces back and forth.

        Parameters
        ----------
        numbers : (k,) array
            Numbers of the elements.
        size
            How far a node moves back and forth, in each direction of space, of a bar along it.
        called
            Numbers of the elements in messages, where they are others.

        Returns
        -------
        (k, nodes * m, nodes * m) array
            Components of the forces by components of the motions, in m directions.

        Raises
        ------
        PluginError
            If a force is not finite.
        """
        (nodes, dim), axes = self._shape, self._axes
        forth = size * np.kron(np.eye(nodes), axes).reshape(-1, nodes, dim)
        both, count = np.concatenate([-forth, forth]), len(forth)
        step = min(len(numbers), max(1, TOGETHER // both.size))
        motions, stiffness = np.tile(both, (step, 1, 1)), np.empty((len(numbers), count, count))
        for first in range(0, len(numbers), step):
            moved = np.repeat(numbers[first : first + step], 2 * count)
            forces = self._forces(moved, motions[: moved.size], calls=2 * count * len(numbers))
            if not np.isfinite(forces).all():
                k = np.argwhere(~np.isfinite(forces))[0, 0]
                fault, place = self.fault(moved[k], motions[k])
                number = moved[k] if called is None else called[np.flatnonzero(numbers == moved[k])[0]]
                raise PluginError(f"{fault}, in cell {number}", place)
            back, forth = np.moveaxis((forces.reshape(-1, dim) @ axes.T).reshape(-1, 2, count, count), 1, 0)
            along = (back - forth) / (2.0 * size)
            stiffness[first : first + step] = 0.5 * (along + along.swapaxes(1, 2))
        return stiffness

    def stresses(self, numbers: Integers, displacements: Floats, states: Floats | None = None) -> Floats:
        """Return the stress in elements at several times, the mean over the volume of each; of solids Cauchy's.

        It is nan in an element that does not call the stress kernel of its material.

        Parameters
        ----------
        numbers : (k,) array
            Numbers of the elements, each once.
        displacements : (T, k, nodes of an element, dim) array
            Displacements of their nodes.
        states : (T, k, points of an element, state variables) array
            State variables of their material before the step; zeros where it is None.

        Returns
        -------
        (T, k) array, of solids (T, k, 3, 3)
        """
        return self.fields(numbers, displacements, states)[0]

    def fields(self, numbers: Integers, displacements: Floats, states: Floats | None = None) -> tuple[Floats, Floats]:
        """Return `stresses`, and of solids the volume of each over that at the start, (T, k)."""
        found, volumes = [], np.full((len(displacements), len(numbers)), np.nan)
        for t, displacement in enumerate(displacements):
            state = None if states is None else states[t]
            self._forces(numbers, displacement, state, calls=len(displacements) * len(numbers))
            calls, stress, strain = (kept[numbers] for kept in self._views)
            stress = stress / np.maximum(calls, 1)[..., None]
            values = self._cauchy(stress, strain) if self._dimension else stress[..., 0]
            weights = np.where(calls > 0, self._weights[numbers], 0.0)
            with np.errstate(invalid="ignore"):  # 0 / 0 of an element that has not asked
                found.append(np.einsum("kp,kp...->k...", weights / weights.sum(axis=1, keepdims=True), values))
            if self._dimension:
                with np.errstate(invalid="ignore"):
                    volumes[t] = (weights * self._volumes(strain)).sum(axis=1) / weights.sum(axis=1)
        return np.array(found), volumes

    def slopes(self, numbers: Integers, size: float) -> Floats:
        """Return what the motion of each node by x adds to the gradient of x of a solid at rest, (k, points, nodes, d).

        Of a body of revolution the last one is that around the axis. `size` is how far a node moves.
        """
        (nodes, dim), d, found = self._shape, self._dimension, []
        for node in range(nodes):
            moved = np.zeros((len(numbers), nodes, dim))
            moved[:, node, 0] = size
            self._forces(numbers, moved, calls=nodes * len(numbers))
            gradient = self._views[2][numbers][:, : self._weights.shape[1] - self._held] / size
            found.append(np.concatenate([gradient[..., :dim], gradient[..., -1:]], axis=-1)[..., :d])
        return np.stack(found, axis=2)

    def volumes(self, number: int, displacement: Floats) -> Floats:
        """Return the volume of each point of a solid element over that at the start, (points,)."""
        self.force(number, displacement)
        return self._volumes(self._views[2][number])

    def _volumes(self, gradient: Floats) -> Floats:
        """Return det(I + H) of displacement gradients, (..., d * d)."""
        d = self._dimension
        volumes: Floats = np.linalg.det(np.eye(d) + gradient.reshape(*gradient.shape[:-1], d, d))
        return volumes

    def fault(self, number: int, displacement: Floats) -> tuple[str, str]:
        """Return what a kernel does wrong in an element at a displacement, and where that stands; empty if nothing.

        Parameters are those of `force`.
        """
        try:
            force = self.force(number, displacement)
        except Exception as error:  # noqa: BLE001  a kernel may raise anything
            return f"a kernel raises {described(error)}", line_in_plugin(error)
        for asked, stress, strain in zip(*(kept[number] for kept in self._views), strict=True):
            if asked and np.isfinite(strain).all() and not np.isfinite(stress[: strain.size]).all():
                values = _listed(stress[: strain.size])
                said = f"material {self._material.name}: the stress is {values} at the strain {_listed(strain)}"
                return said, definition_place(getattr(self._material, self._slot.__name__))
        if np.isfinite(force).all():
            return "", ""
        kernel = "force" if isinstance(self._element, CellElement) else "internal_force"
        said = f"the forces are {_listed(force)} at the displacements {_listed(displacement)}"
        return f"element {self._element.name}: {said}", definition_place(getattr(self._element, kernel))

    def _forces(
        self, numbers: Integers, displacement: Floats, state: Floats | None = None, *, calls: int = 1
    ) -> Floats:
        """Return the forces of elements, (k, nodes, dim); compiled code finds them if there are many calls in all."""
        answers, forces = self._answers, np.zeros((len(numbers), *self._shape))
        if state is not None and state.size:
            before = np.zeros((*self._weights.shape, state.shape[-1]))
            before[numbers] = state
            before = read_only(before.reshape(answers.points.before.shape))
            answers = answers._replace(points=answers.points._replace(before=before))
        arguments = self._elements, answers, numbers, np.ascontiguousarray(displacement), forces
        if calls >= MANY and self._compiles:
            self._compiles = False
            with suppress(*compile_error()):  # the march says why, where it cannot compile the kernels either
                _bound(self._filled, jit=True)(*arguments)
                self._compiles = True
                return forces
        _bound(self._filled, jit=False)(*arguments)
        return forces

    def _cauchy(self, stress: Floats, gradient: Floats) -> Floats:
        """Return Cauchy's stress, (..., 3, 3), from what a solid material returns and the displacement gradient.

        Under small strains, as of linear bodies, it is what the material returns. The stress across a body in plane
        strain is that of the material in three dimensions, nan where it has no `stress_3d`. In plane stress the body
        keeps its thickness.
        """
        dim = self._dimension
        shape = *gradient.shape[:-1], dim, dim
        inside, across = stress[..., : dim**2].reshape(shape), stress[..., dim**2 :]
        if not (self._element.linear and self._material.linear):
            stretch = np.eye(dim) + gradient.reshape(shape)
            volume = np.linalg.det(stretch)[..., None]
            inside, across = inside @ stretch.swapaxes(-2, -1) / volume[..., None], across / volume
        whole = np.zeros((*shape[:-2], 3, 3))
        whole[..., :dim, :dim] = inside
        if self._plane == "strain" and dim == 2:
            whole[..., 2, 2] = across[..., 0] if self._knows_across else np.nan
        return whole


def _listed(numbers: Any) -> str:
    return ", ".join(f"{number:.6g}" for number in np.atleast_1d(numbers))
