"""All names that percuss takes from inside numba, which may change with each of its versions; no other file has any.

Each has a reason, and a fall-back for a version of numba that is built otherwise: `percuss.compiling.numba_inside` then
returns None instead of this module, functions are compiled by plain `numba.njit`, and every number stays the same.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm

# Makes the function object that numba keeps for each compiled function. Without: callees get machine code of their own.
from numba import _dynfunc

# The code of one function before and after it is optimised; callees stop before. Without: all are optimised alone.
from numba.core.codegen import JITCodeLibrary

# The passes of numba, of which one is replaced, and what they return. Without: the passes as they are.
from numba.core.compiler import CompilerBase, CompileResult, DefaultPassBuilder

# Held while numba's table of overloads is filled. Without: see `is_overloaded`.
from numba.core.compiler_lock import global_compiler_lock

# Has a pass counted among those of numba. Without: see `CompilerBase`.
from numba.core.compiler_machinery import register_pass

# Knows the option `_nrt`. Without: code of the loop counts references to its array slices, and is slower.
from numba.core.cpu import CPUTargetOptions

# Finds the globals of a callee, of which an entry has to know the place. Without: see `CompilerBase`.
from numba.core.environment import lookup_environment

# Tells when numba compiles. Without: the time that it takes counts as that of the march, and nothing announces it.
from numba.core.event import Listener as EventListener
from numba.core.event import register

# Knows the functions in whose place numba compiles other code. Without: see `is_overloaded`.
from numba.core.registry import cpu_target

# Pickles compiled functions. Without: nothing is stored on disk, and each process compiles anew.
from numba.core.serialize import dumps

# The pass that is replaced. Without: see `CompilerBase`.
from numba.core.typed_passes import NativeLowering

# The name under which an entry with declared types is stored. Without: nothing is stored.
from numba.core.typing import signature as typing_signature

TRIED = ("0.61", "0.68")  # the first and the last version of numba with which all tests have passed

# ------------------------------------------------------------------------------------- callees and entries

FREE_ORDER = {"fast", "reassoc"}  # options of numba's `fastmath` with which the terms of a sum are added in any order
ENVIRONMENT_PREFIX = "_ZN08NumbaEnv"  # first letters of the name of a variable that refers to a function's globals


class CalleeLibrary(JITCodeLibrary):  # type: ignore[misc]
    """The intermediate code of a callee, never turned into machine code."""

    has_free_order = False  # whether the terms of a sum may be added in any order

    def _optimize_final_module(self) -> None:
        """Leave the code as it is, because the entry is optimised with this code inside.

        A sum in free order is optimised alone, so that its order, and with it its last bit, is the same in all entries.
        """
        if self.has_free_order:
            super()._optimize_final_module()

    def _finalize_final_module(self) -> None:
        """Make the code ready for linking, and give it to no execution engine."""
        self._finalize_dynamic_globals()
        self._finalized = True

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        """Return what is stored on disk: the intermediate code, as there is no other."""
        return self.serialize_using_bitcode()  # type: ignore[no-any-return]

    @classmethod
    def restored(cls, codegen: Any, stored: tuple[str, str, bytes]) -> CalleeLibrary:
        """Return the library that `serialize_using_object_code` stored."""
        name, _, bitcode = stored
        library = cls(codegen, name)
        library._final_module = llvm.parse_bitcode(bitcode)
        library._finalize_final_module()
        return library


def _unreachable_from_python(library: CalleeLibrary, fndesc: Any, environment: Any) -> Any:
    """Return the function object that numba keeps for a callee: it refers to no machine code."""
    name = fndesc.qualname.split(".")[-1]
    return _dynfunc.make_function(fndesc.lookup_module(), name, "compiled callee", 0, environment, (library,))


@register_pass(mutates_CFG=True, analysis_only=False)
class CalleeLowering(NativeLowering):  # type: ignore[misc]
    """The translation of a typed callee into intermediate code."""

    _name = "callee_lowering"

    def run_pass(self, state: Any) -> bool:
        """Translate the function, and let other compiled functions find it."""
        state.library = CalleeLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.has_free_order = not state.flags.fastmath.flags.isdisjoint(FREE_ORDER)
        state.flags.no_compile = True
        super().run_pass(state)
        lowered = state["cr"]
        function = _unreachable_from_python(state.library, lowered.fndesc, lowered.env)
        state.targetctx.insert_user_function(function, lowered.fndesc, [state.library])
        state["cr"] = lowered._replace(cfunc=function)
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class EntryLowering(NativeLowering):  # type: ignore[misc]
    """The translation of a typed entry, with its callees inside, into machine code."""

    _name = "entry_lowering"

    def run_pass(self, state: Any) -> bool:
        """Translate the function, and tell its machine code where the globals of each callee are."""
        super().run_pass(state)
        for variable in state.library._final_module.global_variables:
            if variable.name.startswith(ENVIRONMENT_PREFIX):
                environment = lookup_environment(variable.name)
                if environment is not None:
                    state.targetctx.codegen().set_env(variable.name, environment)
        return True


class _Compiler(CompilerBase):  # type: ignore[misc]
    lowering: type[NativeLowering]

    def define_pipelines(self) -> list[Any]:
        """Return numba's own passes, with another translation instead of their last but one."""
        pipeline = DefaultPassBuilder.define_nopython_pipeline(self.state)
        pipeline.passes = [
            (self.lowering if each is NativeLowering else each, about) for each, about in pipeline.passes
        ]
        pipeline._finalized = False
        pipeline.finalize()
        return [pipeline]


