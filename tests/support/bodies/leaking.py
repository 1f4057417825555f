"""A linear bar whose force on the second node is a hundredth too small: it takes momentum from nowhere."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from percuss import BodyMesh, Element, Floats, energy_density, hookimpl, stress


class LeakingArrays(NamedTuple):
    """What the kernels read, one row an element."""

    length: Floats
    area: Floats
    direction: Floats  # (elements, dim)


@dataclass(frozen=True)
class Leaking(Element):
    """A two-node bar: constant strain along its axis, small displacements.

    Formula: ``strain = e . (u_{i+1} - u_i) / h``, ``force = A stress(strain) e``. With half of its mass at each node
    its own angular frequency is 2c/h.
    """

    name = "leaking"
    summary = "Two-node bar"
    linear = True
    references = ("Hughes: The Finite Element Method, Dover 2000, ch. 1",)
    contract_version = 1

    def bind(self, body: BodyMesh) -> LeakingArrays:
        """Return length, area and direction of each element."""
        h = body.mesh.lengths
        return LeakingArrays(h, np.full(h.size, body.section), np.tile(body.mesh.direction, (h.size, 1)))

    def axial_stiffness(self, body: BodyMesh, modulus: float) -> Floats:
        """Return E A / h."""
        return modulus * body.section / body.mesh.lengths

    def highest_frequency(self, body: BodyMesh, wave_speed: float) -> Floats:
        """Return 2 c / h."""
        return 2.0 * wave_speed / body.mesh.lengths

    @staticmethod
    def internal_force(
        element: LeakingArrays, material: Any, first: int, dim: int, displacement: Floats, force: Floats
    ) -> None:
        """Set `force` to the axial forces on the nodes; a kernel."""
        force[:] = 0.0
        for i in range(displacement.size // dim - 1):
            e = element.direction[first + i]
            stretch = 0.0
            for d in range(dim):
                stretch += e[d] * (displacement[(i + 1) * dim + d] - displacement[i * dim + d])
            axial = element.area[first + i] * stress(material, first + i, stretch / element.length[first + i])
            for d in range(dim):
                force[i * dim + d] += axial * e[d]
                force[(i + 1) * dim + d] -= 0.99 * axial * e[d]

    @staticmethod
    def energy(
        element: LeakingArrays,
        material: Any,
        first: int,
        dim: int,
        displacement: Floats,
        velocity: Floats,
        dt: float,
    ) -> float:
        """Return the sum of volume times energy density between t_n and t_n+1; a kernel."""
        total = 0.0
        for i in range(displacement.size // dim - 1):
            e, h = element.direction[first + i], element.length[first + i]
            after, rate = 0.0, 0.0
            for d in range(dim):
                after += e[d] * (displacement[(i + 1) * dim + d] - displacement[i * dim + d])
                rate += e[d] * (velocity[(i + 1) * dim + d] - velocity[i * dim + d])
            total += (
                element.area[first + i] * h * energy_density(material, first + i, (after - dt * rate) / h, after / h)
            )
        return total


@hookimpl
def percuss_elements() -> list[type]:
    """Return what this file registers."""
    return [Leaking]
