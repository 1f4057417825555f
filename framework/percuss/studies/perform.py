"""The run of a task: the key of its inputs, how it is made, how it ends, and what is stored of it.

A key is a digest of all inputs of a run: equal keys give equal rows, so that a stored run is not made again. The bench
goes to worker processes, also of other machines: it holds the cases as text with all data files that they need.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from percuss.case.case import Case, load
from percuss.case.source import Source
from percuss.digest import content_digest, own_digest, surroundings
from percuss.errors import InputError, PercussError, PluginError, RefusedPair, RunError, TooLargeError
from percuss.jit import LOCK as ONE_AT_A_TIME
from percuss.jsonable import Data, Entries, plain
from percuss.methods.blame import described, line_in_plugin, plugin_faults
from percuss.methods.interfaces import ContactLaw
from percuss.methods.registry import Registry
from percuss.results.assemble import AGAINST_CERTIFICATE, NOT_VALID
from percuss.results.provenance import components_used, processor_model
from percuss.results.result import Result
from percuss.results.runner import run
from percuss.studies.columns import RowSettings
from percuss.studies.tasks import TIED, Task
from percuss.version import __version__

WAITING = "waiting"  # status of a run that is still to be made
LOST = "lost"  # status of a run that the machine failed: it is made again
WORKER = "worker"  # `said_by` of a run that was lost with its worker

# Errors of the machine, whichever code raises them: a missing file, no memory, a missing package.
ENVIRONMENT = (OSError, MemoryError, ImportError, EOFError)
SILENT = ("title", "source", "expect", "plugins")  # entries of a case that change no number of its run


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
    error
        Error of the input if it is the reason why there is no result, else None.
    """

    integrator: str
    contact: str
    varied: Data
    status: str
    reason: str = ""
    said_by: str = ""
    result: Result | None = field(default=None, repr=False)
    error: InputError | None = field(default=None, repr=False)

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


def perform(case: Case, task: Task, make: Callable[[Case], Result] | None = None) -> Run:
    """Return the run of a task with its outcome.

    Parameters
    ----------
    case
        The case of the task.
    task
        Task of the run.
    make
        Function that runs a case, as that of a study, which measures the cost; None: `percuss.run` with one thread.
    """
    names = task.integrator, task.contact, task.varied
    try:
        with plugin_faults():
            changed = task.changed(case)
            changed = tied_twin(changed) if task.tied else changed
            result = make(changed) if make is not None else run(changed, threads=1)
    except RefusedPair as error:
        return Run(*names, "refused", error.reason, error.said_by)
    except RunError as error:
        return Run(*names, "unstable", str(error), result=error.result)
    except InputError as error:  # another machine may have the memory
        return Run(*names, LOST if isinstance(error, TooLargeError) else "failed", str(error), error=error)
    except Exception as error:  # noqa: BLE001 - an error of a plug-in costs its own runs alone
        return Run(*names, *failure_status(error))
    doubts = (note for note in result.summary["notes"] if note.startswith((AGAINST_CERTIFICATE, NOT_VALID)))
    reason = "Ctrl-C" if result.status == "interrupted" else "; ".join(doubts)
    return Run(*names, result.status, reason, result=result)


def failure_status(error: BaseException) -> tuple[str, str]:
    """Return status and reason of a run ended by an unexpected error: `LOST` for one of the machine, else failed."""
    where = line_in_plugin(error)
    message = str(error) if isinstance(error, PercussError) else f"{where + ': ' if where else ''}{described(error)}"
    if isinstance(error, ENVIRONMENT) or isinstance(error.__cause__, ENVIRONMENT):
        return LOST, f"the machine failed, not the methods: {message}"
    return "failed", message


def tying_law(case: Case) -> type[ContactLaw]:
    """Return the registered contact law that ties its contacts during given intervals.

    Raises
    ------
    RefusedPair
        If there is none.
    """
    for name in case.registry.names("contacts"):
        law: Any = case.registry.get("contacts", name)
        if law.tied_during:
            return law  # type: ignore[no-any-return]
    raise _no_twin(case, "no contact law is registered that ties its contacts during intervals of time")


def _no_twin(case: Case, reason: str) -> RefusedPair:
    return RefusedPair(case.method.integrator.name, TIED, reason, TIED)


