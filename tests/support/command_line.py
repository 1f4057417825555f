"""The command line in this process: what a user types, without a second interpreter that starts and loads."""

import contextlib
import io
import os
import warnings
from pathlib import Path
from types import SimpleNamespace

import numba
import typer

from percuss.cli.main import app

COMMAND = typer.main.get_command(app)  # made once: that takes longer than many a command
WIDTH = {"COLUMNS": "", "NO_COLOR": "1"}


def percuss_command(*words, cwd=None, plain=False, columns=120, together=False):
    """Run ``percuss WORDS...`` in a folder; return `returncode`, `stdout` and `stderr`, as of a process.

    With `plain` nothing is compiled: of a case of some elements and steps that would take longer. With `together`
    both streams are in `stdout`, as a terminal shows them.
    """
    out = io.StringIO()
    err = out if together else io.StringIO()
    folder, width = Path.cwd(), {name: os.environ.get(name) for name in WIDTH}
    os.environ.update(WIDTH | {"COLUMNS": str(columns)})
    os.chdir(cwd or folder)
    code, jit = 0, numba.config.DISABLE_JIT
    numba.config.DISABLE_JIT = 1 if plain else jit
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
            warnings.simplefilter("default")
            COMMAND([str(word) for word in words], prog_name="percuss", standalone_mode=True)
    except SystemExit as done:
        code = done.code or 0
    finally:
        os.chdir(folder)
        numba.config.DISABLE_JIT = jit
        for name, value in width.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value
    return SimpleNamespace(returncode=code, stdout=out.getvalue(), stderr=err.getvalue())


def refused(*words, **how):
    """Return what a command says that is refused: it ends with 2 and one message."""
    done = percuss_command(*words, **how)
    assert done.returncode == 2, done.stdout
    assert "Traceback" not in done.stderr
    return done.stderr


def printed(*words, **how):
    """Return what a command prints that does its work."""
    done = percuss_command(*words, **how)
    assert done.returncode == 0, done.stderr
    return done.stdout
