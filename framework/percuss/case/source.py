"""Case as plain data, together with the place of every key and value in the text."""

from __future__ import annotations

import contextlib
import functools
import numbers
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from percuss.case.hints import file_advice
from percuss.case.yaml_text import MAX_DEPTH, KeyPath, Mark, Mistake, NotPlainError, compose, dotted, flow
from percuss.errors import InputError, Problem, nearest, shortened, wrong_input
from percuss.files import found_instead, is_folder
from percuss.jsonable import Data

EXCERPT_WIDTH = 120
MAX_BYTES = 10_000_000  # of a file
LONGEST_LABEL = 200  # letters of the path and of the value of an override


def override_label(path: str, value: object) -> str:
    """Return the text by which messages name an override, as the user typed it unless it is very long."""
    text = value if isinstance(value, str) else flow(value)
    return f"--set {shortened(path, LONGEST_LABEL)}={shortened(text, LONGEST_LABEL)}"


SHORT_TEXT = 100  # letters of a value, up to which it is read once


@functools.lru_cache(maxsize=256)  # a study sets the same few names in each of its runs
def _value_of(text: str) -> Any:
    return Source.parse(text, "").data


def _plain(value: object, path: KeyPath, marks: dict[KeyPath, Mark]) -> Any:
    """Return a Python value as plain data; numbers and arrays of libraries, as numpy, become Python's."""
    if len(path) > MAX_DEPTH:
        raise wrong_input("case", f"nested more than {MAX_DEPTH} levels deep", path=dotted(path[:4]) + "...")
    # As there is no text, the order of the entries stands in for lines, so that problems are listed in that order.
    marks[path] = Mark(None, (len(marks) + 1, 1))
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, numbers.Number) and not isinstance(value, int | float | complex):  # Decimal, Fraction, ...
        with contextlib.suppress(ArithmeticError, TypeError, ValueError):
            value = int(value) if isinstance(value, numbers.Integral) else float(value)  # type: ignore[arg-type]
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise wrong_input("case", f"expected a word as key, found {key!r}", path=dotted(path))
        return {key: _plain(item, (*path, key), marks) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return tuple(_plain(item, (*path, i), marks) for i, item in enumerate(value))
    return value


def _put(data: Any, path: KeyPath, value: object) -> Any:
    """Return `data` with `value` at `path`; the entries beside it are shared with `data`, not copied."""
    if not path:
        return value
    head, rest = path[0], path[1:]
    if isinstance(data, tuple) and isinstance(head, int):
        return (*data[:head], _put(data[head], rest, value), *data[head + 1 :])
    return {**data, head: _put(data.get(head, {}), rest, value)}


@dataclass(frozen=True)
class Source:
    """Plain data of a case and the place of each part of it.

    Attributes
    ----------
    name
        File name as the user gave it, or ``case`` for a mapping.
    text
        The file's text; empty for a mapping.
    data
        Mappings, tuples and scalars.
    marks
        Place of the key and of the value of every path.
    aliases
        Paths written as an alias, with the path of their anchor.
    labels
        Paths that an override set, with the text that the user typed for it.
    folder
        Folder that paths inside the case are relative to.
    data_files
        Texts that stand in for data files, by the path written in the case; those of others are read from `folder`.
    """

    name: str
    text: str
    data: Any
    marks: Mapping[KeyPath, Mark] = field(default_factory=dict, repr=False)
    aliases: Mapping[KeyPath, KeyPath] = field(default_factory=dict, repr=False)
    labels: Mapping[KeyPath, str] = field(default_factory=dict, repr=False)
    folder: Path = field(default_factory=Path)
    data_files: Mapping[str, str] = field(default_factory=dict, repr=False)

    @staticmethod
    def read(path: str | Path) -> Source:
        """Return the contents of a YAML file as a source.

        Raises
        ------
        InputError
            If the file cannot be read or is not YAML.
        """
        name, file = str(path), Path(path)
        if other := found_instead(file):
            advice = "Name a file in it." if is_folder(file) else "Save its text in a file first."
            raise wrong_input(name, f"expected a YAML file, found {other}", advice)
        try:
            with file.open("rb") as stream:
                content = stream.read(MAX_BYTES + 1)
            if other_kind := file_advice(name, content):
                raise wrong_input(name, f"expected a YAML file, found {other_kind[0]}", other_kind[1])
            if file.suffix == ".py":
                raise wrong_input(name, "expected a YAML file, found a Python file", f"Name it as --plugin {name}.")
            text = content.decode("utf-8-sig") if len(content) <= MAX_BYTES else None
        except FileNotFoundError:
            beside = [entry.name for entry in file.parent.glob("*.y*ml")] if file.parent.is_dir() else []
            near = nearest(file.name, beside)
            advice = f"Did you mean '{file.parent / near}'?" if near else "Check the path."
            raise wrong_input(name, "no such file", advice) from None
        except UnicodeDecodeError as error:
            line = error.object.count(b"\n", 0, error.start) + 1
            raise wrong_input(f"{name}:{line}", "not UTF-8 text", "Save the file as UTF-8.") from None
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise wrong_input(name, f"cannot be read: {reason}") from None
        if text is None:
            message = f"expected at most {MAX_BYTES // 1_000_000} MB of text, found more"
            raise wrong_input(name, message, "Keep tables in a CSV file.")
        return Source.parse(text, name, file.parent)

    @staticmethod
    def parse(text: str, name: str, folder: Path = Path()) -> Source:
        """Return YAML text as a source.

        Raises
        ------
        InputError
            If the text is not YAML, holds a key twice or an unknown tag or alias, or is far too large.
        """
        try:
            data, marks, aliases = compose(text)
        except NotPlainError as error:
            bare = Source(name, text, None)
            raise InputError(map(bare._problem_of, error.mistakes)) from None
        return Source(name, text, data, marks, aliases, folder=folder)

    @staticmethod
    def of(mapping: Data, folder: Path = Path()) -> Source:
        """Return a mapping given in Python as a source; lists become tuples.

        Raises
        ------
        InputError
            If a key is not a string or the nesting has no end.
        """
        marks: dict[KeyPath, Mark] = {}
        return Source("case", "", _plain(mapping, (), marks), marks, folder=folder)

    def get(self, path: KeyPath, default: Any = None) -> Any:
        """Return the value at `path`, or `default` where there is none."""
        value = self.data
        for part in path:
            keys: Any = value if isinstance(value, Mapping) else range(len(value)) if isinstance(value, tuple) else ()
            if part not in keys:
                return default
            value = value[part]
        return value

    def replaced(self, path: KeyPath, value: object) -> Source:
        """Return the source with another value at `path`, which keeps the place of the old value."""
        return replace(self, data=_put(self.data, path, value))

    def override(self, path: str, value: object, *, shown_path: str = "") -> Source:
        """Return the source with `value` at the dotted `path`; text is read as YAML.

        Messages show `shown_path` in place of `path`, if it is given.

        Raises
        ------
        InputError
            If `value` is not YAML, or `path` runs through a value that has no parts.
        """
        value = _plain(value, (), {})
        label = override_label(shown_path or path, value)
        if isinstance(value, str):
            try:
                value = _value_of(value) if len(value) <= SHORT_TEXT else Source.parse(value, label).data
            except InputError as error:
                raise InputError(replace(problem, place=label, path=path) for problem in error.problems) from None
        full: KeyPath = ()
        created: KeyPath | None = None
        container = self.data
        for part in path.split("."):
            parent = dotted(full)
            if isinstance(container, tuple):
                if not (part.isdecimal() and int(part) < len(container)):
                    message = f"expected the number of an item, 0 to {len(container) - 1}, found '{part}'"
                    raise wrong_input(label, message, path=parent)
                full, container = (*full, int(part)), container[int(part)]
                continue
            if not isinstance(container, Mapping):
                message = f"is {flow(container)} and has no part '{part}'"
                raise wrong_input(label, message, "Set the whole value.", path=parent)
            full = (*full, part)
            if part not in container and created is None:
                created = full
            container = container.get(part, {})
        labels = {old: text for old, text in self.labels.items() if old[: len(full)] != full}
        data = _put(self.data, full, value)
        return replace(self, data=data, labels={**labels, created or full: label, full: label})

    def has_override(self, *sections: str) -> bool:
        """Return whether an override set something in one of the named sections."""
        return any(path[0] in sections for path in self.labels)

    # ------------------------------------------------------------------------------------------- places

    def _label(self, path: KeyPath) -> str | None:
        return next((self.labels[path[:n]] for n in range(len(path), -1, -1) if path[:n] in self.labels), None)

    def _position(self, path: KeyPath, key: bool) -> tuple[int, int] | None:
        """Return line and column of `path`, or of the nearest entry above it that stands in the text."""
        for n in range(len(path), -1, -1):
            if path[:n] in self.aliases and n < len(path):
                # The contents of an alias stand in the text at its anchor.
                return self._position((*self.aliases[path[:n]], *path[n:]), key)
            mark = self.marks.get(path[:n])
            if mark is not None:
                return mark.key if mark.key is not None and (key or n < len(path)) else mark.value
        return None

    def place(self, path: KeyPath) -> str:
        """Return the place of the value at `path`, ``file:line:column``.

        An entry that is not in the text, such as a missing key, has the place of the nearest entry above it; the place
        of a value that an override set is the override.
        """
        return self._label(path) or self._place_and_line(self._position(path, key=False))[0]

    def order(self, path: KeyPath, *, key: bool = False) -> tuple[int, int, int]:
        """Return the sort key of a problem at `path`: places in the file first, then the overrides in their order."""
        label = self._label(path)
        if label is not None:
            return (1, list(self.labels.values()).index(label), 0)
        return (0, *(self._position(path, key) or (0, 0)))

    @cached_property
    def _lines(self) -> list[str]:
        return self.text.splitlines()

    def _place_and_line(self, position: tuple[int, int] | None) -> tuple[str, str]:
        """Return the place of a position in the file, and the user's own line there with its number and a caret.

        Where there is no text, the place is the name of the source, and the line is empty.
        """
        if position is None or not self.text:
            return self.name, ""
        place = f"{self.name}:{position[0]}:{position[1]}"
        if position[0] > len(self._lines):
            return place, ""
        line, column = self._lines[position[0] - 1], position[1] - 1
        if len(line) > EXCERPT_WIDTH:  # cut first: a long line may hold very many mistakes
            start = max(0, column - EXCERPT_WIDTH // 2)
            line, column = line[start : start + EXCERPT_WIDTH], column - start
        line = "".join(letter if letter.isprintable() else "?" for letter in line.replace("\t", " "))
        number = f"{position[0]:5d} | "
        return place, f"{number}{line}\n{' ' * (len(number) - 2)}| {' ' * column}^"

    def _problem_of(self, mistake: Mistake) -> Problem:
        place, excerpt = self._place_and_line(mistake.position)
        return Problem(place, dotted(mistake.path), mistake.message, mistake.advice, excerpt)

    def _label_of_cause(self, path: KeyPath, message: str, any_inside: bool) -> str | None:
        """Return the text of the override that causes a problem at a path that no override set, or None.

        It set a key inside `path` that the message names, or any one there, or the component that lacks the entry.
        """
        if not path:
            return None
        name = (*path[:-1], "name")
        if name in self.labels and path != name and self.get(path) is None:
            return self.labels[name]
        words = set(re.findall(r"[\w-]+", message))
        inside = {at: label for at, label in self.labels.items() if at[: len(path)] == path}
        named = [label for at, label in inside.items() if str(at[-1]) in words]
        return next(reversed(named or list(inside.values()) * any_inside), None)

    def problem(
        self, path: KeyPath, message: str, advice: str = "", *, key: bool = False, any_inside: bool = False
    ) -> Problem:
        """Return the problem at `path` with its place and the user's own line.

        Where an override inside `path` sets a key that the message names, the place is the override; so it is, with
        `any_inside`, whichever key inside `path` an override sets.
        """
        label = self._label(path) or self._label_of_cause(path, message, any_inside)
        place, excerpt = (label, "") if label else self._place_and_line(self._position(path, key))
        return Problem(place, dotted(path), message, advice, excerpt)
