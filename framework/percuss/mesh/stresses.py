"""The stress field of a body, and whether bars are about rest as stiff as they say."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from percuss.mesh.cells import PROBING_STRAIN, cells_of
from percuss.mesh.element_probe import ElementProbe

if TYPE_CHECKING:
    from collections.abc import Iterable

    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats, Integers

SAME_STIFFNESS = 1e-4  # largest relative difference between declared stiffness and stiffness about rest


def stress_field(
    body: Body, elements: Integers, displacement: Floats, states: Floats, dt: float = math.inf
) -> tuple[Floats, Floats]:
    """Return the stress in elements of a body at several times, and their volume over that at the start.

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
    dt
        The time step.

    Returns
    -------
    stress : (T, E) array, of solid elements (T, E, 3, 3)
        Stress, tension positive [force/length^2]; nan if an element does not call the stress kernel of its material.
    volume : (T, E) array
        Nan of bars, and of linear bodies.
    """
    probe = ElementProbe(body.spec.element, body.spec.material, body.view, dt=dt)
    if body.why_not_linear:
        return probe.fields(elements, displacement, states)
    # Of a linear body one element of each kind is asked, once for each motion of a node. A translation has no stress at
    # all: motion counts from the first node, unless a body of revolution is widened.
    times, count, nodes, dim = displacement.shape
    first, kind = body.view.kinds
    kinds, kind = np.unique(kind[elements], return_inverse=True)
    held = 0 if body.view.plane == "axisymmetric" else dim
    size = PROBING_STRAIN * body.shortest
    units = size * np.eye(nodes * dim)[held:].reshape(-1, 1, nodes, dim)
    stress = probe.stresses(first[kinds], np.broadcast_to(units, (len(units), kinds.size, nodes, dim))) / size
    moved = displacement - displacement[:, :, :1] if held else displacement
    of_elements = moved.reshape(times, count, -1)[..., held:].swapaxes(0, 1)
    by_unit = stress.reshape(len(units), kinds.size, -1).swapaxes(0, 1)
    field: Floats = (of_elements @ by_unit[kind]).swapaxes(0, 1).reshape(times, count, *stress.shape[2:])
    return field, np.full((times, count), np.nan)


def tangent_as_declared(bodies: Iterable[Body]) -> bool:
    """Return whether all bars that are not linear have, about rest, the axial stiffness that they declare.

    Elements are stretched and compressed a little. If they are as stiff as declared, a small motion about rest is that
    of a linear body, and a step that is unstable for the linear body is unstable. Other bodies declare no stiffness.
    """
    for body in bodies:
        if not body.why_not_linear or not body.is_bar:
            continue
        numbers, _ = body.view.kinds
        places = body.mesh.nodes[cells_of(body.mesh)[numbers]] @ body.mesh.direction
        stretched = (places - places[:, :1]) / np.ptp(places, axis=1, keepdims=True)
        probe = ElementProbe(body.spec.element, body.spec.material, body.view)
        matrices = probe.stiffness(numbers, PROBING_STRAIN * body.shortest)
        stiffness = np.einsum("ka,kab,kb->k", stretched, matrices, stretched)
        if not np.allclose(stiffness, body.stiffness[numbers], rtol=SAME_STIFFNESS, atol=0.0):
            return False
    return True
