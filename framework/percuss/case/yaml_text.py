"""YAML text read as plain data, with the place of every key and value.

Scalars follow the core schema of YAML 1.2: ``1e3`` is a number, ``on`` and ``no`` are words. Nothing in a text is ever
executed, and no text takes unbounded time or memory, however deeply it is nested or refers to itself.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, NamedTuple

import yaml

from percuss.jsonable import Entries
from percuss.methods.interfaces import NAME_PATTERN

KeyPath = tuple[str | int, ...]

MAX_DEPTH = 40
MOST_BITS = 14_000  # of a whole number that Python writes out
MAX_NODES = 200_000  # each takes some microseconds and a kilobyte of memory while it is read

_CORE = "tag:yaml.org,2002:"
_NULL, _BOOL, _INT, _FLOAT, _STR = (_CORE + name for name in ("null", "bool", "int", "float", "str"))
_COLLECTIONS = (_CORE + "map", _CORE + "seq")


# The types of plain scalars by the core schema: the pattern of each and its first letters. All else is a text.
_PATTERNS = {
    _NULL: (re.compile(r"(null|Null|NULL|~|)\Z"), ["n", "N", "~", ""]),
    _BOOL: (re.compile(r"(true|True|TRUE|false|False|FALSE)\Z"), list("tTfF")),
    _INT: (re.compile(r"([-+]?[0-9]{1,4000}|0o[0-7]{1,4000}|0x[0-9a-fA-F]{1,4000})\Z"), list("-+0123456789")),
    _FLOAT: (
        re.compile(
            r"([-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?(\.inf|\.Inf|\.INF)|\.nan|\.NaN|\.NAN)\Z"
        ),
        list("-+.0123456789"),
    ),
}


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """PyYAML's loader with the types of YAML 1.2 in place of those of YAML 1.1."""

    yaml_implicit_resolvers: ClassVar[dict[str, list[tuple[str, re.Pattern[str]]]]] = {}


for _tag, (_pattern, _letters) in _PATTERNS.items():
    _Loader.add_implicit_resolver(_tag, _pattern, _letters)


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
        and not any(pattern.match(value) for pattern, _ in _PATTERNS.values())
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
    whole = tag in (_INT, _FLOAT) and _PATTERNS[_INT][0].match(text)
    if not whole and not _PATTERNS[tag][0].match(text):
        raise ValueError(f"expected !!{tag.removeprefix(_CORE)}, found {text!r}")
    if whole:
        number = int(text, 0 if text[:2] in ("0o", "0x") else 10)
        return float(number) if tag == _FLOAT else number
    if tag == _FLOAT:
        return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    return None if tag == _NULL else text.lower() == "true"


def _position(node: Any) -> tuple[int, int]:
    """Return line and column, counted from 1, of the start of an event or a node."""
    return node.start_mark.line + 1, node.start_mark.column + 1


def _checked_aliases(text: str) -> list[tuple[int, int]]:
    """Return the places of all aliases of a text that is safe to compose.

    The composer of PyYAML nests its calls as deeply as the text, and data with aliases written out can be far larger
    than the text. Therefore the parser's events are counted before anything is composed.

    Raises
    ------
    NotPlainError
        If the text is nested too deeply or too large, refers to an unknown anchor, has more than one document, or marks
        a value with the tag ``!`` alone.
    """
    positions: list[tuple[int, int]] = []
    lines: dict[str, int] = {}
    # Number of values and levels of nesting of a node by its anchor, from the end of the node on: none contains itself.
    sizes: dict[str | None, tuple[int, int]] = {}
    # Of each open node its anchor, and the numbers of values and levels before it.
    open_nodes: list[tuple[str | None, int, int]] = []
    values = levels = documents = 0
    events: Iterator[Any] = yaml.parse(text, Loader=_Loader)
    for event in events:
        anchor = getattr(event, "anchor", None)
        if isinstance(event, yaml.AliasEvent):
            if anchor not in sizes:
                advice = f"An alias needs an anchor &{anchor} before it."
                raise _fatal_error(_position(event), f"unknown alias *{anchor}", advice)
            positions.append(_position(event))
            values, levels = values + sizes[anchor][0], max(levels, len(open_nodes) + sizes[anchor][1])
        elif anchor in lines:
            message = f"the anchor &{anchor} occurs twice: here and in line {lines[anchor]}"
            raise _fatal_error(_position(event), message, "Give one of them another name.")
        elif anchor is not None:
            lines[anchor] = event.start_mark.line + 1
        if getattr(event, "tag", None) == "!":
            # YAML reads what follows as a text, PyYAML by its look: neither is what the other expects.
            raise _fatal_error(_position(event), "unknown tag !", "A case holds plain values only: leave the tag out.")
        if isinstance(event, yaml.ScalarEvent):
            values += 1
            sizes[anchor] = (1, 0)
        elif isinstance(event, yaml.CollectionStartEvent):
            open_nodes.append((anchor, values, levels))
            values, levels = values + 1, len(open_nodes)
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, values_before, levels_before = open_nodes.pop()
            sizes[anchor] = values - values_before, levels - len(open_nodes)
            levels = max(levels, levels_before)
        elif isinstance(event, yaml.DocumentStartEvent):
            documents += 1
        _check_limits(event, values, levels, documents)
    return positions


