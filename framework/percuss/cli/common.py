"""Common parts of the commands: options, errors as messages and exit codes, a progress bar, JSON."""

from __future__ import annotations

import contextlib
import json
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer

from percuss.errors import InputError, PercussError, Problem, UnwrittenError, printable, refuse_if_any, shortened
from percuss.files import expect_writable
from percuss.methods.blame import described, plugin_faults
from percuss.reporting.tables import duration, show

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.progress import Progress

    from percuss.case.case import Case
    from percuss.contact.model import Model
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
Workers = Annotated[int | None, option("--workers N", "Number of processes of one thread each; by default one a core.")]
Longest = Annotated[float | None, option("--longest SECONDS", "End a run of a worker after this time.")]
Reference = Annotated[str, option("--reference refine=N", "Where no exact solution is known, judge by a finer run.")]
AsJson = Annotated[bool, option("--json", "Print one JSON object; the rest goes to standard error.")]


SHORT = 0.005  # seconds that a model and the search of its critical step take at least
LONG = 10.0  # seconds from which on it is told beforehand how long something takes
FIRST_LINE, LINES_EVERY = 10.0, 30.0  # seconds until the first line of progress, and between two lines
PACE = 600.0  # seconds over which the pace of the work is taken

COMPILING = "compiling the time loop, once for this kind of model"


@contextmanager
def _compiling_told() -> Iterator[None]:
    """Tell on standard error that numba compiles, if it still does after some time."""
    from percuss.jit import NOTICES

    busy = threading.Event()

    def say() -> None:
        if busy.is_set():
            tell(COMPILING)

    timer = threading.Timer(1.0 if sys.stderr.isatty() else FIRST_LINE, say)
    timer.daemon = True

    def notice(begun: bool) -> None:
        (busy.set if begun else busy.clear)()
        if begun and timer.ident is None:
            timer.start()

    NOTICES.append(notice)
    try:
        yield
    finally:
        NOTICES.remove(notice)
        timer.cancel()


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
    """Turn errors into a message and an exit code, and tell while the time loop is compiled.

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
            _compiling_told(),
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
    rarely. The time to go is that at the pace from the first piece of work on, before which functions are compiled.
    """
    started, next_line = time.monotonic(), FIRST_LINE
    bar: Progress | None = None

    def show(done: int, total: int) -> None:
        nonlocal started, next_line, bar
        if done == 0:
            started = time.monotonic()
        elapsed = time.monotonic() - started
        if bar is None and elapsed > 1.0 and done < total:
            bar = _bar(unit, total)
        if bar is None:
            return
        task = bar.tasks[0]
        bar.update(task.id, completed=done)
        if bar.disable and elapsed >= next_line and done < total:
            left = task.time_remaining
            to_go = "" if left is None else f", about {duration(left)} to go"
            tell(f"{done} of {total} {unit} after {duration(elapsed)}{to_go}")
            next_line = elapsed + max(LINES_EVERY, 0.1 * elapsed)
        if done >= total:
            end()

    def end() -> None:
        nonlocal bar
        if bar is not None:  # other work may show its own bar from now on
            bar.stop()
            bar = None

    try:
        yield show
    finally:
        end()


def _bar(unit: str, total: int) -> Progress:
    """Return a bar on standard error that runs; one that shows nothing where this is no terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = MofNCompleteColumn(), TextColumn(unit), BarColumn(), TimeRemainingColumn()
    look: Entries = {"console": Console(stderr=True), "transient": True, "disable": not sys.stderr.isatty()}
    bar = Progress(*columns, speed_estimate_period=PACE, get_time=time.monotonic, **look)
    bar.start()
    bar.add_task("", total=total)
    return bar


def tell(text: str) -> None:
    """Print a message on standard error, in which texts of files and plug-ins cannot steer a terminal."""
    print(printable(text), file=sys.stderr, flush=True)


def tell_if_long(model: Model, count: int = 1) -> None:
    """Tell beforehand that the search of the critical step of such runs takes long, and where a run needs none."""
    from percuss.certificate.criteria import seconds_to_search
    from percuss.certificate.lanczos import why_not_covered

    each = seconds_to_search(model)
    if (seconds := count * (SHORT + each)) > LONG:
        needs = "" if each < LONG or why_not_covered(model) else "; `percuss run` needs none"
        what = f"{count} critical steps" if count > 1 else "the critical step"
        tell(f"The search of {what} of {model.bodies.n_nodes} nodes takes about {duration(seconds)}{needs}.")


def print_json(data: Entries, file: TextIO | None = None) -> None:
    """Print one JSON object, by default on standard output."""
    from percuss.jsonable import infinity_as_text

    print(printable(json.dumps(infinity_as_text(data), indent=2, ensure_ascii=False, allow_nan=False)), file=file)


def _assignments(items: Iterable[str], option: str, expected: str, advice: str) -> dict[str, str]:
    """Return the values that an option assigns, each as ``KEY=VALUE``."""
    parted = [(item, *item.partition("=")) for item in items]
    wrong = [item for item, key, equals, _ in parted if not (key and equals)]
    refuse_if_any([Problem(option, "", f"expected {expected}, found '{shortened(item)}'", advice) for item in wrong])
    return {key: value for _, key, _, value in parted}


def reference_of(text: str) -> dict[str, str]:
    """Return the values that ``--reference refine=4,contact=lagrange`` sets in a case, by path."""
    given = _assignments(filter(None, text.split(",")), "--reference", "KEY=VALUE", "Write it as refine=4.")
    return {f"reference.{key}": value for key, value in given.items()}


def load_case(
    path: Path,
    sets: list[str] | None,
    files: list[Path] | None,
    read: Callable[..., Case] | None = None,
    reference: str = "",
) -> Case:
    """Return the case in a file, with the values of ``--set`` and ``--reference`` in place of its own."""
    from percuss.case.case import load

    given = _assignments(sets or [], "--set", "PATH=VALUE", "Write it as time.end=0.5.")
    return (read or load)(path, given | reference_of(reference), plugins=files or [])


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
