"""The materials of bodies as elements call them: with parameters and, if they have any, state variables."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from percuss.methods import slots
from percuss.methods.slots import unbound

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats


class MaterialPoints(NamedTuple):
    """The material of a body at all points of its group of bodies, as a kernel of an element passes it on."""

    parameters: Floats  # (k,)
    before: Floats  # (points, state variables) as the last step has left them, read-only
    after: Floats  # (points, state variables) as the present step leaves them


def material_stress(parameters: Floats, strain: float) -> float:
    """Return the stress at `strain` (slot for the kernel of a material)."""
    unbound()


def material_stress_with_state(parameters: Floats, strain: float, before: Floats, after: Floats) -> float:
    """Return the stress at `strain` (slot for the kernel of a material with state variables)."""
    unbound()


def material_energy(parameters: Floats, before: float, after: float) -> float:
    """Return the staggered strain-energy density (slot for the kernel of a material)."""
    unbound()


def stress(material: MaterialPoints, point: int, strain: float) -> float:
    """Return the stress of a point of a material without state variables."""
    return material_stress(material.parameters, strain)


def stress_with_state(material: MaterialPoints, point: int, strain: float) -> float:
    """Return the stress of a point, and set its state variables."""
    before = material.before[point]
    after = material.after[point]
    for k in range(before.size):
        after[k] = before[k]
    return material_stress_with_state(material.parameters, strain, before, after)


def energy_density(material: MaterialPoints, point: int, before: float, after: float) -> float:
    """Return the staggered strain-energy density of a point of a material without state variables."""
    return material_energy(material.parameters, before, after)


def no_energy(material: MaterialPoints, point: int, before: float, after: float) -> float:
    """Return zero: the energy that a material with state variables stores is one of them."""
    return 0.0


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
