"""Studies: many runs, distributed to workers, resumed after any interruption, collected in one table."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import shlex
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from percuss.case.arguments import expect_files, expect_mapping_or_path
from percuss.errors import InputError, Problem
from percuss.filelock import BusyError, locked
from percuss.files import replacing
from percuss.results.provenance import machine
from percuss.studies.store import Store
from percuss.studies.tasks import LOST

if TYPE_CHECKING:
    import threading

    import pandas as pd

    from percuss.studies.job_package import Bench, Job
    from percuss.studies.spec import StudySpec
    from percuss.studies.stored_run import Record
    from percuss.studies.tasks import Task

__all__ = ["Study", "open_study", "study"]

Progress = Callable[[int, int], None]
AGAIN = ("failed", "unstable", "refused", "done")  # statuses whose runs are made again on request
SECONDS = "wall time of the march alone, the least of its repeats; the processor is in the provenance"
NAMES = ("case", "integrator", "contact")


class Study:
    """A study with the rows made so far; each access reads its file again, so that it can be watched while it runs.

    Attributes
    ----------
    path
        The file.
    found
        Number of rows that existed before this call made any; 0 for a study that was only opened.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.found = 0
        self._store = Store(self.path)

    @property
    def spec(self) -> dict[str, Any]:
        """The study file as plain data."""
        return dict(self._store.fact("spec") or {})

    @property
    def columns(self) -> dict[str, str]:
        """Definition of each measured column in words: quantity, norm, averaging."""
        return {**(self._store.fact("columns") or {}), "seconds": SECONDS}

    @property
    def provenance(self) -> dict[str, Any]:
        """Versions, machine and plug-ins of the last session that ran the study; ``sessions`` has them all.

        ``processors`` is the number of rows made on each model of processor.
        """
        sessions = self._store.sessions()
        last = sessions[-1] if sessions else {}
        return {**last, "sessions": sessions, "processors": self._store.processors()}

    @property
    def title(self) -> str:
        """Title of the study."""
        return str(self.spec.get("title", ""))

    @property
    def table(self) -> pd.DataFrame:
        """The table of the study: one row per run, in the order of the study.

        Columns are ``case``, ``integrator``, ``contact``, the varied paths (nothing where the methods have no such
        option), ``status`` (done, unstable, refused, failed; lost where the machine or percuss itself failed; waiting
        where the run is still to be made), ``reason``, ``said_by``, ``fragile``, the measures, ``node_steps``
        (steps times nodes), ``seconds`` (of the march alone, the smallest of its repeats) and ``key``.
        """
        import pandas as pd

        rows = self.as_records()
        numbers = [name for name in self.columns if rows and name in rows[0]]
        table = pd.DataFrame(rows, columns=list(rows[0]) if rows else None)
        for name in numbers:  # a column of None alone is numeric too
            if table[name].isna().all():
                table[name] = table[name].astype(float)
        return table

    def as_records(self) -> list[dict[str, Any]]:
        """Return the rows of `table` as plain mappings, all with the same keys."""
        raw = [(json.loads(row), *rest) for row, *rest in self._store.rows()]
        varied = dict.fromkeys(path for names, *_ in raw for path in names["varied"])
        columns = self.columns
        out = []
        for names, status, reason, said_by, fragile, measures, seconds, key in raw:
            measured = json.loads(measures) if measures else {}
            out.append(
                {
                    **{name: names[name] for name in NAMES},
                    **{path: names["varied"].get(path) for path in varied},
                    "status": status or "waiting",
                    "reason": reason or "",
                    "said_by": said_by or "",
                    "fragile": bool(fragile) if fragile is not None else None,
                    **{name: measured.get(name) for name in columns if name != "seconds"},
                    "seconds": seconds,
                    "key": key,
                }
            )
        return out

    @property
    def counts(self) -> dict[str, int]:
        """Number of rows with each status."""
        return dict(Counter(status or "waiting" for _, status, *_ in self._store.rows()))

    @property
    def complete(self) -> bool:
        """Whether every run was made, and none was lost to the machine."""
        return not {"waiting", LOST} & set(self.counts)

    def histories(self, key: str) -> dict[str, Any] | None:
        """Return the histories of a run that are kept (`keep`), or None if there are none.

        Returns
        -------
        dict
            ``time`` (T,), ``contact`` (names), ``contact_force`` and ``contact_force_exact`` (T, contacts).
        """
        return self._store.histories(key)

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write the table as csv or parquet, by suffix, to a temporary file that is then renamed.

        Raises
        ------
        InputError
            If the suffix is another, the folder cannot be written to, or pyarrow is missing.
        """
        suffix = exportable(path)
        table = self.table
        with replacing(path, suffix) as beside:
            if suffix == ".csv":
                table.to_csv(beside, index=False)
            else:
                # A column of words and numbers is written as words, as parquet has one type per column.
                mixed = [name for name in table if len({type(value) for value in table[name] if value is not None}) > 1]
                table.astype(dict.fromkeys(mixed, str)).to_parquet(beside, index=False)

    def __repr__(self) -> str:
        words = ", ".join(f"{count} {status}" for status, count in self.counts.items())
        return f"<percuss.Study {self.title!r}: {words or 'no rows'}>"


def open_study(path: str | os.PathLike[str]) -> Study:
    """Return a study written by `study`, also one that is being written.

    Raises
    ------
    InputError
        If there is no such file, or it is not the file of a study.
    """
    return Study(path)


def exportable(path: str | os.PathLike[str]) -> str:
    """Return the suffix of a file to which a table can be written.

    Raises
    ------
    InputError
        If the suffix is another, or the package that writes it is not installed.
    """
    from importlib.util import find_spec

    suffix = Path(path).suffix.lower()
    if suffix not in {".csv", ".parquet"}:
        problem = Problem(str(path), "", f"expected a name that ends in .csv or .parquet, found '{suffix}'")
        raise InputError([problem])
    if suffix == ".parquet" and find_spec("pyarrow") is None:
        advice = "Install percuss[study], or write csv."
        raise InputError([Problem(str(path), "", "parquet needs pyarrow, which is not installed", advice)])
    return suffix


def study(
    path: str | Path | Mapping[str, Any],
    out: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    *,
    plugins: Sequence[str | Path] = (),
    again: Sequence[str] = (),
) -> Study:
    """Make the runs of a study that are not made yet.

    Parameters
    ----------
    path
        Path of a study file, or its contents as a mapping.
    out
        File of the rows; by default the name of the study with the ending ``.sqlite``, in the current folder, and with
        some letters added if that file holds another study. Runs stored in it whose inputs have not changed are not
        made again, except those that were lost to the machine.
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

    Returns
    -------
    Study
        Not `complete` if Ctrl-C ended it early: all finished batches are kept, and the same call resumes from there.

    Raises
    ------
    InputError
        If the study, a case or a varied path is wrong, or `out` holds another study or is being written by another
        process; nothing was run then.
    PluginError
        If one of `plugins` cannot be used.
    """
    from percuss.studies.spec import read_study

    expect_mapping_or_path("percuss.study", path)
    expect_files("percuss.study", plugins)
    if workers is not None and workers < 1:
        raise InputError([Problem("--workers", "", f"expected a number of at least 1, found {workers}")])
    unknown = [status for status in again if status not in AGAIN]
    if unknown:
        message = f"expected one of {', '.join(AGAIN)}, found '{unknown[0]}'"
        raise InputError([Problem("--again", "", message, "Runs that were lost are always made again.")])
    spec = read_study(path, [Path(plugin) for plugin in plugins])
    jobs, bench = _planned(spec)
    with _claimed(out, path, spec, {job.key for job in jobs}) as (file, identity):
        finished = Store(file).finished_keys(again) if _has_content(file) else set()
        missing = list({job.key: job for job in jobs if job.key not in finished}.values())
        if missing:
            _rehearse(spec, missing)
        store = Store(file, new=True)
        _begin(store, spec, jobs, _command(path, plugins), identity)
        done = Study(store.path)
        done.found = sum(job.key in finished for job in jobs)
        if missing:
            _make(bench, missing, store, workers, scheduler, _row_counter(progress, jobs, finished), spec)
    return done


def _has_content(path: Path) -> bool:
    return path.exists() and path.stat().st_size > 0


@contextmanager
def _claimed(
    out: str | os.PathLike[str] | None, given: str | Path | Mapping[str, Any], spec: StudySpec, keys: set[str]
) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Lock the file of a study against all other processes, after a check that it holds no other study.

    Raises
    ------
    InputError
        If it holds another study, or another process writes to it.
    """
    refused: InputError | None = None
    for file in [Path(out)] if out is not None else _default_files(given, spec.name):
        identity = _identity(given, spec, file)
        _expect_writable(file)
        try:
            with locked(file, {"study": identity}):
                other = _other_study(file, identity, keys)
                if other is None:
                    yield file, identity
                    return
                refused = other
        except BusyError as error:
            holder = error.holder.get("study")
            if out is not None or not isinstance(holder, dict) or _is_same(holder, identity):
                raise
            refused = error
    if refused is None:
        raise AssertionError("a study has no file and nothing says why")
    raise refused


