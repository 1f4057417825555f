"""Ctrl-C, and places that cannot be written to."""

import contextlib
import json
import os
import signal
import sqlite3
import stat
import sys
from pathlib import Path

import pytest

import percuss
import places
from command_line import percuss_command
from fake_studies import TWO_BARS
from percuss.cli import common
from percuss.cli.main import app
from percuss.errors import InputError
from percuss.interrupt import interruptible
from percuss.jit import compiler
from percuss.march import march
from percuss.results import reference, runner
from percuss.results.rerun import rerun

CASE = {**TWO_BARS, "time": {"steps": 3, "courant": 0.5}}


@pytest.fixture(autouse=True)
def usual_ctrl_c():
    """Let Ctrl-C interrupt, also where the tests were started in the background, which ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def press():
    os.kill(os.getpid(), signal.SIGINT)


def test_the_first_ctrl_c_is_an_event_and_the_second_interrupts():
    with interruptible() as event:
        press()
        assert event.is_set()
        with pytest.raises(KeyboardInterrupt):
            press()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_ctrl_c_in_the_last_step_of_a_run_ends_the_study_around_it():
    with interruptible() as outer:
        with interruptible() as inner:
            press()
        assert inner.is_set()
        assert outer.is_set()
        with pytest.raises(KeyboardInterrupt):
            press()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    with interruptible() as outer:
        with interruptible() as inner:
            pass
        press()
        assert outer.is_set()
        assert not inner.is_set()


@pytest.mark.parametrize("pressed_at", [10, 30])
def test_the_exit_code_of_a_run_that_ctrl_c_ended(tmp_path, monkeypatch, pressed_at):
    """After the first steps, and after the last."""

    @contextlib.contextmanager
    def pressing(unit="steps"):
        yield lambda done, total: press() if (done, unit) == (pressed_at, "steps") else None

    monkeypatch.setattr(common, "progress_bar", pressing)
    monkeypatch.setattr(march, "CHUNK_STEPS", 10)
    (tmp_path / "case.yaml").write_text(repr({**CASE, "time": {"steps": 30, "courant": 0.5}}))
    done = percuss_command("run", "case.yaml", "--json", cwd=tmp_path, plain=True)
    assert (json.loads(done.stdout)["status"], done.returncode) == ("interrupted", 130)


def test_a_ctrl_c_that_a_callback_of_llvm_loses_ends_the_compilation():
    def called_by_llvm():
        with contextlib.suppress(KeyboardInterrupt):
            press()

    with pytest.raises(KeyboardInterrupt), compiler():
        called_by_llvm()


@pytest.mark.parametrize("part", ["preparation", "last steps"])
def test_ctrl_c_during_the_finer_run_that_judges_a_run(monkeypatch, part):
    """The run is kept without the errors that the finer run would give, and those around it know of Ctrl-C."""

    class Pressed(march.March):
        def run(self, *arguments, **options):
            outcome = super().run(*arguments, **options)
            press()
            return outcome

    monkeypatch.setattr("percuss.results.assemble.exact_solution", lambda *_: (None, "", "hidden"))
    if part == "preparation":
        monkeypatch.setattr(reference.verdict, "verdict_alone", lambda *_: press())
    else:
        monkeypatch.setattr(reference, "March", Pressed)
    with interruptible() as around:
        result = percuss.run(percuss.load({**CASE, "reference": {"refine": 2}, "title": part}))
    assert (result.status, result.summary["estimated"]) == ("interrupted", None)
    assert around.is_set()


def test_an_interrupted_run_has_no_finer_run_and_its_twin_tells_nothing(monkeypatch):
    """The finer run takes longer than the run that it judges."""
    monkeypatch.setattr("percuss.results.assemble.exact_solution", lambda *_: (None, "", "hidden"))
    monkeypatch.setattr(march, "CHUNK_STEPS", 1)
    monkeypatch.setattr(reference, "_march", lambda _: pytest.fail("a finer run was made"))
    case = percuss.load({**CASE, "reference": {"refine": 2}})
    result = percuss.run(case, nudge=True, progress=lambda done, _: press() if done == 1 else None)
    assert (result.status, result.summary["steps"], result.summary["fragile"]) == ("interrupted", 1, None)


# ------------------------------------------------------------------------------------- a folder of somebody else


@pytest.fixture
def read_only(monkeypatch):
    """Make a folder one that cannot be written to; for the superuser, who may write anywhere, the calls that would."""

    def make(folder):
        folder.chmod(stat.S_IRUSR | stat.S_IXUSR)
        if os.access(folder, os.W_OK):
            real_open, real_connect = os.open, sqlite3.connect

            def os_open(path, flags, *arguments, **options):
                if Path(path).parent == folder and flags & (os.O_CREAT | os.O_WRONLY | os.O_RDWR):
                    raise PermissionError(13, "Permission denied", str(path))
                return real_open(path, flags, *arguments, **options)

            def connect(database, *arguments, **options):
                file = Path(str(database).removeprefix("file://").partition("?")[0])
                if file.read_bytes()[18:20] == b"\2\2":  # a log beside the database would have to be made
                    raise sqlite3.OperationalError("unable to open database file")
                return real_connect(database, *arguments, **options)

            monkeypatch.setattr(os, "access", lambda path, *_, **__: Path(path) != folder)
            monkeypatch.setattr(os, "open", os_open)
            monkeypatch.setattr(sqlite3, "connect", connect)

    yield make
    monkeypatch.undo()


@pytest.mark.skipif(sys.platform == "win32", reason="folders have no such permissions there")
def test_a_finished_study_in_a_read_only_folder_is_opened_reported_and_not_run_again(tmp_path, read_only, capsys):
    folder = tmp_path / "theirs"
    folder.mkdir()
    (folder / "case.yaml").write_text(repr(CASE))
    study = {"percuss-study": 1, "cases": [str(folder / "case.yaml")], "vary": {"time.courant": [0.4, 0.5]}}
    out = folder / "a.sqlite"
    percuss.study(study, out, workers=1)
    read_only(folder)
    assert percuss.open_study(out).counts == {"done": 2}
    again = percuss.study(study, out, workers=1)
    assert (again.found, again.counts) == (2, {"done": 2})
    more = {**study, "vary": {"time.courant": [0.4, 0.5, 0.6]}}
    with pytest.raises(InputError, match="cannot write here: Permission denied\n  Name another file with -o"):
        percuss.study(more, out, workers=1)
    with pytest.raises(SystemExit) as ended:
        app(["report", str(out)])
    assert ended.value.code == 2
    assert "a.html: cannot write here: Permission denied\n  Name another file or folder." in capsys.readouterr().err


# ------------------------------------------------------------------------------------- other commands


def test_ctrl_c_ends_a_comparison_and_a_verification(monkeypatch, tmp_path):
    """The run that it ended is no row, and no result that differs."""
    case = percuss.load(places.CASES / "hunek.yaml", {"refine": 0.1})
    percuss.run(case).save(tmp_path / "hunek.nc")
    real = runner._run

    def ended(*arguments, **options):
        result = real(*arguments, **options)
        result.summary["status"] = "interrupted"
        return result

    monkeypatch.setattr(runner, "_run", ended)
    with pytest.raises(KeyboardInterrupt):
        percuss.compare(case, contacts=["lagrange", "penalty"])
    with pytest.raises(KeyboardInterrupt):
        rerun(tmp_path / "hunek.nc")
