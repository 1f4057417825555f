"""What the binding of kernels has read, to tell whether binding the same kernels again would give the same code."""

from __future__ import annotations

import types
from collections.abc import Callable, Iterable
from typing import Any

from percuss.compiler.fingerprint import Fingerprint, contents, is_fixed, is_overloaded, refresh_overloads

_MISSING = object()


class Readings:
    """The functions, variables and values that a binding has read, and how they were.

    A kernel that calls another function, or reads another constant, than when it was bound needs other machine code.
    This is seldom, and to look whether anything has changed takes a twentieth of the time of binding again.
    """

    def __init__(self) -> None:
        self._objects: list[tuple[Callable[..., object], tuple[Any, ...], object]] = []
        self._values: list[tuple[object, frozenset[str], str]] = []
        self._overloads: list[tuple[object, bool]] = []

    def function(self, function: types.FunctionType, variables: Iterable[str]) -> None:
        """Add the code of a function, its defaults, the content of its closure, and some of its global variables."""
        for name in ("__code__", "__defaults__", "__kwdefaults__"):
            self.attribute(function, name)
        for cell in function.__closure__ or ():
            self._object(contents, cell)
        for name in variables:
            self._object(function.__globals__.get, name, _MISSING)

    def attribute(self, owner: types.ModuleType | types.FunctionType, name: str) -> None:
        """Add an attribute of a module or a function, or that it has none of this name."""
        self._object(getattr, owner, name, _MISSING)

    def _object(self, read: Callable[..., object], *arguments: Any) -> None:
        self._objects.append((read, arguments, read(*arguments)))

    def value(self, value: object, names: frozenset[str]) -> None:
        """Add the content of a value, as far as it is visible to code that refers to `names`."""
        if not is_fixed(value):
            self._values.append((value, names, _tag(value, names)))

    def overload(self, function: object) -> bool:
        """Return whether numba compiles other code in place of a function, and add that."""
        self._overloads.append((function, is_overloaded(function)))
        return self._overloads[-1][1]

    def unchanged(self, *, jit: bool) -> bool:
        """Return whether everything that was read is as it was; `jit` asks for overloads, too."""
        if jit:
            refresh_overloads()
        return (
            all(read(*arguments) is found for read, arguments, found in self._objects)
            and all(_tag(value, names) == tag for value, names, tag in self._values)
            and (not jit or all(is_overloaded(function) is before for function, before in self._overloads))
        )


def _tag(value: object, names: frozenset[str]) -> str:
    fingerprint = Fingerprint("")
    fingerprint.value(value, names)
    return fingerprint.tag
