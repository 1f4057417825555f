"""Bind kernels into templates, compile them, and store the machine code in the user's cache folder.

A template is a function of the loop that calls slots, functions without a body. It is copied with kernels in the place
of the slots; the name of the copy contains a tag, a digest of everything its code can reach: the function itself with
its source (`percuss.methods.source_digest`), the tags of its helpers, the values that it reads
(`percuss.compiler.fingerprint`), and the versions of Python, numba, NumPy and percuss. Machine code is therefore
never used for an edited kernel, helper or constant. Code without a source, and code that reads objects without
identifiable content, is compiled again by every process that needs it.
"""

from __future__ import annotations

import dataclasses
import functools
import sys
import types
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

from percuss.compiler.compile_function import compile_function
from percuss.compiler.fingerprint import Fingerprint, contents, is_foreign, named_in, plain_function, refresh_overloads
from percuss.compiler.machine_code import jit_disabled
from percuss.compiler.readings import Readings
from percuss.compiling import Kernel, compiler, numba_inside
from percuss.digest import content_digest
from percuss.jsonable import Data, Entries
from percuss.methods import slots as slot_functions
from percuss.methods.source_digest import function_digest
from percuss.version import __version__, installed_version

AnyKernel = TypeVar("AnyKernel", bound=Kernel)
_Part = tuple[str, Any, Any]  # what code reads: its name, its replacement in bound code, and the original

_COMPILED: dict[str, Kernel] = {}  # kernels that this process has compiled or loaded, by tag

CALLS = "percuss.step.calls"
# Modules of the loop itself: they contain no kernel of a plug-in, and no function in them allocates.
ROOMS_OF_THE_LOOP = ("mesh", "contact", "step")
OWN_MODULES = (*(f"percuss.{room}." for room in ROOMS_OF_THE_LOOP), slot_functions.__name__)


class Filled(NamedTuple):
    """What fills a slot where it has slots of its own: a template and, in pairs, what fills them there."""

    kernel: Kernel
    slots: tuple[tuple[Kernel, Any], ...]


