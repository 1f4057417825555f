"""Job package of a study for its workers: the cases as text, with all files they need, and the runs to make."""

from __future__ import annotations

import dataclasses
import functools
import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from percuss.case.case import Case, load
from percuss.case.source import Source
from percuss.compiling import LOCK as ONE_AT_A_TIME
from percuss.errors import PluginError
from percuss.heartbeat import beat
from percuss.methods.blame import plugin_faults
from percuss.methods.registry import Registry
from percuss.methods.single_file import SingleFile
from percuss.methods.source_digest import SourceDigests, content_digest, own_digest, surroundings
from percuss.studies.columns import RowSettings
from percuss.studies.perform import LOST, perform_timed
from percuss.studies.run_key import Keys
from percuss.studies.stored_run import Record, record
from percuss.studies.tasks import Task
from percuss.version import __version__

LONGEST = 1.0  # seconds after which a worker returns the runs it has made


class Interrupted(Exception):
    """Exception after Ctrl-C ended a run of this process, with the records of the runs before it."""

    def __init__(self, records: list[Record]) -> None:
        super().__init__()
        self.records = records


class Job(NamedTuple):
    """A task and the key of its inputs."""

    key: str
    task: Task


@dataclass(frozen=True)
class Bench:
    """Everything that a worker, on this machine or on another, needs to make the runs of a study.

    Attributes
    ----------
    cases
        Contents of each case, by label.
    files
        Contents of the data files that each case names, by label and by the path written in the case.
    plugins
        Single-file plug-ins of each case, by label: path, and contents of the file and of its data files.
    settings
        Settings on which every row depends.
    components, surroundings
        Digests of methods, and versions and environment, at the time the keys were made: the numbers depend on them.
    """

    cases: Mapping[str, Source]
    files: Mapping[str, Mapping[str, bytes]]
    plugins: Mapping[str, tuple[tuple[str, Mapping[str, bytes]], ...]]
    settings: RowSettings
    components: Mapping[str, Mapping[str, str]]
    surroundings: Mapping[str, str]

    def case(self, label: str) -> Case:
        """Return a case, read with the plug-ins and files as they were when the study began."""
        registry = Registry.load([_plugin(Path(path), files) for path, files in self.plugins[label]])
        self._check_environment(registry, self.components.get(label, {}))
        origin = self.cases[label]
        return load(dataclasses.replace(origin, folder=_folder(origin.folder, self.files[label])), registry=registry)

    def records(self, jobs: Sequence[Job], note: Callable[[str], None] | None = None) -> list[Record]:
        """Return the records of the runs made until `LONGEST` has passed; the rest must be requested again.

        Parameters
        ----------
        jobs
            Runs to make.
        note
            Called with the key of each run before it begins.

        Raises
        ------
        Interrupted
            If Ctrl-C reached this process.
        """
        started = time.perf_counter()
        records: list[Record] = []
        for key, task in jobs:
            if note is not None:
                note(key)
            beat()
            began = time.perf_counter()
            try:
                with plugin_faults():
                    case = self._case_once(task.case)
            except Exception as error:  # noqa: BLE001 - it was read where the study began: this machine differs
                reason = f"the worker process cannot read the case: {error}"
                records.append(Record(key, LOST, reason, "worker", misfit=True))
                continue
            run = perform_timed(case, task, nudge=self.settings.nudge, repeats=self.settings.repeats)
            if run.status == "interrupted":
                raise Interrupted(records)
            wall = time.perf_counter() - began
            records.append(record(key, run, self.settings, wall, case.registry))
            if time.perf_counter() - started > LONGEST:
                break
        return records

    def rehearse(self, task: Task) -> Mapping[str, object] | None:
        """Make one step of a run of one step; return its summary as plain data, or None if it fails."""
        from percuss.jsonable import plain
        from percuss.studies.preflight import rehearse

        try:
            with plugin_faults():
                case = self._case_once(task.case)
        except Exception:  # noqa: BLE001 - the runs of this case will say why it cannot be read here
            return None
        return plain(rehearse(case, task))  # type: ignore[no-any-return]

    def _check_environment(self, registry: Registry, components: Mapping[str, str]) -> None:
        """Raise PluginError if numbers computed here could differ from those where the study began."""
        digests = SourceDigests()
        local_digests = {
            f"{family}/{name}": digests.of(source)
            for (family, name), source in registry.sources.items()
            if f"{family}/{name}" in components
        }
        environment = {**surroundings(), "percuss": f"{__version__} {own_digest()}"} if self.surroundings else {}
        for name, digest in components.items():
            if name not in local_digests:
                raise PluginError(f"{name} is not installed here, but was where the study was started")
            if local_digests[name] != digest:
                raise PluginError(f"the sources of {name} differ here from those where the study was started")
        for name in sorted({*environment, *self.surroundings}):
            local, planned = environment.get(name, "not set"), self.surroundings.get(name, "not set")
            if local != planned:
                difference = "has other sources here than" if name == "percuss" else f"is {local} here, and {planned}"
                raise PluginError(f"{name} {difference} where the study was started")

    @functools.cached_property
    def _cases_read(self) -> dict[str, Case]:
        return {}

    def _case_once(self, label: str) -> Case:
        """Return a case, which is read once per process."""
        with ONE_AT_A_TIME:
            if label not in self._cases_read:
                self._cases_read[label] = self.case(label)
            return self._cases_read[label]

    def __getstate__(self) -> dict[str, object]:
        return {attribute.name: getattr(self, attribute.name) for attribute in dataclasses.fields(self)}

    def __setstate__(self, state: dict[str, object]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, value)


