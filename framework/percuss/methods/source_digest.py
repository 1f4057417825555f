"""Digests of sources: the single answer to the question whether code has changed since a number or machine code.

The digest of a method, on which stored runs depend, covers the file that defines it and, recursively, all modules that
this file imports from outside installed distributions: those of its own package, of packages installed as editable and
of the import path, with the data files that they name. Installed distributions count by their version, as do Python and
the packages that compute. The digest of a function, on which machine code depends, covers the file of its module and
its own code; functions and values that it reads have digests of their own (`percuss.compiler.fingerprint`).
"""

from __future__ import annotations

import ast
import functools
import hashlib
import json
import os
import platform
import site
import sys
import sysconfig
import types
from collections.abc import Iterable, Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from percuss.cache import keep, kept
from percuss.errors import InputError, Problem
from percuss.files import PACKAGE, is_file, is_folder
from percuss.version import installed_version

if TYPE_CHECKING:
    from percuss.methods.provenance import Provenance

LARGE = 2**24  # bytes; a larger data file counts by its size and modification time
COMPUTING_PACKAGES = ("numpy", "numba", "llvmlite", "scipy")
# Environment variables of numba with these prefixes change no number.
HARMLESS_PREFIXES = (
    "NUMBA_CACHE", "NUMBA_DEBUG", "NUMBA_DUMP", "NUMBA_NUM_THREADS", "NUMBA_WARNINGS", "NUMBA_COLOR",
    "NUMBA_FULL_TRACEBACKS", "NUMBA_SHOW_HELP", "NUMBA_HIGHLIGHT", "NUMBA_DISABLE_PERFORMANCE", "NUMBA_TRACE",
    "NUMBA_ENABLE_PROFILING", "NUMBA_DEVELOPER_MODE", "NUMBA_JIT_COVERAGE", "NUMBA_GDB", "NUMBA_THREADING_LAYER",
)  # fmt: skip
# Environment variables with these prefixes can change numbers.
NUMERIC_PREFIXES = (
    "NUMBA_",
    "NPY_DISABLE_CPU",
    "NPY_ENABLE_CPU",
    "OPENBLAS_CORETYPE",
    "MKL_CBWR",
    "MKL_ENABLE_INSTRUCTIONS",
)

# Digests of the sources of modules by name, as they were imported; "" where a source cannot be read.
_DIGEST_AT_IMPORT: dict[str, str] = {}


def content_digest(content: bytes) -> str:
    """Return the SHA-256 digest of `content` in hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def surroundings() -> dict[str, str]:
    """Return versions and settings outside the methods that can change numbers: packages, environment, numba's file."""
    versions = {"python": f"{platform.python_implementation()} {platform.python_version()}"}
    return versions | {name: installed_version(name) for name in COMPUTING_PACKAGES} | numeric_settings()


def numeric_settings() -> dict[str, str]:
    """Return variables of the environment that can change numbers, and the digest of numba's settings file."""
    settings = {
        name: value
        for name, value in sorted(os.environ.items())
        if name.startswith(NUMERIC_PREFIXES) and not name.startswith(HARMLESS_PREFIXES)
    }
    file = Path(".numba_config.yaml")
    if file.is_file():
        settings[file.name] = content_digest(file.read_bytes())
    return settings


def own_digest() -> str:
    """Return a digest of all sources of percuss itself, as a working copy changes without a new version number.

    Raises
    ------
    InputError
        If one of the sources was edited after this process imported it.
    """
    digest = hashlib.sha256()
    modules = {Path(file): name for name, file in _loaded_files() if name.partition(".")[0] == "percuss"}
    for path in sorted([*PACKAGE.rglob("*.py"), *PACKAGE.rglob("*.toml")]):
        content = path.read_bytes()
        if path in modules:
            _refuse_edited(modules[path], path, content)
        digest.update(f"{path.relative_to(PACKAGE).as_posix()}\0{content_digest(content)}\0".encode())
    return digest.hexdigest()


def remember() -> None:
    """Record the digests of all imported modules that do not belong to an installed distribution.

    Python imports a module once per process: after a later edit the old code goes on running, and its results must not
    be taken for those of the new code.
    """
    for name, _ in _loaded_files():
        _source_of(name)


def record_import(name: str, content: bytes) -> None:
    """Record the digest of a module that was imported from `content`."""
    _DIGEST_AT_IMPORT[name] = content_digest(content)


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


