"""Common parts of the commands: options, errors as messages and exit codes, a progress bar, JSON."""

from __future__ import annotations

import contextlib
import json
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer

from percuss.errors import InputError, PercussError, Problem, UnwrittenError, printable, refuse_if_any, shortened
from percuss.files import expect_writable
from percuss.listeners import heard_by
from percuss.methods.blame import described, plugin_faults

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from percuss.case.case import Case
    from percuss.jsonable import Entries
    from percuss.reporting.tables import Piece


def option(usage: str, words: str) -> Any:
    """Return an option of a command: its usage, as ``-o --out FILE``, and what it does, both as the help shows them."""
    names = [word for word in usage.split() if word.startswith("-")]
    return typer.Option(*names, metavar=" ".join(usage.split()[len(names) :]) or None, help=words)


CaseFile = Annotated[Path, typer.Argument(metavar="CASE", help="YAML file of the case.")]
Sets = Annotated[list[str] | None, option("--set PATH=VALUE", "Replace a value: method.contact.beta_s=1. Repeatable.")]
Plugins = Annotated[list[Path] | None, option("--plugin FILE", "Add a single-file plug-in. Repeatable.")]
Vary = Annotated[
    list[str] | None,
    option("--vary PATH=VALUES", "Vary a value: 1,2,5, 0:1:11, 0.01:100:log:30 or mortar,gauss-points. Repeatable."),
]
Workers = Annotated[int | None, option("--workers N", "Number of processes; by default one a core.")]
Reference = Annotated[
    str, option("--reference refine=N", "Estimate errors by a finer run where no exact solution is known.")
]
AsJson = Annotated[bool, option("--json", "Print one JSON object; the rest goes to standard error.")]


FIRST_LINE, LINES_EVERY = 10.0, 30.0  # seconds until the first line of progress, and between two lines
MINUTE = 60.0  # seconds over which the pace of the work is taken

COMPILING = "compiling the time loop, once for this kind of model"

# The progress bar that is shown, if any: a terminal has no room for a spinner beside it.
_ON_TERMINAL: list[Any] = []


@contextmanager
def _compiling_shown() -> Iterator[None]:
    """Show on standard error that numba compiles."""
    from percuss.jit import NOTICES

    shown = _Compilations()
    NOTICES.append(shown.notice)
    try:
        yield
    finally:
        NOTICES.remove(shown.notice)
        shown.notice(False)


class _Compilations:
    """The compilations of a command: a spinner on a terminal that shows no progress bar, else one line if they last."""

    def __init__(self) -> None:
        self._since: float | None = None
        self._said = False
        self._end: Callable[[], object] | None = None  # ends what is shown, or waits to be

    def notice(self, begun: bool) -> None:
        """Show that a compilation has begun, or that it has ended."""
        if self._end is not None:
            self._end()
            self._end = None
        if begun and sys.stderr.isatty() and not _ON_TERMINAL:
            from rich.console import Console

            spinner = Console(stderr=True).status(COMPILING)
            spinner.start()
            self._end = spinner.stop
        elif begun and not sys.stderr.isatty() and not self._said:
            now = time.monotonic()
            self._since = now if self._since is None else self._since
            # The line comes some seconds after the first compilation began, if one is under way then.
            timer = threading.Timer(max(0.0, self._since + FIRST_LINE - now), self._say)
            timer.daemon = True
            timer.start()
            self._end = timer.cancel

    def _say(self) -> None:
        self._said = True
        print(COMPILING, file=sys.stderr, flush=True)


