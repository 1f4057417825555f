"""Lock around compilation and work done once per process, and a clock that measures the compile time.

Numba compiles under a lock of its own, but binding kernels before compilation, and querying the compiler about them, is
not safe when several threads do it at once. The clock listens to numba's lock, so that it counts every function that is
compiled or loaded from disk, for the time loop, a certificate or an exact solution.
"""

from __future__ import annotations

import functools
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any, TypeAlias

from percuss.heartbeat import beat
from percuss.interrupt import interrupted_afterwards

Kernel: TypeAlias = Callable[..., Any]  # a function of the loop or of a method, compiled or in plain Python

LOCK = threading.RLock()
# These callbacks are called with True when numba begins to compile a function, and with False when it has finished.
# They are not called for functions loaded from disk.
NOTICES: list[Callable[[bool], None]] = []


class _Clock(threading.local):
    """Compile-time clock of each thread: seconds spent so far, nesting depth of the sections being counted, Ctrl-C."""

    seconds = 0.0
    depth = 0
    since = 0.0
    pressed: threading.Event | None = None  # set by Ctrl-C in a section: LLVM calls Python back and loses its errors

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


def compile_seconds() -> float:
    """Return the seconds that this thread has spent compiling so far, or waiting for another thread to compile.

    The difference of two readings is the time spent in between.
    """
    numba_inside()  # whose events the clock follows
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
def announced() -> Iterator[None]:
    """Call `NOTICES` as for a compilation: this context waits for another process that compiles."""
    _announce(begun=True)
    try:
        yield
    finally:
        _announce(begun=False)


@contextmanager
def compiler() -> Iterator[None]:
    """Hold the lock inside this context; the time, including the wait for the lock, counts as compile time."""
    numba_inside()  # whose events the clock follows
    _CLOCK.start()
    try:
        with LOCK, interrupted_afterwards() as pressed:
            before, _CLOCK.pressed = _CLOCK.pressed, _CLOCK.pressed or pressed
            try:
                yield
            finally:
                _CLOCK.pressed = before
    finally:
        _CLOCK.stop()


def _announce(*, begun: bool) -> None:
    """Call all `NOTICES`; one that raises an error ends the compilation."""
    for notice in NOTICES:
        notice(begun)


class _Compilation:
    """How many functions numba is compiling, each called by the one before."""

    depth = 0

    def changes(self, begun: bool) -> None:
        """Announce the start and the end of the outermost function."""
        if begun and self.depth == 0:
            _announce(begun=True)
        self.depth += 1 if begun else -1
        if not begun and self.depth == 0:
            _announce(begun=False)


def _numba_is_locked(begun: bool) -> None:
    """Run the clock while numba compiles or loads a function in this thread."""
    beat()
    if begun:
        if _CLOCK.pressed is not None and _CLOCK.pressed.is_set():  # numba does not hold its lock yet
            raise KeyboardInterrupt
        _CLOCK.start()
    else:
        _CLOCK.stop()


def numba_inside() -> ModuleType | None:
    """Return the names from inside numba (`percuss.numba_inside`), or None.

    None means that numba is not imported yet, or that this version of it is built otherwise. From the first call on
    that finds numba imported, the clock and `NOTICES` follow what it compiles.
    """
    # Its last names are there when it has been imported whole.
    return _numba_inside() if hasattr(sys.modules.get("numba"), "njit") else None


@functools.cache
def _numba_inside() -> ModuleType | None:
    try:
        from percuss import numba_inside
    except (ImportError, AttributeError):
        return None
    numba_inside.LOCKED.tell, numba_inside.COMPILED.tell = _numba_is_locked, _Compilation().changes
    return numba_inside
