"""The multi-stage schemes that come with percuss, against amplification matrices written from the published formulas.

Derived from the published formulas; the sources' own figures were not at hand. What is reproduced of them are closed
forms that are quoted from them: limits, places where roots meet, and the spectral radius there. Of the explicit forms
of the alpha method the one is taken whose low frequencies do not grow. Kernels run as plain Python, but in impacts.
"""

import math
import re

import numpy as np
import pytest

import percuss
import places
from percuss.case.defaults import DEFAULTS
from percuss.certificate.oscillator import amplification
from percuss.jit import plain
from percuss.methods import slots
from percuss.testing.demands.integrators import check_stages
from percuss.testing.subject import Subject
from strategies import REGISTRY, hunek

PAGE = (places.ROOT / "plugins" / "STABILITY.md").read_text(encoding="utf-8")

# ------------------------------------------------------------- one step of u'' + omega^2 u = 0, x = (omega dt)^2

# Each scheme is a system `new @ (u, dt v, dt^2 a)_{n+1} = old @ (u, dt v, dt^2 a)_n`, written as its paper has it.


def step_of(new, old):
    return np.linalg.solve(np.array(new, dtype=float), np.array(old, dtype=float))


def newmark(x, gamma=0.5):
    new = [[1, 0, 0], [0, 1, -gamma], [x, 0, 1]]
    return step_of(new, [[1, 1, 0.5], [0, 1, 1 - gamma], [0, 0, 0]])


def tchamwa_wielgosz(x, phi=1.033):
    return np.array([[1 - phi * x, 1], [-x, 1]])


def chung_lee(x, beta=28 / 27):
    new = [[1, 0, -beta], [0, 1, -1.5], [0, 0, 1]]
    return step_of(new, [[1, 1, 0.5 - beta], [0, 1, -0.5], [-x, 0, 0]])


def hulbert_chung(x, rho_b=0.4):
    alpha = (2 * rho_b - 1) / (1 + rho_b)
    beta = (5 - 3 * rho_b) / ((1 + rho_b) ** 2 * (2 - rho_b))
    gamma = 1.5 - alpha
    new = [[1, 0, -beta], [0, 1, -gamma], [0, 0, 1 - alpha]]
    return step_of(new, [[1, 1, 0.5 - beta], [0, 1, 1 - gamma], [-x, 0, -alpha]])


def explicit_hht(x, alpha=-0.1):
    beta, gamma = (1 - alpha) ** 2 / 4, 0.5 - alpha
    # a_{n+1} + omega^2 ((1 + alpha) (u_{n+1} - beta dt^2 a_{n+1}) - alpha u_n) = 0: the prediction is what is corrected
    new = [[1, 0, -beta], [0, 1, -gamma], [x * (1 + alpha), 0, 1 - x * (1 + alpha) * beta]]
    return step_of(new, [[1, 1, 0.5 - beta], [0, 1, 1 - gamma], [x * alpha, 0, 0]])


