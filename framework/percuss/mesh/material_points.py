"""The material of a body for calls of an element's kernels in plain Python, outside the time loop."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.mesh.materials import MaterialPoints, material_slots
from percuss.methods.plugin_calls import answer, read_only

if TYPE_CHECKING:
    from collections.abc import Callable

    from percuss.methods.interfaces import Material


def plain_slots(material: Material) -> dict[Any, Callable[..., Any]]:
    """Return what fills the slots of an element's kernels, with the kernels of the material in plain Python."""
    return {slot: getattr(kernel, "py_func", kernel) for slot, kernel in material_slots(material).items()}


def points_at_rest(material: Material, count: int) -> MaterialPoints:
    """Return the material of `count` elements as their kernels pass it on, with state variables of zero."""
    before = np.zeros((count, material.state))
    parameters = np.array(answer(material, "parameters"), dtype=float)
    return MaterialPoints(read_only(parameters), read_only(before), before.copy())
