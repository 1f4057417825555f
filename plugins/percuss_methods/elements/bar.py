"""The two-node bar element."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss import BodyMesh, Element, energy_density, stress

if TYPE_CHECKING:
    from percuss import Floats


class BarArrays(NamedTuple):
    """Arrays of the elements of one body, with one row for each element."""

    inverse_length: Floats  # (elements,)
    area: Floats  # (elements,)
    direction: Floats  # (elements, dim)


@dataclass(frozen=True)
class BarElement(Element):
    """Two-node bar: constant strain along its axis, small displacements, no stiffness across it.

    Formula: ``strain = e . (u_{i+1} - u_i) / h``, ``force = A stress(strain) e``. With lumped mass its own angular
    frequency is 2c/h, so the critical Courant number of a uniform bar is 1.
    """

    name = "bar"
    summary = "Two-node bar, linear displacement"
    linear = True
    references = ("Hughes: The Finite Element Method, Dover 2000, ch. 1",)

    def bind(self, body: BodyMesh) -> BarArrays:
        """Return inverse length, area and direction of each element."""
        lengths = body.mesh.lengths
        return BarArrays(
            1.0 / lengths, np.full(lengths.size, body.section), np.tile(body.mesh.direction, (lengths.size, 1))
        )

    def axial_stiffness(self, body: BodyMesh, modulus: float) -> Floats:
        """Return E A / h."""
        return modulus * body.section / body.mesh.lengths

    def highest_frequency(self, body: BodyMesh, wave_speed: float) -> Floats:
        """Return 2 c / h."""
        return 2.0 * wave_speed / body.mesh.lengths

    @staticmethod
    def internal_force(
        element: BarArrays, material: Any, first: int, dim: int, displacement: Floats, force: Floats
    ) -> None:
        """Set `force` to the axial forces on the nodes."""
        m = displacement.size // dim - 1
        inverse = element.inverse_length[first : first + m]
        area = element.area[first]
        if dim == 1:
            # each axial force is evaluated at both its nodes, because a loop without recurrence can be vectorised
            sign = element.direction[first, 0]
            area *= sign
            force[0] = area * stress(material, first, sign * (displacement[1] - displacement[0]) * inverse[0])
            for i in range(1, m):
                force[i] = area * (
                    stress(material, first + i, sign * (displacement[i + 1] - displacement[i]) * inverse[i])
                    - stress(material, first + i - 1, sign * (displacement[i] - displacement[i - 1]) * inverse[i - 1])
                )
            stretch = sign * (displacement[m] - displacement[m - 1])
            force[m] = -area * stress(material, first + m - 1, stretch * inverse[m - 1])
            return
        direction = element.direction[first]
        previous = 0.0
        for i in range(m):
            stretch = 0.0
            for d in range(dim):
                stretch += direction[d] * (displacement[(i + 1) * dim + d] - displacement[i * dim + d])
            axial = area * stress(material, first + i, stretch * inverse[i])
            for d in range(dim):
                force[i * dim + d] = direction[d] * (axial - previous)
            previous = axial
        for d in range(dim):
            force[m * dim + d] = -direction[d] * previous

    @staticmethod
    def energy(
        element: BarArrays,
        material: Any,
        first: int,
        dim: int,
        displacement: Floats,
        velocity: Floats,
        dt: float,
    ) -> float:
        """Return the sum of volume times energy density over the elements."""
        m = displacement.size // dim - 1
        total = 0.0
        direction = element.direction[first]
        if dim == 1:
            inverses = element.inverse_length[first : first + m]
            sign = direction[0]
            for i in range(m):
                after = sign * (displacement[i + 1] - displacement[i])
                before = after - dt * sign * (velocity[i + 1] - velocity[i])
                density = energy_density(material, first + i, before * inverses[i], after * inverses[i])
                total += density / inverses[i]
            return element.area[first] * total
        for i in range(m):
            after = 0.0
            rate = 0.0
            for d in range(dim):
                after += direction[d] * (displacement[(i + 1) * dim + d] - displacement[i * dim + d])
                rate += direction[d] * (velocity[(i + 1) * dim + d] - velocity[i * dim + d])
            inverse = element.inverse_length[first + i]
            density = energy_density(material, first + i, (after - dt * rate) * inverse, after * inverse)
            total += element.area[first + i] / inverse * density
        return total