SCHEMES = {
    "velocity-verlet": (newmark, [{}]),
    "explicit-newmark": (newmark, [{}, {"gamma": 0.6}, {"gamma": 1.0}]),
    "tchamwa-wielgosz": (tchamwa_wielgosz, [{}, {"phi": 1.0}, {"phi": 4 / 3}, {"phi": 2.0}]),
    "chung-lee": (chung_lee, [{}, {"beta": 1.0}, {"beta": 1.02}]),
    "hulbert-chung": (hulbert_chung, [{}, *({"rho_b": rho} for rho in (0.0, 0.25, 0.5, 0.8, 1.0))]),
    "explicit-hht": (explicit_hht, [{}, {"alpha": 0.0}, {"alpha": -0.05}, {"alpha": -1 / 3}]),
}
EACH = pytest.mark.parametrize(
    ("name", "options"),
    [(name, options) for name, (_, sets) in SCHEMES.items() for options in sets],
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


def roots(name, options, omega):
    return np.linalg.eigvals(SCHEMES[name][0](omega**2, **options))


def radius(name, options, omega):
    return np.abs(roots(name, options, omega)).max()


def made(name, options):
    return REGISTRY.get("integrators", name)(**options)


# ------------------------------------------------------------------------------------------------- the free motion


@EACH
def test_the_kernel_makes_the_published_step(name, options):
    integrator, dt = made(name, options), 0.37
    squares = np.array([0.01, 0.3, 1.0, 2.7, 3.5, 5.0])
    steps = amplification(integrator, integrator.bind(dt), dt, squares)
    for x, step in zip(squares, steps, strict=True):
        np.testing.assert_allclose(step, SCHEMES[name][0](x, **options), atol=1e-13)


@EACH
def test_the_limit_of_stability_is_the_published_one(name, options):
    critical = limit(name, **options)[0]
    # nearer to the limit up to three roots lie so close to -1 that they are known to the cube root of round-off alone
    grid = np.linspace(0.01, 1 - 1e-5, 400) * critical
    assert max(radius(name, options, omega) for omega in grid) < 1 + 1e-10
    assert radius(name, options, critical * (1 + 1e-4)) > 1 + 1e-5
    if not options:
        assert type(made(name, {})).critical_courant == pytest.approx(critical / 2, abs=5e-5)
        doc = re.findall(r"Courant number\s+of\s+(\.\d+)", type(made(name, {})).__doc__)
        assert doc == ([f"{critical / 2:.4f}".lstrip("0")] if critical < 2 else [])
        row = next(line for line in PAGE.splitlines() if line.startswith(f"| `{name}`"))
        assert f"without contact up to a Courant number of {critical / 2:.2g} |" in row


@EACH
def test_the_roots_meet_where_the_paper_says(name, options):
    """At Omega_b the radius is what the options say: rho_b, 2/phi - 1, and 1/2 of a threefold root of Chung and Lee."""
    _, meeting, least = limit(name, **options)
    if meeting is None:
        return
    found = np.sort_complex(roots(name, options, meeting))
    # n roots that meet are known to the n-th root of round-off
    assert np.abs(found[0] - found[1]) < (1e-4 if name in {"chung-lee", "hulbert-chung"} else 1e-7)
    assert np.abs(found[0] + least) < 1e-4
    if name == "chung-lee" or options == {"rho_b": 0.5}:
        np.testing.assert_allclose(found, -0.5, atol=1e-4)


def test_the_limit_of_hulbert_and_chung_is_not_the_one_that_is_quoted():
    """A polynomial that is quoted for Omega_s holds for rho_b of 0 and 1; between them the scheme grows there."""

    def quoted(rho):
        return math.sqrt(12 * (1 + rho) ** 3 * (2 - rho) / (10 + 15 * rho - rho**2 + rho**3 - rho**4))

    for rho in (0.0, 1.0):
        assert quoted(rho) == pytest.approx(limit("hulbert-chung", rho_b=rho)[0], rel=1e-14)
    for rho in (0.2, 0.4, 0.5, 0.8):
        assert 1.0005 < quoted(rho) / limit("hulbert-chung", rho_b=rho)[0] < 1.004
        assert radius("hulbert-chung", {"rho_b": rho}, quoted(rho)) > 1.002


def test_chung_lee_is_a_member_of_hulbert_chung():
    for x in (0.1, 2.0, 3.4):
        np.testing.assert_allclose(hulbert_chung(x, rho_b=0.5), chung_lee(x, beta=28 / 27), atol=1e-15)


def test_velocities_swing_for_ever_with_rho_b_of_one():
    for omega in (0.1, 1.0, 1.9):
        assert np.abs(roots("hulbert-chung", {"rho_b": 1.0}, omega) + 1).min() < 1e-14


def test_the_period_is_best_at_the_quoted_spectral_radius():
    """Hulbert and Chung's leading error of the period vanishes at rho_b = .3665, and nowhere else."""

    def period_error(rho, omega=0.02):
        return omega / np.angle(roots("hulbert-chung", {"rho_b": rho}, omega)).max() - 1

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


# -------------------------------------------------------------------------------------------- order, with a load


def end_of_march(name, options, dt, end=6.0):
    """March u'' + u = sin(2 t + .4) from u = .3 and v = 1 with the kernel in plain Python; return the largest error."""
    integrator = made(name, options)
    stages, time = integrator.bind(dt), [0.0]

    def accelerations(system, stage, u, v, a):
        a[:] = np.sin(2 * (time[0] + stages.times[stage] * dt) + 0.4) - u

    step = plain(type(integrator).step, {slots.accelerations: accelerations})
    u, v = np.array([0.3]), np.array([1.0])
    kept = np.full((integrator.kept, 1), math.sin(0.4) - 0.3)
    error = 0.0
    c, s = 0.3 + math.sin(0.4) / 3, 1.0 + 2 * math.cos(0.4) / 3
    for n in range(round(end / dt)):
        time[0] = n * dt
        step(stages.numbers, None, u, v, kept, dt)
        t = (n + 1) * dt
        exact = c * math.cos(t) + s * math.sin(t) - math.sin(2 * t + 0.4) / 3
        error = max(error, abs(u[0] - exact))
    return error


@EACH
def test_the_order_is_the_published_one(name, options):
    """Second order, but for Tchamwa and Wielgosz's scheme and Newmark's with gamma above 1/2; loads at their times."""
    first = name == "tchamwa-wielgosz" or options.get("gamma", 0.5) > 0.5
    if not options:
        assert type(made(name, {})).order == (1 if first else 2)
    one, other = (end_of_march(name, options, dt) for dt in (0.02, 0.01))
    assert math.log2(one / other) == pytest.approx(1 if first else 2, abs=0.06)


@pytest.mark.parametrize("name", SCHEMES)
def test_stages_are_where_they_are_declared(name):
    check_stages(Subject.of(REGISTRY.get("integrators", name), REGISTRY))


# ------------------------------------------------------------------------------------------------------ identities


IDENTICAL = [
    "velocity-verlet",
    "explicit-newmark",
    {"name": "chung-lee", "beta": 1.0},
    {"name": "hulbert-chung", "rho_b": 1.0},
]


def displacements(integrator, gap):
    case = hunek(5, courant=0.7, integrator=integrator, contact={"name": "penalty", "beta_s": 0.5}, end=0.5)
    case["bodies"]["long"]["at"] = 10.0 + gap
    case["loads"] = {"push": {"half-sine": {"peak": 0.02, "duration": 0.3}, "on": "long.left"}}
    result = percuss.run(percuss.load(case), compiled=False)
    assert (np.abs(result.arrays["contact_force"]).max() > 0) == (gap < 1)
    return result.arrays["displacement"]


@pytest.mark.parametrize("gap", [0.004, 10.0], ids=["contact", "free"])
def test_undamped_members_have_the_displacements_of_central_difference(gap):
    """To round-off, where no contact force acts at t = 0, which the leap-frog start leaves out."""
    expected = displacements("central-difference", gap)
    for integrator in IDENTICAL:
        found = displacements(integrator, gap)
        assert np.abs(found - expected).max() < 1e-11 * np.abs(expected).max(), integrator
    other = displacements({"name": "explicit-newmark", "gamma": 0.55}, gap)
    assert np.abs(other - expected).max() > 1e-3 * np.abs(expected).max()


def test_undamped_predictions_of_the_alpha_method_are_those_of_central_difference():
    integrator, dt, omega = made("explicit-hht", {"alpha": 0.0}), 0.1, 3.0
    predictions = []

    def accelerations(system, stage, u, v, a):
        predictions.append(u[0])
        a[:] = -(omega**2) * u

    step = plain(type(integrator).step, {slots.accelerations: accelerations})
    u, v, kept = np.array([0.3]), np.array([1.0]), np.array([[-(omega**2) * 0.3]])
    for _ in range(50):
        step(integrator.bind(dt).numbers, None, u, v, kept, dt)
    steps = np.array(predictions)
    second = steps[2:] - 2 * steps[1:-1] + steps[:-2]
    np.testing.assert_allclose(second, -((omega * dt) ** 2) * steps[1:-1], atol=1e-13)


# --------------------------------------------------------------------------------------------------------- impacts

# On the bars of cases/hunek.yaml: bounds of the L1 error of the force with the default law and with the penalty, and of
# the energy at the end over that at the begin; with the default law some gain where the contact opens.
IMPACTS = {
    "velocity-verlet": (0.030, 0.081, 0.9999, 1.0014),
    "explicit-newmark": (0.030, 0.081, 0.9999, 1.0014),
    "tchamwa-wielgosz": (0.029, 0.035, 0.984, 0.986),
    "chung-lee": (0.030, 0.036, 0.997, 0.999),
    "hulbert-chung": (0.030, 0.033, 0.996, 0.998),
    "explicit-hht": (0.030, 0.036, 0.997, 0.999),
}


@pytest.mark.deep
@pytest.mark.parametrize("law", [DEFAULTS["contacts"], "penalty"])
@pytest.mark.parametrize("name", SCHEMES)
def test_the_impact_of_hunek(name, law):
    result = percuss.run(percuss.load(hunek(100, 0.5, name, {"name": law})))
    by_default, by_penalty, least, most = IMPACTS[name]
    error = by_default if law == DEFAULTS["contacts"] else by_penalty
    energy = (result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]) / result.summary["energy"]["initial"]
    assert 0.9 * error < result.summary["exact"]["contacts"]["tip"]["force_error_l1"] < error
    assert energy.max() < max(most, 1.0001) + 1e-4
    assert least < energy[-1] < most
    assert result.summary["certificate"]["stable"] == "yes"


@pytest.mark.parametrize("name", SCHEMES)
def test_lagrange_is_refused_where_its_promise_would_be_broken(name, monkeypatch):
    """Each refusal is for cause: without it the bodies overlap, or the reported force pulls."""
    case = hunek(5, courant=0.8, integrator=name, contact={"name": "lagrange"}, end=0.5)
    if name not in {"tchamwa-wielgosz", "velocity-verlet", "explicit-newmark"}:
        with pytest.raises(percuss.RefusedPair, match=r"lagrange (never pulls|allows no overlap)") as refused:
            percuss.run(percuss.load(case), compiled=False)
        assert refused.value.said_by == name
        monkeypatch.delattr(type(made(name, {})), "refuses")
    result = percuss.run(percuss.load(case), compiled=False)
    pulls = result.arrays["contact_force"].min() < -1e-4
    overlaps = result.arrays["gap"].min() < -1e-6
    assert pulls == (name in {"chung-lee", "hulbert-chung"})
    assert overlaps == (name == "explicit-hht")
