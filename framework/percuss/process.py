"""The process of the command line: its standard streams, Ctrl-C where no work is under way, and its end.

It is prepared before anything that takes long is imported, so that this module imports little itself.
"""

from __future__ import annotations

import faulthandler
import functools
import io
import os
import signal
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

INTERRUPTED = 130  # exit code of a command that Ctrl-C ended
GRACE = 2.0  # seconds that threads have to end after the command has ended


@functools.cache
def begin() -> None:
    """Prepare this process for a command; a second call does nothing."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end_at_once)
    _open_closed_streams()
    faulthandler.enable(2, all_threads=False)  # a plug-in that crashes this process is named
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        # Where somebody else has put another stream in its place, as a test does, it is not ours to change.
        if stream is getattr(sys, f"__{name}__") and isinstance(stream, io.TextIOWrapper):
            replacement = _prepared(stream)
            setattr(sys, name, replacement)
            setattr(sys, f"__{name}__", replacement)


def _open_closed_streams() -> None:
    """Let standard streams that are closed lead to nowhere: no file that is opened later may take their place."""
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(descriptor)
        except OSError:
            _lead_nowhere(descriptor, inheritable=True)
        if getattr(sys, name) is None:
            stream = open(descriptor, "w" if descriptor else "r", encoding="utf-8", closefd=False)  # noqa: SIM115
            setattr(sys, name, stream)
            setattr(sys, f"__{name}__", stream)


def _lead_nowhere(descriptor: int, *, inheritable: bool) -> None:
    """Let a descriptor, open or closed, lead to nowhere."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    os.dup2(nowhere, descriptor)
    os.set_inheritable(descriptor, inheritable)
    if nowhere != descriptor:
        os.close(nowhere)


def _prepared(stream: io.TextIOWrapper) -> io.TextIOWrapper:
    """Return a stream instead of standard output or standard error that no letter and no reader can break."""
    if os.name != "posix":  # a console of Windows has a stream of its own
        stream.reconfigure(errors="backslashreplace")
        return stream
    stream.flush()
    descriptor = stream.fileno()
    if descriptor == 1:
        # Whatever writes to the descriptor itself, as a library in C does, writes to standard error.
        descriptor = os.dup(1)
        os.dup2(2, 1)
    return _Stream(
        io.BufferedWriter(_Descriptor(descriptor, "w", closefd=False)),
        encoding=stream.encoding,
        errors="backslashreplace",
        line_buffering=stream.line_buffering or stream.write_through,
    )


class _Stream(io.TextIOWrapper):
    """A standard stream that stays open whoever closes it."""

    def close(self) -> None:
        """Write what is left, and nothing else."""
        self.flush()


class _Descriptor(io.FileIO):
    """An open file whose text goes nowhere once its reader has closed the pipe, as `head` does: that is no error."""

    def write(self, data: Any, /) -> int:
        """Write some bytes; return how many."""
        try:
            return super().write(data)
        except BrokenPipeError:
            _lead_nowhere(self.fileno(), inheritable=os.get_inheritable(self.fileno()))
            return len(data)


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


def end_whatever_runs(code: int) -> None:
    """See to it that this process ends with an exit code, though a plug-in has started threads that Python waits for.

    Parameters
    ----------
    code
        The exit code.
    """
    running = _waited_for()
    if code == INTERRUPTED:
        # A pool of processes that is just ending disturbs the end of Python, which tells that as an error.
        for thread in running:
            thread.join(GRACE / len(running))
    if any(thread.is_alive() for thread in running):
        threading.Thread(target=_end_after_grace, args=(code,), daemon=True).start()


def _waited_for() -> list[threading.Thread]:
    """Return the threads that Python waits for at its end."""
    return [thread for thread in threading.enumerate() if thread is not threading.main_thread() and not thread.daemon]


def _end_after_grace(code: int) -> None:
    """End this process if it has not ended by itself after a while; tell which threads still run."""
    threading.Event().wait(GRACE)
    names = ", ".join(thread.name for thread in _waited_for())
    if not names:
        return
    print(f"note: the command is done, and what still runs ends with it: {names}", file=sys.stderr)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
