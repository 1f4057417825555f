"""The SQLite file of the rows of a study: one row per run, readable while it is written.

A batch of rows is one transaction of a write-ahead log: if a process is killed at any moment, the batches that it
finished are complete. A row is found by the key of the inputs of its run, so that the same run is never made twice.
"""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from percuss.errors import InputError, Problem, UnwrittenError, shortened
from percuss.files import is_file, is_folder, replacing, unwritten
from percuss.studies.perform import LOST
from percuss.studies.row_command import Template, command_of
from percuss.studies.stored_run import Record, unpacked
from percuss.studies.study_files import StudyFile

__all__ = ["Store"]

FORMAT = "percuss-study-2"
TABLES = """
BEGIN;
CREATE TABLE IF NOT EXISTS facts (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS sessions (number INTEGER PRIMARY KEY, provenance TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS plan (number INTEGER PRIMARY KEY, key TEXT NOT NULL, row TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS runs (
    key TEXT PRIMARY KEY, status TEXT NOT NULL, reason TEXT NOT NULL, said_by TEXT NOT NULL, fragile INTEGER,
    seconds REAL, measures TEXT, session INTEGER NOT NULL, compiling REAL, cpu TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS histories (key TEXT PRIMARY KEY, arrays BLOB NOT NULL);
INSERT OR REPLACE INTO facts VALUES ('format', '"percuss-study-2"');
COMMIT;
"""
DAMAGED_ADVICE = "Take a copy of it that is whole, or name another file with -o and make the runs again."
# Errors of SQLite that come from the machine and not from the file.
OF_THE_MACHINE = {
    *(sqlite3.SQLITE_FULL, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED),
    *(sqlite3.SQLITE_IOERR, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM, sqlite3.SQLITE_NOMEM),
}
STATUSES = {None, "done", "unstable", "refused", "failed", "interrupted", LOST}  # None: not yet made
FILES = """
CREATE TABLE IF NOT EXISTS files (
    path TEXT PRIMARY KEY, role TEXT NOT NULL, sha256 TEXT NOT NULL, bytes INTEGER NOT NULL, text TEXT)
"""  # not among `TABLES`: a file of the same format made before there was this table gets it with its next session
WORKER = "worker"  # `said_by` of a run that was lost with its worker


