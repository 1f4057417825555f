"""Schemes that are no leap-frog, as single files: against dense matrices, in their accounts, in what is refused."""

import functools
import math
import textwrap

import numpy as np
import pytest
from hypothesis import given

import dense
import percuss
import places
from percuss.certificate.black_box import BlackBox
from percuss.certificate.linear_laws import linear_laws
from percuss.certificate.maps import stability
from percuss.certificate.verdict import certificate, settled
from percuss.certificate.waves import waves
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.methods.registry import Registry
from percuss.reporting.explanation import explanation
from percuss.results.exact import exact_solution
from percuss.testing import CheckFailed, checks
from strategies import CORE, INTEGRATORS, LEAPFROG, REGISTRY, hunek, rows, with_pair

STAGED = [name for name in CORE if name not in LEAPFROG]
OTHERS = [name for name in INTEGRATORS if name not in (*CORE, *LEAPFROG)]  # in deep tests

HEAD = """
from dataclasses import dataclass
from typing import Annotated
import numpy as np
from percuss import Ge, Gt, Integrator, Le, Stages, Unit, accelerations


@dataclass(frozen=True)
"""
# files in the folder of the tests, not written anew: their machine code is kept from one run of the suite to the next
FOLDER = places.SUPPORT / "schemes"
OWN = sorted(path.stem for path in FOLDER.glob("*.py"))
VERLET = (FOLDER / "verlet.py").read_text(encoding="utf-8").partition("@dataclass(frozen=True)\n")[2]


@pytest.fixture(scope="session")
def files():
    """The schemes as single-file plug-ins."""
    return [FOLDER / f"{name}.py" for name in OWN]


def plugin(folder, text, name="mine.py"):
    (folder / name).write_text(HEAD + textwrap.dedent(text), encoding="utf-8")
    return [folder / name]


def go(case, files, overrides=None, **kwargs):
    return percuss.run(percuss.load(case, plugins=files), overrides, **kwargs)


# ------------------------------------------------------------------------------------------ against dense matrices

# one step of each scheme, from its formula: A(u, v, t, stage) are the accelerations, `a` what it keeps


def tchamwa_step(A, u, v, a, t, dt, phi=2 / 1.5):
    now = A(u, v, t, 0)
    return u + dt * v + phi * dt**2 * now, v + dt * now, a


def newmark_step(A, u, v, a, t, dt, gamma=0.6):
    u = u + dt * v + dt**2 / 2 * a
    after = A(u, v + dt * (1 - gamma) * a, t + dt, 0)
    return u, v + dt * ((1 - gamma) * a + gamma * after), after


def verlet_step(A, u, v, a, t, dt):
    half = v + dt / 2 * a
    u = u + dt * half
    after = A(u, half, t + dt, 0)
    return u, v + dt / 2 * (a + after), after


def alpha_step(A, u, v, a, t, dt, rho=0.8):
    m = (2 * rho - 1) / (1 + rho)
    b, g = (5 - 3 * rho) / (1 + rho) ** 2 / (2 - rho), 1.5 - m
    after = (A(u, v, t, 0) - m * a) / (1 - m)
    return u + dt * v + dt**2 * ((0.5 - b) * a + b * after), v + dt * ((1 - g) * a + g * after), after


def chung_lee_step(A, u, v, a, t, dt, beta=28 / 27):
    now = A(u, v, t, 0)
    return u + dt * v + dt**2 * ((0.5 - beta) * a + beta * now), v + dt * (1.5 * now - 0.5 * a), now


def hht_step(A, u, v, a, t, dt, alpha=-0.1):
    b, g = (1 - alpha) ** 2 / 4, 0.5 - alpha
    predicted = u + dt * v + (0.5 - b) * dt**2 * a
    after = A((1 + alpha) * predicted - alpha * u, v, t + (1 + alpha) * dt, 0)
    return predicted + b * dt**2 * after, v + dt * ((1 - g) * a + g * after), after


def noh_bathe_step(A, u, v, a, t, dt, p=0.54):
    q1 = (1 - 2 * p) / (2 * p * (1 - p))
    q2 = 0.5 - p * q1
    q0 = -q1 - q2 + 0.5
    d, e = p * dt, (1 - p) * dt
    up = u + d * v + d**2 / 2 * a
    ap = A(up, v + d / 2 * a, t + d, 0)
    vp = v + d / 2 * (a + ap)
    u1 = up + e * vp + e**2 / 2 * ap
    hat = vp + e * (q0 * a + (0.5 + q1) * ap)
    a1 = A(u1, hat, t + dt, 1)
    return u1, hat + e * q2 * a1, a1


def ends_of_noh_bathe(dt, p=0.54):
    q2 = 0.5 - p * (1 - 2 * p) / (2 * p * (1 - p))
    return [((1 - p) * dt, (1 - p) * dt**2 / 2), (p * dt, p * dt * (1 - p) * dt * q2 + (p * dt) ** 2 / 2)]


