"""Mistakes of ordinary plug-ins: one message that names the place, before anything runs, and no traceback."""

# ruff: noqa: E501  a line a mistake

from pathlib import Path

import pytest

from percuss.cli.main import app
from percuss.methods import first_run

LAW = '''
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from percuss import ContactLaw


class Bound(NamedTuple):
    e: float


SEEN = []
CALLS = 0


class Memory:
    deepest = 0.0


@dataclass(frozen=True)
class Mine(ContactLaw):
    """A law."""

    name = "mine"
    summary = "a law"

    def bind(self, points, dt):
        return Bound(0.0)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            multiplier[p] = max(-trial.predicted_gap[p] / (trial.delassus[p] * trial.gap_response), 0.0)
'''

SCHEME = '''
from dataclasses import dataclass

import numpy as np
from percuss import Integrator, Stages, accelerations


@dataclass(frozen=True)
class Mine(Integrator):
    """A scheme."""

    name = "mine"
    summary = "a scheme"
    order = 2
    kept = 1

    def bind(self, dt):
        return Stages(times=(1.0,))

    @staticmethod
    def step(numbers, system, u, v, kept, dt):
        v += 0.5 * dt * kept[0]
        u += dt * v
        accelerations(system, 0, u, v, kept[0])
        v += np.float64(0.5) * dt * kept[0]
'''

SET = "            multiplier[p] = max("
WRONG = {
    "an error in bind": (LAW, "return Bound(0.0)", "return points.wieght", "mine.py:29: AttributeError: 'ContactPoints'"),
    "bind returns nothing": (LAW, "return Bound(0.0)", "pass", "law mine: bind returned nothing, expected LinearLaw, or a Named"),
    "bind returns a mapping": (LAW, "return Bound(0.0)", "return {}", "bind returned a dict, expected LinearLaw"),
    "bind without self": (LAW, "bind(self, points", "bind(points", "Mine.bind(points, dt) is called as bind(self, points, dt)"),
    "a kernel of two": (
        LAW, "(bound, trial, multiplier)", "(bound, trial)",
        "Mine.multipliers(bound, trial) is called as multipliers(bound, trial, multiplier)",
    ),
    "no such state": (LAW, "trial.predicted_gap", "trial.gapp", "mine.py:34: contact law mine: multipliers: AttributeError"),
    "an error in the kernel": (LAW, SET, f'            raise ValueError("late")\n{SET}', "multipliers: ValueError: late"),
    "writes to its input": (LAW, SET, f"            trial.gap[p] = 0.0\n{SET}", "multipliers changes what it was handed to read"),
    "sets nothing": (LAW, SET, "            x = max(", "multipliers leaves the multiplier of point 0 of 1 unset: every branch"),
    "beyond the end": (LAW, "trial.delassus[p]", "trial.delassus[p + 7]", "mine.py:34: contact law mine: multipliers: IndexError"),
    "not a number": (LAW, "max(-", "max(np.nan * ", "multipliers computes a multiplier of point 0 of 1 that is not a number: its kernel divides by zero"),
    "keeps a list": (LAW, SET, f"            SEEN.append(p)\n{SET}", "multipliers changes `SEEN`: a kernel keeps nothing"),
    "keeps in a class": (
        LAW, SET, f"            Memory.deepest = max(Memory.deepest, -trial.gap[p])\n{SET}Memory.deepest, ",
        "when it is asked the same again: it keeps state between calls",
    ),
    "keeps in a global": (
        LAW, SET, f"            globals()['CALLS'] = CALLS + 1\n{SET}CALLS, ", "it keeps state between calls",
    ),
    "draws at random": (LAW, SET, f"{SET}1e-9 * np.random.rand(), ", "it keeps state between calls, draws random"),
    "keeps in a bound array": (
        LAW.replace("Bound(0.0)", "Bound(np.zeros(1))"), SET, f"            bound.e[0] += 1.0\n{SET}",
        "mine.py:34: contact law mine: multipliers changes what it was handed to read",
    ),
    "an index that turns negative": (
        LAW.replace("Bound(0.0)", "Bound(np.arange(1000.0))"), SET,
        f"{SET}bound.e[int(-trial.gap[p] / 1e-5)], ", "multipliers reads a bound array at index -100, which counts from its end",
    ),
    "a branch that sets nothing": (
        LAW, SET, f"            if trial.gap[p] < 0.0 and trial.rate[p] > 0.0:\n                continue\n{SET}",
        "unset: every branch of its kernel has to set every multiplier, 0.0 where nothing presses (at gap -1e-06",
    ),
    "no annotation": (LAW, '"a law"\n', '"a law"\n    k = 500.0\n', "Mine.k has no annotation, so that no case can set it"),
    "a name unknown in step": (SCHEME, "import numpy as np\n", "", "integrator mine: step: NameError: name 'np'"),
    "nothing kept": (SCHEME, "    kept = 1\n", "", "integrator mine: step: IndexError", "(`kept` is 0: say how many rows"),
    "wrong stages": (SCHEME, "times=", "time=", "mine.py:18: TypeError: Stages.__new__() got an unexpected keyword"),
    "a step of five": (
        SCHEME, "v, kept, dt)", "v, dt)",
        "Mine.step(numbers, system, u, v, dt) is called as step(numbers, system, u, v, kept, dt)",
    ),
}  # fmt: skip

