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
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias, TypeVar, cast

import numpy as np

from percuss.cache import cache_folder
from percuss.digest import content_digest, is_of_the_loop, loop_digest, source_digest, surroundings
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


def compiled_with(**options: object) -> Callable[[AnyKernel], AnyKernel]:
    """Return a mark that gives a function options of the compiler, or a slot those of the kernel in it."""

    def mark(function: AnyKernel) -> AnyKernel:
        function.compiler_options = options  # type: ignore[attr-defined]
        return function

    return mark


# The function is compiled once and called; copied into its callers it would compile for too long.
called = compiled_with(forceinline=False)
# Products are added without being rounded first, if the processor can do so. Each sum of the function may contain one
# product only, so that the compiler has no choice: it computes the same bits in every copy, whether for one number or
# for several at once.
fused = compiled_with(fastmath={"contract": True})
# The function is a sum, whose terms may be added in any order, which is faster.
reduction = compiled_with(fastmath={"nsz": True, "reassoc": True})
# The kernel in this slot, with all that it calls, merges with its caller before the compiler optimises anything. The
# compiler then knows how often the loops of the kernel run, where the caller knows it.
merged = compiled_with(inline="always")
# The kernel in this slot is not: it would compile for too long, and knows no such loops.
apart = compiled_with(inline="never", forceinline=True)


def shared(function: AnyKernel) -> AnyKernel:
    """Return a copy of a function whose loop over `each` is shared out among threads in compiled code."""
    copy = types.FunctionType(function.__code__, function.__globals__, function.__name__)
    return cast("AnyKernel", compiled_with(forceinline=False, parallel=True)(copy))


