"""Implicit schemes with contact at the end of the step, against dense matrices and published behaviour."""

import copy
import itertools
import math

import numpy as np
import pytest

import dense
import percuss
from percuss.certificate.maps import stability
from percuss.certificate.verdict import certificate, settled
from percuss.march.implicit import solved, stiffness_matrix
from percuss.march.model import Model

STEEL = {"young": 100.0, "density": 0.01}


def scheme(alpha=0.0):
    return {"name": "implicit-hht", "alpha": alpha}


def three_bars(contact="regularised-lagrange", alpha=0.0, **time):
    """Two bars collide, the second strikes a fixed third one; gravity and a force act."""
    return {
        "percuss": 1,
        "bodies": {
            "a": {"bar": {"length": 1.0, "elements": 7}, "material": STEEL, "area": 1.0, "velocity": 0.3},
            "b": {"bar": {"length": 0.3, "elements": 1}, "at": 1.0, "material": STEEL, "area": 0.7, "velocity": -0.1},
            "c": {
                "bar": {"length": 0.8, "elements": 5},
                "at": 1.301,
                "material": {"young": 60.0, "density": 0.02},
                "area": 1.3,
                "velocity": 0.0,
                "fixed": ["right"],
            },
        },
        "contacts": {"ab": {"between": ["a.right", "b.left"]}, "bc": {"between": ["b.right", "c.left"]}},
        "loads": {
            "weight": {"gravity": 0.7},
            "push": {"ramp": {"value": 0.02, "duration": 0.03}, "on": "a.left"},
        },
        "method": {"integrator": scheme(alpha), "contact": contact},
        "time": {"steps": 60, "courant": 1.7} | time,
        "record": {"probes": ["a.left", "a.right", "b.left", "c.left", "c.right"]},
    }


def run(case):
    return percuss.run(percuss.load(case))


def reference(case, compliance):
    """Return multipliers, gaps, u, v and a at t_n by accelerations in full matrices, trying all active sets."""
    bars = dense.assemble(case)
    alpha = case["method"]["integrator"]["alpha"]
    beta, gamma = (1.0 - alpha) ** 2 / 4.0, 0.5 - alpha
    dt = case["time"]["courant"] * min(
        h.min() / math.sqrt(bars.given[name]["material"]["young"] / bars.given[name]["material"]["density"])
        for name, h in bars.lengths.items()
    )
    size = bars.x.size
    free = np.arange(size - 1)  # the right end of the last bar is fixed
    normals, gap0 = np.zeros((size, 2)), np.zeros(2)
    for k, (left, right) in enumerate((("a.right", "b.left"), ("b.right", "c.left"))):
        normals[bars.node(left), k], normals[bars.node(right), k] = -1.0, 1.0
        gap0[k] = bars.x[bars.node(right)] - bars.x[bars.node(left)]
    gap0[np.abs(gap0) < 1e-9] = 0.0

    def force(t):
        f = bars.M @ np.full(size, 0.7)
        f[bars.node("a.left")] += 0.02 * min(t / 0.03, 1.0)
        return f

    def lagged(after, before):
        return (1.0 + alpha) * after - alpha * before

    u, v, a, multiplier = np.zeros(size), bars.v.copy(), np.zeros(size), np.zeros(2)
    v[-1] = 0.0
    a[free] = (np.linalg.inv(bars.M) @ force(0.0))[free]
    out = []
    left = bars.M + (1.0 + alpha) * beta * dt**2 * bars.K
    for n in range(case["time"]["steps"] + 1):
        out.append((multiplier, gap0 + normals.T @ u, u, v, a))
        ahead = u + dt * v + dt**2 * (0.5 - beta) * a
        right = lagged(force((n + 1) * dt), force(n * dt)) - bars.K @ lagged(ahead, u)
        best = None
        for closed in itertools.chain.from_iterable(itertools.combinations(range(2), k) for k in range(3)):
            # a and lambda of the closed contacts together, one system
            columns = list(closed)
            N = normals[free][:, columns]
            block = np.block([[left[np.ix_(free, free)], -N], [beta * dt**2 * N.T, compliance * np.eye(len(columns))]])
            gap_ahead = (gap0 + normals.T @ ahead)[columns]
            solution = np.linalg.solve(block, np.concatenate([right[free], -gap_ahead]))
            acceleration, trial = np.zeros(size), np.zeros(2)
            acceleration[free], trial[columns] = solution[: free.size], solution[free.size :]
            gap = gap0 + normals.T @ (ahead + beta * dt**2 * acceleration) + compliance * trial
            miss = max(-trial.min(), -gap.min() * 1000.0, 0.0)
            if best is None or miss < best[0] - 1e-12:
                best = miss, acceleration, trial
        _, after, multiplier = best
        u, v, a = ahead + beta * dt**2 * after, v + dt * ((1.0 - gamma) * a + gamma * after), after
    return [np.array(column) for column in zip(*out, strict=True)], bars


