"""A digest of everything the code of a kernel can reach: where it is equal, so is the machine code.

Numba looks at the file of the function it compiles and at nothing that function calls or reads. Here a function
counts by its code, defaults and closure, a constant by its value, a module by what of it is named, all the way down.
"""

from __future__ import annotations

import enum
import hashlib
import sys
import types
from collections.abc import Iterable
from typing import Any

import numpy as np

__all__ = ["Fingerprint", "contents", "is_foreign", "is_overloaded", "layout", "named_in", "plain_function"]

# functions of these packages are the compiler's own business
FOREIGN = ("numpy", "math", "numba", "builtins", "scipy", "cmath")

_BY_REPR = (bool, int, float, complex, str, bytes, type(None), type(...), range, slice, np.dtype)
_NOTHING = object()
_ALIVE: dict[int, object] = {}  # what was told by its place in memory, which nothing else may take


def is_foreign(name: str | None) -> bool:
    """Return whether a module belongs to a package that the versions in every digest stand for."""
    return (name or "").split(".")[0] in FOREIGN


def plain_function(value: object) -> types.FunctionType | None:
    """Return the Python function behind a plain or jitted function that a kernel may call, else None."""
    function = getattr(value, "py_func", value)
    # by its globals: a decorator may have copied the module of what it wraps
    if isinstance(function, types.FunctionType) and not is_foreign(function.__globals__.get("__name__")):
        return function
    return None


def named_in(code: types.CodeType) -> set[str]:
    """Return the names a code object and those nested in it refer to; texts too, as `getattr` takes them."""
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            names |= named_in(constant)
        elif isinstance(constant, str) and constant.isidentifier():
            names.add(constant)
    return names


def layout(value: object) -> str:
    """Return how the fields of nested tuples are called and follow each other.

    Machine code on disk knows a NamedTuple by the name of its class, and a field by its place.
    """
    if not isinstance(value, tuple):
        return ""
    fields = getattr(type(value), "_fields", range(len(value)))
    inner = ",".join(f"{field}:{layout(item)}" for field, item in zip(fields, value, strict=True))
    return f"{type(value).__module__}.{type(value).__qualname__}({inner})"