@functools.cache
def _installed_prefixes() -> tuple[str, ...]:
    """Return the beginnings of the paths of installed files, with symbolic links resolved and as configured."""
    paths = {*sysconfig.get_paths().values(), *site.getsitepackages(), site.getusersitepackages()} - {sys.prefix}
    spellings = {spelling for path in paths for spelling in (Path(path).absolute(), Path(path).resolve())}
    return tuple(f"{folder}{os.sep}" for folder in spellings)


def _installed(file: str) -> bool:
    """Return whether a file belongs to Python or to an installed distribution, editable ones excluded."""
    return file.startswith(_installed_prefixes())


def _loaded_files() -> Iterator[tuple[str, str]]:
    """Yield name and file of each imported module that is not installed."""
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if isinstance(file, str) and file.endswith(".py") and name != "__main__" and not _installed(file):
            yield name, file


def _refuse_edited(name: str, path: Path, content: bytes) -> None:
    """Raise InputError if the source of an imported module has changed since the import."""
    imported_digest = _DIGEST_AT_IMPORT.get(name)
    if imported_digest is None or imported_digest == content_digest(content):
        return
    message = "was edited after this process imported it, so that its numbers are those of the code before"
    raise InputError([Problem(str(path), "", message, "Start Python anew, and the workers of a scheduler too.")])


@functools.cache
def _distributions() -> dict[str, list[str]]:
    """Return the names of the distributions that provide each top-level package."""
    return {package: sorted(set(names)) for package, names in metadata.packages_distributions().items()}


class ImportStatement(NamedTuple):
    """An import in a source.

    Attributes
    ----------
    line
        Its line.
    module
        Full name of the module that it names.
    parts
        Names that it takes from that module, which may be modules themselves.
    """

    line: int
    module: str
    parts: tuple[str, ...] = ()


class SourceDigests:
    """Digests of the present sources of methods, each computed once."""

    def __init__(self) -> None:
        self._done: dict[tuple[str, str], str] = {}

    def of(self, source: Provenance) -> str:
        """Return the digest of the sources of a component.

        Raises
        ------
        InputError
            If one of its modules was edited after this process imported it.
        """
        key = source.module, source.file
        if key not in self._done:
            content = json.dumps([source.distribution and source.version, sorted(self._sources(source).items())])
            self._done[key] = content_digest(content.encode())
        return self._done[key]

    def _sources(self, source: Provenance) -> dict[str, str]:
        """Return the digest of each source of a component, by names that do not depend on the place of the files.

        Of a package imported only as the parent of another module the text alone counts, without imports and data.
        """
        digests: dict[str, str] = {}
        own = source.module if source.distribution else ""  # the name of a single file depends on its place
        waiting = [(own, True), *((parent, False) for parent in _parents(own))]
        visited: set[tuple[str, bool]] = set()
        while waiting:
            name, whole = waiting.pop()
            top = name.partition(".")[0]
            if (name, whole) in visited or top in sys.stdlib_module_names or top in {"percuss", *COMPUTING_PACKAGES}:
                continue
            visited.add((name, whole))
            path = Path(source.file) if name == own else file_of_module(name)
            if path is None:
                continue
            if top != own.partition(".")[0] and _installed(str(path)):
                names = _distributions().get(top, [])
                digests[f"package {top}"] = ", ".join(f"{one} {installed_version(one)}" for one in names) or "?"
                continue
            try:
                content = path.read_bytes()
            except OSError:
                digests[name] = "cannot be read"
                continue
            _refuse_edited(name, path, content)
            digests[name] = content_digest(content)
            if whole and path.suffix == ".py":
                in_package = path.name == "__init__.py"
                package = name if in_package else name.rpartition(".")[0]
                imports, texts = imports_and_texts(content, package)
                for data in data_files(path, texts, in_package=in_package or bool(package)):
                    digests[f"{name}: {data.name}"] = _data_digest(data)
                waiting += _modules(imports)
        return digests


def _parents(name: str) -> list[str]:
    """Return the names of the parent packages of a module, outermost first."""
    parts = name.split(".")
    return [".".join(parts[:n]) for n in range(1, len(parts))]


def _modules(imports: Iterable[ImportStatement]) -> Iterator[tuple[str, bool]]:
    """Yield the modules that import statements may load, and their parent packages, of which the text alone counts."""
    for statement in imports:
        parts = [f"{statement.module}.{part}" for part in statement.parts]
        submodules = [part for part in parts if file_of_module(part) is not None]
        # A part that is not a module is a name defined in the package, so the package itself counts.
        names = submodules if submodules and len(submodules) == len(parts) else [statement.module, *parts]
        for name in filter(None, names):
            yield name, True
            yield from ((parent, False) for parent in _parents(name))


