"""The modules that a single-file plug-in imports from beside it, or from elsewhere on the path outside installations.

Python imports a module once a process, and trusts bytecode by the second in which its source was written. Someone who
edits a helper between two runs would get the old one: so their contents count as part of the plug-in.
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

__all__ = ["companions", "importing", "installed", "managed"]

IGNORED = {*sys.stdlib_module_names, "percuss", "percuss_methods"}
MOST = 200  # files of all companions: more is a program that a plug-in is part of, and no helper

_CONTENTS: dict[str, bytes] = {}  # of each companion by the name of its module, as it was last imported


def companions(file: Path, content: bytes) -> dict[Path, tuple[str, bytes]]:
    """Return module name and content of every helper that a plug-in imports, and those that they import.

    Parameters
    ----------
    file, content
        The plug-in.
    """
    found: dict[Path, tuple[str, bytes]] = {}
    waiting = [(name, file.parent) for name in _imported(content, "")]
    while waiting and len(found) < MOST:
        name, folder = waiting.pop()
        path = _located(name, folder)
        if path is None or path == file or path in found:
            continue
        with contextlib.suppress(OSError):
            text = path.read_bytes()
            found[path] = (name, text)
            package = name if path.name == "__init__.py" else name.rpartition(".")[0]
            waiting += [(one, folder) for one in _imported(text, package)]
    return dict(sorted(found.items()))


@functools.lru_cache(maxsize=256)
def _imported(content: bytes, package: str) -> tuple[str, ...]:
    """Return the modules that a text may import, of a package that it is in; none where it is no Python."""
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
            above = ".".join(parents[: len(parents) - node.level + 1]) if node.level else ""
            base = ".".join(filter(None, (above, node.module)))
            names |= dict.fromkeys([base, *(f"{base}.{alias.name}" for alias in node.names)])
    # a package is imported with its parts
    whole = {".".join(name.split(".")[:n]) for name in names for n in range(1, name.count(".") + 2)}
    return tuple(name for name in sorted(whole) if name and name.partition(".")[0] not in IGNORED)


def _located(name: str, folder: Path) -> Path | None:
    """Return the file of a module, beside a plug-in or on the path; None for what is installed or cannot be found."""
    parts = name.split(".")
    for root in (folder, *(Path(one or ".") for one in sys.path)):
        base = root.joinpath(*parts)
        for path in (base / "__init__.py", base.with_name(f"{base.name}.py")):
            if path.is_file():
                resolved = path.resolve()
                return resolved if root is folder or not _is_installed(resolved) else None
    return None


@functools.cache
def _installations() -> tuple[Path, ...]:
    paths = [*sysconfig.get_paths().values(), *site.getsitepackages(), site.getusersitepackages()]
    return tuple(Path(one).resolve() for one in dict.fromkeys(paths) if Path(one) != Path(sys.prefix))


def _is_installed(path: Path) -> bool:
    return any(path.is_relative_to(one) for one in _installations())


@functools.cache
def _installed_prefixes() -> tuple[str, ...]:
    paths = {str(path) for one in _installations() for path in (one, Path(os.path.abspath(one)))}  # noqa: PTH100
    given = {str(Path(one)) for one in (*sysconfig.get_paths().values(), *site.getsitepackages())}
    return tuple(f"{one}{os.sep}" for one in (paths | given) - {str(Path(sys.prefix))})


def installed(file: str) -> bool:
    """Return whether a file belongs to Python or to an installed distribution that is not an editable one."""
    return file.startswith(_installed_prefixes())


def managed() -> Mapping[str, bytes]:
    """Return the modules that are imported anew when they are edited, with their contents."""
    return _CONTENTS


@contextlib.contextmanager
def importing(found: Mapping[Path, tuple[str, bytes]]) -> Iterator[None]:
    """Import a plug-in here: helpers that are not what they were are imported anew, all from their source."""
    if not found:
        yield
        return
    paths = {name: path for path, (name, _) in found.items()}
    # a module keeps what it took from another: where one has changed, all are imported anew
    if any(_CONTENTS.get(name) not in {None, content} for name, content in found.values()):
        for name in paths:
            sys.modules.pop(name, None)
    _CONTENTS.update(found.values())
    finder = _FromSource(paths)
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)


class _Loader(importlib.machinery.SourceFileLoader):
    """Loads a module without bytecode, which an edit within the second that keeps the size would not replace."""

    def path_stats(self, path: Any) -> Any:
        """Say that there is nothing to compare bytecode with."""
        raise OSError(path)


class _FromSource:
    """Finds the helpers of a plug-in, where the path would find them too."""

    def __init__(self, paths: Mapping[str, Path]) -> None:
        self.paths = paths

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Return how a helper is loaded, None for any other module or where Python would not find it there."""
        file = self.paths.get(name)
        usual = importlib.machinery.PathFinder.find_spec(name, path, target) if file is not None else None
        if file is None or usual is None or usual.origin is None or Path(usual.origin).resolve() != file:
            return None
        inside = [str(file.parent)] if file.name == "__init__.py" else None
        loader = _Loader(name, usual.origin)
        return importlib.util.spec_from_file_location(
            name, usual.origin, loader=loader, submodule_search_locations=inside
        )
