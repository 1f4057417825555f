"""Multi-stage schemes: published amplification, limits and orders, accounts and records, internal forces, velocities.

Their runs are held against full matrices in `test_methods.py`; order, limit and stages of each are judged by the kit.
What is reproduced of the sources are closed forms that are quoted from them: limits, places where roots meet, and the
spectral radius there. Of the explicit forms of the alpha method the one is taken whose low frequencies do not grow.
"""

import math
import re

import numpy as np
import pytest

import dense
import formulas
import percuss
import places
from marks import deep
from percuss.certificate.black_box import BlackBox
from percuss.certificate.linear_laws import linear_laws
from percuss.certificate.oscillator import amplification
from percuss.certificate.verdict import certificate
from percuss.jit import plain
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.methods import slots
from percuss.results.exact import exact_solution
from strategies import CORE, INTEGRATORS, LEAPFROG, REGISTRY, UNIT, bar, case_of, hunek, run

STABILITY = (places.ROOT / "plugins" / "STABILITY.md").read_text(encoding="utf-8")
STAGED = [name for name in INTEGRATORS if name not in LEAPFROG]
QUICK = {*CORE, "velocity-verlet"}
EACH_STAGED = [name if name in QUICK else deep(name) for name in STAGED]
PENALTY = {"name": "penalty", "beta_s": 0.5}
BIPENALTY = {"name": "bipenalty", "beta_s": 2.0, "ratio": 1.0}

# ------------------------------------------------------------------------------- the free motion of an oscillator

OPTIONS = {
    "velocity-verlet": [{}],
    "explicit-newmark": [{}, {"gamma": 0.6}, {"gamma": 1.0}],
    "tchamwa-wielgosz": [{}, {"phi": 1.0}, {"phi": 4 / 3}, {"phi": 2.0}],
    "chung-lee": [{}, {"beta": 1.0}, {"beta": 1.02}],
    "hulbert-chung": [{}, *({"rho_b": rho} for rho in (0.0, 0.25, 0.5, 0.8, 1.0))],
    "explicit-hht": [{}, {"alpha": 0.0}, {"alpha": -0.05}, {"alpha": -1 / 3}],
    "noh-bathe": [{}, {"p": 0.6}],
}
EACH = pytest.mark.parametrize(
    ("name", "options"),
    [(name, options) for name, sets in OPTIONS.items() for options in sets],
    ids=lambda value: value if isinstance(value, str) else "".join(f"{k}={v:.3g}" for k, v in value.items()),
)


def limit(name, gamma=0.5, phi=1.033, beta=28 / 27, rho_b=0.4, alpha=-0.1):
    """Return omega dt where the radius becomes 1, and where the roots of low frequency meet with which radius."""
    return {
        "velocity-verlet": (2.0, 2.0, 1.0),
        # 1/sqrt(gamma/2 - beta) and 1/sqrt((gamma + 1/2)^2/4 - beta) of Hughes 1987, with beta = 0 and no damping
        "explicit-newmark": (math.sqrt(2 / gamma), 2 / (gamma + 0.5), (1.5 - gamma) / (gamma + 0.5)),
        "tchamwa-wielgosz": (2 / math.sqrt(2 * phi - 1), 2 / phi, 2 / phi - 1),
        "chung-lee": (2 / math.sqrt(4 * beta - 3), math.sqrt(27 / 8) if beta == 28 / 27 else None, 0.5),
        "hulbert-chung": (
            math.sqrt(12 * (1 + rho_b) * (2 - rho_b) / (10 - 5 * rho_b + rho_b**2)),
            (1 + rho_b) * math.sqrt(2 - rho_b),
            rho_b,
        ),
        "explicit-hht": (2 / math.sqrt(1 - alpha - 2 * alpha**2 - alpha**3), None, None),
    }[name]


def made(name, options):
    return REGISTRY.get("integrators", name)(**options)


def matrix(name, options, x):
    size = 2 + made(name, options).kept
    return formulas.amplification(formulas.SCHEMES[name].step, x, **options)[:size, :size]


def roots(name, options, omega):
    return np.linalg.eigvals(matrix(name, options, omega**2))


