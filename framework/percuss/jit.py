"""Kernels bound into the functions that call them, and compiled by numba.

A template is a function that calls slots, functions without a body. It is copied with kernels in the place of its
slots, and so are the functions that it calls. For the compiler the name of a copy ends in a digest of its sources
(`percuss.digest`), of the values that it reads and of all that is bound into it: numba stores machine code on disk
under that name, so that after an edit of any of them another name is asked for.
"""

from __future__ import annotations

import functools
import inspect
import os
import threading
import time
import types
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias, TypeVar, cast

import numpy as np

from percuss.cache import cache_folder
from percuss.digest import content_digest, is_of_the_loop, loop_digest, source_digest, surroundings
from percuss.heartbeat import beat
from percuss.interrupt import interrupted_afterwards
from percuss.jsonable import Data, Entries

Kernel: TypeAlias = Callable[..., Any]  # a function of the loop or of a method, compiled or in plain Python
AnyKernel = TypeVar("AnyKernel", bound=Kernel)

FOREIGN = {"builtins", "cmath", "llvmlite", "math", "numba", "numpy", "scipy"}  # numba knows their functions
SIMPLE = (bool, int, float, complex, str, bytes, np.generic, np.dtype)
# Options of `numba.njit` that its manual does not have. They change no number: a version that does not know them
# compiles without. Without `_nrt` code does not count references to its array slices, which costs half of the time of a
# small model. With `forceinline` a function is copied into its callers. The others leave out what nobody calls.
UNDOCUMENTED = {"_nrt", "forceinline", "no_cpython_wrapper", "no_cfunc_wrapper"}
_UNKNOWN: set[str] = set()  # those that this version of numba does not know

LOCK = threading.RLock()
# Called with True when a compilation begins, and with False when it has finished.
NOTICES: list[Callable[[bool], None]] = []


# ------------------------------------------------------------------------------------------------------------- marks


def called(function: AnyKernel) -> AnyKernel:
    """Mark a function that is compiled once and called; copied into its callers it would compile for too long."""
    function.called = True  # type: ignore[attr-defined]
    return function


def fused(function: AnyKernel) -> AnyKernel:
    """Mark a function in which products are added without being rounded first, if the processor can do so.

    Each of its sums may contain one product only, so that the compiler has no choice: it computes the same bits in
    every copy, whether for one number or for several at once.
    """
    function.fused = True  # type: ignore[attr-defined]
    return function


def merged(slot: AnyKernel) -> AnyKernel:
    """Mark a slot whose kernel, with all that it calls, merges with its caller before the compiler optimises anything.

    The compiler then knows how often the loops of the kernel run, where the caller knows it.
    """
    slot.merged = True  # type: ignore[attr-defined]
    return slot


# ----------------------------------------------------------------------------------------------------------- binding


class Filled(NamedTuple):
    """What fills a slot where it has slots of its own: a template and, in pairs, what fills them there."""

    kernel: Kernel
    slots: tuple[tuple[Kernel, Any], ...]


class Bound(NamedTuple):
    """A copy of a function with kernels in its slots, or another value that a function reads.

    Attributes
    ----------
    value
        The copy.
    digest
        Digest of all from which it is made; empty in plain Python.
    options
        Options of the compiler.
    """

    value: Any
    digest: str = ""
    options: Data = MappingProxyType({})


