"""Runs of a study on the cores of this machine; a worker that dies costs only the runs that it was making."""

from __future__ import annotations

import contextlib
import faulthandler
import functools
import multiprocessing as mp
import os
import re
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, TypeVar

from percuss.blas import ONE_THREAD
from percuss.errors import RunError
from percuss.heartbeat import Watch, beat
from percuss.methods.blame import third_party_files
from percuss.methods.process_guard import (
    STANDSTILL,
    guarded_output,
    plug_ins_cannot_end_the_process,
    tell_standstill,
    tell_uncaught,
    where_is,
)
from percuss.process import processes_with
from percuss.studies.job_package import Bench, Interrupted, Job
from percuss.studies.perform import LOST
from percuss.studies.store import WORKER
from percuss.studies.stored_run import Record
from percuss.studies.tasks import Task

SECONDS = 0.4  # intended time of a batch: short enough to lose little, long enough to cost nothing
MOST = 500  # largest number of runs in a batch
STRIKES = 3  # a run that kills its worker this often is not tried again
STALLED, CRASH = ".stalled", ".crash"  # endings of the notes of a worker that ends
IN_VAIN = 5  # crews that may die before they make a run
# A process keeps the machine code of every kernel that it has met. Workers of more than this memory [bytes] are
# replaced by new ones, which load from disk what they need, but not until they have worked for some time [s].
MOST_MEMORY = 2**30
SHORTEST_SERVICE = 60.0
# The variable of Python's option -P, and what it is where the user has not set it.
SAFE_PATH, SET_HERE = "PYTHONSAFEPATH", "set by percuss"

Keep = Callable[[Sequence[Record]], None]
Made = TypeVar("Made")


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


def run_local(local: LocalWorkers, jobs: Sequence[Job], keep: Keep, stop: threading.Event) -> None:
    """Make the runs in worker processes.

    Parameters
    ----------
    local
        The workers.
    jobs
        Runs to make.
    keep
        Called with the records of each finished batch.
    stop
        Event that ends the work when it is set; batches that are finished by then are kept.

    Raises
    ------
    RunError
        If the workers die again and again before they make any run.
    """
    batches, in_flight, lost = Batches(jobs, local.number), _InFlight(), _Lost()
    try:
        while (batches.waiting or in_flight or lost.suspects) and not stop.is_set():
            broken = not local.crew.retiring and not _submit(local.crew, batches, in_flight, lost)
            for batch, made in in_flight.finished():
                if made is None:
                    broken = True
                    lost.batches.append(batch)
                    continue
                lost.in_vain = 0
                keep(made)
                batches.put_back(batch, made)
            if broken:
                lost.batches += in_flight.values()
                in_flight.clear()
                keep(lost.sort(local.crew.ends(), batches))
                local.renew()
            elif local.crew.retiring and not in_flight:
                local.renew(wait=True)
            else:
                local.crew.retire_if_large()
    finally:
        if stop.is_set():  # finished batches are kept, those under way are not waited for
            for _, made in in_flight.finished(0.0):
                keep(made or [])
        local.idle = not stop.is_set() and not in_flight


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
            in_flight[crew.submit(_work, batch)] = batch
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


class _Lost:
    """Batches whose workers died, and the runs that may be the cause."""

    def __init__(self) -> None:
        self.batches: list[list[Job]] = []
        self.suspects: deque[Job] = deque()
        self.strikes: Counter[str] = Counter()
        self.crashes: dict[str, str] = {}
        self.in_vain = 0

    def sort(self, running: Mapping[str, _End], batches: Batches) -> list[Record]:
        """Put lost jobs back into the queue, or among the suspects if `running`; return records of those given up."""
        given_up = []
        self.in_vain += 1
        if self.in_vain > IN_VAIN and not running:
            raise RunError("worker processes die before they make a run: --workers 1 shows the reason")
        for batch in reversed(self.batches):
            for job in reversed(batch):
                if job.key not in running:
                    batches.waiting.appendleft(job)
                    continue
                end = running[job.key]
                self.strikes[job.key] += 1
                self.crashes[job.key] = crash = end.crash or self.crashes.get(job.key, "")
                if end.stalled:
                    given_up.append(Record(job.key, "failed", end.stalled, WORKER))
                elif self.strikes[job.key] < STRIKES:
                    self.suspects.append(job)
                elif crash:
                    given_up.append(Record(job.key, "failed", crash, WORKER))
                else:
                    reason = f"its worker process died {STRIKES} times; the same command tries the run again"
                    given_up.append(Record(job.key, LOST, reason, WORKER))
        self.batches = []
        return given_up


class _End(NamedTuple):
    """How the worker of a run ended: what is known of a run that stood still, or of a crash in a plug-in."""

    stalled: str = ""
    crash: str = ""


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
        self.number, self.idle = number, True
        self._new_crew = functools.partial(_Crew, bench, number, stalled_after)
        self._crew: _Crew | None = None

    def __enter__(self) -> LocalWorkers:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if self._crew is not None:
            self._crew.end(wait=self.idle and kind is None)

    @property
    def crew(self) -> _Crew:
        """The processes."""
        if self._crew is None:
            self._crew = self._new_crew()
        return self._crew

    def renew(self, *, wait: bool = False) -> None:
        """End all processes, in the middle of their work unless `wait` is set; new ones start when there is work."""
        if self._crew is not None:
            self._crew.end(wait=wait)
            self._crew = None

    def rehearse(self, steps: Sequence[Task], stop: threading.Event) -> list[Mapping[str, Any]]:
        """Make runs of one step, one after the other; return the summaries of those that succeed."""
        summaries: list[Mapping[str, Any]] = []
        for step in steps:
            try:
                future = self.crew.submit(_rehearse, step)
                while not stop.is_set() and not wait([future], timeout=0.2).done:
                    pass
                if stop.is_set():
                    self.idle = False
                    break
                summary = future.result()
            except BrokenProcessPool:  # the runs of this kind will say why
                self.renew()
                continue
            if summary is not None:
                summaries.append(summary)
        return summaries


