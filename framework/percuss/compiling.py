"""One lock around all that compiles or is imported once a process, and one clock that counts the time it takes.

Numba compiles under a lock of its own, but what binds kernels before that, and what the compiler is asked about them,
is not safe from other threads. The clock listens to numba's lock, so that it counts every function that is compiled or
loaded from disk, whoever asked for it: the time loop, a certificate, or an exact solution.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["LOCK", "NOTICES", "Stopwatch", "compile_seconds", "compiler", "counted", "listen"]

LOCK = threading.RLock()
# Called with True when numba begins to translate a function, and with False when it is done; not for what is loaded
# from disk.
NOTICES: list[Callable[[bool], None]] = []


class _Clock(threading.local):
    """Of each thread: the seconds it has spent compiling, and how deep it is in what is counted."""

    seconds = 0.0
    depth = 0
    since = 0.0

    def start(self) -> None:
        if self.depth == 0:
            self.since = time.perf_counter()
        self.depth += 1

    def stop(self) -> None:
        # A listener may be registered while numba's lock is held: then its end is seen, and its beginning was not.
        if self.depth == 0:
            return
        self.depth -= 1
        if self.depth == 0:
            self.seconds += time.perf_counter() - self.since


_CLOCK = _Clock()
_LISTENING: list[Any] = []


def compile_seconds() -> float:
    """Return the seconds that this thread has spent compiling so far, or waiting for another one that compiles.

    The difference of two readings is what was spent in between.
    """
    listen()
    clock = _CLOCK
    return clock.seconds + (time.perf_counter() - clock.since if clock.depth else 0.0)


class Stopwatch:
    """Tells how long parts of a run take, without what is compiled meanwhile, which it tells apart."""

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
        """Return the seconds since the beginning, whatever they were spent on."""
        return time.perf_counter() - self.began


@contextmanager
def counted() -> Iterator[None]:
    """Count what is done here as compiling."""
    listen()
    _CLOCK.start()
    try:
        yield
    finally:
        _CLOCK.stop()


@contextmanager
def compiler() -> Iterator[None]:
    """Give this thread alone the compiler and what belongs to it, and count the time."""
    with counted(), LOCK:
        yield


def listen() -> None:
    """Have numba tell the clock when it takes and leaves its lock, as soon as numba is imported."""
    if _LISTENING or "numba.core.event" not in sys.modules:
        return
    with LOCK:
        if _LISTENING:
            return
        from numba.core import event

        class Listener(event.Listener):  # type: ignore[misc]
            """Tells the clock of the thread in which numba compiles or loads."""

            def on_start(self, event: Any) -> None:  # noqa: ARG002
                """Start the clock."""
                _CLOCK.start()

            def on_end(self, event: Any) -> None:  # noqa: ARG002
                """Stop the clock."""
                _CLOCK.stop()

        class Announcer(event.Listener):  # type: ignore[misc]
            """Gives notice of the translation of a function with all that it calls."""

            depth = 0

            def on_start(self, event: Any) -> None:  # noqa: ARG002
                """Give notice of the outermost function."""
                self.depth += 1
                if self.depth == 1:
                    self.give(begun=True)

            def on_end(self, event: Any) -> None:  # noqa: ARG002
                """Give notice that the outermost function is done."""
                self.depth -= 1
                if self.depth == 0:
                    self.give(begun=False)

            def give(self, *, begun: bool) -> None:
                """Call all who want to know."""
                for notice in NOTICES:
                    notice(begun)

        _LISTENING.extend([Listener(), Announcer()])
        event.register("numba:compiler_lock", _LISTENING[0])
        event.register("numba:compile", _LISTENING[1])