def radius(name, options, omega):
    return np.abs(roots(name, options, omega)).max()


@EACH
def test_the_kernel_makes_the_published_step(name, options):
    integrator, dt = made(name, options), 0.37
    squares = np.array([0.01, 0.3, 1.0, 2.7, 3.5, 5.0])
    for x, step in zip(squares, amplification(integrator, integrator.bind(dt), dt, squares), strict=True):
        np.testing.assert_allclose(step, matrix(name, options, x), atol=1e-13)


@EACH
def test_the_limit_of_stability_is_the_published_one(name, options):
    if name == "noh-bathe":  # Noh and Bathe 2013 give it in four digits
        assert options or type(made(name, {})).critical_courant == pytest.approx(3.745 / 2, rel=2e-4)
        return
    critical = limit(name, **options)[0]
    # nearer to the limit up to three roots lie so close to -1 that they are known to the cube root of round-off alone
    grid = np.linspace(0.01, 1 - 1e-5, 400) * critical
    assert max(radius(name, options, omega) for omega in grid) < 1 + 1e-10
    assert radius(name, options, critical * (1 + 1e-4)) > 1 + 1e-5
    if not options:
        assert type(made(name, {})).critical_courant == pytest.approx(critical / 2, abs=5e-5)
        doc = re.findall(r"Courant number\s+of\s+(\.\d+)", type(made(name, {})).__doc__)
        assert doc == ([f"{critical / 2:.4f}".lstrip("0")] if critical < 2 else [])
        row = next(line for line in STABILITY.splitlines() if line.startswith(f"| `{name}`"))
        assert f"without contact up to a Courant number of {critical / 2:.2g} |" in row


@EACH
def test_the_roots_meet_where_the_paper_says(name, options):
    """At Omega_b the radius is what the options say: rho_b, 2/phi - 1, and 1/2 of a threefold root of Chung and Lee."""
    _, meeting, least = limit(name, **options) if name != "noh-bathe" else (None, None, None)
    if meeting is None:
        return
    found = np.sort_complex(roots(name, options, meeting))
    # n roots that meet are known to the n-th root of round-off
    assert np.abs(found[0] - found[1]) < (1e-4 if name in {"chung-lee", "hulbert-chung"} else 1e-7)
    assert np.abs(found[0] + least) < 1e-4
    if name == "chung-lee" or options == {"rho_b": 0.5}:
        np.testing.assert_allclose(found, -0.5, atol=1e-4)


def end_of_march(integrator, dt, end=6.0):
    """March u'' + u = sin(2 t + .4) from u = .3 and v = 1 with the kernel in plain Python; return the largest error."""
    stages, time = integrator.bind(dt), [0.0]

    def accelerations(system, stage, u, v, a):
        a[:] = np.sin(2 * (time[0] + stages.times[stage] * dt) + 0.4) - u

    def internal(system, stage, u, f):
        f[:] = u

    step = plain(type(integrator).step, {slots.accelerations: accelerations, slots.internal: internal})
    u, v = np.array([0.3]), np.array([1.0])
    kept = np.full((integrator.kept, 1), math.sin(0.4) - 0.3)
    error = 0.0
    c, s = 0.3 + math.sin(0.4) / 3, 1.0 + 2 * math.cos(0.4) / 3
    for n in range(round(end / dt)):
        time[0] = n * dt
        step(stages.numbers, None, u, v, kept, dt)
        t = (n + 1) * dt
        error = max(error, abs(u[0] - (c * math.cos(t) + s * math.sin(t) - math.sin(2 * t + 0.4) / 3)))
    return error


@EACH
def test_the_order_is_the_published_one(name, options):
    """Second order, but for Tchamwa and Wielgosz's scheme and Newmark's with gamma above 1/2; loads at their times."""
    first = name == "tchamwa-wielgosz" or options.get("gamma", 0.5) > 0.5
    if not options:
        assert type(made(name, {})).order == (1 if first else 2)
    one, other = (end_of_march(made(name, options), dt) for dt in (0.02, 0.01))
    assert math.log2(one / other) == pytest.approx(1 if first else 2, abs=0.06)


