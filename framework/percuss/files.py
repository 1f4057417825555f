"""Folder of the percuss package, and a context manager that writes a file completely or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from percuss.errors import InputError, Problem

PACKAGE = Path(__file__).parent  # folder of percuss's own modules


class replacing:  # noqa: N801 - named like a function because it is used in with statements
    """A context manager that gives a temporary path and, if no error occurs, renames that file to the target."""

    def __init__(self, path: str | os.PathLike[str], suffix: str) -> None:
        self.target = Path(path)
        self.suffix = suffix

    def __enter__(self) -> Path:
        folder = self.target.parent
        if not folder.is_dir():
            raise InputError(
                [Problem(str(self.target), "", f"expected a folder {folder}, found none", "Make it first.")]
            )
        if self.target.is_dir():
            raise InputError(
                [Problem(str(self.target), "", "expected a file to write, found a folder", "Name a file in it.")]
            )
        try:
            handle, name = tempfile.mkstemp(prefix=f".{self.target.name}.", suffix=self.suffix, dir=folder)
        except OSError as error:
            problem = Problem(str(self.target), "", f"cannot write here: {error.strerror}", "Name another folder.")
            raise InputError([problem]) from error
        os.close(handle)
        self.temporary = Path(name)
        return self.temporary

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        if kind is None:
            umask = os.umask(0)
            os.umask(umask)
            self.temporary.chmod(0o666 & ~umask)  # mkstemp makes a private file, but a result is an ordinary one.
            self.temporary.replace(self.target)
        else:
            self.temporary.unlink(missing_ok=True)
