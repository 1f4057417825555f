"""What a run depends on, as one key: two runs with equal keys give the same row, so one that is there is not made."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import percuss
from percuss.case import overrides
from percuss.errors import PercussError
from percuss.methods.source_digest import SourceDigests, content_digest, own_digest, surroundings

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.studies.columns import Column
    from percuss.studies.tasks import Task

__all__ = ["Keys", "files_named"]

SILENT = ("title", "source", "expect", "plugins")  # entries of a case that change no number of its run


class _Inputs(NamedTuple):
    """What a run is made of beside numbers: digests of its components, and the files of numbers that it names."""

    components: dict[str, str]
    files: dict[str, bytes]


class Keys:
    """Makes the keys of a study's tasks.

    Parameters
    ----------
    columns
        What is measured.
    nudge, histories, repeats
        What else a row depends on.

    Attributes
    ----------
    surroundings
        Versions and variables of the environment on which every row depends.
    components
        Digest of each component that some task of a case uses, by the case's label, then family and name.
    files
        The files of numbers that the tasks of each case name, by the case's label and the path written there.
    """

    def __init__(self, columns: Sequence[Column], *, nudge: bool, histories: int, repeats: int | None = None) -> None:
        measured = sorted([one.name, one.kind, [list(pair) for pair in one.arguments]] for one in columns)
        self.surroundings = {**surroundings(), "percuss": f"{percuss.__version__} {own_digest()}"}
        self.common = [self.surroundings, measured, nudge, histories, repeats]
        self.measures = {one.name for one in columns if one.kind == "plug-in"}
        self.components: dict[str, dict[str, str]] = {}
        self.files: dict[str, dict[str, bytes]] = {}
        self._digests = SourceDigests()
        self._inputs: dict[str, _Inputs] = {}

    def of(self, label: str, case: Case, task: Task) -> str:
        """Return the key of a task of `case`, which is called `label`.

        Raises
        ------
        InputError
            If a source was edited after this process imported it.
        """
        try:
            data = overrides.apply(case.origin, task.changes, case.registry)[0].data
        except PercussError:  # a row that says so
            data = {**case.origin.data, "changes": task.changes}
        heard = {name: value for name, value in data.items() if name not in SILENT}
        inputs = self._inputs_of(label, case, task, heard)
        files = [[name, content_digest(content)] for name, content in inputs.files.items()]
        told = [self.common, sorted(inputs.components.items()), files, heard, task.tied]
        return hashlib.sha256(json.dumps(told, sort_keys=True, default=str).encode()).hexdigest()[:32]

    def _inputs_of(self, label: str, case: Case, task: Task, data: Mapping[str, Any]) -> _Inputs:
        """Return the components and files of a task; a number never changes which they are."""
        words = {path: value for path, value in task.changes.items() if not isinstance(value, int | float)}
        which = json.dumps([label, words, task.tied], sort_keys=True, default=str)
        if which not in self._inputs:
            components = dict(self._components(case, task))
            files = files_named(data, case.origin.folder)
            self._inputs[which] = _Inputs(components, files)
            self.components.setdefault(label, {}).update(components)
            self.files.setdefault(label, {}).update(files)
        return self._inputs[which]

    def _components(self, case: Case, task: Task) -> Iterator[tuple[str, str]]:
        """Yield name and digest of all components that a run uses; of all single files where it cannot be read."""
        from percuss.results.provenance import plugins_used
        from percuss.studies.tasks import tying_law

        sources = case.registry.sources
        try:
            used = set(plugins_used(case.with_overrides(task.changes)))
        except PercussError:
            used = {f"{family}/{name}" for (family, name), source in sources.items() if not source.distribution}
        for (family, name), source in sources.items():
            # whichever solution covers the case says its true error, and when a tied twin is tied
            wanted = family == "solutions" or (family == "measures" and name in self.measures)
            wanted = wanted or (task.tied and (family, name) == ("contacts", tying_law(case.registry).name))
            if wanted or f"{family}/{name}" in used:
                yield f"{family}/{name}", self._digests.of(source)


def files_named(data: Mapping[str, Any], folder: Path) -> dict[str, bytes]:
    """Return the files that some entry of a case names, by the path written there.

    Parameters
    ----------
    data
        The case as plain data, overrides applied.
    folder
        That its paths are relative to.
    """
    found = {}
    for name in sorted(set(_texts({key: value for key, value in data.items() if key not in SILENT}))):
        try:
            if (folder / name).is_file():
                found[name] = (folder / name).read_bytes()
        except (OSError, ValueError):  # no path at all, or one that cannot be read: the case says so
            continue
    return found


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for one in value.values():
            yield from _texts(one)
    elif isinstance(value, tuple | list):
        for one in value:
            yield from _texts(one)
