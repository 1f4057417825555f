"""Bind kernels into templates, compile them once, and keep the machine code in the user's cache folder.

A template is copied with the kernels as its globals, under a name that holds a hash of everything its code can
reach: its own bytecode and constants, helpers, module constants, closures, and the versions of Python, numba, NumPy
and percuss. So an edited kernel, helper or constant never meets the machine code of its predecessor.
"""

from __future__ import annotations

import functools
import hashlib
import sys
import types
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import percuss

Kernel = Callable[..., Any]

_COMPILED: dict[tuple[str, bool], Kernel] = {}  # one process compiles or loads a kernel once

# these modules hold the loop; nothing in them allocates
_OWN = ("percuss.kernels", "percuss.loop", "percuss.contact", "percuss.escape", "percuss.stages")

# functions of these packages are the compiler's own business
_FOREIGN = ("numpy", "math", "numba", "builtins", "scipy", "cmath")


def _is_foreign(name: str | None) -> bool:
    return (name or "").split(".")[0] in _FOREIGN


def _plain(value: object) -> types.FunctionType | None:
    """Return the Python function behind a plain or jitted function that a kernel may call, else None."""
    function = getattr(value, "py_func", value)
    if isinstance(function, types.FunctionType) and not _is_foreign(function.__module__):
        return function
    return None


def _names(code: types.CodeType) -> set[str]:
    """Return the names a code object and those nested in it refer to."""
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            names |= _names(constant)
    return names


class Specialiser:
    """Builds kernels for one run; either compiled or as plain Python.

    Parameters
    ----------
    slots
        Slot function to the kernel, plain or already bound, that takes its place.
    jit
        Whether to compile.
    counting
        Whether kernels of plug-ins may allocate arrays, which takes reference counts.
    """

    def __init__(
        self,
        slots: Mapping[Kernel, Kernel] | None = None,
        *,
        jit: bool = True,
        counting: bool = False,
    ) -> None:
        self.slots = dict(slots or {})
        self.jit = jit
        self.counting = counting
        self.tags: dict[int, str] = {}
        self._bound: dict[int, Kernel] = {}
        self._open: set[int] = set()
        self._keep: list[object] = []  # ids are only unique among living objects

    def with_slots(self, slots: Mapping[Kernel, Kernel]) -> Specialiser:
        """Return a specialiser that binds `slots` on top of these; kernels already bound stay usable."""
        other = Specialiser({**self.slots, **slots}, jit=self.jit, counting=self.counting)
        other.tags = self.tags
        other._keep = self._keep
        return other

    def bind(self, function: Kernel, *, cache: bool = False, plain: bool = False, reduction: bool = False) -> Kernel:
        """Return `function` with its slots and helpers bound, compiled if this specialiser compiles.

        Parameters
        ----------
        function
            Template or kernel.
        cache
            Whether its machine code is kept on disk: for what is called from Python, which holds all it calls.
        plain
            Leave this one as plain Python around the parts bound so far; so is whatever calls it.
        reduction
            Whether it adds up terms whose order does not matter.
        """
        if id(function) in self.tags:
            return function
        done = self._bound.get(id(function))
        if done is not None:
            return done
        source = _plain(function)
        if source is None:
            raise TypeError(f"{function!r} is not a Python function")
        if id(function) in self._open:
            return function  # a helper that calls itself
        self._open.add(id(function))
        names = _names(source.__code__)
        bound = {}
        for name in sorted(names & set(source.__globals__)):
            value = source.__globals__[name]
            replacement = self._replacement(value)
            if replacement is not None:
                bound[name] = replacement
        closure = tuple(
            types.CellType(self._replacement(cell.cell_contents) or cell.cell_contents)
            for cell in source.__closure__ or ()
        )
        callees = [*bound.values(), *(cell.cell_contents for cell in closure)]
        plain = plain or any(id(callee) in self.tags and isinstance(callee, types.FunctionType) for callee in callees)
        options = _options(source, counting=self.counting, cache=cache, reduction=reduction)
        tag = self._tag(source, names, bound, closure, options)
        copy = types.FunctionType(
            source.__code__,
            {**source.__globals__, **bound},
            f"{source.__name__}_{tag}",
            source.__defaults__,
            closure or None,
        )
        copy.__module__, copy.__kwdefaults__ = source.__module__, source.__kwdefaults__
        copy.__qualname__, copy.__doc__ = f"{source.__name__}_{tag}", source.__doc__
        out: Kernel = copy
        if self.jit and not plain:
            out = _COMPILED.get((tag, cache)) or _compile(copy, options, cache=cache)
            _COMPILED[tag, cache] = out
        self._open.discard(id(function))
        self._bound[id(function)] = out
        self.tags[id(out)] = tag
        self._keep += [function, out]
        return out

    def _replacement(self, value: Any) -> Kernel | None:
        try:
            slot = self.slots.get(value)
        except TypeError:  # not hashable: a constant
            return None
        if slot is not None:
            return self.bind(slot, reduction=getattr(value, "reduction", False))
        if _plain(value) is not None and getattr(value, "py_func", None) is None:
            return self.bind(value)
        return None

    def _tag(
        self,
        source: types.FunctionType,
        names: set[str],
        bound: Mapping[str, Kernel],
        closure: tuple[Any, ...],
        options: Mapping[str, Any],
    ) -> str:
        # the module too: machine code on disk imports that of its kernels, and a file has a new one after an edit
        digest = hashlib.sha256(f"{_versions()};{source.__module__};{sorted(options.items())}".encode())
        digest.update(repr(self.jit).encode())
        _feed_code(digest, source.__code__)
        digest.update(repr(source.__defaults__).encode())
        for name in sorted(names):
            if name in bound:
                digest.update(f"{name}={self.tags.get(id(bound[name]), 'self')};".encode())
            elif name in source.__globals__:
                digest.update(f"{name}=".encode())
                _feed_value(digest, source.__globals__[name], names, set())
        for cell in closure:
            if id(cell.cell_contents) in self.tags:
                digest.update(self.tags[id(cell.cell_contents)].encode())
            else:
                _feed_value(digest, cell.cell_contents, names, set())
        return digest.hexdigest()[:16]