def start_of_a_half_step(dt, p=1.0):
    return p * dt, (p * dt) ** 2 / 2


START = -1  # instead of a stage, the last one: the acceleration that is kept before the first step
STARTS = {"verlet": start_of_a_half_step, "velocity-verlet": start_of_a_half_step,
          "explicit-newmark": start_of_a_half_step,
          "noh-bathe": functools.partial(start_of_a_half_step, p=0.54)}  # fmt: skip
SCHEMES = {
    "tchamwa": (tchamwa_step, lambda dt: [(dt, 2 / 1.5 * dt**2)]),
    "newmark": (newmark_step, None),
    "verlet": (verlet_step, lambda dt: [(dt, dt**2)]),
    "alpha": (alpha_step, None),
    "noh-bathe": (noh_bathe_step, ends_of_noh_bathe),
    # those that come with percuss
    "velocity-verlet": (verlet_step, lambda dt: [(dt, dt**2)]),
    "explicit-newmark": (functools.partial(newmark_step, gamma=0.5), lambda dt: [(dt, dt**2)]),
    "tchamwa-wielgosz": (functools.partial(tchamwa_step, phi=1.033), lambda dt: [(dt, 1.033 * dt**2)]),
    "hulbert-chung": (functools.partial(alpha_step, rho=0.4), None),
    "chung-lee": (chung_lee_step, None),
    "explicit-hht": (hht_step, None),
}


def march(case, steps, dt, scheme, law, push=None, drive=None):
    """March two bars in contact with full matrices; `push` and `drive` are (node, function of time)."""
    bars = dense.assemble(case)
    make, ends = SCHEMES[scheme]
    K, M, total = bars.K, bars.M, bars.x.size
    N = np.zeros(total)
    N[bars.node("short.right")], N[bars.node("long.left")] = -1.0, 1.0
    g0 = bars.x[bars.node("long.left")] - bars.x[bars.node("short.right")]
    held = {bars.node("long.right"): lambda t: 0.0} if case["bodies"]["long"].get("fixed") else {}
    held |= dict([drive]) if drive else {}
    free = np.array([i for i in range(total) if i not in held])
    eps_s, eps_m = (0, 0) if law["name"] == "lagrange" else dense.penalties(
        law, [bars.end("short.right"), bars.end("long.left")], dt)  # fmt: skip
    g = case["loads"]["weight"]["gravity"] if "weight" in case.get("loads", {}) else 0.0
    now = [0.0]

    def A(u, v, t, stage):
        f = M @ np.full(total, g) - K @ u
        if push:
            f[push[0]] += push[1](t)
        a = np.array([(held[i](now[0] + dt) - held[i](now[0])) / dt if i in held else 0.0 for i in range(total)])
        Mf, Nf, gap = M[np.ix_(free, free)], N[free], g0 + N @ u
        a[free] = np.linalg.solve(Mf, f[free])
        if law["name"] == "lagrange":
            r_v, r_a = (STARTS[scheme] if stage == START and scheme in STARTS else lambda dt: ends(dt)[stage])(dt)
            x = max(-(gap + r_v * N @ v + r_a * N @ a) / (r_a * Nf @ np.linalg.solve(Mf, Nf)), 0.0)
            a[free] += np.linalg.solve(Mf, Nf * x)
        elif gap < 0:
            rest = N @ a - Nf @ a[free]  # of driven nodes
            left = Mf + eps_m * np.outer(Nf, Nf)
            a[free] = np.linalg.solve(left, f[free] - (eps_s * gap + eps_m * rest) * Nf)
        return a

    u, v = np.zeros(total), bars.v.copy()
    for i, V in held.items():
        v[i] = V(0.0)
    a = A(u, v, 0.0, START)
    out = []
    for n in range(steps + 1):
        out.append((u, v))
        now[0] = n * dt
        u1, v1, a = make(A, u, v, a, n * dt, dt)
        for i, V in held.items():
            u1[i], v1[i] = u[i] + dt / 2 * (V(n * dt) + V((n + 1) * dt)), V((n + 1) * dt)
        u, v = u1, v1
    return bars, np.array([one for one, _ in out]), np.array([one for _, one in out])


# Each scheme is compiled for several seconds: the whole check compares all of them.
ALL_SCHEMES = [
    pytest.param(scheme, marks=pytest.mark.deep) if scheme in {"alpha", "tchamwa", *OTHERS} else scheme
    for scheme in SCHEMES
]
LAWS_TRIED = {
    "penalty": {"name": "penalty", "beta_s": 0.5},
    "bipenalty": {"name": "bipenalty", "beta_s": 2.0, "ratio": 1.0},
    "lagrange": {"name": "lagrange"},
}


