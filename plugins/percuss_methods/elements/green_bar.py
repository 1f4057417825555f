"""The two-node bar element with Green's strain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss import BodyMesh, Element, energy_density, stress

if TYPE_CHECKING:
    from percuss import Floats


class GreenBarArrays(NamedTuple):
    """Arrays of the elements of one body, with one row for each element."""

    length: Floats  # (elements,)
    area: Floats  # (elements,)
    direction: Floats  # (elements, dim)


@dataclass(frozen=True)
class GreenBarElement(Element):
    """Two-node bar in total Lagrangian form: large displacements and rotations, no stiffness across its present axis.

    Formula: ``strain = (l^2 - L^2) / (2 L^2) = e . d + d . d / 2`` with the displacement gradient
    ``d = (u_{i+1} - u_i) / L``; ``force = A stress(strain) (e + d)``, where e is the direction, A the area and L the
    length before the motion.

    The material gives the second Piola-Kirchhoff stress for Green's strain, which a rigid rotation leaves at zero. With
    an elastic material, a bar that is stretched by ``lambda = l / L`` pulls with ``A E lambda (lambda^2 - 1) / 2``: it
    is stiffer than at rest in tension, its waves run at ``c sqrt((3 lambda^2 - 1) / 2)``, and so much lower is its
    critical step. Compressed below ``lambda = 1 / sqrt(3)`` it gives way. Contacts and loads keep the directions in
    which they began.
    """

    name = "green-bar"
    summary = "Two-node bar, Green's strain: large displacements"
    references = ("Bonet, Wood: Nonlinear Continuum Mechanics for Finite Element Analysis, Cambridge 2008, ch. 3",)

    def bind(self, body: BodyMesh) -> GreenBarArrays:
        """Return length, area and direction of each element."""
        lengths = body.mesh.lengths
        return GreenBarArrays(
            lengths, np.full(lengths.size, body.section), np.tile(body.mesh.direction, (lengths.size, 1))
        )

    def axial_stiffness(self, body: BodyMesh, modulus: float) -> Floats:
        """Return E A / L, the stiffness at rest."""
        return modulus * body.section / body.mesh.lengths

    def highest_frequency(self, body: BodyMesh, wave_speed: float) -> Floats:
        """Return 2 c / L, the frequency at rest."""
        return 2.0 * wave_speed / body.mesh.lengths

    @staticmethod
    def internal_force(
        element: GreenBarArrays, material: Any, first: int, dim: int, displacement: Floats, force: Floats
    ) -> None:
        """Set `force` to the forces along the present axes of the elements on the nodes."""
        force[:] = 0.0
        for i in range(displacement.size // dim - 1):
            length = element.length[first + i]
            strain = 0.0
            for k in range(dim):
                gradient = (displacement[(i + 1) * dim + k] - displacement[i * dim + k]) / length
                strain += (element.direction[first + i, k] + 0.5 * gradient) * gradient
            axial = element.area[first + i] * stress(material, first + i, strain)
            for k in range(dim):
                gradient = (displacement[(i + 1) * dim + k] - displacement[i * dim + k]) / length
                component = axial * (element.direction[first + i, k] + gradient)
                force[i * dim + k] += component
                force[(i + 1) * dim + k] -= component

    @staticmethod
    def energy(
        element: GreenBarArrays,
        material: Any,
        first: int,
        dim: int,
        displacement: Floats,
        velocity: Floats,
        dt: float,
    ) -> float:
        """Return the sum of volume before the motion times energy density over the elements."""
        total = 0.0
        for i in range(displacement.size // dim - 1):
            length = element.length[first + i]
            after, before = 0.0, 0.0
            for k in range(dim):
                direction = element.direction[first + i, k]
                gradient = (displacement[(i + 1) * dim + k] - displacement[i * dim + k]) / length
                earlier = gradient - dt * (velocity[(i + 1) * dim + k] - velocity[i * dim + k]) / length
                after += (direction + 0.5 * gradient) * gradient
                before += (direction + 0.5 * earlier) * earlier
            density = energy_density(material, first + i, before, after)
            total += element.area[first + i] * length * density
        return total
