"""Compile a function for compiled callers alone, or for Python, and store what is compiled on disk.

Numba optimises every function and makes machine code of it, and then links its intermediate code into each caller,
where both are done again. Nothing ever runs the machine code of a function that only compiled functions call, and it
stays in memory as long as the process. A *callee* here is therefore translated to intermediate code and no further; the
*entry*, the function that Python calls, is optimised once with all its callees inside.
"""

from __future__ import annotations

import contextlib
import functools
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

from percuss.solver.compiler.machine_code import jit_disabled

Kernel = Callable[..., Any]


def compile_callee(function: types.FunctionType, *, cache: bool = False, **options: Any) -> Kernel:
    """Compile a function for compiled callers alone; a call from Python would crash the process.

    Parameters
    ----------
    function
        The function.
    cache
        Whether what is compiled is stored on disk, in the folder that numba is configured for.
    **options
        Options of `numba.njit`.
    """
    options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    compilers = pipelines()
    if compilers is None:
        return _compiled(function, cache, _cache_classes()[0], options)
    return _compiled(function, cache, _cache_classes()[1], {"pipeline_class": compilers.CalleeCompiler, **options})


def compile_entry(function: types.FunctionType, *, cache: bool = False, **options: Any) -> Kernel:
    """Compile a function that Python calls, with the code of its callees inside; parameters as in `compile_callee`."""
    options |= {"no_cfunc_wrapper": True}
    compilers = pipelines()
    if compilers is None:
        return _compiled(function, cache, _cache_classes()[0], options)
    compiler = compilers.compiler_of_one_entry()
    kernel: Any = _compiled(function, cache, _cache_classes()[0], {"pipeline_class": compiler, **options})
    if cache and not jit_disabled():
        compiler.cache = kernel._cache
    return kernel  # type: ignore[no-any-return]


def _compiled(function: types.FunctionType, cache: bool, cache_class: Any, options: dict[str, Any]) -> Kernel:
    import numba

    # A function with given signatures is compiled as soon as it is made, and looks for its cache then.
    kernel: Any = numba.njit(cache=cache and "signature_or_function" in options, **options)(function)
    if cache and not jit_disabled():
        kernel._cache = cache_class(function)
    return kernel  # type: ignore[no-any-return]


@functools.cache
def pipelines() -> types.ModuleType | None:
    """Return the module of compilers for callees and entries, or None if this version of numba is built otherwise.

    Without them every function is compiled as numba does it: slower, with the same result.
    """
    try:
        from percuss.solver.compiler import numba_pipelines
    except (ImportError, AttributeError):
        return None
    return numba_pipelines


@functools.cache
def _cache_classes() -> tuple[Any, Any]:
    """Return the classes of the disk caches of entries and of callees."""
    from numba.core.caching import FunctionCache

    compilers = pipelines()

    class ForgivingCache(FunctionCache):  # type: ignore[misc]
        """A cache of machine code that begins anew where it cannot be read.

        Numba takes union types for equal if their names are, so that in a process that has loaded a single-file
        plug-in before and after an edit, what it stores for the new version also refers to the module of the old one.
        Another process does not have that module.

        Attributes
        ----------
        stored
            The compiled function that was stored last.
        """

        stored: Any = None

        if compilers is not None:
            _impl_class = compilers.EntryCacheImpl

        @property
        def lock_file(self) -> Path:
            """File on which a process holds a lock while it compiles the function for this cache."""
            return Path(self.cache_path) / f"{self._impl.filename_base}.lock"

        def save_overload(self, sig: Any, data: Any) -> None:
            """Store the function compiled for a signature, unless it was stored already or the disk is full."""
            if data is not self.stored:
                with contextlib.suppress(OSError):  # the function runs all the same, and is compiled again next time
                    super().save_overload(sig, data)

        def load_overload(self, sig: Any, target_context: Any) -> Any:
            """Return the function compiled for a signature, or None."""
            try:
                return super().load_overload(sig, target_context)
            except (ImportError, AttributeError):
                self.flush()
                return None

    class CalleeCache(ForgivingCache):
        """The cache of callees, which stores intermediate code."""

        if compilers is not None:
            _impl_class = compilers.CalleeCacheImpl

    return ForgivingCache, CalleeCache
