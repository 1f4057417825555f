"""Lock around compilation and work done once per process, and a clock that measures the compile time.

Numba compiles under a lock of its own, but binding kernels before compilation, and querying the compiler about them, is
not safe when several threads do it at once. The clock listens to numba's lock, so that it counts every function that is
compiled or loaded from disk, for the time loop, a certificate or an exact solution.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from percuss.heartbeat import beat

LOCK = threading.RLock()
# These callbacks are called with True when numba begins to compile a function, and with False when it has finished.
# They are not called for functions loaded from disk.
NOTICES: list[Callable[[bool], None]] = []


class _Clock(threading.local):
    """Compile-time clock of each thread: seconds spent so far, and nesting depth of the sections being counted."""

    seconds = 0.0
    depth = 0
    since = 0.0

    def start(self) -> None:
        if self.depth == 0:
            self.since = time.perf_counter()
        self.depth += 1

    def stop(self) -> None:
        # A listener registered while numba's lock is held gets the end event of that section without its start event.
        if self.depth == 0:
            return
        self.depth -= 1
        if self.depth == 0:
            self.seconds += time.perf_counter() - self.since


_CLOCK = _Clock()
_LISTENERS: list[Any] = []


def compile_seconds() -> float:
    """Return the seconds that this thread has spent compiling so far, or waiting for another thread to compile.

    The difference of two readings is the time spent in between.
    """
    listen()
    clock = _CLOCK
    return clock.seconds + (time.perf_counter() - clock.since if clock.depth else 0.0)


class Stopwatch:
    """A stopwatch for the parts of a run that measures compile time separately."""

    def __init__(self) -> None:
        self.began = self._lap_began = time.perf_counter()
        self._compiled_before = self._lap_compiled = compile_seconds()

    def lap(self) -> float:
        """Return the seconds since the last call that were not spent compiling."""
        now, compiled = time.perf_counter(), compile_seconds()
        seconds = (now - self._lap_began) - (compiled - self._lap_compiled)
        self._lap_began, self._lap_compiled = now, compiled
        return max(seconds, 0.0)

    def compiled(self) -> float:
        """Return the seconds spent compiling since the beginning."""
        return compile_seconds() - self._compiled_before

    def total(self) -> float:
        """Return the seconds since the beginning, compile time included."""
        return time.perf_counter() - self.began


@contextmanager
def counted() -> Iterator[None]:
    """Count the time spent inside this context as compile time."""
    listen()
    _CLOCK.start()
    try:
        yield
    finally:
        _CLOCK.stop()


@contextmanager
def announced() -> Iterator[None]:
    """Call `NOTICES` as for a compilation: this context waits for another process that compiles."""
    for notice in NOTICES:
        notice(True)
    try:
        yield
    finally:
        for notice in NOTICES:
            notice(False)


@contextmanager
def compiler() -> Iterator[None]:
    """Hold the lock inside this context; the time, including the wait for the lock, counts as compile time."""
    with counted(), LOCK:
        yield


def listen() -> None:
    """Register, once numba is imported, the listeners that run the clock and call `NOTICES`."""
    if _LISTENERS or "numba.core.event" not in sys.modules:
        return
    with LOCK:
        if _LISTENERS:
            return
        from numba.core import event

        class Listener(event.Listener):  # type: ignore[misc]
            """The listener that runs a thread's clock while numba compiles or loads a function in that thread."""

            def on_start(self, event: Any) -> None:  # noqa: ARG002
                """Start the clock."""
                beat()
                _CLOCK.start()

            def on_end(self, event: Any) -> None:  # noqa: ARG002
                """Stop the clock."""
                beat()
                _CLOCK.stop()

        class Announcer(event.Listener):  # type: ignore[misc]
            """The listener that calls `NOTICES` when numba compiles a function together with those it calls."""

            depth = 0

            def on_start(self, event: Any) -> None:  # noqa: ARG002
                """Announce the start of the outermost function; a notice that raises an error ends it."""
                if self.depth == 0:
                    self.announce(begun=True)
                self.depth += 1

            def on_end(self, event: Any) -> None:  # noqa: ARG002
                """Announce the end of the outermost function."""
                self.depth -= 1
                if self.depth == 0:
                    self.announce(begun=False)

            def announce(self, *, begun: bool) -> None:
                """Call all `NOTICES`."""
                for notice in NOTICES:
                    notice(begun)

        _LISTENERS.extend([Listener(), Announcer()])
        event.register("numba:compiler_lock", _LISTENERS[0])
        event.register("numba:compile", _LISTENERS[1])
