"""The SQLite file of the rows of a study: one row per run, readable while it is written.

A batch of rows is one transaction of a write-ahead log: if a process is killed at any moment, the batches that it
finished are complete. A row is found by the key of the inputs of its run, so that the same run is never made twice.

Every row of every table ends with the digest of what stands before it, and a table of seals holds the sum of the
digests of each table: reading the file finds whatever was changed, moved, added or removed later. No table has an index
beside it that could disagree with it. The arrays of a run are larger: their digest stands in the row of the run.
"""

from __future__ import annotations

import contextlib
import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, TypeAlias

from percuss.case.hints import file_advice
from percuss.digest import content_digest
from percuss.errors import InputError, UnwrittenError, nearest, shortened, wrong_input
from percuss.files import is_file, is_folder, replacing
from percuss.jsonable import Data, Entries
from percuss.studies.job_package import Record, unpacked
from percuss.studies.perform import LOST, WAITING
from percuss.studies.study_files import StudyFile

Row: TypeAlias = tuple[Any, ...]  # of a table, as SQLite has it

FORMAT = "percuss-study-3"  # format 2 had no digests
COLUMNS = {
    "facts": "name TEXT PRIMARY KEY, value TEXT",
    "sessions": "number INTEGER PRIMARY KEY, provenance TEXT",
    "files": "number INTEGER PRIMARY KEY, path TEXT, role TEXT, sha256 TEXT, bytes INTEGER, text TEXT",
    "plan": "number INTEGER PRIMARY KEY, key TEXT, row TEXT",
    "runs": "key TEXT PRIMARY KEY, status TEXT, reason TEXT, said_by TEXT, fragile INTEGER, seconds REAL, "
    "measures TEXT, session INTEGER, compiling REAL, cpu TEXT, arrays_sha256 TEXT",
}
TABLES = {
    **{name: f"CREATE TABLE {name} ({columns}, digest TEXT) WITHOUT ROWID" for name, columns in COLUMNS.items()},
    "arrays": "CREATE TABLE arrays (key TEXT PRIMARY KEY, npz BLOB)",
    "seals": "CREATE TABLE seals (name TEXT PRIMARY KEY, sum TEXT) WITHOUT ROWID",
}
# Errors of SQLite that come from the machine and not from the file.
OF_THE_MACHINE = {
    *(sqlite3.SQLITE_FULL, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED),
    *(sqlite3.SQLITE_IOERR, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM, sqlite3.SQLITE_NOMEM),
}
WORKER = "worker"  # `said_by` of a run that was lost with its worker


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
        If there is no such file, it is not the file of a study, or it is damaged.
    """

    def __init__(self, path: str | os.PathLike[str], *, new: bool = False) -> None:
        self.path = Path(path)
        self.session = 0
        self._made_by = "percuss study STUDY"
        self._kept: dict[str, tuple[int, list[Row]]] = {}  # seal and rows of the tables that were read
        if is_folder(self.path):
            raise self._error("expected a file, found a folder", "Name a file in it.")
        there = is_file(self.path)
        if not new and not there:
            message = "expected the file of a study, found nothing that can be read"
            near = nearest(self.path.stem, [file.stem for file in self.path.parent.glob("*.sqlite")])
            advice = f"Did you mean '{self.path.with_name(near)}.sqlite'?" if near else "Make one with `percuss study`."
            raise self._error(message, advice)
        self._begun = there and (not new or self.path.stat().st_size > 0)
        if self._begun:
            with self._open() as db:
                self._check(db)

    def _error(self, message: str, advice: str = "") -> InputError:
        return wrong_input(str(self.path), message, advice)

    def _unusable(self, message: str) -> InputError:
        """Return the error of a file that is no study of this format as it was stored."""
        advice = f"Make the study again with `{self._made_by} -o NEW.sqlite`, or use an undamaged copy."
        return self._error(message, advice)

    @contextmanager
    def _open(self, *, write: bool = False) -> Iterator[sqlite3.Connection]:
        """Open a connection for a with statement, whose body is one transaction, also of all that it reads."""
        try:
            with closing(self._connected(write=write)) as db, db:
                db.execute("BEGIN IMMEDIATE" if write else "BEGIN")
                yield db
        except sqlite3.DatabaseError as error:
            code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT) & 0xFF  # without its finer distinctions
            if code == sqlite3.SQLITE_NOTADB:
                other = file_advice(str(self.path), self.path.read_bytes(), texts=True)
                if other is not None:
                    raise self._error(f"expected the file of a study, found {other[0]}", other[1]) from error
                raise self._unusable(f"expected the file of a study, found something else ({error})") from error
            if code in OF_THE_MACHINE and write:
                message = f"cannot be written to: {error}; all rows stored before are kept"
                advice = "When the file can be written again, the same command continues."
                raise UnwrittenError(f"{self.path}: {message}. {advice}") from error
            if code in OF_THE_MACHINE:
                raise self._error(f"cannot be read: {error}", "Name another file with -o.") from error
            raise self._damaged(str(error)) from error
        except UnicodeDecodeError as error:  # of a table's definition, or of what SQLite says of it
            raise self._damaged(str(error)) from error

    def _damaged(self, reason: str) -> InputError:
        return self._unusable(f"the file is damaged: {shortened(reason, 200)}")

    def _connected(self, *, write: bool) -> sqlite3.Connection:
        """Return a connection; a file in a folder that cannot be written to is read as it is.

        SQLite otherwise puts a file beside a database with a write-ahead log, also to read it. A log that still holds
        rows cannot be read without that file.
        """
        file = self.path.absolute().as_uri()
        if write or os.access(self.path.parent, os.W_OK, effective_ids=os.access in os.supports_effective_ids):
            return sqlite3.connect(f"{file}?mode=rw", timeout=60.0, uri=True)
        log = self.path.with_name(f"{self.path.name}-wal")
        if log.exists() and log.stat().st_size:
            message = f"cannot be read: {log.name} beside it holds rows, and this folder cannot be written"
            raise self._error(message, "Copy both files to a folder of your own.")
        return sqlite3.connect(f"{file}?mode=ro&immutable=1", uri=True)

    def _check(self, db: sqlite3.Connection) -> None:
        """Refuse a file that SQLite cannot trust, or that is no study of this format."""
        tables = dict(db.execute("SELECT name, sql FROM sqlite_master WHERE type = 'table'"))
        if "facts" not in tables:
            kind = "another SQLite file" if tables else "an empty one"
            raise self._unusable(f"expected the file of a study, found {kind}")
        with contextlib.suppress(sqlite3.Error, ValueError, LookupError, TypeError):
            ((provenance,),) = db.execute("SELECT provenance FROM sessions ORDER BY number DESC LIMIT 1")
            self._made_by = json.loads(provenance)["command"] or self._made_by
        ((verdict,),) = db.execute("PRAGMA integrity_check(1)")
        if verdict != "ok":
            raise self._damaged(str(verdict).replace("\n", ": "))
        row = db.execute("SELECT value FROM facts WHERE name = 'format'").fetchone()
        if row != (json.dumps(FORMAT),):
            actual = str(row[0]).strip('"') if row else "none"
            raise self._unusable(f"expected the format {FORMAT}, found {shortened(actual, 100)}")
        for name, sql in TABLES.items():
            if tables.get(name) != sql:
                raise self._damaged(f"its table {name} has other columns than those it was made with")

    # ------------------------------------------------------------------------------------------- rows and seals

    def _read(self, db: sqlite3.Connection, table: str) -> list[Row]:
        """Return the rows of a table without their digests; refuse those that are not as they were written.

        Rows are kept in memory: while the seal of their table stays as it is, they are what was written.
        """
        seal = self._seal(db, table)
        if table not in self._kept or self._kept[table][0] != seal:
            rows, total = self._verified(table, db.execute(f"SELECT * FROM {table} ORDER BY 1"))  # noqa: S608
            if total != seal:
                raise self._damaged(f"rows were added to its table {table} or removed from it")
            self._kept[table] = seal, rows
        return self._kept[table][1]

    def _verified(self, table: str, rows: Iterable[Row]) -> tuple[list[Row], int]:
        """Return rows of a table without their digests, and the sum of these."""
        verified, total = [], 0
        for row in rows:
            digest = _digest(table, row[:-1])
            if digest != row[-1]:
                raise self._damaged(f"row {row[0]!r} of its table {table} does not have the digest stored with it")
            verified.append(row[:-1])
            total += int(digest, 16)
        return verified, total % 2**256

    def _seal(self, db: sqlite3.Connection, table: str) -> int:
        """Return the sum of the digests of a table as it was written."""
        row = db.execute("SELECT sum FROM seals WHERE name = ?", (table,)).fetchone()
        try:
            return int(row[0], 16) if row is not None else 0  # no row of the table was ever written
        except (ValueError, TypeError) as error:
            raise self._damaged(f"the sum of the digests of its table {table} cannot be read") from error

    def _write(self, db: sqlite3.Connection, table: str, rows: Iterable[Row], *, anew: bool = True) -> None:
        """Write rows in place of all rows of a table, or else of those with the same key, with digests and seal."""
        sealed = {row[0]: (*row, _digest(table, row)) for row in rows}
        if anew:
            db.execute(f"DELETE FROM {table}")  # noqa: S608
            total = 0
        else:
            query = f"SELECT * FROM {table} WHERE key = ?"  # noqa: S608
            replaced = (row for key in sealed for row in db.execute(query, (key,)))
            total = self._seal(db, table) - self._verified(table, replaced)[1]
        total += sum(int(row[-1], 16) for row in sealed.values())
        places = ", ".join("?" * (COLUMNS[table].count(",") + 2))
        db.executemany(f"INSERT OR REPLACE INTO {table} VALUES ({places})", sealed.values())  # noqa: S608
        self._kept.pop(table, None)
        db.execute("INSERT OR REPLACE INTO seals VALUES (?, ?)", (table, f"{total % 2**256:064x}"))

    # ------------------------------------------------------------------------------------------- writing

    def begin(
        self,
        facts: Data,
        provenance: Data,
        plan: Iterable[tuple[str, Data]],
        files: Iterable[StudyFile] = (),
    ) -> None:
        """Store facts, files and provenance of this session, and the plan: key and names of every row.

        Rows that are no longer in the plan are kept: a later plan may need them again.
        """
        with self._open(write=True) if self._begun else self._made() as db:
            sessions = self._read(db, "sessions")
            self.session = len(sessions) + 1
            self._write(db, "sessions", [*sessions, (self.session, json.dumps(provenance))])
            stored = {"format": FORMAT, **facts}
            self._write(db, "facts", [(name, json.dumps(value)) for name, value in stored.items()])
            self._write(db, "plan", [(n, key, json.dumps(row)) for n, (key, row) in enumerate(plan)])
            columns = [(n, file.path, file.role, file.sha256, file.size, file.text) for n, file in enumerate(files)]
            self._write(db, "files", columns)

    @contextmanager
    def _made(self) -> Iterator[sqlite3.Connection]:
        """Make the file of what the body of a with statement writes: all of it or, if the process dies, nothing."""
        with closing(sqlite3.connect(":memory:")) as db:
            for table in TABLES.values():
                db.execute(table)
            yield db
            db.commit()
            content = db.serialize()
        for ending in ("-wal", "-shm", "-journal"):  # of a file that was here before, which SQLite would replay
            self.path.with_name(f"{self.path.name}{ending}").unlink(missing_ok=True)
        with replacing(self.path, self.path.suffix) as temporary:
            temporary.write_bytes(content[:18] + b"\2\2" + content[20:])  # a database with a write-ahead log
        self._begun = True

    def add(self, records: Sequence[Record]) -> None:
        """Store a batch of rows: all of them or, if the process dies meanwhile, none."""
        rows = [_row(record, self.session) for record in records]
        with self._open(write=True) as db:
            self._write(db, "runs", rows, anew=False)
            arrays = [(record.key, record.histories) for record in records if record.histories]
            db.executemany("INSERT OR REPLACE INTO arrays VALUES (?, ?)", arrays)

    # ------------------------------------------------------------------------------------------- reading

    def tables(self, *names: str) -> list[list[Row]]:
        """Return the rows of tables at one moment; none of a file that is still to be made."""
        if not self._begun:
            return [[] for _ in names]
        with self._open() as db:
            return [self._read(db, name) for name in names]

    def facts(self) -> Entries:
        """Return the facts that `begin` stored."""
        (facts,) = self.tables("facts")
        return {name: json.loads(value) for name, value in facts}

    def runs(self) -> list[tuple[Entries, Record]]:
        """Return names and run of each row of the plan, in order."""
        plan, runs = self.tables("plan", "runs")
        made = {row[0]: _record(row) for row in runs}
        return [(json.loads(names), made.get(key) or Record(key, WAITING)) for _, key, names in plan]

    def finished_keys(self, again: Sequence[str] = ()) -> set[str]:
        """Return the keys of the stored runs to be kept: all but the lost ones and those with a status in `again`."""
        (runs,) = self.tables("runs")
        return {key for key, status, *_ in runs if status != LOST and status not in again}

    def planned(self) -> set[str]:
        """Return the keys of all rows of the plan."""
        (plan,) = self.tables("plan")
        return {key for _, key, _ in plan}

    def histories(self, key: str) -> Entries | None:
        """Return the stored arrays of a run, or None if there are none."""
        with self._open() as db:
            digest = next((digest for stored, *_, digest in self._read(db, "runs") if stored == key), None)
            if digest is None:
                return None
            found = db.execute("SELECT CAST(npz AS BLOB) FROM arrays WHERE key = ?", (key,)).fetchone()
            if found is None or content_digest(found[0]) != digest:
                raise self._damaged(f"the histories of the run {key} do not have the digest stored with it")
            return unpacked(found[0])


def _row(record: Record, session: int) -> Row:
    """Return the row of a run in its table."""
    fragile = int(record.fragile) if record.fragile is not None else None
    measures = json.dumps(record.measures) if record.measures is not None else None
    digest = content_digest(record.histories) if record.histories else None
    outcome = record.key, record.status, record.reason, record.said_by, fragile, record.seconds, measures
    return (*outcome, session, record.compiling, record.cpu, digest)


def _record(row: Row) -> Record:
    """Return the run of a row of the table of runs, without its histories."""
    key, status, reason, said_by, fragile, seconds, measures, _, compiling, cpu, _ = row
    measured = json.loads(measures) if measures is not None else {}
    known = None if fragile is None else bool(fragile)
    return Record(key, status, reason, said_by, known, seconds, measured, compiling=compiling, cpu=cpu)


def _digest(table: str, row: Row) -> str:
    """Return the digest of a row of a table."""
    return content_digest(f"{table} {tuple(row)!r}".encode())


def as_json_data(value: Any) -> Any:
    """Return plain data with lists and text keys, as in JSON."""
    if isinstance(value, Mapping):
        return {str(key): as_json_data(item) for key, item in value.items()}
    return [as_json_data(item) for item in value] if isinstance(value, list | tuple) else value
