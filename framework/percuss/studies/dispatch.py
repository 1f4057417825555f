"""Runs of a study given to this process, to local processes or to a cluster, and stored batch by batch."""

from __future__ import annotations

import dataclasses
import os
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, closing, nullcontext

from percuss.errors import InputError, wrong_input
from percuss.interrupt import interruptible
from percuss.jit import announced
from percuss.jsonable import Data
from percuss.studies.job_package import Bench, Job, Record
from percuss.studies.perform import LOST
from percuss.studies.spec import StudySpec
from percuss.studies.store import Store
from percuss.studies.tasks import Task
from percuss.studies.workers import LocalWorkers

Progress = Callable[[int, int], None]


def make(
    bench: Bench,
    jobs: Sequence[Job],
    store: Store,
    scheduler: str | None,
    local: LocalWorkers | None,
    count: Callable[[Sequence[Record]], None],
    spec: StudySpec,
) -> None:
    """Make runs and store them batch by batch, until all are made or Ctrl-C.

    They are made by the workers of the scheduler, or else by the local workers, or else in this process.
    """
    from percuss.studies.workers import Batches, made_here, made_locally

    tasks, batches = {job.key: job.task for job in jobs}, Batches(jobs)
    with interruptible() as stop:
        if scheduler is not None:
            from percuss.studies.cluster import made_on_cluster

            made = made_on_cluster(bench, scheduler, batches, stop)
        else:
            made = made_here(bench, batches, stop) if local is None else made_locally(local, batches, stop)
        with closing(made):
            for batch, records in made:
                kept = [_record_to_store(record, tasks[record.key], spec) for record in records]
                if kept:
                    store.add(kept)
                    count(kept)
                batches.put_back(batch, records)


def summaries_of(local: LocalWorkers | None, bench: Bench, steps: Sequence[Task]) -> list[Data]:
    """Make the rehearsals of a study, by a local worker or else in this process, and return their summaries.

    Raises
    ------
    KeyboardInterrupt
        If Ctrl-C ended them.
    """
    summaries: list[Data | None] = []
    with interruptible() as stop:
        if local is not None:
            with announced():
                summaries += local.rehearse(steps, stop)
        for step in steps if local is None else ():
            summaries.append(bench.rehearse(step))
            if stop.is_set():
                break
        if stop.is_set():
            raise KeyboardInterrupt
    return [summary for summary in summaries if summary is not None]


def local_workers(
    bench: Bench, count: int, workers: int | None, scheduler: str | None, stalled_after: float
) -> AbstractContextManager[LocalWorkers | None]:
    """Return the local workers for `count` runs, or nothing where the runs are to be made in this process.

    A run that never returns, or that ends its process, can only be given up where it is not made in this process: so
    that is left to those who ask for it with ``workers=1``. With a scheduler one local worker rehearses the study.
    """
    from percuss.studies.workers import LocalWorkers

    if workers == 1 and scheduler is None:
        return nullcontext()
    number = 1 if scheduler is not None else min(number_of_workers(workers), count)
    return LocalWorkers(bench, number, stalled_after)


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


def _record_to_store(record: Record, task: Task, spec: StudySpec) -> Record:
    """Return the record to store: a run whose case is readable here but not by the worker was lost, not wrong."""
    if not record.unread:
        return record
    try:
        spec.cases[task.case].with_overrides(task.changes)
    except InputError:
        return record
    reason = f"the worker process cannot read the case: {record.reason}"
    return dataclasses.replace(record, status=LOST, reason=reason)


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