class Store:
    """The file of a study.

    Parameters
    ----------
    path
        Path of the file.
    new
        Whether to create the file if it is missing, and to write to it.

    Raises
    ------
    InputError
        If there is no such file, it is not the file of a study, or it cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str], *, new: bool = False) -> None:
        self.path = Path(path)
        self.session = 0
        if is_folder(self.path):
            raise self._error("expected a file, found a folder", "Name a file in it.")
        if not new and not is_file(self.path):
            message = "expected the file of a study, found nothing that can be read"
            raise self._error(message, "Make one with `percuss study`.")
        if new and not (is_file(self.path) and self.path.stat().st_size):
            try:
                with replacing(self.path, ".sqlite") as beside, closing(sqlite3.connect(beside)) as db:
                    db.execute("PRAGMA journal_mode = WAL")
                    db.executescript(TABLES)
            except sqlite3.OperationalError as error:
                raise unwritten(self.path, str(error)) from error
        with self._open(write=new) as db:
            self._check(db)

    def _error(self, message: str, advice: str = "") -> InputError:
        return InputError([Problem(str(self.path), "", message, advice)])

    @contextmanager
    def _open(self, *, write: bool = False) -> Iterator[sqlite3.Connection]:
        """Open a connection for a with statement, whose body is one transaction and decodes what it reads."""
        try:
            with closing(self._connected(write=write)) as db, db:
                yield db
        except sqlite3.DatabaseError as error:
            code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT) & 0xFF  # without its finer distinctions
            if code == sqlite3.SQLITE_NOTADB:
                raise self._error(f"expected the file of a study, found something else ({error})") from error
            if code in OF_THE_MACHINE and write:
                message = f"cannot be written to: {error}; all rows stored before are kept"
                advice = "The same command goes on from there, when there is room."
                raise UnwrittenError(f"{self.path}: {message}. {advice}") from error
            if code in OF_THE_MACHINE:
                raise self._error(f"cannot be read: {error}", "Name another file with -o.") from error
            raise self._damaged(str(error)) from error
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:  # of decoding
            raise self._damaged(f"{type(error).__name__}: {error}") from error

    def _damaged(self, reason: str) -> InputError:
        return self._error(f"the file is damaged: {shortened(reason, 200)}", DAMAGED_ADVICE)

    def _connected(self, *, write: bool) -> sqlite3.Connection:
        """Return a connection; a file in a folder that cannot be written to is read as it is.

        SQLite otherwise puts a file beside a database with a write-ahead log, also to read it. A log that still holds
        rows cannot be read without that file.
        """
        if write or os.access(self.path.parent, os.W_OK, effective_ids=os.access in os.supports_effective_ids):
            return sqlite3.connect(self.path, timeout=60.0)
        log = self.path.with_name(f"{self.path.name}-wal")
        if log.exists() and log.stat().st_size:
            message = f"cannot be read: {log.name} beside it holds rows, and this folder cannot be written to"
            raise self._error(message, "Copy both files to a folder of yours.")
        return sqlite3.connect(f"{self.path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)

    def _check(self, db: sqlite3.Connection) -> None:
        tables = {name for (name,) in db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if "facts" not in tables:
            kind = "another SQLite file" if tables else "an empty one"
            raise self._error(f"expected the file of a study, found {kind}", "Name another file.")
        actual = self._fact(db, "format")
        if actual != FORMAT:
            raise self._error(f"expected the format {FORMAT}, found {actual}", "Name another file.")
        (verdict,) = db.execute("PRAGMA quick_check(1)").fetchone()
        if verdict != "ok":
            raise self._damaged(str(verdict).replace("\n", ": "))

    @staticmethod
    def _fact(db: sqlite3.Connection, name: str) -> Any:
        row = db.execute("SELECT value FROM facts WHERE name = ?", (name,)).fetchone()
        return json.loads(row[0]) if row is not None else None

    # ------------------------------------------------------------------------------------------- writing

    def begin(
        self,
        facts: Mapping[str, Any],
        provenance: Mapping[str, Any],
        plan: Iterable[tuple[str, Mapping[str, Any]]],
        files: Iterable[StudyFile] = (),
    ) -> None:
        """Store facts, files and provenance of this session, and the plan: key and names of every row.

        Rows that are no longer in the plan are kept: a later plan may need them again.
        """
        with self._open(write=True) as db:
            for name, value in facts.items():
                db.execute("INSERT OR REPLACE INTO facts VALUES (?, ?)", (name, json.dumps(value)))
            db.execute("DELETE FROM plan")
            rows = ((n, key, json.dumps(row)) for n, (key, row) in enumerate(plan))
            db.executemany("INSERT INTO plan VALUES (?, ?, ?)", rows)
            db.execute(FILES)
            db.execute("DELETE FROM files")
            columns = ((file.path, file.role, file.sha256, file.size, file.text) for file in files)
            db.executemany("INSERT INTO files VALUES (?, ?, ?, ?, ?)", columns)
            cursor = db.execute("INSERT INTO sessions (provenance) VALUES (?)", (json.dumps(provenance),))
            self.session = cursor.lastrowid or 0

    def add(self, records: Sequence[Record]) -> None:
        """Store a batch of rows: all of them or, if the process dies meanwhile, none."""
        rows = [
            (
                record.key,
                record.status,
                record.reason,
                record.said_by,
                record.fragile,
                record.seconds,
                json.dumps(record.measures) if record.measures is not None else None,
                self.session,
                record.compiling,
                record.cpu,
            )
            for record in records
        ]
        with self._open(write=True) as db:
            db.executemany("INSERT OR REPLACE INTO runs VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", rows)
            histories = [(record.key, record.histories) for record in records if record.histories]
            db.executemany("INSERT OR REPLACE INTO histories VALUES (?, ?)", histories)

    # ------------------------------------------------------------------------------------------- reading

    def finished_keys(self, again: Sequence[str] = ()) -> set[str]:
        """Return the keys of the stored runs to be kept: all but the lost ones and those with a status in `again`."""
        with self._open() as db:
            statuses = db.execute("SELECT key, status FROM runs").fetchall()
        return {key for key, status in statuses if status != LOST and status not in again}

    def planned(self) -> set[str]:
        """Return the keys of all rows of the plan."""
        with self._open() as db:
            return {key for (key,) in db.execute("SELECT key FROM plan")}

    def processors(self) -> dict[str, int]:
        """Return the number of rows of the plan made on each model of processor."""
        with self._open() as db:
            return dict(
                db.execute(
                    "SELECT cpu, COUNT(*) FROM plan JOIN runs ON runs.key = plan.key WHERE cpu != '' GROUP BY cpu"
                )
            )

    def fact(self, name: str) -> dict[str, Any] | None:
        """Return a fact that `begin` stored, or None if it stored no such fact."""
        with self._open() as db:
            fact = self._fact(db, name)
            return dict(fact) if fact is not None else None

    def statuses(self) -> list[str | None]:
        """Return the status of each row of the plan, None for a run not yet made."""
        with self._open() as db:
            return [status for (status,) in db.execute("SELECT status FROM plan LEFT JOIN runs ON runs.key = plan.key")]

    def sessions(self) -> list[dict[str, Any]]:
        """Return the provenance of each session in which the study was run, oldest first."""
        with self._open() as db:
            sessions = [json.loads(text) for (text,) in db.execute("SELECT provenance FROM sessions ORDER BY number")]
            return [dict(session) for session in sessions]

    def files(self) -> list[StudyFile]:
        """Return the files that the study came from; none if it was made before files were kept."""
        with self._open() as db:
            if db.execute("SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = 'files'").fetchone() is None:
                return []
            files = [StudyFile(*row) for row in db.execute("SELECT * FROM files ORDER BY rowid")]
            if not all(file.is_sound for file in files):
                raise ValueError("a file that was kept with the study cannot be what was stored")
            return files

    def row_commands(self) -> tuple[list[Template], list[int | None]]:
        """Return the templates of the commands, and for each row of the plan, in order, the index of its template."""
        with self._open() as db:
            templates = self._fact(db, "commands") or []
            rows = db.execute("SELECT row FROM plan ORDER BY number")
            indices = [json.loads(row).get("command") for (row,) in rows]
            if not all(index is None or 0 <= index < len(templates) for index in indices):
                raise ValueError("the commands of the rows cannot be what was stored")
            return list(templates), indices

    def command(self, key: str) -> str | None:
        """Return the command of the first row of the plan with a key, or None if it has none."""
        with self._open() as db:
            found = db.execute("SELECT row FROM plan WHERE key = ? ORDER BY number", (key,)).fetchone()
            row = json.loads(found[0]) if found is not None else {}
            index = row.get("command")
            return None if index is None else command_of(self._fact(db, "commands")[index], row["varied"])

    def rows(self) -> list[tuple[Any, ...]]:
        """Return the rows of the plan in order: names and outcome of each run, or None for a run not yet made."""
        with self._open() as db:
            rows = db.execute(
                "SELECT plan.row, status, reason, said_by, fragile, measures, seconds, plan.key FROM plan "
                "LEFT JOIN runs ON runs.key = plan.key ORDER BY plan.number"
            )
            return [_decoded(*row) for row in rows]

    def histories(self, key: str) -> dict[str, Any] | None:
        """Return the stored arrays of a run, or None if there are none."""
        with self._open() as db:
            row = db.execute("SELECT arrays FROM histories WHERE key = ?", (key,)).fetchone()
            return unpacked(row[0]) if row is not None else None


def _decoded(  # the columns of the query in `Store.rows`
    text: str, status: Any, reason: Any, said_by: Any, fragile: Any, measured: str | None, seconds: Any, key: Any
) -> tuple[Any, ...]:
    """Return a row with names and measures as mappings; raise an error if no `Store` stored it."""
    names = json.loads(text)
    measures = json.loads(measured) if measured is not None else None
    values = [] if measures is None else list(measures.values())
    as_stored = {
        "its plan": isinstance(names["varied"], dict)
        and all(isinstance(names[name], str) for name in ("case", "integrator", "contact")),
        "its status": status in STATUSES,
        "its reason": isinstance(reason, str | None) and isinstance(said_by, str | None),
        "its numbers": isinstance(seconds, float | None) and isinstance(fragile, int | None),
        "its measures": all(isinstance(value, str | int | float | None) for value in values),
    }
    if not all(as_stored.values()):
        wrong = next(part for part, right in as_stored.items() if not right)
        raise ValueError(f"{wrong} in the row {key!r} cannot be what was stored")
    return names, status, reason, said_by, fragile, measures, seconds, key


def as_json_data(value: Any) -> Any:
    """Return plain data with lists and text keys, as in JSON."""
    if isinstance(value, Mapping):
        return {str(key): as_json_data(item) for key, item in value.items()}
    return [as_json_data(item) for item in value] if isinstance(value, list | tuple) else value
