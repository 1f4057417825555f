"""Runs of a study in worker processes of this machine: one that dies or takes too long costs only its own run."""

from __future__ import annotations

import faulthandler
import functools
import logging
import os
import pickle
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from types import ModuleType
from typing import TYPE_CHECKING

from percuss.blas import ONE_THREAD
from percuss.errors import RunError, wrong_input
from percuss.jit import NOTICES
from percuss.process import processes_with
from percuss.studies.bench import Bench, Job
from percuss.studies.perform import LOST, WORKER, Record

if TYPE_CHECKING:
    from pebble import ProcessPool

LATE = 75  # exit code of a worker whose run has taken too long
MOST_RUNS = 1000  # of one process, which keeps the machine code of every kernel that it has met
SILENCE = 600.0  # seconds without an answer after which a run is named
LOG = logging.getLogger("percuss")  # without other settings Python prints its warnings on standard error
# The variable of Python's option -P, and what it is where the user has not set it.
SAFE_PATH, SET_HERE = "PYTHONSAFEPATH", "set by percuss"


class Workers:
    """Worker processes, which start with the first run and serve one study after the other; a context that ends them.

    Parameters
    ----------
    number
        Number of processes.
    """

    def __init__(self, number: int) -> None:
        self._number = number
        self._pool: ProcessPool | None = None

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.stop()  # type: ignore[no-untyped-call]
            self._pool.join()

    def made(
        self, longest: float | None, bench: Bench, jobs: Sequence[Job], stop: threading.Event
    ) -> Generator[list[Record]]:
        """Make runs, and yield the records of those that have ended meanwhile.

        Parameters
        ----------
        longest
            Seconds that a run may take; None for any time.
        bench
            Everything the workers need.
        jobs
            The runs.
        stop
            Event that ends the work when it is set, in the middle of runs.

        Raises
        ------
        RunError
            If no worker can be started.
        """
        from pebble import ProcessExpired, ProcessPool

        if self._pool is None:
            quiet = {"PYTHONWARNINGS": "ignore"}  # of a process that outlives this one, if somebody kills it
            with processes_with({**_variables(), **quiet}):
                resource_tracker.ensure_running()
            self._pool = ProcessPool(self._number, max_tasks=MOST_RUNS, initializer=_begin, context=_Context())
        give, packed = functools.partial(self._pool.schedule, _made), pickle.dumps(bench)
        waiting: dict[Future[Record], Job] = {give(args=[packed, job, longest]): job for job in jobs}
        deaths, since = Counter[str](), dict[Future[Record], float]()
        try:
            while waiting and not stop.is_set():
                records = []
                for future in wait(waiting, timeout=0.2, return_when=FIRST_COMPLETED).done:
                    job, error = waiting.pop(future), future.exception()
                    deaths[job.key] += isinstance(error, ProcessExpired) and error.exitcode != LATE
                    if deaths[job.key] == 1 and error is not None:  # somebody else may have killed it
                        waiting[give(args=[packed, job, longest])] = job
                    else:
                        records.append(_record_of(future, job, longest))
                yield records
                _name_silent(waiting, since)
        except BrokenProcessPool:
            raise RunError("worker processes die before they make a run: --workers 1 shows the reason") from None


def _record_of(future: Future[Record], job: Job, longest: float | None) -> Record:
    """Return the record of a run that has ended, in whichever way."""
    from pebble import ProcessExpired

    try:
        return future.result()
    except ProcessExpired as death:
        code = death.exitcode
        if code == LATE:
            return Record(job.key, "failed", f"no result after {longest:g} s (--longest)", WORKER)
        how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
        return Record(job.key, LOST, f"its worker process {how}, twice, while it made this run", WORKER)


def _name_silent(waiting: Mapping[Future[Record], Job], since: dict[Future[Record], float]) -> None:
    """Name each run that has begun and has not ended for `SILENCE` seconds in the log, once."""
    now = time.monotonic()
    for future, job in waiting.items():
        if future.running() and now - since.setdefault(future, now) > SILENCE:
            since[future] = float("inf")
            methods = f"{job.task.case}: {job.task.integrator} + {job.task.contact}"
            LOG.warning("%s has not answered for %.0f s: --longest SECONDS ends such runs", methods, SILENCE)


def number_of_workers(given: int | None) -> int:
    """Return the number of worker processes: the given one, or the number of cores that this process may use.

    Raises
    ------
    InputError
        If it is less than 1.
    """
    if given is not None and given < 1:
        raise wrong_input("--workers", f"expected a number of at least 1, found {given}")
    return given or len(os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1))


def _variables() -> dict[str, str]:
    """Return the environment of the processes that start here."""
    return {**ONE_THREAD, SAFE_PATH: os.environ.get(SAFE_PATH) or SET_HERE}


class _Process(SpawnProcess):
    """A process that does not run the script of its parent again, never sees Ctrl-C, and uses one thread of BLAS.

    Python would put the current folder first on its path, and multiprocessing puts it instead of an empty entry of
    ours. Ctrl-C goes to all processes of a terminal: the one that hands out the work handles it.
    """

    def start(self) -> None:
        """Start the process."""
        main, path = sys.modules["__main__"], sys.path
        sys.modules["__main__"] = ModuleType("__main__")
        sys.path = [folder for folder in path if folder]
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            with processes_with(_variables()):
                super().start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            sys.modules["__main__"], sys.path = main, path


class _Context(SpawnContext):
    Process = _Process


# ------------------------------------------------------------------------------------- inside a worker process


def _begin() -> None:
    """Prepare this process."""
    if os.environ.get(SAFE_PATH) == SET_HERE:  # What a plug-in starts in a worker has the path it has elsewhere.
        del os.environ[SAFE_PATH]
    # Standard output belongs to the results of the process that hands out the work.
    os.dup2(2, 1)
    faulthandler.enable()  # a plug-in that crashes this process is named


@functools.lru_cache(maxsize=2)
def _unpacked(packed: bytes) -> Bench:
    return pickle.loads(packed)  # type: ignore[no-any-return]  # noqa: S301 - from the process that started this one


def _made(packed: bytes, job: Job, longest: float | None) -> Record:
    """Return the record of a run; end this process after `longest` seconds, in which compiling does not count."""
    ended = threading.Event()
    if longest is not None:
        threading.Thread(target=_end_late, args=(longest, ended), daemon=True).start()
    try:
        return _unpacked(packed).record_elsewhere(job)
    finally:
        ended.set()


def _end_late(longest: float, ended: threading.Event) -> None:
    compiling, spent, last = [False], 0.0, time.monotonic()

    def notice(begun: bool) -> None:
        compiling[0] = begun

    NOTICES.append(notice)
    while not ended.wait(0.1):
        now = time.monotonic()
        spent, last = spent + (0.0 if compiling[0] else now - last), now
        if spent > longest:
            os._exit(LATE)
    NOTICES.remove(notice)
