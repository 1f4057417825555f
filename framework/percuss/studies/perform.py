"""The run of a task: how it is made, how it ends, and what is stored of it."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from percuss.case.case import Case
from percuss.errors import InputError, PercussError, RefusedPair, RunError, TooLargeError
from percuss.jsonable import Data, Entries, plain
from percuss.methods.blame import described, line_in_plugin, plugin_faults
from percuss.methods.interfaces import ContactLaw
from percuss.methods.registry import Registry
from percuss.results.assemble import AGAINST_CERTIFICATE, NOT_VALID
from percuss.results.provenance import processor_model
from percuss.results.result import Result
from percuss.results.runner import run
from percuss.studies.columns import RowSettings
from percuss.studies.tasks import TIED, Task

WAITING = "waiting"  # status of a run that is still to be made
LOST = "lost"  # status of a run that the machine failed: it is made again
WORKER = "worker"  # `said_by` of a run that was lost with its worker

# Errors of the machine, whichever code raises them: a missing file, no memory, a missing package.
ENVIRONMENT = (OSError, MemoryError, ImportError, EOFError)


@dataclass(frozen=True)
class Run:
    """A run of a comparison or of a study, with its outcome.

    Attributes
    ----------
    integrator, contact
        Names of the pair.
    varied
        Value of each varied path.
    status
        ``done``, ``interrupted``, ``unstable``, ``refused``, ``failed``; or `LOST` where the machine failed and
        nothing is known of the methods.
    reason
        Why the run is not ``done``, or doubts about a run that is ``done``; else empty.
    said_by
        Component that refused the pair; empty otherwise.
    result
        The result, also of a stopped run; None if there is none.
    """

    integrator: str
    contact: str
    varied: Data
    status: str
    reason: str = ""
    said_by: str = ""
    result: Result | None = field(default=None, repr=False)

    @property
    def label(self) -> str:
        """The pair of methods and the varied values, in one line."""
        return label_of(self.integrator, self.contact, self.varied)

    def as_dict(self) -> Entries:
        """Return the run as plain data for JSON."""
        return {
            "integrator": self.integrator,
            "contact": self.contact,
            **self.varied,
            "status": self.status,
            "reason": self.reason,
            "said_by": self.said_by,
            "summary": self.result.summary if self.result is not None else None,
        }


def label_of(integrator: str, contact: str, varied: Data) -> str:
    """Return a pair of methods and the varied values that it has, in one line."""
    given = {path.split(".")[-1]: value for path, value in varied.items() if value is not None}
    values = (f"{name}={value:.6g}" if isinstance(value, float) else f"{name}={value}" for name, value in given.items())
    return " ".join([f"{integrator} + {contact}", *values])


def perform(case: Case, task: Task, make: Callable[[Case], Result] = run) -> tuple[Run, InputError | None]:
    """Make the run of a task.

    Parameters
    ----------
    case
        The case of the task.
    task
        Task of the run.
    make
        Function that runs a case; in a study one that measures its cost.

    Returns
    -------
    run
        The run with its outcome.
    error
        Error of the input if it is the reason why there is no result, else None.
    """
    names, unread = (task.integrator, task.contact, task.varied), True
    try:
        with plugin_faults():
            changed = task.changed(case)
            unread = False
            result = make(tied_twin(changed) if task.tied else changed)
    except (RefusedPair, _NoTwin) as error:
        said = (error.reason, error.said_by) if isinstance(error, RefusedPair) else (str(error), TIED)
        return Run(*names, "refused", *said), None
    except RunError as error:
        return Run(*names, "unstable", str(error), result=error.result), None
    except InputError as error:
        lost = isinstance(error, TooLargeError) and not unread
        return Run(*names, LOST if lost else "failed", str(error)), error
    except Exception as error:  # noqa: BLE001 - an error of a plug-in costs its own runs alone
        return Run(*names, *failure_status(error)), None
    reason = "; ".join(note for note in result.summary["notes"] if note.startswith((AGAINST_CERTIFICATE, NOT_VALID)))
    reason = "Ctrl-C" if result.status == "interrupted" else reason
    return Run(*names, result.status, reason, result=result), None


def failure_status(error: BaseException) -> tuple[str, str]:
    """Return status and reason of a run ended by an unexpected error: `LOST` for one of the machine, else failed."""
    where = line_in_plugin(error)
    message = str(error) if isinstance(error, PercussError) else f"{where + ': ' if where else ''}{described(error)}"
    if isinstance(error, ENVIRONMENT) or isinstance(error.__cause__, ENVIRONMENT):
        return LOST, f"the machine failed, not the methods: {message}"
    return "failed", message


class _NoTwin(PercussError):
    """Error: a tied twin cannot be made for lack of a tying law or of the exact times at which to tie."""


def tying_law(registry: Registry) -> type[ContactLaw]:
    """Return the registered contact law that ties its contacts during given intervals.

    Raises
    ------
    PercussError
        If there is none.
    """
    for name in registry.names("contacts"):
        law: Any = registry.get("contacts", name)
        if law.tied_during:
            return law  # type: ignore[no-any-return]
    raise _NoTwin("no contact law is registered that ties its contacts during intervals of time")


def tied_twin(case: Case) -> Case:
    """Return a case with each contact tied while its exact solution is closed.

    Raises
    ------
    PercussError
        If there is no law that ties, or nothing says when the exact contact is closed.
    """
    from percuss.certificate.verdict import settled
    from percuss.results.exact import exact_solution

    law = tying_law(case.registry)
    tied_contacts = {f"contacts.{name}.method": law.name for name in case.contacts}
    model = settled(case.with_overrides(tied_contacts) if tied_contacts else case).model
    solution, _, reason = exact_solution(model, (model.steps + 1) * model.dt, of_contact=True)
    if solution is None or reason:
        raise _NoTwin(f"the times at which the exact contact is closed are unknown: {reason}")
    tied_during = {
        f"contacts.{name}.method": {"name": law.name, law.tied_during: contact.closed}
        for name, contact in solution.contacts.items()
    }
    return case.with_overrides(tied_during)


# ------------------------------------------------------------------------------------------------- what is stored


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
    compiling
        Seconds that were spent on compilation; None if there is no result.
    cpu
        Model of the processor.
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
    compiling: float | None = None
    cpu: str = ""


def record(key: str, run: Run, settings: RowSettings, registry: Registry) -> Record:
    """Return the stored form of a run.

    Parameters
    ----------
    key
        Key of the task.
    run
        The run with its outcome.
    settings
        Its columns are measured if the run is done; a stopped run has no number that could be compared.
    registry
        Registry of the measures that are plug-ins.
    """
    times = run.result.summary["seconds"] if run.result is not None else {}
    compiling = times.get("compile")
    stored = Record(key, run.status, run.reason, run.said_by, compiling=compiling, cpu=processor_model())
    if run.result is None or run.status != "done":
        return stored
    measures = {}
    for column in settings.columns:
        try:
            with plugin_faults():
                measures[column.name] = plain(column.take(run.result, registry))
        except Exception as error:  # noqa: BLE001 - an error of a plug-in's measure costs this run alone
            status, reason = failure_status(error)
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
