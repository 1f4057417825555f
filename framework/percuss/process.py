"""The process of the command line: crashes, letters that a stream lacks, and processes that it starts.

It is prepared before anything that takes long is imported, so that this module imports little itself.
"""

from __future__ import annotations

import faulthandler
import io
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

INTERRUPTED = 130  # exit code of a command that Ctrl-C ended


def begin() -> None:
    """Prepare this process for a command."""
    faulthandler.enable(2, all_threads=False)  # a plug-in that crashes this process is named
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


@contextmanager
def processes_with(variables: Mapping[str, str]) -> Iterator[None]:
    """Set variables of the environment for the processes that start inside this context."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
