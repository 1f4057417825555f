"""YAML text read as plain data, with the place of every key and value.

Scalars follow the core schema of YAML 1.2: ``1e3`` is a number, ``on`` and ``no`` are words. Nothing in a text is ever
executed, and no text takes unbounded time or memory, however deeply it is nested or refers to itself.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import yaml

__all__ = ["MAX_DEPTH", "KeyPath", "Mark", "Mistake", "NotPlainError", "compose", "dotted", "flow"]

KeyPath = tuple[str | int, ...]

MAX_DEPTH = 40
MAX_NODES = 1_000_000

_PARSER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_CORE = "tag:yaml.org,2002:"
_NULL = re.compile(r"null|Null|NULL|~|")
_BOOL = re.compile(r"true|True|TRUE|false|False|FALSE")
_INT = re.compile(r"[-+]?[0-9]{1,4000}")
_BASED = re.compile(r"0o[0-7]{1,4000}|0x[0-9a-fA-F]{1,4000}")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_INF = re.compile(r"[-+]?(\.inf|\.Inf|\.INF)")
_NAN = re.compile(r"\.nan|\.NaN|\.NAN")


class Mark(NamedTuple):
    """Place of a key and its value, each as line and column counted from 1; `key` is None for items of a list."""

    key: tuple[int, int] | None
    value: tuple[int, int]


class Mistake(NamedTuple):
    """Mistake in a text: line and column counted from 1, path inside the data, message and advice."""

    position: tuple[int, int]
    path: KeyPath
    message: str
    advice: str = ""


class NotPlainError(ValueError):
    """Error for a text that is not YAML of plain values.

    Attributes
    ----------
    mistakes
        All mistakes found in the text; a syntax mistake is the only one, as reading ends there.
    """

    def __init__(self, mistakes: list[Mistake]) -> None:
        super().__init__(mistakes[0].message)
        self.mistakes = mistakes


def _fatal_error(position: tuple[int, int], message: str, advice: str = "") -> NotPlainError:
    """Return the error for a mistake after which the rest of the text has no meaning."""
    return NotPlainError([Mistake(position, (), message, advice)])


def dotted(path: KeyPath) -> str:
    """Return a path as written on the command line, for example ``bodies.short.bar.length``."""
    return ".".join(str(part) for part in path)


def _quoted_if_needed(value: str) -> str:
    """Return a text as YAML writes it, in quotes unless it is read as the same text without them."""
    plain = (
        value and value == value.strip() and isinstance(_scalar(value), str) and not re.search(r"[\[\]{},:#'\"]", value)
    )
    return value if plain else "'" + value.replace("'", "''") + "'"


def flow(value: Any) -> str:  # noqa: PLR0911
    """Return a plain value as YAML writes it on one line."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if value != value else (".inf" if value > 0 else "-.inf")  # noqa: PLR0124
    if isinstance(value, str):
        return _quoted_if_needed(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_quoted_if_needed(str(key))}: {flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, tuple | list):
        return "[" + ", ".join(flow(item) for item in value) + "]"
    return str(value)


