"""Stress and stiffness of single elements, from plain Python calls of the kernels of a body.

The material kernel is replaced by one that records the stress it returns. The stress is therefore the one behind the
element's force, whatever strain the element measures and whatever the element does with the stress.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.compiler.specialise import Specialiser
from percuss.mesh.cells import PROBING_STRAIN, cells_of, volumes_of
from percuss.mesh.material_points import plain_slots, points_at_rest
from percuss.methods import slots
from percuss.methods.interfaces import BodyMesh, CellElement
from percuss.methods.plugin_calls import answer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from percuss.mesh.body import Body
    from percuss.mesh.materials import MaterialPoints
    from percuss.methods.interfaces import Element, Floats, Integers, Material

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
        volumes = volumes_of(element, mesh)
        self.points_of_element = volumes.shape[1]
        self.nodes_of_element = cells_of(mesh.mesh).shape[1]
        self._points = points_at_rest(material, volumes.size)
        self._stresses: list[tuple[float, float]] = []  # of each call: stress, and volume of its point
        maker = Specialiser(plain_slots(material), jit=False)
        stress: Callable[..., float] = maker.bind(maker.slots[slots.stress])

        def recorded_stress(points: MaterialPoints, point: int, strain: float) -> float:
            value = stress(points, point, strain)
            self._stresses.append((float(value), float(volumes.flat[point])))
            return value

        specialiser = Specialiser({slots.stress: recorded_stress}, jit=False)
        if isinstance(element, CellElement):
            self._force = _force_of_cell(element, mesh, specialiser)
        else:
            arrays, force = answer(element, "bind", mesh), specialiser.bind(element.internal_force)
            self._force = lambda points, number, u, f: force(arrays, points, number, self.dim, u, f)

    def force(self, number: int, displacement: Floats, state: Floats | None = None) -> Floats:
        """Return the force of an element on its nodes, (nodes of an element * dim,).

        Parameters
        ----------
        number
            Number of the element in the body.
        displacement : (nodes of an element * dim,) array
            Displacement of its nodes.
        state : (points of an element, state variables) array
            State variables of its material before the step; zeros where it is None.
        """
        force = np.zeros(self.nodes_of_element * self.dim)
        points = self._points
        if state is not None:
            before = np.zeros_like(points.after)
            first = number * self.points_of_element
            before[first : first + self.points_of_element] = state
            points = points._replace(before=before)
        self._force(points, number, displacement, force)
        return force

    def stress(self, number: int, displacement: Floats, state: Floats | None = None) -> float:
        """Return the stress in an element, the mean over its volume.

        It is nan if the element does not call the stress kernel of its material. Parameters are those of `force`.
        """
        self._stresses.clear()
        self.force(number, displacement, state)
        if not self._stresses:
            return np.nan
        if self.points_of_element == 1:
            return float(np.mean([stress for stress, _ in self._stresses]))
        values, volumes = np.array(self._stresses).T
        return float(values @ volumes / volumes.sum())


def _force_of_cell(element: CellElement, mesh: BodyMesh, specialiser: Specialiser) -> Callable[..., None]:
    """Return the force of single cells as a function of their points, number, displacement and, to be set, force."""
    force, rule, cells = specialiser.bind(element.force), answer(element, "rule"), cells_of(mesh.mesh)
    points_of_cell = volumes_of(element, mesh).shape[1]

    def force_of_cell(points: Any, number: int, displacement: Floats, nodal: Floats) -> None:
        shape = cells.shape[1], mesh.mesh.nodes.shape[1]
        first = number * points_of_cell
        coordinates = mesh.mesh.nodes[cells[number]]
        force(rule, points, first, mesh.section, coordinates, displacement.reshape(shape), nodal.reshape(shape))

    return force_of_cell


def stress_field(body: Body, elements: Integers, displacement: Floats, states: Floats) -> Floats:
    """Return the stress in elements of a body at several times.

    Parameters
    ----------
    body
        The body.
    elements : (E,) array
        Numbers of the elements in the body.
    displacement : (T, E, nodes of an element, dim) array
        Displacements of the nodes of each element.
    states : (T, E, points of an element, state variables) array
        State variables of the material of each element before the step.

    Returns
    -------
    (T, E) array
        Stress, tension positive [force/length^2]; nan if an element does not call the stress kernel of its material.
    """
    probe = ElementProbe(body.spec.element, body.spec.material, body.view)
    times, count, nodes, dim = displacement.shape
    nodal_states = displacement.reshape(times, count, nodes * dim)
    field = np.empty((times, count))
    linear = not body.why_not_linear
    for column, number in enumerate(elements):
        if linear and body.of_cells:  # as below, relative to the first node
            size = PROBING_STRAIN * float(body.mesh.lengths[number])
            stresses = [probe.stress(int(number), unit) / size for unit in size * np.eye(nodes * dim)[dim:]]
            relative = displacement[:, column, 1:] - displacement[:, column, :1]
            field[:, column] = relative.reshape(times, -1) @ np.array(stresses)
        elif linear:  # the stress is linear in the displacements: one call for each unit displacement is enough
            size = PROBING_STRAIN * float(body.mesh.lengths[number])
            stresses = [probe.stress(int(number), unit) / size for unit in size * np.eye(2 * dim)]
            # Both nodes have the same influence with opposite signs; using their mean difference makes the stress of a
            # translation exactly zero.
            influence = 0.5 * (np.array(stresses[dim:]) - np.array(stresses[:dim]))
            field[:, column] = (nodal_states[:, column, dim:] - nodal_states[:, column, :dim]) @ influence
        else:
            field[:, column] = [
                probe.stress(int(number), nodal_state, state)
                for nodal_state, state in zip(nodal_states[:, column], states[:, column], strict=True)
            ]
    return field


def tangent_as_declared(bodies: Iterable[Body]) -> bool:
    """Return whether all bodies that are not linear have, about rest, the axial stiffness that they declare.

    Elements are stretched and compressed a little. If they are as stiff as declared, a small motion about rest is that
    of a linear body, and a step that is unstable for the linear body is unstable.
    """
    for body in bodies:
        if not body.why_not_linear:
            continue
        probe = ElementProbe(body.spec.element, body.spec.material, body.view)
        numbers = np.unique(np.linspace(0, body.stiffness.size - 1, PROBED_ELEMENTS).round().astype(np.int64))
        for number in numbers:
            nodes = body.mesh.nodes[body.element_nodes(np.array([number]))[0] - body.start]
            along = (nodes - nodes[0]) @ body.mesh.direction
            length_change = PROBING_STRAIN * float(body.mesh.lengths[number])
            for sign in (1.0, -1.0):
                elongation = sign * length_change * body.mesh.direction
                stretched = (along / along.max())[:, None] * elongation
                force = probe.force(int(number), stretched.ravel())
                stiffness = float(force[: elongation.size] @ elongation) / length_change**2
                if not abs(stiffness - body.stiffness[number]) <= SAME_STIFFNESS * body.stiffness[number]:
                    return False
    return True