@dataclass
class Binder:
    """Binds kernels into templates.

    Parameters
    ----------
    slots
        What fills each slot: a kernel, `Filled` or `Bound`.
    jit
        Whether for the compiler, or for plain Python.
    allocates
        Whether kernels of plug-ins may allocate arrays, which needs reference counts.
    inline
        Whether functions are copied into their callers.
    checked
        Whether kernels of plug-ins check array indices against the size of the array.
    """

    slots: Mapping[Kernel, Any]
    jit: bool = True
    allocates: bool = False
    inline: bool = True
    checked: bool = False
    _merges: bool = False  # whether functions merge with their callers, as in a slot that is `merged`
    _done: dict[object, Bound | None] = field(default_factory=dict)

    def bind(self, function: Kernel, *, reduction: bool = False) -> Bound:
        """Return a copy of a function with its slots filled, and with bound copies of all functions that it calls.

        The terms of the sum of a `reduction` may be added in any order.
        """
        source, found = plain_function(function), self._done.get(function)
        if found is not None:
            return found
        if source is None or function in self._done:  # an instruction for the compiler, or a recursive call
            return Bound(function, getattr(function, "__name__", ""))
        self._done[function] = None
        names = _names(source.__code__)
        read = {name: source.__globals__[name] for name in sorted(names) if name in source.__globals__}
        parts = {name: part for name, value in read.items() if (part := self._part(value, names))}
        cells = [cell.cell_contents for cell in source.__closure__ or ()]
        closure = [self._part(value, names) or Bound(value, _text(value)) for value in cells]
        copy = types.FunctionType(
            source.__code__,
            source.__globals__ | {name: part.value for name, part in parts.items()},
            source.__name__,
            source.__defaults__,
            tuple(types.CellType(part.value) for part in closure),
        )
        copy.__module__, copy.__kwdefaults__, copy.__doc__ = source.__module__, source.__kwdefaults__, source.__doc__
        bound = Bound(copy)
        if self.jit:
            options = self._options(function, source, reduction=reduction or getattr(function, "reduction", False))
            digests = [(name, parts[name].digest if name in parts else _text(value)) for name, value in read.items()]
            digest = _digest(_about(source), sorted(options.items()), digests, [part.digest for part in closure])
            copy.__name__ = copy.__qualname__ = f"{source.__name__}_{digest}"
            bound = Bound(copy, digest, options)
        self._done[function] = bound
        return bound

    def reached(self, function: Kernel) -> bool:
        """Return whether the code that was bound reaches a function."""
        return function in self._done

    def callee(self, function: Kernel, *, reduction: bool = False) -> Bound:
        """Return a function as `bind` does, for compiled callers compiled alone."""
        bound = self.bind(function, reduction=reduction)
        compiles = self.jit and isinstance(bound.value, types.FunctionType)
        return bound._replace(value=_callee(bound)) if compiles else bound

    def _part(self, value: Any, names: frozenset[str]) -> Bound | None:
        """Return what stands in for a value that a function reads, or None to keep the value."""
        if isinstance(value, types.ModuleType):
            return self._module(value, names)
        slot = self.slots.get(value) if isinstance(value, types.FunctionType) else None
        if isinstance(slot, Bound):
            return slot
        maker, kernel, reduction = self, slot or value, getattr(value, "reduction", False)
        if getattr(value, "merged", False):
            maker = replace(maker, _merges=self.inline, _done={})
        if isinstance(slot, Filled):
            maker, kernel = replace(maker, slots={**self.slots, **dict(slot.slots)}, _done={}), slot.kernel
        if slot is None and plain_function(value) is None:
            return None
        return maker.callee(kernel, reduction=reduction)

    def _module(self, module: types.ModuleType, names: frozenset[str]) -> Bound | None:
        """Return a copy of a module in which its functions among `names` are bound; None of one that numba knows."""
        if module.__name__.split(".")[0] in FOREIGN or module in self._done:
            return None
        self._done[module] = None  # prevents endless recursion where modules import each other
        read = {name: getattr(module, name) for name in sorted(names) if hasattr(module, name)}
        parts = {name: part for name, value in read.items() if (part := self._part(value, names))}
        del self._done[module]
        copy = types.ModuleType(module.__name__)
        vars(copy).update(vars(module) | {name: part.value for name, part in parts.items()})
        digests = [(name, parts[name].digest if name in parts else _text(value)) for name, value in read.items()]
        return Bound(copy, _digest(digests))

    def _options(self, function: Any, source: types.FunctionType, *, reduction: bool) -> Entries:
        """Return the options of the compiler, of a jitted function those of its author too."""
        own = is_of_the_loop(source.__code__.co_filename)
        options: Entries = {"boundscheck": True} if self.checked and not own else {}
        if hasattr(function, "targetoptions"):
            author = {name: value for name, value in function.targetoptions.items() if name != "nopython"}
            if isinstance(flags := author.get("fastmath"), set):
                author["fastmath"] = tuple(sorted(flags))
            return options | author
        # Always set, because otherwise the option of the calling function applies. The loop allocates nothing.
        options |= {"error_model": "numpy", "nogil": True, "_nrt": self.allocates and not own}
        if self.inline and not getattr(function, "called", False):
            options |= {"inline": "always"} if self._merges else {"forceinline": True}
        if reduction:
            options["fastmath"] = ("nsz", "reassoc")
        elif getattr(function, "fused", False):
            options["fastmath"] = ("contract",)
        return options


def plain_function(value: object) -> types.FunctionType | None:
    """Return the Python function behind a plain or jitted function that a kernel may call, else None."""
    function = getattr(value, "py_func", value)
    if not isinstance(function, types.FunctionType):
        return None
    # The globals belong to the true module: a decorator may have copied `__module__` from the function it wraps.
    top = str(function.__globals__.get("__name__")).split(".")[0]
    return None if top in FOREIGN else function


