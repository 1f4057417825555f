"""Studies: many runs, distributed to workers, resumed after any interruption, collected in one table.

The way of a row: `spec` reads the plan in its `layout` and draws its points, `tasks` makes them tasks, and the bench of
`perform` gives each a key. A `Session` gives the tasks that are left to workers (`pool`), where the bench reads their
cases, makes the runs and says what is kept of each, and `columns` measures them. `study_table` keeps the rows, shows
them, and makes one of them again.
"""

from __future__ import annotations

import os
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

from percuss.case.arguments import expect_files
from percuss.errors import InputError, wrong_input
from percuss.files import expect_no_input, expect_place, expect_writable, locked
from percuss.interrupt import interruptible
from percuss.jsonable import Data, Entries, as_lists
from percuss.results.provenance import keys_of, machine, origins
from percuss.studies import pool
from percuss.studies.perform import LOST, Bench, Record
from percuss.studies.spec import StudySpec, read_study, refuse_wrong_values
from percuss.studies.study_table import Store, Study
from percuss.studies.tasks import NAMES, Task, tasks

OWN = "percuss"  # distribution of the methods that come with it
BATCH_SECONDS = 0.4  # between two batches of rows that are stored
AGAIN = ("failed", "unstable", "refused", "done")  # statuses whose runs are made again on request
Progress = Callable[[int, int], None]
Makers = Callable[[Bench, Sequence[Task], threading.Event], Iterator[Record | None]]


def study(
    path: str | Path | Data,
    out: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    *,
    plugins: Sequence[str | Path] = (),
    again: Sequence[str] = (),
    outputs: Sequence[str | os.PathLike[str]] = (),
    changes: Data | None = None,
    longest: float | None = None,
) -> Study:
    """Make the runs of a study that are not made yet.

    Parameters
    ----------
    path
        Path of a study file, or its contents as a mapping.
    out
        File of the rows; by default the name of the study with the ending ``.sqlite``, in the current folder. Runs
        stored in it whose inputs have not changed are not made again, except those that were lost.
    workers
        Number of processes; by default one per core. With 1 the runs are made in this process.
    scheduler
        Address of a Dask scheduler whose workers make the runs instead.
    progress
        Called with (rows made, rows in all).
    plugins
        Single-file plug-ins besides those that the cases name.
    again
        Statuses, as ``failed``, whose runs are made again although their inputs have not changed.
    outputs
        Files that the caller writes afterwards, checked before any run is made.
    changes
        Values that every case gets besides those of its ``set``, by dotted path, as ``{"reference.refine": 4}``.
    longest
        Seconds that a run may take in a worker process; by default any time.

    Returns
    -------
    Study
        Not `complete` if Ctrl-C ended it early: all finished batches are kept, and the same call resumes from there.

    Raises
    ------
    InputError
        If the study, a case or a varied path is wrong, or `out` is no file of a study or is being written by
        another process, or an output cannot be written or is a file that the study reads; nothing was run then.
    PluginError
        If one of `plugins` cannot be used.
    """
    expect_files("percuss.study", plugins)
    pool.number_of_workers(workers)
    unknown = [status for status in again if status not in AGAIN]
    if unknown:
        message = f"expected one of {', '.join(AGAIN)}, found '{unknown[0]}'"
        raise wrong_input("--again", message, "Lost runs are always made again.")
    spec = read_study(path, [Path(plugin) for plugin in plugins], changes)
    file = Path(out or ("study.sqlite" if isinstance(path, Mapping) else f"{Path(path).stem}.sqlite"))
    expect_no_input(file, spec.inputs)
    for output in outputs:
        expect_writable(output, [*spec.inputs, ("file of rows", file)])
    planned_tasks, bench = planned(spec)
    most = len(planned_tasks)
    with session(spec, bench, file, workers=workers, scheduler=scheduler, longest=longest, most=most) as running:
        return running.make(planned_tasks, progress, again)


def planned(spec: StudySpec) -> tuple[list[Task], Bench]:
    """Return the tasks of all runs of a study, and the bench that makes them."""
    bench = Bench.of(spec.cases, spec.rows)
    read = []
    for task in tasks(spec.cases, spec.integrators, spec.contacts, spec.points, tied=spec.section.tied):
        row = {**{name: getattr(task, name) for name in NAMES}, **task.varied}
        if all(condition.holds(row) for condition in spec.section.where):
            read.append(bench.with_key(task))
    if not read:
        raise InputError([spec.source.problem(("where",), "leaves no run to be made", "Loosen a condition.")])
    refuse_wrong_values(spec, read)
    return [task for task, _ in read], bench


