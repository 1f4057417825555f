"""One thread of BLAS: with several, the last digits of eigenvalues and of long sums depend on how many there are."""

from __future__ import annotations

import functools
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

# Variables of the environment from which the libraries take their number of threads when they are loaded.
ONE_THREAD = {
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "BLIS_NUM_THREADS": "1",
    "VECLIB_MAXIMUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
}


class _Limit:
    """The limit of one thread, which is one for the whole process, however many threads of Python compute.

    Attributes
    ----------
    always
        Whether the process began with one thread of BLAS, so that nothing is left to do.
    users
        Number of computations that go on.
    before
        Libraries of BLAS, each with its number of threads before the first of these computations.
    """

    def __init__(self) -> None:
        self.always = False
        self.lock = threading.Lock()
        self.users = 0
        self.before: list[tuple[Any, int]] = []

    def begin(self) -> None:
        with self.lock:
            if self.users == 0:
                self.before = [(library, library.get_num_threads()) for library in _libraries()]
                for library in _libraries():
                    _set_threads(library, 1)
            self.users += 1

    def end(self) -> None:
        with self.lock:
            self.users -= 1
            if self.users == 0:
                for library, threads in self.before:
                    _set_threads(library, threads)


@functools.cache
def _libraries() -> list[Any]:
    """Return the libraries of BLAS in this process: NumPy and SciPy each bring one."""
    import scipy.linalg  # noqa: F401 - a limit holds for the libraries alone that are loaded before it is set
    from threadpoolctl import ThreadpoolController

    return list(ThreadpoolController().select(user_api="blas").lib_controllers)


_LIMIT = _Limit()


def _set_threads(library: Any, threads: int) -> None:
    """Set the number of threads of a library.

    The public method of a library does nothing in any thread of Python but the first that called it and still lives.
    Here the limit has one owner, which counts its users.
    """
    getattr(library, "_real_set_num_threads", library.set_num_threads)(threads)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let BLAS compute with one thread inside this context; also a decorator.

    The matrices are small, so that more threads cost time as well: most of all where other processes compute.
    """
    if _LIMIT.always:
        yield
        return
    _LIMIT.begin()
    try:
        yield
    finally:
        _LIMIT.end()


def start_with_one_blas_thread() -> None:
    """Let BLAS have one thread in this process, if NumPy is not imported yet, and in those that the process starts."""
    os.environ.update(ONE_THREAD)
    _LIMIT.always |= "numpy" not in sys.modules