@pytest.mark.slow
@pytest.mark.parametrize("direction", [[1.0], [0.6, -0.8], [2.0 / 3.0, 1.0 / 3.0, -2.0 / 3.0]], ids=len)
@pytest.mark.parametrize("law", LAWS_TRIED)
@pytest.mark.parametrize("scheme", ALL_SCHEMES)
def test_the_motion_is_that_of_dense_matrices(scheme, law, direction, files):
    """Supports, drives, forces and gravity, in one to three dimensions."""
    if law == "lagrange" and SCHEMES[scheme][1] is None:
        with pytest.raises(percuss.RefusedPair):
            go(hunek(4, integrator=scheme, contact={"name": "lagrange"}), files)
        return
    flat = hunek(6, courant=0.55, integrator=scheme, contact=LAWS_TRIED[law], end=0.6)
    flat["bodies"]["long"]["at"] = 10.01
    flat["loads"] = {"weight": {"gravity": -0.05}}
    bars = dense.assemble(flat)
    dt = 0.55 * 10 / 6 / 100
    steps = math.ceil(0.6 / dt - 1e-9)
    T = 0.3
    push = bars.node("long.left"), lambda t: 0.02 * math.sin(math.pi * t / T) if t < T else 0.0
    drive = bars.node("short.left"), lambda t: 0.1 + 0.04 * math.sin(2 * math.pi * 3 * t)
    bars, u, v = march(flat, steps, dt, scheme, LAWS_TRIED[law], push, drive)

    case = hunek(6, courant=0.55, integrator=scheme, contact=LAWS_TRIED[law], end=0.6)
    unit = np.array(direction)
    for one in case["bodies"].values():
        one["bar"]["direction"] = direction
    case["bodies"]["short"]["at"] = list(0.0 * unit)
    case["bodies"]["long"]["at"] = list(10.01 * unit)
    case["loads"] = {
        "weight": {"gravity": list(-0.05 * unit)},
        "push": {"half-sine": {"peak": 0.02, "duration": T}, "on": "long.left"},
        "drive": {"harmonic": {"mean": 0.1, "value": 0.04, "frequency": 3}, "on": "short.left", "as": "velocity"},
    }
    result = go(case, files)
    assert result.summary["compiled"] or result.summary["compiled_why"] == [
        "compilation is switched off by NUMBA_DISABLE_JIT"
    ]
    assert (result.arrays["contact_force"] != 0).sum() > 10, "no contact: the test says little"
    for k, name in enumerate(("short.left", "short.right", "long.left")):
        for found, expected in ((result.arrays["displacement"], u), (result.arrays["velocity"], v)):
            along = found[:, k] @ unit
            assert np.abs(along - expected[:, bars.node(name)]).max() < 1e-11 * np.abs(expected).max()
            assert np.abs(found[:, k] - np.outer(along, unit)).max() < 1e-12 * np.abs(expected).max()
    assert result.summary["momentum"]["error"] < 1e-13


@pytest.mark.parametrize("law", LAWS_TRIED)
@pytest.mark.parametrize("scheme", ALL_SCHEMES)
def test_the_impact_is_that_of_dense_matrices_to_round_off(scheme, law, files):
    if law == "lagrange" and SCHEMES[scheme][1] is None:
        return
    case = hunek(6, courant=0.55, integrator=scheme, contact=LAWS_TRIED[law], end=0.6)
    result = go(case, files)
    bars, u, v = march(case, result.summary["steps"], result.summary["dt"], scheme, LAWS_TRIED[law])
    for k, name in enumerate(("short.left", "short.right", "long.left")):
        for found, expected in ((result.arrays["displacement"], u), (result.arrays["velocity"], v)):
            assert np.abs(found[:, k, 0] - expected[:, bars.node(name)]).max() < 1e-11 * np.abs(expected).max()


@pytest.mark.parametrize("apart", [0.0, 0.004])
@pytest.mark.parametrize("law", [*LAWS_TRIED, "tied"])
def test_verlet_is_central_difference(law, apart, files):
    """To round-off, also where a law at the end of the step presses at t = 0, as the bodies touch and approach."""
    contact = LAWS_TRIED.get(law, {"name": law})
    case = hunek(10, courant=0.7, integrator="verlet", contact=contact)
    case["bodies"]["long"]["at"] = 10.0 + apart
    case["loads"] = {
        "weight": {"gravity": 0.1},
        "push": {"half-sine": {"peak": 0.02, "duration": 0.3}, "on": "long.left"},
        "hold": {"prescribed-velocity": 0.1, "on": "short.left"},
    }
    one = go(case, files)
    other = go({**case, "method": {"integrator": "central-difference", "contact": contact}}, files)
    assert np.abs(other.arrays["contact_force"]).max() > 0
    for name, scale in (("displacement", "displacement"), ("gap", "displacement"), ("velocity", "velocity")):
        difference = one.arrays[name] - other.arrays[name]
        if name == "velocity":
            difference = difference[1:]  # a leap-frog record at t = 0 has half of the first impulse
        assert np.abs(difference).max() < 1e-10 * np.abs(other.arrays[scale]).max(), name
    force = other.arrays["contact_force"]
    force = np.concatenate([2.0 * force[:1], force[1:]])  # that of central difference acts for half a step at t = 0
    mean = 0.5 * (force[1:] + force[:-1])
    assert np.abs(one.arrays["contact_force"][:-1] - mean).max() < 1e-10 * np.abs(force).max()
    critical = [
        certificate(model_of(percuss.load({**case, "method": {**case["method"], "integrator": name}}, plugins=files)))
        for name in (case["method"]["integrator"], "central-difference")
    ]
    assert critical[0]["dt_critical"] == pytest.approx(critical[1]["dt_critical"], rel=1e-6)