@pytest.mark.deep
def test_the_scheme_of_the_page_is_of_fourth_order_up_to_the_root_of_twelve(registry):
    """The trace of its step is 2 - x + x^2/12 - ..., which leaves [-2, 2] at x = (omega dt)^2 = 12."""
    integrator = registry.get("integrators", "force-gradient")()
    assert math.log2(end_of_march(integrator, 0.1) / end_of_march(integrator, 0.05)) == pytest.approx(4.0, abs=0.1)
    case = hunek(5, courant=0.6, integrator="force-gradient", contact=PENALTY)
    # the linear laws take contact and mesh alike, and here they are not: the black box decides
    closed = certificate(model_of(percuss.load(case, registry=registry)))
    assert closed["by"] == "black-box"
    assert 0.0 < closed["courant_critical"] < math.sqrt(3.0)
    del case["contacts"]
    judged = certificate(model_of(percuss.load(case, registry=registry)))
    assert (judged["stable"], judged["courant_critical"]) == ("yes", pytest.approx(math.sqrt(3.0), rel=1e-6))


# --------------------------------------------------------------------------------------------------------- impacts


@pytest.mark.parametrize(
    "name", [deep(name) if name in {"chung-lee", "hulbert-chung"} else name for name in OPTIONS if name != "noh-bathe"]
)
def test_lagrange_is_refused_where_its_promise_would_be_broken(name, monkeypatch):
    """Each refusal is for cause: without it the bodies overlap, or the reported force pulls."""
    case = hunek(5, courant=0.8, integrator=name, contact={"name": "lagrange"}, end=0.5)
    if name not in {"tchamwa-wielgosz", "velocity-verlet", "explicit-newmark"}:
        with pytest.raises(percuss.RefusedPair, match=r"lagrange (never pulls|allows no overlap)") as refused:
            run(case, compiled=False)
        assert refused.value.said_by == name
        monkeypatch.delattr(type(made(name, {})), "refuses")
    result = run(case, compiled=False)
    pulls = result.arrays["contact_force"].min() < -1e-4
    overlaps = result.arrays["gap"].min() < -1e-6
    assert pulls == (name in {"chung-lee", "hulbert-chung"})
    assert overlaps == (name == "explicit-hht")


# ----------------------------------------------------------------------------------------------------- stability


def oscillator(integrator, courant, load=None, elements=1):
    """One element or more, fixed at the left end; one of them is a mass of 1 on a spring of 1."""
    body = bar(1.0, elements, velocity=1.0, material={"young": 1.0, "density": 2.0}, fixed=["left"])
    loads = {"push": {**load, "on": "a.right"}} if load else {}
    return case_of({"a": body}, {}, {"end": 4.0, "courant": courant}, loads, integrator)


def on_a_wall(name, law):
    bars, contacts = {"b": bar(1.0, 12, material=UNIT)}, {"w": {"body": "b.left", "wall": 0.0}}
    return case_of(bars, contacts, {"steps": 20, "courant": 0.5}, None, name, law)


LINEAR = [PENALTY, {"name": "penalty", "beta_s": 30.0}, BIPENALTY,
          {"name": "bipenalty", "beta_s": 10.0, "ratio": 5.0}]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("law", LINEAR, ids=str)
@pytest.mark.parametrize("name", EACH_STAGED)
def test_the_black_box_has_the_limit_of_the_linear_laws(name, law):
    """Growth seen in the step, what is kept between steps included, against oscillators and the linear laws."""
    model = model_of(percuss.load(on_a_wall(name, law)))
    assert BlackBox(model).critical_step == pytest.approx(linear_laws(model).critical_step, rel=5e-6)


# ------------------------------------------------------------------------------------------------------ accounts


