"""Kernels that fail in the middle of a run: one message with law, contact or line, step and time; and nothing kept."""

from pathlib import Path

import numpy as np
import pytest

import percuss
from percuss.cli.main import app
from percuss.jit import jit_disabled
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.methods.registry import Registry
from percuss.testing import CheckFailed, checks

LAW = '''
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from percuss import ContactLaw, Doc, Ge, Unit


class Bound(NamedTuple):
    stiffness: np.ndarray
    mistake: int
    late: float


@dataclass(frozen=True)
class Faulty(ContactLaw):
    """A spring that makes a mistake of some kind from some time on.

    Formula: ``lambda = k <-g>``.
    """

    name = "faulty"
    summary = "a spring with a mistake"
    mistake: Annotated[int, Ge(0), Unit("1"), Doc("which")] = 0
    late: Annotated[float, Ge(0), Unit("time"), Doc("from when on")] = 0.1

    def bind(self, points, dt):
        return Bound(0.25 * points.stiffness, self.mistake, self.late)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        late = trial.time > bound.late
        for p in range(multiplier.size):
            force = max(-bound.stiffness[p] * trial.gap[p], 0.0)
            if late and p == 1 and bound.mistake == 1:
                continue
            if late and p == 1 and bound.mistake == 2:
                force = multiplier[p] * 0.5
            if late and p == 1 and bound.mistake == 3:
                force = np.sqrt(-1.0 - force)
            if late and bound.mistake == 4:
                raise ValueError("too late")
            if late and bound.mistake == 5:
                force = bound.stiffness[int(trial.time * 1e9)]
            multiplier[p] = force
'''
LINE = {name: 1 + LAW[: LAW.index(text)].count("\n") for name, text in (
    ("raise", 'raise ValueError("too late")'), ("index", "force = bound.stiffness[int("),
)}  # fmt: skip

CASE = {
    "percuss": 1,
    "bodies": {
        "a": {"bar": {"length": 1.0, "elements": 4}, "material": {"young": 100.0, "density": 0.01}, "area": 1.0,
              "velocity": 1.0},
        "b": {"bar": {"length": 1.0, "elements": 4}, "material": {"young": 100.0, "density": 0.01}, "area": 1.0,
              "at": 1.0},
    },
    "contacts": {"tip": {"between": ["a.right", "b.left"]}, "stop": {"body": "b.right", "wall": 2.0}},
    "method": {"integrator": "central-difference", "contact": "faulty"},
    "time": {"end": 0.3, "courant": 0.5, "on_unstable": "warn"},
}  # fmt: skip


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    file = tmp_path_factory.mktemp("laws") / "faulty.py"
    file.write_text(LAW, encoding="utf-8")
    return file


def made(file, mistake, *, compiled, integrator="central-difference"):
    """Return a march that was made, and what it left."""
    law = {"name": "faulty", "mistake": mistake}
    case = percuss.load({**CASE, "method": {"integrator": integrator, "contact": law}}, plugins=[file])
    march = March(model_of(case), compiled=compiled)
    outcome = march.run()
    assert outcome.kernels.compiled is compiled or jit_disabled(), outcome.kernels.reasons
    return march, outcome


BOTH = pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "plain"])


@BOTH
def test_without_a_mistake_it_runs(file, compiled):
    _, outcome = made(file, 0, compiled=compiled)
    assert outcome.status == "done"
    assert outcome.sums.impulse.min() > 0


MISTAKES = {
    1: ("law faulty leaves the multiplier of contact 'stop' unset", "every branch of its kernel has to set every"),
    2: ("law faulty uses the multiplier of contact 'stop' before it has set it", "every branch of its kernel"),
    3: ("law faulty computes a multiplier of contact 'stop' that is not a number", "the root of a negative number"),
}


@BOTH
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_multiplier_that_is_not_set_stops_the_run_and_is_named(file, mistake, compiled):
    march, outcome = made(file, mistake, compiled=compiled)
    dt = march.model.dt
    assert outcome.status == "unstable"
    assert outcome.stop.step == np.floor(0.1 / dt) + 1
    body = march.model.bodies.at(outcome.stop.node)
    assert (body.name, outcome.stop.node - body.start) == ("b", 4)
    what, cause = MISTAKES[mistake]
    assert outcome.stop.what == what
    assert cause in outcome.stop.cause
    assert "the kernel was called with gap " in outcome.stop.cause


