"""Where the runs of a study are made: the key of the inputs of each run, and the bench that makes the run.

A key is a digest of all inputs of a run: equal keys give equal rows, so that a stored run is not made again. The bench
goes to worker processes, also of other machines: it holds the cases as text with all data files that they need.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from percuss.case.case import Case, load
from percuss.case.source import Source
from percuss.digest import content_digest, own_digest, surroundings
from percuss.errors import InputError, PercussError, PluginError
from percuss.jit import LOCK as ONE_AT_A_TIME
from percuss.jsonable import Data, Entries
from percuss.methods.blame import plugin_faults
from percuss.methods.registry import Registry
from percuss.results.provenance import components_used
from percuss.studies.columns import RowSettings
from percuss.studies.perform import LOST, WORKER, Record, perform, record, tying_law
from percuss.studies.tasks import Task
from percuss.version import __version__

SILENT = ("title", "source", "expect", "plugins")  # entries of a case that change no number of its run


class Job(NamedTuple):
    """A task and the key of its inputs."""

    key: str
    task: Task


@dataclass(frozen=True)
class Bench:
    """Everything that a process needs to make the runs of a study.

    Attributes
    ----------
    settings
        Settings on which every row depends.
    sources
        Text of each case, by label, with the texts of the data files that it names.
    plugins
        Paths of the single-file plug-ins of each case, by label.
    components
        Digest of each component that some task of a case uses, by label, then by family and name.
    surroundings
        Versions where the study began, of percuss, of Python and of the packages that compute.
    cases, errors
        The cases that this process has read, by label, and by key the errors of tasks that cannot change their case;
        both stay in this process.
    """

    settings: RowSettings
    sources: dict[str, Source]
    plugins: dict[str, tuple[Path, ...]]
    components: dict[str, dict[str, str]]
    surroundings: dict[str, str]
    cases: dict[str, Case] = field(default_factory=dict, repr=False)
    errors: dict[str, InputError] = field(default_factory=dict, repr=False)

    @staticmethod
    def of(cases: Mapping[str, Case], settings: RowSettings) -> Bench:
        """Return the bench of some cases, which is complete when it has made the jobs of all their tasks."""
        sources = {label: case.origin.replaced(("plugins",), ()) for label, case in cases.items()}
        plugins = {label: tuple(file.path for file in case.registry.single_files) for label, case in cases.items()}
        return Bench(settings, sources, plugins, {label: {} for label in cases}, _surroundings(), dict(cases))

    def __getstate__(self) -> Entries:
        return {**vars(self), "cases": {}, "errors": {}}

    def job(self, task: Task) -> Job:
        """Return a task with its key."""
        case = self.cases[task.case]
        registry, columns = case.registry, self.settings.columns
        # Any solution may cover the case: it gives the true error, and the times at which a tied twin is tied.
        used = {key for key in registry.sources if key[0] == "solutions"}
        used |= {("measures", column.name) for column in columns if column.kind == "plug-in"}
        used |= {("contacts", tying_law(registry).name)} if task.tied else set()
        failed: PercussError | None = None
        try:
            changed = task.changed(case)
        except PercussError as error:  # the run will fail and report it: it depends on the code that refuses it
            failed = error
            data: Data = {**case.data, "changes": task.changes}
            files = case.data_files
            used |= {key for key, source in registry.sources.items() if not source.distribution}
        else:
            data, files = changed.data, changed.data_files
            used |= {*components_used(changed)}
        components = {"/".join(key): registry.sources[key].digest for key in sorted(used & registry.sources.keys())}
        self.components[task.case].update(components)
        source = self.sources[task.case]
        self.sources[task.case] = replace(source, data_files={**source.data_files, **files})
        inputs = [
            self.surroundings,
            sorted([column.name, column.kind, column.path, repr(column.section)] for column in columns),
            [self.settings.nudge, self.settings.histories, self.settings.repeats],
            components,
            {name: content_digest(text.encode()) for name, text in files.items()},
            {name: value for name, value in data.items() if name not in SILENT},
            task.tied,
        ]
        key = content_digest(json.dumps(inputs, sort_keys=True, default=str).encode())[:32]
        if isinstance(failed, InputError):
            self.errors[key] = failed
        return Job(key, task)

    def record_elsewhere(self, job: Job) -> Record:
        """Return the record of a run in another process than that which hands out the work and sees Ctrl-C."""
        return self.record(job) or Record(job.key, LOST, "the run was interrupted", WORKER)

    def record(self, job: Job) -> Record | None:
        """Return the record of a run; None if Ctrl-C has ended it."""
        try:
            with plugin_faults(), ONE_AT_A_TIME:
                case = self._case(job.task.case)
        except Exception as error:  # noqa: BLE001 - it was read where the study began: this process differs
            return Record(job.key, LOST, f"the worker process cannot read the case: {error}", WORKER)
        run, _ = perform(case, job.task, self.settings.run)
        return None if run.status == "interrupted" else record(job.key, run, self.settings, case.registry)

    def _case(self, label: str) -> Case:
        """Return a case, which is read once per process, if all is here as it was where the study began."""
        if label not in self.cases:
            registry, components = Registry.load(self.plugins[label]), self.components[label]
            here = {"/".join(key): source.digest for key, source in registry.sources.items()}
            differ = [name for name, digest in components.items() if here.get(name) != digest]
            if differ or self.surroundings != _surroundings():
                what = differ[0] if differ else "the versions of Python and its packages"
                raise PluginError(f"expected {what} as where the study was started, found another here")
            self.cases[label] = load(self.sources[label], registry=registry)
        return self.cases[label]


def _surroundings() -> dict[str, str]:
    return {**surroundings(), "percuss": f"{__version__} {own_digest()}"}