@dataclass(eq=False)
class Specialiser:
    """Binds and compiles the kernels of one run, or binds them as plain Python.

    Parameters
    ----------
    slots
        Map from each slot to its kernel, plain or already bound.
    jit
        Whether to compile.
    counting
        Whether kernels of plug-ins may allocate arrays, which needs reference counts.
    about
        A text for everything else the machine code depends on: the layout of the tuples that the kernels receive.
    inline
        Whether functions are copied into their callers. A call that is not inlined passes every array as several
        numbers; code that is inlined takes longer to compile.
    digested_alone
        Whether to bind and digest as for the compiler, without handing anything to it.
    checked
        Whether kernels of plug-ins check array indices against the size of the array.
    tags, readings
        The tag of each kernel, by its id, and what was read. Those that `with_slots` makes have them in common.
    """

    slots: Mapping[Kernel, Any] = field(default_factory=dict)
    _: KW_ONLY
    jit: bool = True
    counting: bool = False
    about: str = ""
    inline: bool = True
    digested_alone: bool = False
    checked: bool = False
    tags: dict[int, str] = field(default_factory=dict)
    readings: Readings = field(default_factory=Readings)
    _unkept: set[str] = field(default_factory=set)  # tags of code without a source, or that reaches one without digest
    _slotted: set[str] = field(default_factory=set)  # tags of code that reaches a slot or belongs to a plug-in
    _keep: list[object] = field(default_factory=list)  # alive, as ids are only unique among living objects
    _bound: dict[int, Kernel] = field(default_factory=dict, init=False)
    _in_progress: set[int] = field(default_factory=set, init=False)
    _modules: set[int] = field(default_factory=set, init=False)  # ids of the modules that are being copied

    def with_slots(self, slots: Mapping[Kernel, Kernel], about: str = "") -> Specialiser:
        """Return a specialiser with `slots` added to those of this one; kernels already bound remain usable."""
        return dataclasses.replace(self, slots={**self.slots, **slots}, about=about)

    def tag_of(self, kernel: Kernel) -> str:
        """Return the tag of a function that `bind` has returned; empty if its machine code may not be stored."""
        tag = self.tags[id(kernel)]
        return "" if tag in self._unkept else tag

    def reached(self, kernel: Kernel) -> bool:
        """Return whether the code that this specialiser has bound reaches `kernel`."""
        return id(kernel) in self._bound

    def bind(self, function: Kernel, *, entry: bool = False, linked: bool = False) -> Kernel:
        """Return `function` with its slots and helpers bound, and compiled if this specialiser compiles.

        Parameters
        ----------
        function
            Template or kernel.
        entry
            Whether Python calls it. A call from Python of any other function would crash the process.
        linked
            Whether compiled functions call it by its address (`percuss.step.linking`).
        """
        with compiler():
            if self.jit:
                refresh_overloads()
            return self._bind(function, entry=entry, linked=linked)

    def _bind(self, function: Kernel, *, entry: bool = False, linked: bool = False, reduction: bool = False) -> Kernel:
        """Bind a function as `bind` does; the terms of a `reduction` may be added in any order."""
        if id(function) in self.tags:
            return function
        definition = getattr(function, "__wrapped__", None)
        if definition is not None and function.__module__ == CALLS:  # an instruction for the compiler, not a function
            self.tags[id(function)] = function_digest(definition)[0]
            return function
        if id(function) in self._bound:
            return self._bound[id(function)]
        source = plain_function(function)
        if source is None:
            raise TypeError(f"{function!r} is not a Python function")
        if id(function) in self._in_progress:
            return function  # a recursive call keeps the original function, plain or compiled by its author
        self._in_progress.add(id(function))
        names = named_in(source.__code__)
        variables = {name: source.__globals__[name] for name in sorted(names & set(source.__globals__))}
        self.readings.function(source, variables)
        bound = self._replacements(variables, names)
        cells = [contents(cell) for cell in source.__closure__ or ()]
        closure = [self._replacement(value, names) or value for value in cells]
        parts = [(name, bound.get(name), value) for name, value in variables.items()]
        parts += [("", replacement, value) for replacement, value in zip(closure, cells, strict=True)]
        entry = entry or linked
        called = entry or getattr(function, "called", False)
        options = self._options(function, called=called, reduction=reduction)
        if self.checked and not _is_part_of_loop(source):
            options.setdefault("boundscheck", True)
        # Entry or callee is part of the tag: what is stored of a callee cannot be called from Python.
        tag = self._tag(source, names, parts, {**options, "entry": entry, "linked": linked})
        if linked:
            options["no_cpython_wrapper"] = True
        plain = _copy(source, bound, closure, tag)
        kernel = self._compiled(plain, options, tag, entry) if self.jit and not self.digested_alone else plain
        self._in_progress.discard(id(function))
        self._bound[id(function)] = kernel
        self.tags[id(kernel)] = tag
        self._keep += [function, kernel]
        return kernel

    def _compiled(self, function: types.FunctionType, options: Entries, tag: str, entry: bool) -> Kernel:
        if tag not in _COMPILED:
            if isinstance(options.get("fastmath"), tuple):
                options["fastmath"] = set(options["fastmath"])
            # The loop allocates nothing, and on small models the counts of references to array slices, two locked
            # additions for each slice, cost half of the run time. Kernels of plug-ins do without them too, unless one
            # of them allocates: then all of them count references.
            inside = numba_inside()
            if inside is None or not inside.reference_counts_can_be_left_out():
                options.pop("_nrt", None)
            key = "" if tag in self._unkept else tag
            _COMPILED[tag] = compile_function(function, entry=entry, key=key, **options)
        return _COMPILED[tag]

    def _replacements(self, values: Data, names: frozenset[str]) -> Entries:
        """Return the replacements among variables or attributes, by name."""
        found = ((name, self._replacement(value, names)) for name, value in values.items())
        return {name: replacement for name, replacement in found if replacement is not None}

    def _replacement(self, value: Any, names: frozenset[str]) -> Any:
        """Return the replacement for a global variable of a kernel, or None to keep the original.

        The replacement is the bound kernel for a slot, a bound copy for a helper function, and for a module a copy
        with bound helpers.
        """
        try:
            slot = self.slots.get(value)
        except TypeError:  # a constant that is not hashable is no slot
            return None
        if slot is not None:
            filled = slot if isinstance(slot, Filled) else Filled(slot, ())
            maker = self.with_slots(dict(filled.slots), self.about) if filled.slots else self
            return maker._bind(filled.kernel, reduction=getattr(value, "reduction", False))
        if isinstance(value, types.ModuleType):
            return self._module(value, names)
        if plain_function(value) is None:
            return None
        if self.jit and self.readings.overload(value):
            return None
        return self._bind(value)

    def _module(self, module: types.ModuleType, names: frozenset[str]) -> types.ModuleType | None:
        """Return a copy of a module in which its functions among `names` are bound, None if there is none to bind."""
        if is_foreign(module.__name__) or id(module) in self._modules:
            return None
        self._modules.add(id(module))  # prevents endless recursion where modules import each other
        for name in names:
            self.readings.attribute(module, name)
        originals = {name: getattr(module, name) for name in sorted(names) if hasattr(module, name)}
        bound = self._replacements(originals, names)
        self._modules.discard(id(module))
        if not bound:
            return None
        changed = types.ModuleType(module.__name__)
        vars(changed).update({**vars(module), **bound})
        fingerprint = Fingerprint(f"module {module.__name__};")
        parts = [(name, bound.get(name), original) for name, original in originals.items()]
        self.tags[id(changed)] = self._finish(fingerprint, names, parts)
        self._keep.append(changed)
        return changed

    def _finish(self, fingerprint: Fingerprint, names: frozenset[str], parts: Sequence[_Part]) -> str:
        """Return the tag of code that reads `parts`."""
        for name, replacement, original in parts:
            fingerprint.text(name)
            if id(replacement) in self.tags:
                fingerprint.text(self.tags[id(replacement)])
                fingerprint.whole = fingerprint.whole and self.tags[id(replacement)] not in self._unkept
            else:
                fingerprint.value(original, names)
                self.readings.value(original, names)
        if not fingerprint.whole:
            self._unkept.add(fingerprint.tag)
        return fingerprint.tag

    def _options(self, function: Any, *, called: bool, reduction: bool) -> Entries:
        """Return the compiler options: for a jitted function those of its author, without the cache."""
        if not isinstance(function, types.FunctionType):
            author_options = {key: value for key, value in function.targetoptions.items() if key != "nopython"}
            inside = numba_inside()
            if function.nopython_signatures and inside is not None and not inside.compiles_for_any_types(function):
                author_options["signature_or_function"] = tuple(function.nopython_signatures)
            return author_options
        options: Entries = {"error_model": "numpy", "nogil": True}
        # Copies of whole stages would double the compile time. The option of the calling function applies where none is
        # set.
        if self.inline and not called:
            options["forceinline"] = True
        if reduction or getattr(function, "reduction", False):
            options["fastmath"] = ("nsz", "reassoc")
        elif getattr(function, "fused", False):
            options["fastmath"] = ("contract",)
        # Always set, because otherwise the option of the calling function applies.
        options["_nrt"] = self.counting and not _is_part_of_loop(function)
        return options

    def _tag(self, source: types.FunctionType, names: frozenset[str], parts: Sequence[_Part], options: Data) -> str:
        reaches_slot = not _is_part_of_loop(source) or any(
            original in self.slots or self.tags.get(id(replacement)) in self._slotted
            for name, replacement, original in parts
            if name and replacement is not None
        )
        # The module name is included because machine code on disk imports the modules of its kernels, and an edited
        # plug-in file becomes a module of another name.
        about = f"{_versions()};{source.__module__};{sorted(options.items(), key=repr)};{self.jit};"
        if reaches_slot:  # only functions behind slots read the tuples of plug-ins
            about += self.about
        digest, has_source = function_digest(source)
        fingerprint = Fingerprint(about + digest)
        fingerprint.whole = has_source
        fingerprint.value(source.__defaults__, frozenset())
        fingerprint.value(source.__kwdefaults__, frozenset())
        tag = self._finish(fingerprint, names, parts)
        if reaches_slot:
            self._slotted.add(tag)
        return tag


