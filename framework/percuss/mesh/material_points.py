"""The material of a body for calls of an element's kernels in plain Python, outside the time loop."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.mesh.cells import parameters_of, slots_of_material, volumes_of
from percuss.mesh.materials import MaterialPoints
from percuss.methods.blame import plain_function
from percuss.methods.plugin_calls import read_only

if TYPE_CHECKING:
    from collections.abc import Callable

    from percuss.methods.interfaces import BodyMesh, Element, Material


def plain_slots(element: Element, material: Material) -> dict[Any, Callable[..., Any]]:
    """Return what fills the slots of an element's kernels, with the kernels of the material in plain Python."""
    return {slot: plain_function(kernel) for slot, kernel in slots_of_material(element, material).items()}


def points_at_rest(element: Element, material: Material, body: BodyMesh) -> MaterialPoints:
    """Return the material of a body as the kernels of its elements pass it on, with state variables of zero."""
    before = np.zeros((volumes_of(element, body).size, material.state))
    parameters = parameters_of(element, material, body)
    return MaterialPoints(read_only(parameters), read_only(before), before.copy())
