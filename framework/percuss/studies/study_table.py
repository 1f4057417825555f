"""The SQLite file of a study, what a reader sees of it, and its rows made again: one row per run, readable at any time.

A batch of rows is one transaction: if a process is killed at any moment, the batches that it finished are complete. A
row is found by the key of the inputs of its run, so that the same run is never made twice.
"""

from __future__ import annotations

import contextlib
import functools
import json
import os
import shlex
import sqlite3
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from percuss.case.arguments import expect_suffix
from percuss.case.case import Case
from percuss.case.hints import file_advice
from percuss.errors import InputError, UnwrittenError, nearest, wrong_input
from percuss.files import is_file, replacing
from percuss.jsonable import Data, Entries, as_lists
from percuss.results.provenance import case_inside, keys_of, machine, origins
from percuss.results.rerun import Rerun, changes, row_differences
from percuss.studies.columns import RowSettings
from percuss.studies.perform import LOST, WAITING, Record, label_of, perform, record, tied_twin, unpacked
from percuss.studies.spec import settings_of
from percuss.studies.tasks import NAMES, Task

if TYPE_CHECKING:
    import pandas as pd

FORMAT = 6  # the `user_version` of the file
BEGUN = (
    "CREATE TABLE IF NOT EXISTS facts (name TEXT PRIMARY KEY, value TEXT)",
    "CREATE TABLE IF NOT EXISTS plan (number INTEGER PRIMARY KEY, key TEXT, row TEXT)",
    "CREATE TABLE IF NOT EXISTS runs (key TEXT PRIMARY KEY, status TEXT, row TEXT, histories BLOB)",
    "DELETE FROM facts",
    "DELETE FROM plan",
    f"PRAGMA user_version = {FORMAT}",
)
ANOTHER = "Use an undamaged copy, or make the study again: percuss study STUDY -o NEW.sqlite."
OUTCOME = ("status", "reason", "said_by", "fragile")
SECONDS = "wall time of the time steps alone, the least of its repeats; the provenance names the processor"


