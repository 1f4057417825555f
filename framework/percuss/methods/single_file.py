"""Single-file plug-ins: one Python file, given by its path, with the data files that it names."""

from __future__ import annotations

import importlib.metadata
import json
import re
import sys
import urllib.parse
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

from percuss.errors import PluginError, nearest, shortened
from percuss.files import found_instead
from percuss.methods.provenance import Provenance, display_path
from percuss.methods.source_digest import content_digest, data_files, file_of_module, imports_and_texts, record_import

NEVER_BESIDE = {*sys.stdlib_module_names, "percuss", "percuss_methods"}


@dataclass(frozen=True)
class SingleFile:
    """A single-file plug-in as read, with its data files; an edit of any of them makes another plug-in.

    Attributes
    ----------
    path, content
        Path of the file, with symbolic links resolved, and its content.
    data
        Paths and contents of the data files that it names.
    given
        The path as the user wrote it.
    """

    path: Path
    content: bytes
    data: tuple[tuple[Path, bytes], ...]
    given: str = field(compare=False)

    @classmethod
    def read(cls, given: Path) -> SingleFile:
        """Return the single-file plug-in at a path.

        Parameters
        ----------
        given
            The path as the user wrote it.

        Raises
        ------
        PluginError
            If the path is not a readable Python file, or the file imports another one beside it.
        """
        try:
            path = given.expanduser().resolve()
            there = path.exists()
        except (OSError, RuntimeError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise PluginError(f"{shortened(str(given))}: this is not the path of a file: {reason}") from error
        if not there:
            near = nearest(path.name, [file.name for file in path.parent.glob("*.py")])
            advice = f". Did you mean '{near}'?" if near else ""
            raise PluginError(f"{given}: there is no such file in {display_path(str(path.parent))}{advice}")
        if path.suffix != ".py":
            raise PluginError(f"{given}: this is not a Python file, expected a name that ends in .py")
        if other := found_instead(path):
            raise PluginError(f"{given}: expected a Python file, found {other}")
        try:
            content = path.read_bytes()
        except OSError as error:
            raise PluginError(f"{given}: cannot be read: {error.strerror}") from error
        if beside := _modules_beside(path, content):
            lines = (
                f"{given}:{line}: imports '{name}' from beside it, and a single-file plug-in is one file: move what "
                "it needs into this file, or make a package of both, which `percuss new` begins"
                for name, line in beside.items()
            )
            raise PluginError("\n".join(lines))
        named = data_files(path, imports_and_texts(content, "")[1], in_package=False)
        data = tuple((file, file.read_bytes()) for file in named)
        return cls(path, content, data, str(given))

    @property
    def digest(self) -> str:
        """SHA-256 of the file and its data files, in hexadecimal digits."""
        return content_digest(b"\0".join([self.content, *(text for _, text in self.data)]))

    @property
    def source(self) -> Provenance:
        """Provenance of the plug-in, with a module name of its own for each path and content."""
        # The name depends on the content too, so that an edited file is a new module and the old one stays intact.
        unique = content_digest(f"{self.path}\0{self.digest}".encode())[:12]
        stem = re.sub(r"[^A-Za-z0-9_]", "_", self.path.stem)
        return Provenance("", self.digest[:12], f"percuss_file_{stem}_{unique}", str(self.path))

    @property
    def files(self) -> dict[str, bytes]:
        """Contents of the plug-in and of its data files that lie in its folder, by their paths from there."""
        folder = self.path.parent
        files = ((self.path, self.content), *self.data)
        return {str(path.relative_to(folder)): text for path, text in files if path.is_relative_to(folder)}

    def import_as(self, name: str) -> None:
        """Import the file as the module called `name`."""
        module = ModuleType(name)
        module.__file__ = str(self.path)
        sys.modules[name] = module  # Dataclasses and pickle look the module up there.
        record_import(name, self.content)
        before = sys.path.copy()
        try:
            # Python's own loader is not used: its bytecode cache misses an edit within one second that keeps the size.
            exec(compile(self.content, str(self.path), "exec", dont_inherit=True), vars(module))  # noqa: S102
        finally:  # What lies beside the file must not stand in for modules that anybody imports later.
            beside = self.path.parent
            sys.path[:] = [folder for folder in sys.path if folder in before or Path(folder).resolve() != beside]


def _modules_beside(path: Path, content: bytes) -> dict[str, int]:
    """Return the modules that a source imports from its folder, each with its first line, installed ones left out.

    Python imports a module once per process, so that an edit of such a module would not be seen by the next load.
    """
    folder = path.parent
    lines: dict[str, int] = {}
    for statement in sorted(imports_and_texts(content, "")[0]):
        for name in [statement.module] if statement.module else statement.parts:
            top = name.partition(".")[0]
            if top.isidentifier() and top not in NEVER_BESIDE and top not in lines and _is_beside(top, folder):
                lines[top] = statement.line
    return lines


def _is_beside(name: str, folder: Path) -> bool:
    """Return whether a folder holds a module that is not installed, and Python finds no other by the same name."""
    module, package = folder / f"{name}.py", folder / name
    if not module.is_file() and not any(package.glob("*.py")):
        return False
    file = file_of_module(name)
    elsewhere = file is not None and file.resolve() not in {module.resolve(), (package / "__init__.py").resolve()}
    return not elsewhere and folder not in _editable_folders()


def _editable_folders() -> set[Path]:
    """Return the folders in which distributions installed as editable have their modules."""
    folders: set[Path] = set()
    for distribution in importlib.metadata.distributions():
        origin = json.loads(distribution.read_text("direct_url.json") or "{}")
        if origin.get("dir_info", {}).get("editable"):
            from urllib.request import url2pathname  # imports much that only distributions installed so need

            root = Path(url2pathname(urllib.parse.urlparse(origin["url"]).path)).resolve()
            folders |= {root, root / "src"}
    return folders
