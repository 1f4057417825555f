"""A digest of the sources that a method is made of: where it is equal, so are the method's numbers.

A method counts by the file that defines it and by all that this file imports, all the way down, as far as it is not
installed: modules of the method's own package, packages installed as editable, helpers beside a single file, and files
of data that they name. Installed distributions count by their version, as do Python and the packages that compute.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import json
import os
import platform
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from percuss.errors import InputError, Problem
from percuss.files import PACKAGE
from percuss.methods.local_modules import installed, managed

if TYPE_CHECKING:
    from percuss.methods.provenance import Provenance

__all__ = ["SourceDigests", "content_digest", "data_named", "own_digest", "remember", "surroundings"]

LARGE = 2**24  # bytes; a larger file of data counts by its size and time
COMPUTING = ("numpy", "numba", "llvmlite", "scipy")
# of the many variables of numba, these change no number
HARMLESS = (
    "NUMBA_CACHE", "NUMBA_DEBUG", "NUMBA_DUMP", "NUMBA_NUM_THREADS", "NUMBA_WARNINGS", "NUMBA_COLOR",
    "NUMBA_FULL_TRACEBACKS", "NUMBA_SHOW_HELP", "NUMBA_HIGHLIGHT", "NUMBA_DISABLE_PERFORMANCE", "NUMBA_TRACE",
    "NUMBA_ENABLE_PROFILING", "NUMBA_DEVELOPER_MODE", "NUMBA_JIT_COVERAGE", "NUMBA_GDB", "NUMBA_THREADING_LAYER",
)  # fmt: skip
HEARD = ("NUMBA_", "NPY_DISABLE_CPU", "NPY_ENABLE_CPU", "OPENBLAS_CORETYPE", "MKL_CBWR", "MKL_ENABLE_INSTRUCTIONS")

_REMEMBERED: dict[str, str] = {}  # digest of the source of each module that is not installed, as it was imported


def content_digest(content: bytes) -> str:
    """Return the SHA-256 of a content."""
    return hashlib.sha256(content).hexdigest()


def surroundings() -> dict[str, str]:
    """Return what changes numbers and is no method: versions of what computes, and variables of the environment."""
    found = {"python": f"{platform.python_implementation()} {platform.python_version()}"}
    found |= {name: _version(name) for name in COMPUTING}
    for name, value in sorted(os.environ.items()):
        if name.startswith(HEARD) and not name.startswith(HARMLESS):
            found[name] = value
    settings = Path(".numba_config.yaml")
    if settings.is_file():
        found[settings.name] = content_digest(settings.read_bytes())
    return found


def own_digest() -> str:
    """Return a digest of all of percuss's own sources: a clone that is being worked on changes without a new version.

    Raises
    ------
    InputError
        If one of them was edited after this process imported it.
    """
    digest = hashlib.sha256()
    modules = {Path(file): name for name, file in _loaded_files() if name.partition(".")[0] == "percuss"}
    for path in sorted(PACKAGE.rglob("*.py")):
        content = path.read_bytes()
        if path in modules:
            _expect_as_imported(modules[path], path, content)
        digest.update(f"{path.relative_to(PACKAGE).as_posix()}\0{content_digest(content)}\0".encode())
    return digest.hexdigest()


def remember() -> None:
    """Note the sources of all modules that are imported by now and not installed.

    Python imports a module once a process: of one that is edited later the old code goes on running, and what it
    computes must not be taken for what the new one would.
    """
    for name, file in _loaded_files():
        if name not in _REMEMBERED:
            try:
                _REMEMBERED[name] = content_digest(Path(file).read_bytes())
            except OSError:
                _REMEMBERED[name] = ""


def _loaded_files() -> Iterator[tuple[str, str]]:
    """Yield name and file of each imported module that is not installed, but for those that are imported anew."""
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        anew = name.startswith("percuss_file_") or name in managed() or name == "__main__"
        if isinstance(file, str) and file.endswith(".py") and not anew and not installed(file):
            yield name, file


def _expect_as_imported(name: str, path: Path, content: bytes) -> None:
    """Raise InputError where the source of an imported module is not what was imported."""
    known = _REMEMBERED.get(name)
    if known is None or name in managed() or known == content_digest(content):
        return
    message = "was edited after this process imported it, so that its numbers are those of the code before"
    raise InputError([Problem(str(path), "", message, "Start Python anew, and the workers of a scheduler too.")])


@functools.cache
def _version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"


@functools.cache
def _distributions() -> dict[str, list[str]]:
    return {name: sorted(set(those)) for name, those in metadata.packages_distributions().items()}


class _Import(NamedTuple):
    """A module that a source imports; of one that comes along as the parent of another, only its text counts."""

    name: str
    whole: bool


class SourceDigests:
    """Digests the sources of methods as they are now; each file is read once."""

    def __init__(self) -> None:
        self._done: dict[tuple[str, str], str] = {}

    def of(self, source: Provenance) -> str:
        """Return the digest of a component.

        Raises
        ------
        InputError
            If one of its modules was edited after this process imported it.
        """
        key = source.module, source.file
        if key not in self._done:
            told = json.dumps([source.distribution and source.version, sorted(self._sources(source).items())])
            self._done[key] = content_digest(told.encode())
        return self._done[key]

    def _sources(self, source: Provenance) -> dict[str, str]:
        """Return the digest of everything a component is made of, by a name that does not say where it lies."""
        single = not source.distribution
        start = Path(source.file)
        folder = start.parent if single else None
        top = "" if single else source.module.partition(".")[0]
        found: dict[str, str] = {}
        waiting: list[tuple[_Import, Path]] = [(_Import("" if single else source.module, whole=True), start)]
        if not single:
            above = [_Import(name, whole=False) for name in _parents(source.module)]
            waiting += self._followed(above, None, top, found)
        seen: set[_Import] = set()
        while waiting:
            module, path = waiting.pop()
            if module in seen:
                continue
            seen.add(module)
            try:
                content = path.read_bytes()
            except OSError:
                found[module.name] = "cannot be read"
                continue
            _expect_as_imported(module.name, path, content)
            found[module.name] = content_digest(content)
            if not module.whole or path.suffix != ".py":
                continue
            package = module.name if path.name == "__init__.py" else module.name.rpartition(".")[0]
            imports, words = _read(content, package)
            for data in _data_files(path, words, in_package=path.name == "__init__.py" or bool(package)):
                found[f"{module.name}: {data.name}"] = _data_digest(data)
            waiting += self._followed(imports, folder, top, found)
        return found

    def _followed(
        self, imports: list[_Import], folder: Path | None, top: str, found: dict[str, str]
    ) -> list[tuple[_Import, Path]]:
        """Return the files of imported modules that are to be read; versions of the others join `found`."""
        out = []
        for module in imports:
            first = module.name.partition(".")[0]
            if first in sys.stdlib_module_names or first == "percuss" or first in COMPUTING:
                continue
            path = _located(module.name, folder)
            if path is not None and (first == top or not installed(str(path)) or (folder and path.parent == folder)):
                out.append((module, path))
            elif path is not None:
                names = _distributions().get(first, [])
                found[f"package {first}"] = ", ".join(f"{name} {_version(name)}" for name in names) or "?"
        return out


def _parents(name: str) -> list[str]:
    parts = name.split(".")
    return [".".join(parts[:n]) for n in range(1, len(parts))]


def _read(content: bytes, package: str) -> tuple[list[_Import], list[str]]:
    """Return what a source imports and the texts in it; nothing where it is no Python."""
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError, RecursionError):
        return [], []
    imports: dict[_Import, None] = {}
    words: dict[str, None] = {}
    for node in ast.walk(tree):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [name for alias in node.names for name in (alias.name, *_parents(alias.name))]
        elif isinstance(node, ast.ImportFrom):
            base = _absolute("." * node.level + (node.module or ""), package)
            parts = [f"{base}.{alias.name}" for alias in node.names]
            modules = [one for one in parts if _located(one, None) is not None]
            # what is no module of its own is a name in the package
            names = modules if modules and len(modules) == len(parts) else [base, *parts]
        elif isinstance(node, ast.Call) and _is_import(node.func):
            texts = [one.value for one in node.args if isinstance(one, ast.Constant) and isinstance(one.value, str)]
            names = [_absolute(text, package) for text in texts[:1]]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and 0 < len(node.value) < 200:
            words[node.value] = None
        for name in filter(None, names):
            imports[_Import(name, whole=True)] = None
            imports |= dict.fromkeys(_Import(parent, whole=False) for parent in _parents(name))
    return list(imports), list(words)


def _is_import(function: ast.expr) -> bool:
    name = getattr(function, "attr", getattr(function, "id", ""))
    return name in {"import_module", "__import__"}


def _absolute(name: str, package: str) -> str:
    """Return the full name of a module that may be written relative to a package."""
    level = len(name) - len(name.lstrip("."))
    if not level:
        return name
    parents = package.split(".")
    above = parents[: len(parents) - level + 1]
    return ".".join(filter(None, [*above, name[level:]]))


def _located(name: str, folder: Path | None) -> Path | None:
    """Return the file of a module: beside a single-file plug-in, as it was imported, or as it would be."""
    if folder is not None:
        base = folder.joinpath(*name.split("."))
        for path in (base / "__init__.py", base.with_name(f"{base.name}.py")):
            if path.is_file():
                return path
    module = sys.modules.get(name)
    file = getattr(module, "__file__", None)
    if module is None:
        file = _file_on_path(name)
    return Path(file) if isinstance(file, str) and Path(file).is_file() else None


def _file_on_path(name: str) -> str | None:
    """Return the file of a module that is not imported yet, looked for without importing its parents."""
    parent, _, _ = name.rpartition(".")
    search: list[str] | None = None
    if parent:
        package = sys.modules.get(parent)
        search = list(getattr(package, "__path__", [])) if package is not None else None
        if search is None:
            above = _located(parent, None)
            if above is None or above.name != "__init__.py":
                return None
            search = [str(above.parent)]
    for finder in sys.meta_path:
        find = getattr(finder, "find_spec", None)
        try:
            spec = find(name, search) if find is not None else None
        except Exception:  # noqa: BLE001, S112 - somebody else's finder
            continue
        if spec is not None:
            return spec.origin if spec.origin not in {"built-in", "frozen"} else None
    return None


def data_named(path: Path, content: bytes) -> list[Path]:
    """Return the files of data that a Python source outside any package names."""
    return _data_files(path, _read(content, "")[1], in_package=False)


def _data_files(path: Path, words: list[str], *, in_package: bool) -> list[Path]:
    """Return the files of data that a source may read: those that it names, and all of those in its package."""
    folder = path.parent
    found: dict[Path, None] = {}
    folders = [folder]
    for word in words:
        try:
            if (folder / word).is_dir() and "/" not in word.strip("/") and word.strip("./"):
                folders.append(folder / word)
        except (OSError, ValueError):
            continue
    for place in folders:
        for word in words:
            try:
                if (place / word).is_file() and not word.endswith(".py"):
                    found[place / word] = None
            except (OSError, ValueError):
                continue
    if in_package and (folder / "__init__.py").is_file():
        for one in folder.rglob("*"):
            if one.is_file() and one.suffix not in {".py", ".pyc", ".nbi", ".nbc"} and "__pycache__" not in one.parts:
                found[one] = None
    return sorted(found)


def _data_digest(path: Path) -> str:
    try:
        state = path.stat()
        if state.st_size > LARGE:
            return f"{state.st_size} bytes, {state.st_mtime_ns}"
        return content_digest(path.read_bytes())
    except OSError:
        return "cannot be read"
