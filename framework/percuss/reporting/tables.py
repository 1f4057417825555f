"""What commands print: lines and tables, which one writer shows on a terminal or in a pipe; no number is ever cut.

On a terminal long names are broken into lines; if that is not enough, columns are left out in an order that the table
states, and named below it; or, where all columns weigh the same, the table is continued below itself. In a pipe nothing
is left out or broken, and there are no lines that are drawn.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeAlias

from percuss.errors import printable

if TYPE_CHECKING:  # rich is imported only where something is printed
    from rich.console import Console

GAP = 3  # characters between two columns: two of padding and the line
BREAKS = re.compile(r"[^\s._,/=-]*[\s._,/=-]*")  # the pieces of a name or a head, between which a line may end


@dataclass
class Column:
    """A column of a table.

    Attributes
    ----------
    head
        Head of the column.
    cells
        Its cells as text, one for each row.
    drop
        Rank in which it is left out where the table is too wide: the highest first; None if it never is.
    is_number
        Whether its cells are numbers, which are never broken.
    """

    head: str
    cells: list[str] = field(default_factory=list)
    drop: int | None = None
    is_number: bool = True

    @property
    def full_width(self) -> int:
        """Width in which nothing is broken."""
        return max(len(self.head), *map(len, self.cells), 1)

    @property
    def least_width(self) -> int:
        """Width below which a number, or a piece of a name, would be broken."""
        pieces = BREAKS.findall(self.head)
        for cell in self.cells:
            pieces += [cell] if self.is_number else BREAKS.findall(cell)
        return max(1, *(len(piece.rstrip()) for piece in pieces))


def words(head: str, cells: Iterable[object], drop: int | None = None) -> Column:
    """Return a column of words, which may be broken into lines."""
    return Column(head, list(map(str, cells)), drop, is_number=False)


@dataclass
class Table:
    """A table of columns.

    Attributes
    ----------
    columns
        The columns.
    title
        Title of the table.
    continued
        Number of columns that name a row. If it is not 0, columns without room are not left out: the table is continued
        below, with these columns again.
    """

    columns: Sequence[Column]
    title: str = ""
    continued: int = 0


class Unbroken(str):
    """A line that is never broken, such as a path or a command, which a reader copies."""

    __slots__ = ()


# A line may consist of parts, of which some have a style, as ("FAILED", "red").
Piece: TypeAlias = str | Sequence[str | tuple[str, str]] | Table


def console() -> Console:
    """Return the console on standard output: of the width of the terminal, or as wide as its content in a pipe."""
    from rich.console import Console

    made = Console(highlight=False)
    # Text in a pipe is read by programs and pasted into notes: lines are as long as what they say.
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
    from rich.text import Text

    title, continued = printable(table.title), table.continued
    columns = [replace(c, head=printable(c.head), cells=[printable(cell) for cell in c.cells]) for c in table.columns]
    if continued:
        names, rest = columns[:continued], columns[continued:]
        while rest:
            taken = [rest.pop(0)]
            while rest and _fits([*names, *taken, rest[0]], out.width):
                taken.append(rest.pop(0))
            _print_columns(out, [*names, *taken], title)
            title = ""
        return
    shown = list(columns)
    while not _fits(shown, out.width) and any(column.drop is not None for column in shown):
        shown.remove(max((column for column in shown if column.drop is not None), key=lambda column: column.drop or 0))
    _print_columns(out, shown, title)
    if left_out := [column.head for column in columns if column not in shown]:
        out.print(Text(f"not shown, for lack of width: {', '.join(left_out)}; --json has all, a wider terminal too"))


def _fits(columns: Sequence[Column], room: int) -> bool:
    return sum(column.least_width + GAP for column in columns) + 1 <= room


def _print_columns(out: Console, columns: Sequence[Column], title: str) -> None:
    """Print columns as a table; row by row where there is too little room for that."""
    from rich import box
    from rich.table import Table as Drawn
    from rich.text import Text

    if not _fits(columns, out.width):
        out.print(Text(title, style="italic"))
        for cells in zip(*(column.cells for column in columns), strict=True):
            for column, cell in zip(columns, cells, strict=True):
                out.print(Text(f"{column.head}: {cell}"), soft_wrap=True)
            out.print()
        return
    widths = _widths(columns, out.width)
    table = Drawn(box=box.HEAVY_HEAD if out.is_terminal else box.MARKDOWN, title=Text(title) if title else None)
    for column, width in zip(columns, widths, strict=True):
        head = Text("\n".join(_broken(column.head, width)))
        table.add_column(head, width=width, no_wrap=True, justify="right" if column.is_number else "left")
    for cells in zip(*(column.cells for column in columns), strict=True):
        table.add_row(*(Text("\n".join(_broken(cell, width))) for cell, width in zip(cells, widths, strict=True)))
    if out.is_terminal:
        out.print(table)
        return
    with out.capture() as captured:
        out.print(table)
    lines = (line.rstrip() for line in captured.get().splitlines())
    out.print(Text("\n".join(line for line in lines if line)), soft_wrap=True)


def _widths(columns: Sequence[Column], room: int) -> list[int]:
    """Return the widths of the columns: as wide as their content if there is room, and the widest are made narrower."""
    widths = [column.full_width for column in columns]
    for _ in range(sum(widths) + GAP * len(columns) + 1 - room):
        spare = [width - column.least_width for column, width in zip(columns, widths, strict=True)]
        widest = max(range(len(columns)), key=lambda i: (spare[i] > 0, widths[i]))
        widths[widest] -= 1
    return widths


def _broken(text: str, width: int) -> list[str]:
    """Return a text in lines of at most a width, broken behind spaces and punctuation where that is possible."""
    lines = [""]
    for part in text.split("\n"):
        if lines != [""]:
            lines.append("")
        for piece in BREAKS.findall(part):
            if len(lines[-1]) + len(piece.rstrip()) > width:
                lines.append("")
            lines[-1] += piece
    return [line.rstrip() for line in lines if line.strip()] or [""]


def duration(seconds: float) -> str:
    """Return a time in seconds, minutes or hours, in words."""
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"