@pytest.mark.slow
@pytest.mark.parametrize("name", EACH_STAGED)
def test_records_impulses_and_drives_of_a_scheme(name):
    """Energies of record n are those of the motion of record n + 1; one element, so that the probes are all nodes."""
    case = oscillator(name, 0.3, {"harmonic": {"value": 0.7, "frequency": 0.3}})
    case["bodies"]["a"]["fixed"] = []
    result = run(case)
    u, v = result.arrays["displacement"][:, :, 0], result.arrays["velocity"][:, :, 0]
    np.testing.assert_array_equal(result.arrays["time_half"], result.arrays["time"] + result.summary["dt"])
    np.testing.assert_allclose(result.arrays["kinetic_energy"][:-1], 0.5 * (v[1:] ** 2).sum(axis=1), rtol=1e-12)
    strain = 0.5 * (u[1:, 1] - u[1:, 0]) ** 2
    np.testing.assert_allclose(result.arrays["elastic_energy"][:-1], strain, rtol=1e-9, atol=1e-14)
    assert (v[0] == 1.0).all()
    assert "t_n+1" in result.histories["kinetic_energy"].attrs["definition"]
    assert result.histories["kinetic_energy"].attrs["at"] == "time_half"
    assert any("energy_error is what" in note for note in result.summary["notes"])
    if name in QUICK:  # a constant force brings its impulse, switched on and off within steps
        case["bodies"]["a"]["velocity"] = 0.0
        case["loads"]["push"] = {"constant": 2.0, "on": "a.right", "from": 0.777, "until": 2.345}
        momentum = run(case).summary["momentum"]
        assert momentum["final"][0] == pytest.approx(2.0 * (2.345 - 0.777), rel=1e-12)
        assert momentum["error"] < 1e-14
    # a drive is followed exactly while it holds
    case = hunek(4, courant=0.5, integrator=name, contact={"name": "penalty"})
    case["loads"] = {"drive": {"harmonic": {"value": 0.3, "frequency": 3.0}, "on": "short.left", "as": "velocity",
                               "from": 0.1, "until": 0.5}}  # fmt: skip
    result = run(case)
    t, v = result.arrays["time"], result.arrays["velocity"][:, 0, 0]
    u, dt = result.arrays["displacement"][:, 0, 0], result.summary["dt"]
    inside = (t > 0.1 + dt) & (t < 0.5 - dt)
    wanted = 0.3 * np.sin(2 * np.pi * 3.0 * (t - 0.1))
    assert np.abs(v - wanted)[inside].max() < 1e-14
    steps = np.flatnonzero(inside[1:] & inside[:-1])
    assert np.abs(np.diff(u)[steps] - 0.5 * dt * (wanted[steps] + wanted[steps + 1])).max() < 1e-15
    assert result.summary["momentum"]["error"] < 1e-13


def test_what_the_scheme_takes_is_the_energy_error():
    case = oscillator("noh-bathe", 1.5, elements=20)
    case["time"] = {"steps": 400, "courant": 1.5}
    result = run(case)
    total = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
    assert total[-1] < 0.99 * total[0]
    # closure over the largest energy: kinetic at the start
    kept = total[-1] / result.summary["energy"]["initial"]
    assert result.arrays["energy_error"][-1] == pytest.approx(kept - 1, rel=0.05)
    assert result.summary["energy_growth"]["guarantee"] == "unknown"
    assert result.summary["energy_growth"]["kept"] is None


@pytest.mark.parametrize("name", ["noh-bathe", "velocity-verlet"])
def test_the_exact_force_is_that_of_the_same_time(name):
    case = hunek(40, courant=0.7, integrator=name, contact={"name": "penalty", "beta_s": 0.25})
    result = run(case)
    solution = exact_solution(model_of(percuss.load(case)), 0.8)[0]
    t, dt = result.arrays["time"][:-1], result.summary["dt"]
    expected = solution.contacts["tip"].mean_force(t, t + dt)
    np.testing.assert_allclose(result.arrays["contact_force_exact"][:-1, 0], expected, atol=1e-15)
    errors = result.summary["exact"]["contacts"]["tip"]
    assert errors["impulse_error"] < 0.03
    assert errors["force_error_l1"] < 0.12
    summed = dt * np.cumsum(result.arrays["contact_force"][:, 0])[:-1]
    true = solution.contacts["tip"].impulse(t + dt)
    assert errors["impulse_error"] == pytest.approx(np.abs(summed - true).max() / np.abs(true).max(), rel=1e-6)


# --------------------------------------------------------------------- internal forces, and velocities of a stage