def packed(cases: Mapping[str, Case], settings: RowSettings, keys: Keys) -> Bench:
    """Return the bench of a study; `keys` must have made the keys of all its tasks."""
    plugins = {
        label: tuple((str(file), SingleFile.read(file).files) for file in case.registry.files)
        for label, case in cases.items()
    }
    origins = {label: _without_plugins(case.origin) for label, case in cases.items()}
    files = {label: keys.files.get(label, {}) for label in cases}
    return Bench(origins, files, plugins, settings, keys.components, keys.surroundings)


def _without_plugins(origin: Source) -> Source:
    """Return the contents of a case without the plug-ins that it names, which travel as text."""
    return origin.replaced(("plugins",), ()) if "plugins" in origin.data else origin


def _plugin(path: Path, files: Mapping[str, bytes]) -> Path:
    """Return a file with these contents: the original, or a copy if the original has changed."""
    return _folder(path.parent, files) / path.name


def _folder(folder: Path, files: Mapping[str, bytes]) -> Path:
    """Return a folder with these files: the original, or a folder of copies if a file has changed."""
    if all(_holds(folder / name, text) for name, text in files.items()):
        return folder
    return _copied(files)


def _holds(path: Path, text: bytes) -> bool:
    try:
        return path.read_bytes() == text
    except OSError:
        return False


def _copied(files: Mapping[str, bytes]) -> Path:
    """Return a folder of copies, named by a digest of their contents; several workers may make it at once."""
    digest = content_digest(repr(sorted(files.items())).encode())[:16]
    user = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"percuss-{user}-{digest}"
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.lstat().st_uid != user:  # who owns the folder can put other code there after it was compared
        raise PluginError(f"{folder} belongs to another user: set TMPDIR to a folder of your own")
    for path, text in _missing_files(folder, files):
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}")
        temporary.write_bytes(text)
        temporary.replace(path)
    return folder


def _missing_files(folder: Path, files: Mapping[str, bytes]) -> Iterator[tuple[Path, bytes]]:
    """Yield path and contents of the files that a folder lacks.

    Raises
    ------
    ValueError
        For a path outside the folder, to which nothing is written.
    """
    for name, text in files.items():
        target = folder / name
        if folder.resolve() not in target.resolve().parents:
            raise ValueError(
                f"this machine lacks the file {name}, or has another one there; only files in the folder of the case "
                "and below it travel to a worker: put it there"
            )
        if not _holds(target, text):
            yield target, text
