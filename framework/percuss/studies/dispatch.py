"""Runs of a study given to this process, to local processes or to a cluster, and stored as they end."""

from __future__ import annotations

import os
import threading
import time
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, closing

from percuss.errors import wrong_input
from percuss.interrupt import interruptible
from percuss.studies.job_package import Bench, Job, Record
from percuss.studies.pool import Workers
from percuss.studies.store import Store

Progress = Callable[[int, int], None]
SECONDS = 0.4  # between two batches of rows that are stored


def make(
    bench: Bench,
    jobs: Sequence[Job],
    store: Store,
    count: Callable[[Sequence[Record]], None],
    *,
    workers: int | Workers | None,
    scheduler: str | None,
    longest: float | None,
) -> None:
    """Make runs and store them as they end, until all are made or Ctrl-C.

    The workers of the scheduler make them, or local ones, or with one worker this process: a run that never returns, or
    that ends its process, can only be given up where it is not made here.
    """
    with interruptible() as stop, ExitStack() as ends:
        if scheduler is not None:
            from percuss.studies.cluster import made_on_cluster

            made = made_on_cluster(bench, jobs, scheduler, stop)
        elif workers == 1:
            made = _made_here(bench, jobs, stop)
        else:
            if not isinstance(workers, Workers):
                workers = ends.enter_context(Workers(min(number_of_workers(workers), len(jobs))))
            made = workers.made(bench, jobs, longest, stop)
        for records in ends.enter_context(closing(made)):
            if records:
                store.add(records)
                count(records)


def _made_here(bench: Bench, jobs: Sequence[Job], stop: threading.Event) -> Generator[list[Record]]:
    """Make runs in this process, and yield the records of each `SECONDS`, until none is left or `stop` is set."""
    records: list[Record] = []
    since = time.monotonic()
    for job in jobs:
        made = None if stop.is_set() else bench.record(job)
        if made is None:
            break
        records.append(made)
        if time.monotonic() - since > SECONDS:
            yield records
            records, since = [], time.monotonic()
    yield records


def row_counter(
    progress: Progress | None, jobs: Sequence[Job], finished: set[str]
) -> Callable[[Sequence[Record]], None]:
    """Report the progress so far; return a function that counts the rows of incoming records and reports it again."""
    rows = Counter(job.key for job in jobs)
    count_made = sum(count for key, count in rows.items() if key in finished)

    def count(records: Sequence[Record]) -> None:
        nonlocal count_made
        count_made += sum(rows[record.key] for record in records)
        if progress is not None:
            progress(count_made, len(jobs))

    count([])
    return count


def number_of_workers(given: int | None) -> int:
    """Return the number of worker processes: the given one, or the number of cores that this process may use.

    Raises
    ------
    InputError
        If it is less than 1.
    """
    if given is not None:
        if given < 1:
            raise wrong_input("--workers", f"expected a number of at least 1, found {given}")
        return given
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