VERLET = '''
from dataclasses import dataclass
import numpy as np
from percuss import Integrator, Stages, accelerations, internal


@dataclass(frozen=True)
class Mine(Integrator):
    """Velocity Verlet, with something added. Formula: that of velocity Verlet."""

    name = "mine"
    summary = "Velocity Verlet"
    order = 2
    kept = KEPT

    def bind(self, dt):
        return Stages(times=(1.0,), DECLARED)

    @staticmethod
    def step(numbers, system, u, v, kept, dt):
        v += 0.5 * dt * kept[0]
        u += dt * v
        accelerations(system, 0, u, v, kept[0])
        ADDED
        v += 0.5 * dt * kept[0]
'''


def mine(folder, kept=1, declared="", added="pass"):
    text = VERLET.replace("KEPT", str(kept)).replace("DECLARED", declared).replace("ADDED", added)
    (folder / "mine.py").write_text(text, encoding="utf-8")
    return [folder / "mine.py"]


@pytest.mark.parametrize("compiled", [False, True], ids=["plain", "compiled"])
def test_internal_forces_are_those_of_dense_matrices(compiled, tmp_path):
    """Nodes: M^-1 K u, zero at the support; then no contact force, the reaction that holds the support, no load."""
    case = hunek(5, courant=0.6, integrator="mine", contact=PENALTY)
    case["loads"] = {"weight": {"gravity": 3.0}, "push": {"constant": 0.02, "on": "short.left"}}
    case["time"] = {"steps": 9, "courant": 0.6}
    model = model_of(percuss.load(case, plugins=mine(tmp_path, kept=2, added="internal(system, 0, u, kept[1])")))
    march = March(model, compiled=compiled)
    march.run()
    u, kept = march.stepper.state.u, march.stepper.state.kept
    bars = dense.assemble(case)
    nodes, support = bars.x.size, bars.node("long.right")
    force = bars.K @ u[:nodes]
    expected = force / np.diag(bars.M)
    assert abs(expected[support]) > 1e-6 * np.abs(expected).max()
    expected[support] = 0.0
    np.testing.assert_allclose(kept[1, :nodes], expected, atol=1e-12 * np.abs(expected).max())
    contact, *others = kept[1, nodes:]
    assert kept[0, nodes] > 0.0 == contact
    # minus the reaction that would hold the end, as the forces on it are minus f_int
    assert others[0] == pytest.approx(-force[support], rel=1e-11)
    assert not any(others[1:])


@pytest.mark.parametrize("compiled", [False, True], ids=["plain", "compiled"])
def test_a_dashpot_leaves_second_order_with_the_velocity_of_the_stage(compiled, tmp_path):
    """Against the exact damped oscillation; at the velocity that is handed over, half a step before, it is first."""
    files = mine(tmp_path, declared="velocity=(dt / 2,)")

    def order(integrator):
        errors = []
        for steps in (80, 160):
            dashpot = {"spring-dashpot": {"stiffness": 0.0, "damping": 0.6}, "on": "a.right"}
            case = oscillator(integrator, 0.5) | {"loads": {"dashpot": dashpot}}
            case["time"] = {"steps": steps, "step": 4.0 / steps}
            result = percuss.run(percuss.load(case, plugins=files), compiled=compiled)
            t, omega = result.arrays["time"], math.sqrt(1.0 - 0.3**2)
            exact = np.exp(-0.3 * t) * np.sin(omega * t) / omega
            errors.append(np.abs(result.arrays["displacement"][:, 1, 0] - exact).max())
            assert result.summary["momentum"]["balanced"]
        return math.log2(errors[0] / errors[1])

    assert order("mine") == pytest.approx(2.0, abs=0.1)
    if not compiled:
        assert order("velocity-verlet") == pytest.approx(1.0, abs=0.1)


# -------------------------------------------------------------------------------------------------- what is said

WRONG = {
    "one stage or more": ({"declared": ""}, "times=(1.0,), ", "times=()"),
    "three numbers": ({"declared": "end=((dt, 0.0, dt),)"}, "", ""),
    "three numbers greater": ({"declared": "end=((dt, dt, dt), (dt, dt, dt))"}, "", ""),
    "expected LeapFrog or Stages": ({"declared": ""}, "Stages(times=(1.0,), )", "(1.0,)"),
    "velocity needs a number of at least 0": ({"declared": "velocity=(-dt,)"}, "", ""),
    "no static method `step": ({"declared": ""}, "    @staticmethod\n    def step", "    def stop"),
}


