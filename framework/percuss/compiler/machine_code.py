"""Machine code of the functions that are called by address: stored on disk, and loaded without the compiler.

Importing numba, and having it load what it has stored, takes several times as long as a short run. A function that is
called by its address needs none of that: its machine code refers to nothing but the C library, and `llvmlite`, with
which numba makes it, loads it by itself. Code that refers to more, as it allocates arrays or prints, is stored by numba
alone, and loaded with it.
"""

from __future__ import annotations

import ctypes
import functools
import json
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from percuss.cache import keep, kept
from percuss.compiling import LOCK
from percuss.digest import content_digest, surroundings
from percuss.files import PACKAGE

OWN_NAMES = ("Py", "_Py", "numba", "NRT_")  # beginnings of the names that Python and numba provide to compiled code


class CannotLink(NotImplementedError):
    """Error: a kernel cannot be called by its address, as its data contain something else than numbers and arrays."""


class MachineCode(NamedTuple):
    """The machine code of one function.

    Attributes
    ----------
    symbol
        Name of the function in `object_code`.
    form
        Places of the numbers of its data, as `percuss.step.calls.form_of` returns them.
    object_code
        A relocatable object file.
    """

    symbol: str
    form: str
    object_code: bytes


# The address and the form of the data of each function that this process has loaded, and the library that has its code,
# by key. llvmlite removes the code of a library from memory when nothing refers to it any more.
_LOADED: dict[str, tuple[tuple[int, str], object]] = {}


def jit_disabled() -> bool:
    """Return whether numba is configured not to compile (``NUMBA_DISABLE_JIT=1``), without importing it if possible."""
    if "numba" not in sys.modules and not Path(".numba_config.yaml").exists():
        return os.environ.get("NUMBA_DISABLE_JIT", "0") not in {"", "0"}
    import numba

    return bool(numba.config.DISABLE_JIT)


def key_of(*parts: str) -> str:
    """Return the name under which machine code is stored: a digest of `parts`, the processor and the compiler."""
    return content_digest("\0".join([*parts, _surroundings()]).encode())[:40]


@functools.cache
def _surroundings() -> str:
    from llvmlite import binding

    files = [*sorted(Path(__file__).parent.glob("*.py")), PACKAGE / "numba_inside.py"]
    compiler = b"".join(file.read_bytes() for file in files)
    features = binding.get_host_cpu_features().flatten()
    return f"{binding.get_host_cpu_name()};{features};{sorted(surroundings().items())};{content_digest(compiler)}"


def address_of_stored(key: str) -> tuple[int, str] | None:
    """Return the address of a stored function and the form of its data, or None if it cannot be loaded."""
    with LOCK:
        if key not in _LOADED:
            stored = kept(f"{key}.code")
            if stored is None:
                return None
            header, object_code = stored.split(b"\n", 1)
            symbol, form = json.loads(header)
            library = _library(key, MachineCode(symbol, form, object_code))
            if library is None:
                return None
            _LOADED[key] = (int(library[symbol]), form), library
        return _LOADED[key][0]


def store(key: str, code: MachineCode) -> None:
    """Store machine code."""
    keep(f"{key}.code", json.dumps([code.symbol, code.form]).encode() + b"\n" + code.object_code)


def refers_to_c_alone(names: Iterable[str]) -> bool:
    """Return whether the C library provides all of these names that are no instruction of LLVM itself."""
    outside = [name for name in names if not name.startswith("llvm.")]
    if any(name.startswith(OWN_NAMES) for name in outside):
        return False
    try:
        process = ctypes.CDLL(None)
    except TypeError:  # on Windows
        return not outside
    return all(hasattr(process, name) for name in outside)


@functools.cache
def _linker() -> Any:
    """Return the part of llvmlite that puts machine code into memory."""
    from llvmlite import binding

    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    machine = binding.Target.from_default_triple().create_target_machine(jit=True)
    return binding.create_lljit_compiler(machine, suppress_errors=True)


def _library(key: str, code: MachineCode) -> Any:
    """Return the library of a function after loading its machine code, None if something it refers to is missing."""
    from llvmlite import binding

    library = binding.JITLibraryBuilder().add_object_img(code.object_code).add_current_process()
    try:
        return library.export_symbol(code.symbol).link(_linker(), key)
    except RuntimeError:
        return None
