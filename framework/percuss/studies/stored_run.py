"""The stored form of a run, which a worker returns: its row as plain data, and its histories if they are kept."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace

import numpy as np

from percuss.jsonable import Entries
from percuss.methods.registry import Registry
from percuss.results.result import Result
from percuss.studies.columns import RowSettings
from percuss.studies.perform import Run


@dataclass(frozen=True)
class Record:
    """A run as it is stored.

    Attributes
    ----------
    key
        Key of its inputs.
    status, reason, said_by
        As in a `percuss.studies.perform.Run`.
    fragile
        Whether the result depends on round-off; None if this was not tested or there is no exact solution.
    seconds
        Wall time of the march alone, the smallest of its repeats; None if the march did not reach its end.
    wall
        Seconds from the beginning of the run to its end.
    compiling
        Seconds of these that were spent on compilation; None if there is no result.
    cpu
        Model of the processor.
    unread
        Whether the run failed because this process could not read the case with the values of the run.
    misfit
        Whether the run was lost because this process does not have the methods, files or versions of the study.
    measures
        Value of each column; None if the run was not done.
    histories
        Arrays as one npz file; empty if none are kept.
    """

    key: str
    status: str
    reason: str = ""
    said_by: str = ""
    fragile: bool | None = None
    seconds: float | None = None
    measures: Entries | None = None
    histories: bytes = b""
    wall: float | None = None
    compiling: float | None = None
    cpu: str = ""
    unread: bool = False
    misfit: bool = False


def record(key: str, run: Run, settings: RowSettings, wall: float, registry: Registry) -> Record:
    """Return the stored form of a run.

    Parameters
    ----------
    key
        Key of the task.
    run
        The run with its outcome.
    settings
        Its columns are measured if the run is done; a stopped run has no number that could be compared.
    wall
        Wall time of the whole run.
    registry
        Registry of the measures that are plug-ins.
    """
    from percuss.jsonable import plain
    from percuss.methods.blame import plugin_faults
    from percuss.methods.process_guard import process_as_before
    from percuss.results.provenance import processor_model
    from percuss.studies.perform import failure_status

    times = run.result.summary["seconds"] if run.result is not None else {}
    stored = Record(key, run.status, run.reason, run.said_by, unread=run.unread)
    stored = replace(stored, wall=wall, compiling=times.get("compile"), cpu=processor_model())
    if run.result is None or run.status != "done":
        return stored
    measures = {}
    for column in settings.columns:
        try:
            with plugin_faults(), process_as_before():
                measures[column.name] = plain(column.take(run.result, registry))
        except Exception as error:  # noqa: BLE001 - an error of a plug-in's measure costs this run alone
            status, reason = failure_status(error, registry)
            return replace(stored, status=status, reason=f"measure {column.name}: {reason}", said_by=column.name)
    histories = _packed(run.result, settings.histories) if settings.histories else b""
    return replace(
        stored, fragile=run.result.summary["fragile"], seconds=times["march"], measures=measures, histories=histories
    )


def _packed(result: Result, points: int) -> bytes:
    """Return time, contact force and exact force as one npz file, single precision, at most `points` of each.

    Every n-th record is kept, from the first on: runs can be compared on a regular time axis.
    """
    arrays = result.arrays
    stride = max(1, -(-arrays["time"].size // points))
    kept = {
        name: arrays[name][::stride].astype(np.float32)
        for name in ("time", "contact_force", "contact_force_exact")
        if name in arrays
    }
    out = io.BytesIO()
    np.savez(out, allow_pickle=False, contact=np.array(result.coordinates["contact"]), **kept)
    return out.getvalue()


def unpacked(packed: bytes) -> Entries:
    """Return the arrays of stored histories: ``time``, ``contact``, ``contact_force``, ``contact_force_exact``."""
    with np.load(io.BytesIO(packed), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}
