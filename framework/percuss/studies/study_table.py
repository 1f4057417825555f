"""A study as a reader sees it: its table, its plan and its provenance, read from the file of its rows."""

from __future__ import annotations

import json
import os
import shlex
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from percuss.case.arguments import expect_suffix
from percuss.files import replacing
from percuss.jsonable import Entries
from percuss.studies.perform import LOST, WAITING, Record, unpacked
from percuss.studies.store import Store

if TYPE_CHECKING:
    import pandas as pd

SECONDS = "wall time of the time steps alone, the least of its repeats; the provenance names the processor"

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
    def spec(self) -> Entries:
        """The study file as plain data."""
        return self._store.fact("spec") or {}

    @property
    def columns(self) -> dict[str, str]:
        """Definition of each measured column in words: quantity, norm, averaging."""
        return {**(self._store.fact("columns") or {}), "seconds": SECONDS}

    @property
    def units(self) -> dict[str, str]:
        """Names of the units by kind, as ``{"length": "m"}``, that all cases of the study give."""
        return self._store.fact("units") or {}

    @property
    def provenance(self) -> Entries:
        """Versions, machine and plug-ins of the last session that ran the study; ``sessions`` has them all.

        ``processors`` is the number of rows made on each model of processor.
        """
        found = self._store.select("SELECT provenance FROM sessions ORDER BY number")
        sessions = [json.loads(session) for (session,) in found]
        processors = Counter(run.cpu for run in self.runs.values() if run.cpu)
        return {**(sessions or [{}])[-1], "sessions": sessions, "processors": dict(sorted(processors.items()))}

    @property
    def plan(self) -> dict[str, Entries]:
        """Names of methods, varied values and all changes of each row, by key."""
        return {run.key: names for names, run in self._rows()}

    @property
    def cases(self) -> dict[str, Entries]:
        """What a case is read again from, by label, as the provenance of a result has it."""
        provenance = self.provenance
        return {label: {**provenance, **case} for label, case in (self._store.fact("cases") or {}).items()}

    @property
    def runs(self) -> dict[str, Record]:
        """The run of each row, without its histories, by key."""
        return {run.key: run for _, run in self._rows()}

    def _rows(self) -> list[tuple[Entries, Record]]:
        """Return the plan and the run of each row, in the order of the study."""
        query = "SELECT plan.key, status, runs.row, plan.row FROM plan LEFT JOIN runs USING (key) ORDER BY number"
        return [
            (json.loads(names), Record(key, WAITING) if row is None else Record(key, status, **json.loads(row)))
            for key, status, row, names in self._store.select(query)
        ]

    def command(self, key: str) -> str | None:
        """Return the command that makes the run of a row alone, or None if no row has this key."""
        return shlex.join(["percuss", "run", str(self.path), "--row", key]) if key in self.plan else None

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

        rows = self.as_records()
        numbers = [name for name in self.columns if rows and name in rows[0]]
        table = pd.DataFrame(rows, columns=list(rows[0]) if rows else None)
        for name in numbers:  # a column of None alone is numeric too
            if table[name].isna().all():
                table[name] = table[name].astype(float)
        return table

    def as_records(self) -> list[Entries]:
        """Return the rows of `table` as plain mappings, all with the same keys."""
        rows, columns = self._rows(), [name for name in self.columns if name != "seconds"]
        varied = dict.fromkeys(path for names, _ in rows for path in names["varied"])
        return [
            {
                **{name: names[name] for name in NAMES},
                **{path: names["varied"].get(path) for path in varied},
                **{name: getattr(run, name) for name in ("status", "reason", "said_by", "fragile")},
                **{name: (run.measures or {}).get(name) for name in columns},
                "seconds": run.seconds,
                "key": run.key,
            }
            for names, run in rows
        ]

    @property
    def counts(self) -> dict[str, int]:
        """Number of rows with each status."""
        return dict(Counter(run.status for _, run in self._rows()))

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
        found = self._store.select("SELECT histories FROM runs WHERE key = ? AND histories IS NOT NULL", (key,))
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
