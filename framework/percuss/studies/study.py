"""Studies: many runs, distributed to workers, resumed after any interruption, collected in one table.

The way of a row: `spec` reads the plan, `parameters` draws its points, `tasks` makes them tasks, `run_key` gives each a
key, `claim` locks the file of rows, `preflight` tries each kind of run, `dispatch` gives the tasks that are left to
workers, where `job_package` reads their cases, `perform` makes the runs, `columns` measures them and `stored_run` packs
them; `store` keeps the rows, the command of each (`row_command`) and the files that they came from (`study_files`), and
`study_table` shows them.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from percuss.case.arguments import expect_files, expect_mapping_or_path
from percuss.errors import InputError, Problem
from percuss.filelock import NotWritableError
from percuss.files import expect_no_input, expect_writable
from percuss.jsonable import Data
from percuss.results.provenance import machine
from percuss.studies.claim import claimed
from percuss.studies.dispatch import Progress, local_workers, make, row_counter, summaries_of
from percuss.studies.job_package import Bench, Job
from percuss.studies.row_command import RowCommands
from percuss.studies.spec import StudySpec
from percuss.studies.store import Store, as_json_data
from percuss.studies.study_files import files_of
from percuss.studies.study_table import Study

AGAIN = ("failed", "unstable", "refused", "done")  # statuses whose runs are made again on request


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
    from percuss.studies.preflight import check_measures, rehearsals
    from percuss.studies.spec import read_study

    expect_mapping_or_path("percuss.study", path)
    expect_files("percuss.study", plugins)
    if workers is not None and workers < 1:
        raise InputError([Problem("--workers", "", f"expected a number of at least 1, found {workers}")])
    unknown = [status for status in again if status not in AGAIN]
    if unknown:
        message = f"expected one of {', '.join(AGAIN)}, found '{unknown[0]}'"
        raise InputError([Problem("--again", "", message, "Lost runs are always made again.")])
    spec = read_study(path, [Path(plugin) for plugin in plugins])
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
            with local_workers(bench, len(missing), workers, scheduler, spec.stalled_after) as local:
                if missing:
                    steps = rehearsals(spec.cases, [job.task for job in missing])
                    check_measures(spec, summaries_of(local, spec.cases, steps))
                commands = RowCommands(
                    spec.data.get("set", {}), [Path(file) for file in plugins], nudge=spec.rows.nudge
                )
                _begin(store, spec, jobs, bench, commands, {"command": _command(path, plugins)}, {"study": identity})
                done = Study(store.path)
                done.found = sum(job.key in finished for job in jobs)
                if missing:
                    make(bench, missing, store, scheduler, local, row_counter(progress, jobs, finished), spec)
    except NotWritableError as error:
        made = None if again else _finished_study(error.path, jobs)
        if made is None:
            raise
        return made
    return done


def _finished_study(file: Path, jobs: Sequence[Job]) -> Study | None:
    """Return the study in a file that cannot be written to if all its runs are made and planned there, else None."""
    store = Store(file, new=True)
    keys = {job.key for job in jobs}
    if store.planned() != keys or keys - store.finished_keys():
        return None
    done = Study(file)
    done.found = len(jobs)
    return done


def planned(spec: StudySpec) -> tuple[list[Job], Bench]:
    """Return the jobs of all runs of a study, and the bench that workers need to make them."""
    from percuss.studies.job_package import Job, packed
    from percuss.studies.parameters import combinations
    from percuss.studies.preflight import check_points
    from percuss.studies.run_key import Keys
    from percuss.studies.tasks import tasks

    check_points(spec)
    points = combinations(spec.vary, spec.paired, spec.sample)
    keys = Keys(spec.rows)
    jobs = []
    for label, case in spec.cases.items():
        for task in tasks(label, case, spec.integrators, spec.contacts, points, tied=spec.tied):
            names = {"case": label, "integrator": task.integrator, "contact": task.contact, **task.varied}
            if all(condition.holds(names) for condition in spec.where):
                jobs.append(Job(keys.of(label, case, task), task))
    if not jobs:
        raise InputError([spec.source.problem(("where",), "leaves no run to be made", "Loosen a condition.")])
    return jobs, packed(spec.cases, spec.rows, keys)


def _command(given: str | Path | Data, plugins: Sequence[str | Path]) -> str | None:
    """Return the command that makes a study again, or None if the study has no file."""
    if isinstance(given, Mapping):
        return None
    return shlex.join(
        ["percuss", "study", str(given), *(word for plugin in plugins for word in ("--plugin", str(plugin)))]
    )


def _begin(
    store: Store,
    spec: StudySpec,
    jobs: Sequence[Job],
    bench: Bench,
    commands: RowCommands,
    provenance: Data,
    facts: Data,
) -> None:
    """Store the facts, the files, the provenance and the plan of the study."""
    plugins = {
        str(path): source.version
        for case in spec.cases.values()
        for path in case.registry.files
        for source in case.registry.sources.values()
        if source.file == str(path)
    }
    plan = [
        (
            job.key,
            {
                "case": job.task.case,
                "integrator": job.task.integrator,
                "contact": job.task.contact,
                "varied": as_json_data(job.task.varied),
                "command": commands.index_of(job.task.case, spec.cases[job.task.case], job.task),
            },
        )
        for job in jobs
    ]
    facts = {
        **facts,
        "spec": as_json_data(spec.data),
        "columns": {column.name: column.what for column in spec.rows.columns},
        "commands": commands.templates,
    }
    provenance = {**machine(), "cores": os.cpu_count(), "plugins": plugins, **provenance}
    store.begin(facts, provenance, plan, files_of(spec, bench))