class _Crew:
    """Worker processes, and a folder in which each process notes the run that it is making and how it ends.

    Attributes
    ----------
    retiring
        Whether the processes are to end when they have finished their batches.
    """

    def __init__(self, bench: Bench, number: int, stalled_after: float) -> None:
        context = mp.get_context("forkserver" if "forkserver" in mp.get_all_start_methods() else "spawn")
        context.set_forkserver_preload([__name__])  # slow imports are made once for all workers
        if context.get_start_method() == "forkserver":
            _start_server()
        self.notes = Path(tempfile.mkdtemp(prefix="percuss-"))
        self.alive, self.leash = context.Pipe(duplex=False)
        self.began, self.retiring = time.monotonic(), False
        arguments = (bench, self.alive, str(self.notes), stalled_after)
        self.pool = ProcessPoolExecutor(number, context, _begin, arguments)

    def submit(self, function: Callable[[Any], Made], argument: object) -> Future[Made]:
        """Let a worker call a function of this module."""
        with _starting():
            return self.pool.submit(function, argument)

    def ends(self) -> dict[str, _End]:
        """Return how the workers ended that were making runs, by the keys of these runs."""
        ends = {}
        for note in self.notes.glob("*.run"):
            key = note.read_text(encoding="ascii").strip()
            stalled, crash = (_text_of(note.with_suffix(suffix)) for suffix in (STALLED, CRASH))
            if key:
                ends[key] = _End(stalled, self._crash_in_plugin(crash))
        return ends

    def _crash_in_plugin(self, trace: str) -> str:
        """Return the message for a crash by its trace, or an empty text if the crash was in no plug-in."""
        fatal = re.search(r"Fatal Python error: (.+)", trace)
        calls = re.findall(r'File "(.+)", line (\d+)', trace)
        plugins = third_party_files()
        place = next((f"{file}:{line}" for file, line in calls if file in plugins), "")
        return f"{place}: its worker process died {STRIKES} times here: {fatal[1]}" if fatal and place else ""

    def retire_if_large(self) -> None:
        """Let the workers retire if one of them takes more than `MOST_MEMORY`."""
        if not self.retiring and time.monotonic() - self.began > SHORTEST_SERVICE:
            self.retiring = any(_memory_of(note.stem) > MOST_MEMORY for note in self.notes.glob("*.run"))

    def end(self, *, wait: bool = False) -> None:
        """End the workers, in the middle of their work unless `wait` is set."""
        if wait:
            self.pool.shutdown()
        self.leash.close()  # a worker ends when this pipe is closed
        self.pool.shutdown(wait=False, cancel_futures=True)
        self.alive.close()
        shutil.rmtree(self.notes, ignore_errors=True)


def _text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""


def _memory_of(process: str) -> int:
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

_PROCESS_STATE: dict[str, Any] = {}


def _begin(bench: Bench, alive: Any, notes: str, stalled_after: float) -> None:
    """Prepare this worker process for its work."""
    if os.environ.get(SAFE_PATH) == SET_HERE:  # What a plug-in starts in a worker has the path that it has elsewhere.
        del os.environ[SAFE_PATH]
    # The process that hands out the work handles Ctrl-C: a worker must not take half a run for a whole one.
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    threading.Thread(target=_watch, args=(alive, notes), daemon=True).start()
    note = Path(notes) / f"{os.getpid()}.run"
    guards = contextlib.ExitStack()
    _PROCESS_STATE.update(bench=bench, key="", guards=guards)
    try:
        _PROCESS_STATE["note"] = os.open(note, os.O_CREAT | os.O_WRONLY, 0o600)
        crash = guards.enter_context(note.with_suffix(CRASH).open("w", encoding="utf-8"))
    except FileNotFoundError:  # Ctrl-C has ended the work, and removed its folder, before it began here
        os._exit(1)
    # Standard output belongs to the results of the process that hands out the work.
    os.dup2(2, 1)
    guards.enter_context(guarded_output(shown=False))
    guards.enter_context(plug_ins_cannot_end_the_process())
    tell_uncaught()
    guards.enter_context(Watch(STANDSTILL, tell_standstill))
    faulthandler.enable(crash)
    guards.enter_context(Watch(stalled_after, functools.partial(_stop_work, note.with_suffix(STALLED), stalled_after)))


def _stop_work(note: Path, stalled_after: float) -> None:
    """End this process, which has not completed a step for long, and leave a note with the line at which it was."""
    if not _PROCESS_STATE["key"]:
        return  # nothing is asked of this process
    place = where_is(threading.main_thread().ident or 0)
    reason = f"no step was completed for {stalled_after:g} s (`stalled_after` of the study)"
    note.write_text(f"{place}: {reason}" if place else reason, encoding="utf-8")
    os._exit(1)


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


def _rehearse(step: Task) -> Mapping[str, Any] | None:
    _PROCESS_STATE["key"] = "rehearsal"
    beat()
    try:
        return _PROCESS_STATE["bench"].rehearse(step)  # type: ignore[no-any-return]
    finally:
        _PROCESS_STATE["key"] = ""


def _note(key: str) -> None:
    _PROCESS_STATE["key"] = key
    os.lseek(_PROCESS_STATE["note"], 0, os.SEEK_SET)
    os.write(_PROCESS_STATE["note"], f"{key:32}".encode("ascii"))
