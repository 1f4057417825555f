"""The materials of bodies as elements call them: with parameters and, if they have any, state variables."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.methods import slots
from percuss.methods.slots import unbound

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats


class MaterialPoints(NamedTuple):
    """The material of a body at all points of its group of bodies, as a kernel of an element passes it on."""

    parameters: Floats  # (k,)
    before: Floats  # (points, state variables) as the last step has left them, read-only
    after: Floats  # (points, state variables) as the present step leaves them


def material_stress(parameters: Floats, strain: Any) -> Any:
    """Return the stress at a strain or a displacement gradient (slot for the kernel of a material)."""
    unbound()


def material_stress_with_state(parameters: Floats, strain: Any, before: Floats, after: Floats) -> Any:
    """Return the stress at a strain or a gradient (slot for the kernel of a material with state variables)."""
    unbound()


def material_energy(parameters: Floats, before: float, after: float) -> float:
    """Return the staggered strain-energy density (slot for the kernel of a material)."""
    unbound()


def stress(material: MaterialPoints, point: int, strain: Any) -> Any:
    """Return the stress of a point, at its strain or displacement gradient, of a material without state variables."""
    return material_stress(material.parameters, strain)


def stress_of_point(material: MaterialPoints, point: int, gradient: Any) -> Any:
    """Return the stress of a point of a solid (slot for `stress` or `stress_with_state`)."""
    unbound()


def stress_of_area(material: MaterialPoints, point: int, gradient: Any) -> Any:
    """Return the stress of a point in two dimensions of a material of finite strain, nan where it is inside out."""
    if (1.0 + gradient[0]) * (1.0 + gradient[3]) - gradient[1] * gradient[2] <= 0.0:
        return np.nan, np.nan, np.nan, np.nan
    return stress_of_point(material, point, gradient)


def stress_of_volume(material: MaterialPoints, point: int, gradient: Any) -> Any:
    """Return the stress of a point in three dimensions of a material of finite strain, nan where it is inside out."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = gradient
    across = (1.0 + yy) * (1.0 + zz) - yz * zy, yz * zx - yx * (1.0 + zz), yx * zy - (1.0 + yy) * zx
    if (1.0 + xx) * across[0] + xy * across[1] + xz * across[2] <= 0.0:
        return np.nan, np.nan, np.nan, np.nan, np.nan, np.nan, np.nan, np.nan, np.nan
    return stress_of_point(material, point, gradient)


def stress_with_state(material: MaterialPoints, point: int, strain: Any) -> Any:
    """Return the stress of a point, and set its state variables."""
    before = material.before[point]
    after = material.after[point]
    for k in range(before.size):
        after[k] = before[k]
    return material_stress_with_state(material.parameters, strain, before, after)


def stress_in_space(parameters: Floats, gradient: Any, before: Floats, after: Floats) -> Any:
    """Return the stress in space (slot for the kernel of a material with state variables in plane strain)."""
    unbound()


def stress_in_plane(parameters: Floats, gradient: Any, before: Floats, after: Floats) -> Any:
    """Return the stress in plane strain by a kernel in space, and set the state variables."""
    whole = (gradient[0], gradient[1], 0.0, gradient[2], gradient[3], 0.0, 0.0, 0.0, 0.0)
    of_space = stress_in_space(parameters, whole, before, after)
    return of_space[0], of_space[1], of_space[3], of_space[4]


def energy_density(material: MaterialPoints, point: int, before: float, after: float) -> float:
    """Return the staggered strain-energy density of a point of a material without state variables."""
    return material_energy(material.parameters, before, after)


def no_energy(material: MaterialPoints, point: int, before: Any, after: Any) -> float:
    """Return zero: the energy that a material with state variables stores is one of them."""
    return 0.0


def rise(material: MaterialPoints, point: int, gradient: Any) -> float:
    """Return half of what a state variable of a point rises by from `before` to a gradient.

    The first row of `after` is room for the variables, and the second one begins with the number of the variable.
    """
    before, after = material.before[point], material.after[0]
    for k in range(before.size):
        after[k] = before[k]
    material_stress_with_state(material.parameters, gradient, before, after)
    number = int(material.after[1, 0])
    half: float = 0.5 * (after[number] - before[number])
    return half


def rise_2d(material: MaterialPoints, point: int, before: Floats, after: Floats) -> float:
    """Return half of what a state variable of a point in two dimensions rises by in the coming step."""
    return rise(material, point, (after[0], after[1], after[2], after[3]))


def rise_3d(material: MaterialPoints, point: int, before: Floats, after: Floats) -> float:
    """Return half of what a state variable of a point in three dimensions rises by in the coming step."""
    gradient = (after[0], after[1], after[2], after[3], after[4], after[5], after[6], after[7], after[8])
    return rise(material, point, gradient)


def stored_by_gradient(parameters: Floats, gradient: Floats) -> float:
    """Return the stored energy per volume (slot for the kernel of a solid material)."""
    unbound()


def linear_energy_2d(material: MaterialPoints, point: int, before: Floats, after: Floats) -> float:
    """Return half the product of stress before and gradient after of a linear material in two dimensions."""
    stress = material_stress(material.parameters, (before[0], before[1], before[2], before[3]))
    total = 0.0
    for k in range(4):
        total += stress[k] * after[k]
    return 0.5 * total


def linear_energy_3d(material: MaterialPoints, point: int, before: Floats, after: Floats) -> float:
    """Return half the product of stress before and gradient after of a linear material in three dimensions."""
    gradient = (
        before[0], before[1], before[2], before[3], before[4], before[5], before[6], before[7], before[8],
    )  # fmt: skip
    stress = material_stress(material.parameters, gradient)
    total = 0.0
    for k in range(9):
        total += stress[k] * after[k]
    return 0.5 * total


def mean_stored_energy(material: MaterialPoints, point: int, before: Floats, after: Floats) -> float:
    """Return the mean of the energies that a material stores before and after a step."""
    stored = stored_by_gradient(material.parameters, before) + stored_by_gradient(material.parameters, after)
    return 0.5 * stored


def solid_slots(material: Any, dimension: int) -> dict[Any, Callable[..., Any]]:
    """Return the slots of a solid element's kernels that a material, or its class, fills, and what fills them."""
    flat = dimension == 2
    kernel, slot = (material.stress_2d, slots.stress_2d) if flat else (material.stress_3d, slots.stress_3d)
    if material.linear:
        energy = linear_energy_2d if flat else linear_energy_3d
        return {slot: stress, material_stress: kernel, slots.energy_density: energy}
    of_finite_strain = stress_of_area if flat else stress_of_volume
    if material.state > 0:
        by_space = flat and kernel is None
        return {
            slot: of_finite_strain,
            stress_of_point: stress_with_state,
            material_stress_with_state: stress_in_plane if by_space else kernel,
            stress_in_space: material.stress_3d,
            slots.energy_density: rise_2d if flat else rise_3d,
        }
    stored = material.stored_2d if flat else material.stored_3d
    filled = {slot: of_finite_strain, stress_of_point: stress, material_stress: kernel}
    return filled | {slots.energy_density: mean_stored_energy, stored_by_gradient: stored}


def material_slots(material: Any) -> dict[Any, Callable[..., Any]]:
    """Return the slots of an element's kernels that a material, or its class, fills, and what fills them."""
    if material.state == 0:
        return {
            slots.stress: stress,
            slots.energy_density: energy_density,
            material_stress: material.stress,
            material_energy: material.energy_density,
        }
    return {
        slots.stress: stress_with_state,
        slots.energy_density: no_energy,
        material_stress_with_state: material.stress,
    }
