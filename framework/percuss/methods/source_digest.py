"""Digests of functions, on which machine code depends."""

from __future__ import annotations

import functools
import sys
import types
from pathlib import Path

from percuss.digest import content_digest

# Digests of the sources of modules by name, as they were imported; "" where a source cannot be read.
_DIGEST_AT_IMPORT: dict[str, str] = {}


def _source_of(name: str) -> str:
    """Return the digest of the source of an imported module; empty for a module without a source.

    The source is read once per process.
    """
    if name not in _DIGEST_AT_IMPORT:
        file = getattr(sys.modules.get(name), "__file__", None)
        try:
            _DIGEST_AT_IMPORT[name] = content_digest(Path(file or "").read_bytes())
        except OSError:
            _DIGEST_AT_IMPORT[name] = ""
    return _DIGEST_AT_IMPORT[name]


def function_digest(function: types.FunctionType) -> tuple[str, bool]:
    """Return the digest of a function without the values that it reads, and whether the function has a source.

    The source alone is not enough: the source of a module does not tell which of its functions this is, nor whether
    the function is still that of the source. A function made by ``exec`` or at a prompt has no source.

    Parameters
    ----------
    function
        The function; the digest does not depend on the place of its file.
    """
    name = function.__globals__.get("__name__", "")
    module = sys.modules.get(name)
    own = module is not None and vars(module) is function.__globals__
    source = _source_of(name) if own and function.__code__.co_filename == getattr(module, "__file__", None) else ""
    return f"{source} {_code_digest(function.__code__)}", bool(source)


@functools.lru_cache(maxsize=4096)
def _code_digest(code: types.CodeType) -> str:
    """Return the digest of bytecode, its constants, and the names and kinds of its arguments.

    The flags of the code do not count: numba changes them when it calls a compiled function under a profiler.
    """
    arguments = code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
    constants = [
        _code_digest(constant) if isinstance(constant, types.CodeType) else f"{type(constant).__name__}:{constant!r}"
        for constant in code.co_consts
    ]
    return content_digest(repr((code.co_code, code.co_exceptiontable, arguments, names, constants)).encode())