def oscillator(integrator, courant, load=None):
    """One element fixed at its left end: a mass on a spring."""
    bar = {"bar": {"length": 1.0, "elements": 1}, "material": {"young": 1.0, "density": 2.0}, "area": 1.0}
    case = {
        "percuss": 1,
        "bodies": {"a": {**bar, "velocity": 1.0, "fixed": ["left"]}},
        "method": {"integrator": integrator},
        "time": {"end": 4.0, "courant": courant},
        "record": {"probes": ["a.left", "a.right"]},
    }
    return case | ({"loads": {"push": {**load, "on": "a.right"}}} if load else {})


@pytest.mark.deep
@pytest.mark.parametrize("load", [None, {"harmonic": {"value": 0.7, "frequency": 0.3, "phase": 0.4}}], ids=str)
@pytest.mark.parametrize("name", [*STAGED, *OWN])  # of the others see test_integrators
def test_the_order_is_what_is_declared(name, load, files):
    """A mass of 1 on a spring of 1, with and without a force."""
    case = percuss.load(oscillator(name, 0.1, load), plugins=files)
    declared = type(case.method.integrator).order
    courants = np.array([0.2, 0.1, 0.05, 0.025])
    errors = []
    for courant in courants:
        result = percuss.run(case, {"time.courant": float(courant)})
        t = result.arrays["time"]
        exact = np.sin(t)
        if load:
            # u'' + u = F sin(w t + phase)
            F, w, phase = 0.7, 2 * math.pi * 0.3, 0.4
            c = F / (1 - w**2)
            exact = c * np.sin(w * t + phase) - c * math.sin(phase) * np.cos(t)
            exact += (1 - c * w * math.cos(phase)) * np.sin(t)
        errors.append(np.abs(result.arrays["displacement"][:, 1, 0] - exact).max())
        assert not result.arrays["displacement"][:, 0].any()
        assert not result.arrays["velocity"][:, 0].any()
    slope = np.polyfit(np.log(courants), np.log(errors), 1)[0]
    assert slope == pytest.approx(declared, abs=0.15)


# ----------------------------------------------------------------------------------------------------- stability


LIMITS = {
    "noh-bathe": 3.745 / 2,  # Noh and Bathe 2013
    "verlet": 1.0,
    "runge": math.sqrt(8) / 2,
}


@pytest.mark.parametrize("name", ["noh-bathe", "verlet", "runge"])
def test_the_free_limit_is_that_of_the_scheme(name, files):
    case = oscillator(name, 0.5)
    case["bodies"]["a"] |= {"bar": {"length": 1.0, "elements": 30}, "fixed": []}
    found = certificate(model_of(percuss.load(case, plugins=files)))
    assert found["courant_critical"] == pytest.approx(LIMITS[name], rel=2e-3 if name == "noh-bathe" else 1e-6)


def on_a_wall(name, law, elements=12):
    bar = {"bar": {"length": 1.0, "elements": elements}, "material": {"young": 1.0, "density": 1.0}, "area": 1.0}
    return {
        "percuss": 1,
        "bodies": {"b": bar},
        "contacts": {"w": {"body": "b.left", "wall": 0.0}},
        "method": {"integrator": name, "contact": law},
        "time": {"steps": 20, "courant": 0.5},
    }


@pytest.mark.slow
@pytest.mark.parametrize("law", [LAWS_TRIED["penalty"], {"name": "penalty", "beta_s": 30.0}, LAWS_TRIED["bipenalty"],
                                 {"name": "bipenalty", "beta_s": 10.0, "ratio": 5.0}], ids=str)  # fmt: skip
@pytest.mark.parametrize(
    "name", ["noh-bathe", "verlet", "newmark", "tchamwa", "alpha", pytest.param("runge", marks=pytest.mark.deep)]
)
def test_the_black_box_has_the_limit_of_the_linear_laws(name, law, files):
    """Growth seen in the step, what is kept between steps included, against oscillators and the linear laws."""
    model = model_of(percuss.load(on_a_wall(name, law), plugins=files))
    assert BlackBox(model).critical_step == pytest.approx(linear_laws(model).critical_step, rel=5e-6)