class Answer:
    """What a command prints and writes: where a file cannot be written, the rest is printed all the same.

    Attributes
    ----------
    as_json
        Whether standard output holds one JSON object; the rest then goes to standard error.
    unwritten
        One sentence for each file that could not be written.
    exit_code
        Exit code of the command, if all its files could be written.
    """

    def __init__(self, *, as_json: bool) -> None:
        self.as_json = as_json
        self._results = sys.stdout  # what a plug-in prints goes elsewhere where this holds JSON
        self.unwritten: list[str] = []
        self.exit_code = 0

    def write(self, path: Path | None, writer: Callable[..., object], *arguments: object) -> None:
        """Call a function that writes a file, if the path of the file is given."""
        try:
            if path is not None:
                writer(*arguments)
        except UnwrittenError as error:
            self.unwritten.append(str(error))

    def draw(self, path: Path | None, figure: Callable[..., Figure], *arguments: object) -> None:
        """Write the figure that a function returns, if the path of its file is given."""
        from percuss.reporting.figures import write

        if path is not None:
            self.write(path, write, path, figure(*arguments))

    def show(self, data: Entries, pieces: Iterable[Piece]) -> None:
        """Print the data as JSON, or what tells the same to a reader."""
        if self.as_json:
            print_json(data, self._results)
        else:
            from percuss.reporting.tables import show

            show(pieces)

    def conclude(self, lines: Iterable[str]) -> None:
        """Print the verdict at the end of a command, on standard error if standard output holds JSON."""
        for line in lines:
            print(printable(line), file=sys.stderr if self.as_json else sys.stdout, flush=True)

    def finish(self) -> None:
        """Report the files that could not be written, after all else, and end a command that has failed."""
        for error in self.unwritten:
            tell(f"error: {error}")
        if code := 2 if self.unwritten else self.exit_code:
            raise typer.Exit(code)


@contextmanager
def reporting(as_json: bool) -> Iterator[Answer]:
    """Turn errors into a message and an exit code, and show a spinner while the time loop is compiled.

    Only errors that percuss raises on purpose, errors in plug-ins and lack of memory are treated so. Numbers that
    overflow are told by the result or by an error, not by warnings of numpy besides.
    """
    import numpy as np

    answer = Answer(as_json=as_json)
    try:
        with (
            plugin_faults(),
            np.errstate(all="ignore"),
            contextlib.redirect_stdout(sys.stderr) if as_json else contextlib.nullcontext(),
            _compiling_shown(),
        ):
            yield answer
            answer.finish()
    except (PercussError, MemoryError) as error:
        if isinstance(error, MemoryError):
            size = described(error).partition(": ")[2] or "of no known size"
            error = PercussError(f"the machine has too little memory for this ({size}): take fewer elements or records")
        problems = [vars(problem) for problem in getattr(error, "problems", ())]
        if as_json:
            status = "bad input" if error.exit_code == 2 else "failed"
            print_json({"status": status, "error": str(error), "problems": problems})
        tell(str(error) if problems else f"error: {error}")
        if isinstance(error, InputError):
            tell(f"{len(problems)} mistake{'s' if len(problems) > 1 else ''}; nothing was run")
        raise typer.Exit(error.exit_code) from None


@contextmanager
def progress_bar(unit: str = "steps") -> Iterator[Callable[[int, int], None]]:
    """Yield a callback that shows the progress of work that lasts: as a bar on a terminal, else as lines now and then.

    Both go to standard error. A line comes after 10 s, then every half minute, and of work that lasts for hours more
    rarely. The time to go is that at the pace of the last minute.
    """
    started = time.monotonic()
    shown: list[Any] = []
    past: deque[tuple[float, int]] = deque()  # seconds and work done, the first of them a minute ago
    next_line = FIRST_LINE

    def show(done: int, total: int) -> None:
        nonlocal started, next_line
        if done == 0:
            started = time.monotonic()
            past.clear()
        elapsed = time.monotonic() - started
        past.append((elapsed, done))
        while len(past) > 1 and past[1][0] <= elapsed - MINUTE:
            past.popleft()
        left = _time_left(past, total)
        if not sys.stderr.isatty():
            if elapsed >= next_line and done < total:
                print(_progress_line(done, total, unit, elapsed, left), file=sys.stderr, flush=True)
                next_line = elapsed + max(LINES_EVERY, 0.1 * elapsed)
            return
        if not shown and elapsed > 1.0 and done < total:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn

            columns = (
                TextColumn(f"{{task.completed}}/{{task.total}} {unit}"),
                BarColumn(),
                TextColumn("{task.fields[left]}"),
            )
            bar = Progress(*columns, console=Console(stderr=True), transient=True)
            bar.start()
            shown.extend([bar, bar.add_task("march", total=total, left=left)])
            _ON_TERMINAL.append(bar)
        if shown:
            shown[0].update(shown[1], completed=done, left=left)
        if done >= total:
            end()

    def end() -> None:
        if shown:  # other work may show its own bar from now on
            shown[0].stop()
            _ON_TERMINAL.remove(shown[0])
            shown.clear()

    try:
        yield show
    finally:
        end()