@pytest.mark.parametrize("alpha", [0.0, -0.1, -1.0 / 3.0])
@pytest.mark.parametrize("contact", ["regularised-lagrange", "lagrange"])
def test_motion_and_multipliers_are_those_of_full_matrices(contact, alpha):
    law = {"name": contact} | ({"epsilon_s": 400.0} if contact == "regularised-lagrange" else {})
    case = three_bars(law, alpha)
    (multiplier, gap, u, v, _), bars = reference(case, 1.0 / 400.0 if contact == "regularised-lagrange" else 0.0)
    result = run(case)
    assert (multiplier > 0.0).any(axis=0).all()
    assert np.abs(result.arrays["contact_force"] - multiplier).max() < 1e-9 * multiplier.max()
    assert np.abs(result.arrays["gap"] - gap).max() < 1e-12
    for k, probe in enumerate(case["record"]["probes"]):
        assert np.abs(result.arrays["displacement"][:, k, 0] - u[:, bars.node(probe)]).max() < 1e-12
        assert np.abs(result.arrays["velocity"][:, k, 0] - v[:, bars.node(probe)]).max() < 1e-10
    kinetic = 0.5 * np.einsum("ni,ij,nj->n", v, bars.M, v)
    elastic = 0.5 * np.einsum("ni,ij,nj->n", u, bars.K, u)
    assert np.abs(result.arrays["kinetic_energy"] - kinetic).max() < 1e-10 * kinetic.max()
    assert np.abs(result.arrays["elastic_energy"] - elastic).max() < 1e-10 * kinetic.max()
    assert np.array_equal(result.arrays["time_half"], result.arrays["time"])
    assert result.histories["kinetic_energy"].attrs["definition"] == "kinetic energy at t_n"
    assert result.histories["contact_force"].attrs["definition"].startswith("contact force that moves the mass")


def test_a_penalty_is_the_compliance_at_the_end_of_the_step():
    ours = run(three_bars({"name": "penalty", "epsilon_s": 400.0}))
    theirs = run(three_bars({"name": "regularised-lagrange", "epsilon_s": 400.0}))
    assert np.array_equal(ours.arrays["contact_force"], theirs.arrays["contact_force"])


@pytest.mark.parametrize(
    "contact", ["lagrange", *(pytest.param(law, marks=pytest.mark.deep) for law in ("penalty", "tied"))]
)
def test_accounts_close_whatever_the_scheme_and_the_contact(contact):
    for alpha, courant in itertools.product((0.0, -0.2), (0.5, 3.0)):
        summary = run(three_bars(contact, alpha, courant=courant, steps=150, on_unstable="warn")).summary
        assert summary["energy"]["ledger_error"] < 1e-11
        assert summary["momentum"]["error"] < 1e-11
        dissipated = summary["energy"]["dissipated"] / summary["energy"]["max"]
        assert abs(dissipated) < 1e-11 if alpha == 0.0 else dissipated > 1e-4


def test_work_is_that_of_the_trapezoidal_rule():
    """(f_n + f_{n+1}) / 2 times the way of the step, for alpha = 0."""
    case = three_bars()
    (multiplier, gap, *_), _ = reference(case | {"method": {"integrator": scheme(), "contact": ""}}, 1.0 / 200.0)
    case["method"]["contact"] = {"name": "regularised-lagrange", "epsilon_s": 200.0}
    result = run(case)
    work = np.cumsum(0.5 * (multiplier[1:] + multiplier[:-1]) * np.diff(gap, axis=0), axis=0).sum(axis=1)
    assert np.abs(result.arrays["contact_work"][1:] - work).max() < 1e-11 * np.abs(work).max()
    impulse = result.summary["contacts"]["ab"]["impulse"] / result.summary["dt"]
    assert impulse == pytest.approx(0.5 * (multiplier[1:, 0] + multiplier[:-1, 0]).sum(), rel=1e-10)


