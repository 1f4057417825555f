"""What goes to the workers of a study and what comes back: the key of each run, the package of all, and the records.

A key is a digest of all inputs of a run: equal keys give equal rows, so that a stored run is not made again. The
package has the cases as text with all files that they need. A record is a run as it is stored.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import json
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from percuss.case import overrides
from percuss.case.case import Case, load
from percuss.case.source import Source
from percuss.digest import content_digest, own_digest, surroundings
from percuss.errors import PercussError, PluginError
from percuss.jit import LOCK as ONE_AT_A_TIME
from percuss.jsonable import Data, Entries, plain
from percuss.methods.blame import plugin_faults
from percuss.methods.registry import Registry
from percuss.results.provenance import components_used, processor_model
from percuss.results.result import Result
from percuss.studies.columns import RowSettings
from percuss.studies.perform import LOST, Run, failure_status, perform_timed, tying_law
from percuss.studies.tasks import Task
from percuss.version import __version__

WORKER = "worker"  # `said_by` of a run that was lost with its worker
SILENT = ("title", "source", "expect", "plugins")  # entries of a case that change no number of its run


def run_data(data: Data) -> Entries:
    """Return the entries of a case that change its run."""
    return {name: value for name, value in data.items() if name not in SILENT}


class Keys:
    """Maker of the keys for the tasks of a study.

    Parameters
    ----------
    settings
        Settings on which every row depends.

    Attributes
    ----------
    surroundings
        Versions and variables of the environment on which every row depends.
    components
        Digest of each component that some task of a case uses, by the case's label, then family and name.
    files
        Texts of the data files that the tasks of each case name, by the case's label and the path written there.
    """

    def __init__(self, settings: RowSettings) -> None:
        columns = settings.columns
        measured = sorted([column.name, column.kind, column.path, repr(column.section)] for column in columns)
        self.surroundings = {**surroundings(), "percuss": f"{__version__} {own_digest()}"}
        self.common = [self.surroundings, measured, settings.nudge, settings.histories, settings.repeats]
        self.measures = {column.name for column in columns if column.kind == "plug-in"}
        self.components: dict[str, dict[str, str]] = {}
        self.files: dict[str, dict[str, str]] = {}
        self._inputs: dict[str, tuple[dict[str, str], dict[str, str]]] = {}

    def of(self, label: str, case: Case, task: Task) -> str:
        """Return the key of a task of `case`, whose label is `label`."""
        try:
            changed = overrides.apply(case.origin, task.changes, case.registry)[0]
        except PercussError:  # the run will fail and report it
            changed = None
        data = run_data(changed.data if changed is not None else {**case.origin.data, "changes": task.changes})
        components, files = self._inputs_of(label, case, task, changed)
        digests = [[name, content_digest(text.encode())] for name, text in sorted(files.items())]
        inputs = [self.common, sorted(components.items()), digests, data, task.tied]
        return content_digest(json.dumps(inputs, sort_keys=True, default=str).encode())[:32]

    def _inputs_of(
        self, label: str, case: Case, task: Task, changed: Source | None
    ) -> tuple[dict[str, str], dict[str, str]]:
        """Return digests of the components of a task, and texts of its data files, by name.

        They do not depend on the values of numbers. `changed` is the text of the case with the changes of the task, or
        None if they cannot be made. An unreadable case counts with its own files and all single-file plug-ins.
        """
        words = {path: value for path, value in task.changes.items() if not isinstance(value, int | float)}
        kind = json.dumps([label, words, task.tied], sort_keys=True, default=str)
        if kind in self._inputs:
            return self._inputs[kind]
        read = None
        if changed is not None:
            with contextlib.suppress(PercussError):
                read = load(changed, registry=case.registry)
        inputs = dict(self._components(case, task, read)), dict((read or case).data_files)
        self.components.setdefault(label, {}).update(inputs[0])
        self.files.setdefault(label, {}).update(inputs[1])
        if read is not None:
            self._inputs[kind] = inputs
        return inputs

    def _components(self, case: Case, task: Task, read: Case | None) -> Iterator[tuple[str, str]]:
        """Yield name and digest of each component of a run, whose case is None if it cannot be read."""
        sources = case.registry.sources
        single_files = [key for key, source in sources.items() if not source.distribution]
        used = {*single_files} if read is None else {*components_used(read)}
        # Any solution may cover the case: it gives the true error, and the times at which a tied twin is tied.
        used |= {key for key in sources if key[0] == "solutions"} | {("measures", name) for name in self.measures}
        used |= {("contacts", tying_law(case.registry).name)} if task.tied else set()
        for family, name in sources:
            if (family, name) in used:
                yield f"{family}/{name}", sources[family, name].digest


class Job(NamedTuple):
    """A task and the key of its inputs."""

    key: str
    task: Task


@dataclass(frozen=True)
class Bench:
    """Everything that a process needs to make the runs of a study.

    Attributes
    ----------
    cases
        Contents of each case, by label, with the texts of the data files that it names.
    plugins
        Paths of the single-file plug-ins of each case, by label.
    settings
        Settings on which every row depends.
    components, surroundings
        Digests of methods, and versions and environment, at the time the keys were made: the numbers depend on them.
    read
        The cases that a process has read so far, by label.
    """

    cases: Mapping[str, Source]
    plugins: Mapping[str, tuple[Path, ...]]
    settings: RowSettings
    components: Mapping[str, Mapping[str, str]]
    surroundings: Mapping[str, str]
    read: dict[str, Case] = field(default_factory=dict, init=False, repr=False)

    def record_elsewhere(self, job: Job) -> Record:
        """Return the record of a run in another process than that which hands out the work and sees Ctrl-C."""
        return self.record(job) or Record(job.key, LOST, "the run was interrupted", WORKER)

    def record(self, job: Job) -> Record | None:
        """Return the record of a run; None if Ctrl-C has ended it."""
        began = time.perf_counter()
        try:
            with plugin_faults(), ONE_AT_A_TIME:
                case = self._case(job.task.case)
        except Exception as error:  # noqa: BLE001 - it was read where the study began: this process differs
            return Record(job.key, LOST, f"the worker process cannot read the case: {error}", WORKER)
        asked = self.settings
        run = perform_timed(case, job.task, nudge=asked.nudge, repeats=asked.repeats, critical_step=asked.critical_step)
        if run.status == "interrupted":
            return None
        return record(job.key, run, asked, time.perf_counter() - began, case.registry)

    def _case(self, label: str) -> Case:
        """Return a case, which is read once per process, if all is here as it was where the study began."""
        if label not in self.read:
            registry = Registry.load(self.plugins[label])
            self._check_environment(registry, self.components.get(label, {}))
            self.read[label] = load(self.cases[label], registry=registry)
        return self.read[label]

    def _check_environment(self, registry: Registry, components: Mapping[str, str]) -> None:
        """Raise PluginError if numbers computed here could differ from those where the study began."""
        sources = {f"{family}/{name}": source for (family, name), source in registry.sources.items()}
        for name, digest in components.items():
            if name not in sources:
                raise PluginError(f"{name} is not installed here, but was where the study was started")
            if sources[name].digest != digest:
                raise PluginError(f"the sources of {name} differ here from those where the study was started")
        here = {**surroundings(), "percuss": f"{__version__} {own_digest()}"}
        for name in sorted({*here, *self.surroundings}):
            local, planned = here.get(name, "not set"), self.surroundings.get(name, "not set")
            if local != planned:
                difference = "has other sources here than" if name == "percuss" else f"is {local} here, and {planned}"
                raise PluginError(f"{name} {difference} where the study was started")


def packed(cases: Mapping[str, Case], settings: RowSettings, keys: Keys) -> Bench:
    """Return the bench of a study; `keys` must have made the keys of all its tasks."""
    origins = {
        label: dataclasses.replace(case.origin.replaced(("plugins",), ()), data_files=keys.files.get(label, {}))
        for label, case in cases.items()
    }
    plugins = {label: tuple(file.path for file in case.registry.single_files) for label, case in cases.items()}
    return Bench(origins, plugins, settings, keys.components, keys.surroundings)


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
    times = run.result.summary["seconds"] if run.result is not None else {}
    stored = Record(key, run.status, run.reason, run.said_by)
    stored = replace(stored, wall=wall, compiling=times.get("compile"), cpu=processor_model())
    if run.result is None or run.status != "done":
        return stored
    measures = {}
    for column in settings.columns:
        try:
            with plugin_faults():
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