def tied_twin(case: Case) -> Case:
    """Return a case with each contact tied while its exact solution is closed.

    Raises
    ------
    RefusedPair
        If there is no law that ties, or nothing says when the exact contact is closed.
    """
    from percuss.certificate.verdict import settled
    from percuss.results.exact import exact_solution

    law = tying_law(case)
    tied_contacts = {f"contacts.{name}.method": law.name for name in case.contacts}
    model = settled(case.with_overrides(tied_contacts) if tied_contacts else case).model
    solution, _, reason = exact_solution(model, (model.steps + 1) * model.dt, of_contact=True)
    if solution is None or reason:
        raise _no_twin(case, f"the times at which the exact contact is closed are unknown: {reason}")
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
    stored = Record(key, run.status, run.reason, run.said_by, cpu=processor_model())
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
    summary, histories = run.result.summary, _packed(run.result, settings.histories) if settings.histories else b""
    seconds = summary["seconds"]["march"]
    return replace(stored, fragile=summary["fragile"], seconds=seconds, measures=measures, histories=histories)


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


# ------------------------------------------------------------------------------------------- where runs are made


@dataclass(frozen=True)
class Bench:
    """Everything that a process needs to make the runs of a study.

    Attributes
    ----------
    settings
        Settings on which every row depends.
    sources
        Text of each case, by label, with the texts of the data files that its tasks name.
    plugins
        Paths of the single-file plug-ins of each case, by label.
    components
        Digest of each component that some task of a case uses, by label, then by family and name.
    surroundings
        Versions where the study began, of percuss, of Python and of the packages that compute.
    cases
        The cases that this process has read, by label; they stay in it.
    """

    settings: RowSettings
    sources: dict[str, Source]
    plugins: dict[str, tuple[Path, ...]]
    components: dict[str, dict[str, str]]
    surroundings: dict[str, str]
    cases: dict[str, Case] = field(default_factory=dict, repr=False)

    @staticmethod
    def of(cases: Mapping[str, Case], settings: RowSettings) -> Bench:
        """Return the bench of some cases, which is complete when it has given a key to all their tasks."""
        sources = {label: case.origin.replaced(("plugins",), ()) for label, case in cases.items()}
        plugins = {label: tuple(file.path for file in case.registry.single_files) for label, case in cases.items()}
        return Bench(settings, sources, plugins, {label: {} for label in cases}, _surroundings(), dict(cases))

    def __getstate__(self) -> Entries:
        return {**vars(self), "cases": {}}

    def with_key(self, task: Task) -> tuple[Task, InputError | None]:
        """Return a task with its key, and the error of the input by which its case cannot be changed so."""
        case = self.cases[task.case]
        sources, failed = case.registry.sources, None
        try:
            changed = task.changed(case)
            # Any solution may cover the case: it gives the true error, and the times at which a tied twin is tied.
            used = {*components_used(changed), *(key for key in sources if key[0] == "solutions")}
            used |= {("measures", column.name) for column in self.settings.columns if column.kind == "plug-in"}
            used |= {("contacts", tying_law(case).name)} if task.tied else set()
        except PercussError as error:  # the run will fail and report it: it depends on the code that refuses it
            changed, failed = case, error
            used = {key for key, source in sources.items() if not source.distribution}
        components = {"/".join(key): sources[key].digest for key in sorted(used & sources.keys())}
        self.components[task.case].update(components)
        source, files = self.sources[task.case], changed.data_files
        self.sources[task.case] = replace(source, data_files={**source.data_files, **files})
        inputs = [
            self.surroundings,
            repr(self.settings),
            components,
            {name: content_digest(text.encode()) for name, text in files.items()},
            {name: value for name, value in case.data.items() if name not in SILENT},
            task.changes,
            task.tied,
        ]
        key = content_digest(json.dumps(inputs, sort_keys=True, default=str).encode())[:32]
        return replace(task, key=key), failed if isinstance(failed, InputError) else None

    def record(self, task: Task) -> Record:
        """Return the record of a run; it is lost where Ctrl-C has ended it."""
        try:
            with plugin_faults(), ONE_AT_A_TIME:
                case = self._case(task.case)
        except Exception as error:  # noqa: BLE001 - it was read where the study began: this process differs
            return Record(task.key, LOST, f"the worker process cannot read the case: {error}", WORKER)
        run = perform(case, task, self.settings.run)
        if run.status == "interrupted":
            return Record(task.key, LOST, "the run was interrupted", WORKER)
        return record(task.key, run, self.settings, case.registry)

    def _case(self, label: str) -> Case:
        """Return a case, which is read once per process, if all is here as it was where the study began."""
        if label not in self.cases:
            registry = Registry.load(self.plugins[label])
            here = {"/".join(key): source.digest for key, source in registry.sources.items()}
            differ = [name for name, digest in self.components[label].items() if here.get(name) != digest]
            if differ or self.surroundings != _surroundings():
                what = differ[0] if differ else "the versions of Python and its packages"
                raise PluginError(f"expected {what} as where the study was started, found another here")
            self.cases[label] = load(self.sources[label], registry=registry)
        return self.cases[label]


def _surroundings() -> dict[str, str]:
    return {**surroundings(), "percuss": f"{__version__} {own_digest()}"}