def _default_files(given: str | Path | Mapping[str, Any], name: str) -> list[Path]:
    """Return the default files for the rows of a study, of which the first that is free or its own is used.

    Studies of the same name in several folders have a file each: the name of the second also depends on its place.
    """
    if isinstance(given, Mapping):
        return [Path(f"{name}.sqlite")]
    place = hashlib.sha256(str(Path(given).resolve()).encode()).hexdigest()[:6]
    first, second = Path(f"{name}.sqlite"), Path(f"{name}-{place}.sqlite")
    return [second] if second.exists() else [first, second]


def _identity(given: str | Path | Mapping[str, Any], spec: StudySpec, out: Path) -> dict[str, Any]:
    """Return the identity of a study: path of its file, absolute and relative to `out`, title and cases.

    A study remains the same if its plan changes, and if it moves together with its rows.
    """
    description = {"title": str(spec.data.get("title", "")), "cases": _as_json_data(spec.data.get("cases", ()))}
    if isinstance(given, Mapping):
        return {"file": None, "beside": None, **description}
    file = Path(given).resolve()
    try:
        relative = os.path.relpath(file, out.resolve().parent)
    except ValueError:  # a path on another drive has no relative form
        relative = None
    return {"file": str(file), "beside": relative, **description}


def _is_same(first: Mapping[str, Any], second: Mapping[str, Any]) -> bool:
    """Return whether two identities are of the same study."""
    if first.get("file") is None or second.get("file") is None:
        return all(first.get(name) == second.get(name) for name in ("file", "title", "cases"))
    return any(first.get(name) is not None and first.get(name) == second.get(name) for name in ("file", "beside"))


