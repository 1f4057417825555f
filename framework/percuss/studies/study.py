"""Studies: many runs, spread over workers, resumed after any interruption, gathered in one table."""

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
AGAIN = ("failed", "unstable", "refused", "done")  # statuses whose runs are made again where that is asked for
SECONDS = "wall time of the march alone, the least of its repeats; the processor is in the provenance"
NAMES = ("case", "integrator", "contact")


class Study:
    """A study as far as it was run; it reads its file anew for what is asked, so it can be watched while it runs.

    Attributes
    ----------
    path
        The file.
    found
        How many rows were there before this call ran any; 0 for a study that was only opened.
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
        """What each measured column is, in words: quantity, norm, averaging."""
        return {**(self._store.fact("columns") or {}), "seconds": SECONDS}

    @property
    def provenance(self) -> dict[str, Any]:
        """Versions, machine and plug-ins of the last session that ran the study; ``sessions`` has them all.

        ``processors`` says how many rows were made on each model of processor.
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
        """A row a run, in the order of the study.

        Columns are ``case``, ``integrator``, ``contact``, the varied paths (nothing where the methods have no such
        option), ``status`` (done, unstable, refused, failed; lost where the machine or percuss itself failed; waiting
        where the run is still to be made), ``reason``, ``said_by``, ``fragile``, what is measured, ``node_steps``
        (steps times nodes), ``seconds`` (of the march alone, the least of its repeats) and ``key``.
        """
        import pandas as pd

        rows = self.rows()
        numbers = [name for name in self.columns if rows and name in rows[0]]
        table = pd.DataFrame(rows, columns=list(rows[0]) if rows else None)
        for name in numbers:  # a column of nothing but None is one of numbers too
            if table[name].isna().all():
                table[name] = table[name].astype(float)
        return table

    def rows(self) -> list[dict[str, Any]]:
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
        """How many rows have each status."""
        return dict(Counter(status or "waiting" for _, status, *_ in self._store.rows()))

    @property
    def complete(self) -> bool:
        """Whether every run was made, and none was lost to the machine."""
        return not {"waiting", LOST} & set(self.counts)

    def histories(self, key: str) -> dict[str, Any] | None:
        """Return what is kept of a run's histories (`keep`); None where nothing is.

        Returns
        -------
        dict
            ``time`` (T,), ``contact`` (names), ``contact_force`` and ``contact_force_exact`` (T, contacts).
        """
        return self._store.histories(key)

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write the table as csv or parquet, by suffix; beside and then renamed.

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
                # a column of words and numbers becomes one of words: parquet has one type a column
                mixed = [name for name in table if len({type(v) for v in table[name] if v is not None}) > 1]
                table.astype(dict.fromkeys(mixed, str)).to_parquet(beside, index=False)

    def __repr__(self) -> str:
        told = ", ".join(f"{count} {status}" for status, count in self.counts.items())
        return f"<percuss.Study {self.title!r}: {told or 'no rows'}>"


def open_study(path: str | os.PathLike[str]) -> Study:
    """Return a study written by `study`, also one that is being written.

    Raises
    ------
    InputError
        If there is no such file, or it is not of a study.
    """
    return Study(path)


def exportable(path: str | os.PathLike[str]) -> str:
    """Return the suffix of a file that a table can be written to.

    Raises
    ------
    InputError
        If it is another, or what writes it is not installed.
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
        Of a study file; or the same as a mapping.
    out
        File of the rows; by default the study's name with the ending ``.sqlite``, in the current folder, and with some
        letters more where that holds another study. Runs that it holds and that nothing changed for are not made
        again, but for those that were lost to the machine.
    workers
        Number of processes; by default one a core. With 1 the runs are made in this process.
    scheduler
        Address of a Dask scheduler, whose workers then make the runs.
    progress
        Called with (rows there, rows in all).
    plugins
        Single-file plug-ins beside those that the cases name.
    again
        Statuses, as ``failed``, whose runs are made again although nothing changed for them.

    Returns
    -------
    Study
        Not `complete` where Ctrl-C ended it early: every finished batch is kept, and the same call goes on from there.

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
    spec = read_study(path, [Path(one) for one in plugins])
    jobs, bench = _planned(spec)
    with _claimed(out, path, spec, {job.key for job in jobs}) as (file, identity):
        known = Store(file).known(again) if _holds_something(file) else set()
        missing = list({job.key: job for job in jobs if job.key not in known}.values())
        if missing:
            _rehearse(spec, missing)
        store = Store(file, new=True)
        _begin(store, spec, jobs, _command(path, plugins), identity)
        done = Study(store.path)
        done.found = sum(job.key in known for job in jobs)
        if missing:
            _make(bench, missing, store, workers, scheduler, _counted(progress, jobs, known), spec)
    return done


def _holds_something(path: Path) -> bool:
    return path.exists() and path.stat().st_size > 0


@contextmanager
def _claimed(
    out: str | os.PathLike[str] | None, given: str | Path | Mapping[str, Any], spec: StudySpec, keys: set[str]
) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Hold the file of a study against all other processes, once it is known to hold no other study.

    Raises
    ------
    InputError
        If it does, or another process writes to it.
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
    """Return the files that the rows of a study may be kept in, the first that is free or its own.

    Studies of one name in several folders each have a file of their own: the second is called by its place too.
    """
    if isinstance(given, Mapping):
        return [Path(f"{name}.sqlite")]
    place = hashlib.sha256(str(Path(given).resolve()).encode()).hexdigest()[:6]
    first, second = Path(f"{name}.sqlite"), Path(f"{name}-{place}.sqlite")
    return [second] if second.exists() else [first, second]


def _identity(given: str | Path | Mapping[str, Any], spec: StudySpec, out: Path) -> dict[str, Any]:
    """Return what a study is known by: its file, by its place and by that as seen from `out`; without one, its title.

    A study whose plan changes stays the same study, and so does one that moves together with its rows.
    """
    told = {"title": str(spec.data.get("title", "")), "cases": _listed(spec.data.get("cases", ()))}
    if isinstance(given, Mapping):
        return {"file": None, "beside": None, **told}
    file = Path(given).resolve()
    try:
        beside = os.path.relpath(file, out.resolve().parent)
    except ValueError:  # on another drive
        beside = None
    return {"file": str(file), "beside": beside, **told}


def _is_same(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Return whether two identities are of one study."""
    if one.get("file") is None or other.get("file") is None:
        return all(one.get(name) == other.get(name) for name in ("file", "title", "cases"))
    return any(one.get(name) is not None and one.get(name) == other.get(name) for name in ("file", "beside"))


