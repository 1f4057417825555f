"""Studies: many runs, distributed to workers, resumed after any interruption, collected in one table.

The way of a row: `spec` reads the plan, `parameters` draws its points, `tasks` makes them tasks, `job_package` gives
each a key, the file of rows is locked, `dispatch` gives the tasks that are left to workers (`pool`, `cluster`), where
`job_package` reads their cases, `perform` makes the runs and `columns` measures them; `store` keeps the
rows and the files that they came from (`study_files`), `study_table` shows them, and `rows` makes one of them again.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from percuss.case.arguments import expect_files
from percuss.case.case import Case
from percuss.digest import content_digest
from percuss.errors import InputError, shortened, wrong_input
from percuss.files import expect_no_input, expect_place, expect_writable
from percuss.jsonable import Data, Entries, as_lists
from percuss.locks import NotWritableError, locked
from percuss.results.provenance import keys_of, machine, origins
from percuss.studies.dispatch import Progress, make, number_of_workers, row_counter
from percuss.studies.job_package import Bench, Job
from percuss.studies.pool import Workers
from percuss.studies.spec import StudySpec
from percuss.studies.store import Store, as_json_data
from percuss.studies.study_files import files_of
from percuss.studies.study_table import Study

OWN = "percuss"  # distribution of the methods that come with it
AGAIN = ("failed", "unstable", "refused", "done")  # statuses whose runs are made again on request


def study(
    path: str | Path | Data,
    out: str | os.PathLike[str] | None = None,
    workers: int | Workers | None = None,
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
        File of the rows; by default the name of the study with the ending ``.sqlite``, in the current folder, and with
        some letters added if that file holds another study. Runs stored in it whose inputs have not changed are not
        made again, except those that failed because of the machine.
    workers
        Number of processes; by default one per core. With 1 the runs are made in this process. Or workers that serve
        several studies.
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
        If the study, a case or a varied path is wrong, or `out` holds another study or is being written by another
        process, or an output cannot be written or is a file that the study reads; nothing was run then.
    PluginError
        If one of `plugins` cannot be used.
    """
    from percuss.studies.preflight import check_measures
    from percuss.studies.spec import read_study

    expect_files("percuss.study", plugins)
    if not isinstance(workers, Workers):
        number_of_workers(workers)
    unknown = [status for status in again if status not in AGAIN]
    if unknown:
        message = f"expected one of {', '.join(AGAIN)}, found '{unknown[0]}'"
        raise wrong_input("--again", message, "Lost runs are always made again.")
    spec = read_study(path, [Path(plugin) for plugin in plugins], changes)
    if out is not None:
        expect_no_input(out, spec.inputs)
    for output in outputs:
        expect_writable(output, [*spec.inputs, *([("file of rows", Path(out))] if out is not None else [])])
    jobs, bench = planned(spec)
    try:
        with claimed(out, path, spec, {job.key for job in jobs}) as (file, identity):
            store = Store(file, new=True)
            finished = store.finished_keys(again)
            missing = list({job.key: job for job in jobs if job.key not in finished}.values())
            if workers == 1:  # the runs are made in this process, which has read the cases
                bench.read.update(spec.cases)
            if missing:
                check_measures(spec, missing[0].task)
            _begin(store, spec, jobs, bench, _command(path, plugins, changes), identity)
            done = Study(store.path)
            done.found = sum(job.key in finished for job in jobs)
            count = row_counter(progress, jobs, finished)
            if missing:
                make(bench, missing, store, count, workers=workers, scheduler=scheduler, longest=longest)
            store.finish()
    except NotWritableError as error:
        made = None if again else _finished_study(error.path, jobs)
        if made is None:
            raise
        row_counter(progress, jobs, {job.key for job in jobs})
        return made
    return done


def _finished_study(file: Path, jobs: Sequence[Job]) -> Study | None:
    """Return the study in a file that cannot be written to if all its runs are made and planned there, else None."""
    store = Store(file, new=True)
    keys = {job.key for job in jobs}
    if store.planned().keys() != keys or keys - store.finished_keys():
        return None
    done = Study(file)
    done.found = len(jobs)
    return done


def planned(spec: StudySpec) -> tuple[list[Job], Bench]:
    """Return the jobs of all runs of a study, and the bench that workers need to make them."""
    from percuss.studies.job_package import Job, Keys, packed
    from percuss.studies.parameters import combinations
    from percuss.studies.preflight import check_points
    from percuss.studies.tasks import tasks

    check_points(spec)
    points = combinations(spec.vary, spec.paired, spec.sample)
    keys = Keys(spec.rows)
    jobs = []
    for label, case in spec.cases.items():
        for task in tasks(label, case, spec.integrators, spec.contacts, points, tied=spec.section.tied):
            names = {"case": label, "integrator": task.integrator, "contact": task.contact, **task.varied}
            if all(condition.holds(names) for condition in spec.where):
                jobs.append(Job(keys.of(label, case, task), task))
    if not jobs:
        raise InputError([spec.source.problem(("where",), "leaves no run to be made", "Loosen a condition.")])
    return jobs, packed(spec.cases, spec.rows, keys)


