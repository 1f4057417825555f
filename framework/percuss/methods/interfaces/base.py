"""Base of all component families: facts of a class, units and bounds of options, data files."""

from __future__ import annotations

import re
import sys
from abc import ABC
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from percuss.jsonable import Data, Entries

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Array = NDArray[Any]  # of numbers or records of any kind

NAME_PATTERN = re.compile(r"[A-Za-z][\w-]*")


@dataclass(frozen=True)
class Unit:
    """Physical dimension of an option, in words: ``Unit("force/length")``; ``Unit("1")`` is a pure number."""

    unit: str

    def __get_pydantic_json_schema__(self, core_schema: object, handler: Callable[[object], Entries]) -> Entries:
        return {**handler(core_schema), "x-unit": self.unit}


@dataclass(frozen=True)
class AllowInf:
    """Mark of a numerical option that may be infinite; all others must be finite, and ``nan`` is always refused."""

    def __get_pydantic_core_schema__(self, source: object, handler: Callable[[object], Entries]) -> Entries:
        return {**handler(source), "allow_inf_nan": True}


@dataclass(frozen=True)
class Doc:
    """Description of an option in one line, shown in the schema and by ``percuss plugins NAME``."""

    text: str

    def __get_pydantic_json_schema__(self, core_schema: object, handler: Callable[[object], Entries]) -> Entries:
        return {**handler(core_schema), "description": self.text}


