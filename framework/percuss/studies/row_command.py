"""The command that makes the run of a row alone: ``percuss run`` with the changes of the row as ``--set``.

A command is stored as a template, which all rows share that differ by numbers alone. It is stored only if the overrides
in it, read as the command line reads them, make of the file of the case exactly the data that the study runs.
"""

from __future__ import annotations

import json
import math
import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from percuss.case import overrides as overriding
from percuss.case.case import Case, load
from percuss.case.source import Source
from percuss.case.yaml_text import flow
from percuss.errors import InputError, PercussError
from percuss.jsonable import Data, Entries
from percuss.studies.job_package import run_data
from percuss.studies.tasks import Task

# Texts, and between them places of numbers: the varied path, and whether its value is a whole number.
Template = list[str | Entries]

LARGEST_EXACT = 2**53  # Above it not every whole number is a double, as which the page of a study holds it.


def named_path(path: Path) -> str:
    """Return the name of a file as a command would name it here, without detours such as ``studies/..``."""
    name = os.path.normpath(path)
    try:
        # Behind a symbolic link the folder above is another one.
        name = name if Path(name).samefile(path) else str(path)
    except OSError:
        name = str(path)
    return f"./{name}" if name.startswith("-") else name


def command_of(template: Template, varied: Data) -> str:
    """Return the command of a row, quoted for a shell.

    Parameters
    ----------
    template
        The template of the row.
    varied
        Value of each varied path of the row.
    """
    return "".join(piece if isinstance(piece, str) else flow(varied[piece["value"]]) for piece in template)


class RowCommands:
    """Maker of the templates for the tasks of a study.

    Parameters
    ----------
    given
        Values that the study sets in every case, by dotted path.
    plugins
        Single-file plug-ins given beside the study.
    nudge
        Whether a nudged twin is run.

    Attributes
    ----------
    templates
        The templates made so far.
    """

    def __init__(self, given: Data, plugins: Sequence[Path], *, nudge: bool) -> None:
        self.given = _texts({path: value for path, value in given.items() if path.partition(".")[0] != "expect"})
        self.plugins = plugins
        self.nudge = nudge
        self.templates: list[Template] = []
        self._index: dict[str, int | None] = {}
        self._files: dict[str, Source] = {}
        self._expectations_fit: dict[tuple[str, ...], bool] = {}

    def index_of(self, label: str, case: Case, task: Task) -> int | None:
        """Return the index of the template of a task of `case`, or None if no command makes the same run.

        Parameters
        ----------
        label
            Label of the case.
        case
            The case with the values that the study sets.
        task
            The task.
        """
        kind = repr([label, _kinds(task.changes), task.tied])
        if kind in self._index:
            return self._index[kind]
        template, numbers_may_change = self._template(label, case, task)
        index = None
        if template is not None:
            self.templates.append(template)
            index = len(self.templates) - 1
        if numbers_may_change:
            self._index[kind] = index
        return index

    def _template(self, label: str, case: Case, task: Task) -> tuple[Template | None, bool]:
        """Return the template of a task, and whether it is that of all tasks that differ by numbers alone."""
        if label not in self._files:
            self._files[label] = Source.parse(case.origin.text, case.origin.name, case.origin.folder)
        file = self._files[label]
        wanted = _changed(case.origin, task.changes, case)
        written, as_study = run_data(file.data), run_data(case.origin.data)
        changes = _texts(task.changes)
        # The changes as they are written in the study come first, as they are the easiest to read.
        candidates = [({**self.given, **changes}, True)]
        as_set = _changed(file, self.given, case) if None not in self.given.values() else None
        if as_set is not None:
            candidates.append(({**self.given, **_differences(as_set, as_study), **changes}, True))
        candidates.append(({**_differences(written, as_study), **changes}, True))
        if wanted is not None:
            candidates.append((_differences(written, wanted), False))
        for texts, numbers_may_change in candidates:
            words = {path: text for path, text in texts.items() if text is not None and "=" not in path}
            if len(words) < len(texts) or _identity(_changed(file, words, case)) != _identity(wanted):
                continue
            numbers = {path: value for path, value in task.varied.items() if numbers_may_change and _is_number(value)}
            if not self._expectations_hold(label, case, words):
                words["expect"] = "[]"
            return self._pieces(case, words, numbers, task), numbers_may_change
        return None, wanted is not None

    def _expectations_hold(self, label: str, case: Case, words: Mapping[str, str]) -> bool:
        """Return whether the case can be read with its expectations, which may name a contact that it no longer has."""
        paths = (label, *words)
        if paths not in self._expectations_fit:
            try:
                load(case.origin.name, words, plugins=self.plugins)
            except InputError as error:
                fit = not any(problem.path.partition(".")[0] == "expect" for problem in error.problems)
            except PercussError:
                fit = True
            else:
                fit = True
            self._expectations_fit[paths] = fit
        return self._expectations_fit[paths]

    def _pieces(self, case: Case, words: Mapping[str, str], numbers: Data, task: Task) -> Template:
        """Return the template of a command that sets `words` by path, with places for `numbers`."""
        files = [word for plugin in self.plugins for word in ("--plugin", named_path(plugin))]
        template: Template = [shlex.join(["percuss", "run", named_path(Path(case.origin.name)), *files])]
        for path, text in words.items():
            if path in numbers:
                # A number needs no quotes, and a quoted text and what follows it are one word of a shell.
                place = {"value": path, "whole": isinstance(numbers[path], int)}
                template += [f" --set {shlex.quote(f'{path}=')}", place]
            else:
                template.append(f" --set {shlex.quote(f'{path}={text}')}")
        template += [" --tied"] if task.tied else []
        template += [" --nudge"] if self.nudge else []
        return template


