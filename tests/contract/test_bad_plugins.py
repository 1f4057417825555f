"""Plug-ins with a misdeed: each is named with file and line, in a run and in a study, which goes on.

The plug-ins are the templates of `percuss new` with one line put into one method.
"""

import gc
import itertools
import json
import os
import re
import signal
import subprocess
import sys
import warnings

import numpy as np
import pytest

import percuss
from command_line import percuss_command
from fake_studies import TWO_BARS

# What a plug-in does in one line, and what is said of it beside file and line.
FAR = {
    "a generator's exit": ("raise GeneratorExit('g')", "GeneratorExit: g"),
    "an interrupt": ("raise KeyboardInterrupt", "KeyboardInterrupt"),
    "a cancellation": ("raise asyncio.CancelledError", "CancelledError"),
    "its own": ("raise type('Own', (BaseException,), {})('mine')", "Own: mine"),
    "a group": (
        "raise BaseExceptionGroup('many', [KeyboardInterrupt()])",
        "BaseExceptionGroup: many (1 sub-exception)",
    ),
    "an end of iteration": ("raise StopIteration", "StopIteration"),
    "no text": (
        "raise type('Mute', (Exception,), {'__str__': lambda self: 1 / 0})",
        "Mute: its text cannot be shown (ZeroDivisionError)",
    ),
    "a wrong input": ("raise percuss.InputError('x')", "InputError: x"),
    "a stop of a run": ("raise percuss.RunError('x')", "RunError: x"),
    "aborts": ("os.abort()", "a plug-in ends the process (None): raise an error instead"),
    "closes files": (
        "os.closerange(0, 256)",
        "os.closerange closes file 0, which percuss needs",
    ),
    "closes a stream": ("os.close(2)", "os.close closes file 2, which percuss needs"),
    "overwrites numpy": ("np.zeros = np.ones", "overwrites numpy.zeros, which others use too"),
    "overwrites Python": ("builtins.len = lambda it: 1", "overwrites builtins.len, which others use too"),
    "overwrites a class": ("percuss.ContactLaw.refuses = None", "overwrites ContactLaw.refuses, which others use too"),
}
QUICK_FAR = {
    ("at_import", "an interrupt"), ("at_import", "overwrites numpy"), ("at_options", "a generator's exit"),
    ("at_options", "overwrites Python"), ("at_bind", "an interrupt"), ("at_bind", "no text"),
    ("at_bind", "closes files"), ("at_bind", "overwrites a class"), ("at_bind", "a stop of a run"),
}  # fmt: skip
LATER = ("its own", "a group", "an end of iteration", "no text", "a wrong input", "overwrites Python")
FAR_PLUGIN = """
import asyncio, builtins, gc, math, os, sys
import numpy as np
import percuss
from dataclasses import dataclass
from percuss import ContactLaw, LinearLaw
{at_import}

@dataclass(frozen=True)
class Far(ContactLaw):
    '''A penalty.'''

    name = "far"
    summary = "A penalty"

    def __post_init__(self):
        {at_options}

    def bind(self, points, dt):
        {at_bind}
        return LinearLaw(at="explicit", sigma=4.0 / points.stiffness)
"""
PLACES = ("at_import", "at_options", "at_bind")
FAR_CASE = {**TWO_BARS, "method": {"contact": "penalty"}, "time": {"steps": 4, "courant": 0.5}}


