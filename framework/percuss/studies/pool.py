"""Workers that make the runs of a study, on this machine or elsewhere: one that dies costs only its own run."""

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
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from queue import Empty, SimpleQueue
from types import ModuleType

from percuss.blas import ONE_THREAD
from percuss.errors import RunError, wrong_input
from percuss.jit import NOTICES
from percuss.process import processes_with
from percuss.studies.perform import LOST, WORKER, Bench, Record
from percuss.studies.tasks import Task

LATE = 75  # exit code of a worker whose run has taken too long
MOST_RUNS = 1000  # of one process, which keeps the machine code of every kernel that it has met
SILENCE = 600.0  # seconds without an answer after which a run is named
LOOK_SECONDS = 5.0  # between two looks at what has not answered
WAIT_SECONDS = 0.2  # for runs that end, before it is asked whether to stop
CONNECT_SECONDS = 5.0  # until a scheduler counts as absent
LOG = logging.getLogger("percuss")  # without other settings Python prints its warnings on standard error
# Python's option -P: it would put the current folder first on the path of a worker.
ENVIRONMENT = {**ONE_THREAD, "PYTHONSAFEPATH": "1"}

Submit = Callable[[Task], Future[Record]]
Workers = Callable[[bytes], Submit]  # what hands a run to workers, made of a packed bench


@contextmanager
def processes(number: int, longest: float | None = None) -> Iterator[Workers]:
    """Give processes of this machine, which start with the first run and end with this context.

    Parameters
    ----------
    number
        Number of processes.
    longest
        Seconds that a run may take; None for any time.
    """
    from pebble import ProcessPool

    with processes_with(ENVIRONMENT):
        resource_tracker.ensure_running()
    pool = ProcessPool(number, max_tasks=MOST_RUNS, initializer=_begin, context=_Context())
    try:
        yield lambda packed: lambda task: pool.schedule(_made, args=[packed, task, longest])
    except BrokenProcessPool:
        raise RunError("worker processes die before they make a run: --workers 1 shows the reason") from None
    finally:
        pool.stop()
        pool.join()


@contextmanager
def cluster(address: str) -> Iterator[Workers]:
    """Give the workers of a Dask scheduler, where percuss and the plug-ins are installed too.

    Parameters
    ----------
    address
        Address of the scheduler, as ``tcp://10.0.0.1:8786``.

    Raises
    ------
    InputError
        If distributed is not installed, or no scheduler answers at `address`.
    RunError
        If the scheduler goes away meanwhile, or a worker has no percuss.
    """
    try:
        from distributed import Client
    except ImportError:
        advice = "Install percuss[study], or leave --scheduler out to use the cores of this machine."
        raise wrong_input("--scheduler", "needs distributed, which is not installed", advice) from None
    try:
        client = Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:
        advice = "Start one with `dask scheduler`, and workers with `dask worker ADDRESS`."
        raise wrong_input(f"--scheduler {address}", f"nobody answers: {error}", advice) from None
    executor = client.get_executor(pure=False)

    def submit_of(packed: bytes) -> Submit:
        held = client.scatter(packed, broadcast=True, direct=False, hash=False)
        return functools.partial(executor.submit, _record, held)

    try:
        with client.as_current():
            yield submit_of
    except (CancelledError, OSError, ImportError) as error:  # an ImportError is that of a worker
        message = "the scheduler is gone, or a worker lacks a package; the same command continues"
        raise RunError(f"{address}: {message} ({type(error).__name__}: {error})") from error
    finally:
        executor.shutdown(wait=False)
        client.close()


def made(
    workers: Workers, longest: float | None, bench: Bench, tasks: Sequence[Task], stop: threading.Event
) -> Iterator[Record | None]:
    """Hand runs to workers, and yield the record of each that ends, or None where none has ended for `WAIT_SECONDS`.

    Parameters
    ----------
    workers
        What hands a run to workers.
    longest
        Seconds that a run may take, for its record.
    bench
        Everything the workers need.
    tasks
        The runs.
    stop
        Event that ends the work when it is set, in the middle of runs.

    Raises
    ------
    RunError
        If no worker can be started.
    """
    submit = workers(pickle.dumps(bench))
    waiting, ended, deaths = dict[Future[Record], Task](), SimpleQueue[Future[Record]](), Counter[str]()
    since, looked = dict[Future[Record], float](), time.monotonic()

    def start(task: Task) -> None:
        waiting[future := submit(task)] = task
        future.add_done_callback(ended.put)

    for task in tasks:
        start(task)
    while waiting and not stop.is_set():
        if time.monotonic() - looked > LOOK_SECONDS:
            _name_silent(waiting, since)
            looked = time.monotonic()
        try:
            future = ended.get(timeout=WAIT_SECONDS)
        except Empty:
            yield None
            continue
        task, error = waiting.pop(future), future.exception()
        exit_code = getattr(error, "exitcode", None)  # of a process that has ended
        deaths[task.key] += exit_code not in (None, LATE)
        if deaths[task.key] == 1 and error is not None:  # somebody else may have killed it
            start(task)
        elif error is None:
            yield future.result()
        elif exit_code is None and type(error).__name__ != "KilledWorker":
            raise error
        elif exit_code == LATE:
            yield Record(task.key, "failed", f"no result after {longest:g} s (--longest)", WORKER)
        else:
            yield Record(task.key, LOST, _death(exit_code, error), WORKER)


def _death(exit_code: int | None, error: BaseException) -> str:
    """Return how a worker has ended, in words; Dask has its own for one that killed several workers."""
    if exit_code is None:
        return str(error)
    how = f"was killed by {signal.Signals(-exit_code).name}" if exit_code < 0 else f"ended with exit code {exit_code}"
    return f"its worker process {how}, twice, while it made this run"


def _name_silent(waiting: Mapping[Future[Record], Task], since: dict[Future[Record], float]) -> None:
    """Name each run that has begun and has not ended for `SILENCE` seconds in the log, once."""
    now = time.monotonic()
    for future, task in waiting.items():
        if future.running() and now - since.setdefault(future, now) > SILENCE:
            since[future] = float("inf")
            methods = f"{task.case}: {task.integrator} + {task.contact}"
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


class _Process(SpawnProcess):
    """A process that does not run the script of its parent again, never sees Ctrl-C, and uses one thread of BLAS.

    Ctrl-C goes to all processes of a terminal: the one that hands out the work handles it.
    """

    def start(self) -> None:
        """Start the process."""
        main = sys.modules["__main__"]
        with processes_with(ENVIRONMENT):
            before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            sys.modules["__main__"] = ModuleType("__main__")
            try:
                super().start()
            finally:
                sys.modules["__main__"] = main
                signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Context(SpawnContext):
    Process = _Process


# ------------------------------------------------------------------------------------- inside a worker process


def _begin() -> None:
    """Prepare this process."""
    os.dup2(2, 1)  # Standard output belongs to the results of the process that hands out the work.
    faulthandler.enable()  # a plug-in that crashes this process is named


@functools.lru_cache(maxsize=2)
def _unpacked(packed: bytes) -> Bench:
    return pickle.loads(packed)  # type: ignore[no-any-return]  # noqa: S301 - from the process that hands out the work


def _record(packed: bytes, task: Task) -> Record:
    return _unpacked(packed).record(task)


def _made(packed: bytes, task: Task, longest: float | None) -> Record:
    """Return the record of a run; end this process after `longest` seconds, in which compiling does not count."""
    ended = threading.Event()
    if longest is not None:
        threading.Thread(target=_end_late, args=(longest, ended), daemon=True).start()
    try:
        return _record(packed, task)
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
