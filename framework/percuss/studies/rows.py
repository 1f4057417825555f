"""A row of a study made again: its run alone, from what the file of the study holds of its case."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from percuss.case.case import Case
from percuss.errors import nearest, wrong_input
from percuss.jsonable import Entries
from percuss.results.provenance import case_inside, keys_of, machine, origins
from percuss.results.rerun import Rerun, changes, row_differences
from percuss.studies.columns import RowSettings
from percuss.studies.perform import Record, label_of, perform, record, tied_twin, unpacked
from percuss.studies.spec import settings_of
from percuss.studies.study_table import Study


class StoredRows:
    """The rows of a study with their cases, each of which is read once.

    Parameters
    ----------
    path
        The file of the study.
    plugins
        Single-file plug-ins that stand in for those of the study.

    Attributes
    ----------
    study
        The study.
    rows
        What it has of each row, by key.
    """

    def __init__(self, path: Path, plugins: Sequence[Path] = ()) -> None:
        self.study = Study(path)
        self.rows = {task.key: (task, run) for task, run in self.study.rows()}
        self._plugins, self._about, self._spec = plugins, self.study.cases, self.study.spec
        self._read = functools.cache(self._case)

    def key(self, start: str) -> str:
        """Return the key that begins with a text.

        Raises
        ------
        InputError
            If no row or several rows have such a key.
        """
        keys = [key for key in self.rows if key.startswith(start)]
        if len(keys) != 1:
            near = nearest(start, self.rows)
            advice = f"Did you mean '{near}'?" if near else "The column `key` of the table has the keys."
            message = f"expected the key of one row of {self.study.path}, found {len(keys)}"
            raise wrong_input(f"--row {start}", message, advice)
        return keys[0]

    def case(self, key: str) -> Case:
        """Return the case of a row with its changes, which ties its contacts if the row is a tied twin."""
        task, _ = self.rows[key]
        changed = task.changed(self._read(task.case)[0])
        return tied_twin(changed) if task.tied else changed

    def rerun(self, key: str) -> Rerun:
        """Make the run of a row again, and compare what the study holds of it to the last bit."""
        task, then = self.rows[key]
        about, (case, settings) = self._about[task.case], self._read(task.case)
        run = perform(case, task, replace(settings, repeats=1).run)
        if run.status == "interrupted":
            raise KeyboardInterrupt
        now = record(key, run, settings, case.registry)
        timed = {column.name for column in settings.columns if column.path.startswith("seconds")}
        arrays = unpacked(now.histories) if now.histories else {}
        found = row_differences(_numbers(then, timed), _numbers(now, timed), self.study.histories(key) or {}, arrays)
        since = changes(about, {**machine(), **origins(case, keys_of(about["plugins"]))})
        label = f"{task.case}: {label_of(task.integrator, task.contact, task.varied)}"
        return Rerun(f"{self.study.path} --row {key[:12]}", label, tuple(found), tuple(since))

    def _case(self, label: str) -> tuple[Case, RowSettings]:
        """Return the case of a label as the study has it, and the settings of its rows; see `case_inside`."""
        case = case_inside(self._about[label], plugins=self._plugins, name=str(self.study.path))
        return case, settings_of(self._spec, {label: case})


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
        If no row or several rows have such a key, or the case cannot be read; see `case_inside`.
    """
    rows, made = StoredRows(path, plugins), []
    keys = [rows.key(start)] if start else [key for key, (_, run) in rows.rows.items() if run.status == "done"]
    for key in keys:
        made.append(rows.rerun(key))
        if progress is not None:
            progress(len(made), len(keys))
    return made


def _numbers(row: Record, timed: set[str]) -> Entries:
    """Return what two runs of a row have in common: outcome and measures, but for times of the wall clock."""
    measures = {name: value for name, value in (row.measures or {}).items() if name not in timed}
    return {"status": row.status, "fragile": row.fragile, **measures}
