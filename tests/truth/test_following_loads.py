"""Loads that follow the motion of an end: against exact solutions, the ledger and the limits of the schemes."""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import percuss
import places
from percuss.certificate.black_box import BlackBox
from percuss.certificate.linear_laws import linear_laws
from percuss.certificate.verdict import certificate
from percuss.march.model_of_case import model_of
from percuss.march.parts import features_of
from strategies import CD, CORE, INTEGRATORS, INVISCID, STEEL, bar, case_of, each_integrator, number, run, with_methods

# of the bars c = 100, and of unit area impedance 1


def under(loads, integrator=CD, elements=50, courant=1.0, end=0.4, velocity=0.0, length=10.0):
    """A free bar under `loads`."""
    time = {"end": end, "courant": courant}
    return case_of({"bar": bar(length, elements, velocity=velocity)}, {}, time, loads, integrator)


PUSH = {"half-sine": {"peak": 1.0, "duration": 0.05}, "on": "bar.left"}
ABSORBING = {"absorbing": {}, "on": "bar.right"}


def mount(stiffness=0.0, damping=0.0, on="bar.right", **more):
    return {"spring-dashpot": {"stiffness": stiffness, "damping": damping}, "on": on, **more}


# ---------------------------------------------------------------------------------------------- exact solutions


def test_at_courant_number_one_an_absorbing_end_reflects_nothing():
    """Central difference is exact there: the pulse leaves to the last bit of its energy, 0.025 = Z int v^2 dt."""
    result = run(under({"push": PUSH, "end": ABSORBING}))
    total = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
    assert total.max() == pytest.approx(0.025, rel=1e-3)
    assert total[-1] < 1e-28
    assert result.summary["energy"]["ledger_error"] < 1e-14
    assert result.summary["momentum"]["error"] < 1e-14


@each_integrator(INTEGRATORS)
def test_a_bar_on_a_mount_is_the_damped_oscillator_of_its_nodes(integrator):
    """One element with both nodes free, one of them on a spring and a dashpot: by the exponential of its matrix."""
    from scipy.linalg import expm

    stiffness, mass, k, c, speed = 40.0, 0.5, 25.0, 0.9, 1.0
    bulk = np.array([[stiffness, -stiffness], [-stiffness, stiffness + k]]) / mass
    rates = np.block([[np.zeros((2, 2)), np.eye(2)], [-bulk, -np.diag([0.0, c / mass])]])
    errors = []
    for steps in (400, 800):
        case = under({"mount": mount(k, c)}, integrator=integrator, elements=1, velocity=speed, length=1.0)
        case["bodies"]["bar"]["material"] = {"young": stiffness, "density": 2 * mass}
        case["time"] = {"end": 2.0, "step": 2.0 / steps}
        result = run(case)
        exact = np.array([expm(rates * t) @ [0.0, 0.0, speed, speed] for t in result.arrays["time"]])
        errors.append(np.abs(result.arrays["displacement"][:, :, 0] - exact[:, :2]).max())
    assert errors[0] < 2e-3
    order = 2.0 if integrator in INVISCID else 1.0
    assert math.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.15)


@dataclass(frozen=True)
class Friction(percuss.FollowingLoad):
    """Coulomb friction of an end.

    Formula: ``F = -f sign(v)``.
    """

    name = "friction"
    summary = "Coulomb friction"
    limit: float = 0.5

    def numbers(self, end):
        return (self.limit,)

    @staticmethod
    def follow(numbers, time, displacement, velocity):
        if velocity > 0.0:
            return -numbers[0]
        return numbers[0] if velocity < 0.0 else 0.0


@dataclass(frozen=True)
class Clock(percuss.FollowingLoad):
    """Formula: ``F = t``, counted since the load was switched on."""

    name = "clock"
    summary = "its own time"

    def numbers(self, end):
        return ()

    @staticmethod
    def follow(numbers, time, displacement, velocity):
        return time


REGISTRY = with_methods(Friction, Clock)


def test_a_sliding_bar_is_stopped_by_friction_after_its_exact_distance():
    """A force mu N sign(v) has its jump at rest: the solution stays there, at v0^2 m / (2 mu N)."""
    since = {"on": "bar.left", "from": 0.1}
    own, ramp = (
        percuss.run(
            percuss.load(under({"one": {**load, **since}}, elements=5, courant=0.5, end=0.3), registry=REGISTRY)
        )
        for load in ({"clock": {}}, {"table": {"time": [0, 1], "value": [0, 1]}})
    )
    assert np.allclose(own.arrays["velocity"], ramp.arrays["velocity"], rtol=0.0, atol=1e-12)
    case = under(
        {"drag": {"friction": {}, "on": "bar.left"}}, elements=1, velocity=1.0, length=1.0, courant=0.1, end=0.2
    )
    case["bodies"]["bar"]["material"] = {"young": 1e4, "density": 0.02}
    result = percuss.run(percuss.load(case, registry=REGISTRY))
    distance = result.arrays["displacement"].mean(axis=1)[:, 0]
    assert distance[-1] == pytest.approx(0.02 * 1.0 / (2 * 0.5), rel=2e-3)
    assert np.abs(result.arrays["velocity"][-200:, 0]).max() < 1e-12  # the end with friction rests, to the last
    assert result.summary["energy"]["ledger_error"] < 1e-12
    found = certificate(model_of(percuss.load(case, registry=REGISTRY)))
    assert found["stable"] == "unknown"
    assert "no sum of a spring and a dashpot" in found["why"]
    with pytest.raises(percuss.InputError, match="expected loads of which the critical step is known"):
        percuss.run(percuss.load(case, {"time": {"end": 0.1, "courant": "auto"}}, registry=REGISTRY))


