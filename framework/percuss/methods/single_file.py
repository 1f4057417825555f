"""Single-file plug-ins: one Python file, given by its path."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

from percuss.digest import content_digest
from percuss.errors import PluginError, nearest, shortened
from percuss.files import found_instead
from percuss.methods.blame import PLUGIN_MODULES
from percuss.methods.provenance import Provenance, display_path


@dataclass(frozen=True)
class SingleFile:
    """A single-file plug-in as read; an edit makes another plug-in.

    Attributes
    ----------
    path, content
        Path of the file, with symbolic links resolved, and its content.
    given
        The path as the user wrote it.
    """

    path: Path
    content: bytes
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
            If the path is not a readable Python file.
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
        return cls(path, content, str(given))

    @property
    def digest(self) -> str:
        """SHA-256 of the file, in hexadecimal digits."""
        return content_digest(self.content)

    @property
    def source(self) -> Provenance:
        """Provenance of the plug-in, with a module name of its own for each path and content."""
        # The name depends on the content too, so that an edited file is a new module and the old one stays intact.
        unique = content_digest(f"{self.path}\0{self.digest}".encode())[:12]
        stem = re.sub(r"[^A-Za-z0-9_]", "_", self.path.stem)
        return Provenance("", self.digest[:12], f"percuss_file_{stem}_{unique}", str(self.path))

    def module(self) -> ModuleType:
        """Return the module of the file, which is imported once for each content."""
        name = self.source.module
        if name in sys.modules:
            return sys.modules[name]
        PLUGIN_MODULES.add(name)
        module = ModuleType(name)
        module.__file__ = str(self.path)
        sys.modules[name] = module  # Dataclasses and pickle look the module up there.
        # Python's own loader is not used: its bytecode cache misses an edit within one second that keeps the size.
        try:
            exec(compile(self.content, str(self.path), "exec", dont_inherit=True), vars(module))  # noqa: S102
        except BaseException:
            del sys.modules[name]
            raise
        return module
