"""Internal forces without loads and contacts, for multi-stage schemes: against dense matrices, and in a scheme."""

import math
import re

import numpy as np
import pytest

import dense
import percuss
import places
from percuss.certificate.verdict import certificate
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.methods.registry import Registry
from percuss.testing import CheckFailed, checks
from strategies import hunek

PAGE = (places.ROOT / "plugins" / "INTEGRATOR.md").read_text(encoding="utf-8")

# Keeps the accelerations of a step, and the internal forces of the displacement at which they were asked for.
KEEPER = """
from dataclasses import dataclass
import numpy as np
from percuss import Integrator, Stages, accelerations, internal


@dataclass(frozen=True)
class Keeper(Integrator):
    \"\"\"Velocity Verlet that keeps accelerations and internal forces.

    Formula: that of velocity Verlet.
    \"\"\"

    name = "keeper"
    summary = "Keeps internal forces"
    order = 2
    kept = 2

    def bind(self, dt):
        return Stages(times=(1.0,), end=((dt, dt**2, dt),))

    @staticmethod
    def step(numbers, system, u, v, kept, dt):
        v += 0.5 * dt * kept[0]
        u += dt * v
        accelerations(system, 0, u, v, kept[0])
        internal(system, 0, SCALE * u, kept[1])
        v += 0.5 * dt * kept[0]
"""


def keeper(folder, scale="1.0"):
    file = folder / "keeper.py"
    file.write_text(KEEPER.replace("SCALE", scale), encoding="utf-8")
    return [file]


@pytest.fixture(scope="module")
def gradient(tmp_path_factory):
    """The scheme with the gradient of the force that stands in the page."""
    text = re.search(r"[Ss]ave this as `force_gradient\.py`:\n\n```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    file = tmp_path_factory.mktemp("scheme") / "force_gradient.py"
    file.write_text(text.group(1), encoding="utf-8")
    return [file]


def marched(case, files, compiled):
    """March a case, and return the march with its state after the last step."""
    model = model_of(percuss.load(case, plugins=files))
    march = March(model)
    if compiled:
        march.compile()
    march.run()
    return march


def two_bars(integrator, steps=9):
    """Return a bar that hits one that is held, under its weight and a force, in contact from the first step on."""
    case = hunek(5, courant=0.6, integrator=integrator, contact={"name": "penalty", "beta_s": 0.5})
    case["bodies"]["long"]["fixed"] = ["right"]
    case["loads"] = {"weight": {"gravity": 3.0}, "push": {"constant": 0.02, "on": "short.left"}}
    case["time"] = {"steps": steps, "courant": 0.6}
    return case


@pytest.mark.parametrize("compiled", [False, True], ids=["plain", "compiled"])
def test_internal_forces_are_those_of_dense_matrices(compiled, tmp_path):
    """Nodes: M^-1 K u, zero at the support; then no contact force, the reaction that holds the support, no load."""
    case = two_bars("keeper")
    march = marched(case, keeper(tmp_path), compiled)
    u, kept = march.stepper.state.u, march.stepper.state.kept
    bars = dense.assemble(case)
    nodes = bars.x.size
    force = bars.K @ u[:nodes]
    support = bars.node("long.right")
    expected = force / np.diag(bars.M)
    assert abs(expected[support]) > 1e-6 * np.abs(expected).max()
    expected[support] = 0.0
    np.testing.assert_allclose(kept[1, :nodes], expected, atol=1e-12 * np.abs(expected).max())
    contact, *others = kept[1, nodes:]
    assert kept[0, nodes] > 0.0
    assert contact == 0.0
    # minus the reaction that would hold the end, as the forces on it are minus f_int
    assert others[0] == pytest.approx(-force[support], rel=1e-11)
    assert not any(others[1:])


def test_accelerations_without_loads_and_contacts_are_minus_internal_forces(tmp_path):
    """In every entry, reactions included, in one and three dimensions."""
    for direction in ([1.0], [2 / 3, 1 / 3, -2 / 3]):
        case = two_bars("keeper", steps=40)
        case["bodies"]["long"]["at"] = 30.0
        del case["contacts"], case["loads"]
        case["bodies"]["short"]["fixed"] = ["left"]
        case["bodies"]["short"]["velocity"] = 0.1
        if len(direction) > 1:
            for body in case["bodies"].values():
                body["bar"]["direction"] = direction
                body["at"] = [body.get("at", 0.0), 0.0, 0.0]
                body["velocity"] = [0.1 * one for one in direction]
        march = marched(case, keeper(tmp_path), False)
        kept = march.stepper.state.kept
        assert np.abs(kept[0]).max() > 0.0
        np.testing.assert_array_equal(kept[1], -kept[0])


def test_materials_remember_nothing_of_internal_forces(tmp_path):
    """A scheme that asks for the internal forces of ten times the strain makes the steps of velocity Verlet."""
    case = hunek(5, courant=0.5, integrator="velocity-verlet", contact={"name": "penalty", "beta_s": 0.5}, end=0.6)
    for body in case["bodies"].values():
        young, density = body["material"]["young"], body["material"]["density"]
        body["material"] = {
            "name": "bilinear-plastic", "young": young, "density": density,
            "yield_stress": 0.02, "tangent": 0.1,
        }  # fmt: skip
    one = percuss.run(percuss.load(case))
    assert one.summary["energy"]["dissipated"] > 0.0
    case["method"]["integrator"] = "keeper"
    for compiled in (True, False):
        other = percuss.run(percuss.load(case, plugins=keeper(tmp_path, "10.0")), compiled=compiled)
        for name in ("displacement", "contact_force", "dissipated_energy"):
            np.testing.assert_array_equal(one.arrays[name], other.arrays[name])


# ---------------------------------------------------------------------------------- the scheme in the page


def chin(acceleration, stiffness, u, v, a, dt):
    """One step of Chin's algorithm A for linear forces, from the operators exp(dt/6 V) exp(dt/2 T) exp(2/3 dt V~)."""
    v = v + dt / 6 * a
    u = u + dt / 2 * v
    a = acceleration(u)
    v = v + 2 / 3 * dt * (a - dt**2 / 24 * stiffness @ a)
    u = u + dt / 2 * v
    a = acceleration(u)
    return u, v + dt / 6 * a, a


@pytest.mark.parametrize("compiled", [False, True], ids=["plain", "compiled"])
def test_the_scheme_with_the_gradient_is_that_of_dense_matrices(compiled, gradient):
    """Contact, a support and a force included."""
    case = two_bars("force-gradient", steps=200)
    del case["loads"]["weight"]
    march = marched(case, gradient, compiled)
    bars = dense.assemble(case)
    dt, M = march.model.dt, np.diag(bars.M)
    support, left, right = (bars.node(end) for end in ("long.right", "long.left", "short.right"))
    normal = np.zeros(bars.x.size)
    normal[left], normal[right] = 1.0, -1.0
    eps = dense.penalties({"name": "penalty", "beta_s": 0.5}, [bars.end("short.right"), bars.end("long.left")], dt)[0]
    held = 1.0 / M
    held[support] = 0.0
    push = np.zeros(bars.x.size)
    push[bars.node("short.left")] = 0.02
    closed = []

    def acceleration(u):
        gap = bars.x[left] - bars.x[right] + normal @ u
        closed.append(gap < 0)
        return held * (push - bars.K @ u + eps * max(-gap, 0.0) * normal)

    u, v = np.zeros(bars.x.size), bars.v.copy()
    v[support] = 0.0
    a = acceleration(u)
    for _ in range(201):  # the last one makes the force of the last record
        u, v, a = chin(acceleration, held[:, None] * bars.K, u, v, a, dt)
    assert any(closed)
    assert not all(closed)
    np.testing.assert_allclose(march.stepper.state.u[: u.size], u, atol=1e-11 * np.abs(u).max())
    np.testing.assert_allclose(march.stepper.state.v[: u.size], v, atol=1e-10 * np.abs(v).max())


def test_its_order_with_a_load_is_four(gradient):
    """A mass of 1 on a spring of 1 under a smooth force."""
    errors, steps = [], [40, 80]
    for count in steps:
        case = {
            "percuss": 1,
            "bodies": {
                "a": {
                    "bar": {"length": 1.0, "elements": 1}, "material": {"young": 1.0, "density": 2.0},
                    "area": 1.0, "velocity": 1.0, "fixed": ["left"],
                }
            },
            "loads": {"push": {"harmonic": {"value": 0.7, "frequency": 0.3, "phase": 0.4}, "on": "a.right"}},
            "method": {"integrator": "force-gradient"},
            "time": {"steps": count, "step": 4.0 / count},
            "record": {"probes": ["a.right"]},
        }  # fmt: skip
        result = percuss.run(percuss.load(case, plugins=gradient), compiled=False)
        t, w = result.arrays["time"], 2 * math.pi * 0.3
        c = 0.7 / (1 - w**2)
        exact = c * np.sin(w * t + 0.4) - c * math.sin(0.4) * np.cos(t) + (1 - c * w * math.cos(0.4)) * np.sin(t)
        errors.append(np.abs(result.arrays["displacement"][:, 0, 0] - exact).max())
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.1)