class Fingerprint:
    """Digests values one after the other.

    Attributes
    ----------
    whole
        False as soon as something was met whose content cannot be told: it counts by its place in memory, and equal
        digests promise equal content in this process only.
    """

    def __init__(self, text: str) -> None:
        self._digest = hashlib.sha256(text.encode())
        self._seen: set[tuple[int, frozenset[str]]] = set()
        self._keep: list[object] = []  # ids are only unique among living objects
        self.whole = True

    @property
    def tag(self) -> str:
        """The digest in sixteen letters."""
        return self._digest.hexdigest()[:16]

    def text(self, text: str) -> None:
        """Digest a text, its end included."""
        self._digest.update(text.encode() + b"\0")

    def code(self, code: types.CodeType) -> None:
        """Digest bytecode with its constants, and the names by which arguments may be passed."""
        self._digest.update(code.co_code + code.co_exceptiontable)
        shape = (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags)
        self.text(repr((shape, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)))
        for constant in code.co_consts:
            if isinstance(constant, types.CodeType):
                self.code(constant)
            else:
                self.text(f"{type(constant).__name__}:{constant!r}")

    def function(self, function: types.FunctionType) -> None:
        """Digest a function: its code, what its arguments default to, and all globals and cells it reads."""
        names = named_in(function.__code__)
        self.code(function.__code__)
        self.defaults(function)
        for name in sorted(names & set(function.__globals__)):
            self.text(name)
            self.value(function.__globals__[name], names)
        for cell in function.__closure__ or ():
            self.value(contents(cell), names)

    def defaults(self, function: types.FunctionType) -> None:
        """Digest what the arguments of a function default to."""
        self.value(function.__defaults__, ())
        self.value(function.__kwdefaults__, ())

    def value(self, value: Any, names: Iterable[str]) -> None:
        """Digest what code that refers to `names` can see of a value."""
        names = frozenset(names)
        if (id(value), names) in self._seen:
            self.text("again")
            return
        self._seen.add((id(value), names))
        self._keep.append(value)
        if isinstance(value, _BY_REPR) and not isinstance(value, enum.Enum):
            self.text(f"{type(value).__name__}:{value!r}")
        elif isinstance(value, types.ModuleType):
            self._module(value, names)
        elif isinstance(value, type):
            self._class(value, names)
        elif isinstance(value, (tuple, list, dict, set, frozenset)):
            self._container(value, names)
        elif type(value) in {np.ndarray, np.recarray} and not value.dtype.hasobject:
            self._digest.update(f"{value.dtype}{value.shape}".encode() + value.tobytes())
        elif isinstance(value, np.generic):
            self._digest.update(f"{value.dtype}".encode() + value.tobytes())
        else:
            self._callable(value)

    def _module(self, value: types.ModuleType, names: frozenset[str]) -> None:
        self.text(f"module {value.__name__} {getattr(value, '__version__', '')}")
        if is_foreign(value.__name__):
            return
        for name in sorted(names):
            one = getattr(value, name, _NOTHING)  # not from its dictionary: a module may make attributes when asked
            if one is not _NOTHING:
                self.text(name)
                self.value(one, names)

    def _class(self, value: type, names: frozenset[str]) -> None:
        self.text(f"{value.__module__}.{value.__qualname__}{getattr(value, '_fields', '')}")
        if issubclass(value, enum.Enum):
            for member in value:
                self.text(member.name)
                self.value(member.value, names)
        elif hasattr(value, "class_type"):  # of numba's jitclass, compiled with all its methods
            self._by_place(value)

    def _container(self, value: Any, names: frozenset[str]) -> None:
        fields = getattr(type(value), "_fields", "")
        self.text(f"{type(value).__module__}.{type(value).__qualname__}{fields}[{len(value)}]")
        items = value.items() if isinstance(value, dict) else value
        for item in sorted(items, key=repr) if isinstance(value, (set, frozenset)) else items:
            self.value(item, names)

    def _callable(self, value: Any) -> None:
        """Digest a function, or whatever else is left: what is not known makes the digest worthless."""
        function = plain_function(value)
        inner = getattr(getattr(value, "_dispatcher", None), "py_func", None)  # of numba's vectorize
        if function is not None:
            # what numba compiled has a name without a tag: loaded from disk, it would stand for its edited successor
            if function is not value or is_overloaded(function):
                self._by_place(value)
            self.text(repr(sorted(getattr(value, "targetoptions", {}).items(), key=repr)))
            self.function(function)
        elif isinstance(inner, types.FunctionType):
            self._by_place(value)
            self.text(f"{type(value).__name__}{getattr(value, 'types', '')}{getattr(value, 'identity', '')}")
            self.function(inner)
        elif isinstance(value, enum.Enum):
            self._class(type(value), frozenset())
            self.text(value.name)
        elif isinstance(value, np.ufunc) or _is_where_it_says(value):
            self.text(f"{type(value).__name__} {getattr(value, '__module__', '')}.{value.__name__}")
        elif is_foreign(type(value).__module__) and type(value).__module__.startswith("numba.core.types"):
            self.text(repr(value))
        else:
            self._by_place(value)

    def _by_place(self, value: object) -> None:
        _ALIVE[id(value)] = value
        self.whole = False
        self.text(f"at {id(value)}")


def is_overloaded(function: object) -> bool:
    """Return whether numba was told of other code to compile in the place of a plain function."""
    registry = sys.modules.get("numba.core.registry")
    if registry is None or not isinstance(function, types.FunctionType):
        return False
    context = registry.cpu_target.typing_context
    # What numba knows of overloads is filled by generators, which another thread that compiles may be in.
    with sys.modules["numba.core.compiler_lock"].global_compiler_lock:
        context.refresh()
        return context._lookup_global(function) is not None


def contents(cell: types.CellType) -> Any:
    """Return what a cell of a closure holds, None where it is still empty."""
    try:
        return cell.cell_contents
    except ValueError:
        return None


def _is_where_it_says(value: Any) -> bool:
    """Return whether a value is what its own foreign module knows by its name, as ``math.sin`` is."""
    module, name = getattr(value, "__module__", None), getattr(value, "__name__", None)
    if not isinstance(module, str) or not isinstance(name, str) or not is_foreign(module):
        return False
    return getattr(sys.modules.get(module), name, None) is value
