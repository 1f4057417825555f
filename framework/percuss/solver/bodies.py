"""What the elements of a body themselves say, asked one at a time: the stress in them, and their stiffness about rest.

The kernels of a body are called as plain Python, with the slot of the material replaced by one that notes what it
returns. So the stress is that of the force, whatever strain the element measures and whatever its material makes of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from percuss.methods import slots
from percuss.methods.interfaces import BodyMesh
from percuss.solver.compiler.specialise import Specialiser

if TYPE_CHECKING:
    from collections.abc import Callable

    from percuss.methods.interfaces import Element, Floats, Integers, Material
    from percuss.solver.entities import Body
    from percuss.solver.model import Model

PROBING_STRAIN = 1e-7  # small against every strain at which a material or an element is no longer as it is at rest
SAME_STIFFNESS = 1e-4  # relative difference up to which a stiffness about rest is the one declared
PROBED_ELEMENTS = 8


class ElementProbe:
    """The elements of one body, each asked by itself for its force and its stress.

    Parameters
    ----------
    element, material
        The methods that fill the body.
    mesh
        The body, as `Element.bind` is handed it.
    """

    def __init__(self, element: Element, material: Material, mesh: BodyMesh) -> None:
        self.dim = mesh.mesh.nodes.shape[1]
        self._arrays = element.bind(mesh)
        self._parameters = np.array(material.parameters(), dtype=float)
        self._stresses: list[float] = []
        law: Callable[[Floats, float], float] = getattr(material.stress, "py_func", material.stress)

        def noted(parameters: Floats, strain: float) -> float:
            value = law(parameters, strain)
            self._stresses.append(float(value))
            return value

        self._force = Specialiser({slots.stress: noted}, jit=False).bind(element.internal_force)

    def force(self, number: int, displacement: Floats) -> Floats:
        """Return the force of an element on its two nodes, (2 dim,), at their `displacement`, (2 dim,)."""
        force = np.zeros(2 * self.dim)
        self._force(self._arrays, self._parameters, number, self.dim, displacement, force)
        return force

    def stress(self, number: int, displacement: Floats) -> float:
        """Return the stress in an element; nan where the element does not ask its material for any."""
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
        Stress, tension positive [force/length^2]; nan where an element does not ask its material for any.
    """
    probe = ElementProbe(body.spec.element, body.spec.material, BodyMesh(body.mesh, body.spec.area))
    times, count, _, dim = displacement.shape
    flat = displacement.reshape(times, count, 2 * dim)
    out = np.empty((times, count))
    linear = not body.why_not_linear
    for k, number in enumerate(elements):
        if linear:  # the stress is a sum over the displacements, so that one call for each is enough
            size = PROBING_STRAIN * float(body.mesh.lengths[number])
            shares = [probe.stress(int(number), unit) / size for unit in size * np.eye(2 * dim)]
            # the influence of the first node is that of the second, taken the other way: so a translation gives none
            ahead = 0.5 * (np.array(shares[dim:]) - np.array(shares[:dim]))
            out[:, k] = (flat[:, k, dim:] - flat[:, k, :dim]) @ ahead
        else:
            out[:, k] = [probe.stress(int(number), state) for state in flat[:, k]]
    return out


def tangent_as_declared(model: Model) -> bool:
    """Return whether the bodies of a model, stretched or compressed a little from rest, are as stiff as they declare.

    Then a small motion about rest is that of a linear body, and a step that is unstable for it is unstable.
    """
    for body in model.bodies.values():
        if not body.why_not_linear:
            continue
        probe = ElementProbe(body.spec.element, body.spec.material, BodyMesh(body.mesh, body.spec.area))
        numbers = np.unique(np.linspace(0, body.stiffness.size - 1, PROBED_ELEMENTS).round().astype(np.int64))
        for number in numbers:
            stretch = PROBING_STRAIN * float(body.mesh.lengths[number])
            for sign in (1.0, -1.0):
                ahead = sign * stretch * body.mesh.direction
                force = probe.force(int(number), np.concatenate([np.zeros(model.dim), ahead]))
                stiffness = float(force[: model.dim] @ ahead) / stretch**2
                if not abs(stiffness - body.stiffness[number]) <= SAME_STIFFNESS * body.stiffness[number]:
                    return False
    return True