@functools.cache
def _versions() -> str:
    from importlib.metadata import version

    return f"{sys.version};{version('numba')};{np.__version__};{percuss.__version__}"


def _feed_code(digest: Any, code: types.CodeType) -> None:
    digest.update(code.co_code)
    digest.update(repr(code.co_names).encode())
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            _feed_code(digest, constant)
        else:
            digest.update(f"{type(constant).__name__}:{constant!r};".encode())


def _feed_value(digest: Any, value: Any, names: set[str], seen: set[int]) -> None:
    """Hash a global that a kernel reads: a constant by its value, a module by what of it the kernel names."""
    if id(value) in seen:
        return
    seen.add(id(value))
    function = _plain(value)
    if isinstance(value, types.ModuleType):
        digest.update(f"module {value.__name__} {getattr(value, '__version__', '')};".encode())
        if not _is_foreign(value.__name__):
            for name in sorted(names & set(vars(value))):
                digest.update(f"{name}=".encode())
                _feed_value(digest, vars(value)[name], names, seen)
    elif function is not None:
        _feed_code(digest, function.__code__)
        inner = _names(function.__code__)
        for name in sorted(inner & set(function.__globals__)):
            _feed_value(digest, function.__globals__[name], inner, seen)
    elif isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode() + value.tobytes())
    elif isinstance(value, type):
        digest.update(f"{value.__module__}.{value.__qualname__}{getattr(value, '_fields', '')};".encode())
    elif isinstance(value, (tuple, list)):
        digest.update(f"{type(value).__name__}[{len(value)}]".encode())
        for item in value:
            _feed_value(digest, item, names, seen)
    else:
        digest.update(f"{type(value).__name__}:{value!r};".encode())


def jit_disabled() -> bool:
    """Return whether numba is told not to compile (``NUMBA_DISABLE_JIT=1``)."""
    import numba

    return bool(numba.config.DISABLE_JIT)


def compile_error() -> tuple[type[Exception], ...]:
    """Return the errors numba raises for what it cannot compile."""
    from numba.core import errors

    # the second is no NumbaError, the third is what several of its own passes raise
    return errors.NumbaError, errors.UnsupportedBytecodeError, NotImplementedError


def _options(source: types.FunctionType, *, counting: bool, cache: bool, reduction: bool) -> dict[str, Any]:
    """Return how a function is compiled."""
    options: dict[str, Any] = {"error_model": "numpy", "nogil": True}
    if not cache and source.__module__ != "percuss.stages":
        options["forceinline"] = True  # a call that is not inlined passes every array as a handful of numbers
    if reduction or getattr(source, "reduction", False):
        options["fastmath"] = ("nsz", "reassoc")
    if _counting_can_be_left_out():
        options["_nrt"] = counting and source.__module__ not in _OWN  # said always: else the caller's is taken
    return options


def _compile(function: types.FunctionType, options: dict[str, Any], *, cache: bool) -> Kernel:
    import numba

    if "fastmath" in options:
        options["fastmath"] = set(options["fastmath"])
    if not cache:
        return numba.njit(**options)(function)  # type: ignore[no-any-return]
    asked = numba.config.CACHE_DIR
    if not asked:
        import platformdirs

        numba.config.CACHE_DIR = platformdirs.user_cache_dir("percuss", appauthor=False)
    try:
        return numba.njit(cache=True, **options)(function)  # type: ignore[no-any-return]
    finally:
        numba.config.CACHE_DIR = asked


@functools.cache
def _counting_can_be_left_out() -> bool:
    """Return whether this numba lets a function do without reference counts on the arrays it slices.

    The loop allocates nothing, and on small models the counts, two locked additions a slice, are half of its cost.
    Kernels of plug-ins do without too, unless one of them allocates: then all of theirs count.
    """
    import numba

    try:
        return float(numba.njit(_nrt=False)(_first)(np.ones(2))) == 1.0
    except Exception:  # noqa: BLE001 - whatever a future version says to an option it does not know
        return False


def _first(array: Any) -> Any:
    return array[:1][0]