def test_of_a_scheme_of_stages_it_is_named_too(file):
    _, outcome = made(file, 1, compiled=False, integrator="noh-bathe")
    assert outcome.stop.what == MISTAKES[1][0]
    with pytest.raises(percuss.PluginError, match=r"faulty\.py:\d+: contact law faulty: multipliers: ValueError: too"):
        made(file, 4, compiled=False, integrator="noh-bathe")


@BOTH
@pytest.mark.parametrize(
    ("mistake", "what", "line"), [(4, "ValueError: too late", "raise"), (5, "IndexError: ", "index")]
)
def test_an_error_in_the_march_is_one_message(file, compiled, mistake, what, line):
    with pytest.raises(percuss.PluginError) as raised:
        made(file, mistake, compiled=compiled)
    text = str(raised.value)
    assert len(text.splitlines()) == 1
    assert text.startswith(f"{file}:{LINE[line]}: contact law faulty: multipliers: {what}")
    assert "at time 0.1" in text
    assert "(in step " in text


@pytest.mark.slow
def test_the_command_line_prints_the_message_and_writes_nothing(file, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("numba.config.DISABLE_JIT", True)
    import json

    Path("case.json").write_text(json.dumps(CASE), encoding="utf-8")
    Path("case.yaml").write_text(Path("case.json").read_text(encoding="utf-8"), encoding="utf-8")
    with pytest.raises(SystemExit) as left:
        app(["run", "case.yaml", "--plugin", str(file), "--set", "method.contact.mistake=4", "-o", "out.nc"])
    out, err = capsys.readouterr()
    assert left.value.code == 2, out + err
    assert len(err.splitlines()) == 1
    assert "faulty.py" in err
    assert "Traceback" not in err
    assert not Path("out.nc").exists()


WRITES = {
    "bound arrays": "bound.stiffness[p] = 1.0",
    "the trial": "trial.gap[p] = 0.0",
}


@BOTH
@pytest.mark.parametrize("what", WRITES)
def test_a_branch_that_writes_to_what_it_reads_is_refused(tmp_path, what, compiled):
    """It is never reached before time 0.1: compiled code does not begin, plain Python stops there."""
    file = tmp_path / "writes.py"
    line = "            multiplier[p] = force\n"
    file.write_text(
        LAW.replace(line, f"            if late:\n                {WRITES[what]}\n{line}"), encoding="utf-8"
    )
    with pytest.raises(percuss.PluginError) as raised:
        made(file, 0, compiled=compiled)
    assert str(raised.value).startswith(f"{file}:{1 + LAW[: LAW.index(line)].count(chr(10)) + 1}: ")
    assert "changes what it was handed" in str(raised.value)


SCHEME = '''
from dataclasses import dataclass

import numpy as np
from percuss import Integrator, Stages, accelerations


class Memory:
    steps = 0


@dataclass(frozen=True)
class Forgetful(Integrator):
    """Velocity Verlet with a mistake."""

    name = "forgetful"
    summary = "Verlet"
    order = 2
    kept = 1

    def bind(self, dt):
        return Stages(times=(1.0,))

    @staticmethod
    def step(numbers, system, u, v, kept, dt):
        v += 0.5 * dt * kept[0]
        u += dt * v
        accelerations(system, 0, u, v, kept[0])
        HERE
        v += 0.5 * dt * kept[0]
'''
KEEPS = {
    "class": "Memory.steps += 1; u += 1e-12 * Memory.steps * dt * kept[0]",
    "random": "u += 1e-12 * np.random.rand() * dt * kept[0]",
}


@pytest.mark.parametrize("how", KEEPS)
def test_the_kit_finds_a_scheme_that_remembers_elsewhere(tmp_path, how):
    file = tmp_path / "forgetful.py"
    file.write_text(SCHEME.replace("HERE", KEEPS[how]), encoding="utf-8")
    registry = Registry.load([file])
    check = dict(checks(registry.get("integrators", "forgetful"), registry=registry))["no-hidden-state"]
    with pytest.raises(CheckFailed, match="the second time"):
        check()