@pytest.mark.parametrize("message", WRONG)
def test_what_a_plug_in_must_not_say_of_its_stages(message, tmp_path):
    options, old, new = WRONG[message]
    (file,) = mine(tmp_path, **options)
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(percuss.PluginError, match=message):
        percuss.run(percuss.load(hunek(4, integrator="mine", contact=PENALTY), plugins=[file]))


def test_a_law_judged_at_the_end_is_refused_where_no_end_is_said(tmp_path):
    with pytest.raises(percuss.RefusedPair, match="do not say") as refused:
        percuss.run(percuss.load(hunek(4, integrator="mine", contact={"name": "lagrange"}), plugins=mine(tmp_path)))
    assert (refused.value.integrator, refused.value.contact, refused.value.said_by) == ("mine", "lagrange", "mine")


def test_a_body_whose_nodes_are_all_held_is_stable_at_any_step():
    case = oscillator("noh-bathe", 0.5)
    case["bodies"]["a"]["velocity"] = 0.0
    case["loads"] = {"drive": {"constant": 2.0, "on": "a.right", "as": "velocity"}}
    result = run(case)
    assert result.summary["certificate"]["stable"] == "yes"
    assert result.arrays["displacement"][-1, 1, 0] == pytest.approx(2.0 * result.arrays["time"][-1], rel=1e-12)


def test_what_the_docstrings_say_of_the_alpha_methods():
    def quoted(rho):
        return math.sqrt(12 * (1 + rho) ** 3 * (2 - rho) / (10 + 15 * rho - rho**2 + rho**3 - rho**4))

    # a polynomial that is quoted for Omega_s holds for rho_b of 0 and 1; between them the scheme grows there
    for rho in (0.0, 1.0):
        assert quoted(rho) == pytest.approx(limit("hulbert-chung", rho_b=rho)[0], rel=1e-14)
    for rho in (0.2, 0.4, 0.5, 0.8):
        assert 1.0005 < quoted(rho) / limit("hulbert-chung", rho_b=rho)[0] < 1.004
        assert radius("hulbert-chung", {"rho_b": rho}, quoted(rho)) > 1.002
    for x in (0.1, 2.0, 3.4):  # the scheme of Chung and Lee is a member of that of Hulbert and Chung
        np.testing.assert_allclose(matrix("hulbert-chung", {"rho_b": 0.5}, x), matrix("chung-lee", {}, x), atol=1e-15)
    for omega in (0.1, 1.0, 1.9):  # velocities swing for ever
        assert np.abs(roots("hulbert-chung", {"rho_b": 1.0}, omega) + 1).min() < 1e-14

    def period_error(rho, omega=0.02):
        return omega / np.angle(roots("hulbert-chung", {"rho_b": rho}, omega)).max() - 1

    # the leading error of the period vanishes at rho_b = .3665, and nowhere else
    assert period_error(0.366) > 0 > period_error(0.367)
    assert abs(period_error(0.3665)) < 1e-3 * abs(period_error(0.8))


def test_low_frequencies_would_grow_with_the_old_prediction():
    """What the docstring of `explicit-hht` says of the form with u*_n instead of u_n."""
    alpha, x = -0.1, 0.25
    beta, gamma = (1 - alpha) ** 2 / 4, 0.5 - alpha
    # state (u, dt v, dt^2 a, dt^2 f); f_{n+1} = -omega^2 u*_{n+1}
    predicted = np.array([1, 1, 0.5 - beta, 0])
    a = -(1 + alpha) * x * predicted - alpha * np.eye(4)[3]
    step = np.array([predicted + beta * a, np.array([0, 1, 1 - gamma, 0]) + gamma * a, a, -x * predicted])
    assert np.abs(np.linalg.eigvals(step)).max() > 1 + 1e-4
    assert radius("explicit-hht", {}, math.sqrt(x)) < 1 - 1e-4