class CalleeCompiler(_Compiler):
    """The compiler of callees."""

    lowering = CalleeLowering


class EntryCompiler(_Compiler):
    """The compiler of entries. Of several processes that need the same entry, one compiles it and the others load it.

    Attributes
    ----------
    cache
        The cache of the entry. Each entry has a compiler class of its own.
    """

    lowering = EntryLowering
    cache: Any

    def compile_extra(self, function: Any) -> Any:
        """Compile the function, or load it once another process has compiled it."""
        state = self.state
        key = state.args if state.return_type is None else typing_signature(state.return_type, *state.args)
        with self.cache.in_turn():
            compiled = self.cache.load_overload(key, state.targetctx)
            if compiled is None:
                compiled = super().compile_extra(function)
                self.cache.save_overload(key, compiled)
            else:
                state.targetctx.insert_user_function(compiled.entry_point, compiled.fndesc, [compiled.library])
            self.cache.stored = compiled  # the caller stores it once more
            return compiled


def restored_entry(target_context: Any, payload: tuple[Any, ...]) -> CompileResult:
    """Return the compiled entry from what `CompileResult._reduce` returned; its object code stays with it."""
    restored = CompileResult._rebuild(target_context, *payload)
    _, form, code = payload[0]
    if form == "object":
        restored.library.restored_from = code[0]
    return restored


def object_code(library: Any) -> tuple[bytes, list[str]]:
    """Return the object code of a compiled function, empty if there is none, and the names that it does not define."""
    code = getattr(library, "restored_from", None) or library._compiled_object or b""
    module = library._final_module
    outside = [item.name for item in (*module.functions, *module.global_variables) if item.is_declaration]
    return bytes(code), outside


class _ContextOfCallees:
    """The context with which numba makes compiled functions anew, where these are callees without machine code."""

    def __init__(self, context: Any) -> None:
        self._context = context
        self.typing_context = context.typing_context

    def codegen(self) -> _ContextOfCallees:
        """Return this object, which reads the stored library."""
        return self

    def unserialize_library(self, stored: tuple[str, str, bytes]) -> CalleeLibrary:
        """Return the library that was stored."""
        return CalleeLibrary.restored(self._context.codegen(), stored)

    def get_executable(self, library: CalleeLibrary, fndesc: Any, environment: Any) -> Any:
        """Return a function object without machine code."""
        return _unreachable_from_python(library, fndesc, environment)


def restored_callee(target_context: Any, payload: tuple[Any, ...]) -> CompileResult:
    """Return the compiled callee from what `CompileResult._reduce` returned; its entry refers to the environments."""
    *parts, environments = payload
    restored = CompileResult._rebuild(_ContextOfCallees(target_context), *parts, ())
    return restored._replace(target_context=target_context, referenced_envs=environments)


# ------------------------------------------------------------------------------------------- dispatchers and storage


def use_storage(dispatcher: Any, storage: Any) -> None:
    """Have a compiled function load and save its code by `storage`, instead of numba's own cache."""
    dispatcher._cache = storage


def content_of(signature: Any, compiled: Any) -> bytes:
    """Return what is stored of a function compiled for a signature; empty if it refers to addresses of this process."""
    if compiled.library.has_dynamic_globals:
        return b""
    return bytes(dumps((signature, compiled._reduce())))


def compiles_for_any_types(dispatcher: Any) -> bool:
    """Return whether a function is compiled when it is called with new types; without this module it counts as such."""
    return bool(dispatcher._can_compile)


def reference_counts_can_be_left_out() -> bool:
    """Return whether numba can compile a function without reference counts on array slices (option `_nrt`)."""
    return hasattr(CPUTargetOptions, "_nrt")


# -------------------------------------------------------------------------------------------------------- overloads


def refresh_overloads() -> None:
    """Let numba notice the overloads of functions that were registered since the last call."""
    _refresh(tuple(len(declarations.globals) for declarations in list(cpu_target.typing_context._registries)))


@functools.lru_cache(maxsize=1)
def _refresh(declared: tuple[int, ...]) -> None:  # noqa: ARG001  a key of the cache
    """Fill numba's table of overloads, unless each of its registries has as many declarations as at the last call.

    It takes longer than a bulk step, and would find nothing new.
    """
    # Generators fill the table, and another thread that compiles may be running one of them.
    with global_compiler_lock:
        cpu_target.typing_context.refresh()


def is_overloaded(function: object) -> bool:
    """Return whether numba compiles other code in place of a plain function; without this module that is not seen."""
    return cpu_target.typing_context._lookup_global(function) is not None


# ------------------------------------------------------------------------------------------------------------ events


class Listener(EventListener):  # type: ignore[misc]
    """The listener to one kind of event; it calls `tell` with True at the begin of each, and with False at its end."""

    tell: Callable[[bool], None]

    def __init__(self, kind: str) -> None:
        self.tell = lambda _: None  # until somebody listens
        register(kind, self)

    def on_start(self, event: Any) -> None:  # noqa: ARG002
        """Tell that an event begins."""
        self.tell(True)

    def on_end(self, event: Any) -> None:  # noqa: ARG002
        """Tell that an event ends."""
        self.tell(False)


LOCKED = Listener("numba:compiler_lock")  # numba compiles or loads a function
COMPILED = Listener("numba:compile")  # numba compiles a function, with those that it calls
