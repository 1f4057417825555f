"""The process of the command line: crashes, letters that a stream lacks, and Ctrl-C where no work is under way.

It is prepared before anything that takes long is imported, so that this module imports little itself.
"""

from __future__ import annotations

import faulthandler
import io
import os
import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

INTERRUPTED = 130  # exit code of a command that Ctrl-C ended


def begin() -> None:
    """Prepare this process for a command."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end_at_once)
    faulthandler.enable(2, all_threads=False)  # a plug-in that crashes this process is named
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _end_at_once(number: int, frame: object) -> None:  # noqa: ARG001
    """End this process, which does no work that would have to be put in order, at Ctrl-C."""
    os.write(2, b"interrupted\n")
    os._exit(INTERRUPTED)


@contextmanager
def ctrl_c_raises() -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt inside this context, for work that leaves things in order when it ends."""
    before = signal.getsignal(signal.SIGINT)
    if before is not _end_at_once:
        yield
        return
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        yield
    finally:
        signal.signal(signal.SIGINT, before)


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
