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

from percuss.case.hints import comma_advice
from percuss.jsonable import Entries
from percuss.methods.interfaces import NAME_PATTERN

KeyPath = tuple[str | int, ...]

MAX_DEPTH = 40
MOST_BITS = 14_000  # of a whole number that Python writes out
MAX_NODES = 200_000  # each takes some microseconds and a kilobyte of memory while it is read

_CORE = "tag:yaml.org,2002:"
_NULL, _BOOL, _INT, _FLOAT, _STR = (_CORE + name for name in ("null", "bool", "int", "float", "str"))
_COLLECTIONS = (None, _CORE + "map", _CORE + "seq")
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

# The types of plain scalars by the core schema, in the order in which they are tried. All else is a text.
_PATTERNS = {
    _NULL: re.compile(r"(null|Null|NULL|~|)\Z"),
    _BOOL: re.compile(r"(true|True|TRUE|false|False|FALSE)\Z"),
    _INT: re.compile(r"([-+]?[0-9]{1,4000}|0o[0-7]{1,4000}|0x[0-9a-fA-F]{1,4000})\Z"),
    _FLOAT: re.compile(
        r"([-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?(\.inf|\.Inf|\.INF)|\.nan|\.NaN|\.NAN)\Z"
    ),
}


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
        value
        and value == value.strip()
        and not any(pattern.match(value) for pattern in _PATTERNS.values())
        and not re.search(r"[\[\]{},:#'\"]", value)
    )
    return value if plain else "'" + value.replace("'", "''") + "'"


