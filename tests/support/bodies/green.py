"""A bar with Green-Lagrange strain (St. Venant-Kirchhoff), in one to three dimensions."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from percuss import Element, energy_density, stress


class Arrays(NamedTuple):
    length: np.ndarray
    area: np.ndarray
    direction: np.ndarray


@dataclass(frozen=True)
class GreenBar(Element):
    """Two-node bar, total Lagrangian.

    Formula: ``E = e . d / h + d . d / (2 h^2)``, ``d = u_{i+1} - u_i``; force ``A stress(E) (e + d / h)``.
    """

    name = "green-bar"
    summary = "Bar with Green-Lagrange strain"
    references = ("Bonet, Wood: Nonlinear Continuum Mechanics for FEA, Cambridge 2008",)

    def bind(self, body):
        h = body.mesh.lengths
        return Arrays(h, np.full(h.size, body.area), np.tile(body.mesh.direction, (h.size, 1)))

    def axial_stiffness(self, body, modulus):
        return modulus * body.area / body.mesh.lengths

    def highest_frequency(self, body, wave_speed):
        return 2.0 * wave_speed / body.mesh.lengths

    @staticmethod
    def internal_force(element, parameters, first, dim, displacement, force):
        force[:] = 0.0
        for i in range(displacement.size // dim - 1):
            e, h = element.direction[first + i], element.length[first + i]
            strain = 0.0
            for k in range(dim):
                d = (displacement[(i + 1) * dim + k] - displacement[i * dim + k]) / h
                strain += e[k] * d + 0.5 * d * d
            axial = element.area[first + i] * stress(parameters, strain)
            for k in range(dim):
                d = (displacement[(i + 1) * dim + k] - displacement[i * dim + k]) / h
                force[i * dim + k] += axial * (e[k] + d)
                force[(i + 1) * dim + k] -= axial * (e[k] + d)

    @staticmethod
    def energy(element, parameters, first, dim, displacement, velocity, dt):
        total = 0.0
        for i in range(displacement.size // dim - 1):
            e, h = element.direction[first + i], element.length[first + i]
            after, before = 0.0, 0.0
            for k in range(dim):
                d = (displacement[(i + 1) * dim + k] - displacement[i * dim + k]) / h
                b = d - dt * (velocity[(i + 1) * dim + k] - velocity[i * dim + k]) / h
                after += e[k] * d + 0.5 * d * d
                before += e[k] * b + 0.5 * b * b
            density = 0.5 * (energy_density(parameters, before, before) + energy_density(parameters, after, after))
            total += element.area[first + i] * h * density
        return total