def test_its_limit_is_the_root_of_twelve(gradient):
    """The trace of the step is 2 - x + x^2/12 - ..., which leaves [-2, 2] at x = (omega dt)^2 = 12."""
    case = two_bars("force-gradient")
    del case["contacts"], case["loads"]
    judged = certificate(model_of(percuss.load(case, plugins=gradient)))
    assert judged["stable"] == "yes"
    assert judged["courant_critical"] == pytest.approx(math.sqrt(3.0), rel=1e-6)


def test_a_closed_contact_is_no_spring_of_the_mesh(gradient):
    """The linear laws take contact and mesh alike, and here they are not: the black box decides."""
    case = two_bars("force-gradient")
    del case["loads"]
    judged = certificate(model_of(percuss.load(case, plugins=gradient)))
    assert judged["by"] == "black-box"
    assert 0.0 < judged["courant_critical"] < math.sqrt(3.0)


def test_the_kit_finds_a_stage_that_does_not_exist(tmp_path):
    file = keeper(tmp_path)[0]
    file.write_text(file.read_text().replace("internal(system, 0", "internal(system, 3"), encoding="utf-8")
    registry = Registry.load([file])
    with pytest.raises(CheckFailed, match="asks for stage 3"):
        dict(checks(registry.get("integrators", "keeper"), registry=registry))["stages"]()


def test_schemes_that_do_not_ask_for_internal_forces_compile_none():
    """The entrance of the internal forces is compiled for schemes that ask for them alone."""
    from percuss.step.integrator_check import kernel_of, uses_internal

    case = percuss.load(hunek(5, courant=0.5, integrator="velocity-verlet", contact={"name": "penalty"}))
    assert not uses_internal(kernel_of(case.method.integrator))