@pytest.mark.parametrize("courant", [1.8, 1.9])
def test_noh_bathe_runs_below_its_limit_and_not_above(courant):
    case = on_a_wall("noh-bathe", {"name": "lagrange"})
    case["bodies"]["b"]["velocity"] = -1.0
    case["time"] |= {"steps": 2000, "courant": courant, "on_unstable": "warn"}
    if courant < LIMITS["noh-bathe"]:
        result = percuss.run(percuss.load(case))
        assert result.summary["certificate"]["stable"] == "yes"
        total = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
        assert total.max() < 0.6
        return
    with pytest.raises(percuss.RunError) as stopped:
        percuss.run(percuss.load(case))
    stop = stopped.value.result.summary["stop"]
    assert 0 < stop["step"] < 2000
    assert stop["time"] == pytest.approx(stop["step"] * stopped.value.result.summary["dt"])
    assert stop["body"] == "b"
    assert "above" in stop["cause"]
    case["time"]["on_unstable"] = "stop"
    with pytest.raises(percuss.RunError, match="not started"):
        percuss.run(percuss.load(case))


@pytest.mark.parametrize("law", ["penalty", "lagrange", "tied"])
def test_the_step_is_chosen(law):
    case = hunek(6, courant="auto", integrator="noh-bathe", contact={"name": law})
    found = certificate(*settled(percuss.load(case)))
    assert found["stable"] == "yes"
    assert found["margin"] == pytest.approx(0.9, rel=1e-6)
    assert found["energy"] == "unknown"
    assert "noh-bathe" in found["energy_why"]
    assert found["by"] == ("linear-laws" if law == "penalty" else "black-box")


def test_a_scheme_of_which_no_step_is_stable_is_told(tmp_path):
    heun = '''
    class Heun(Integrator):
        """Heun's scheme, which amplifies every frequency."""
        name = "heun"
        summary = "Heun"
        order = 2
        def bind(self, dt):
            return Stages((0.0, 1.0))
        @staticmethod
        def step(numbers, system, u, v, kept, dt):
            a, b = np.empty_like(u), np.empty_like(u)
            accelerations(system, 0, u, v, a)
            accelerations(system, 1, u + dt * v, v + dt * a, b)
            u += dt * v + 0.5 * dt * dt * a
            v += 0.5 * dt * (a + b)
    '''
    files = plugin(tmp_path, heun)
    case = hunek(4, integrator="heun", contact={"name": "penalty"})
    assert certificate(model_of(percuss.load(case, plugins=files)))["stable"] == "no"
    with pytest.raises(percuss.InputError, match="some step is known to be stable"):
        settled(percuss.load({**case, "time": {"end": 0.1, "courant": "auto"}}, plugins=files))


# ------------------------------------------------------------------------------------------------------ accounts


@given(case=rows())
def test_momentum_balances_whatever_acts(case):
    for name in STAGED:
        try:
            result = percuss.run(percuss.load(with_pair(case, (name, {"name": "penalty", "beta_s": 0.4}))))
        except percuss.RunError:
            continue
        assert result.summary["momentum"]["error"] <= 1e-12


def test_the_works_are_what_the_kinetic_energy_takes_up(files):
    """With one stage the force of the strains is K u_n: then every term of the balance is known from outside."""
    case = hunek(6, integrator="tchamwa", contact=LAWS_TRIED["penalty"])
    case["loads"] = {
        "weight": {"gravity": -0.3},
        "push": {"half-sine": {"peak": 0.05, "duration": 0.3}, "on": "short.left"},
        "drive": {"harmonic": {"value": 0.05, "frequency": 4.0}, "on": "long.left", "as": "velocity",
                  "from": 0.1, "until": 0.5},
    }  # fmt: skip
    model = model_of(percuss.load(case, plugins=files))
    march_ = March(model)
    march_.compile()
    march_.stepper.start()
    K, mass, total = dense.assemble(case).K, model.bodies.mass, march_.arrays.step.totals[0]
    total.floor = np.inf
    kinetic = lambda v: 0.5 * float(mass @ v**2)  # noqa: E731
    moved = 0
    for first, last in model.segments():
        if first > 0:
            march_.switch((first + 0.5) * model.dt)
            total = march_.arrays.step.totals[0]
        for n in range(first, min(last, model.steps)):
            u, v = march_.u.copy(), march_.v.copy()
            works = total.external_work + total.contact_work
            assert march_.advance(march_.stepper.amplitudes(n, 1), n, 1) == 1
            given = total.external_work + total.contact_work - works
            mean = 0.5 * (v + march_.v)
            missing = kinetic(march_.v) - kinetic(v) - given + model.dt * float(u @ K @ mean)
            free = np.abs(march_.v).max() ** 2 * mass.sum()
            held = model.dt * (np.abs(K @ u) * np.abs(mean)).sum()
            # along a support or drive the strains press on what holds the node: their work is in neither account
            assert abs(missing) <= 1e-13 * (free + held)
            moved = max(moved, abs(given) / (free + held))
    assert moved > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.deep if name in ("runge", *OTHERS) else ())
        for name in (*STAGED, *OTHERS, *OWN)
    ],
)
def test_records_stand_where_they_say(name, files):
    """Energies of record n are those of the motion of record n + 1; one element, so that the probes are all nodes."""
    case = oscillator(name, 0.3, {"harmonic": {"value": 0.7, "frequency": 0.3}})
    case["bodies"]["a"]["fixed"] = []
    result = go(case, files)
    u, v = result.arrays["displacement"][:, :, 0], result.arrays["velocity"][:, :, 0]
    np.testing.assert_array_equal(result.arrays["time_half"], result.arrays["time"] + result.summary["dt"])
    np.testing.assert_allclose(result.arrays["kinetic_energy"][:-1], 0.5 * (v[1:] ** 2).sum(axis=1), rtol=1e-12)
    strain = 0.5 * (u[1:, 1] - u[1:, 0]) ** 2
    np.testing.assert_allclose(result.arrays["elastic_energy"][:-1], strain, rtol=1e-9, atol=1e-14)
    assert (v[0] == 1.0).all()
    assert "t_n+1" in result.histories["kinetic_energy"].attrs["definition"]
    assert result.histories["kinetic_energy"].attrs["at"] == "time_half"
    assert any("energy_error is what" in note for note in result.summary["notes"])


