"""The key of a run, a digest of all its inputs: equal keys give equal rows, so a stored run is not made again."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from percuss.case import overrides
from percuss.case.case import Case, load
from percuss.case.source import Source
from percuss.errors import PercussError
from percuss.jsonable import Data
from percuss.methods.source_digest import SourceDigests, content_digest, own_digest, surroundings
from percuss.studies.columns import RowSettings
from percuss.studies.tasks import Task
from percuss.version import __version__

SILENT = ("title", "source", "expect", "plugins")  # entries of a case that change no number of its run


class _Inputs(NamedTuple):
    """Inputs of a run besides its options: digests of its components, and contents of the data files that it names."""

    components: dict[str, str]
    files: dict[str, bytes]


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
        Contents of the data files that the tasks of each case name, by the case's label and the path written there.
    """

    def __init__(self, settings: RowSettings) -> None:
        columns = settings.columns
        measured = sorted([column.name, column.kind, [list(pair) for pair in column.arguments]] for column in columns)
        self.surroundings = {**surroundings(), "percuss": f"{__version__} {own_digest()}"}
        self.common = [self.surroundings, measured, settings.nudge, settings.histories, settings.repeats]
        self.measures = {column.name for column in columns if column.kind == "plug-in"}
        self.components: dict[str, dict[str, str]] = {}
        self.files: dict[str, dict[str, bytes]] = {}
        self._digests = SourceDigests()
        self._inputs: dict[str, _Inputs] = {}

    def of(self, label: str, case: Case, task: Task) -> str:
        """Return the key of a task of `case`, whose label is `label`.

        Raises
        ------
        InputError
            If a source was edited after this process imported it.
        """
        try:
            changed = overrides.apply(case.origin, task.changes, case.registry)[0]
        except PercussError:  # the run will fail and report it
            changed = None
        data = changed.data if changed is not None else {**case.origin.data, "changes": task.changes}
        relevant = {name: value for name, value in data.items() if name not in SILENT}
        inputs = self._inputs_of(label, case, task, changed, relevant)
        files = [[name, content_digest(content)] for name, content in inputs.files.items()]
        inputs_of_run = [self.common, sorted(inputs.components.items()), files, relevant, task.tied]
        return content_digest(json.dumps(inputs_of_run, sort_keys=True, default=str).encode())[:32]

    def _inputs_of(self, label: str, case: Case, task: Task, changed: Source | None, data: Data) -> _Inputs:
        """Return the components and files of a task; they do not depend on the values of numbers."""
        words = {path: value for path, value in task.changes.items() if not isinstance(value, int | float)}
        kind = json.dumps([label, words, task.tied], sort_keys=True, default=str)
        if kind not in self._inputs:
            components = dict(self._components(case, task, changed))
            files = files_named(data, case.origin.folder)
            self._inputs[kind] = _Inputs(components, files)
            self.components.setdefault(label, {}).update(components)
            self.files.setdefault(label, {}).update(files)
        return self._inputs[kind]

    def _components(self, case: Case, task: Task, changed: Source | None) -> Iterator[tuple[str, str]]:
        """Yield name and digest of each component of a run, or of all single-file plug-ins for an unreadable case.

        `changed` is the text of the case with the changes of the task, or None if they cannot be made.
        """
        from percuss.results.provenance import components_used
        from percuss.studies.perform import tying_law

        sources = case.registry.sources
        used = {f"{family}/{name}" for (family, name), source in sources.items() if not source.distribution}
        if changed is not None:
            with contextlib.suppress(PercussError):
                components = components_used(load(changed, registry=case.registry))
                used = {f"{family}/{name}" for family, name in components}
        for (family, name), source in sources.items():
            # Any solution may cover the case: it gives the true error, and the times at which a tied twin is tied.
            wanted = family == "solutions" or (family == "measures" and name in self.measures)
            wanted = wanted or (task.tied and (family, name) == ("contacts", tying_law(case.registry).name))
            if wanted or f"{family}/{name}" in used:
                yield f"{family}/{name}", self._digests.of(source)


def files_named(data: Data, folder: Path) -> dict[str, bytes]:
    """Return the contents of the files that entries of a case name, by the path written there.

    Parameters
    ----------
    data
        The case as plain data, overrides applied.
    folder
        Folder to which the paths are relative.
    """
    contents = {}
    for name in sorted(set(_texts({key: value for key, value in data.items() if key not in SILENT}))):
        try:
            if (folder / name).is_file():
                contents[name] = (folder / name).read_bytes()
        except (OSError, ValueError):  # not a path, or one that cannot be read, which the case reports
            continue
    return contents


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for item in value.values():
            yield from _texts(item)
    elif isinstance(value, tuple | list):
        for item in value:
            yield from _texts(item)
