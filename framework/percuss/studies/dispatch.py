"""Runs of a study given to this process, to local processes or to a cluster, and stored batch by batch."""

from __future__ import annotations

import dataclasses
import os
from collections import Counter
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from percuss.errors import InputError
from percuss.interrupt import interruptible
from percuss.studies.perform import LOST

if TYPE_CHECKING:
    import threading

    from percuss.studies.job_package import Bench, Job
    from percuss.studies.spec import StudySpec
    from percuss.studies.store import Store
    from percuss.studies.stored_run import Record
    from percuss.studies.tasks import Task

__all__ = ["Progress", "make", "row_counter"]

Progress = Callable[[int, int], None]


def make(
    bench: Bench,
    jobs: Sequence[Job],
    store: Store,
    workers: int | None,
    scheduler: str | None,
    count: Callable[[Sequence[Record]], None],
    spec: StudySpec,
) -> None:
    """Make runs and store them batch by batch, until all are made or Ctrl-C."""
    from percuss.studies.workers import run_here, run_local

    tasks = {job.key: job.task for job in jobs}

    def keep(records: Sequence[Record]) -> None:
        records = [_record_to_store(record, tasks[record.key], spec) for record in records]
        if records:
            store.add(records)
            count(records)

    stop: threading.Event
    with interruptible() as stop:
        count([])
        if scheduler is not None:
            from percuss.studies.cluster import run_cluster

            run_cluster(bench, jobs, scheduler, keep, stop)
            return
        number = workers or _cores()
        if number == 1 or len(jobs) == 1:
            run_here(bench, jobs, keep, stop)
        else:
            run_local(bench, jobs, number, keep, stop)


def row_counter(
    progress: Progress | None, jobs: Sequence[Job], finished: set[str]
) -> Callable[[Sequence[Record]], None]:
    """Return a function that counts the rows of incoming records and reports the progress."""
    rows = Counter(job.key for job in jobs)
    count_made = sum(count for key, count in rows.items() if key in finished)

    def count(records: Sequence[Record]) -> None:
        nonlocal count_made
        count_made += sum(rows[record.key] for record in records)
        if progress is not None:
            progress(count_made, len(jobs))

    return count


def _record_to_store(record: Record, task: Task, spec: StudySpec) -> Record:
    """Return the record to store: a run whose case is readable here but not by the worker was lost, not wrong."""
    if not record.unread:
        return record
    try:
        spec.cases[task.case].with_overrides(task.changes)
    except InputError:
        return record
    reason = f"the process that was to make the run cannot read the case: {record.reason}"
    return dataclasses.replace(record, status=LOST, reason=reason)


def _cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