@functools.lru_cache(maxsize=256)
def imports_and_texts(content: bytes, package: str) -> tuple[tuple[ImportStatement, ...], tuple[str, ...]]:
    """Return the imports of a source and the short texts in it; both are empty if it is not valid Python.

    They are kept in the user's cache folder, as to find them takes a good part of a short run.
    """
    facts = package, sys.version, _source_of(__name__)
    name = content_digest(b"\0".join([content, *map(str.encode, facts)])) + ".found"
    stored = kept(name)
    if stored is not None:
        imports, texts = json.loads(stored)
        return tuple(ImportStatement(line, module, tuple(parts)) for line, module, parts in imports), tuple(texts)
    found = _parsed(content, package)
    keep(name, json.dumps(found).encode())
    return found


def _parsed(content: bytes, package: str) -> tuple[tuple[ImportStatement, ...], tuple[str, ...]]:
    """Return the imports of a source and the short texts in it; both are empty if it is not valid Python."""
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError, RecursionError):
        return (), ()
    imports: list[ImportStatement] = []
    texts: dict[str, None] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [name for alias in node.names for name in (alias.name, *_parents(alias.name))]
            imports += [ImportStatement(node.lineno, name) for name in names]
        elif isinstance(node, ast.ImportFrom):
            base = _absolute("." * node.level + (node.module or ""), package)
            imports.append(ImportStatement(node.lineno, base, tuple(alias.name for alias in node.names)))
        elif isinstance(node, ast.Call) and _is_import(node.func):
            arguments = [arg.value for arg in node.args if isinstance(arg, ast.Constant) and isinstance(arg.value, str)]
            imports += [ImportStatement(node.lineno, _absolute(name, package)) for name in arguments[:1]]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and 0 < len(node.value) < 200:
            texts[node.value] = None
    return tuple(imports), tuple(texts)


def _is_import(function: ast.expr) -> bool:
    """Return whether a called function imports a module by its name."""
    name = getattr(function, "attr", getattr(function, "id", ""))
    return name in {"import_module", "__import__"}


def _absolute(name: str, package: str) -> str:
    """Return the full name of a module whose name may be relative to a package."""
    level = len(name) - len(name.lstrip("."))
    if not level:
        return name
    parents = package.split(".")
    above = parents[: len(parents) - level + 1]
    return ".".join(filter(None, [*above, name[level:]]))


def file_of_module(name: str) -> Path | None:
    """Return the file of a module as imported, or else where Python would find it; None if there is none."""
    module = sys.modules.get(name)
    file = _file_on_path(name) if module is None else getattr(module, "__file__", None)
    return Path(file) if isinstance(file, str) and Path(file).is_file() else None


def _file_on_path(name: str) -> str | None:
    """Return the file of a module that is not imported yet, without importing its parent packages."""
    parent, _, _ = name.rpartition(".")
    search: list[str] | None = None
    if parent:
        package = sys.modules.get(parent)
        search = list(getattr(package, "__path__", [])) if package is not None else None
        if search is None:
            parent_file = file_of_module(parent)
            if parent_file is None or parent_file.name != "__init__.py":
                return None
            search = [str(parent_file.parent)]
    for finder in sys.meta_path:
        try:
            spec = finder.find_spec(name, search)
        except Exception:  # noqa: BLE001, S112 - finders of other packages may raise anything
            continue
        if spec is not None:
            return spec.origin if spec.origin not in {"built-in", "frozen"} else None
    return None


def data_files(path: Path, texts: Sequence[str], *, in_package: bool) -> list[Path]:
    """Return the data files that a source may read: those named in its texts and, in a package, all in its folder."""
    folder = path.parent
    single = (folder / text for text in texts if "/" not in text.strip("/") and text.strip("./"))
    folders = [folder, *filter(is_folder, single)]
    named = (parent / text for parent in folders for text in texts if not text.endswith(".py"))
    found = set(filter(is_file, named))
    if in_package and (folder / "__init__.py").is_file():
        data = (entry for entry in folder.rglob("*") if entry.suffix not in {".py", ".pyc", ".nbi", ".nbc"})
        found |= {entry for entry in data if entry.is_file() and "__pycache__" not in entry.parts}
    return sorted(found)


def _data_digest(path: Path) -> str:
    """Return the digest of a data file, or size and modification time of a large one."""
    try:
        state = path.stat()
        if state.st_size > LARGE:
            return f"{state.st_size} bytes, {state.st_mtime_ns}"
        return content_digest(path.read_bytes())
    except OSError:
        return "cannot be read"
