"""Origin of components, and plug-ins that were left out."""

from __future__ import annotations

import os
from dataclasses import dataclass

from percuss.digest import content_digest, source_digest


@dataclass(frozen=True)
class Provenance:
    """Origin of a component: its distribution or single file, and its module.

    Attributes
    ----------
    distribution
        Name of the installed distribution; empty for a single file.
    version
        Version of the distribution; for a single file, the first digits of the SHA-256 of the file and its data files.
    module, file
        Module and file that define the class.
    """

    distribution: str
    version: str
    module: str
    file: str

    @property
    def label(self) -> str:
        """Name and version of the distribution, or path of the single file."""
        return f"{self.distribution} {self.version}" if self.distribution else display_path(self.file)

    @property
    def digest(self) -> str:
        """SHA-256 of the version and the sources of its package, or of its single file."""
        sources = source_digest(self.file) if self.distribution else ""
        return content_digest(f"{self.version} {sources}".encode())

    def __str__(self) -> str:
        return f"{self.label} ({self.module if self.distribution else self.version})"


@dataclass(frozen=True)
class Broken:
    """A plug-in, or a part of one, that was left out: its label, the error, and ``file:line`` as far as known."""

    source: str
    error: str
    file: str

    def __str__(self) -> str:
        return f"{self.source}: {self.error}" + (f" [{display_path(self.file)}]" if self.file else "")


def display_path(file: str) -> str:
    """Return a path for display, in which ``~`` stands for the home folder."""
    home = os.path.expanduser("~")  # noqa: PTH111  Path.home raises if there is no home folder
    return "~" + file[len(home) :] if home != os.sep and file.startswith(home + os.sep) else file
