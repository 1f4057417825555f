"""The threads that share out the loops over large bodies: OpenMP's, by the public interface of numba.

They are launched when they are first asked for, as a process that has launched them may not fork: a child of such a
process has one. Each sum is made by one thread in its one order, so that the bits do not depend on how many there are.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from percuss.errors import wrong_input

NO_LAYER = "numba has no threads here that several threads of Python may use: install OpenMP (libgomp) or tbb"
FORKED = "a forked process has one thread"

PARTS = 64  # of the steps, after each of which threads are compared with one
FEW = 8  # steps, of which one alone would take too long

_FORKED = threading.Event()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_FORKED.set)


def why_one() -> str:
    """Return why there is one thread alone in this process; empty where there are more, which are launched."""
    import numba

    if _FORKED.is_set():
        return FORKED
    # That of numba itself ends the process where two threads of Python use it at once.
    numba.config.THREADING_LAYER = "threadsafe"
    try:
        # It launches the threads, without which machine code with their loops cannot be loaded.
        numba.get_num_threads()
    except ValueError:
        return NO_LAYER
    # Others have launched them before, by the setting of numba that they had.
    return NO_LAYER if numba.threading_layer() == "workqueue" else ""


def most() -> int:
    """Return how many threads there may be: NUMBA_NUM_THREADS of the environment, or as many as there are cores."""
    try:
        import numba
    except ValueError:
        found = os.environ.get("NUMBA_NUM_THREADS")
        raise wrong_input("NUMBA_NUM_THREADS", f"expected a number of at least 1, found {found}") from None
    return int(numba.config.NUMBA_NUM_THREADS)


def number_of_threads(given: int | None) -> int:
    """Return how many threads a run is given, as many as there may be if nobody says; refuse fewer than 1 and more."""
    there = most()
    if given is None or (type(given) is int and 1 <= given <= there):
        return given or there
    advice = "There are as many as cores, or as NUMBA_NUM_THREADS of the environment says."
    raise wrong_input("--threads", f"expected a whole number from 1 to {there}, found {given!r}", advice)


@contextmanager
def limited_to(count: int) -> Iterator[None]:
    """Share out the loops of this thread of Python among `count` threads inside this context."""
    import numba

    before = numba.get_num_threads()
    numba.set_num_threads(count)
    try:
        yield
    finally:
        numba.set_num_threads(before)


def made_faster(count: int, threads: int, advance: Callable[[int, int], int]) -> int:
    """Make steps by some threads or by one, whichever is faster; return how many were made before one failed.

    Threads wait for each other in each step: where other programs hold the cores, one thread alone is several times as
    fast. So one thread makes the first part of the steps, and all of them go on until they have lost the time of a part
    against it. Threads alone make a few steps.

    Parameters
    ----------
    count
        Number of steps.
    threads
        How many threads there are.
    advance
        Makes the steps from a first number up to another, and returns how many it made before one failed.
    """
    part, done, alone, lost = max(1, count // PARTS), 0, math.inf, 0.0
    by = 1 if count >= FEW else threads
    while True:
        stop, began = min(done + part, count), time.perf_counter()
        with limited_to(by):
            made = advance(done, stop)
        seconds = time.perf_counter() - began
        if made < stop - done or stop == count:
            return done + made
        done = stop
        if by == 1:
            by, alone = threads, seconds
        else:
            lost += seconds - alone
        if lost > alone:
            by, part = 1, count
