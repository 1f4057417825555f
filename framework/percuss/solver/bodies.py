"""Stress and stiffness of single elements, from plain Python calls of the kernels of a body.

The material kernel is replaced by one that records the stress it returns. The stress is therefore the one behind the
element's force, whatever strain the element measures and whatever the element does with the stress.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from percuss.methods import slots
from percuss.methods.interfaces import BodyMesh
from percuss.methods.plugin_calls import answer
from percuss.solver.compiler.specialise import Specialiser

if TYPE_CHECKING:
    from collections.abc import Callable

    from percuss.methods.interfaces import Element, Floats, Integers, Material
    from percuss.solver.entities import Body
    from percuss.solver.model import Model

PROBING_STRAIN = 1e-7  # far below any strain at which the stiffness of a material or an element changes
SAME_STIFFNESS = 1e-4  # largest relative difference between declared stiffness and stiffness about rest
PROBED_ELEMENTS = 8


class ElementProbe:
    """Force and stress of single elements of one body.

    Parameters
    ----------
    element, material
        The methods of the body.
    mesh
        The body as `Element.bind` receives it.
    """

    def __init__(self, element: Element, material: Material, mesh: BodyMesh) -> None:
        self.dim = mesh.mesh.nodes.shape[1]
        self._arrays = answer(element, "bind", mesh)
        self._parameters = np.array(answer(material, "parameters"), dtype=float)
        self._stresses: list[float] = []
        stress: Callable[[Floats, float], float] = getattr(material.stress, "py_func", material.stress)

        def recorded_stress(parameters: Floats, strain: float) -> float:
            value = stress(parameters, strain)
            self._stresses.append(float(value))
            return value

        self._force = Specialiser({slots.stress: recorded_stress}, jit=False).bind(element.internal_force)

    def force(self, number: int, displacement: Floats) -> Floats:
        """Return the force of an element on its two nodes, (2 dim,), at their `displacement`, (2 dim,)."""
        force = np.zeros(2 * self.dim)
        self._force(self._arrays, self._parameters, number, self.dim, displacement, force)
        return force

    def stress(self, number: int, displacement: Floats) -> float:
        """Return the stress in an element; nan if the element does not call the stress kernel of its material."""
        self._stresses.clear()
        self.force(number, displacement)
        return float(np.mean(self._stresses)) if self._stresses else np.nan


def stress_field(body: Body, elements: Integers, displacement: Floats) -> Floats:
    """Return the stress in elements of a body at several times.

    Parameters
    ----------
    body
        The body.
    elements : (E,) array
        Numbers of the elements in the body.
    displacement : (T, E, 2, dim) array
        Displacements of the two nodes of each element.

    Returns
    -------
    (T, E) array
        Stress, tension positive [force/length^2]; nan if an element does not call the stress kernel of its material.
    """
    probe = ElementProbe(body.spec.element, body.spec.material, BodyMesh(body.mesh, body.spec.area))
    times, count, _, dim = displacement.shape
    nodal_states = displacement.reshape(times, count, 2 * dim)
    field = np.empty((times, count))
    linear = not body.why_not_linear
    for column, number in enumerate(elements):
        if linear:  # the stress is linear in the displacements: one call for each unit displacement is enough
            size = PROBING_STRAIN * float(body.mesh.lengths[number])
            stresses = [probe.stress(int(number), unit) / size for unit in size * np.eye(2 * dim)]
            # Both nodes have the same influence with opposite signs; using their mean difference makes the stress of a
            # translation exactly zero.
            influence = 0.5 * (np.array(stresses[dim:]) - np.array(stresses[:dim]))
            field[:, column] = (nodal_states[:, column, dim:] - nodal_states[:, column, :dim]) @ influence
        else:
            field[:, column] = [probe.stress(int(number), state) for state in nodal_states[:, column]]
    return field


def tangent_as_declared(model: Model) -> bool:
    """Return whether all bodies that are not linear have, about rest, the axial stiffness that they declare.

    Elements are stretched and compressed a little. If they are as stiff as declared, a small motion about rest is that
    of a linear body, and a step that is unstable for the linear body is unstable.
    """
    for body in model.bodies.values():
        if not body.why_not_linear:
            continue
        probe = ElementProbe(body.spec.element, body.spec.material, BodyMesh(body.mesh, body.spec.area))
        numbers = np.unique(np.linspace(0, body.stiffness.size - 1, PROBED_ELEMENTS).round().astype(np.int64))
        for number in numbers:
            length_change = PROBING_STRAIN * float(body.mesh.lengths[number])
            for sign in (1.0, -1.0):
                elongation = sign * length_change * body.mesh.direction
                force = probe.force(int(number), np.concatenate([np.zeros(model.dim), elongation]))
                stiffness = float(force[: model.dim] @ elongation) / length_change**2
                if not abs(stiffness - body.stiffness[number]) <= SAME_STIFFNESS * body.stiffness[number]:
                    return False
    return True
