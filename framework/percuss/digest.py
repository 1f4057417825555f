"""Digests of sources: a stored number, or stored machine code, is used as long as the code behind it has its digest.

The digest of a method is that of its package, of all its Python files, or of its single file. What it imports from
elsewhere counts by its version if it computes numbers, and else not at all.
"""

from __future__ import annotations

import functools
import hashlib
import platform
from pathlib import Path

from percuss.files import PACKAGE
from percuss.version import installed_version

COMPUTING_PACKAGES = ("numpy", "numba", "llvmlite", "scipy")
SOURCES = {".py", ".toml"}
SHOWN_ALONE = {"cli", "reporting", "testing"}  # rooms of percuss on which no number of a run depends
OF_THE_LOOP = ("contact", "mesh", "step", "methods/slots.py", "jit.py", "digest.py")  # what is compiled, and how


def content_digest(content: bytes) -> str:
    """Return the SHA-256 digest of `content` in hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


@functools.cache
def source_digest(file: str) -> str:
    """Return the digest of all sources of the package in which a file lies, or of a file in no package.

    A process reads them once, as Python does: after an edit its numbers are still those of the code before. What has no
    file, as code that was typed at a prompt, has the digest of nothing.
    """
    path = Path(file).absolute()
    if path.is_relative_to(PACKAGE):
        return loop_digest() if is_of_the_loop(file) else own_digest()
    if not path.is_file():
        return _digest(path)
    folder = path.parent
    while (folder / "__init__.py").is_file():
        path, folder = folder, folder.parent
    return _digest(path, (path,))


@functools.cache
def is_of_the_loop(file: str) -> bool:
    """Return whether a file is one of those from which percuss compiles the time loop."""
    path = Path(file).absolute()
    return path.is_relative_to(PACKAGE) and path.relative_to(PACKAGE).as_posix().startswith(OF_THE_LOOP)


def loop_digest() -> str:
    """Return the digest of percuss's own sources from which the time loop is compiled."""
    return _digest(PACKAGE, tuple(PACKAGE / part for part in OF_THE_LOOP))


@functools.cache
def own_digest() -> str:
    """Return the digest of percuss's own sources on which a number may depend."""
    return _digest(PACKAGE, tuple(part for part in sorted(PACKAGE.iterdir()) if part.name not in SHOWN_ALONE))


@functools.cache
def surroundings() -> dict[str, str]:
    """Return the versions outside the methods that can change numbers."""
    versions = {"python": f"{platform.python_implementation()} {platform.python_version()}"}
    return versions | {name: installed_version(name) for name in COMPUTING_PACKAGES}


@functools.cache
def _digest(root: Path, parts: tuple[Path, ...] = ()) -> str:
    """Return the digest of all sources in files and folders, in order and by their places below `root`."""
    files = (file for part in parts for file in ([part] if part.is_file() else sorted(part.rglob("*"))))
    sources = (file for file in files if file.suffix in SOURCES and file.is_file())
    read = (f"{file.relative_to(root).as_posix()}\0{content_digest(file.read_bytes())}\0" for file in sources)
    return content_digest("".join(read).encode())
