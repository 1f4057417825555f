"""The threads that share out the loops over large bodies: OpenMP's, by the public interface of numba.

They are launched when they are first asked for, as a process that has launched them may not fork: a child of such a
process has one. Each sum is made by one thread in its one order, so that the bits do not depend on how many there are.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

NO_LAYER = "numba has no threads here that several threads of Python may use: install OpenMP (libgomp) or tbb"
FORKED = "a forked process has one thread"

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
    return ""


def most() -> int:
    """Return how many threads there may be: NUMBA_NUM_THREADS of the environment, or as many as there are cores."""
    import numba

    return int(numba.config.NUMBA_NUM_THREADS)


@contextmanager
def limited_to(count: int) -> Iterator[None]:
    """Share out the loops of this thread of Python among `count` threads inside this context, where there are more."""
    import numba

    if count < 2:
        yield
        return
    before = numba.get_num_threads()
    numba.set_num_threads(min(count, most()))
    try:
        yield
    finally:
        numba.set_num_threads(before)
