"""Runs of a study on the cores of this machine; a worker that dies costs only the runs that it was making.

Each worker has a pipe to this process, through which batches go and records come. Its end tells its death, and the
closed pipe ends the worker: no worker outlives the process that hands out the work.
"""

from __future__ import annotations

import contextlib
import faulthandler
import multiprocessing as mp
import os
import re
import signal
import sys
import tempfile
import threading
import time
from collections import Counter, deque
from collections.abc import Generator, Iterator, Sequence
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as first_of
from pathlib import Path
from queue import SimpleQueue
from types import ModuleType
from typing import Any, NamedTuple

from percuss.blas import ONE_THREAD
from percuss.errors import RunError
from percuss.heartbeat import beat, watched
from percuss.jsonable import Data
from percuss.methods.blame import running_line, third_party_files
from percuss.process import processes_with
from percuss.studies.job_package import Bench, Job, Record
from percuss.studies.perform import LOST
from percuss.studies.store import WORKER
from percuss.studies.tasks import Task

SECONDS = 0.4  # intended time of a batch: short enough to lose little, long enough to cost nothing
MOST = 500  # largest number of runs in a batch
GIVEN = 2  # batches of a worker, so that it need not wait for the next
STRIKES = 3  # a run that kills its worker this often is not tried again
IN_VAIN = 5  # workers that may die one after the other before they are ready
GRACE = 2.0  # seconds that an idle worker has to end by itself
# A process keeps the machine code of every kernel that it has met. A worker of more than this memory [bytes] is
# replaced by a new one, which loads from disk what it needs, but not until it has worked for some time [s].
MOST_MEMORY = 2**30
SHORTEST_SERVICE = 60.0
# The variable of Python's option -P, and what it is where the user has not set it.
SAFE_PATH, SET_HERE = "PYTHONSAFEPATH", "set by percuss"

Made = Generator[tuple[Sequence[Job], Sequence[Record]]]  # batches with the records of the runs made of each


class Batches:
    """Waiting jobs, handed out in batches that take about `SECONDS`."""

    def __init__(self, jobs: Sequence[Job]) -> None:
        self.waiting = deque(jobs)
        self.workers = 1  # that share them
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

    def culprit(self, jobs: Sequence[Job]) -> Job | None:
        """Return the job of a batch that has killed its worker; those of a larger batch are tried alone first."""
        if len(jobs) == 1:
            return jobs[0]
        self.alone |= {job.key for job in jobs}
        return None

    def put_back(self, jobs: Sequence[Job], made: Sequence[Record]) -> None:
        """Update the time of a run from a returned batch, and put its unmade jobs at the front of the queue."""
        keys = {record.key for record in made}
        self.waiting.extendleft(job for job in reversed(jobs) if job.key not in keys)
        times = [record.wall for record in made if record.wall is not None]
        if times:
            mean = sum(times) / len(times)
            self.seconds = mean if self.seconds is None else 0.5 * (self.seconds + mean)


def made_here(bench: Bench, batches: Batches, stop: threading.Event) -> Made:
    """Make the runs in this process and yield each batch with its records, until none is left or `stop` is set."""
    while batches.waiting and not stop.is_set():
        batch = batches.take()
        yield batch, bench.records(batch)


def made_locally(local: LocalWorkers, batches: Batches, stop: threading.Event) -> Made:
    """Make the runs in worker processes and yield each finished batch with its records.

    Parameters
    ----------
    local
        The workers.
    batches
        Runs to make.
    stop
        Event that ends the work when it is set; batches that are finished by then are yielded.

    Raises
    ------
    RunError
        If the workers die again and again before they make any run.
    """
    batches.workers, strikes = local.number, Counter[str]()
    while (batches.waiting or local.busy) and not stop.is_set():
        local.hand_out(batches)
        for worker, batch, made in local.finished():
            yield batch, _records_of_dead(worker, batch, batches, strikes) if made is None else made
    if stop.is_set():  # those under way are not waited for
        for _, batch, made in local.finished(0.0):
            yield batch, made or []


def _records_of_dead(worker: _Worker, batch: Sequence[Job], batches: Batches, strikes: Counter[str]) -> list[Record]:
    """Return the records of the runs that are given up because they ended their worker; make the others again.

    The runs of a batch that has killed its worker are tried alone, so that the one that does it again is the cause.
    """
    for unmade in reversed(list(worker.given)[1:]):
        batches.put_back(unmade, [])
    if worker.stall is not None:
        return [Record(worker.stall.key, "failed", worker.stall.reason, WORKER)]
    job = batches.culprit(batch) if worker.ready else None
    if job is None:
        return []
    strikes[job.key] += 1
    if strikes[job.key] < STRIKES:
        return []
    if crash := worker.crash_in_plugin():
        return [Record(job.key, "failed", crash, WORKER)]
    reason = f"its worker process died {STRIKES} times; the same command tries the run again"
    return [Record(job.key, LOST, reason, WORKER)]