def plain(function: Kernel, slots: Mapping[Kernel, Any]) -> Kernel:
    """Return a function with its slots filled, in plain Python."""
    return cast("Kernel", Binder(slots, jit=False).bind(function).value)


@functools.lru_cache(maxsize=4096)
def _names(code: types.CodeType) -> frozenset[str]:
    """Return the names that a code object, with those nested in it, refers to."""
    inner = (_names(constant) for constant in code.co_consts if isinstance(constant, types.CodeType))
    return frozenset(code.co_names).union(*inner)


def _text(value: object) -> str:
    """Return the text of a constant that is compiled into code; empty of any other value, whose source counts."""
    if isinstance(value, tuple):
        return f"({','.join(map(_text, value))})"
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{value.shape}{content_digest(value.tobytes())}"
    return f"{type(value).__name__} {value!r}" if isinstance(value, SIMPLE) else ""


def _digest(*about: object) -> str:
    return content_digest(repr(about).encode())[:16]


def _about(function: types.FunctionType) -> tuple[object, ...]:
    """Return on what the machine code of a function depends beside what it reads: its sources and what compiles it.

    The code is there for functions that are in no file, as those made by ``exec``.
    """
    sources = source_digest(function.__code__.co_filename), loop_digest(), _versions()
    defaults = _text(function.__defaults__ or ()), _text(tuple((function.__kwdefaults__ or {}).items()))
    return *sources, function.__module__, function.__qualname__, *defaults, _code(function.__code__)


def _code(code: types.CodeType) -> tuple[object, ...]:
    """Return what a function does, without the flags of its code, which numba changes under a profiler."""
    constants = [
        _code(one) if isinstance(one, types.CodeType) else sorted(map(repr, one)) if isinstance(one, frozenset) else one
        for one in code.co_consts
    ]
    return code.co_firstlineno, code.co_code, code.co_names, code.co_varnames, constants


@functools.cache
def _versions() -> str:
    return repr(sorted(surroundings().items()))


# --------------------------------------------------------------------------------------------------------- compiling

# What this process has compiled or loaded, by digest and code, and of entries by the types of their arguments.
_CALLEES: dict[tuple[str, types.CodeType], Kernel] = {}
_ENTRIES: dict[tuple[str, types.CodeType], dict[tuple[Any, ...], Kernel]] = {}


def _callee(bound: Bound) -> Kernel:
    """Return a bound function for compiled callers alone; a call from Python would crash the process."""
    import numba

    key = bound.digest, bound.value.__code__
    if key not in _CALLEES:
        wrapped = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        _CALLEES[key] = numba.njit(**_usable({**bound.options, **wrapped}))(bound.value)
    return _CALLEES[key]


def entry(bound: Bound, decorate: Callable[..., Any], signature: Any) -> Any:
    """Return a bound function compiled for others than compiled callers, with its machine code on disk if possible.

    Parameters
    ----------
    bound
        The function.
    decorate
        `numba.njit` or `numba.cfunc`.
    signature
        The types of its arguments, for `numba.cfunc` also that of its result.
    """
    silent = not NOTICES or _stored(bound.value.__name__)
    with compiler(), nullcontext() if silent else announced():
        try:
            return _decorated(bound, decorate, signature)
        except KeyError:
            if not _drop_unknown_options():
                raise
            return _decorated(bound, decorate, signature)


def _decorated(bound: Bound, decorate: Callable[..., Any], signature: Any) -> Any:
    import numba

    options = {name: value for name, value in _usable(bound.options).items() if name != "forceinline"}
    before, folder = numba.config.CACHE_DIR, cache_folder()
    if folder is not None and os.access(folder, os.W_OK):
        numba.config.CACHE_DIR = str(folder)  # numba reads it in the decorator
        try:
            return decorate(signature, cache=True, **options)(bound.value)
        except Exception as error:  # no source, a full disk, damaged files: it is compiled without them
            if isinstance(error, (KeyError, *compile_error())):
                raise
            for file in _stored(bound.value.__name__):
                with suppress(OSError):
                    file.unlink()
        finally:
            numba.config.CACHE_DIR = before
    return decorate(signature, **options)(bound.value)


def _stored(name: str) -> list[Path]:
    """Return the files that numba has written for a function."""
    folder = cache_folder()
    return [] if folder is None else list(folder.glob(f"*/*.{name}-*"))