def test_what_the_scheme_takes_is_the_energy_error():
    case = oscillator("noh-bathe", 1.5)
    case["bodies"]["a"] |= {"bar": {"length": 1.0, "elements": 20}, "fixed": ["left"]}
    case["time"] = {"steps": 400, "courant": 1.5}
    result = percuss.run(percuss.load(case))
    total = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
    assert total[-1] < 0.99 * total[0]
    # closure over the largest energy: kinetic at the start
    assert result.arrays["energy_error"][-1] == pytest.approx(
        total[-1] / result.summary["energy"]["initial"] - 1, rel=0.05
    )
    assert result.summary["energy_growth"]["guarantee"] == "unknown"
    assert result.summary["energy_growth"]["kept"] is None


@pytest.mark.parametrize("name", ["noh-bathe", "verlet"])
def test_the_exact_force_is_that_of_the_same_time(name, files):
    case = hunek(40, courant=0.7, integrator=name, contact={"name": "penalty", "beta_s": 0.25})
    result = go(case, files)
    model = model_of(percuss.load(case, plugins=files))
    solution = exact_solution(model, 0.8)[0]
    t, dt = result.arrays["time"][:-1], result.summary["dt"]
    expected = solution.contacts["tip"].mean_force(t, t + dt)
    np.testing.assert_allclose(result.arrays["contact_force_exact"][:-1, 0], expected, atol=1e-15)
    errors = result.summary["exact"]["contacts"]["tip"]
    force = result.arrays["contact_force"][:, 0]
    assert errors["impulse_error"] < 0.03
    assert errors["force_error_l1"] < 0.12
    summed = dt * np.cumsum(force)[:-1]
    true = solution.contacts["tip"].impulse(t + dt)
    assert errors["impulse_error"] == pytest.approx(np.abs(summed - true).max() / np.abs(true).max(), rel=1e-6)


@pytest.mark.slow
def test_a_constant_force_brings_its_impulse_whenever_it_acts(files):
    """Switched on and off within steps."""
    for name in (*STAGED, "verlet", "runge"):
        case = oscillator(name, 0.3, {"constant": 2.0})
        case["bodies"]["a"] |= {"fixed": [], "velocity": 0.0}
        case["loads"]["push"] |= {"from": 0.777, "until": 2.345}
        result = go(case, files)
        assert result.summary["momentum"]["final"][0] == pytest.approx(2.0 * (2.345 - 0.777), rel=1e-12)
        assert result.summary["momentum"]["error"] < 1e-14


@pytest.mark.parametrize("name", [*STAGED, *OWN, *(pytest.param(name, marks=pytest.mark.deep) for name in OTHERS)])
def test_a_drive_is_followed_exactly_while_it_holds(name, files):
    case = hunek(4, courant=0.5, integrator=name, contact={"name": "penalty"})
    case["loads"] = {"drive": {"harmonic": {"value": 0.3, "frequency": 3.0}, "on": "short.left", "as": "velocity",
                               "from": 0.1, "until": 0.5}}  # fmt: skip
    result = go(case, files)
    t, v = result.arrays["time"], result.arrays["velocity"][:, 0, 0]
    u, dt = result.arrays["displacement"][:, 0, 0], result.summary["dt"]
    inside = (t > 0.1 + dt) & (t < 0.5 - dt)
    wanted = 0.3 * np.sin(2 * np.pi * 3.0 * (t - 0.1))
    assert np.abs(v - wanted)[inside].max() < 1e-14
    steps = np.flatnonzero(inside[1:] & inside[:-1])
    assert np.abs(np.diff(u)[steps] - 0.5 * dt * (wanted[steps] + wanted[steps + 1])).max() < 1e-15
    assert result.summary["momentum"]["error"] < 1e-13