class LocalWorkers:
    """The worker processes of a study, which start when there is work; a context that ends them.

    Parameters
    ----------
    bench
        Everything the workers need.
    number
        Number of processes.
    stalled_after
        Seconds without a completed step after which a worker gives up its run, and itself.
    """

    def __init__(self, bench: Bench, number: int, stalled_after: float) -> None:
        self.number = number
        self._bench, self._stalled_after = bench, stalled_after
        self._workers: list[_Worker] = []
        self._in_vain = 0

    def __enter__(self) -> LocalWorkers:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            worker.end()

    @property
    def busy(self) -> bool:
        """Whether a worker has work."""
        return any(worker.given for worker in self._workers)

    def hand_out(self, batches: Batches) -> None:
        """Give batches to workers that have few; start workers, and replace those that have grown large."""
        for worker in [worker for worker in self._workers if worker.large and not worker.given]:
            worker.end()
            self._workers.remove(worker)
        for number in range(GIVEN):
            for k in range(self.number):
                if batches.waiting and k == len(self._workers):
                    self._workers.append(_Worker(self._bench, self._stalled_after))
                if batches.waiting and len(self._workers[k].given) <= number and not self._workers[k].large:
                    self._workers[k].give(batches.take())

    def finished(self, timeout: float = 0.2) -> Iterator[tuple[_Worker, list[Any], Any]]:
        """Yield each finished batch with its worker and what it made, or with None if the worker has died.

        Raises
        ------
        RunError
            If the workers die again and again before they are ready.
        """
        by_pipe = {worker.pipe: worker for worker in self._workers if worker.given}
        for pipe in first_of(list(by_pipe), timeout):
            worker = by_pipe[pipe]
            try:
                said = worker.pipe.recv()
            except (EOFError, OSError):
                self._workers.remove(worker)
                self._in_vain += not worker.ready
                if self._in_vain > IN_VAIN:
                    message = "worker processes die before they make a run: --workers 1 shows the reason"
                    raise RunError(message) from None
                yield worker, worker.given[0], None
                worker.end()
                continue
            if said == READY:
                worker.ready, self._in_vain = True, 0
            elif isinstance(said, _Stall):
                worker.stall = said
            else:
                yield worker, worker.given.popleft(), said

    def rehearse(self, steps: Sequence[Task], stop: threading.Event) -> list[Data | None]:
        """Make runs of one step, one after the other; return their summaries, None for one that fails."""
        summaries: list[Data | None] = []
        for step in steps:
            if not self._workers:
                self._workers.append(_Worker(self._bench, self._stalled_after))
            self._workers[0].give([step])
            while self.busy and not stop.is_set():
                # The runs of a kind whose rehearsal fails, or kills its worker, will say why.
                summaries += [summary for _, _, summary in self.finished()]
        return summaries


READY = "ready"  # what a worker says when it is prepared for its work


class _Stall(NamedTuple):
    """What a worker says of the run that stands still, before it ends."""

    key: str
    reason: str


class _Worker:
    """A worker process.

    Attributes
    ----------
    pipe
        The pipe to it.
    given
        The batches that it has to make, in order.
    ready
        Whether it has been prepared.
    stall
        What it said of a run that stands still.
    """

    def __init__(self, bench: Bench, stalled_after: float) -> None:
        context: Any = mp.get_context("forkserver" if "forkserver" in mp.get_all_start_methods() else "spawn")
        if context.get_start_method() == "forkserver":
            context.set_forkserver_preload([__name__])  # slow imports are made once for all workers
            _start_server()
        handle, crash = tempfile.mkstemp(prefix="percuss-", suffix=".crash")
        os.close(handle)
        self.pipe, other = context.Pipe()
        self.given: deque[list[Any]] = deque()
        self.ready = False
        self.stall: _Stall | None = None
        self._crash, self._began = Path(crash), time.monotonic()
        self._process = context.Process(target=_serve, args=(other, bench, crash, stalled_after))
        with _starting():
            self._process.start()
        other.close()

    def give(self, batch: list[Any]) -> None:
        """Give a batch of jobs, or a list of one rehearsal, to the worker."""
        self.given.append(batch)
        with contextlib.suppress(OSError):  # it has died, which is noticed where its records are expected
            self.pipe.send(batch)

    @property
    def large(self) -> bool:
        """Whether it takes more than `MOST_MEMORY` and has worked for some time."""
        return time.monotonic() - self._began > SHORTEST_SERVICE and _memory_of(self._process.pid) > MOST_MEMORY

    def crash_in_plugin(self) -> str:
        """Return the message for a crash of the process, or an empty text if there was none in a plug-in."""
        trace = self._crash.read_text(encoding="utf-8", errors="replace") if self._crash.is_file() else ""
        fatal = re.search(r"Fatal Python error: (.+)", trace)
        plugins = third_party_files()
        calls = re.findall(r'File "(.+)", line (\d+)', trace)
        place = next((f"{file}:{line}" for file, line in calls if file in plugins), "")
        return f"{place}: its worker process died {STRIKES} times here: {fatal[1]}" if fatal and place else ""

    def end(self) -> None:
        """End the process, in the middle of its work if it has any."""
        self.pipe.close()
        with contextlib.suppress(OSError):
            self._crash.unlink()


