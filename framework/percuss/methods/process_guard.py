"""Guards around a process that runs plug-ins: what they print, and their attempts to end the process."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from percuss.files import PACKAGE
from percuss.methods.blame import line_in_plugin, running_line

__all__ = [
    "STANDSTILL",
    "exit_text",
    "guarded_output",
    "plug_ins_cannot_exit",
    "process_as_before",
    "tell_standstill",
    "where_is",
]

STANDSTILL = 10.0  # seconds without a completed step after which the line of the plug-in is named

# Nothing in this folder prints: text that appears to come from here comes from a compiled kernel.
KERNELS_RUN_IN = str(PACKAGE / "solver")
COMPILED = "a compiled kernel (NUMBA_DISABLE_JIT=1 shows its line)"


class _Output:
    """Standard output from which the text of plug-ins is passed on to standard error.

    Parameters
    ----------
    real
        The standard output.
    shown
        Whether the text of plug-ins is passed on; otherwise it is left out.
    """

    def __init__(self, real: Any, *, shown: bool) -> None:
        self._real, self._shown = real, shown
        self.places: dict[str, None] = {}

    def write(self, text: str) -> int:
        """Write a text to standard output, or to standard error if a plug-in wrote it."""
        caller = sys._getframe(1)
        place = running_line(caller)
        if not place and caller.f_code.co_filename.startswith(KERNELS_RUN_IN):
            place = COMPILED
        if not place:
            return self._real.write(text)  # type: ignore[no-any-return]
        if place not in self.places:
            self.places[place] = None
            fate = "it is shown here" if self._shown else "its text is left out"
            print(f"note: {place} prints to standard output, which is for results; {fate}", file=sys.stderr)
        return sys.stderr.write(text) if self._shown else len(text)

    def close(self) -> None:
        """Leave the standard output open: what follows is printed there."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real, name)


@contextmanager
def guarded_output(*, shown: bool = True) -> Iterator[None]:
    """Keep what plug-ins print inside this context from standard output; name each line of code that prints once.

    Parameters
    ----------
    shown
        Whether their text goes to standard error; otherwise it is left out.
    """
    if isinstance(sys.stdout, _Output):
        yield
        return
    with contextlib.redirect_stdout(_Output(sys.stdout, shown=shown)):
        yield


@contextmanager
def plug_ins_cannot_exit() -> Iterator[None]:
    """Raise SystemExit where a plug-in calls `os._exit` inside this context: it can be caught and has a place."""
    real = os._exit

    def exit_process(status: int) -> None:
        if running_line(sys._getframe(1)):
            raise SystemExit(status)
        real(status)

    os._exit = exit_process  # type: ignore[assignment]
    try:
        yield
    finally:
        os._exit = real


@contextmanager
def process_as_before() -> Iterator[None]:
    """Put back what the import of a plug-in inside this context changes in this process: streams, depth of calls."""
    streams, depth = (sys.stdin, sys.stdout, sys.stderr), sys.getrecursionlimit()
    try:
        yield
    finally:
        sys.setrecursionlimit(depth)
        sys.stdin, sys.stdout, sys.stderr = streams


def exit_text(error: SystemExit) -> str:
    """Return the message for a plug-in that ends the process, with its place, or an empty text if no plug-in does."""
    where = line_in_plugin(error)
    return f"{where}: a plug-in ends the process ({error.code!r}): raise an error instead" if where else ""


def where_is(thread: int) -> str:
    """Return the line of a plug-in at which a thread is, or a text for compiled kernels, else an empty text."""
    frame = sys._current_frames().get(thread)
    if frame is None:
        return ""
    in_solver = Path(frame.f_code.co_filename).is_relative_to(KERNELS_RUN_IN)
    return running_line(frame) or (COMPILED if in_solver else "")


def tell_standstill() -> None:
    """Say on standard error in which line of a plug-in the work of the main thread stands still, if it is in one."""
    if place := where_is(threading.main_thread().ident or 0):
        message = f"note: no step has been completed for {STANDSTILL:g} s; the work is in {place}; Ctrl-C ends it"
        print(message, file=sys.stderr, flush=True)
