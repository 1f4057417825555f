"""What a run depends on, as one key: two runs with equal keys give the same row, so one that is there is not made."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import percuss
from percuss import overrides
from percuss.errors import PercussError

if TYPE_CHECKING:
    from percuss.case import Case
    from percuss.columns import Column
    from percuss.tasks import Task

__all__ = ["Keys", "files_named"]

SILENT = ("title", "source", "expect", "plugins")  # entries of a case that change no number of its run


class Keys:
    """Makes the keys of a study's tasks.

    Parameters
    ----------
    columns
        What is measured.
    nudge, histories
        What else a row depends on.
    """

    def __init__(self, columns: Sequence[Column], *, nudge: bool, histories: int) -> None:
        measured = sorted([one.name, one.kind, [list(pair) for pair in one.arguments]] for one in columns)
        self.common = [percuss.__version__, _own_sources(), measured, nudge, histories]
        self.measures = {one.name for one in columns if one.kind == "plug-in"}
        self._parts: dict[str, list[str]] = {}
        self._files: dict[int, list[list[str]]] = {}

    def of(self, label: str, case: Case, task: Task) -> str:
        """Return the key of a task of `case`, which is called `label`."""
        try:
            data = overrides.apply(case.origin, task.changes, case.registry)[0].data
        except PercussError:  # a row that says so
            data = {**case.origin.data, "changes": task.changes}
        heard = {name: value for name, value in data.items() if name not in SILENT}
        if id(case) not in self._files:
            self._files[id(case)] = [[name, _hash(text)] for name, text in files_named(case).items()]
        told = [self.common, self._used(label, case, task), self._files[id(case)], heard, task.tied]
        return hashlib.sha256(json.dumps(told, sort_keys=True, default=str).encode()).hexdigest()[:32]

    def _used(self, label: str, case: Case, task: Task) -> list[str]:
        """Return the sources of the components of a task; a number never changes which they are."""
        words = {path: value for path, value in task.changes.items() if not isinstance(value, int | float)}
        which = json.dumps([label, words], sort_keys=True, default=str)
        if which not in self._parts:
            self._parts[which] = sorted(set(_components(case, task.changes, self.measures)))
        return self._parts[which]


def _components(case: Case, changes: Mapping[str, Any], measures: set[str]) -> Iterator[str]:
    """Yield hashes of the sources of all components that a run uses; of all single files where it cannot be read."""
    from percuss.runner import plugins_used

    registry = case.registry
    try:
        used = plugins_used(case.with_overrides(changes))
    except PercussError:
        yield from (source.version for source in registry.sources.values() if not source.distribution)
        return
    for one in used.values():
        yield _source(**one)
    for (family, name), source in registry.sources.items():
        # whichever solution covers the case says its true error
        if family == "solutions" or (family == "measures" and name in measures):
            yield _source(source.distribution, source.version, source.file)


def _source(distribution: str, version: str, file: str) -> str:
    """Return a hash of a component's source: a single file's as read, or a package's file and its helpers.

    Helpers are the files beside it whose names start with ``_``.
    """
    if not distribution:
        return version
    path = Path(file)
    files = [path, *sorted(path.parent.glob("_[a-z]*.py"))]
    return f"{version} {_hash(b''.join(one.read_bytes() for one in files if one.is_file()))}"


@functools.cache
def _own_sources() -> str:
    """Return a hash of percuss itself: a clone that is being worked on changes without a new version."""
    return _hash(b"\0".join(one.read_bytes() for one in sorted(Path(__file__).parent.glob("*.py"))))


def _hash(text: bytes) -> str:
    return hashlib.sha256(text).hexdigest()[:16]


def files_named(case: Case) -> dict[str, bytes]:
    """Return the files of numbers that the loads of a case name, by the path written there."""
    folder = case.origin.folder
    names = set(_texts(case.origin.data.get("loads", {})))
    return {name: (folder / name).read_bytes() for name in sorted(names) if (folder / name).is_file()}


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for one in value.values():
            yield from _texts(one)
    elif isinstance(value, tuple):
        for one in value:
            yield from _texts(one)