class Compiled:
    """A bound function, compiled for the types of its arguments when it is first called with them."""

    def __init__(self, bound: Bound) -> None:
        self.bound = bound
        self._known = _ENTRIES.setdefault((bound.digest, bound.value.__code__), {})

    def of(self, arguments: tuple[object, ...]) -> Kernel:
        """Return the function compiled for the types of these arguments."""
        import numba

        kinds = tuple(map(numba.typeof, arguments))
        with LOCK:
            if kinds not in self._known:
                self._known[kinds] = entry(self.bound, numba.njit, kinds)
            return self._known[kinds]

    def __call__(self, *arguments: object, **named: object) -> Any:
        """Call the function."""
        given = inspect.signature(self.bound.value).bind(*arguments, **named)
        given.apply_defaults()
        return self.of(given.args)(*given.args)


def compiled_function(function: AnyKernel, slots: Mapping[Kernel, Any] = MappingProxyType({})) -> AnyKernel:
    """Return a function compiled together with all functions that it calls, or as it is where numba may not compile.

    The machine code is stored in the user's cache folder and is never used after an edit of any of these functions, or
    of a constant that they read.

    Parameters
    ----------
    function
        A function that numba can compile, of arrays, numbers and tuples of them.
    slots
        What fills its slots, if it has any.

    Returns
    -------
    callable
        The same function. It is compiled when it is first called.
    """
    if jit_disabled():
        return function
    with compiler():
        return cast("AnyKernel", Compiled(Binder(slots, allocates=True, inline=False).bind(function)))


def compile_error() -> tuple[type[Exception], ...]:
    """Return the types of error that numba raises for code that it cannot compile."""
    from numba import errors

    # The second is no subclass of NumbaError, and several of numba's passes raise the third.
    return errors.NumbaError, errors.UnsupportedBytecodeError, NotImplementedError


def jit_disabled() -> bool:
    """Return whether numba is configured not to compile (``NUMBA_DISABLE_JIT=1``)."""
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in {"", "0"}:
        return True
    import numba

    return bool(numba.config.DISABLE_JIT)


def _usable(options: Data) -> Entries:
    """Return options as numba takes them, without those that its version does not know."""
    usable = {name: value for name, value in options.items() if name not in _UNKNOWN}
    if isinstance(flags := usable.get("fastmath"), tuple):  # a set has no order, which a digest needs
        usable["fastmath"] = set(flags)
    return usable


def _drop_unknown_options() -> bool:
    """Leave out the undocumented options that this version of numba does not know; return whether there are any."""
    import numba

    found = set()
    for name in UNDOCUMENTED - _UNKNOWN:
        try:
            numba.njit("void()", **{name: False})(_nothing)
        except KeyError:
            found.add(name)
    for kernel in _CALLEES.values():
        for name in found:
            kernel.targetoptions.pop(name, None)  # type: ignore[attr-defined]
    _UNKNOWN.update(found)
    return bool(found)


def _nothing() -> None:
    pass


# ------------------------------------------------------------------------------------------------------------- clock


class _Clock(threading.local):
    """Compile-time clock of each thread: seconds spent so far, and the depth of contexts that are counted."""

    seconds = 0.0
    depth = 0


_CLOCK = _Clock()


def compile_seconds() -> float:
    """Return the seconds that this thread has spent compiling so far, or waiting for another thread to compile.

    The difference of two readings is the time spent in between.
    """
    return _CLOCK.seconds


class Stopwatch:
    """A stopwatch for the parts of a run that measures compile time separately."""

    def __init__(self) -> None:
        self.began = self._lap_began = time.perf_counter()
        self._compiled_before = self._lap_compiled = compile_seconds()

    def lap(self) -> float:
        """Return the seconds since the last call that were not spent compiling."""
        now, compiled = time.perf_counter(), compile_seconds()
        seconds = (now - self._lap_began) - (compiled - self._lap_compiled)
        self._lap_began, self._lap_compiled = now, compiled
        return max(seconds, 0.0)

    def compiled(self) -> float:
        """Return the seconds spent compiling since the beginning."""
        return compile_seconds() - self._compiled_before

    def total(self) -> float:
        """Return the seconds since the beginning, compile time included."""
        return time.perf_counter() - self.began


@contextmanager
def announced() -> Iterator[None]:
    """Call `NOTICES` as for a compilation: this context compiles, or waits for another process that does."""
    for notice in NOTICES:
        notice(True)
    try:
        yield
    finally:
        for notice in NOTICES:
            notice(False)


@contextmanager
def compiler() -> Iterator[None]:
    """Hold the lock inside this context; the time, including the wait for the lock, counts as compile time.

    Ctrl-C is told at its end: LLVM calls Python back and loses its errors.
    """
    beat()
    began = time.perf_counter()
    _CLOCK.depth += 1
    try:
        with LOCK, interrupted_afterwards():
            yield
    finally:
        _CLOCK.depth -= 1
        if _CLOCK.depth == 0:
            _CLOCK.seconds += time.perf_counter() - began