def _other_study(file: Path, identity: Mapping[str, Any], keys: set[str]) -> InputError | None:
    """Return what to say where a file holds another study; None where it does not."""
    if not _holds_something(file):
        return None
    store = Store(file)
    held = store.fact("study")
    if held is None or _is_same(held, identity) or store.planned() == keys:
        return None
    message = f"holds another study: {_named(held)}; this is {_named(identity)}"
    return InputError([Problem(str(file), "", message, "Name another file with -o, or remove this one.")])


def _named(identity: Mapping[str, Any]) -> str:
    title = f"'{identity.get('title')}'" if identity.get("title") else "one without a title"
    return f"{title} of {identity.get('file') or 'a mapping'}"


def _expect_writable(path: Path) -> None:
    """Raise InputError where a file is still to be made, and cannot be."""
    if not _holds_something(path):
        attempt = replacing(path, path.suffix)
        attempt.__enter__()
        attempt.__exit__(OSError, None, None)


def _planned(spec: StudySpec) -> tuple[list[Job], Bench]:
    """Return all runs of a study with their keys, and what workers need to make them."""
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
    """Make one step of each kind of run: it compiles for all workers, and shows what a summary holds.

    Raises
    ------
    InputError
        If a measure is in none of the summaries.
    """
    from percuss.studies.preflight import check_measures, first_steps

    check_measures(spec, first_steps(spec.cases, [job.task for job in missing]))


def _command(given: str | Path | Mapping[str, Any], plugins: Sequence[str | Path]) -> str | None:
    """Return the command that makes a study again, or None where there is no file of it."""
    if isinstance(given, Mapping):
        return None
    return shlex.join(["percuss", "study", str(given), *(word for one in plugins for word in ("--plugin", str(one)))])


def _begin(
    store: Store, spec: StudySpec, jobs: Sequence[Job], command: str | None, identity: Mapping[str, Any]
) -> None:
    """Write down what the study is and who runs it."""
    files = {
        str(path): source.version
        for case in spec.cases.values()
        for path in case.registry.files
        for source in case.registry.sources.values()
        if source.file == str(path)
    }
    facts = {"study": identity, "spec": _listed(spec.data), "columns": {one.name: one.what for one in spec.columns}}
    plan = (
        (
            job.key,
            {
                "case": job.task.case,
                "integrator": job.task.integrator,
                "contact": job.task.contact,
                "varied": _listed(job.task.varied),
            },
        )
        for job in jobs
    )
    store.begin(facts, {**machine(), "cores": os.cpu_count(), "plugins": files, "command": command}, plan)


def _listed(value: Any) -> Any:
    """Return plain data as JSON has it."""
    if isinstance(value, Mapping):
        return {str(key): _listed(item) for key, item in value.items()}
    return [_listed(item) for item in value] if isinstance(value, list | tuple) else value


def _counted(progress: Progress | None, jobs: Sequence[Job], known: set[str]) -> Callable[[Sequence[Record]], None]:
    """Return what counts rows as their records come in."""
    rows = Counter(job.key for job in jobs)
    there = sum(count for key, count in rows.items() if key in known)

    def count(records: Sequence[Record]) -> None:
        nonlocal there
        there += sum(rows[one.key] for one in records)
        if progress is not None:
            progress(there, len(jobs))

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
    """Make runs and keep them batch by batch, until all are made or Ctrl-C."""
    from percuss.interrupt import interruptible
    from percuss.studies.workers import run_here, run_local

    tasks = {job.key: job.task for job in jobs}

    def keep(records: Sequence[Record]) -> None:
        records = [_judged(record, tasks[record.key], spec) for record in records]
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


def _judged(record: Record, task: Task, spec: StudySpec) -> Record:
    """Return a record as it is to be kept: a case that can be read here and could not be there was lost, not wrong."""
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
