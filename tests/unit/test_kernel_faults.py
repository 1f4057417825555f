"""Kernels that fail in the middle of a run: one message with law, contact or line, step and time; and nothing kept."""

import re

import numpy as np
import pytest

import percuss
from percuss.jit import jit_disabled
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from strategies import bar, case_of

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
            multiplier[p] = force
'''
CASE = case_of(
    {"a": bar(1.0, 4, velocity=1.0), "b": bar(1.0, 4, 1.0)},
    {"tip": {"between": ["a.right", "b.left"]}, "stop": {"body": "b.right", "wall": 2.0}},
    {"end": 0.3, "courant": 0.5, "on_unstable": "warn"},
)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    file = tmp_path_factory.mktemp("laws") / "faulty.py"
    file.write_text(LAW, encoding="utf-8")
    return file


def made(file, mistake, *, compiled):
    """Return a march that was made, and what it left."""
    law = {"name": "faulty", "mistake": mistake}
    case = percuss.load({**CASE, "method": {"integrator": "central-difference", "contact": law}}, plugins=[file])
    march = March(model_of(case), compiled=compiled)
    outcome = march.run()
    assert outcome.kernels.compiled is compiled or jit_disabled(), outcome.kernels.reasons
    return march, outcome


BOTH = pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "plain"])


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
    assert re.match(r"the kernel at \S+faulty\.py:\d+ was called with gap ", outcome.stop.cause)


@BOTH
def test_an_error_in_the_march_is_one_message(file, compiled):
    with pytest.raises(percuss.PluginError) as raised:
        made(file, 4, compiled=compiled)
    line = 1 + LAW[: LAW.index("raise ValueError")].count("\n")
    text = str(raised.value)
    assert text.startswith(f"{file}:{line}: contact law faulty: multipliers: ValueError: too late")
    assert len(text.splitlines()) == 1
    assert "at time 0.1" in text
    assert "(in step " in text