def _check_limits(event: object, values: int, levels: int, documents: int) -> None:
    """Raise NotPlainError where the text up to an event is too deep, too large or not one document."""
    if levels > MAX_DEPTH:
        raise _fatal_error(_position(event), f"nested more than {MAX_DEPTH} levels deep", "A case needs far fewer.")
    if values > MAX_NODES:
        message = f"more than {MAX_NODES} values, aliases included"
        raise _fatal_error(_position(event), message, "Keep tables in a file.")
    if documents > 1:
        message = "expected one document, found a second one"
        raise _fatal_error(_position(event), message, "Put each case in a file of its own.")


class _Document:
    """Plain data of a composed document, with the marks, the aliases and the mistakes of its nodes.

    Parameters
    ----------
    alias_positions
        Places of all aliases in the order of the text; in the composed document an alias is the node of its anchor.
    """

    def __init__(self, alias_positions: list[tuple[int, int]]) -> None:
        self.marks: dict[KeyPath, Mark] = {}
        self.aliases: dict[KeyPath, KeyPath] = {}
        self.mistakes: list[Mistake] = []
        self.alias_positions = iter(alias_positions)
        # Path and data of each node that was read, by its identity: a node met again is an alias.
        self.nodes: dict[int, tuple[KeyPath, object]] = {}

    def read(self, node: yaml.Node, path: KeyPath = (), key: tuple[int, int] | None = None) -> Any:
        """Return the data of the node at `path`, whose key stands at `key`."""
        self.marks[path] = Mark(key, self.place(node))
        if id(node) in self.nodes:
            self.aliases[path], data = self.nodes[id(node)]
            return data
        if isinstance(node, yaml.ScalarNode):
            data = self.scalar(node, path)
        else:
            if node.tag not in _COLLECTIONS:
                self.report_unknown_tag(node, path)
            if isinstance(node, yaml.MappingNode):
                data = self.mapping(node, path)
            else:
                data = tuple(self.read(item, (*path, i)) for i, item in enumerate(node.value))
        self.nodes[id(node)] = path, data
        return data

    def place(self, node: yaml.Node) -> tuple[int, int]:
        """Return the place of the node, or of the alias in its stead."""
        return next(self.alias_positions) if id(node) in self.nodes else _position(node)

    def mapping(self, node: yaml.MappingNode, path: KeyPath) -> Entries:
        data: Entries = {}
        lines: dict[str, int] = {}
        for key_node, value_node in node.value:
            position = self.place(key_node)
            key = self.key(key_node, path, position)
            if key in data:
                message = f"the key '{key}' occurs twice: here and in line {lines[key]}"
                self.mistakes.append(Mistake(position, (*path, key), message, "Keep one of them."))
            before = next(reversed(data.values()), None)
            lines[key] = position[0]
            data[key] = self.read(value_node, (*path, key), position)
            wrong = self.mistakes[-1] if self.mistakes else None
            split = key.isdigit() and data[key] is None and isinstance(before, int)
            if split and wrong is not None and wrong.position == position:
                self.mistakes[-1] = wrong._replace(advice=f"Write {before}.{key}: the decimal mark is a point.")
        return data

    def key(self, node: yaml.Node, path: KeyPath, position: tuple[int, int]) -> str:
        """Return the word of a key of the mapping at `path`."""
        if not isinstance(node, yaml.ScalarNode) or id(node) in self.nodes:
            message = "expected a word as key, found a list, a mapping or an alias"
            raise _fatal_error(position, message, "Write `key: value`.")
        value = self.scalar(node, path)
        self.nodes[id(node)] = (*path, node.value), value
        if not isinstance(value, str):
            message = f"expected a word as key, found {flow(value)}"
            quoted = f"Quote it: '{node.value}'."
            advice = (
                quoted if NAME_PATTERN.fullmatch(node.value) else "A name is a letter, then letters, digits, _ or -."
            )
            self.mistakes.append(Mistake(position, path, message, advice))
        elif value == "<<" and not node.style:
            message = "merge keys (<<) are not part of YAML 1.2"
            self.mistakes.append(Mistake(position, (*path, "<<"), message, "Write the keys out."))
        return str(node.value)

    def scalar(self, node: yaml.ScalarNode, path: KeyPath) -> Any:
        """Return the value of a scalar, or its text if it has not the type of its tag."""
        try:
            if node.tag in (_NULL, _BOOL, _INT, _FLOAT, _STR):
                return _scalar(node.value, node.tag)
            self.report_unknown_tag(node, path)
        except ValueError as error:
            self.mistakes.append(Mistake(_position(node), path, str(error), "Leave the tag out."))
        return node.value

    def report_unknown_tag(self, node: yaml.Node, path: KeyPath) -> None:
        shown = "!!" + node.tag.removeprefix(_CORE) if node.tag.startswith(_CORE) else node.tag
        advice = "A case holds plain values only: leave the tag out."
        self.mistakes.append(Mistake(_position(node), path, f"unknown tag {shown}", advice))


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


def compose(text: str) -> tuple[object, dict[KeyPath, Mark], dict[KeyPath, KeyPath]]:
    """Return the data of a YAML text, the marks of its paths, and for each alias path the path of its anchor.

    Raises
    ------
    NotPlainError
        With all mistakes found.
    """
    try:
        document = _Document(_checked_aliases(text))
        node = yaml.compose(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise NotPlainError([_syntax(error, text)]) from None
    data = None if node is None else document.read(node)
    if document.mistakes:
        raise NotPlainError(sorted(document.mistakes, key=lambda mistake: mistake.position))
    return data, document.marks, document.aliases
