"""Where components come from, and which plug-ins were left out."""

from __future__ import annotations

import os
from dataclasses import dataclass


@dataclass(frozen=True)
class Provenance:
    """Where a component is from.

    Attributes
    ----------
    distribution
        Name of the installed distribution; empty for a single file.
    version
        Version of the distribution; for a single file, the first digits of the SHA-256 of it and of helpers beside it.
    module, file
        That define the class.
    """

    distribution: str
    version: str
    module: str
    file: str

    @property
    def label(self) -> str:
        """Distribution and version, or the file."""
        return f"{self.distribution} {self.version}" if self.distribution else shown(self.file)

    def __str__(self) -> str:
        return f"{self.label} ({self.module if self.distribution else self.version})"


@dataclass(frozen=True)
class Broken:
    """A plug-in, or a part of one, that was left out: whose, why, and ``file:line`` as far as known."""

    source: str
    error: str
    file: str

    def __str__(self) -> str:
        return f"{self.source}: {self.error}" + (f" [{shown(self.file)}]" if self.file else "")


def shown(file: str) -> str:
    """Return a path for people: below the home folder it starts with ``~``."""
    home = os.path.expanduser("~")  # noqa: PTH111  Path.home raises where there is none
    return "~" + file[len(home) :] if home != os.sep and file.startswith(home + os.sep) else file
