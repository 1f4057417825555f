"""Common parts of the commands: options, errors as messages and exit codes, a progress bar, JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from percuss.errors import InputError, PercussError, Problem

if TYPE_CHECKING:
    from percuss.case.case import Case

CaseFile = Annotated[Path, typer.Argument(metavar="CASE", help="YAML file of the case.")]
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="Replace a value, as method.contact.beta_s=1; repeatable."),
]
Plugins = Annotated[
    list[Path] | None, typer.Option("--plugin", metavar="FILE", help="A single-file plug-in; repeatable.")
]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object on standard output, the rest on standard error.")]


COMPILING = "compiling the time loop, once for this kind of model"

# The progress bar that is shown, if any: a terminal has no room for a spinner beside it.
_ON_TERMINAL: list[Any] = []


@contextmanager
def _compiling_shown() -> Iterator[None]:
    """Show a spinner on standard error while numba compiles, on a terminal that shows no progress bar."""
    from percuss.compiling import NOTICES

    spinner: list[Any] = []

    def notice(begun: bool) -> None:
        if begun and not _ON_TERMINAL and sys.stderr.isatty():
            from rich.console import Console

            spinner.append(Console(stderr=True).status(COMPILING))
            spinner[0].start()
        elif spinner and not begun:
            spinner.pop().stop()

    NOTICES.append(notice)
    try:
        yield
    finally:
        NOTICES.remove(notice)
        if spinner:
            spinner.pop().stop()


@contextmanager
def reporting(as_json: bool) -> Iterator[None]:
    """Turn errors into a message and an exit code, and show a spinner while the time loop is compiled.

    Only errors that percuss raises on purpose, errors in plug-ins and lack of memory are treated so.
    """
    try:
        with _compiling_shown():
            yield
    except PercussError as error:
        if as_json:
            problems = [vars(problem) for problem in error.problems] if isinstance(error, InputError) else []
            status = "bad input" if error.exit_code == 2 else "failed"
            print_json({"status": status, "error": str(error), "problems": problems})
        print(f"error: {error}" if not isinstance(error, InputError) else str(error), file=sys.stderr)
        if isinstance(error, InputError):
            count = len(error.problems)
            print(f"{count} mistake{'s' if count > 1 else ''}; nothing was run", file=sys.stderr)
        raise typer.Exit(error.exit_code) from None
    except MemoryError as error:
        text = f"this needs more memory than there is ({error or 'of no known size'}): take fewer elements or records"
        if as_json:
            print_json({"status": "bad input", "error": text, "problems": []})
        print(f"error: {text}", file=sys.stderr)
        raise typer.Exit(2) from None
    except Exception as error:
        from percuss.methods.blame import line_in_plugin

        where = line_in_plugin(error)
        # A defect of percuss itself keeps its full traceback.
        if not where:
            raise
        text = f"{where}: {type(error).__name__}: {error}"
        if as_json:
            print_json({"status": "bad input", "error": text, "problems": []})
        print(f"error: {text}", file=sys.stderr)
        raise typer.Exit(2) from None


@contextmanager
def progress_bar(unit: str = "steps") -> Iterator[Callable[[int, int], None]]:
    """Yield a callback that shows a bar with the remaining time, on a terminal and if the work lasts over a second."""
    import time

    started = time.monotonic()
    shown: list[Any] = []

    def show(done: int, total: int) -> None:
        if not shown and sys.stderr.isatty() and time.monotonic() - started > 1.0 and done < total:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

            columns = (TextColumn(f"{{task.completed}}/{{task.total}} {unit}"), BarColumn(), TimeRemainingColumn())
            bar = Progress(*columns, console=Console(stderr=True), transient=True)
            bar.start()
            shown.extend([bar, bar.add_task("march", total=total)])
            _ON_TERMINAL.append(bar)
        if shown:
            shown[0].update(shown[1], completed=done)

    try:
        yield show
    finally:
        if shown:
            shown[0].stop()
            _ON_TERMINAL.remove(shown[0])


def print_json(data: dict[str, Any]) -> None:
    """Print one JSON object on standard output."""
    print(json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False))


def load_case(
    path: Path, sets: list[str] | None, files: list[Path] | None, read: Callable[..., Case] | None = None
) -> Case:
    """Return the case in a file, with the values of ``--set`` in place of its own."""
    from percuss.case.case import load

    overrides = {}
    problems = []
    for item in sets or []:
        key, equals, value = item.partition("=")
        if not equals or not key:
            problems.append(Problem(f"--set {item}", "", "expected PATH=VALUE", "Write it as time.end=0.5."))
        overrides[key] = value
    if problems:
        raise InputError(problems)
    return (read or load)(path, overrides, plugins=files or [])


def load_to_write(
    path: Path, sets: list[str] | None, files: list[Path] | None, plot: Path | None, out: Path | None = None
) -> Case:
    """Return the case in a file; refuse a figure or an output file that could not be written before the case is run."""
    if plot is not None:
        expect_drawable(plot)
    loaded = load_case(path, sets, files)
    for target in (out, plot):
        if target is not None:
            expect_writable(target)
    return loaded


def print_notes(case: Case) -> None:
    """Print the notes of a case on standard error, for commands whose report has no place for them."""
    for note in case.notes:
        print(f"note: {note}", file=sys.stderr)


def names_in(text: str) -> list[str]:
    """Return the names in a comma-separated list."""
    return [name.strip() for name in text.split(",") if name.strip()]


def methods_in_words(case: Case) -> str:
    """Return the integrator and the contact laws of a case in words, for the head of a figure."""
    laws = list(dict.fromkeys(contact.law.name for contact in case.contacts.values())) or ["no contact"]
    return f"{case.method.integrator.name} integrator  ·  {', '.join(laws)}"


def expect_drawable(path: Path) -> None:
    """Refuse a figure that cannot be drawn because of its suffix or because matplotlib is not installed."""
    from percuss.reporting.figures import check_suffix

    check_suffix(path)


def expect_writable(path: Path) -> None:
    """Refuse a path that cannot be written to, before anything is run."""
    from percuss.files import replacing

    attempt = replacing(path, path.suffix)
    attempt.__enter__()
    attempt.__exit__(OSError, None, None)
