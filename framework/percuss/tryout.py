"""A law's own kernel tried once before it runs, in plain Python, and where in a plug-in an error came from.

Compiled code checks no bounds, writes where it was told not to, and leaves unset what a kernel forgets; numbers that
come of that look like any others. One call in plain Python, with arrays that cannot be written and a multiplier that
is no number, tells before the run.
"""

from __future__ import annotations

import sys
import traceback
import weakref
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contracts import Rows, Trial
from percuss.errors import PluginError
from percuss.escape import kernel_of

if TYPE_CHECKING:
    from percuss.contracts import ContactLaw, ContactPoints

OWN = ("percuss", "percuss_methods")
_TRIED: weakref.WeakKeyDictionary[type, set[int]] = weakref.WeakKeyDictionary()


def bound_of(law: ContactLaw, points: ContactPoints, dt: float) -> Any:
    """Return what a law binds at some points, its kernel tried if it has one.

    Raises
    ------
    PluginError
        If `bind` returned anything but rows or a NamedTuple, or the kernel fails.
    """
    bound = law.bind(points, dt)
    if isinstance(bound, Rows):
        return bound
    if not (isinstance(bound, tuple) and hasattr(bound, "_fields")):
        found = "nothing" if bound is None else f"a {type(bound).__name__}"
        wanted = "Rows, or a NamedTuple of what its kernel `multipliers` needs"
        raise PluginError(f"contact law {law.name}: bind returned {found}, expected {wanted}")
    count = len(points.names)
    if count not in _TRIED.setdefault(type(law), set()):
        _try(law, bound, points, dt)
        _TRIED[type(law)].add(count)
    return bound


def _try(law: ContactLaw, bound: Any, points: ContactPoints, dt: float) -> None:
    """Call the kernel of a law with closed and open points, each closing or parting."""
    kernel: Any = kernel_of(law)
    kernel = getattr(kernel, "py_func", kernel)
    before = _mutable(kernel)
    count = len(points.names)
    place = np.arange(count)
    for shift in range(2):
        gap = 1e-6 * np.where((place + shift) % 2, -1.0, 1.0)
        rate = np.where((place // 2 + shift) % 2, -1e-3, 1e-3)
        arrays = [gap, gap + dt * rate, rate, rate.copy()]
        for array in arrays:
            array.flags.writeable = False
        e=np.zeros(0, dtype=np.int64); trial = Trial(arrays[0], arrays[1], arrays[2], arrays[3], points.delassus, dt, 0.0, dt * dt, dt, np.zeros(count+1,dtype=np.int64), e, np.zeros(0), np.zeros(count))
        multiplier = np.full(count, np.nan)
        try:
            with np.errstate(all="ignore"):
                kernel(bound, trial, multiplier)
        except Exception as error:
            text = f"{type(error).__name__}: {error}"
            if isinstance(error, ValueError) and "read-only" in str(error):
                text = "it changes what it was handed; it may write to the multiplier alone"
            where = fault_of(error)
            raise PluginError(f"{where + ': ' if where else ''}contact law {law.name}: multipliers: {text}") from error
        if np.isnan(multiplier).any():
            raise PluginError(
                f"contact law {law.name}: multipliers leaves point {int(np.isnan(multiplier).argmax())} of {count} "
                "without a number: set every entry, 0.0 where nothing presses"
            )
    for name, value in _mutable(kernel).items():
        if value != before[name]:
            raise PluginError(
                f"contact law {law.name}: multipliers changes `{name}`: a kernel keeps nothing between calls; what it "
                "needs is in what `bind` returns and in the trial"
            )


def _mutable(kernel: Any) -> dict[str, str]:
    """Return what the lists and the like that a kernel names look like, those of classes too."""
    kinds = (list, dict, set, bytearray, np.ndarray)
    names = kernel.__globals__
    found = {name: names[name] for name in kernel.__code__.co_names if name in names}
    inside = {
        f"{name}.{part}": value
        for name, owner in found.items()
        if isinstance(owner, type)
        for part, value in vars(owner).items()
    }
    return {name: repr(value) for name, value in {**found, **inside}.items() if isinstance(value, kinds)}


def fault_of(error: BaseException) -> str:
    """Return ``file:line`` of the innermost step of an error that is in a plug-in of somebody else's, else nothing."""
    plugins = _plugin_modules()
    for frame, line in reversed(list(traceback.walk_tb(error.__traceback__))):
        module = frame.f_globals.get("__name__", "")
        if module.startswith("percuss_file_") or module.partition(".")[0] in plugins:
            return f"{frame.f_code.co_filename}:{line}"
    return ""


def _plugin_modules() -> set[str]:
    """Return the top modules of the plug-ins that are loaded, less percuss's own."""
    registry: ModuleType | None = sys.modules.get("percuss.registry")
    if registry is None:
        return set()
    sources = registry.Registry.load().sources.values()
    return {source.module.partition(".")[0] for source in sources} - set(OWN)