def _command(given: str | Path | Data, plugins: Sequence[str | Path], changes: Data | None) -> str | None:
    """Return the command that makes a study again, or None if the study has no file."""
    if isinstance(given, Mapping):
        return None
    options = [word for plugin in plugins for word in ("--plugin", str(plugin))]
    if changes:
        values = (f"{path.removeprefix('reference.')}={value}" for path, value in changes.items())
        options += ["--reference", ",".join(values)]
    return shlex.join(["percuss", "study", str(given), *options])


def _begin(
    store: Store, spec: StudySpec, jobs: Sequence[Job], bench: Bench, command: str | None, identity: Data
) -> None:
    """Store the facts, the files, the provenance and the plan of a study."""
    plan = []
    for key, task in jobs:
        names = {"case": task.case, "integrator": task.integrator, "contact": task.contact, "twin": task.tied}
        plan.append((key, {**names, "varied": as_json_data(task.varied), "changes": as_json_data(task.changes)}))
    cases = {label: _inside(case, bench, label) for label, case in spec.cases.items()}
    plugins = {name: origin for case in cases.values() for name, origin in case["plugins"].items()}
    facts = {
        "study": identity,
        "spec": as_json_data(spec.data),
        "columns": {column.name: column.what for column in spec.rows.columns},
        "cases": cases,
        "units": _common_units([case.data.get("units") or {} for case in spec.cases.values()]),
    }
    theirs = {name: origin for name, origin in plugins.items() if origin["distribution"] != OWN}
    provenance = {**machine(), "cores": os.cpu_count(), "plugins": theirs, "command": command}
    store.begin(facts, provenance, plan, files_of(spec, bench))


def _inside(case: Case, bench: Bench, label: str) -> Entries:
    """Return a case with all from which it is read again, as the provenance of a result has it."""
    return {
        "case": as_lists(case.data),
        **origins(case, keys_of(bench.components[label])),
        "data_files": dict(bench.cases[label].data_files),
    }


def _common_units(of_cases: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return the names of units that all cases give."""
    return {kind: name for kind, name in of_cases[0].items() if all(units.get(kind) == name for units in of_cases)}


@contextmanager
def claimed(
    out: str | os.PathLike[str] | None, given: str | Path | Data, spec: StudySpec, keys: set[str]
) -> Iterator[tuple[Path, Entries]]:
    """Lock the file of a study against all other processes, after a check that it holds no other study.

    Raises
    ------
    InputError
        If it holds another study, or another process writes to it.
    """
    refused: InputError | None = None
    for file in [Path(out)] if out is not None else _default_files(given, spec.name):
        identity = _identity(given, spec, file)
        expect_place(file)
        with locked(file):
            refused = _other_study(file, identity, keys)
            if refused is None:
                yield file, identity
                return
    if refused is None:
        raise AssertionError("a study has no file and nothing says why")
    raise refused


def _default_files(given: str | Path | Data, name: str) -> list[Path]:
    """Return the default files for the rows of a study, of which the first that is free or its own is used.

    Studies of the same name in several folders have a file each: the name of the second also depends on its place.
    """
    if isinstance(given, Mapping):
        return [Path(f"{name}.sqlite")]
    place = content_digest(str(Path(given).resolve()).encode())[:6]
    first, second = Path(f"{name}.sqlite"), Path(f"{name}-{place}.sqlite")
    return [second] if second.exists() else [first, second]


def _identity(given: str | Path | Data, spec: StudySpec, out: Path) -> Entries:
    """Return the identity of a study: path of its file, absolute and relative to `out`, title and cases.

    A study remains the same if its plan changes, and if it moves together with its rows.
    """
    description = {"title": str(spec.data.get("title", "")), "cases": as_json_data(spec.data.get("cases", ()))}
    if isinstance(given, Mapping):
        return {"file": None, "beside": None, **description}
    file = Path(given).resolve()
    try:
        relative = os.path.relpath(file, out.resolve().parent)
    except ValueError:  # a path on another drive has no relative form
        relative = None
    return {"file": str(file), "beside": relative, **description}


def _is_same(first: Data, second: Data) -> bool:
    """Return whether two identities are of the same study."""
    if first.get("file") is None or second.get("file") is None:
        return all(first.get(name) == second.get(name) for name in ("file", "title", "cases"))
    return any(first.get(name) is not None and first.get(name) == second.get(name) for name in ("file", "beside"))


def _other_study(file: Path, identity: Data, keys: set[str]) -> InputError | None:
    """Return the error of a file that holds another study, or None if it does not."""
    store = Store(file, new=True)
    held = store.facts().get("study")
    if held is None or _is_same(held, identity) or store.planned().keys() == keys:
        return None
    message = f"holds another study: {_described(held)}; this is {_described(identity)}"
    return wrong_input(str(file), message, "Name another file with -o, or remove this one.")


def _described(identity: Data) -> str:
    title = f"'{identity.get('title')}'" if identity.get("title") else "one without a title"
    cases = ", ".join(map(str, identity.get("cases") or ()))
    return f"{title} of {identity.get('file') or shortened(cases)}"
