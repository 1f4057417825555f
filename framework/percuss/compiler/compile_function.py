"""Compile a function for compiled callers alone, or for Python, and store what is compiled on disk.

Numba optimises every function and makes machine code of it, and then links its intermediate code into each caller,
where both are done again. Nothing ever runs the machine code of a function that only compiled functions call, and it
stays in memory as long as the process. A *callee* here is therefore translated to intermediate code and no further; the
*entry*, the function that Python calls, is optimised once with all its callees inside.
"""

from __future__ import annotations

import contextlib
import pickle
import types
from typing import Any

from percuss.cache import cache_folder, keep, kept
from percuss.compiler.machine_code import jit_disabled, key_of
from percuss.compiling import Kernel, numba_inside
from percuss.locks import in_turn

LONGEST_WAIT = 120.0  # seconds that a process waits for another to compile, before it compiles by itself


def compile_function(function: types.FunctionType, *, entry: bool, key: str = "", **options: Any) -> Kernel:
    """Compile a function for compiled callers alone, or one that Python calls, with the code of its callees inside.

    Where a version of numba is built otherwise, every function is compiled by plain `numba.njit`, and anew by every
    process: slower, with the same result.

    Parameters
    ----------
    function
        The function.
    entry
        Whether Python calls it; a call from Python of any other would crash the process.
    key
        Name under which what is compiled is stored on disk, another one for any other code; empty not to store it.
    **options
        Options of `numba.njit`.
    """
    import numba

    options |= {"no_cfunc_wrapper": True} | ({} if entry else {"no_cpython_wrapper": True})
    signatures = options.pop("signature_or_function", ())
    inside, stored = numba_inside(), StoredFunction(key, entry=entry)
    if inside is not None:
        entry_compiler = type("Compiler", (inside.EntryCompiler,), {"cache": stored})
        options["pipeline_class"] = entry_compiler if entry else inside.CalleeCompiler
    kernel: Any = numba.njit(**options)(function)
    if jit_disabled():
        return kernel  # type: ignore[no-any-return]
    if inside is not None:
        inside.use_storage(kernel, stored)
    for signature in signatures:  # numba compiles for these at once, and for no others
        kernel.compile(signature)
    if signatures:
        kernel.disable_compile()
    return kernel  # type: ignore[no-any-return]


class StoredFunction:
    """What is compiled of one function, stored on disk for each signature, instead of numba's own cache.

    Parameters
    ----------
    key
        Name of the function, another one for any other code; empty if nothing is stored.
    entry
        Whether Python calls it.

    Attributes
    ----------
    stored
        What an entry has compiled or loaded last.
    cache_path
        What numba shows in its statistics: no folder belongs to this function alone.
    """

    cache_path = None
    stored: object = None

    def __init__(self, key: str, *, entry: bool) -> None:
        self.key, self.entry = key, entry

    def in_turn(self) -> contextlib.AbstractContextManager[None]:
        """Return a context in which no other process compiles this function."""
        folder = cache_folder() if self.key else None
        return contextlib.nullcontext() if folder is None else in_turn(folder / f"{self.key}.lock", LONGEST_WAIT)

    def save_overload(self, signature: object, compiled: object) -> None:
        """Store the function compiled for a signature, unless it was stored already or refers to addresses."""
        if not self.key or compiled is self.stored:
            return
        from percuss.numba_inside import content_of

        if content := content_of(signature, compiled):
            keep(self._name_of(signature), content)

    def load_overload(self, signature: object, target_context: Any) -> Any:
        """Return the function compiled for a signature, or None.

        Numba takes union types for equal if their names are, so that in a process that has loaded a single-file plug-in
        before and after an edit, what it stores for the new version also refers to the module of the old one. Another
        process does not have that module.
        """
        from percuss.numba_inside import restored_callee, restored_entry

        target_context.refresh()
        content = kept(self._name_of(signature)) if self.key else None
        if content is None:
            return None
        try:
            of, payload = pickle.loads(content)  # noqa: S301 - the folder is of its user
            restored = restored_entry if self.entry else restored_callee
            return restored(target_context, payload) if of == signature else None
        except (ImportError, AttributeError):
            return None

    def flush(self) -> None:
        """Leave what is stored as it is: numba asks for this where a function is to be compiled again."""

    def _name_of(self, signature: object) -> str:
        # Types are told apart by more than their names, as tuples of two classes of one name are: see above.
        return f"{key_of(self.key, repr(signature))}.compiled"
