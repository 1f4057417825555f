"""Trial calls of the kernels of third-party elements and materials in plain Python, made before the run.

Compiled code can write to arrays that are meant to be read only, and its numbers look like any others.
"""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.errors import PercussError, PluginError
from percuss.methods import slots
from percuss.methods.blame import breach, is_third_party, line_in_plugin
from percuss.methods.plugin_calls import DIFFERENT, answer, read_only, same
from percuss.solver.compiler.specialise import Specialiser

if TYPE_CHECKING:
    from collections.abc import Callable

    from percuss.methods.interfaces import BodyMesh, Element, Floats, Material

FORCE = "internal_force"
# The kernels that have been tried, by the class of the first third-party component among element and material.
_TRIED: weakref.WeakKeyDictionary[type, set[Any]] = weakref.WeakKeyDictionary()


def try_kernels(element: Element, material: Material, mesh: BodyMesh) -> None:
    """Call the kernels of a third-party element and material in plain Python, and a second time in each state.

    The first element of the body is at rest, stretched, compressed and displaced as a whole. What the kernels are
    handed to read is read-only.

    Raises
    ------
    PluginError
        If a kernel raises an error, changes what it was handed, gives a value that is not finite, or another one the
        second time.
    """
    foreign = [part for part in (element, material) if is_third_party(type(part).__module__)]
    key = repr(element), repr(material), mesh.mesh.direction.size
    if not foreign or key in _TRIED.setdefault(type(foreign[0]), set()):
        return
    arrays = read_only(answer(element, "bind", mesh))
    parameters = read_only(np.array(answer(material, "parameters"), dtype=float))
    size = 1e-6 * float(mesh.mesh.lengths[0]) * mesh.mesh.direction
    rest = 0.0 * size
    # displacement of both nodes, and their velocity
    states = [
        read_only((np.concatenate(displacement), np.concatenate(velocity)))
        for displacement in ((rest, rest), (rest, size), (size, rest), (size, size), (rest, 1e3 * size))
        for velocity in ((rest, rest), (size, 2.0 * size))
    ]
    stress: Any = getattr(material.stress, "py_func", material.stress)
    energy_density: Any = getattr(material.energy_density, "py_func", material.energy_density)
    slot_kernels: dict[Any, Any] = {slots.stress: stress, slots.energy_density: energy_density}
    force = Specialiser(slot_kernels, jit=False).bind(element.internal_force)
    energy = Specialiser(slot_kernels, jit=False).bind(element.energy)

    def stress_of(u: Floats, _: Floats) -> Any:
        return stress(parameters, float(u[-1] - u[0]))

    def density_of(u: Floats, v: Floats) -> Any:
        return energy_density(parameters, float(u[-1] - u[0]), float(v[-1] - v[0]))

    def force_of(u: Floats, _: Floats) -> Floats:
        result = np.full(u.size, np.nan)
        force(arrays, parameters, 0, rest.size, u, result)
        return result

    def energy_of(u: Floats, v: Floats) -> Any:
        return energy(arrays, parameters, 0, rest.size, u, v, 1e-3)

    kernels: tuple[tuple[Any, str, Callable[[Any, Any], Any]], ...] = (
        (material, "stress", stress_of),
        (material, "energy_density", density_of),
        (element, FORCE, force_of),
        (element, "energy", energy_of),
    )
    for component, name, call in kernels:
        if component in foreign:
            _try_twice(component, name, call, states)
    _TRIED[type(foreign[0])].add(key)


def _try_twice(component: Any, name: str, call: Callable[[Any, Any], Any], states: list[Any]) -> None:
    """Call a kernel in all states, twice; raise PluginError if it fails or its results differ."""
    try:
        with np.errstate(all="ignore"):
            first, second = ([call(*state) for state in states] for _ in range(2))
    except PercussError:
        raise
    except Exception as error:
        text = f"{name}: {type(error).__name__}: {error}"
        if isinstance(error, ValueError) and "read-only" in str(error):
            text = f"{name} changes what it was handed to read"
        failure = breach(component, name, text)
        where = line_in_plugin(error)
        raise PluginError(f"{where}: {str(failure).partition(': ')[2]}" if where else str(failure)) from error
    for value, repeated in zip(first, second, strict=True):
        # the nodal forces are the array that the kernel was handed; the other kernels return a number
        if np.ndim(value) != (1 if name == FORCE else 0):
            raise breach(component, name, f"{name} returned {value}, expected one number")
        if not np.isfinite(np.asarray(value, dtype=float)).all():
            raise breach(component, name, f"{name} gave {value}, expected finite numbers")
        if not same(value, repeated):
            raise breach(component, name, f"{name} {DIFFERENT}")