def test_rotation_and_elements_of_more_nodes():
    case = three_bars("lagrange", -0.1)
    del case["loads"]
    force = run(case).arrays["contact_force"]
    turned = copy.deepcopy(case)
    for body in turned["bodies"].values():
        body["bar"]["direction"] = [0.6, 0.8]
        body["at"] = [0.6 * body.get("at", 0.0), 0.8 * body.get("at", 0.0)]
    assert np.abs(run(turned).arrays["contact_force"] - force).max() < 1e-8 * force.max()
    case["bodies"]["a"]["element"] = {"name": "spectral-bar", "order": 3}
    model = Model(percuss.load(case))
    matrix = stiffness_matrix(model)
    assert abs(matrix - matrix.T).max() < 1e-12
    start, stop = model.bodies["a"].start, model.bodies["a"].stop
    assert np.abs(matrix[start:stop, start:stop] @ np.ones(stop - start)).max() < 1e-10
    along = model.bodies.nodes[start:stop, 0]
    assert along @ (matrix[start:stop, start:stop] @ along) == pytest.approx(100.0, rel=1e-10)  # EA L at unit strain
    assert run(case).summary["energy"]["ledger_error"] < 1e-11


# ---------------------------------------------------------------------------------------------- published facts


def oscillator(alpha, omega_dt, steps):
    """Return the case of a single mass: a bar of one element that is fixed at one end."""
    bar = {"bar": {"length": 1.0, "elements": 1}, "material": STEEL, "area": 1.0, "velocity": 1.0, "fixed": ["left"]}
    omega = math.sqrt(100.0 / 0.005)
    return {
        "percuss": 1,
        "bodies": {"a": bar},
        "contacts": {},
        "method": {"integrator": scheme(alpha)},
        "time": {"step": omega_dt / omega, "steps": steps},
        "record": {"probes": ["a.right"]},
    }


def test_the_trapezoidal_rule_has_the_period_of_the_text():
    """tan(omega' dt / 2) = omega dt / 2, so that periods are longer by (omega dt)^2 / 12; and no amplitude decays."""
    omega_dt = 0.6
    u = run(oscillator(0.0, omega_dt, 400)).arrays["displacement"][:, 0, 0]
    turned = 2.0 * math.atan(omega_dt / 2.0)
    expected = np.sin(turned * np.arange(u.size))
    assert np.abs(u / np.abs(u).max() - expected).max() < 2e-3
    assert np.abs(u - expected * (u @ expected) / (expected @ expected)).max() < 1e-10 * u.max()


@pytest.mark.parametrize(("alpha", "least"), [(-0.05, 19 / 21), (-0.1, 9 / 11), (-1 / 3, 0.5)])
def test_the_alpha_method_damps_the_highest_frequencies_as_published(alpha, least):
    """Hilber, Hughes, Taylor (1977): the spectral radius falls to (1 + alpha) / (1 - alpha), 1/2 for alpha = -1/3."""
    assert least == pytest.approx((1.0 + alpha) / (1.0 - alpha))
    velocity = run(oscillator(alpha, 1e3, 40)).arrays["velocity"][:, 0, 0]
    # the two roots are equal there: the amplitude falls as n least^n
    ratio = np.abs(velocity[31:] / velocity[30:-1]) * np.arange(30, 40) / np.arange(31, 41)
    assert ratio == pytest.approx(least, rel=2e-2)


def test_without_contact_the_trapezoidal_rule_conserves_energy_at_any_step():
    case = three_bars(courant=25.0, steps=800)
    del case["contacts"], case["loads"]
    case["bodies"]["b"]["at"], case["bodies"]["c"]["at"] = 5.0, 9.0
    result = run(case)
    energy = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-10
    assert result.summary["certificate"]["stable"] == "yes"


@pytest.mark.deep
@pytest.mark.parametrize("case", ["hunek", "doyen-impact"])
def test_with_exact_multipliers_the_trapezoidal_rule_oscillates_and_gains_energy_and_damping_cures_it(case):
    """Doyen, Ern, Piperno (2011): spurious oscillations and no conservation; HHT takes a part of them."""
    loaded = percuss.load(f"cases/{case}.yaml", {"method.contact": "lagrange", "time.courant": 0.5})
    trapezoidal = percuss.run(loaded, {"method.integrator": scheme()})
    energy = trapezoidal.summary["energy"]
    assert energy["final"] > 2.0 * energy["initial"]
    pressing = trapezoidal.arrays["contact_force"][:, 0]
    closed = np.flatnonzero(pressing > 0.0)
    assert np.mean(pressing[closed[0] : closed[-1]] == 0.0) > 0.1  # it lets go in the middle of the contact
    damped = percuss.run(loaded, {"method.integrator": scheme(-0.3)}).summary
    assert damped["energy"]["final"] < damped["energy"]["initial"]
    (name,) = damped["exact"]["contacts"]
    errors = [summary["exact"]["contacts"][name]["force_error_l1"] for summary in (trapezoidal.summary, damped)]
    assert errors[1] < 0.1 * errors[0]


