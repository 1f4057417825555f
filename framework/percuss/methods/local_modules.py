"""Helper modules that a single-file plug-in imports from its folder, or from the import path outside installations.

Python imports a module once per process, and recognises outdated bytecode only if the source has another size or was
written in another second. After an edit of a helper between two runs Python might therefore run the old one. To prevent
this, the contents of helpers count as part of the plug-in.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import importlib.machinery
import importlib.util
import os
import site
import sys
import sysconfig
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

__all__ = ["companions", "importing", "installed", "managed_modules"]

IGNORED = {*sys.stdlib_module_names, "percuss", "percuss_methods"}
MOST_HELPERS = 200  # A plug-in with more of them is part of a larger program, and the rest are not followed.

_CONTENTS: dict[str, bytes] = {}  # content of each helper by the name of its module, as last imported


def companions(file: Path, content: bytes) -> dict[Path, tuple[str, bytes]]:
    """Return the helpers that a plug-in imports, directly or through another helper: path -> (module name, content).

    Parameters
    ----------
    file, content
        Path and content of the plug-in.
    """
    helpers: dict[Path, tuple[str, bytes]] = {}
    waiting = [(name, file.parent) for name in _imported(content, "")]
    while waiting and len(helpers) < MOST_HELPERS:
        name, folder = waiting.pop()
        path = _located(name, folder)
        if path is None or path == file or path in helpers:
            continue
        with contextlib.suppress(OSError):
            text = path.read_bytes()
            helpers[path] = (name, text)
            package = name if path.name == "__init__.py" else name.rpartition(".")[0]
            waiting += [(imported, folder) for imported in _imported(text, package)]
    return dict(sorted(helpers.items()))


@functools.lru_cache(maxsize=256)
def _imported(content: bytes, package: str) -> tuple[str, ...]:
    """Return the modules, except `IGNORED`, that a source in a package may import; none if it is not valid Python."""
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError, RecursionError):
        return ()
    names: dict[str, None] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= dict.fromkeys(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = package.split(".")
            parent = ".".join(parents[: len(parents) - node.level + 1]) if node.level else ""
            base = ".".join(filter(None, (parent, node.module)))
            names |= dict.fromkeys([base, *(f"{base}.{alias.name}" for alias in node.names)])
    # Python imports the parent packages of a module along with it.
    with_parents = {".".join(name.split(".")[:n]) for name in names for n in range(1, name.count(".") + 2)}
    return tuple(name for name in sorted(with_parents) if name and name.partition(".")[0] not in IGNORED)


def _located(name: str, folder: Path) -> Path | None:
    """Return the file of a module beside a plug-in or on the import path, or None if it is installed or not found."""
    parts = name.split(".")
    for root in (folder, *(Path(entry or ".") for entry in sys.path)):
        base = root.joinpath(*parts)
        for path in (base / "__init__.py", base.with_name(f"{base.name}.py")):
            if path.is_file():
                resolved = path.resolve()
                return resolved if root is folder or not _is_installed(resolved) else None
    return None


@functools.cache
def _installations() -> tuple[Path, ...]:
    """Return the folders of Python and of installed distributions, with symbolic links resolved."""
    paths = [*sysconfig.get_paths().values(), *site.getsitepackages(), site.getusersitepackages()]
    return tuple(Path(path).resolve() for path in dict.fromkeys(paths) if Path(path) != Path(sys.prefix))


def _is_installed(path: Path) -> bool:
    """Return whether a path, with symbolic links resolved, lies in a folder of installations."""
    return any(path.is_relative_to(folder) for folder in _installations())


@functools.cache
def _installed_prefixes() -> tuple[str, ...]:
    """Return the beginnings of the paths of installed files, with symbolic links resolved and as configured."""
    resolved = {str(path) for folder in _installations() for path in (folder, Path(os.path.abspath(folder)))}  # noqa: PTH100
    configured = {str(Path(path)) for path in (*sysconfig.get_paths().values(), *site.getsitepackages())}
    return tuple(f"{folder}{os.sep}" for folder in (resolved | configured) - {str(Path(sys.prefix))})


def installed(file: str) -> bool:
    """Return whether a file belongs to Python or to an installed distribution, editable ones excluded."""
    return file.startswith(_installed_prefixes())


def managed_modules() -> Mapping[str, bytes]:
    """Return the names and contents of the helper modules, which are imported again after an edit."""
    return _CONTENTS


@contextlib.contextmanager
def importing(helpers: Mapping[Path, tuple[str, bytes]]) -> Iterator[None]:
    """Import helpers from source inside this context, and import all of them again if one has changed."""
    if not helpers:
        yield
        return
    paths = {name: path for path, (name, _) in helpers.items()}
    # A module keeps the names that it imported from another one, so after a change all helpers are imported again.
    if any(_CONTENTS.get(name) not in {None, content} for name, content in helpers.values()):
        for name in paths:
            sys.modules.pop(name, None)
    _CONTENTS.update(helpers.values())
    finder = _FromSource(paths)
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)


class _Loader(importlib.machinery.SourceFileLoader):
    """A loader that ignores bytecode, which survives an edit of the source within one second that keeps its size."""

    def path_stats(self, path: Any) -> Any:
        """Raise OSError, so that Python takes bytecode to be unusable."""
        raise OSError(path)


class _FromSource:
    """A finder for the helpers of a plug-in; it gives only files that the import path would give too."""

    def __init__(self, paths: Mapping[str, Path]) -> None:
        self.paths = paths

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Return the import spec of a helper, or None for any other module or if Python would find another file."""
        file = self.paths.get(name)
        usual = importlib.machinery.PathFinder.find_spec(name, path, target) if file is not None else None
        if file is None or usual is None or usual.origin is None or Path(usual.origin).resolve() != file:
            return None
        inside = [str(file.parent)] if file.name == "__init__.py" else None
        loader = _Loader(name, usual.origin)
        return importlib.util.spec_from_file_location(
            name, usual.origin, loader=loader, submodule_search_locations=inside
        )
