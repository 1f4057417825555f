"""Compilers of numba in which a function is optimised and made machine code of only where Python calls it.

This module names private parts of numba. `percuss.compiler.compile_function` does without it where a version of
numba is built otherwise.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
from numba import _dynfunc
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, CompileResult, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.environment import lookup_environment
from numba.core.typed_passes import NativeLowering
from numba.core.typing import signature as typing_signature

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
        """Return numba's own passes, with another translation in the place of its last but one."""
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
