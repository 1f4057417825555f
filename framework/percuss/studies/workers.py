"""Many runs spread over the cores of this machine; a worker that dies costs nothing but the runs it was at."""

from __future__ import annotations

import contextlib
import multiprocessing as mp
import os
import shutil
import signal
import sys
import tempfile
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import ModuleType
from typing import Any

from percuss.errors import RunError
from percuss.studies.job_package import Bench, Interrupted, Job
from percuss.studies.store import WORKER
from percuss.studies.stored_run import Record
from percuss.studies.tasks import LOST

__all__ = ["Batches", "run_here", "run_local"]

SECONDS = 0.4  # that a batch is meant to take: short enough to lose little, long enough to cost nothing
MOST = 500
STRIKES = 3  # a run that kills its worker so often is not tried again
IN_VAIN = 5  # crews that die before they make a run

Keep = Callable[[Sequence[Record]], None]


class Batches:
    """The jobs that wait, handed out in batches that take about `SECONDS`."""

    def __init__(self, jobs: Sequence[Job], workers: int) -> None:
        self.waiting = deque(jobs)
        self.workers = workers
        self.seconds: float | None = None  # of a run, as the last ones took
        self.alone: set[str] = set()  # runs that are suspected of killing workers

    def take(self) -> list[Job]:
        """Return the next batch; the first ones are single runs, from which the size of later ones follows."""
        count = 1 if self.seconds is None else int(SECONDS / max(self.seconds, SECONDS / MOST))
        share = -(-len(self.waiting) // (2 * self.workers))  # towards the end no worker is left without
        batch: list[Job] = []
        while self.waiting and len(batch) < max(1, min(count, share)):
            if self.waiting[0].key in self.alone and batch:
                break
            batch.append(self.waiting.popleft())
            if batch[0].key in self.alone:
                break
        return batch

    def back(self, jobs: Sequence[Job], made: Sequence[Record]) -> None:
        """Learn from a batch, and have what it left over wait in front."""
        keys = {one.key for one in made}
        self.waiting.extendleft(job for job in reversed(jobs) if job.key not in keys)
        times = [one.wall for one in made if one.wall is not None]
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
        batches.back(batch, made)


def run_local(bench: Bench, jobs: Sequence[Job], workers: int, keep: Keep, stop: threading.Event) -> None:
    """Make the runs in worker processes.

    Parameters
    ----------
    bench
        What the workers need.
    jobs
        What to run.
    workers
        Number of processes.
    keep
        Called with the records of each finished batch.
    stop
        Ends the work when it is set; batches that are finished by then are kept.

    Raises
    ------
    RunError
        If the workers die again and again before they make any run.
    """
    batches, flying, lost = Batches(jobs, workers), _Flying(), _Lost()
    crew = _Crew(bench, workers)
    try:
        while (batches.waiting or flying or lost.suspects) and not stop.is_set():
            broken = not _submit(crew, batches, flying, lost)
            for batch, made in flying.finished():
                if made is None:
                    broken = True
                    lost.batches.append(batch)
                    continue
                lost.in_vain = 0
                keep(made)
                batches.back(batch, made)
            if broken:
                lost.batches += flying.all()
                blamed = crew.at_work()
                crew.end()
                keep(lost.sort(blamed, batches))
                crew = _Crew(bench, workers)
    finally:
        if stop.is_set():  # what is finished is kept; what is under way is not waited for
            for _, made in flying.finished(0.0):
                keep(made or [])
        crew.end(wait=not stop.is_set() and not flying)


def _submit(crew: _Crew, batches: Batches, flying: _Flying, lost: _Lost) -> bool:
    """Hand out work; return whether the crew still takes any."""
    while True:
        if lost.suspects:
            # alone, so that what dies with it is known to have died of it
            batch = [lost.suspects.popleft()] if not flying else []
        else:
            batch = batches.take() if batches.waiting and len(flying) < 2 * batches.workers else []
        if not batch:
            return True
        try:
            flying[crew.submit(batch)] = batch
        except BrokenProcessPool:
            lost.batches.append(batch)
            return False


class _Flying(dict[Future[list[Record]], list[Job]]):
    """The batches under way."""

    def finished(self, timeout: float = 0.2) -> Iterator[tuple[list[Job], list[Record] | None]]:
        """Yield the batches that are finished with their records, None for one whose worker died."""
        if not self:
            return
        for future in wait(list(self), timeout=timeout, return_when=FIRST_COMPLETED).done:
            batch = self.pop(future)
            try:
                yield batch, future.result()
            except BrokenProcessPool:
                yield batch, None

    def all(self) -> list[list[Job]]:
        """Return all batches, which are under way no more."""
        batches = list(self.values())
        self.clear()
        return batches


class _Lost:
    """Batches whose workers died, and the runs that may be why."""

    def __init__(self) -> None:
        self.batches: list[list[Job]] = []
        self.suspects: deque[Job] = deque()
        self.strikes: Counter[str] = Counter()
        self.in_vain = 0

    def sort(self, blamed: set[str], batches: Batches) -> list[Record]:
        """Put lost jobs back to wait, those in `blamed` to be tried alone; return the rows of those given up."""
        given_up = []
        self.in_vain += 1
        if self.in_vain > IN_VAIN and not blamed:
            raise RunError("worker processes die before they make a run: try --workers 1, which says why")
        for batch in reversed(self.batches):
            for job in reversed(batch):
                if job.key not in blamed:
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
    """The worker processes, and a folder in which each says which run it is at."""

    def __init__(self, bench: Bench, workers: int) -> None:
        context = mp.get_context("forkserver" if "forkserver" in mp.get_all_start_methods() else "spawn")
        context.set_forkserver_preload([__name__])  # what is slow to import is imported once for all workers
        self.notes = Path(tempfile.mkdtemp(prefix="percuss-"))
        self.alive, self.leash = context.Pipe(duplex=False)
        self.pool = ProcessPoolExecutor(workers, context, _begin, (bench, self.alive, str(self.notes)))

    def submit(self, batch: list[Job]) -> Future[list[Record]]:
        with _starting():
            return self.pool.submit(_work, batch)

    def at_work(self) -> set[str]:
        """Return the keys of the runs that workers were at when they died."""
        return {one.read_text(encoding="ascii").strip() for one in self.notes.iterdir()} - {""}

    def end(self, *, wait: bool = False) -> None:
        """Dismiss the workers, in the middle of their work unless it is waited for."""
        if wait:
            self.pool.shutdown()
        self.leash.close()  # a worker ends when this does
        self.pool.shutdown(wait=False, cancel_futures=True)
        self.alive.close()
        shutil.rmtree(self.notes, ignore_errors=True)


@contextlib.contextmanager
def _starting() -> Iterator[None]:
    """Have processes that start now take over nothing that they should not.

    They would import the script that is running, and one without ``if __name__ == "__main__"`` would run again in
    each. And threads of BLAS would get into each other's way.
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

_HERE: dict[str, Any] = {}


def _begin(bench: Bench, alive: Any, notes: str) -> None:
    """Prepare this process for its work."""
    # Ctrl-C is the business of the process that hands out the work: nothing here may take half a run for a whole one
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    threading.Thread(target=_watch, args=(alive, notes), daemon=True).start()
    _HERE["bench"] = bench
    _HERE["note"] = os.open(Path(notes) / str(os.getpid()), os.O_CREAT | os.O_WRONLY, 0o600)


def _watch(alive: Any, notes: str) -> None:
    """End this process with the one that hands out the work, however that ended."""
    with contextlib.suppress(EOFError, OSError):
        alive.recv()
    shutil.rmtree(notes, ignore_errors=True)
    os._exit(1)


def _work(batch: list[Job]) -> list[Record]:
    made = _HERE["bench"].records(batch, _note)
    _note("")
    return made  # type: ignore[no-any-return]


def _note(key: str) -> None:
    os.lseek(_HERE["note"], 0, os.SEEK_SET)
    os.write(_HERE["note"], f"{key:32}".encode("ascii"))