def _is_number(value: object) -> bool:
    """Return whether a value may differ between rows of one template: a number that the page of a study holds too."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    if isinstance(value, int):
        return abs(value) < LARGEST_EXACT
    return math.isfinite(value) and not (value == 0 and math.copysign(1, value) < 0)


def _kinds(changes: Data) -> list[tuple[str, object]]:
    """Return the changes of a task, with the type of each number in place of it."""
    return [(path, type(value) if _is_number(value) else value) for path, value in changes.items()]


def _texts(values: Data) -> dict[str, str | None]:
    """Return overrides of a study as texts; those that are texts already are read as YAML, as by the command line."""
    return {path: value if isinstance(value, str) else _as_text(value) for path, value in values.items()}


def _as_text(value: object) -> str | None:
    """Return plain data as a text that is read as the same data, or None if there is no such text."""
    for write in (flow, json.dumps):
        try:
            text = write(value)
            if _is_same(Source.parse(text, "").data, value):
                return text
        except (InputError, TypeError, ValueError):
            continue
    return None


def _changed(source: Source, changes: Data, case: Case) -> Entries | None:
    """Return the entries of a source with changes that change its run, or None if they cannot be made."""
    try:
        return run_data(overriding.apply(*overriding.with_plugins(source, changes), case.registry)[0].data)
    except PercussError:
        return None


def _identity(data: Data | None) -> dict[str, str] | None:
    """Return a text for each entry of a case; the order of bodies and contacts counts, that of the entries does not."""
    return None if data is None else {name: json.dumps(value) for name, value in data.items()}


def _differences(before: Data, after: Data) -> dict[str, str | None]:
    """Return texts by path, two levels deep, that make the data `after` of the data `before`."""
    changed: Entries = {}
    for name, value in after.items():
        old = before.get(name)
        if name in before and _is_same(old, value):
            continue
        if isinstance(old, Mapping) and isinstance(value, Mapping) and set(old) <= set(value):
            others = {key: item for key, item in value.items() if key not in old or not _is_same(old[key], item)}
            changed |= {f"{name}.{key}": item for key, item in others.items()}
        else:
            changed[name] = value
    return {path: _as_text(value) for path, value in changed.items()}


def _is_same(first: object, second: object) -> bool:
    """Return whether two values are the same data with the same types and the same order of keys."""
    return json.dumps(first) == json.dumps(second)
