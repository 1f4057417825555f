"""Trial calls of the kernels of third-party elements and materials in plain Python, before the first run of a source.

Compiled code can write to arrays that are meant to be read only, and its numbers look like any others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.compiler.specialise import Specialiser
from percuss.mesh.cells import cells_of, is_solid
from percuss.mesh.material_points import plain_slots, points_at_rest
from percuss.methods import slots
from percuss.methods.blame import breach, plain_function
from percuss.methods.first_run import first_asked, is_watched
from percuss.methods.interfaces import CellElement
from percuss.methods.plugin_calls import answer, as_numbers, called_twice, read_only

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from percuss.mesh.materials import MaterialPoints
    from percuss.methods.interfaces import BodyMesh, Component, Element, Floats, Material, Mesh

FORCE, CELL_FORCE = "internal_force", "force"

# Component, name of its kernel, and the kernel as a function of displacement and velocity.
Trial = tuple["Component", str, "Callable[[Floats, Floats], Any]"]


def try_kernels(element: Element, material: Material, mesh: BodyMesh) -> None:
    """Call the kernels of a third-party element and material in plain Python, and a second time in each state.

    The first element of the body is at rest, stretched, compressed and displaced as a whole. What the kernels are
    handed to read is read-only.

    Raises
    ------
    PluginError
        If a kernel raises an error, changes what it was handed, gives a value that is not finite, or another one the
        second time.
    """
    foreign = [part for part in (element, material) if is_watched(part)]
    with first_asked(f"kernels {element!r} {material!r} {mesh.mesh.nodes.shape[1]}", *foreign) as due:
        if due:
            _try_kernels(element, material, mesh, foreign)


def _try_kernels(element: Element, material: Material, mesh: BodyMesh, foreign: Sequence[Component]) -> None:
    points = points_at_rest(element, material, mesh)
    states = [
        read_only((displacement.ravel(), velocity.ravel()))
        for displacement in _motions(mesh.mesh)
        for velocity in list(_motions(mesh.mesh))[:2]
    ]
    maker = Specialiser(plain_slots(element, material), jit=False)
    kernels = (
        _solid_kernels(element, material, points, mesh)
        if is_solid(element)
        else _material_kernels(maker, material, points)
    )
    if isinstance(element, CellElement):
        kernels.append((element, CELL_FORCE, _force_of_first_cell(maker, element, points, mesh)))
    else:
        kernels += _line_kernels(maker, element, points, mesh)
    for component, name, call in kernels:
        if component in foreign:
            _try_twice(component, name, call, states)


def _material_kernels(maker: Specialiser, material: Material, points: MaterialPoints) -> list[Trial]:
    """Return the kernels of a material as functions of displacement and velocity, whose ends make the strain."""
    stress, energy_density = (maker.bind(maker.slots[slot]) for slot in (slots.stress, slots.energy_density))

    def stress_of(u: Floats, _: Floats) -> Any:
        return stress(points, 0, float(u[-1] - u[0]))

    def density_of(u: Floats, v: Floats) -> Any:
        return energy_density(points, 0, float(u[-1] - u[0]), float(v[-1] - v[0]))

    return [(material, "stress", stress_of), (material, "energy_density", density_of)]


def _solid_kernels(element: Any, material: Any, points: MaterialPoints, mesh: BodyMesh) -> list[Trial]:
    """Return the kernels of a solid material as functions of the displacement of a cell, which makes its gradient."""
    corners, size = mesh.mesh.nodes[cells_of(mesh.mesh)[0]], element.dimension

    def gradient(u: Floats) -> Floats:
        about = np.column_stack([np.ones(len(corners)), corners])
        slopes = np.linalg.lstsq(about, u.reshape(corners.shape), rcond=None)[0][1:].T
        found = np.zeros((size, size))
        found[: len(slopes), : len(slopes)] = slopes
        return found.ravel()

    stress, stored = (getattr(material, f"{kernel}_{size}d") for kernel in ("stress", "stored"))
    kernels: list[Trial] = [
        (
            material,
            f"stress_{size}d",
            lambda u, _: plain_function(stress)(points.parameters, tuple(gradient(u).tolist())),
        )
    ]
    if not material.linear:
        energy = plain_function(stored)
        kernels.append((material, f"stored_{size}d", lambda u, _: energy(points.parameters, read_only(gradient(u)))))
    return kernels


def _motions(mesh: Mesh) -> Iterator[Floats]:
    """Yield displacements of the first element: of both its ends, or of all nodes of a cell that is along no line."""
    corners = mesh.nodes[cells_of(mesh)[0]]
    if mesh.line is not None:
        corners = np.stack([0.0 * mesh.direction, float(mesh.lengths[0]) * mesh.direction])
    stretches, size = corners - corners[0], 1e-6 * float(np.ptp(corners, axis=0).max())
    rest, moved = 0.0 * stretches, 0.0 * stretches + size
    yield from (rest, 1e-6 * stretches, -1e-6 * stretches, moved, 1e-3 * stretches)
    if mesh.line is None:
        yield 1e-6 * stretches[:, ::-1]


def _line_kernels(maker: Specialiser, element: Element, points: MaterialPoints, mesh: BodyMesh) -> list[Trial]:
    """Return the kernels of a two-node element as functions of displacement and velocity of its first element."""
    arrays, dim = read_only(answer(element, "bind", mesh)), mesh.mesh.nodes.shape[1]
    force, energy = maker.bind(element.internal_force), maker.bind(element.energy)

    def force_of(u: Floats, _: Floats) -> Floats:
        result = np.full(u.size, np.nan)
        force(arrays, points, 0, dim, u, result)
        return result

    def energy_of(u: Floats, v: Floats) -> Any:
        return energy(arrays, points, 0, dim, u, v, 1e-3)

    return [(element, FORCE, force_of), (element, "energy", energy_of)]


def _force_of_first_cell(
    maker: Specialiser, element: CellElement, points: MaterialPoints, mesh: BodyMesh
) -> Callable[[Any, Any], Any]:
    """Return the force of the first cell as a function of the displacement; along a line that of its ends."""
    along_line = mesh.mesh.line is not None
    places, rule = np.zeros(0), read_only(answer(element, "rule"))
    if along_line:
        places = np.asarray(answer(element, "reference_nodes"))
    geometry, force = read_only(answer(element, "geometry", mesh)[0]), maker.bind(element.force)

    def force_of(u: Floats, _: Floats) -> Floats:
        displacement = u.reshape(-1, mesh.mesh.nodes.shape[1])
        if along_line:
            displacement = (1.0 - places[:, None]) * displacement[0] + places[:, None] * displacement[1]
        displacement = read_only(displacement)
        result = np.full(displacement.shape, np.nan)
        force(rule, points, 0, mesh.section, geometry, displacement, result)
        return result.ravel()

    return force_of


def _try_twice(component: Any, name: str, call: Callable[[Any, Any], Any], states: list[Any]) -> None:
    """Call a kernel in all states, twice; raise PluginError if it fails or its results differ or are no numbers."""
    count = {"stress_2d": 4, "stress_3d": 9}.get(name)
    for value in called_twice(component, name, call, states):
        # the nodal forces are the array that the kernel was handed; the other kernels return what they find
        numbers = as_numbers(value)
        right = name in (FORCE, CELL_FORCE) or (numbers is not None and numbers.shape == ((count,) if count else ()))
        if numbers is None or not right:
            raise breach(
                component, name, f"{name} returned {value}, expected {f'{count} numbers' if count else 'one number'}"
            )
        if not np.isfinite(numbers).all():
            shown = tuple(numbers.tolist()) if count else value
            raise breach(component, name, f"{name} gave {shown}, expected finite numbers")