def each(count: int) -> Any:
    """Return the numbers below `count`; a loop over them may be shared out among threads (slot in compiled code)."""
    return range(count)


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
        Option by which functions are copied into their callers; empty if they are not.
    checked
        Whether kernels of plug-ins check array indices against the size of the array.
    """

    slots: Mapping[Kernel, Any]
    jit: bool = True
    allocates: bool = False
    inline: Data = field(default_factory=lambda: {"forceinline": True})
    checked: bool = False
    _done: dict[object, Bound | None] = field(default_factory=dict)

    def bind(self, function: Kernel, options: Data = MappingProxyType({})) -> Bound:
        """Return a copy of a function with its slots filled, and with bound copies of all functions that it calls.

        The options of the compiler, beside those of its mark, are percuss's own, also of a function with
        ``@numba.njit``.
        """
        source, key = plain_function(function), (function, *sorted(self.inline.items()))
        found = self._done.get(key)
        if found is not None:
            return found
        if source is None or key in self._done:  # an instruction for the compiler, or a recursive call
            return Bound(function, getattr(function, "__name__", ""))
        self._done[key] = None
        names = _names(source.__code__)
        read = {name: self._part(source.__globals__[name], names) for name in sorted(names & source.__globals__.keys())}
        closure = [self._part(cell.cell_contents, names) for cell in source.__closure__ or ()]
        copy = types.FunctionType(
            source.__code__,
            source.__globals__ | {name: part.value for name, part in read.items()},
            source.__name__,
            source.__defaults__,
            tuple(types.CellType(part.value) for part in closure),
        )
        copy.__kwdefaults__ = source.__kwdefaults__
        bound = Bound(copy)
        if self.jit:
            options = self._options(source, {**getattr(function, "compiler_options", {}), **options})
            digest = _digest(_about(source), sorted(options.items()), _digests(read), [part.digest for part in closure])
            copy.__name__ = copy.__qualname__ = f"{source.__name__}_{digest}"
            bound = Bound(copy, digest, options)
        self._done[key] = bound
        return bound

    def reached(self, function: Kernel) -> bool:
        """Return whether the code that was bound reaches a function."""
        return any(isinstance(key, tuple) and key[0] is function for key in self._done)

    def callee(self, function: Kernel, options: Data = MappingProxyType({})) -> Bound:
        """Return a function as `bind` does, for compiled callers compiled alone; Python would crash if it called it."""
        bound = self.bind(function, options)
        if not self.jit or not isinstance(bound.value, types.FunctionType):
            return bound
        import numba

        key = bound.digest, bound.value.__code__
        if key not in _CALLEES:
            usable = {name: value for name, value in bound.options.items() if name not in _UNKNOWN}
            wrappers = {name: True for name in ("no_cpython_wrapper", "no_cfunc_wrapper") if name not in _UNKNOWN}
            _CALLEES[key] = numba.njit(**usable, **wrappers)(bound.value)
        return bound._replace(value=_CALLEES[key])

    def _part(self, value: Any, names: frozenset[str]) -> Bound:
        """Return what stands in for a value that a function reads: a bound function, a copy of a module, or itself."""
        if isinstance(value, types.ModuleType):
            return self._module(value, names)
        slot = self.slots.get(value) if isinstance(value, types.FunctionType) else None
        if isinstance(slot, Bound):
            return slot
        if slot is None and plain_function(value) is None:
            return Bound(value, _text(value))
        maker, kernel, options = self, slot or value, getattr(value, "compiler_options", {})
        if "inline" in options:  # which all that the kernel calls is given too
            maker, options = replace(maker, inline=self.inline and options), {}
        if isinstance(slot, Filled):
            maker, kernel = replace(maker, slots={**self.slots, **dict(slot.slots)}, _done={}), slot.kernel
        return maker.callee(kernel, options)

    def _module(self, module: types.ModuleType, names: frozenset[str]) -> Bound:
        """Return a copy of a module in which its functions among `names` are bound; itself if numba knows it."""
        if module.__name__.split(".")[0] in FOREIGN or module in self._done:
            return Bound(module)
        self._done[module] = None  # prevents endless recursion where modules import each other
        read = {name: self._part(getattr(module, name), names) for name in sorted(names) if hasattr(module, name)}
        del self._done[module]
        copy = types.ModuleType(module.__name__)
        vars(copy).update(vars(module) | {name: part.value for name, part in read.items()})
        return Bound(copy, _digest(_digests(read)))

    def _options(self, source: types.FunctionType, marked: Data) -> Entries:
        """Return the options of the compiler.

        Numba gives a function the options of the first caller that it compiles, where the function has none of its own:
        numbers would hang on what a process has compiled before.
        """
        of_plugin = not is_of_the_loop(source.__code__.co_filename)
        options: Entries = {"error_model": "numpy", "nogil": True, "fastmath": False, "forceinline": False}
        options |= {"_nrt": self.allocates and of_plugin, **self.inline, **marked}
        return options | ({"boundscheck": True} if self.checked and of_plugin else {})


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


def _digests(parts: Mapping[str, Bound]) -> list[tuple[str, str]]:
    return [(name, part.digest) for name, part in parts.items()]


def _digest(*about: object) -> str:
    return content_digest(repr(about).encode())[:16]


def _about(function: types.FunctionType) -> tuple[object, ...]:
    """Return on what the machine code of a function depends beside what it reads: its sources and what compiles it.

    The code is there for functions that are in no file, as those made by ``exec``.
    """
    sources = source_digest(function.__code__.co_filename), loop_digest(), repr(surroundings())
    defaults = _text(function.__defaults__ or ()), _text(tuple((function.__kwdefaults__ or {}).items()))
    return *sources, function.__module__, function.__qualname__, *defaults, _code(function.__code__)


def _code(code: types.CodeType) -> tuple[object, ...]:
    """Return what a function does, without the flags of its code, which numba changes under a profiler."""
    constants = [
        _code(one) if isinstance(one, types.CodeType) else sorted(map(repr, one)) if isinstance(one, frozenset) else one
        for one in code.co_consts
    ]
    return code.co_firstlineno, code.co_code, code.co_names, code.co_varnames, constants


# --------------------------------------------------------------------------------------------------------- compiling

# What this process has compiled or loaded, by digest and code, and of entries by what they are and their types.
_CALLEES: dict[tuple[str, types.CodeType], Kernel] = {}
_ENTRIES: dict[tuple[Any, ...], Any] = {}


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
    key = bound.digest, bound.value.__code__, decorate, signature
    with LOCK:
        if key not in _ENTRIES:
            told = () if not NOTICES or _stored(bound.value.__name__) else tuple(NOTICES)
            with compiler(), ExitStack() as end:
                for notice in told:
                    notice(True)
                    end.callback(notice, False)
                _ENTRIES[key] = _compiled(bound, decorate, signature)
        return _ENTRIES[key]


def _compiled(bound: Bound, decorate: Callable[..., Any], signature: Any) -> Any:
    """Compile an entry, without options that this version of numba does not know, and store it where that works."""
    import numba

    before, folder = numba.config.CACHE_DIR, cache_folder()
    stores = folder is not None and os.access(folder, os.W_OK)
    while True:
        left_out = {*_UNKNOWN, "forceinline"}
        options = {name: value for name, value in bound.options.items() if name not in left_out}
        try:
            numba.config.CACHE_DIR = str(folder) if stores else before  # numba reads it in the decorator
            return decorate(signature, cache=stores, **options)(bound.value)
        except Exception as error:
            if isinstance(error, KeyError) and _leave_out_unknown(error):
                continue
            if not stores or isinstance(error, compile_error()):
                raise
            stores = False  # no source, a full disk, damaged files: it is compiled without them
            for file in _stored(bound.value.__name__):
                file.unlink(missing_ok=True)
        finally:
            numba.config.CACHE_DIR = before


def _leave_out_unknown(error: KeyError) -> bool:
    """Leave out the undocumented options that numba refuses with this error; return whether there are any."""
    left = UNDOCUMENTED - _UNKNOWN
    unknown = {name for name in left if name in str(error).partition("Known options")[0]} or left
    _UNKNOWN.update(unknown)
    for kernel in _CALLEES.values():
        for name in unknown:
            kernel.targetoptions.pop(name, None)  # type: ignore[attr-defined]
    return bool(unknown)


def _stored(name: str) -> list[Path]:
    """Return the files that numba has written for a function."""
    folder = cache_folder()
    return [] if folder is None else list(folder.glob(f"*/*.{name}-*"))


_TYPES: dict[object, Any] = {}


def type_of(data: object) -> Any:
    """Return the numba type of data; numba is asked once for each structure, as it takes long for records.

    Raises
    ------
    ValueError
        If there is none, as for an array of objects.
    """
    import numba

    structure = structure_of(data)
    if structure not in _TYPES:
        _TYPES[structure] = numba.typeof(data)
    return _TYPES[structure]


def structure_of(data: object) -> object:
    """Return what the numba type of arrays, numbers and tuples of them depends on; it is found again far faster."""
    import numba

    if isinstance(data, tuple):
        return type(data), *map(structure_of, data)
    if isinstance(data, np.ndarray):
        return type(data), data.dtype, data.ndim, data.flags.num
    return numba.typeof(data)


@dataclass(frozen=True)
class Compiled:
    """A bound function, compiled for the types of its arguments when it is first called with them."""

    bound: Bound
    _known: dict[object, Kernel] = field(default_factory=dict, compare=False)

    def of(self, arguments: tuple[object, ...]) -> Kernel:
        """Return the function compiled for the types of these arguments."""
        import numba

        structure = structure_of(arguments)
        if structure not in self._known:
            self._known[structure] = cast("Kernel", entry(self.bound, numba.njit, tuple(map(type_of, arguments))))
        return self._known[structure]

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
        return cast("AnyKernel", Compiled(Binder(slots, allocates=True, inline={}).bind(function)))


def compile_error() -> tuple[type[Exception], ...]:
    """Return the types of error that numba raises for code that it cannot compile."""
    from numba import errors

    # The second is no subclass of NumbaError, and several of numba's passes raise the third.
    return errors.NumbaError, errors.UnsupportedBytecodeError, NotImplementedError


def jit_disabled() -> bool:
    """Return whether numba is configured not to compile (``NUMBA_DISABLE_JIT=1``)."""
    import numba

    return bool(numba.config.DISABLE_JIT)


# ------------------------------------------------------------------------------------------------------------- clock

_COMPILING: ContextVar[float] = ContextVar("_COMPILING", default=0.0)


def compile_seconds() -> float:
    """Return the seconds that this thread has spent compiling so far, or waiting for another thread to compile.

    The difference of two readings is the time spent in between.
    """
    return _COMPILING.get()


class Stopwatch:
    """A stopwatch for the parts of a run that measures compile time separately."""

    def __init__(self) -> None:
        self._began, self._compiled_before = self._lap = time.perf_counter(), compile_seconds()

    def lap(self) -> float:
        """Return the seconds since the last call that were not spent compiling."""
        (began, compiled), self._lap = self._lap, (time.perf_counter(), compile_seconds())
        return self._lap[0] - began - (self._lap[1] - compiled)

    def compiled(self) -> float:
        """Return the seconds spent compiling since the beginning."""
        return compile_seconds() - self._compiled_before

    def total(self) -> float:
        """Return the seconds since the beginning, compile time included."""
        return time.perf_counter() - self._began


@contextmanager
def compiler() -> Iterator[None]:
    """Hold the lock inside this context; the time, including the wait for the lock, counts as compile time.

    Ctrl-C is told at its end: LLVM calls Python back and loses its errors.
    """
    began, before = time.perf_counter(), _COMPILING.get()
    try:
        with LOCK, interrupted_afterwards():
            yield
    finally:
        _COMPILING.set(before + time.perf_counter() - began)