class Store:
    """The file of a study.

    Parameters
    ----------
    path
        Path of the file.
    new
        Whether the file may be missing or empty; `begin` makes it then.

    Raises
    ------
    InputError
        If there is no such file, or it is not the file of a study.
    """

    def __init__(self, path: str | os.PathLike[str], *, new: bool = False) -> None:
        self.path = Path(path)
        self._there = is_file(self.path)
        if self._there:
            query = "SELECT user_version, (SELECT count(*) FROM sqlite_master) FROM pragma_user_version"
            ((found, tables),) = self.select(query)
            self._there = tables > 0  # a study that begins, or was killed then, has none yet
            if self._there and found != FORMAT:
                what = "one of an earlier version" if 0 < found < FORMAT else "another SQLite file"
                raise self._error(f"expected the file of a study of format {FORMAT}, found {what}", ANOTHER)
        elif not new:
            near = nearest(self.path.stem, [file.stem for file in self.path.parent.glob("*.sqlite")])
            advice = f"Did you mean '{self.path.with_name(near)}.sqlite'?" if near else "Make one with `percuss study`."
            raise self._error("expected the file of a study, found nothing that can be read", advice)

    def _error(self, message: str, advice: str) -> InputError:
        return wrong_input(str(self.path), message, advice)

    @contextmanager
    def _open(self, *, write: bool = False) -> Iterator[sqlite3.Connection]:
        """Open a connection for a with statement, whose body is one transaction, also of all that it reads."""
        mode = "rw" if self._there else "rwc"
        try:  # a file that may only be read is opened to read it
            with closing(sqlite3.connect(f"{self.path.absolute().as_uri()}?mode={mode}", timeout=60.0, uri=True)) as db:
                if write:
                    db.execute("PRAGMA journal_mode = WAL")
                with db:
                    db.execute("BEGIN IMMEDIATE" if write else "BEGIN")
                    yield db
        except sqlite3.Error as error:
            if getattr(error, "sqlite_errorcode", 0) == sqlite3.SQLITE_NOTADB:
                other = file_advice(str(self.path), self.path.read_bytes(), texts=True)
                found, advice = other or ("no SQLite file", ANOTHER)
                raise self._error(f"expected the file of a study, found {found}", advice) from error
            if write:
                message = f"cannot be written to: {error}; all rows stored before are kept"
                advice = "When the file can be written again, the same command continues."
                raise UnwrittenError(f"{self.path}: {message}. {advice}") from error
            raise self._error(f"cannot be read: {error}", ANOTHER) from error

    # ------------------------------------------------------------------------------------------- writing

    def begin(self, facts: Data, plan: Iterable[Task]) -> None:
        """Store facts and the plan, a task for every row.

        Rows that are no longer in the plan are kept: a later plan may need them again.
        """
        with self._open(write=True) as db:
            for statement in BEGUN:
                db.execute(statement)
            db.executemany("INSERT INTO facts VALUES (?, ?)", [(name, json.dumps(facts[name])) for name in facts])
            rows = [(task.key, json.dumps(as_lists(vars(task)))) for task in plan]
            db.executemany("INSERT INTO plan (key, row) VALUES (?, ?)", rows)
        self._there = True

    def add(self, records: Sequence[Record]) -> None:
        """Store a batch of rows: all of them or, if the process dies meanwhile, none."""
        rows = [
            (one.key, one.status, json.dumps({**vars(one), "histories": ""}), one.histories or None) for one in records
        ]
        with self._open(write=True) as db:
            db.executemany("INSERT OR REPLACE INTO runs VALUES (?, ?, ?, ?)", rows)

    def finish(self) -> None:
        """Put all rows into the one file, which then opens in a folder that cannot be written to."""
        with contextlib.suppress(sqlite3.Error), closing(sqlite3.connect(self.path)) as db:  # unless somebody reads it
            db.execute("PRAGMA journal_mode = DELETE")

    # ------------------------------------------------------------------------------------------- reading

    def select(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        """Return the rows that a query of SQL finds; none in a file that is still to be made."""
        if not self._there:
            return []
        with self._open() as db:
            return db.execute(query, values).fetchall()

    def fact(self, name: str) -> Any:
        """Return one of the facts that `begin` stored, which is empty if there is none."""
        return json.loads(next(iter(self.select("SELECT value FROM facts WHERE name = ?", name)), ["{}"])[0])

    def finished_keys(self, again: Sequence[str] = ()) -> set[str]:
        """Return the keys of the stored runs to be kept: all but the lost ones and those with a status in `again`."""
        return {key for key, status in self.select("SELECT key, status FROM runs") if status not in (LOST, *again)}


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
    def spec(self) -> Entries:
        """The study file as plain data."""
        return self._store.fact("spec")  # type: ignore[no-any-return]

    @property
    def columns(self) -> dict[str, str]:
        """Definition of each measured column in words: quantity, norm, averaging."""
        return {**self._store.fact("columns"), "seconds": SECONDS}

    @property
    def units(self) -> dict[str, str]:
        """Names of the units by kind, as ``{"length": "m"}``, that all cases of the study give."""
        return self._store.fact("units")  # type: ignore[no-any-return]

    @property
    def provenance(self) -> Entries:
        """Versions, machine and plug-ins of the last session that ran the study.

        ``processors`` is the number of rows made on each model of processor.
        """
        processors = Counter(run.cpu for _, run in self.rows() if run.cpu)
        return {**self._store.fact("provenance"), "processors": dict(sorted(processors.items()))}

    @property
    def cases(self) -> dict[str, Entries]:
        """What a case is read again from, by label, as the provenance of a result has it."""
        provenance = self.provenance
        return {label: {**provenance, **case} for label, case in self._store.fact("cases").items()}

    def rows(self) -> list[tuple[Task, Record]]:
        """Return the task and the run of each row, without its histories, in the order of the study."""
        query = "SELECT plan.row, runs.row FROM plan LEFT JOIN runs USING (key) ORDER BY number"
        rows = ((Task(**json.loads(task)), run) for task, run in self._store.select(query))
        return [(task, Record(task.key, WAITING) if run is None else Record(**json.loads(run))) for task, run in rows]

    def command(self, key: str) -> str:
        """Return the command that makes the run of a row alone."""
        return shlex.join(["percuss", "run", str(self.path), "--row", key])

    @property
    def title(self) -> str:
        """Title of the study."""
        return str(self.spec.get("title", ""))

    @property
    def table(self) -> pd.DataFrame:
        """The table of the study: one row per run, in the order of the study.

        Columns are ``case``, ``integrator``, ``contact``, the varied paths (nothing where the methods have no such
        option), ``status`` (done, unstable, refused, failed; lost where the machine failed; waiting
        where the run is still to be made), ``reason``, ``said_by``, ``fragile``, the measures, ``node_steps``
        (steps times stages times nodes), ``seconds`` (of the march alone, the smallest of its repeats) and ``key``.
        """
        import pandas as pd

        table = pd.DataFrame(self.as_records())
        # A column of None alone is numeric too.
        return table.astype({name: float for name in self.columns if name in table and table[name].isna().all()})

    def as_records(self) -> list[Entries]:
        """Return the rows of `table` as plain mappings, all with the same keys."""
        rows, columns = self.rows(), [name for name in self.columns if name != "seconds"]
        varied = dict.fromkeys(path for task, _ in rows for path in task.varied)
        return [
            {
                **{name: getattr(task, name) for name in NAMES},
                **{path: task.varied.get(path) for path in varied},
                **{name: getattr(run, name) for name in OUTCOME},
                **{name: (run.measures or {}).get(name) for name in columns},
                "seconds": run.seconds,
                "key": task.key,
            }
            for task, run in rows
        ]

    @property
    def counts(self) -> dict[str, int]:
        """Number of rows with each status."""
        return dict(Counter(run.status for _, run in self.rows()))

    @property
    def complete(self) -> bool:
        """Whether every run was made, and none was lost to the machine."""
        return not {WAITING, LOST} & set(self.counts)

    @property
    def with_histories(self) -> set[str]:
        """Keys of the runs whose histories are kept."""
        return {key for (key,) in self._store.select("SELECT key FROM runs WHERE histories IS NOT NULL")}

    def histories(self, key: str) -> Entries | None:
        """Return the histories of a run that are kept (`keep`), or None if there are none.

        Returns
        -------
        dict
            ``time`` (T,), ``contact`` (names), ``contact_force`` and ``contact_force_exact`` (T, contacts).
        """
        found = self._store.select("SELECT histories FROM runs WHERE key = ? AND histories IS NOT NULL", key)
        return unpacked(found[0][0]) if found else None

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write the table as csv, to a temporary file that is then renamed.

        Raises
        ------
        InputError
            If the suffix is another, or the folder cannot be written to.
        """
        with replacing(path, expect_suffix(path, "a table", (".csv",), "Name it table.csv.")) as beside:
            self.table.to_csv(beside, index=False)

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


# --------------------------------------------------------------------------------------------- rows made again


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
    if not keys:
        raise wrong_input(str(path), "expected rows that are done, found none", "Make them with `percuss study`.")
    for key in keys:
        made.append(rows.rerun(key))
        if progress is not None:
            progress(len(made), len(keys))
    return made


def _numbers(row: Record, timed: set[str]) -> Entries:
    """Return what two runs of a row have in common: outcome and measures, but for times of the wall clock."""
    measures = {name: value for name, value in (row.measures or {}).items() if name not in timed}
    return {"status": row.status, "fragile": row.fragile, **measures}