def _memory_of(process: int | None) -> int:
    """Return the memory of a process [bytes], 0 where the system does not report it."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
    except (OSError, ValueError, IndexError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


@contextlib.contextmanager
def _starting() -> Iterator[None]:
    """Keep processes that start now from code that nothing names and from using several threads of BLAS.

    Python would put the current folder first on their path, and multiprocessing puts it instead of an empty entry
    of ours. A script without ``if __name__ == "__main__"`` would run again in each process. The threads of several
    processes would slow each other down.
    """
    main, path = sys.modules["__main__"], sys.path
    sys.modules["__main__"] = ModuleType("__main__")
    sys.path = [folder for folder in path if folder]
    try:
        with processes_with({**ONE_THREAD, SAFE_PATH: os.environ.get(SAFE_PATH) or SET_HERE}):
            yield
    finally:
        sys.modules["__main__"], sys.path = main, path


def _start_server() -> None:
    """Start the process from which all workers are forked, if it does not run yet, so that it never sees Ctrl-C.

    Ctrl-C goes to all processes of a terminal, and this one would meet it in the middle of its imports.
    """
    from multiprocessing import forkserver, resource_tracker

    with _starting():
        resource_tracker.ensure_running()  # which lets signals through at its end
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            forkserver.ensure_running()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


# ------------------------------------------------------------------------------------- inside a worker process


def _serve(pipe: Connection, bench: Bench, crash: str, stalled_after: float) -> None:
    """Prepare this worker process for its work, and make the batches that come through a pipe."""
    with contextlib.ExitStack() as guards:
        desk = _Desk(pipe, Path(crash))
        desk.prepare(guards, stalled_after)
        desk.say(READY)
        while (batch := desk.batches.get()) is not None:
            desk.say(desk.made(bench, batch))


class _Desk:
    """The work of this worker process.

    Attributes
    ----------
    batches
        What is to be made; None where the work ends.
    """

    def __init__(self, pipe: Connection, crash: Path) -> None:
        self._pipe, self._crash, self._key = pipe, crash, ""
        self.batches: SimpleQueue[list[Any] | None] = SimpleQueue()

    def prepare(self, guards: contextlib.ExitStack, stalled_after: float) -> None:
        """Enter the contexts in which the work is done."""
        if os.environ.get(SAFE_PATH) == SET_HERE:  # What a plug-in starts in a worker has the path it has elsewhere.
            del os.environ[SAFE_PATH]
        # The process that hands out the work handles Ctrl-C: a worker must not take half a run for a whole one.
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        threading.Thread(target=self._receive, daemon=True).start()
        try:
            crash = guards.enter_context(self._crash.open("r+", encoding="utf-8"))
        except FileNotFoundError:  # Ctrl-C has ended the work before it began here
            os._exit(1)
        # Standard output belongs to the results of the process that hands out the work.
        os.dup2(2, 1)
        faulthandler.enable(crash)
        guards.enter_context(watched(stalled_after, lambda: self._give_up(stalled_after)))

    def _receive(self) -> None:
        """Put what is to be made into the queue; end this process when the pipe is closed, in the middle of a run."""
        with contextlib.suppress(EOFError, OSError):
            while True:
                self.batches.put(self._pipe.recv())
        with contextlib.suppress(OSError):
            self._crash.unlink()
        if not self._key:
            self.batches.put(None)  # it ends by itself, unless a plug-in has left something that runs
            time.sleep(GRACE)
        os._exit(1)

    def say(self, what: object) -> None:
        """Send something to the process that hands out the work."""
        try:
            self._pipe.send(what)
        except OSError:  # it has ended
            os._exit(1)

    def made(self, bench: Bench, batch: list[Any]) -> object:
        """Return the records of a batch, or the summary of a rehearsal."""
        try:
            if isinstance(batch[0], Task):
                self._note("rehearsal")
                beat()
                return bench.rehearse(batch[0])
            return bench.records(batch, self._note)
        finally:
            self._note("")

    def _note(self, key: str) -> None:
        self._key = key

    def _give_up(self, stalled_after: float) -> None:
        """Say of the run that has not completed a step for long at which line it stands, and end this process."""
        if not self._key:
            return  # nothing is asked of this process
        place = running_line(sys._current_frames().get(threading.main_thread().ident or 0))
        reason = f"no step was completed for {stalled_after:g} s (`stalled_after` of the study)"
        self.say(_Stall(self._key, f"{place}: {reason}" if place else reason))
        os._exit(1)