def compiled_function(function: AnyKernel) -> AnyKernel:
    """Return a function compiled together with all functions that it calls, or as it is where numba may not compile.

    The machine code is stored in the user's cache folder and is never used after an edit of any of these functions, or
    of a constant that they read.

    Parameters
    ----------
    function
        A function that numba can compile, of arrays, numbers and tuples of them.

    Returns
    -------
    callable
        The same function. It is compiled when it is first called.
    """
    if jit_disabled():
        return function
    return cast("AnyKernel", Specialiser(counting=True, inline=False).bind(function, entry=True))


@functools.cache
def _versions() -> str:
    # Machine code names the tuples of the loop and reads their fields by position.
    rooms = (Path(__file__).parents[1] / room for room in ROOMS_OF_THE_LOOP)
    files = sorted(file for room in rooms for file in room.rglob("*.py"))
    loop = content_digest(b"".join(file.read_bytes() for file in files))
    packages = ";".join(installed_version(name) for name in ("numba", "scipy", "numpy"))
    return f"{sys.version};{packages};{__version__};{loop}"


def compile_error() -> tuple[type[Exception], ...]:
    """Return the types of error that numba raises for code that it cannot compile."""
    from numba import errors

    # The second is no subclass of NumbaError, and several of numba's passes raise the third.
    return errors.NumbaError, errors.UnsupportedBytecodeError, NotImplementedError


def _is_part_of_loop(function: types.FunctionType) -> bool:
    """Return whether a function belongs to the loop, and not to a plug-in."""
    return function.__module__.startswith(OWN_MODULES)


def _copy(source: types.FunctionType, bound: Data, closure: Sequence[object], tag: str) -> types.FunctionType:
    """Return a copy of a function with other globals and closure cells, and with the tag in its name."""
    name = f"{source.__name__}_{tag}"
    cells = tuple(map(types.CellType, closure)) or None
    bound_copy = types.FunctionType(source.__code__, {**source.__globals__, **bound}, name, source.__defaults__, cells)
    bound_copy.__module__, bound_copy.__kwdefaults__ = source.__module__, source.__kwdefaults__
    bound_copy.__qualname__, bound_copy.__doc__ = name, source.__doc__
    return bound_copy
