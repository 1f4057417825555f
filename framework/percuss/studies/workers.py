"""Runs of a study on the cores of this machine; a worker that dies costs only the runs that it was making."""

from __future__ import annotations

import contextlib
import multiprocessing as mp
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import ModuleType
from typing import Any

from percuss.errors import RunError
from percuss.studies.job_package import Bench, Interrupted, Job
from percuss.studies.perform import LOST
from percuss.studies.store import WORKER
from percuss.studies.stored_run import Record

__all__ = ["Batches", "run_here", "run_local"]

SECONDS = 0.4  # intended time of a batch: short enough to lose little, long enough to cost nothing
MOST = 500  # largest number of runs in a batch
STRIKES = 3  # a run that kills its worker this often is not tried again
IN_VAIN = 5  # crews that may die before they make a run
# A process keeps the machine code of every kernel that it has met. Workers of more than this memory [bytes] are
# replaced by new ones, which load from disk what they need, but not until they have worked for some time [s].
MOST_MEMORY = 2**30
SHORTEST_SERVICE = 60.0

Keep = Callable[[Sequence[Record]], None]


class Batches:
    """Waiting jobs, handed out in batches that take about `SECONDS`."""

    def __init__(self, jobs: Sequence[Job], workers: int) -> None:
        self.waiting = deque(jobs)
        self.workers = workers
        self.seconds: float | None = None  # of a run, from the last batches
        self.alone: set[str] = set()  # keys of runs suspected of killing workers

    def take(self) -> list[Job]:
        """Return the next batch; the first batches are single runs, whose times give the size of later ones."""
        count = 1 if self.seconds is None else int(SECONDS / max(self.seconds, SECONDS / MOST))
        share = -(-len(self.waiting) // (2 * self.workers))  # so that no worker is left without work at the end
        batch: list[Job] = []
        while self.waiting and len(batch) < max(1, min(count, share)):
            if self.waiting[0].key in self.alone and batch:
                break
            batch.append(self.waiting.popleft())
            if batch[0].key in self.alone:
                break
        return batch

    def put_back(self, jobs: Sequence[Job], made: Sequence[Record]) -> None:
        """Update the time of a run from a returned batch, and put its unmade jobs at the front of the queue."""
        keys = {record.key for record in made}
        self.waiting.extendleft(job for job in reversed(jobs) if job.key not in keys)
        times = [record.wall for record in made if record.wall is not None]
        if times:
            mean = sum(times) / len(times)
            self.seconds = mean if self.seconds is None else 0.5 * (self.seconds + mean)


def run_here(bench: Bench, jobs: Sequence[Job], keep: Keep, stop: threading.Event) -> None:
    """Make the runs in this process, batch by batch."""
    batches = Batches(jobs, 1)
    while batches.waiting and not stop.is_set():
        batch = batches.take()
        try:
            made = bench.records(batch)
        except Interrupted as interrupted:
            stop.set()
            made = interrupted.records
        keep(made)
        batches.put_back(batch, made)


def run_local(bench: Bench, jobs: Sequence[Job], workers: int, keep: Keep, stop: threading.Event) -> None:
    """Make the runs in worker processes.

    Parameters
    ----------
    bench
        Everything the workers need.
    jobs
        Runs to make.
    workers
        Number of processes.
    keep
        Called with the records of each finished batch.
    stop
        Event that ends the work when it is set; batches that are finished by then are kept.

    Raises
    ------
    RunError
        If the workers die again and again before they make any run.
    """
    batches, in_flight, lost = Batches(jobs, workers), _InFlight(), _Lost()
    crew = _Crew(bench, workers)
    try:
        while (batches.waiting or in_flight or lost.suspects) and not stop.is_set():
            broken = not crew.retiring and not _submit(crew, batches, in_flight, lost)
            for batch, made in in_flight.finished():
                if made is None:
                    broken = True
                    lost.batches.append(batch)
                    continue
                lost.in_vain = 0
                keep(made)
                batches.put_back(batch, made)
            if broken:
                lost.batches += in_flight.take_all()
                running = crew.at_work()
                crew.end()
                keep(lost.sort(running, batches))
                crew = _Crew(bench, workers)
            elif crew.retiring and not in_flight:
                crew.end(wait=True)
                crew = _Crew(bench, workers)
            crew.retire_if_large()
    finally:
        if stop.is_set():  # finished batches are kept, those under way are not waited for
            for _, made in in_flight.finished(0.0):
                keep(made or [])
        crew.end(wait=not stop.is_set() and not in_flight)


def _submit(crew: _Crew, batches: Batches, in_flight: _InFlight, lost: _Lost) -> bool:
    """Hand out batches; return whether the crew still accepts work."""
    while True:
        if lost.suspects:
            # A suspect runs alone, so that it must be the cause if a worker dies.
            batch = [lost.suspects.popleft()] if not in_flight else []
        else:
            batch = batches.take() if batches.waiting and len(in_flight) < 2 * batches.workers else []
        if not batch:
            return True
        try:
            in_flight[crew.submit(batch)] = batch
        except BrokenProcessPool:
            lost.batches.append(batch)
            return False


class _InFlight(dict[Future[list[Record]], list[Job]]):
    """Batches under way, by future."""

    def finished(self, timeout: float = 0.2) -> Iterator[tuple[list[Job], list[Record] | None]]:
        """Yield the finished batches with their records, or with None if the worker died."""
        if not self:
            return
        for future in wait(list(self), timeout=timeout, return_when=FIRST_COMPLETED).done:
            batch = self.pop(future)
            try:
                yield batch, future.result()
            except BrokenProcessPool:
                yield batch, None

    def take_all(self) -> list[list[Job]]:
        """Return all batches and forget them, as they are no longer under way."""
        batches = list(self.values())
        self.clear()
        return batches


class _Lost:
    """Batches whose workers died, and the runs that may be the cause."""

    def __init__(self) -> None:
        self.batches: list[list[Job]] = []
        self.suspects: deque[Job] = deque()
        self.strikes: Counter[str] = Counter()
        self.in_vain = 0

    def sort(self, running: set[str], batches: Batches) -> list[Record]:
        """Put lost jobs back into the queue, or among the suspects if `running`; return records of those given up."""
        given_up = []
        self.in_vain += 1
        if self.in_vain > IN_VAIN and not running:
            raise RunError("worker processes die before they make a run: try --workers 1, which says why")
        for batch in reversed(self.batches):
            for job in reversed(batch):
                if job.key not in running:
                    batches.waiting.appendleft(job)
                    continue
                self.strikes[job.key] += 1
                if self.strikes[job.key] < STRIKES:
                    self.suspects.append(job)
                else:
                    reason = (
                        f"its worker process died {STRIKES} times; the next time the study is run it is tried again"
                    )
                    given_up.append(Record(job.key, LOST, reason, WORKER))
        self.batches = []
        return given_up


class _Crew:
    """Worker processes, and a folder in which each process notes the run that it is making.

    Attributes
    ----------
    retiring
        Whether the processes are to end when they have finished their batches.
    """

    def __init__(self, bench: Bench, workers: int) -> None:
        context = mp.get_context("forkserver" if "forkserver" in mp.get_all_start_methods() else "spawn")
        context.set_forkserver_preload([__name__])  # slow imports are made once for all workers
        self.notes = Path(tempfile.mkdtemp(prefix="percuss-"))
        self.alive, self.leash = context.Pipe(duplex=False)
        self.pool = ProcessPoolExecutor(workers, context, _begin, (bench, self.alive, str(self.notes)))
        self.began = time.monotonic()
        self.retiring = False

    def submit(self, batch: list[Job]) -> Future[list[Record]]:
        with _starting():
            return self.pool.submit(_work, batch)

    def at_work(self) -> set[str]:
        """Return the keys of the runs that workers were making when they died."""
        return {note.read_text(encoding="ascii").strip() for note in self.notes.iterdir()} - {""}

    def retire_if_large(self) -> None:
        """Let the workers retire if one of them takes more than `MOST_MEMORY`."""
        if not self.retiring and time.monotonic() - self.began > SHORTEST_SERVICE:
            self.retiring = any(_memory_of(note.name) > MOST_MEMORY for note in self.notes.iterdir())

    def end(self, *, wait: bool = False) -> None:
        """End the workers, in the middle of their work unless `wait` is set."""
        if wait:
            self.pool.shutdown()
        self.leash.close()  # a worker ends when this pipe is closed
        self.pool.shutdown(wait=False, cancel_futures=True)
        self.alive.close()
        shutil.rmtree(self.notes, ignore_errors=True)


def _memory_of(process: str) -> int:
    """Return the memory of a process [bytes], 0 where the system does not report it."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
    except (OSError, ValueError, IndexError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


@contextlib.contextmanager
def _starting() -> Iterator[None]:
    """Keep processes that start now from importing the running script and from using several threads of BLAS.

    A script without ``if __name__ == "__main__"`` would run again in each process. The threads of several processes
    would slow each other down.
    """
    main, threads = sys.modules["__main__"], os.environ.get("OPENBLAS_NUM_THREADS")
    sys.modules["__main__"] = ModuleType("__main__")
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    try:
        yield
    finally:
        sys.modules["__main__"] = main
        if threads is None:
            del os.environ["OPENBLAS_NUM_THREADS"]
        else:
            os.environ["OPENBLAS_NUM_THREADS"] = threads


# ------------------------------------------------------------------------------------- inside a worker process

_PROCESS_STATE: dict[str, Any] = {}


def _begin(bench: Bench, alive: Any, notes: str) -> None:
    """Prepare this worker process for its work."""
    # The process that hands out the work handles Ctrl-C: a worker must not take half a run for a whole one.
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    threading.Thread(target=_watch, args=(alive, notes), daemon=True).start()
    _PROCESS_STATE["bench"] = bench
    _PROCESS_STATE["note"] = os.open(Path(notes) / str(os.getpid()), os.O_CREAT | os.O_WRONLY, 0o600)


def _watch(alive: Any, notes: str) -> None:
    """End this process when the process that hands out the work ends, in any way."""
    with contextlib.suppress(EOFError, OSError):
        alive.recv()
    shutil.rmtree(notes, ignore_errors=True)
    os._exit(1)


def _work(batch: list[Job]) -> list[Record]:
    made = _PROCESS_STATE["bench"].records(batch, _note)
    _note("")
    return made  # type: ignore[no-any-return]


def _note(key: str) -> None:
    os.lseek(_PROCESS_STATE["note"], 0, os.SEEK_SET)
    os.write(_PROCESS_STATE["note"], f"{key:32}".encode("ascii"))
