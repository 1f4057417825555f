"""The side of a study that workers see: the cases as text, with all files they need, and the runs to be made."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import percuss
from percuss.case.case import Case, load
from percuss.compiling import LOCK as ONE_AT_A_TIME
from percuss.errors import PluginError
from percuss.methods.local_modules import companions
from percuss.methods.registry import Registry
from percuss.methods.source_digest import SourceDigests, data_named, own_digest, surroundings
from percuss.studies.stored_run import Record, record
from percuss.studies.tasks import LOST, Task, perform_timed

if TYPE_CHECKING:
    from percuss.case.source import Source
    from percuss.studies.columns import Column
    from percuss.studies.run_key import Keys

__all__ = ["Bench", "Interrupted", "Job", "packed"]

LONGEST = 1.0  # seconds after which a worker hands back what it has


class Interrupted(Exception):
    """Ctrl-C ended a run of this process; carries the records of the runs before it."""

    def __init__(self, records: list[Record]) -> None:
        super().__init__()
        self.records = records


class Job(NamedTuple):
    """A task and the key of what it depends on."""

    key: str
    task: Task


@dataclass(frozen=True)
class Bench:
    """All that a worker, on this machine or on another, needs to make the runs of a study.

    Attributes
    ----------
    cases
        Contents of each case, by label.
    files
        Files of numbers that each case names, by the path written there.
    plugins
        Single-file plug-ins of each case: path, and contents of the file and of the helpers in its folder.
    columns, nudge, histories, repeats
        What a row is made of.
    components, surroundings
        What numbers depend on, as it was when the keys were made: digests of methods, versions, the environment.
    """

    cases: Mapping[str, Source]
    files: Mapping[str, Mapping[str, bytes]]
    plugins: Mapping[str, tuple[tuple[str, Mapping[str, bytes]], ...]]
    columns: Sequence[Column]
    nudge: bool
    histories: int
    repeats: int | None = None
    components: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    surroundings: Mapping[str, str] = field(default_factory=dict)

    def case(self, label: str) -> Case:
        """Return a case, read with the plug-ins and files as they were when the study began."""
        registry = Registry.load([_plugin(Path(path), files) for path, files in self.plugins[label]])
        self._expect_the_same(registry, self.components.get(label, {}))
        origin = self.cases[label]
        return load(dataclasses.replace(origin, folder=_folder(origin.folder, self.files[label])), registry=registry)

    def records(self, jobs: Sequence[Job], note: Callable[[str], None] | None = None) -> list[Record]:
        """Make runs until all are made, or `LONGEST` has passed; what is left over is to be asked for again.

        Parameters
        ----------
        jobs
            What to run.
        note
            Told the key of each run before it begins.

        Raises
        ------
        Interrupted
            If Ctrl-C reached this process.
        """
        started = time.perf_counter()
        made: list[Record] = []
        for key, task in jobs:
            if note is not None:
                note(key)
            began = time.perf_counter()
            try:
                case = self._kept(task.case)
            except Exception as error:  # noqa: BLE001 - it was read where the study began: something here is otherwise
                reason = f"the process that was to make the run cannot read the case: {error}"
                made.append(Record(key, LOST, reason, "worker", misfit=True))
                continue
            row = perform_timed(case, task, nudge=self.nudge, repeats=self.repeats)
            if row.status == "interrupted":
                raise Interrupted(made)
            wall = time.perf_counter() - began
            made.append(record(key, row, self.columns, self.histories, wall, case.registry))
            if time.perf_counter() - started > LONGEST:
                break
        return made

    def _expect_the_same(self, registry: Registry, components: Mapping[str, str]) -> None:
        """Raise PluginError where a number made here might be another than that of the plan."""
        digests = SourceDigests()
        here = {
            f"{family}/{name}": digests.of(source)
            for (family, name), source in registry.sources.items()
            if f"{family}/{name}" in components
        }
        around = {**surroundings(), "percuss": f"{percuss.__version__} {own_digest()}"} if self.surroundings else {}
        for name, digest in components.items():
            if name not in here:
                raise PluginError(f"{name} is not installed here, and it is where the study was begun")
            if here[name] != digest:
                raise PluginError(f"the sources of {name} are others here than where the study was begun")
        for name in sorted({*around, *self.surroundings}):
            mine, theirs = around.get(name, "not set"), self.surroundings.get(name, "not set")
            if mine != theirs:
                what = "has other sources here than" if name == "percuss" else f"is {mine} here, and {theirs}"
                raise PluginError(f"{name} {what} where the study was begun")

    @functools.cached_property
    def _read(self) -> dict[str, Case]:
        return {}

    def _kept(self, label: str) -> Case:
        """Return a case that is read once a process."""
        with ONE_AT_A_TIME:
            if label not in self._read:
                self._read[label] = self.case(label)
            return self._read[label]

    def __getstate__(self) -> dict[str, object]:
        return {one.name: getattr(self, one.name) for one in dataclasses.fields(self)}

    def __setstate__(self, state: dict[str, object]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, value)


def packed(
    cases: Mapping[str, Case],
    columns: Sequence[Column],
    keys: Keys,
    *,
    nudge: bool,
    histories: int,
    repeats: int | None = None,
) -> Bench:
    """Return the bench of a study, whose `keys` have been made."""
    plugins = {
        label: tuple((str(file), _with_helpers(file)) for file in case.registry.files) for label, case in cases.items()
    }
    origins = {label: _without_plugins(case.origin) for label, case in cases.items()}
    files = {label: keys.files.get(label, {}) for label in cases}
    used = keys.components, keys.surroundings
    return Bench(origins, files, plugins, columns, nudge, histories, repeats, *used)


def _without_plugins(origin: Source) -> Source:
    """Return a case's contents without the plug-ins that it names: they travel as text."""
    return origin.replaced(("plugins",), ()) if "plugins" in origin.data else origin