def _scalar(text: str) -> Any:  # noqa: PLR0911
    """Return the value of a plain scalar by the core schema of YAML 1.2."""
    if _INT.fullmatch(text):
        return int(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    if _BOOL.fullmatch(text):
        return text.lower() == "true"
    if _NULL.fullmatch(text):
        return None
    if _BASED.fullmatch(text):
        return int(text, 0)
    if _INF.fullmatch(text):
        return float(text.replace(".", ""))
    return float("nan") if _NAN.fullmatch(text) else text


def _tagged(text: str, tag: str) -> Any:
    """Return the value of a scalar with an explicit type, as in ``!!float 1``; raise ValueError if it has another."""
    if tag == "str":
        return text
    value = _scalar(text)
    if tag == "float" and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if {"int": int, "float": float, "bool": bool, "null": type(None)}[tag] is not type(value):
        raise ValueError(f"expected !!{tag}, found {text!r}")
    return value


class _Composer:
    """Composer of the parser's events into plain data and marks.

    PyYAML's own composer is not used, because in C it recurses without a limit, and it keeps the last of two equal keys
    without an error.
    """

    def __init__(self, text: str) -> None:
        self.events: Iterator[Any] = yaml.parse(text, Loader=_PARSER)
        self.marks: dict[KeyPath, Mark] = {}
        self.aliases: dict[KeyPath, KeyPath] = {}
        self.anchors: dict[str, tuple[Any, int, int, KeyPath]] = {}
        self.mistakes: list[Mistake] = []

    def document(self) -> Any:
        """Return the data of the only document of the text, or None where there is no document."""
        next(self.events)
        event = next(self.events)
        if isinstance(event, yaml.StreamEndEvent):
            return None
        data, _, _ = self.node(next(self.events), (), None, 0)
        next(self.events)
        event = next(self.events)
        if not isinstance(event, yaml.StreamEndEvent):
            raise _fatal_error(
                self.position(event), "expected one document, found a second one", "Keep one case a file."
            )
        return data

    @staticmethod
    def position(event: Any) -> tuple[int, int]:
        return event.start_mark.line + 1, event.start_mark.column + 1

    def node(self, event: Any, path: KeyPath, key: tuple[int, int] | None, depth: int) -> tuple[Any, int, int]:
        """Return the data, the number of nodes and the height of the node that starts with `event`."""
        position = self.position(event)
        self.marks[path] = Mark(key, position)
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in self.anchors:
                raise _fatal_error(
                    position,
                    f"unknown alias *{event.anchor}",
                    f"An alias needs an anchor &{event.anchor} before it.",
                )
            data, count, height, self.aliases[path] = self.anchors[event.anchor]
        elif isinstance(event, yaml.ScalarEvent):
            data, count, height = self.scalar(event, path), 1, 0
        else:
            if event.tag not in (None, "!", _CORE + "map", _CORE + "seq"):
                self.report_unknown_tag(event.tag, position, path)
            if depth >= MAX_DEPTH:
                raise _fatal_error(position, f"nested more than {MAX_DEPTH} levels deep", "A case needs far fewer.")
            compose_items = self.mapping if isinstance(event, yaml.MappingStartEvent) else self.sequence
            data, count, height = compose_items(path, depth)
        if depth + height > MAX_DEPTH:
            raise _fatal_error(position, f"nested more than {MAX_DEPTH} levels deep", "A case needs far fewer.")
        if getattr(event, "anchor", None) and not isinstance(event, yaml.AliasEvent):
            self.anchors[event.anchor] = (data, count, height, path)
        return data, count, height

    def checked_count(self, count: int, event: Any) -> int:
        if count > MAX_NODES:
            raise _fatal_error(
                self.position(event), f"more than {MAX_NODES} values, aliases written out", "Keep tables in a file."
            )
        return count

    def sequence(self, path: KeyPath, depth: int) -> tuple[Any, int, int]:
        items: list[Any] = []
        count, height = 1, 0
        while not isinstance(event := next(self.events), yaml.SequenceEndEvent):
            data, inside, below = self.node(event, (*path, len(items)), None, depth + 1)
            items.append(data)
            count, height = self.checked_count(count + inside, event), max(height, below)
        return tuple(items), count, height + 1

    def mapping(self, path: KeyPath, depth: int) -> tuple[Any, int, int]:
        items: dict[str, Any] = {}
        count, height = 1, 0
        while not isinstance(event := next(self.events), yaml.MappingEndEvent):
            key, position = self.key(event, path), self.position(event)
            first = self.marks.get((*path, key)) if key in items else None
            data, inside, below = self.node(next(self.events), (*path, key), position, depth + 1)
            count, height = self.checked_count(count + inside + 1, event), max(height, below)
            if first is not None and first.key is not None:
                self.mistakes.append(
                    Mistake(
                        position,
                        (*path, key),
                        f"the key '{key}' stands twice: here and in line {first.key[0]}",
                        "Keep one of them.",
                    )
                )
            items[key] = data
        return items, count, height + 1

    def key(self, event: Any, path: KeyPath) -> str:
        position = self.position(event)
        if not isinstance(event, yaml.ScalarEvent):
            raise _fatal_error(
                position, "expected a word as key, found a list, a mapping or an alias", "Write `key: value`."
            )
        value = self.scalar(event, path)
        if isinstance(value, str) and value == "<<" and event.implicit[0]:
            self.mistakes.append(
                Mistake(position, (*path, "<<"), "merge keys (<<) are not part of YAML 1.2", "Write the keys out.")
            )
        if isinstance(value, str):
            return value
        self.mistakes.append(
            Mistake(position, path, f"expected a word as key, found {flow(value)}", f"Quote it: '{event.value}'.")
        )
        return str(event.value)

    def scalar(self, event: Any, path: KeyPath) -> Any:
        if event.tag in (None, "!"):
            return _scalar(event.value) if event.implicit[0] and event.tag is None else event.value
        tag = event.tag.removeprefix(_CORE)
        if event.tag == tag or tag not in {"str", "int", "float", "bool", "null"}:
            self.report_unknown_tag(event.tag, self.position(event), path)
            return event.value
        try:
            return _tagged(event.value, tag)
        except ValueError as error:
            self.mistakes.append(Mistake(self.position(event), path, str(error), "Leave the tag out."))
            return event.value

    def report_unknown_tag(self, tag: str, position: tuple[int, int], path: KeyPath) -> None:
        shown = "!!" + tag.removeprefix(_CORE) if tag.startswith(_CORE) else tag
        self.mistakes.append(
            Mistake(position, path, f"unknown tag {shown}", "A case holds plain values only: leave the tag out.")
        )


def _syntax(error: yaml.YAMLError, text: str) -> Mistake:
    """Return the error of the parser as a mistake with its place, and with advice for common causes."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        position = error.problem_mark.line + 1, error.problem_mark.column + 1
        message = str(error.problem)
        if error.context and error.context_mark is not None:
            start = error.context_mark.line + 1, error.context_mark.column + 1
            origin = "" if start == position else f" that starts in line {start[0]}, column {start[1]}"
            message = f"{message} {error.context}{origin}"
        lines = text.splitlines()
        line = lines[position[0] - 1] if position[0] <= len(lines) else ""
        if "\t" in line[: position[1]]:
            return Mistake(position, (), f"not YAML: {message}", "Indent with spaces: YAML takes no tabs there.")
        if error.context_mark is not None and "flow" in str(error.context):
            advice = f"Close the bracket of line {error.context_mark.line + 1}, or put a comma between the values."
            return Mistake(position, (), f"not YAML: {message}", advice)
        return Mistake(position, (), f"not YAML: {message}", "Values with ': ', '#', '[' or '{' in them need quotes.")
    offset = getattr(error, "position", 0)
    before = text[:offset]
    position = before.count("\n") + 1, offset - (before.rfind("\n") + 1) + 1
    return Mistake(position, (), f"not YAML: {getattr(error, 'reason', error)}", "Remove the character.")


def compose(text: str) -> tuple[Any, dict[KeyPath, Mark], dict[KeyPath, KeyPath]]:
    """Return the data of a YAML text, the marks of its paths, and for each alias path the path of its anchor.

    Raises
    ------
    NotPlainError
        With all mistakes found.
    """
    composer = _Composer(text)
    try:
        data = composer.document()
    except yaml.YAMLError as error:
        raise NotPlainError([_syntax(error, text)]) from None
    if composer.mistakes:
        raise NotPlainError(sorted(composer.mistakes, key=lambda mistake: mistake.position))
    return data, composer.marks, composer.aliases
