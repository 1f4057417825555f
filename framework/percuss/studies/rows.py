"""A row of a study made again: its run alone, from what the file of the study holds of its case."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from percuss.case.case import Case
from percuss.errors import nearest, wrong_input
from percuss.jsonable import Entries
from percuss.results.differences import changes, row_differences
from percuss.results.provenance import case_inside, machine, origins
from percuss.results.rerun import Rerun
from percuss.studies.columns import RowSettings
from percuss.studies.job_package import Record, record, unpacked
from percuss.studies.perform import label_of, perform_timed, tied_twin
from percuss.studies.spec import settings_of
from percuss.studies.study_table import Study
from percuss.studies.tasks import Task


@dataclass(frozen=True)
class StoredRow:
    """A row of a study with its case.

    Attributes
    ----------
    key
        Key of its run.
    case
        The case as the study has it, without the changes of the row.
    task
        Methods and changes of the row.
    """

    key: str
    case: Case
    task: Task

    @property
    def changed(self) -> Case:
        """The case with the changes of the row, which ties its contacts if the row is a tied twin."""
        changed = self.case.with_overrides(self.task.changes)
        return tied_twin(changed) if self.task.tied else changed


def stored_row(study: Study, start: str, plugins: Sequence[Path] = ()) -> StoredRow:
    """Return the row of a study whose key begins with a text.

    Parameters
    ----------
    study
        The study.
    start
        The key, or its first letters.
    plugins
        Single-file plug-ins that stand in for those of the study.

    Raises
    ------
    InputError
        If no row or several rows have such a key, or the case cannot be read; see `case_inside`.
    """
    plan = study.plan
    keys = [key for key in plan if key.startswith(start)]
    if len(keys) != 1:
        near = nearest(start, list(plan))
        advice = f"Did you mean '{near}'?" if near else "The column `key` of the table and the report have the keys."
        raise wrong_input(f"--row {start}", f"expected the key of one row of {study.path}, found {len(keys)}", advice)
    row = plan[keys[0]]
    names = row["case"], row["integrator"], row["contact"]
    task = Task(*names, varied=row["varied"], changes=row["changes"], tied=row["twin"])
    case = case_inside(study.cases[task.case], plugins=plugins, name=f"{study.path} --row {start}")
    return StoredRow(keys[0], case, task)


def rerun_rows(
    path: Path, start: str, plugins: Sequence[Path] = (), progress: Callable[[int, int], None] | None = None
) -> list[Rerun]:
    """Make rows of a study again, and compare what the study holds of each to the last bit.

    Parameters
    ----------
    path
        The file of the study.
    start
        Key of the row, or its first letters; empty for all rows that are done.
    plugins
        Single-file plug-ins that stand in for those of the study.
    progress
        Called with (rows made, rows in all).

    Raises
    ------
    InputError
        As `stored_row`.
    """
    study, made = Study(path), []
    done = [row["key"] for row in study.as_records() if row["status"] == "done"]
    for key in [start] if start else dict.fromkeys(done):
        one = stored_row(study, key, plugins)
        made.append(_rerun(study, one, settings_of(study.spec, {one.task.case: one.case}, one.task.varied)))
        if progress is not None:
            progress(len(made), 1 if start else len(done))
    return made


def _rerun(study: Study, one: StoredRow, settings: RowSettings) -> Rerun:
    task, about = one.task, study.cases[one.task.case]
    run = perform_timed(one.case, task, nudge=settings.nudge, repeats=1, critical_step=settings.critical_step)
    if run.status == "interrupted":
        raise KeyboardInterrupt
    now, then = record(one.key, run, settings, 0.0, one.case.registry), study.record(one.key)
    timed = {column.name for column in settings.columns if column.path.startswith("seconds")}
    arrays = unpacked(now.histories) if now.histories else {}
    found = row_differences(_numbers(then, timed), _numbers(now, timed), study.histories(one.key) or {}, arrays)
    components = [(family, name) for family, _, name in (each.partition("/") for each in about["plugins"])]
    since = changes(about, {**machine(), **origins(one.case, components)})
    label = f"{task.case}: {label_of(task.integrator, task.contact, task.varied)}"
    return Rerun(f"{study.path} --row {one.key[:12]}", label, tuple(found), tuple(since))


def _numbers(row: Record, timed: set[str]) -> Entries:
    """Return what two runs of a row have in common: outcome and measures, but for times of the wall clock."""
    measures = {name: value for name, value in (row.measures or {}).items() if name not in timed}
    return {"status": row.status, "fragile": row.fragile, **measures}
