"""What the binding of kernels has read, to tell whether binding the same kernels again would give the same code."""

from __future__ import annotations

import types
from collections.abc import Mapping

from percuss.compiler.fingerprint import Fingerprint, contents, is_fixed, is_overloaded, refresh_overloads

_MISSING = object()


class Readings:
    """The functions, variables and values that a binding has read, and how they were.

    A kernel that calls another function, or reads another constant, than when it was bound needs other machine code.
    This is seldom, and to look whether anything has changed takes a twentieth of the time of binding again.
    """

    def __init__(self) -> None:
        self._variables: list[tuple[Mapping[str, object], str, object]] = []
        self._attributes: list[tuple[types.ModuleType | types.FunctionType, str, object]] = []
        self._cells: list[tuple[types.CellType, object]] = []
        self._values: list[tuple[object, frozenset[str], str]] = []
        self._overloads: list[tuple[object, bool]] = []

    def function(self, function: types.FunctionType) -> None:
        """Add the code of a function, its defaults and the content of its closure."""
        for name in ("__code__", "__defaults__", "__kwdefaults__"):
            self.attribute(function, name)
        self._cells += [(cell, contents(cell)) for cell in function.__closure__ or ()]

    def variable(self, namespace: Mapping[str, object], name: str) -> None:
        """Add the variable `name` of the globals of a function."""
        self._variables.append((namespace, name, namespace[name]))

    def attribute(self, owner: types.ModuleType | types.FunctionType, name: str) -> None:
        """Add an attribute of a module or a function, or that it has none of this name."""
        self._attributes.append((owner, name, getattr(owner, name, _MISSING)))

    def value(self, value: object, names: frozenset[str]) -> None:
        """Add the content of a value, as far as it is visible to code that refers to `names`."""
        if not is_fixed(value):
            self._values.append((value, names, _tag(value, names)))

    def overload(self, function: object, *, overloaded: bool) -> None:
        """Add whether numba compiles other code in place of a function."""
        self._overloads.append((function, overloaded))

    def unchanged(self, *, jit: bool) -> bool:
        """Return whether everything that was read is as it was; `jit` asks for overloads, too."""
        if jit:
            refresh_overloads()
        return (
            all(namespace.get(name, _MISSING) is value for namespace, name, value in self._variables)
            and all(getattr(owner, name, _MISSING) is value for owner, name, value in self._attributes)
            and all(contents(cell) is value for cell, value in self._cells)
            and all(_tag(value, names) == tag for value, names, tag in self._values)
            and (not jit or all(is_overloaded(function) is before for function, before in self._overloads))
        )


def _tag(value: object, names: frozenset[str]) -> str:
    fingerprint = Fingerprint("")
    fingerprint.value(value, names)
    return fingerprint.tag