@contextmanager
def exact_solution_shown() -> Iterator[None]:
    """Show the progress of an exact solution that lasts."""
    with progress_bar("percent of the exact solution") as show, heard_by(lambda share: show(int(100 * share), 100)):
        yield


def _time_left(past: Sequence[tuple[float, int]], total: int) -> str:
    """Return in words how long the rest of some work takes at its pace from the first to the last of `past`."""
    from percuss.reporting.tables import duration

    (since, before), (now, done) = past[0], past[-1]
    return f"about {duration((now - since) * (total - done) / (done - before))} to go" if done > before else ""


def _progress_line(done: int, total: int, unit: str, elapsed: float, left: str) -> str:
    """Return the line that tells the progress where there is no terminal."""
    from percuss.reporting.tables import duration

    return f"{done} of {total} {unit} after {duration(elapsed)}{', ' if left else ''}{left}"


def tell(text: str) -> None:
    """Print a message on standard error, in which texts of files and plug-ins cannot steer a terminal."""
    print(printable(text), file=sys.stderr, flush=True)


def print_json(data: Entries, file: TextIO | None = None) -> None:
    """Print one JSON object, by default on standard output."""
    from percuss.jsonable import infinity_as_text

    print(printable(json.dumps(infinity_as_text(data), indent=2, ensure_ascii=False, allow_nan=False)), file=file)


def reference_of(text: str) -> dict[str, str]:
    """Return the values that ``--reference refine=4,contact=lagrange`` sets in a case, by path."""
    changes = [(item, *item.partition("=")) for item in text.split(",") if text]
    advice = "Write it as refine=4."
    refuse_if_any(
        [
            Problem("--reference", "", f"expected KEY=VALUE, found '{shortened(item)}'", advice)
            for item, key, equals, _ in changes
            if not (key and equals)
        ]
    )
    return {f"reference.{key}": value for _, key, _, value in changes}


def load_case(
    path: Path,
    sets: list[str] | None,
    files: list[Path] | None,
    read: Callable[..., Case] | None = None,
    reference: str = "",
) -> Case:
    """Return the case in a file, with the values of ``--set`` and ``--reference`` in place of its own."""
    from percuss.case.case import load
    from percuss.case.overrides import as_given_by

    changes = [(item, *item.partition("=")) for item in sets or []]
    advice = "Write it as time.end=0.5."
    refuse_if_any(
        [
            Problem(f"--set {shortened(item)}", "", "expected PATH=VALUE", advice)
            for item, key, equals, _ in changes
            if not (key and equals)
        ]
    )
    given = {key: value for _, key, _, value in changes}
    named = reference_of(reference)
    try:
        return (read or load)(path, given | named, plugins=files or [])
    except InputError as error:
        if not named:
            raise
        raise as_given_by({key: f"--reference {key.partition('.')[2]}=" for key in named}, error) from None


def load_to_write(
    path: Path,
    sets: list[str] | None,
    files: list[Path] | None,
    plot: Path | None,
    out: Path | None = None,
    varied: Mapping[str, Sequence[object]] | None = None,
    reference: str = "",
) -> Case:
    """Return the case in a file; refuse a figure or an output file that could not be written before the case is run.

    Among the varied values may be files, which are read too.
    """
    expect_drawable(plot)
    loaded = load_case(path, sets, files, reference=reference)
    inputs = [*loaded.inputs, *loaded.files_among(value for values in (varied or {}).values() for value in values)]
    for target in filter(None, (out, plot)):
        expect_writable(target, inputs)
    return loaded


def print_notes(case: Case) -> None:
    """Print the notes of a case on standard error, for commands whose report has no place for them."""
    for note in case.notes:
        tell(f"note: {note}")


def names_in(text: str) -> list[str]:
    """Return the names in a comma-separated list."""
    return [name.strip() for name in text.split(",") if name.strip()]


def methods_in_words(case: Case) -> str:
    """Return the integrator and the contact laws of a case in words, for the head of a figure."""
    laws = list(dict.fromkeys(contact.law.name for contact in case.contacts.values())) or ["no contact"]
    return f"{case.method.integrator.name} integrator  ·  {', '.join(laws)}"


def expect_drawable(path: Path | None) -> None:
    """Refuse a figure that cannot be drawn because of its suffix or because matplotlib is not installed."""
    from percuss.reporting.figures import check_suffix

    if path is not None:
        check_suffix(path)
