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
_FROM_THE_START = threading.Event()  # set where the process began with one thread, so that nothing is left to do


@functools.cache
def _libraries() -> Any:
    """Return what sets the number of threads of the libraries of BLAS: NumPy and SciPy each bring one."""
    import scipy.linalg  # noqa: F401 - a limit holds for the libraries alone that are loaded before it is set
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let BLAS compute with one thread inside this context; also a decorator.

    The matrices are small, so that more threads cost time as well: most of all where other processes compute. OpenBLAS
    obeys the thread of Python that was the first to limit it: runs in other threads may compute with several of BLAS.
    """
    if _FROM_THE_START.is_set():
        yield
        return
    with _libraries().limit(limits=1, user_api="blas"):
        yield


def start_with_one_blas_thread() -> None:
    """Let BLAS have one thread in this process, if NumPy is not imported yet, and in those that the process starts."""
    os.environ.update(ONE_THREAD)
    if "numpy" not in sys.modules:
        _FROM_THE_START.set()
