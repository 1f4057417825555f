"""Digests of the values that a kernel reads: with the digest of its code they promise equal machine code.

Numba's own cache checks the file of the compiled function, but nothing that this function calls or reads. A fingerprint
contains the value of a constant and, of a module, the attributes that the code names. Functions are not values here:
those that a kernel calls are bound and have a digest of their own (`percuss.methods.source_digest.function_digest`).
"""

from __future__ import annotations

import enum
import functools
import hashlib
import sys
import types
from typing import Any

import numpy as np

from percuss.compiling import numba_inside

# Functions of these packages are compiled by numba itself; a fingerprint contains their names only.
FOREIGN = ("numpy", "math", "numba", "builtins", "scipy", "cmath")

_BY_REPR = (bool, int, float, complex, str, bytes, type(None), type(...), range, slice, np.dtype)
_FIXED = (*_BY_REPR, np.generic, np.ufunc, types.FunctionType, types.BuiltinFunctionType)
# Objects that a fingerprint identifies by their address: kept alive, so that no other object can take that address.
_KEPT_ALIVE: dict[int, object] = {}


def is_foreign(name: str | None) -> bool:
    """Return whether a module belongs to a package whose functions are identified by their names."""
    return (name or "").split(".")[0] in FOREIGN


def is_fixed(value: object) -> bool:
    """Return whether the fingerprint of a value cannot change: that of a constant, a function or a foreign module."""
    if isinstance(value, types.ModuleType):
        return is_foreign(value.__name__)
    if isinstance(value, tuple):
        return all(map(is_fixed, value))
    return isinstance(value, _FIXED) and not isinstance(value, enum.Enum)


def plain_function(value: object) -> types.FunctionType | None:
    """Return the Python function behind a plain or jitted function that a kernel may call, else None."""
    function = getattr(value, "py_func", value)
    # The globals belong to the true module: a decorator may have copied `__module__` from the function it wraps.
    if isinstance(function, types.FunctionType) and not is_foreign(function.__globals__.get("__name__")):
        return function
    return None


@functools.lru_cache(maxsize=4096)
def named_in(code: types.CodeType) -> frozenset[str]:
    """Return the names that a code object, with those nested in it, refers to.

    String constants that are identifiers are included, as they may be arguments of `getattr`.
    """
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            names |= named_in(constant)
        elif isinstance(constant, str) and constant.isidentifier():
            names.add(constant)
    return frozenset(names)


def layout(value: object) -> str:
    """Return the class and field names of nested tuples, in order, as one string; empty for any other value.

    Machine code on disk identifies a NamedTuple by the name of its class, and a field by its position alone.
    """
    if not isinstance(value, tuple):
        return ""
    fields = getattr(type(value), "_fields", range(len(value)))
    inner = ",".join(f"{field}:{layout(item)}" for field, item in zip(fields, value, strict=True))
    return f"{type(value).__module__}.{type(value).__qualname__}({inner})"


class Fingerprint:
    """A digest of several values.

    Attributes
    ----------
    whole
        False once a value without identifiable content was added: such a value counts by its address in memory, and
        equal digests promise equal content in this process only.
    """

    def __init__(self, text: str) -> None:
        self._digest = hashlib.sha256(text.encode())
        # The values themselves, too, as ids are only unique among living objects.
        self._seen: dict[tuple[int, frozenset[str]], object] = {}
        self.whole = True

    @property
    def tag(self) -> str:
        """The first sixteen hexadecimal digits of the digest."""
        return self._digest.hexdigest()[:16]

    def text(self, text: str) -> None:
        """Add a text, followed by a separator."""
        self._digest.update(text.encode() + b"\0")

    def value(self, value: Any, names: frozenset[str]) -> None:
        """Add the part of a value that is visible to code that refers to `names`."""
        if (id(value), names) in self._seen:
            self.text("again")
            return
        self._seen[id(value), names] = value
        if isinstance(value, _BY_REPR) and not isinstance(value, enum.Enum):
            self.text(f"{type(value).__name__}:{value!r}")
        elif isinstance(value, types.ModuleType):
            self._module(value, names)
        elif isinstance(value, type):
            self._class(value, names)
        elif isinstance(value, (tuple, list, dict, set, frozenset)):
            self._container(value, names)
        elif (type(value) in {np.ndarray, np.recarray} or isinstance(value, np.generic)) and not value.dtype.hasobject:
            self._digest.update(f"{value.dtype}{value.shape}".encode() + value.tobytes())
        elif isinstance(value, enum.Enum):
            self._class(type(value), frozenset())
            self.text(value.name)
        elif isinstance(value, np.ufunc) or _is_named_in_module(value):
            self.text(f"{type(value).__name__} {getattr(value, '__module__', '')}.{value.__name__}")
        elif _is_type_of_numba(value):
            self.text(repr(value))
        else:
            self._by_address(value)

    def _module(self, value: types.ModuleType, names: frozenset[str]) -> None:
        self.text(f"module {value.__name__} {getattr(value, '__version__', '')}")
        if is_foreign(value.__name__):
            return
        # Not from the dictionary of the module, which may create attributes on request (`__getattr__`).
        for name in sorted(name for name in names if hasattr(value, name)):
            self.text(name)
            self.value(getattr(value, name), names)

    def _class(self, value: type, names: frozenset[str]) -> None:
        self.text(f"{value.__module__}.{value.__qualname__}{getattr(value, '_fields', '')}")
        self.value(getattr(value, "_field_defaults", None), names)  # of a NamedTuple
        if issubclass(value, enum.Enum):
            for member in value:
                self.text(member.name)
                self.value(member.value, names)
        elif hasattr(value, "class_type"):  # a class compiled by numba's jitclass, with all its methods
            self._by_address(value)

    def _container(self, value: Any, names: frozenset[str]) -> None:
        fields = getattr(type(value), "_fields", "")
        self.text(f"{type(value).__module__}.{type(value).__qualname__}{fields}[{len(value)}]")
        items = value.items() if isinstance(value, dict) else value
        for item in sorted(items, key=repr) if isinstance(value, (set, frozenset)) else items:
            self.value(item, names)

    def _by_address(self, value: object) -> None:
        _KEPT_ALIVE[id(value)] = value
        self.whole = False
        self.text(f"at {id(value)}")


def refresh_overloads() -> None:
    """Let numba notice the overloads of functions that were registered since the last call."""
    inside = numba_inside()
    if inside is not None:
        inside.refresh_overloads()


def is_overloaded(function: object) -> bool:
    """Return whether numba compiles other code in place of a plain function, as an overload of it."""
    inside = numba_inside()
    return inside is not None and isinstance(function, types.FunctionType) and inside.is_overloaded(function)


def contents(cell: types.CellType) -> object:
    """Return the content of a closure cell, None where it is still empty."""
    try:
        return cell.cell_contents
    except ValueError:
        return None


def _is_named_in_module(value: object) -> bool:
    """Return whether a value is the attribute of its own foreign module under its own name, as ``math.sin`` is."""
    module, name = getattr(value, "__module__", None), getattr(value, "__name__", None)
    if not isinstance(module, str) or not isinstance(name, str) or not is_foreign(module):
        return False
    return getattr(sys.modules.get(module), name, None) is value


def _is_type_of_numba(value: object) -> bool:
    """Return whether a value is one of the types of compiled code."""
    return "numba" in sys.modules and isinstance(value, sys.modules["numba"].types.Type)
