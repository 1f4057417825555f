"""What a worker hands back: the row of one run in plain terms, and its histories where they are kept."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from percuss.methods.registry import Registry
    from percuss.results.result import Result
    from percuss.studies.columns import Column
    from percuss.studies.tasks import Row

__all__ = ["Record", "record", "unpacked"]


@dataclass(frozen=True)
class Record:
    """One run as it is stored.

    Attributes
    ----------
    key
        What it depends on.
    status, reason, said_by
        As of a `percuss.studies.tasks.Row`.
    fragile
        Whether the answer hangs on round-off; None where nobody asked or there is no exact solution.
    seconds
        Wall time of the march alone, the least of all times it was made; None where it did not get to its end.
    wall
        Seconds from the beginning of the run to its end, whatever they were spent on.
    compiling
        Seconds of these that were spent compiling; None where there is no result.
    cpu
        Model of the processor.
    unread
        Whether the run failed because this process could not read the case with the row's values.
    misfit
        Whether it was lost because this process does not have the methods, files or versions of the study.
    measures
        Value of each column; empty where the run was not done.
    histories
        Arrays as one npz file; empty where none are kept.
    """

    key: str
    status: str
    reason: str = ""
    said_by: str = ""
    fragile: bool | None = None
    seconds: float | None = None
    measures: dict[str, Any] | None = None
    histories: bytes = b""
    wall: float | None = None
    compiling: float | None = None
    cpu: str = ""
    unread: bool = False
    misfit: bool = False


def record(key: str, row: Row, columns: Sequence[Column], keep: int, wall: float, registry: Registry) -> Record:
    """Return the row of a run in plain terms.

    Parameters
    ----------
    key
        Of the task.
    row
        What became of it.
    columns
        What is measured of a run that is done; a run that was stopped has no number that could be compared.
    keep
        At most so many points of each history are kept.
    wall
        How long it took in all.
    registry
        Where the measures are that are plug-ins.
    """
    from percuss.jsonable import plain
    from percuss.results.provenance import processor_model
    from percuss.studies.tasks import blamed

    times = row.result.summary["seconds"] if row.result is not None else {}
    made = Record(key, row.status, row.reason, row.said_by, unread=row.unread)
    made = replace(made, wall=wall, compiling=times.get("compile"), cpu=processor_model())
    if row.result is None or row.status != "done":
        return made
    exact = row.result.summary["exact"]
    fragile = exact["fragile"] if exact is not None else None
    measures = {}
    for one in columns:
        try:
            measures[one.name] = plain(one.take(row.result, registry))
        except Exception as error:  # noqa: BLE001 - somebody's measure: a row that says so, as of their methods
            status, reason = blamed(error, registry)
            return replace(made, status=status, reason=f"measure {one.name}: {reason}", said_by=one.name)
    histories = _packed(row.result, keep) if keep else b""
    return replace(made, fragile=fragile, seconds=times["march"], measures=measures, histories=histories)


def _packed(result: Result, points: int) -> bytes:
    """Return time, contact force and exact force as one npz file, single precision, at most `points` of each.

    Every so many records are kept, from the first on: on a regular axis runs can be compared.
    """
    arrays = result.arrays
    every = max(1, -(-arrays["time"].size // points))
    kept = {
        name: arrays[name][::every].astype(np.float32)
        for name in ("time", "contact_force", "contact_force_exact")
        if name in arrays
    }
    out = io.BytesIO()
    np.savez(out, allow_pickle=False, contact=np.array(result.coordinates["contact"]), **kept)
    return out.getvalue()


def unpacked(packed: bytes) -> dict[str, Any]:
    """Return the arrays of a record: ``time``, ``contact``, ``contact_force``, ``contact_force_exact``."""
    with np.load(io.BytesIO(packed), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}