def _with_helpers(file: Path) -> dict[str, bytes]:
    """Return the contents of a single-file plug-in, and of helpers and data in its folder that it names."""
    content = file.read_bytes()
    helpers = {path: text for path, (_, text) in companions(file, content).items()}
    named = {path for source, text in {file: content, **helpers}.items() for path in data_named(source, text)}
    data = {path: path.read_bytes() for path in sorted(named)}
    beside = {path: text for path, text in {**helpers, **data}.items() if path.is_relative_to(file.parent)}
    return {file.name: content} | {str(path.relative_to(file.parent)): text for path, text in beside.items()}


def _plugin(path: Path, files: Mapping[str, bytes]) -> Path:
    """Return a file with these contents: the one that it was read from, or a copy where that is another by now."""
    return _folder(path.parent, files) / path.name


def _folder(folder: Path, files: Mapping[str, bytes]) -> Path:
    """Return a folder with these files: the one they were read from, or one of copies."""
    if all(_holds(folder / name, text) for name, text in files.items()):
        return folder
    return _copied(files)


def _holds(path: Path, text: bytes) -> bool:
    try:
        return path.read_bytes() == text
    except OSError:
        return False


def _copied(files: Mapping[str, bytes]) -> Path:
    """Return a folder of copies, whose name says what they hold; several workers may make it at once."""
    digest = hashlib.sha256(repr(sorted(files.items())).encode()).hexdigest()[:16]
    folder = Path(tempfile.gettempdir()) / f"percuss-{os.getuid() if hasattr(os, 'getuid') else 0}-{digest}"
    for name, text in _inside(folder, files):
        name.parent.mkdir(parents=True, exist_ok=True)
        beside = name.with_name(f".{name.name}.{os.getpid()}.{threading.get_ident()}")
        beside.write_bytes(text)
        beside.replace(name)
    return folder


def _inside(folder: Path, files: Mapping[str, bytes]) -> Iterator[tuple[Path, bytes]]:
    for name, text in files.items():
        target = folder / name
        if folder.resolve() not in target.resolve().parents:
            raise ValueError(f"{name} would be copied to outside {folder}")
        if not _holds(target, text):
            yield target, text