def flow(value: object) -> str:  # noqa: PLR0911
    """Return a plain value as YAML writes it on one line."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int) and value.bit_length() > MOST_BITS:
        return f"a whole number of about {value.bit_length() * math.log10(2.0):.0f} digits"
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if value != value else (".inf" if value > 0 else "-.inf")  # noqa: PLR0124
    if isinstance(value, str):
        return _quoted_if_needed(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_quoted_if_needed(str(key))}: {flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, tuple | list):
        return "[" + ", ".join(flow(item) for item in value) + "]"
    return str(value)


def _scalar(text: str, tag: str) -> Any:
    """Return the value of a scalar of the type `tag`; raise ValueError if the text has another type."""
    if tag == _STR:
        return text
    whole = tag in (_INT, _FLOAT) and _PATTERNS[_INT].match(text)
    if not whole and not _PATTERNS[tag].match(text):
        raise ValueError(f"expected !!{tag.removeprefix(_CORE)}, found {text!r}")
    if whole:
        number = int(text, 0 if text[:2] in ("0o", "0x") else 10)
        return float(number) if tag == _FLOAT else number
    if tag == _FLOAT:
        return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    return None if tag == _NULL else text.lower() == "true"


def _position(event: Any) -> tuple[int, int]:
    """Return line and column, counted from 1, of the start of an event."""
    return event.start_mark.line + 1, event.start_mark.column + 1


def _levels(data: Any) -> int:
    """Return the number of levels of nesting of plain data, 0 of a scalar."""
    items = data.values() if isinstance(data, dict) else data
    return 1 + max(map(_levels, items), default=0) if isinstance(data, dict | tuple) else 0


class _Document:
    """Plain data of a text, read event by event, with the marks, the aliases and the mistakes of its nodes.

    PyYAML's own composer nests its calls as deeply as the text, and data with aliases written out can be far larger
    than the text. Here values and levels are counted before anything is made of them.

    Raises
    ------
    NotPlainError
        If the text is nested too deeply or too large, refers to an unknown anchor, has more than one document, marks a
        value with the tag ``!`` alone, or has a key that is no word.
    """

    def __init__(self, text: str) -> None:
        self.events: Iterator[Any] = yaml.parse(text, Loader=_LOADER)
        self.marks: dict[KeyPath, Mark] = {}
        self.aliases: dict[KeyPath, KeyPath] = {}
        self.mistakes: list[Mistake] = []
        self.values = 0  # so far, aliases written out
        self.lines: dict[str, int] = {}  # of the anchors
        # Path, data and values of each node with an anchor, from the end of the node on: none contains itself.
        self.anchored: dict[str, tuple[KeyPath, object, int]] = {}
        # The first key that is no word: often a misplaced bracket, which makes the text wrong farther on.
        self.no_word: NotPlainError | None = None
        self.data: object = None
        for event in self.events:
            if isinstance(event, yaml.DocumentStartEvent):
                if self.marks:
                    message = "expected one document, found a second one"
                    raise _fatal_error(_position(event), message, "Put each case in a file of its own.")
                self.data = self.read(next(self.events), ())
        if self.no_word is not None:
            raise self.no_word

    def read(self, event: Any, path: KeyPath, key: tuple[int, int] | None = None) -> Any:
        """Return the data of the node at `path` that begins with `event`, and whose key stands at `key`."""
        self.marks[path] = Mark(key, _position(event))
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in self.anchored:
                advice = f"An alias needs an anchor &{event.anchor} before it."
                raise _fatal_error(_position(event), f"unknown alias *{event.anchor}", advice)
            self.aliases[path], data, values = self.anchored[event.anchor]
            self.count(event, values, len(path) + _levels(data))
            return data
        self.check_properties(event)
        before = self.values
        self.count(event, 1, len(path) + isinstance(event, yaml.CollectionStartEvent))
        if isinstance(event, yaml.ScalarEvent):
            data = self.scalar(event, path)
        else:
            if event.tag not in _COLLECTIONS:
                self.report_unknown_tag(event, path)
            data = self.mapping(path) if isinstance(event, yaml.MappingStartEvent) else self.sequence(path)
        if event.anchor is not None:
            self.anchored[event.anchor] = path, data, self.values - before
        return data

    def check_properties(self, event: Any) -> None:
        """Refuse an anchor that another node has, and a tag without a name."""
        if event.anchor in self.lines:
            message = f"the anchor &{event.anchor} occurs twice: here and in line {self.lines[event.anchor]}"
            raise _fatal_error(_position(event), message, "Give one of them another name.")
        if event.anchor is not None:
            self.lines[event.anchor] = event.start_mark.line + 1
        if event.tag == "!":
            # YAML reads what follows as a text, PyYAML by its look: neither is what the other expects.
            raise _fatal_error(_position(event), "unknown tag !", "A case holds plain values only: leave the tag out.")

    def count(self, event: yaml.Event, values: int, levels: int) -> None:
        """Count the values that an event brings; refuse a text that becomes too large by them, or too deep."""
        self.values += values
        if levels > MAX_DEPTH:
            raise _fatal_error(_position(event), f"nested more than {MAX_DEPTH} levels deep", "A case needs far fewer.")
        if self.values > MAX_NODES:
            message = f"more than {MAX_NODES} values, aliases included"
            raise _fatal_error(_position(event), message, "Keep tables in a file.")

    def sequence(self, path: KeyPath) -> tuple[Any, ...]:
        items: list[Any] = []
        while not isinstance(event := next(self.events), yaml.SequenceEndEvent):
            items.append(self.read(event, (*path, len(items))))
        return tuple(items)

    def mapping(self, path: KeyPath) -> Entries:
        data: Entries = {}
        lines: dict[str, int] = {}
        while not isinstance(event := next(self.events), yaml.MappingEndEvent):
            position, key = _position(event), self.key(event, path)
            if key in data:
                message = f"the key '{key}' occurs twice: here and in line {lines[key]}"
                self.mistakes.append(Mistake(position, (*path, key), message, "Keep one of them."))
            before = next(reversed(data.values()), None)
            lines[key] = position[0]
            data[key] = self.read(next(self.events), (*path, key), position)
            wrong = self.mistakes[-1] if self.mistakes else None
            split = key.isdigit() and data[key] is None and isinstance(before, int)
            if split and wrong is not None and wrong.position == position:
                self.mistakes[-1] = wrong._replace(advice=comma_advice(f"{before},{key}"))
        return data

    def key(self, event: Any, path: KeyPath) -> str:
        """Return the word of a key of the mapping at `path`."""
        position = _position(event)
        if not isinstance(event, yaml.ScalarEvent) and self.no_word is None:
            message = "expected a word as key, found a list, a mapping or an alias"
            self.no_word = _fatal_error(position, message, "Write `key: value`.")
        text = str(getattr(event, "value", ""))
        known = len(self.mistakes)
        value = self.read(event, (*path, text))
        self.mistakes[known:] = [mistake._replace(path=path) for mistake in self.mistakes[known:]]
        if not isinstance(value, str):
            is_name = NAME_PATTERN.fullmatch(text)
            advice = f"Quote it: '{text}'." if is_name else "A name is a letter, then letters, digits, _ or -."
            self.mistakes.append(Mistake(position, path, f"expected a word as key, found {flow(value)}", advice))
        elif value == "<<" and not event.style:
            message = "merge keys (<<) are not part of YAML 1.2"
            self.mistakes.append(Mistake(position, (*path, "<<"), message, "Write the keys out."))
        return text

    def scalar(self, event: Any, path: KeyPath) -> Any:
        """Return the value of a scalar, or its text if it has not the type of its tag."""
        fitting = (tag for tag, pattern in _PATTERNS.items() if event.implicit[0] and pattern.match(event.value))
        tag = event.tag or next(fitting, _STR)
        try:
            if tag in (*_PATTERNS, _STR):
                return _scalar(event.value, tag)
            self.report_unknown_tag(event, path)
        except ValueError as error:
            self.mistakes.append(Mistake(_position(event), path, str(error), "Leave the tag out."))
        return event.value

    def report_unknown_tag(self, event: Any, path: KeyPath) -> None:
        shown = "!!" + event.tag.removeprefix(_CORE) if event.tag.startswith(_CORE) else event.tag
        advice = "A case holds plain values only: leave the tag out."
        self.mistakes.append(Mistake(_position(event), path, f"unknown tag {shown}", advice))


def _syntax(error: yaml.YAMLError, text: str) -> Mistake:
    """Return the error of the parser as a mistake with its place, and with advice for common causes."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        position = error.problem_mark.line + 1, error.problem_mark.column + 1
        message = str(error.problem)
        if error.context and error.context_mark is not None:
            start = error.context_mark.line + 1, error.context_mark.column + 1
            origin = "" if start == position else f" that starts in line {start[0]}, column {start[1]}"
            message = f"{message} {error.context}{origin}"
        before = "".join(text.splitlines()[position[0] - 1 : position[0]])[: position[1]]
        advice = "Values with ': ', '#', '[' or '{' in them need quotes."
        if "\t" in before:
            advice = "Indent with spaces: YAML takes no tabs there."
        elif error.context_mark is not None and "flow" in str(error.context):
            advice = f"Close the bracket of line {error.context_mark.line + 1}, or put a comma between the values."
    else:
        offset = getattr(error, "position", 0)
        before = text[:offset]
        position = before.count("\n") + 1, offset - (before.rfind("\n") + 1) + 1
        message, advice = getattr(error, "reason", str(error)), "Remove the character."
    return Mistake(position, (), f"not YAML: {message}", advice)


def compose(text: str) -> tuple[object, dict[KeyPath, Mark], dict[KeyPath, KeyPath]]:
    """Return the data of a YAML text, the marks of its paths, and for each alias path the path of its anchor.

    Raises
    ------
    NotPlainError
        With all mistakes found.
    """
    try:
        document = _Document(text)
    except yaml.YAMLError as error:
        raise NotPlainError([_syntax(error, text)]) from None
    if document.mistakes:
        raise NotPlainError(sorted(document.mistakes, key=lambda mistake: mistake.position))
    return document.data, document.marks, document.aliases