# ------------------------------------------------------------------------------------------- accounts and switches


@given(
    stiffness=number(0.0, 30.0),
    damping=number(0.0, 300.0),
    start=st.sampled_from([None, 0.0, 0.0301]),
    stop=st.sampled_from([None, 0.0605]),
    integrator=st.sampled_from([name for name in CORE if name != "noh-bathe"]),
)
def test_energy_and_momentum_are_accounted_for_and_a_dashpot_takes_energy(stiffness, damping, start, stop, integrator):
    switches = {"from": start, "until": stop}
    case = under({"mount": mount(stiffness, damping, **switches)}, integrator=integrator, elements=5, velocity=1.0,
               end=0.15, courant=0.9)  # fmt: skip
    result = run(case)
    assert result.summary["energy"]["ledger_error"] < 1e-12
    assert result.summary["momentum"]["error"] < 1e-12
    if stiffness == 0.0:
        assert np.diff(result.arrays["external_work"]).max() <= 1e-15


# --------------------------------------------------------------------------------------------------- certificates


def test_the_critical_step_of_velocity_verlet_with_an_absorbing_end():
    """It evaluates the dashpot half a step late: by the dense matrix of the step, and by runs at steps about it."""
    case = under({"end": ABSORBING}, integrator="velocity-verlet", courant=0.5, elements=8)
    model = model_of(percuss.load(case))
    critical = certificate(model)["courant_critical"]
    mass, identity = model.bodies.mass[:, None], np.eye(9)
    stiffness = 8 * STEEL["young"] / 10.0 * (np.diff(identity, axis=0).T @ np.diff(identity, axis=0))
    dashpot = np.diag([0.0] * 8 + [1.0])

    def radius(courant):
        dt = courant * 2.0 / model.bodies.omega
        kick, damp = -dt * stiffness / mass, identity - dt * dashpot / mass
        return np.abs(np.linalg.eigvals(np.block([[identity + dt * kick, dt * damp], [kick, damp]]))).max()

    assert radius(critical * (1 - 1e-5)) < 1 + 1e-9
    assert radius(critical * (1 + 1e-3)) > 1 + 1e-3
    case["bodies"]["bar"]["velocity"] = 1.0
    for share, bounded in ((0.999, True), (1.01, False)):
        case["time"] = {"steps": 400, "courant": share * critical, "on_unstable": "warn"}
        assert bool(np.abs(run(case).arrays["velocity"]).max() < 2.0) is bounded
    case["time"]["on_unstable"] = "stop"
    with pytest.raises(percuss.RunError, match="is unstable with all contacts open"):
        run(case)


def test_linear_laws_and_black_box_agree_on_mounts():
    for stiffness, damping in ((0.0, 3.0), (400.0, 0.0), (150.0, 20.0)):
        case = under({"mount": mount(stiffness, damping)}, elements=4, courant=0.5)
        model = model_of(percuss.load(case))
        by_laws, by_step = (kind(model).critical_step for kind in (linear_laws, BlackBox))
        assert by_step == pytest.approx(by_laws, rel=1e-5)
        assert (by_laws < 2.0 / model.bodies.omega * (1 - 1e-9)) is (stiffness > 0.0)


def test_a_dashpot_that_drives_is_unstable():
    case = under({"drive": mount(damping=0.5)}, elements=4, courant=0.5)
    model = model_of(percuss.load(case))
    driven = model.loads.followers[0].__class__(**{**vars(model.loads.followers[0]), "numbers": (0.0, -0.5)})
    changed = dataclasses.replace(model, loads=model.loads._replace(followers=(driven,)))
    found = certificate(dataclasses.replace(changed, features=features_of(changed)))
    assert found["by"] == "black-box"
    assert found["stable"] == "no"


def test_a_load_that_follows_during_a_part_of_the_run_has_no_certificate():
    found = certificate(model_of(percuss.load(under({"mount": mount(1.0, 1.0, until=0.1)}, courant=0.5))))
    assert found["stable"] == "unknown"
    assert "during only a part of the run" in found["why"]


def test_the_critical_courant_number_of_the_page_is_true():
    page = (places.ROOT / "plugins" / "STABILITY.md").read_text(encoding="utf-8")
    case = under({"end": ABSORBING}, integrator="velocity-verlet", courant=0.5)
    critical = certificate(model_of(percuss.load(case)))["courant_critical"]
    assert f"`velocity-verlet` up to a Courant number of {critical:.3f} |" in page
