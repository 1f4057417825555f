"""Ctrl-C in a run, in a compilation, in the finer run, in a comparison and in a verification."""

import contextlib
import json
import os
import signal

import pytest

import percuss
import places
from command_line import percuss_command
from fake_studies import TWO_BARS
from percuss.cli import common
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
        monkeypatch.setattr(reference, "recordable", lambda model: press() or model)
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
    monkeypatch.setattr(reference, "_march", lambda *_: pytest.fail("a finer run was made"))
    case = percuss.load({**CASE, "reference": {"refine": 2}})
    result = percuss.run(case, nudge=True, progress=lambda done, _: press() if done == 1 else None)
    assert (result.status, result.summary["steps"], result.summary["fragile"]) == ("interrupted", 1, None)


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
