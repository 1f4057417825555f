"""Kernels that fail in the middle of a run: one message with law, contact or line, step and time; and nothing kept."""

import re

import numpy as np
import pytest

import percuss
from marks import deep
from percuss.jit import jit_disabled
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from strategies import bar, case_of

LAW = '''
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from percuss import ContactLaw


class Bound(NamedTuple):
    stiffness: np.ndarray


@dataclass(frozen=True)
class Faulty(ContactLaw):
    """A spring that makes a mistake from some time on."""

    name = "faulty"
    summary = "a spring with a mistake"

    def bind(self, points, dt):
        return Bound(0.25 * points.stiffness)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            force = max(-bound.stiffness[p] * trial.gap[p], 0.0)
            if trial.time > 0.1 and p == 1:
                MISTAKE
            multiplier[p] = force
'''
CASE = case_of(
    {"a": bar(1.0, 4, velocity=1.0), "b": bar(1.0, 4, 1.0)},
    {"tip": {"between": ["a.right", "b.left"]}, "stop": {"body": "b.right", "wall": 2.0}},
    {"end": 0.3, "courant": 0.5, "on_unstable": "warn"},
)


def made(folder, mistake, *, compiled):
    """Return a march that was made, and what it left."""
    (folder / "faulty.py").write_text(LAW.replace("MISTAKE", mistake), encoding="utf-8")
    method = {"integrator": "central-difference", "contact": "faulty"}
    march = March(model_of(percuss.load({**CASE, "method": method}, plugins=[folder / "faulty.py"])), compiled=compiled)
    outcome = march.run()
    assert outcome.kernels.compiled is compiled or jit_disabled(), outcome.kernels.reasons
    return march, outcome


BOTH = pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "plain"])
MISTAKES = {
    "continue": (
        "law faulty leaves the multiplier of contact 'stop' unset", "every branch of its kernel has to set every",
    ),
    "force = 0.5 * multiplier[p]": (
        "law faulty uses the multiplier of contact 'stop' before it has set it", "every branch of its kernel",
    ),
    "force = np.sqrt(-1.0 - force)": (
        "law faulty computes a multiplier of contact 'stop' that is not a number", "the root of a negative number",
    ),
}  # fmt: skip


@BOTH
@pytest.mark.parametrize("mistake", [one if n == 0 else deep(one) for n, one in enumerate(MISTAKES)])
def test_a_multiplier_that_is_not_set_stops_the_run_and_is_named(tmp_path, mistake, compiled):
    march, outcome = made(tmp_path, mistake, compiled=compiled)
    assert outcome.status == "unstable"
    assert outcome.stop.step == np.floor(0.1 / march.model.dt) + 1
    body = march.model.bodies.at(outcome.stop.node)
    assert (body.name, outcome.stop.node - body.start) == ("b", 4)
    what, cause = MISTAKES[mistake]
    assert outcome.stop.what == what
    assert cause in outcome.stop.cause
    assert re.match(r"the kernel at \S+faulty\.py:\d+ was called with gap ", outcome.stop.cause)


@BOTH
def test_an_error_in_the_march_is_one_message(tmp_path, compiled):
    with pytest.raises(percuss.PluginError) as raised:
        made(tmp_path, 'raise ValueError("too late")', compiled=compiled)
    line, text = 1 + LAW[: LAW.index("MISTAKE")].count("\n"), str(raised.value)
    assert text.startswith(f"{tmp_path / 'faulty.py'}:{line}: contact law faulty: multipliers: ValueError: too late")
    assert len(text.splitlines()) == 1
    assert "at time 0.1" in text
    assert "(in step " in text