CASE = """
percuss: 1
bodies:
  a: {bar: {length: 1, elements: 4}, material: {young: 100, density: 0.01}, area: 1, velocity: 1}
contacts: {w: {body: a.right, wall: 1}}
method: {PART: mine}
time: {steps: 4, courant: 0.5}
"""


@pytest.fixture
def ran(tmp_path, monkeypatch, capsys):
    """Run a plug-in on a case by the command line; return exit code, standard output and standard error."""
    monkeypatch.chdir(tmp_path)

    def run(text):
        Path("mine.py").write_text(text)
        part = "integrator" if "Integrator" in text else "contact"
        Path("case.yaml").write_text(CASE.replace("PART", part))
        with pytest.raises(SystemExit) as left:
            app(["run", "case.yaml", "--plugin", "mine.py", "-o", "out.nc"])
        return left.value.code, *capsys.readouterr()

    return run


@pytest.mark.slow
@pytest.mark.parametrize("text", [LAW, SCHEME], ids=["law", "scheme"])
def test_without_a_mistake_they_run(ran, text):
    code, _, err = ran(text)
    assert code == 0, err


@pytest.mark.parametrize("name", WRONG)
def test_a_mistake_is_one_message(ran, name):
    text, right, wrong, *said = WRONG[name]
    assert right in text
    code, out, err = ran(text.replace(right, wrong))
    assert code == 2, out + err
    assert err.startswith("error: ")
    assert len(err.splitlines()) == 1
    for one in said:
        assert one in err
    assert not Path("out.nc").exists()


class Everything:
    """The questions that a source has answered, if it has answered all of them."""

    def __contains__(self, question):
        return True

    def __rsub__(self, questions):
        return set()


# What a run need not find any more once the source has passed its first run; the kit finds it. All others are found in
# every run, or where the plug-in is loaded.
BEFORE_THE_FIRST_RUN = ("keeps a list", "draws at random", "an index that turns negative")


QUICK = {*BEFORE_THE_FIRST_RUN, "not a number", "nothing kept"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else pytest.mark.deep) for name in WRONG]
)
def test_a_mistake_is_found_in_every_run_or_else_by_the_kit(ran, name, monkeypatch, capsys):
    known = first_run.Answers._noted
    monkeypatch.setattr(first_run.Answers, "_noted", lambda self: Everything() if self.file else known(self))
    monkeypatch.setattr("numba.config.DISABLE_JIT", True)
    text, right, wrong, *_ = WRONG[name]
    code, *_ = ran(text.replace(right, wrong))
    assert code != 0 or name in BEFORE_THE_FIRST_RUN
    if name in BEFORE_THE_FIRST_RUN:
        with pytest.raises(SystemExit) as left:
            app(["verify", "--plugin", "mine.py", "--method", "mine"])
        assert left.value.code != 0
        assert "mine.py" in "".join(capsys.readouterr())