def _other_study(file: Path, identity: Mapping[str, Any], keys: set[str]) -> InputError | None:
    """Return the error of a file that holds another study, or None if it does not."""
    if not _has_content(file):
        return None
    store = Store(file)
    held = store.fact("study")
    if held is None or _is_same(held, identity) or store.planned() == keys:
        return None
    message = f"holds another study: {_described(held)}; this is {_described(identity)}"
    return InputError([Problem(str(file), "", message, "Name another file with -o, or remove this one.")])


def _described(identity: Mapping[str, Any]) -> str:
    title = f"'{identity.get('title')}'" if identity.get("title") else "one without a title"
    return f"{title} of {identity.get('file') or 'a mapping'}"


def _expect_writable(path: Path) -> None:
    """Raise InputError if a file does not exist yet and cannot be created."""
    if not _has_content(path):
        attempt = replacing(path, path.suffix)
        attempt.__enter__()
        attempt.__exit__(OSError, None, None)


def _planned(spec: StudySpec) -> tuple[list[Job], Bench]:
    """Return the jobs of all runs of a study, and the bench that workers need to make them."""
    from percuss.studies.job_package import Job, packed
    from percuss.studies.parameters import combinations
    from percuss.studies.preflight import check_points
    from percuss.studies.run_key import Keys
    from percuss.studies.tasks import tasks

    points = combinations(spec.vary, spec.paired, spec.sample)
    check_points(spec, points)
    keys = Keys(spec.columns, nudge=spec.nudge, histories=spec.histories, repeats=spec.repeats)
    jobs = []
    for label, case in spec.cases.items():
        for task in tasks(label, case, spec.integrators, spec.contacts, points, tied=spec.tied):
            names = {"case": label, "integrator": task.integrator, "contact": task.contact, **task.varied}
            if all(condition.holds(names) for condition in spec.where):
                jobs.append(Job(keys.of(label, case, task), task))
    if not jobs:
        raise InputError([spec.source.problem(("where",), "leaves no run to be made", "Loosen a condition.")])
    return jobs, packed(
        spec.cases, spec.columns, keys, nudge=spec.nudge, histories=spec.histories, repeats=spec.repeats
    )


def _rehearse(spec: StudySpec, missing: Sequence[Job]) -> None:
    """Make one step of each kind of run, which compiles for all workers, and check the measures on its summary.

    Raises
    ------
    InputError
        If a measure is in none of the summaries.
    """
    from percuss.studies.preflight import check_measures, first_steps

    check_measures(spec, first_steps(spec.cases, [job.task for job in missing]))


def _command(given: str | Path | Mapping[str, Any], plugins: Sequence[str | Path]) -> str | None:
    """Return the command that makes a study again, or None if the study has no file."""
    if isinstance(given, Mapping):
        return None
    return shlex.join(
        ["percuss", "study", str(given), *(word for plugin in plugins for word in ("--plugin", str(plugin)))]
    )


def _begin(
    store: Store, spec: StudySpec, jobs: Sequence[Job], command: str | None, identity: Mapping[str, Any]
) -> None:
    """Store the facts, the provenance and the plan of the study."""
    files = {
        str(path): source.version
        for case in spec.cases.values()
        for path in case.registry.files
        for source in case.registry.sources.values()
        if source.file == str(path)
    }
    facts = {
        "study": identity,
        "spec": _as_json_data(spec.data),
        "columns": {column.name: column.what for column in spec.columns},
    }
    plan = (
        (
            job.key,
            {
                "case": job.task.case,
                "integrator": job.task.integrator,
                "contact": job.task.contact,
                "varied": _as_json_data(job.task.varied),
            },
        )
        for job in jobs
    )
    store.begin(facts, {**machine(), "cores": os.cpu_count(), "plugins": files, "command": command}, plan)


def _as_json_data(value: Any) -> Any:
    """Return plain data with lists and text keys, as in JSON."""
    if isinstance(value, Mapping):
        return {str(key): _as_json_data(item) for key, item in value.items()}
    return [_as_json_data(item) for item in value] if isinstance(value, list | tuple) else value


def _row_counter(
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


def _make(
    bench: Bench,
    jobs: Sequence[Job],
    store: Store,
    workers: int | None,
    scheduler: str | None,
    count: Callable[[Sequence[Record]], None],
    spec: StudySpec,
) -> None:
    """Make runs and store them batch by batch, until all are made or Ctrl-C."""
    from percuss.interrupt import interruptible
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
