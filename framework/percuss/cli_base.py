"""What every command does alike: errors as messages and exit codes, a progress bar, JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import typer

from percuss.errors import InputError, PercussError


@contextmanager
def reporting(as_json: bool) -> Iterator[None]:
    """Turn errors that percuss raises on purpose into a message and an exit code."""
    try:
        yield
    except PercussError as error:
        if as_json:
            problems = [vars(p) for p in error.problems] if isinstance(error, InputError) else []
            kind = "bad input" if error.exit_code == 2 else "failed"
            print_json({"status": kind, "error": str(error), "problems": problems})
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
        if not where:  # a defect of percuss itself: all of it is wanted
            raise
        text = f"{where}: {type(error).__name__}: {error}"
        if as_json:
            print_json({"status": "bad input", "error": text, "problems": []})
        print(f"error: {text}", file=sys.stderr)
        raise typer.Exit(2) from None


@contextmanager
def progress_bar(what: str = "steps") -> Iterator[Callable[[int, int], None]]:
    """Give a callback that shows a bar with the remaining time, on a terminal and for runs that last."""
    import time

    started = time.monotonic()
    shown: list[Any] = []

    def show(done: int, total: int) -> None:
        if not shown and sys.stderr.isatty() and time.monotonic() - started > 1.0 and done < total:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

            columns = (TextColumn(f"{{task.completed}}/{{task.total}} {what}"), BarColumn(), TimeRemainingColumn())
            bar = Progress(*columns, console=Console(stderr=True), transient=True)
            bar.start()
            shown.extend([bar, bar.add_task("march", total=total)])
        if shown:
            shown[0].update(shown[1], completed=done)

    try:
        yield show
    finally:
        if shown:
            shown[0].stop()


def print_json(data: dict[str, Any]) -> None:
    """Print one JSON object."""
    print(json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False))