@pytest.fixture
def far(tmp_path, monkeypatch):
    """Return a function that writes a plug-in with a line at a place, and that returns file and line of it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("numba.config.DISABLE_JIT", True)
    (tmp_path / "case.yaml").write_text(json.dumps(FAR_CASE))

    def write(place, line):
        text = FAR_PLUGIN.format(**{**dict.fromkeys(PLACES, "pass"), place: line})
        (tmp_path / "far.py").write_text(text)
        return f"far.py:{1 + text.partition(line)[0].count(chr(10))}: "

    return write


@pytest.mark.parametrize(
    ("place", "deed"),
    [
        pytest.param(place, deed, marks=() if (place, deed) in QUICK_FAR else pytest.mark.deep)
        for place, deed in itertools.product(PLACES, FAR)
    ],
)
def test_a_plug_in_that_goes_far_is_named(far, place, deed):
    line, said = FAR[deed]
    said = "SystemExit" if (place, deed) == ("at_import", "aborts") else said
    where = far(place, line)
    done = percuss_command("run", "case.yaml", "--plugin", "far.py", "--set", "method.contact=far")
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert f"{where}{said}" in done.stderr
    assert "Traceback" not in done.stderr
    assert (np.zeros(1), len([])) == (0.0, 0)


@pytest.mark.parametrize(
    "deed", ["an interrupt", "overwrites numpy", *(pytest.param(deed, marks=pytest.mark.deep) for deed in LATER)]
)
def test_a_plug_in_that_goes_far_costs_its_own_runs_alone(far, deed):
    line, said = FAR[deed]
    where = far("at_bind", line)
    study = {"percuss-study": 1, "cases": ["case.yaml"], "methods": {"contacts": ["far", "penalty"]}}
    bad, good = percuss.study(study, workers=1, plugins=["far.py"]).as_records()
    assert (bad["status"], good["status"]) == ("failed", "done")
    assert f"{where}{said}" in bad["reason"]


def test_a_measure_that_goes_far_costs_its_own_runs_alone(far, tmp_path):
    far("at_bind", "pass")
    measure = "@dataclass(frozen=True)\nclass M(percuss.Measure):\n    'm'\n    name = 'm'\n    summary = 'm'\n"
    with (tmp_path / "far.py").open("a") as file:
        file.write(f"\n\n{measure}    def of(self, result):\n        raise GeneratorExit\n")
    study = {"percuss-study": 1, "cases": ["case.yaml"], "measure": ["m"]}
    (row,) = percuss.study(study, workers=1, plugins=["far.py"]).as_records()
    assert row["status"] == "failed"
    assert re.search(r"measure m: .*far\.py:\d+: GeneratorExit", row["reason"])


CHANGES = {
    "errors of numpy": ("np.seterr(all='raise')", np.geterr),
    "garbage": ("gc.disable()", gc.isenabled),
    "folder": ("os.chdir('/')", os.getcwd),
    "switches": ("sys.setswitchinterval(1.0)", sys.getswitchinterval),
    "warnings": ("__import__('warnings').simplefilter('error')", lambda: warnings.filters[:]),
    "Ctrl-C": ("__import__('signal').signal(2, lambda *_: None)", lambda: signal.getsignal(signal.SIGINT)),
}


@pytest.mark.parametrize("place", ["at_bind", pytest.param("at_import", marks=pytest.mark.deep)])
@pytest.mark.parametrize("change", CHANGES)
def test_what_a_plug_in_changes_for_others_is_put_back(far, place, change):
    line, state = CHANGES[change]
    far(place, line)
    before = state()
    percuss.run(percuss.load({**FAR_CASE, "method": {"contact": "far"}}, plugins=["far.py"]))
    assert state() == before


NO_NUMBERS = {"an object": "object", "a complex number": "complex", "a text": "str", "more digits": "np.longdouble"}


@pytest.mark.parametrize("kind", NO_NUMBERS)
def test_what_is_no_real_number_is_told_at_the_plug_in(far, kind):
    far("at_bind", f"return LinearLaw(at='explicit', sigma=np.ones(1).astype({NO_NUMBERS[kind]}))")
    case = percuss.load({**FAR_CASE, "method": {"contact": "far"}}, plugins=["far.py"])
    with pytest.raises(percuss.PluginError, match=r"far\.py:\d+: contact law far: .*, expected (real )?numbers"):
        percuss.run(case)


def test_a_crash_names_the_line_of_the_plug_in(far, tmp_path):
    where = far("at_import", "__import__('ctypes').string_at(0)")
    command = [sys.executable, "-m", "percuss", "plugins", "--plugin", "far.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == -signal.SIGSEGV
    assert f'far.py", line {where.split(":")[1]}' in done.stderr


def test_an_error_that_nothing_catches_is_one_line(far, tmp_path):
    at_bind = "t = __import__('threading').Thread(target=lambda: 1 / 0); t.start(); t.join()"
    where = far("at_bind", at_bind)
    command = [
        sys.executable,
        "-m",
        "percuss",
        "check",
        "case.yaml",
        "--plugin",
        "far.py",
        "--set",
        "method.contact=far",
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    (line,) = [line for line in done.stderr.splitlines() if "ZeroDivisionError" in line]
    assert f"{where}ZeroDivisionError: division by zero; nothing catches it here" in line
    assert "Traceback" not in done.stderr


FATES = """
import ctypes, os, signal, sys, time
from dataclasses import dataclass
from percuss import ContactLaw, LinearLaw


@dataclass(frozen=True)
class Fated(ContactLaw):
    '''A penalty with a fate.'''

    name = "fated"
    summary = "A penalty with a fate"
    fate: str = "none"

    def bind(self, points, dt):
        if self.fate == "raises":
            raise RuntimeError("plan B")
        if self.fate == "exits":
            os._exit(3)
        if self.fate == "endless":
            while True: pass
        if self.fate == "crashes":
            os.kill(os.getpid(), signal.SIGSEGV)
        if self.fate == "is killed":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.fate == "prints":
            os.write(1, b"HELLO")
            print("HELLO")
        return LinearLaw(at="explicit", sigma=4.0 / points.stiffness)
"""


def line_of(text):
    return 1 + FATES[: FATES.index(text)].count("\n")


@pytest.mark.deep
def test_a_study_goes_on_whatever_a_plug_in_does(tmp_path):
    (tmp_path / "case.yaml").write_text(json.dumps({**FAR_CASE, "method": {"contact": "fated"}}))
    (tmp_path / "fates.py").write_text(FATES)
    fates = {
        "none": ("done", ""),
        "raises": ("failed", f"fates.py:{line_of('raise Run')}: RuntimeError: plan B"),
        "exits": ("failed", f"fates.py:{line_of('os._exit')}: a plug-in ends the process (3)"),
        "endless": ("failed", f"fates.py:{line_of('while')}: no step was completed for 8 s (`stalled_after`"),
        "crashes": ("failed", f"fates.py:{line_of('os.kill')}: its worker process died 3 times here: Segmentation"),
        "is killed": ("lost", "its worker process died 3 times"),
        "prints": ("done", ""),
    }
    study = {"percuss-study": 1, "cases": ["case.yaml"], "stalled_after": 8, "vary": {"method.contact.fate": [*fates]}}
    (tmp_path / "study.yaml").write_text(json.dumps(study))
    options = ["--plugin", "fates.py", "--json", "--workers", "2"]
    command = [sys.executable, "-m", "percuss", "study", "study.yaml", *options]
    plain = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, cwd=tmp_path, env=plain, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    rows = {row["method.contact.fate"]: row for row in json.loads(done.stdout)["rows"]}
    for fate, (status, reason) in fates.items():
        assert rows[fate]["status"] == status, rows[fate]
        assert reason in rows[fate]["reason"]