class OptionError(ValueError):
    """Refusal of the value of one option, which a component raises where it is made.

    Parameters
    ----------
    message
        Value expected and value found.
    path
        Key of the option, then the number of the wrong item if the option is a list.
    """

    def __init__(self, message: str, *path: str | int) -> None:
        super().__init__(message)
        self.path = path


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A file of a mesh that a case names by a path relative to its own; read once, when the case is checked.

    Two mesh files are equal if their paths, nodes and cells are equal.

    Attributes
    ----------
    path
        Path as written in the case.
    nodes : (nodes, 3) array
        Positions.
    cells
        Node numbers of the cells, (cells, nodes of a cell), by kind; kinds have the names and the order of `Mesh`.
    groups
        Rows of `cells` that belong to each physical group, by its name and the kind.
    """

    path: str
    nodes: Floats
    cells: Mapping[str, Integers]
    groups: Mapping[str, Mapping[str, Integers]]

    @classmethod
    def __get_pydantic_core_schema__(cls, source: object, handler: Any) -> Entries:
        return {
            "type": "function-after",
            "function": {"type": "with-info", "function": lambda path, info: info.context.mesh_file(path)},
            "schema": handler.generate_schema(str),
        }

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, MeshFile):
            return NotImplemented
        same = self.path == other.path and self.cells.keys() == other.cells.keys()
        pairs = [(self.nodes, other.nodes), *((self.cells[kind], other.cells[kind]) for kind in self.cells if same)]
        return same and all(np.array_equal(mine, its) for mine, its in pairs)

    def __hash__(self) -> int:
        return hash((self.path, self.nodes.shape))


@dataclass(frozen=True, eq=False)
class DataFile:
    """A CSV file of numbers that a case names by a path relative to its own; read once, when the case is checked.

    Two data files are equal if their paths, numbers and names of columns are equal.

    Attributes
    ----------
    path
        Path as written in the case.
    numbers : (columns, rows) array
        Numbers of the file, nan in columns of other things; a first line in which no field begins like a number is
        skipped.
    names
        Fields of that first line, which name the columns; empty if the file has none.
    lines
        Line of the file on which each row stands, from 1.
    faults
        What is wrong with the first field that is no number, with its place, by the index of its column; in the order
        of the file.
    """

    path: str
    numbers: Floats
    names: tuple[str, ...] = ()
    lines: tuple[int, ...] = ()
    faults: Mapping[int, str] = field(default_factory=dict)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: object, handler: Any) -> Entries:
        # The input has a path, and the context of the validation finds the file.
        return {
            "type": "function-after",
            "function": {"type": "with-info", "function": lambda path, info: info.context.data_file(path)},
            "schema": handler.generate_schema(str),
        }

    def __eq__(self, other: object) -> bool:
        # An array has no truth value, so the comparison that a dataclass generates would fail.
        if not isinstance(other, DataFile):
            return NotImplemented
        same = self.path == other.path and self.names == other.names
        return same and np.array_equal(self.numbers, other.numbers, equal_nan=True)

    def __hash__(self) -> int:
        return hash((self.path, self.numbers.shape))

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.numbers)

    @property
    def table(self) -> Floats:
        """The (columns, rows) numbers of the whole file.

        Raises
        ------
        ValueError
            If the file holds anything else; the message gives line and column.
        """
        for fault in self.faults.values():
            raise ValueError(fault)
        return self.numbers

    def as_columns(self, count: int) -> Floats:
        """Return the (count, rows) numbers.

        Raises
        ------
        ValueError
            If the file does not have `count` columns, or holds anything but numbers.
        """
        if self.width != count:
            raise ValueError(f"{self.path} has {self.width} columns, expected {count}")
        return self.table

    def column(self, which: str | int) -> Floats:
        """Return the (rows,) numbers of a column, given by its name in the first line or by its number from 1.

        Raises
        ------
        ValueError
            If the file has no such column, or several of that name, or if the column holds anything but numbers.
        """
        if isinstance(which, int):
            if not 1 <= which <= self.width:
                raise ValueError(f"{self.path} has no column {which}: it has {self.width}, numbered from 1")
            if fault := self.faults.get(which - 1):
                raise ValueError(fault)
            numbers: Floats = self.numbers[which - 1]
            return numbers
        if self.names.count(which) == 1:
            return self.column(self.names.index(which) + 1)
        if not self.names:
            raise ValueError(f"{self.path} has no column '{which}': no line above its numbers names each; give numbers")
        several = "several columns" if which in self.names else "no column"
        named = ", ".join(f"'{name}'" for name in self.names)
        raise ValueError(f"{self.path} has {several} '{which}': its first line names {named}")

    def place(self, row: int) -> str:
        """Return the file and the line of a row, numbered from 0, for messages: ``FILE:LINE``."""
        return f"{self.path}:{self.lines[row]}"


class Component(ABC):
    r"""Base class of all contracts; a class is either a contract or a finished method, never both.

    Attributes
    ----------
    name
        Name in a case; matches ``[A-Za-z][\w-]*``.
    summary
        Description in one line, for tables and help.
    references
        Sources, with DOI if there is one.
    examples
        Sensible sets of options; the conformance kit runs them.
    shorthand
        Option that a bare value in a case sets if it stands in place of a mapping; empty if there is none.
    expected_failures
        Reasons for the checks that the method is known to fail, by check: ``"energy-never-grows"``, or for a single
        partner ``"energy-never-grows with penalty"``. A declared failure that does not occur is an error.
    allocates
        Whether a kernel of it makes arrays, as by `np.zeros`. A kernel that does and does not say so is compiled twice
        in every process, which takes half a second.
    contract_version
        The `percuss.CONTRACT` for which the component was written; may be left out. An older percuss asks for an
        upgrade.
    """

    family: ClassVar[str]
    name: ClassVar[str]
    summary: ClassVar[str]
    references: ClassVar[tuple[str, ...]] = ()
    examples: ClassVar[tuple[Data, ...]] = ({},)
    shorthand: ClassVar[str] = ""
    expected_failures: ClassVar[Mapping[str, str]] = {}
    allocates: ClassVar[bool] = False
    contract_version: ClassVar[int | None] = None

    def __init_subclass__(cls, *, contract: str = "", **kwargs: object) -> None:
        super().__init_subclass__(**kwargs)
        if contract:
            cls.family = contract
            return
        finished = [base.__name__ for base in cls.__mro__[1:] if "name" in vars(base) and issubclass(base, Component)]
        if finished:
            msg = f"{cls.__name__} subclasses the finished method {finished[0]}: subclass its contract instead"
            raise TypeError(msg)
        for fact in ("name", "summary"):
            if not isinstance(vars(cls).get(fact), str):
                raise TypeError(f'{cls.__name__} does not say its `{fact}`: add `{fact} = "..."` to the class')
        inherited = {fact for base in cls.__mro__[1:] for fact in (*vars(base), *vars(base).get("__annotations__", {}))}
        for option, value in vars(cls).items():
            plain = isinstance(value, int | float | str | None) and option.islower() and not option.startswith("_")
            if plain and option not in inherited and option not in vars(cls).get("__annotations__", {}):
                raise TypeError(
                    f"{cls.__name__}.{option} has no annotation, so that no case can set it: write "
                    f"`{option}: {type(value).__name__} = {value!r}`, or {option.upper()} for a constant"
                )
        if sys.flags.optimize < 2 and not (vars(cls).get("__doc__") or "").strip():  # `python -OO` drops docstrings
            raise TypeError(f"{cls.__name__} has no docstring: give formula, source and stability limit")
