"""The stress field of a body, and whether a body is about rest as stiff as it says."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.mesh.bar import Bar
from percuss.mesh.cell_stiffness import cell_stiffness
from percuss.mesh.cells import PROBING_STRAIN, is_solid
from percuss.mesh.element_probe import ElementProbe

if TYPE_CHECKING:
    from collections.abc import Iterable

    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats, Integers

SAME_STIFFNESS = 1e-4  # largest relative difference between declared stiffness and stiffness about rest
PROBED_ELEMENTS = 8


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
    (T, E) array, of solid elements (T, E, 3, 3)
        Stress, tension positive [force/length^2]; nan if an element does not call the stress kernel of its material.
    """
    probe = ElementProbe(body.spec.element, body.spec.material, body.view)
    times, count, nodes, dim = displacement.shape
    nodal_states = displacement.reshape(times, count, nodes * dim)
    field = np.empty((times, count, *((3, 3) if is_solid(body.spec.element) else ())))
    linear = not body.why_not_linear
    if linear and is_solid(body.spec.element):
        return _linear_field(body, probe, elements, displacement)
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


def _linear_field(body: Body, probe: ElementProbe, elements: Integers, displacement: Floats) -> Floats:
    """Return the stress field of a linear body that is no bar; one cell of each kind is asked."""
    times, count, nodes, dim = displacement.shape
    field, size = np.empty((times, count, 3, 3)), PROBING_STRAIN * body.shortest
    # A translation has no stress at all: motion counts from the first node, unless a body of revolution is widened.
    element: Any = body.spec.element
    first = dim if element.dimension == dim else 0
    kind = cell_stiffness(body.spec.element, body.spec.material, body.view).kind[elements]
    alike = np.split(np.argsort(kind, kind="stable"), np.cumsum(np.bincount(kind))[:-1])
    for columns in filter(len, alike):
        number = int(elements[columns[0]])
        stresses = [probe.stress(number, unit) / size for unit in size * np.eye(nodes * dim)[first:]]
        moved = displacement[:, columns] - (displacement[:, columns, :1] if first else 0.0)
        of_nodes = moved.reshape(times, len(columns), -1)[..., first:]
        field[:, columns] = np.tensordot(of_nodes, np.array(stresses), 1)
    return field


def tangent_as_declared(bodies: Iterable[Body]) -> bool:
    """Return whether all bodies that are not linear have, about rest, the axial stiffness that they declare.

    Elements are stretched and compressed a little. If they are as stiff as declared, a small motion about rest is that
    of a linear body, and a step that is unstable for the linear body is unstable.
    """
    for body in bodies:
        if not body.why_not_linear or not isinstance(body, Bar):  # others have no declared stiffness
            continue
        probe = ElementProbe(body.spec.element, body.spec.material, body.view)
        numbers = np.unique(np.linspace(0, body.count - 1, PROBED_ELEMENTS).round().astype(np.int64))
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