# ------------------------------------------------------------------------------------------------- making rows


@contextmanager
def session(
    spec: StudySpec,
    bench: Bench,
    file: Path,
    *,
    workers: int | None,
    scheduler: str | None = None,
    longest: float | None = None,
    most: int,
) -> Iterator[Session]:
    """Lock the file of a study against all other processes, and start workers with the first run.

    Parameters
    ----------
    spec, bench
        The study, and where its runs are made.
    file
        File of the rows.
    workers, scheduler, longest
        As in `study`.
    most
        Largest number of runs at once.

    Raises
    ------
    InputError
        If the file is none of a study, or another process writes to it.
    """
    expect_place(file)
    with locked(file), ExitStack() as ends:
        store = Store(file, new=True)
        made: Makers = _made_here
        if scheduler is not None or workers != 1:
            number = min(pool.number_of_workers(workers), most)
            elsewhere = pool.cluster(scheduler) if scheduler is not None else pool.processes(number, longest)
            made = partial(pool.made, ends.enter_context(elsewhere), longest)
        yield Session(spec, bench, store, made)
        store.finish()


class Session:
    """The rows of a study that are being made.

    Parameters
    ----------
    spec, bench
        The study, and where its runs are made.
    store
        File of its rows.
    made
        Makes runs, and yields the record of each as it ends, and None now and then while none does.
    """

    def __init__(self, spec: StudySpec, bench: Bench, store: Store, made: Makers) -> None:
        self._spec, self._bench, self._store, self._made = spec, bench, store, made

    def make(self, planned: Sequence[Task], progress: Progress | None = None, again: Sequence[str] = ()) -> Study:
        """Make the runs of these tasks, which are all of the study so far, and store them as they end.

        Runs that are stored already are not made again, but for lost ones and those with a status in `again`.
        """
        finished = self._store.finished_keys(again)
        missing = list({task.key: task for task in planned if task.key not in finished}.values())
        self._store.begin(self._facts(), planned)
        study = Study(self._store.path)
        study.found = done = sum(task.key in finished for task in planned)
        rows, report = Counter(task.key for task in planned), progress or (lambda *_: None)
        report(done, len(planned))
        with interruptible() as stop:
            for records in _batches(self._made(self._bench, missing, stop)) if missing else ():
                self._store.add(records)
                done += sum(rows[record.key] for record in records)
                report(done, len(planned))
        return study

    def _facts(self) -> Entries:
        """Return what the file tells of the study besides its rows."""
        cases = {
            label: {
                "case": as_lists(case.data),
                **origins(case, keys_of(self._bench.components[label])),
                "data_files": self._bench.sources[label].data_files,
            }
            for label, case in self._spec.cases.items()
        }
        plugins = {name: origin for case in cases.values() for name, origin in case["plugins"].items()}
        theirs = {name: origin for name, origin in plugins.items() if origin["distribution"] != OWN}
        units = [case.data.get("units") or {} for case in self._spec.cases.values()]
        return {
            "spec": self._spec.data,
            "columns": {column.name: column.what for column in self._spec.rows.columns},
            "cases": cases,
            "units": {kind: name for kind, name in units[0].items() if all(one.get(kind) == name for one in units)},
            "provenance": {**machine(), "cores": os.cpu_count(), "plugins": theirs},
        }


def _made_here(bench: Bench, tasks: Sequence[Task], stop: threading.Event) -> Iterator[Record]:
    """Make runs in this process, and yield the record of each, until none is left or `stop` is set."""
    for task in tasks:
        record = bench.record(task)
        if not (stop.is_set() and record.status == LOST):  # one was interrupted
            yield record
        if stop.is_set():
            return


def _batches(made: Iterable[Record | None]) -> Iterator[list[Record]]:
    """Yield the records that end in each `BATCH_SECONDS`; those before an error, before it is raised."""
    records, since = list[Record](), time.monotonic()
    try:
        for record in made:
            records += [record] if record is not None else []
            if time.monotonic() - since > BATCH_SECONDS:
                yield records
                records, since = [], time.monotonic()
    except Exception:
        yield records
        raise
    yield records