@pytest.mark.parametrize("courant", [0.5, 1.0, 2.0, 5.0])
def test_a_compliance_keeps_the_trapezoidal_rule_calm_at_any_step(courant):
    result = percuss.run(
        percuss.load("cases/hunek.yaml"),
        {"method.integrator": scheme(), "method.contact": "regularised-lagrange", "time.courant": courant},
    )
    assert result.summary["certificate"]["stable"] == "yes"
    assert result.summary["energy"]["final"] == pytest.approx(result.summary["energy"]["initial"], rel=2e-3)
    assert result.summary["exact"]["contacts"]["tip"]["force_error_l1"] < 0.1
    assert any("NumPy and SciPy" in note for note in result.summary["notes"])
    assert result.summary["compiled"] is False


# ---------------------------------------------------------------------------------------- certificate, refusals


def test_a_gap_held_closed_grows_in_its_multiplier_and_is_unknown_to_the_certificate():
    """With g = 0 the trapezoidal rule turns the velocity of the gap around in each step, and lambda grows with n."""
    case = three_bars("lagrange")
    case["loads"] = {"press": {"constant": 3.0, "on": "a.left"}}
    case["bodies"]["c"]["at"] = 1.3
    for body in case["bodies"].values():
        body["velocity"] = 0.0
    judged = certificate(Model(percuss.load(case)))
    assert judged["stable"] == "unknown"
    assert "multiplier grows" in judged["why"]
    (found,) = {certificate(Model(percuss.load(three_bars(law))))["stable"] for law in ("penalty", "tied")}
    assert found == "yes"
    assert certificate(Model(percuss.load(three_bars("penalty", -0.1))))["stable"] == "unknown"


@pytest.mark.deep
def test_the_tie_of_rates_stays_bounded():
    result = run(three_bars("tied", steps=4000, courant=0.7))
    energy = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"] - result.arrays["external_work"]
    assert energy[100:].max() < 1.001 * energy[:100].max()


@pytest.mark.parametrize(
    ("contact", "reason"),
    [
        ("bipenalty", "weighs the gap acceleration"),
        ("damped-penalty", "weighs the gap rate"),
        ("hunt-crossley", "has a kernel"),
        ("uzawa", "has a kernel"),
        ("nitsche", "no acceleration of the gap"),
        ("moreau-jean", "solves for the force at the end of a step"),
        ("paoli-schatzman", "solves for the force at the end of a step"),
    ],
)
def test_other_laws_are_refused_with_the_reason(contact, reason):
    with pytest.raises(percuss.RefusedPair, match=reason):
        Model(percuss.load(three_bars(contact)))


def test_other_loads_bodies_and_questions_are_refused():
    case = three_bars()
    case["loads"]["drive"] = {"prescribed-velocity": 0.1, "on": "a.left"}
    del case["loads"]["push"]
    with pytest.raises(percuss.InputError, match="how an end moves"):
        Model(percuss.load(case))
    case["loads"]["drive"] = {"spring-dashpot": {"stiffness": 1.0}, "on": "a.left"}
    with pytest.raises(percuss.InputError, match="how an end moves"):
        Model(percuss.load(case))
    case = three_bars()
    case["bodies"]["a"]["element"] = "green-bar"
    with pytest.raises(percuss.InputError, match="expected linear bodies"):
        Model(percuss.load(case))
    with pytest.raises(percuss.InputError, match="No step is critical"):
        settled(percuss.load(three_bars(courant="auto")))
    (row,) = stability(percuss.load(three_bars()))
    assert row["courant_critical"] is None
    assert "implicit" in row["reason"]


def test_multipliers_solve_the_mixed_complementarity_problem():
    random = np.random.default_rng(3)
    for count in range(1, 7):
        for _ in range(20):
            root = random.standard_normal((count, count))
            matrix = (root @ root.T + 0.1 * np.eye(count)) * 10.0 ** random.integers(-9, 9)
            right, pushes = random.standard_normal(count), random.integers(0, 2, count).astype(bool)
            x = solved(matrix, right, pushes)
            rest = matrix @ x + right
            assert np.abs(rest[~pushes]).max(initial=0.0) < 1e-9
            assert (x[pushes] >= 0.0).all()
            assert (rest[pushes] > -1e-9).all()
            assert np.abs(x * rest)[pushes].max(initial=0.0) <= 1e-9 * np.abs(x).max()