def test_contacts_held_together_do_not_overlap():
    """Every stage of Noh-Bathe sees to the next one: no gap is ever negative with a multiplier."""
    for courant in (0.3, 0.9, 1.7):
        result = percuss.run(percuss.load(hunek(10, courant, "noh-bathe", {"name": "lagrange"})))
        assert result.arrays["gap"].min() > -1e-13
        assert result.summary["contacts"]["tip"]["penetration"]["largest"] < 1e-13
        assert result.arrays["contact_force"].min() >= 0.0


@pytest.mark.parametrize("law", ["lagrange", "tied"])
@pytest.mark.parametrize("name", ["noh-bathe", pytest.param("explicit-newmark", marks=pytest.mark.deep)])
def test_bodies_that_touch_and_approach_do_not_overlap_in_the_first_step(name, law):
    case = hunek(5, 0.5, name, {"name": law}, end=0.1)
    result = percuss.run(percuss.load(case))
    assert result.arrays["contact_force"][0, 0] > 0.0
    assert result.summary["contacts"]["tip"]["penetration"]["largest"] < 1e-13
    assert np.abs(result.arrays["gap"][:5]).max() < 1e-13


def test_the_penetration_of_a_run_is_that_of_its_stages_too():
    """The kernel of Noh-Bathe in NumPy, one mass against a wall: at its first stage it is deeper than at any end."""
    case = hunek(5, 0.9, "noh-bathe", {"name": "penalty", "beta_s": 3.0}, end=0.06)
    result = percuss.run(percuss.load(case))
    bars, u, _ = march(case, result.summary["steps"], result.summary["dt"], "noh-bathe", case["method"]["contact"])
    left, right = bars.node("short.right"), bars.node("long.left")
    gaps = bars.x[right] - bars.x[left] + u[:, right] - u[:, left]
    deepest = result.summary["contacts"]["tip"]["penetration"]["largest"]
    assert deepest > 1.05 * -gaps.min() > 0.0


# ------------------------------------------------------------------------------------------- compiled, and not


@pytest.mark.parametrize("law", ["penalty", "lagrange", "tied"])
def test_plain_python_gives_the_same_numbers(law):
    case = hunek(8, integrator="noh-bathe", contact={"name": law})
    one, other = percuss.run(percuss.load(case)), percuss.run(percuss.load(case), compiled=False)
    assert other.summary["compiled"] is False
    for name in ("contact_force", "displacement", "kinetic_energy", "contact_work"):
        scale = np.abs(one.arrays[name]).max()
        assert np.abs(one.arrays[name] - other.arrays[name]).max() <= 1e-12 * scale


@pytest.mark.slow
def test_a_kernel_that_cannot_be_compiled_runs_in_python(tmp_path, files):
    text = VERLET.replace("verlet", "slow").replace(
        "        u += dt * v\n", '        names = {"dt": dt, "half": [object(), 0.5]}\n        u += names["dt"] * v\n'
    )
    case = hunek(8, integrator="slow", contact={"name": "penalty"})
    result = go(case, plugin(tmp_path, text))
    assert result.summary["compiled"] is False
    (why,) = result.summary["compiled_why"]
    assert why.startswith(("integrator slow cannot be compiled: ", "compilation is switched off"))
    fast = go({**case, "method": {**case["method"], "integrator": "verlet"}}, files)
    np.testing.assert_allclose(result.arrays["contact_force"], fast.arrays["contact_force"], rtol=1e-10, atol=1e-12)


@pytest.mark.deep
def test_a_law_with_a_kernel_sees_the_stage(tmp_path, files):
    """A penalty written as a kernel is the penalty."""
    (tmp_path / "mine.py").write_text(
        textwrap.dedent(
            '''
            from dataclasses import dataclass
            from typing import NamedTuple
            from percuss import ContactLaw

            class Bound(NamedTuple):
                stiffness: object

            @dataclass(frozen=True)
            class Mine(ContactLaw):
                """A law."""
                name = "mine"
                summary = "a penalty"

                def bind(self, points, dt):
                    return Bound(0.5 * points.stiffness)

                @staticmethod
                def multipliers(bound, trial, multiplier):
                    for p in range(multiplier.size):
                        multiplier[p] = bound.stiffness[p] * max(-trial.gap[p], 0.0)
            '''
        ),
        encoding="utf-8",
    )
    for name in ("noh-bathe", "alpha"):
        one, other = (
            go(hunek(8, integrator=name, contact=law), [*files, tmp_path / "mine.py"], compiled=False)
            for law in ({"name": "mine"}, LAWS_TRIED["penalty"])
        )
        np.testing.assert_allclose(one.arrays["contact_force"], other.arrays["contact_force"], rtol=1e-12, atol=1e-15)


