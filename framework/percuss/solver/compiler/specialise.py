"""Bind kernels into templates, compile them once, and keep the machine code in the user's cache folder.

A template is copied with the kernels as its globals, under a name that holds a hash of everything its code can
reach: its own bytecode and constants, helpers, module constants, closures, and the versions of Python, numba, NumPy
and percuss (`percuss.solver.compiler.fingerprint`). So an edited kernel, helper or constant never meets the machine
code of its predecessor. What cannot be hashed is compiled anew by every process that needs it.
"""

from __future__ import annotations

import functools
import sys
import types
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

import percuss
from percuss.compiling import compiler, listen
from percuss.methods import slots as slot_functions
from percuss.solver import compiled
from percuss.solver.compiler.fingerprint import (
    Fingerprint,
    contents,
    is_foreign,
    is_overloaded,
    named_in,
    plain_function,
)

Kernel = Callable[..., Any]

_COMPILED: dict[tuple[str, bool], Kernel] = {}  # one process compiles or loads a kernel once

# these modules hold the loop; nothing in them allocates
OWN_MODULES = (compiled.__name__, slot_functions.__name__)  # of the loop itself, in which no kernel of a plug-in lies


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
    about
        What else the machine code depends on: how the tuples it is handed are laid out.
    """

    def __init__(
        self,
        slots: Mapping[Kernel, Kernel] | None = None,
        *,
        jit: bool = True,
        counting: bool = False,
        about: str = "",
    ) -> None:
        self.slots = dict(slots or {})
        self.jit = jit
        self.counting = counting
        self.about = about
        self.checked = False  # whether indices in kernels of plug-ins are held against the size of their arrays
        self.tags: dict[int, str] = {}
        self._untold: set[str] = set()  # tags of what reaches something that has no hash
        self._slotted: set[str] = set()  # tags of what reaches a slot, or is a plug-in's
        self._bound: dict[int, Kernel] = {}
        self._open: set[int] = set()
        self._modules: set[int] = set()  # being copied
        self._keep: list[object] = []  # ids are only unique among living objects

    def with_slots(self, slots: Mapping[Kernel, Kernel], about: str = "") -> Specialiser:
        """Return a specialiser that binds `slots` on top of these; kernels already bound stay usable."""
        other = Specialiser({**self.slots, **slots}, jit=self.jit, counting=self.counting, about=about)
        other.tags, other._untold, other._keep = self.tags, self._untold, self._keep
        other._slotted = self._slotted
        other.checked = self.checked
        return other

    def bind(self, function: Kernel, *, entry: bool = False, reduction: bool = False) -> Kernel:
        """Return `function` with its slots and helpers bound, compiled if this specialiser compiles.

        Parameters
        ----------
        function
            Template or kernel.
        entry
            Whether it is called from Python. What is not has no code that takes Python objects apart, which is half of
            what compiling costs; called from Python all the same, it would end the process.
        reduction
            Whether it adds up terms whose order does not matter.
        """
        with compiler():
            return self._bind(function, entry=entry, reduction=reduction)

    def _bind(self, function: Kernel, *, entry: bool, reduction: bool) -> Kernel:
        if id(function) in self.tags:
            return function
        done = self._bound.get(id(function))
        if done is not None:
            return done
        source = plain_function(function)
        if source is None:
            raise TypeError(f"{function!r} is not a Python function")
        if id(function) in self._open:
            return function  # it calls itself: that stays Python, or as its author compiled it
        self._open.add(id(function))
        names = named_in(source.__code__)
        bound = {}
        for name in sorted(names & set(source.__globals__)):
            replacement = self._replacement(source.__globals__[name], names)
            if replacement is not None:
                bound[name] = replacement
        closure = tuple(
            types.CellType(self._replacement(contents(cell), names) or contents(cell))
            for cell in source.__closure__ or ()
        )
        options = _options(function, counting=self.counting, entry=entry, reduction=reduction)
        if self.checked and not _is_own(source):
            options.setdefault("boundscheck", True)
        tag = self._tag(source, names, bound, closure, options)
        copy = _copy(source, bound, closure, tag)
        out: Kernel = copy
        if self.jit:
            out = self._compiled(copy, options, tag, entry)
        self._open.discard(id(function))
        self._bound[id(function)] = out
        self.tags[id(out)] = tag
        self._keep += [function, out]
        return out

    def _compiled(self, copy: types.FunctionType, options: dict[str, Any], tag: str, entry: bool) -> Kernel:
        out = _COMPILED.get((tag, entry)) or _compile(copy, options, cache=tag not in self._untold)
        _COMPILED[tag, entry] = out
        return out

    def _replacement(self, value: Any, names: set[str]) -> Any:
        """Return what takes the place of a global in bound code, or None: slots, helpers, modules of helpers."""
        try:
            slot = self.slots.get(value)
        except TypeError:  # not hashable: a constant
            return None
        if slot is not None:
            return self.bind(slot, reduction=getattr(value, "reduction", False))
        if isinstance(value, types.ModuleType):
            return self._module(value, names)
        if plain_function(value) is None or (self.jit and is_overloaded(value)):
            return None
        return self.bind(value)

    def _module(self, module: types.ModuleType, names: set[str]) -> types.ModuleType | None:
        """Return a copy of a module with those of its functions bound that are named, None where none is."""
        if is_foreign(module.__name__) or id(module) in self._modules:
            return None
        self._modules.add(id(module))  # modules may import each other
        bound = {}
        for name in sorted(names):
            replacement = self._replacement(getattr(module, name, None), names)
            if replacement is not None:
                bound[name] = replacement
        self._modules.discard(id(module))
        if not bound:
            return None
        copy = types.ModuleType(module.__name__)
        vars(copy).update({**vars(module), **bound})
        print_ = Fingerprint(f"module {module.__name__};")
        named = {name: getattr(module, name) for name in names if hasattr(module, name)}
        self.tags[id(copy)] = self._finish(
            print_, names, [(name, bound.get(name), named[name]) for name in sorted(named)]
        )
        self._keep.append(copy)
        return copy

    def _finish(self, print_: Fingerprint, names: set[str], parts: Sequence[tuple[str, Any, Any]]) -> str:
        """Return the tag of code that reads `parts`: name, what takes its place in bound code, and what it was."""
        whole = True
        for name, replacement, given in parts:
            print_.text(name)
            if id(replacement) in self.tags:
                print_.text(self.tags[id(replacement)])
                whole = whole and self.tags[id(replacement)] not in self._untold
            else:
                print_.value(given, names)
        if not (whole and print_.whole):
            self._untold.add(print_.tag)
        return print_.tag

    def _tag(
        self,
        source: types.FunctionType,
        names: set[str],
        bound: Mapping[str, Any],
        closure: tuple[types.CellType, ...],
        options: Mapping[str, Any],
    ) -> str:
        reaches_slot = not _is_own(source) or any(
            value in self.slots or self.tags.get(id(bound.get(name))) in self._slotted
            for name, value in source.__globals__.items()
            if name in bound
        )
        # the module too: machine code on disk imports that of its kernels, and a file has a new one after an edit
        about = f"{_versions()};{source.__module__};{sorted(options.items(), key=repr)};{self.jit};"
        if reaches_slot:  # only slots read the tuples of plug-ins
            about += self.about
        print_ = Fingerprint(about)
        print_.code(source.__code__)
        print_.defaults(source)
        parts = [(name, bound.get(name), source.__globals__[name]) for name in sorted(names & set(source.__globals__))]
        cells = zip(closure, source.__closure__ or (), strict=True)
        parts += [("", cell.cell_contents, contents(given)) for cell, given in cells]
        tag = self._finish(print_, names, parts)
        if reaches_slot:
            self._slotted.add(tag)
        return tag


@functools.cache
def _versions() -> str:
    from importlib.metadata import version

    return f"{sys.version};{version('numba')};{np.__version__};{percuss.__version__}"


def jit_disabled() -> bool:
    """Return whether numba is told not to compile (``NUMBA_DISABLE_JIT=1``)."""
    import numba

    return bool(numba.config.DISABLE_JIT)


def compile_error() -> tuple[type[Exception], ...]:
    """Return the errors numba raises for what it cannot compile."""
    from numba.core import errors

    # the second is no NumbaError, the third is what several of its own passes raise
    return errors.NumbaError, errors.UnsupportedBytecodeError, NotImplementedError


def _options(function: Any, *, counting: bool, entry: bool, reduction: bool) -> dict[str, Any]:
    """Return how a function is compiled: as its author had it compiled, less the author's cache, or as the loop is."""
    if not isinstance(function, types.FunctionType):
        own = {key: value for key, value in function.targetoptions.items() if key != "nopython"}
        if function.nopython_signatures and not function._can_compile:
            own["signature_or_function"] = tuple(function.nopython_signatures)
        return own
    options: dict[str, Any] = {"error_model": "numpy", "nogil": True}
    # a call that is not inlined passes every array as a handful of numbers; whole stages are worth a call: copied into
    # one another they would take the compiler twice as long
    if not entry and not getattr(function, "called", False):
        options["forceinline"] = True
    if reduction or getattr(function, "reduction", False):
        options["fastmath"] = ("nsz", "reassoc")
    options["no_cfunc_wrapper"] = True
    if not entry:
        options["no_cpython_wrapper"] = True
    if _counting_can_be_left_out():
        # said always: else the caller's is taken
        options["_nrt"] = counting and not _is_own(function)
    return options


def _is_own(function: types.FunctionType) -> bool:
    """Return whether a function is a part of the loop, and not of a plug-in."""
    return function.__module__.startswith(OWN_MODULES)


def _copy(
    source: types.FunctionType, bound: Mapping[str, Any], closure: tuple[types.CellType, ...], tag: str
) -> types.FunctionType:
    """Return a function with other globals and cells, called by its tag."""
    name = f"{source.__name__}_{tag}"
    copy = types.FunctionType(
        source.__code__, {**source.__globals__, **bound}, name, source.__defaults__, closure or None
    )
    copy.__module__, copy.__kwdefaults__ = source.__module__, source.__kwdefaults__
    copy.__qualname__, copy.__doc__ = name, source.__doc__
    return copy


def _compile(function: types.FunctionType, options: Mapping[str, Any], *, cache: bool) -> Kernel:
    import numba

    listen()  # the first call compiles
    options = dict(options)
    if isinstance(options.get("fastmath"), tuple):
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
    from numba.core.cpu import CPUTargetOptions

    return hasattr(CPUTargetOptions, "_nrt")
