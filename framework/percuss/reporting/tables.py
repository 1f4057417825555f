"""What commands print: lines and tables, on a terminal or in a pipe; no number is ever cut.

On a terminal names are folded into lines. Where the numbers have no room beside them the last columns are left out, and
named below the table. In a pipe nothing is left out or folded: each row is a line.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from percuss.errors import printable

if TYPE_CHECKING:  # rich is imported only where something is printed
    from rich.console import Console

GAP = 3  # characters between two columns: two of padding and the line
NAME, HEAD = 16, 12  # characters above which a name, or a word in the head of a column of numbers, may be folded


@dataclass(frozen=True)
class Column:
    """A column of numbers, which are never folded, or of words.

    Attributes
    ----------
    head
        Head of the column.
    cells
        Its cells as text, one for each row.
    is_number
        Whether its cells are numbers.
    """

    head: str
    cells: Sequence[str]
    is_number: bool = True

    @property
    def least_width(self) -> int:
        """Width below which a number would be folded, or a name into too many lines."""
        if self.is_number:
            return max(*map(len, self.cells), *(min(len(word), HEAD) for word in self.head.split()), 1)
        return min(max(map(len, self.cells), default=1), NAME)


def words(head: str, cells: Iterable[object]) -> Column:
    """Return a column of words."""
    return Column(head, list(map(str, cells)), is_number=False)


@dataclass(frozen=True)
class Table:
    """A table of columns; its last numbers are those that a narrow terminal leaves out first."""

    columns: Sequence[Column]
    title: str = ""


class Unbroken(str):
    """A line that is never broken, such as a path or a command, which a reader copies."""

    __slots__ = ()


# A line may consist of parts, of which some have a style, as ("FAILED", "red").
Piece: TypeAlias = str | Sequence[str | tuple[str, str]] | Table


def console() -> Console:
    """Return the console on standard output: of the width of the terminal, or as wide as its content in a pipe."""
    from rich.console import Console

    made = Console(highlight=False)
    return made if made.is_terminal else Console(highlight=False, width=100_000)


def show(pieces: Iterable[Piece], out: Console | None = None) -> None:
    """Print lines and tables, in which texts of files and plug-ins cannot steer a terminal."""
    for piece in pieces:
        if isinstance(piece, Unbroken):
            print(printable(piece), file=out.file if out else None)
            continue
        from rich.text import Text

        out = out or console()
        if isinstance(piece, Table):
            _print_table(out, piece)
            continue
        parts = [piece] if isinstance(piece, str) else piece
        styled = [(part, "") if isinstance(part, str) else part for part in parts]
        out.print(Text.assemble(*((printable(text), style) for text, style in styled)))


def _print_table(out: Console, table: Table) -> None:
    """Print a table, and below it the names of the columns that had no room."""
    from rich import box
    from rich.table import Table as Drawn
    from rich.text import Text

    shown: list[Column] = list(table.columns)
    left_out: list[Column] = []
    while sum(column.least_width + GAP for column in shown) + 1 > out.width and any(c.is_number for c in shown[1:]):
        left_out.insert(0, next(column for column in reversed(shown) if column.is_number))
        shown.remove(left_out[0])
    title = Text(printable(table.title)) if table.title else None
    drawn = Drawn(box=box.HEAVY_HEAD if out.is_terminal else box.MARKDOWN, title=title)
    for column in shown:
        width = column.least_width if column.is_number and out.is_terminal else None
        head = Text(printable(column.head))
        drawn.add_column(head, width=width, overflow="fold", justify="right" if column.is_number else "left")
    for cells in zip(*(column.cells for column in shown), strict=True):
        drawn.add_row(*(Text(printable(cell)) for cell in cells))
    if out.is_terminal:
        out.print(drawn)
    else:
        with out.capture() as captured:
            out.print(drawn)
        lines = (line.rstrip() for line in captured.get().splitlines())
        out.print(Text("\n".join(line for line in lines if line)), soft_wrap=True)
    if left_out:
        heads = printable(", ".join(column.head for column in left_out))
        out.print(Text(f"not shown, for lack of width: {heads}; --json has all, a wider terminal too"))


def duration(seconds: float) -> str:
    """Return a time in seconds, minutes or hours, in words."""
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"
