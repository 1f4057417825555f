"""The command line. Modules that take long to import are imported inside the commands that need them."""

from __future__ import annotations

import errno
import gc
import os
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from percuss.blas import start_with_one_blas_thread
from percuss.cli.check import check
from percuss.cli.compare import compare
from percuss.cli.new import new
from percuss.cli.plugins import plugins
from percuss.cli.recommend import recommend
from percuss.cli.report import report
from percuss.cli.run import run
from percuss.cli.schema import schema
from percuss.cli.stability import stability
from percuss.cli.study import study
from percuss.cli.verify import verify
from percuss.cli.waves import waves
from percuss.files import CANNOT_BE_WRITTEN
from percuss.methods.blame import line_in_plugin
from percuss.process import INTERRUPTED
from percuss.version import CONTRACT, __version__

GARBAGE_THRESHOLD = 50_000  # new objects after which Python looks for garbage

COMMANDS = (run, check, compare, stability, waves, study, recommend, report, plugins, new, verify, schema)


class Commands(TyperGroup):
    """The commands."""

    def invoke(self, ctx: Any) -> Any:
        """Run a command; Ctrl-C ends it, with the line of the plug-in in which it was at work, if it was in one."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interrupt:
            where = line_in_plugin(interrupt)
            print(f"interrupted{f' in {where}' if where else ''}", file=sys.stderr)
            raise typer.Exit(INTERRUPTED) from None


app = typer.Typer(
    name="percuss",
    cls=Commands,
    help="A bench on which explicit contact-impact methods are compared.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in COMMANDS:
    app.command()(command)


def _print_version(asked: bool) -> None:
    if asked:
        print(f"percuss {__version__}, contract {CONTRACT}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Take the options that belong to no command."""


def main() -> None:
    """Run the command line: exit code 0 for done, 1 for a run or expectation that failed, 2 for bad input.

    The exit code is 130 for a command that Ctrl-C ended.
    """
    start_with_one_blas_thread()
    # Pydantic would look through all installed distributions for plug-ins of its own.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    # Importing makes many objects that stay: to look for garbage among them every time takes a tenth of a short run.
    gc.set_threshold(GARBAGE_THRESHOLD)
    try:
        try:
            app(standalone_mode=True)
        finally:
            print(end="", flush=True)  # here, where an error can still be told
    except OSError as error:
        if error.errno not in {*CANNOT_BE_WRITTEN, errno.EPIPE}:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes it once more at its end
        if error.errno == errno.EPIPE:  # the reader has left, as `head` does
            sys.exit(1)
        print(f"error: {error.filename or 'the output'} cannot be written: {error.strerror}", file=sys.stderr)
        sys.exit(2)
