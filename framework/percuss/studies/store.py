"""The SQLite file of the rows of a study: one row per run, readable while it is written.

A batch of rows is one transaction: if a process is killed at any moment, the batches that it finished are complete. A
row is found by the key of the inputs of its run, so that the same run is never made twice.
"""

from __future__ import annotations

import contextlib
import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from percuss.case.hints import file_advice
from percuss.errors import InputError, UnwrittenError, nearest, wrong_input
from percuss.files import is_file
from percuss.jsonable import Data
from percuss.studies.perform import LOST, Record

FORMAT = 5  # the `user_version` of the file
TABLES = (
    "CREATE TABLE facts (name TEXT PRIMARY KEY, value TEXT)",
    "CREATE TABLE sessions (number INTEGER PRIMARY KEY, provenance TEXT)",
    "CREATE TABLE plan (number INTEGER PRIMARY KEY, key TEXT, row TEXT)",
    "CREATE TABLE runs (key TEXT PRIMARY KEY, status TEXT, row TEXT, histories BLOB)",
    f"PRAGMA user_version = {FORMAT}",
)
EMPTIED = ("DELETE FROM facts", "DELETE FROM plan")  # before the plan of another session is stored
STORED = ("reason", "said_by", "fragile", "seconds", "measures", "compiling", "cpu")  # of a record, in its row
ANOTHER = "Use an undamaged copy, or make the study again: percuss study STUDY -o NEW.sqlite."


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
            ((found,),) = self.select("PRAGMA user_version")
            ((tables,),) = self.select("SELECT count(*) FROM sqlite_master")
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

    def begin(self, facts: Data, provenance: Data | None, plan: Iterable[tuple[str, Data]]) -> None:
        """Store facts, the plan (key and names of every row), and the provenance of a session that begins.

        Rows that are no longer in the plan are kept: a later plan may need them again.
        """
        with self._open(write=True) as db:
            for statement in TABLES if not self._there else EMPTIED:
                db.execute(statement)
            if provenance is not None:
                db.execute("INSERT INTO sessions (provenance) VALUES (?)", (json.dumps(provenance),))
            db.executemany(
                "INSERT INTO facts VALUES (?, ?)", [(name, json.dumps(fact)) for name, fact in facts.items()]
            )
            db.executemany("INSERT INTO plan (key, row) VALUES (?, ?)", [(key, json.dumps(row)) for key, row in plan])
        self._there = True

    def add(self, records: Sequence[Record]) -> None:
        """Store a batch of rows: all of them or, if the process dies meanwhile, none."""
        rows = [
            (each.key, each.status, json.dumps({name: getattr(each, name) for name in STORED}), each.histories or None)
            for each in records
        ]
        with self._open(write=True) as db:
            db.executemany("INSERT OR REPLACE INTO runs VALUES (?, ?, ?, ?)", rows)

    def finish(self) -> None:
        """Put all rows into the one file, which then opens in a folder that cannot be written to."""
        with contextlib.suppress(sqlite3.Error), closing(sqlite3.connect(self.path)) as db:  # unless somebody reads it
            db.execute("PRAGMA journal_mode = DELETE")

    # ------------------------------------------------------------------------------------------- reading

    def select(self, query: str, values: Sequence[object] = ()) -> list[tuple[Any, ...]]:
        """Return the rows that a query of SQL finds; none in a file that is still to be made."""
        if not self._there:
            return []
        with self._open() as db:
            return db.execute(query, values).fetchall()

    def fact(self, name: str) -> Any:
        """Return one of the facts that `begin` stored, or None if there is none."""
        found = self.select("SELECT value FROM facts WHERE name = ?", (name,))
        return json.loads(found[0][0]) if found else None

    def finished_keys(self, again: Sequence[str] = ()) -> set[str]:
        """Return the keys of the stored runs to be kept: all but the lost ones and those with a status in `again`."""
        return {key for key, status in self.select("SELECT key, status FROM runs") if status not in (LOST, *again)}
