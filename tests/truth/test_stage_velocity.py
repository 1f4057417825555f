"""Velocities at the stages of multi-stage schemes, for loads that follow the motion: order, refusals, the kit."""

import math

import numpy as np
import pytest

import percuss
from percuss.testing.demands.integrators import check_stages
from percuss.testing.subject import CheckFailed, Subject
from strategies import REGISTRY

SCHEME = '''
from dataclasses import dataclass
from percuss import Integrator, Stages, accelerations


@dataclass(frozen=True)
class Centred(Integrator):
    """Velocity Verlet whose loads act at the velocity of the stage.

    Formula: that of velocity Verlet.
    """

    name = "centred"
    summary = "Velocity Verlet with velocities at its stage"
    order = 2
    kept = 1

    def bind(self, dt):
        return Stages(times=(1.0,), velocity=VELOCITY)

    @staticmethod
    def step(numbers, system, u, v, kept, dt):
        v += 0.5 * dt * kept[0]
        u += dt * v
        accelerations(system, 0, u, v, kept[0])
        v += 0.5 * dt * kept[0]
'''


def scheme(folder, velocity):
    file = folder / "centred.py"
    file.write_text(SCHEME.replace("VELOCITY", velocity), encoding="utf-8")
    return [file]


def damped(integrator, steps):
    """Return a mass of 1 on a spring of 1 with a dashpot of 0.6 under a smooth force, from rest, until t = 4."""
    bar = {"bar": {"length": 1.0, "elements": 1}, "material": {"young": 1.0, "density": 2.0}, "area": 1.0}
    return {
        "percuss": 1,
        "bodies": {"a": {**bar, "velocity": 1.0, "fixed": ["left"]}},
        "loads": {"dashpot": {"spring-dashpot": {"stiffness": 0.0, "damping": 0.6}, "on": "a.right"}},
        "method": {"integrator": integrator},
        "time": {"steps": steps, "step": 4.0 / steps},
        "record": {"probes": ["a.right"]},
    }


def order(integrator, files=(), *, compiled=False):
    errors = []
    for steps in (80, 160):
        result = percuss.run(percuss.load(damped(integrator, steps), plugins=files), compiled=compiled)
        t = result.arrays["time"]
        omega = math.sqrt(1.0 - 0.3**2)
        exact = np.exp(-0.3 * t) * np.sin(omega * t) / omega
        errors.append(np.abs(result.arrays["displacement"][:, 0, 0] - exact).max())
        assert result.summary["momentum"]["balanced"]
    return math.log2(errors[0] / errors[1])


@pytest.mark.parametrize("compiled", [False, True], ids=["plain", "compiled"])
def test_a_dashpot_leaves_second_order_with_the_velocity_of_the_stage(compiled, tmp_path):
    """Against the exact damped oscillation; at the velocity that is handed over, half a step before, it is first."""
    assert order("centred", scheme(tmp_path, "(dt / 2,)"), compiled=compiled) == pytest.approx(2.0, abs=0.1)
    if not compiled:
        assert order("velocity-verlet") == pytest.approx(1.0, abs=0.1)


def test_it_is_the_leap_frog_with_a_dashpot(tmp_path):
    """The velocity at a stage of velocity Verlet is the mean of those half a step before and after it."""
    one = percuss.run(percuss.load(damped("centred", 50), plugins=scheme(tmp_path, "(dt / 2,)")), compiled=False)
    other = percuss.run(percuss.load(damped("central-difference", 50)), compiled=False)
    # They start unlike, as central difference leaves the dashpot out of its first half step; the recurrence is one.
    a, b = (result.arrays["displacement"][:, 0, 0] for result in (one, other))
    dt = 4.0 / 50
    residual = [(x[2:] - 2 * x[1:-1] + x[:-2]) / dt**2 + 0.6 * (x[2:] - x[:-2]) / (2 * dt) + x[1:-1] for x in (a, b)]
    assert np.abs(residual[0]).max() < 1e-11
    assert np.abs(residual[1]).max() < 1e-11


@pytest.mark.parametrize("velocity", ["(-dt,)", "(dt / 2, dt)", "(float('nan'),)"])
def test_wrong_velocities_are_told(velocity, tmp_path):
    with pytest.raises(percuss.PluginError, match=r"Stages(\.velocity needs a number of at least 0| need)"):
        percuss.run(percuss.load(damped("centred", 5), plugins=scheme(tmp_path, velocity)))


def test_the_kit_holds_velocities_against_the_times(tmp_path):
    for velocity, right in (("(dt / 2,)", True), ("(dt,)", False)):
        case = percuss.load(damped("centred", 5), plugins=scheme(tmp_path, velocity))
        subject = Subject.of(type(case.method.integrator), REGISTRY)
        if right:
            check_stages(subject)
            continue
        with pytest.raises(CheckFailed, match="`velocity` of stage 0 gives"):
            check_stages(subject)