# -------------------------------------------------------------------------------------------------- what is said


def test_a_law_judged_at_the_end_is_refused_where_no_end_is_said(files):
    for name in ("newmark", "alpha", "runge"):
        with pytest.raises(percuss.RefusedPair, match="do not say") as refused:
            go(hunek(4, integrator=name, contact={"name": "lagrange"}), files)
        assert (refused.value.integrator, refused.value.contact, refused.value.said_by) == (name, "lagrange", name)


GOOD = """
        v += dt * kept[0]
        u += dt * v
        accelerations(system, 0, u, v, kept[0])
"""
WRONG = {
    "in place": (GOOD.replace("u += dt * v", "u = u + dt * v"), "Stages((1.0,))", "kept = 1"),
    "change of v by 0.5 dt a": (GOOD.replace("v += dt", "v += 0.5 * dt"), "Stages((1.0,))", "kept = 1"),
    "asks for stage 1": (GOOD.replace("system, 0", "system, 1"), "Stages((1.0,))", "kept = 1"),
    "one stage or more": (GOOD, "Stages(())", "kept = 1"),
    "three numbers": (GOOD, "Stages((1.0,), end=((dt, 0.0, dt),))", "kept = 1"),
    "three numbers greater": (GOOD, "Stages((1.0,), end=((dt, dt, dt), (dt, dt, dt)))", "kept = 1"),
    "expected LeapFrog or Stages": (GOOD, "(1.0,)", "kept = 1"),
}
BY_THE_KIT = ("in place", "change of v by 0.5 dt a", "asks for stage 1")


@pytest.mark.parametrize("message", WRONG)
def test_what_a_plugin_must_not_say(message, tmp_path):
    body, bound, kept = WRONG[message]
    text = f'''
class Wrong(Integrator):
    """Wrong."""

    name = "wrong"
    summary = "wrong"
    order = 1
    {kept}

    def bind(self, dt):
        return {bound}

    @staticmethod
    def step(numbers, system, u, v, kept, dt):{body}
'''
    case = hunek(4, integrator="wrong", contact={"name": "penalty"})
    registry = Registry.load(plugin(tmp_path, text))
    if message in BY_THE_KIT:
        with pytest.raises(CheckFailed, match=message):
            dict(checks(registry.get("integrators", "wrong"), registry=registry))["stages"]()
        return
    with pytest.raises(percuss.PluginError, match=f"integrator wrong: .*{message}"):
        percuss.run(percuss.load(case, registry=registry))


def test_a_scheme_without_a_kernel_is_told(tmp_path):
    text = VERLET.split("    @staticmethod", maxsplit=1)[0]
    with pytest.raises(percuss.PluginError, match="no static method `step"):
        go(hunek(4, integrator="verlet", contact={"name": "penalty"}), plugin(tmp_path, text))


def test_a_case_is_explained():
    model = model_of(percuss.load(hunek(6, integrator="noh-bathe", contact={"name": "lagrange"})))
    text = explanation(model).text
    assert "no leap-frog scheme: accelerations, contact included, at 0.54, 1 of each step" in text
    assert "u_{n+p} = u_n + p dt v_n" in text
    assert "is not known" in text


def test_waves_are_refused_with_the_reason():
    case = percuss.load(hunek(6, integrator="noh-bathe", contact={"name": "penalty"}))
    with pytest.raises(percuss.PercussError, match="noh-bathe is no leap-frog scheme"):
        waves(model_of(case))
    told = {row["by"]: row for row in stability(case, by=("linear-laws", "black-box"))}
    critical = [told[way]["dt_critical"] for way in ("linear-laws", "black-box")]
    assert critical[0] == pytest.approx(critical[1], rel=1e-5)


def test_the_registered_ones_are_tried_here():
    assert STAGED, "no scheme of stages is registered"
    for name in (*STAGED, *OTHERS):
        integrator = REGISTRY.get("integrators", name)
        assert isinstance(integrator().bind(0.5), percuss.Stages)
        assert "momentum" in integrator.conserves


def test_a_body_whose_nodes_are_all_held_is_stable_at_any_step():
    case = hunek(1, integrator="noh-bathe", contact={"name": "penalty"}, end=0.1)
    case["bodies"] = {"short": {**case["bodies"]["short"], "fixed": ["right"], "velocity": 0.0}}
    case |= {"contacts": {}, "record": {"probes": ["short.left"]}}
    case["loads"] = {"drive": {"constant": {"value": 2.0}, "on": "short.left", "as": "velocity"}}
    result = go(case, [])
    assert result.summary["certificate"]["stable"] == "yes"
    assert result.arrays["displacement"][-1, 0, 0] == pytest.approx(2.0 * result.arrays["time"][-1], rel=1e-12)
