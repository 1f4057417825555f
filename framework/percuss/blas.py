"""One thread of BLAS: with several, the last digits of eigenvalues and of long sums depend on how many there are."""

from __future__ import annotations

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
PACKAGES = ("numpy", "scipy.linalg")  # each brings a library of its own


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
        self._libraries: list[Any] = []
        self._imported: list[str] = []

    def begin(self) -> None:
        with self.lock:
            if self.users == 0:
                self.before = []
            for library in self._found()[len(self.before) :]:  # those that came with an import are the last
                self.before.append((library, library.get_num_threads()))
                _set_threads(library, 1)
            self.users += 1

    def end(self) -> None:
        with self.lock:
            self.users -= 1
            if self.users == 0:
                for library, threads in self.before:
                    _set_threads(library, threads)

    def _found(self) -> list[Any]:
        """Return the libraries of BLAS in this process, which is searched again where it has imported another one."""
        imported = [package for package in PACKAGES if package in sys.modules]
        if imported != self._imported:
            from threadpoolctl import ThreadpoolController

            self._imported = imported
            known = {library.filepath for library in self._libraries}
            controllers = ThreadpoolController().select(user_api="blas").lib_controllers
            self._libraries += [library for library in controllers if library.filepath not in known]
        return self._libraries


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
