"""Laws that see and push the force of end elements, Nitsche's method first of all: against dense matrices.

The reference is written from the formulas alone: ``M (u_{n+1} - 2 u_n + u_{n-1}) / dt^2 = -K u_n + sum of P lambda +
c Sigma Sigma^T u_n``. Of Chouly, Hild and Renard (ESAIM: M2AN 49, 2015) it
has the balance of energy, which their first part proves for every theta; the figures of the source were not at hand.
"""

import functools
import itertools
from pathlib import Path

import numpy as np
import pytest

import percuss
from dense import assemble
from percuss.certificate import verdict
from percuss.certificate.closed_contacts import closed_contacts
from percuss.certificate.criteria import RunCriterion, step_criterion
from percuss.certificate.decoupled_gaps import DecoupledGapsCriterion, EnergyAtEndCriterion, closed_form
from percuss.march.march import March
from percuss.march.model import Model
from strategies import hunek, run

LAWS = str(Path(__file__).parent.parent / "support" / "bodies" / "end_forces.py")
CD, WU = "central-difference", "wu-predictor-corrector"
STEEL, BRASS = {"young": 100.0, "density": 0.01}, {"young": 49.0, "density": 0.02}
THETAS = (1.0, 0.3, 0.0, -1.0)
WALL = {
    "percuss": 1,
    "bodies": {"a": {"bar": {"length": 1.0, "elements": 6}, "material": STEEL, "area": 1.3, "velocity": 1.3}},
    "contacts": {"c": {"body": "a.right", "wall": 1.01}},
    "time": {"steps": 400, "courant": 0.5},
    "record": {"probes": ["a.left", "a.right"]},
}  # fmt: skip
# Unlike bars of unlike areas, elements and masses; the far end of the second is fixed.
PAIR = {
    **WALL,
    "bodies": {
        "a": {"bar": {"length": 1.0, "elements": 6, "grading": 1.4}, "material": STEEL, "area": 1.0, "velocity": 1.3},
        "b": {
            "bar": {"length": 1.4, "elements": 4}, "at": 1.01, "material": BRASS, "area": 1.6, "velocity": 0.0,
            "fixed": ["right"],
        },
    },
    "contacts": {"c": {"between": ["a.right", "b.left"]}},
}  # fmt: skip
# Three ends that meet, a wall at one of them, and bars of one and two elements between contacts.
STAR = {
    **WALL,
    "bodies": {
        "a": {"bar": {"length": 1.0, "elements": 3}, "material": STEEL, "area": 1.0, "velocity": 1.0},
        "b": {"bar": {"length": 1.4, "elements": 1}, "at": 1.002, "material": BRASS, "area": 0.6, "velocity": -0.1},
        "c": {"bar": {"length": 0.7, "elements": 2}, "at": 1.0035, "material": STEEL, "area": 0.8, "velocity": -0.3},
    },
    "contacts": {
        "ab": {"between": ["a.right", "b.left"]},
        "ac": {"between": ["a.right", "c.left"]},
        "wall": {"body": "a.right", "wall": 1.005},
        "end": {"body": "b.right", "wall": 2.43},
        "last": {"body": "c.right", "wall": 1.73},
    },
}  # fmt: skip


def nitsche(theta, **options):
    return {"name": "nitsche", "theta": theta, "stress_from": "elements", **options}


def with_law(case, law, integrator=CD, **time):
    return {
        **case,
        "plugins": [LAWS],
        "method": {"integrator": integrator, "contact": law},
        "time": {**case["time"], **time},
    }


def ran(case, law, integrator=CD, **time):
    return run(with_law(case, law, integrator, **time))


# ------------------------------------------------------------------------------------------------ the reference


class Dense:
    """Dense matrices of a case: K, 1/M, N, Sigma, kappa and gaps; ends that are fixed have 1/M = 0."""

    def __init__(self, case):
        bars = assemble(case)
        self.bars, self.K, self.mass = bars, bars.K, np.diag(bars.M)
        self.inverse = 1.0 / self.mass
        for name, body in case["bodies"].items():
            for end in body.get("fixed", ()):
                self.inverse[bars.node(f"{name}.{end}")] = 0.0
        contacts = case["contacts"].values()
        self.N, self.Sigma = np.zeros((2, self.mass.size, len(contacts)))
        self.kappa, self.gap = np.zeros((2, len(contacts)))
        for p, contact in enumerate(contacts):
            ends = contact.get("between", [contact.get("body")])
            nodes = [bars.node(end) for end in ends]
            assert ends[0].endswith("right")
            self.gap[p] = (bars.x[nodes[1]] if len(nodes) == 2 else contact["wall"]) - bars.x[nodes[0]]
            weights = self.inverse[nodes] / self.inverse[nodes].sum()
            for end, node, weight, sign in zip(ends, nodes, weights, (-1.0, 1.0), strict=False):
                inner = node - 1 if end.endswith("right") else node + 1
                stiffness = bars.end(end)[0]
                self.N[node, p] = sign
                # In tension the outer node of an element has moved further outward than the inner one.
                self.Sigma[node, p] -= sign * weight * stiffness
                self.Sigma[inner, p] += sign * weight * stiffness
                self.kappa[p] += weight**2 * stiffness

    def functionals(self, gamma, a, b):
        return self.N + a * self.Sigma / gamma, self.N + b * self.Sigma / gamma

    def stiffness(self, gamma, c):
        return self.K - (self.Sigma * (c / gamma)) @ self.Sigma.T

    def march(self, case, dt, gamma, a, b, c, at):
        """Return forces, gaps, displacements; `at` is "current", "predicted" or "end"."""
        G, P = self.functionals(gamma, a, b)
        K = self.stiffness(gamma, c)
        operator = np.diag(1.0 / gamma) + dt**2 * G.T @ (self.inverse[:, None] * P)
        u = np.zeros(self.mass.size)
        v = np.where(self.inverse > 0.0, self.bars.v, 0.0)
        forces, displacements = [], []
        for _ in range(case["time"]["steps"] + 1):
            v = v - dt * self.inverse * (K @ u)
            seen = self.gap + G.T @ (u if at == "current" else u + dt * v)
            force = gamma * np.maximum(-seen, 0.0) if at != "end" else complementary(operator, -seen)
            forces.append(force)
            displacements.append(u)
            v = v + dt * self.inverse * (P @ force)
            u = u + dt * v
        displacements = np.array(displacements)
        return np.array(forces), self.gap + displacements @ self.N, displacements

    def radius(self, dt, gamma, theta, at):
        """Return the spectral radius of the step with all contacts closed."""
        G, P = self.functionals(gamma, 1.0, theta)
        n = self.mass.size
        pull = dt**2 * self.inverse[:, None] * self.stiffness(gamma, theta)
        step = np.block([[np.eye(n) - pull, np.eye(n)], [-pull, np.eye(n)]])  # of (u, dt v)
        seen = np.hstack([G.T, np.zeros_like(G.T)])
        if at == "predicted":
            seen = seen @ step
        push = -(dt**2) * self.inverse[:, None] * P @ (gamma[:, None] * seen)
        return np.abs(np.linalg.eigvals(step + np.vstack([push, push]))).max()


def complementary(operator, right):
    """Return x >= 0 with ``operator x - right >= 0`` and one of both zero at each place, by trying all sets."""
    best, least = np.zeros(right.size), np.inf
    for size in range(right.size + 1):
        for active in map(list, itertools.combinations(range(right.size), size)):
            x = np.zeros(right.size)
            x[active] = np.linalg.solve(operator[np.ix_(active, active)], right[active])
            miss = max(-(operator @ x - right).min(), -(x * np.diag(operator)).min(), 0.0)
            if miss < least - 1e-14 * np.abs(right).max():
                best, least = x, miss
    assert least <= 1e-12 * max(np.abs(right).max(), 1e-300)
    return best


def gamma_of(result):
    resolved = result.provenance["resolved"]["contacts"].values()
    return np.array([one.get("epsilon_s", one.get("gamma")) for one in resolved])


def agrees(result, reference, within=1e-12):
    for name, expected in zip(("contact_force", "gap"), reference, strict=False):
        assert np.abs(result.arrays[name] - expected).max() <= within * np.abs(expected).max(), name


def accounts_close(result, within=1e-12):
    assert result.summary["energy"]["ledger_error"] <= within
    assert result.summary["momentum"]["error"] <= within


# --------------------------------------------------------------------------------------- against dense matrices


@pytest.mark.parametrize("theta", THETAS)
@pytest.mark.parametrize("integrator", [CD, WU])
@pytest.mark.parametrize("case", [WALL, PAIR], ids=["wall", "pair"])
def test_a_run_of_nitsche_is_that_of_dense_matrices(case, integrator, theta):
    dense = Dense(case)
    result = ran(
        case, nitsche(theta, epsilon_s=float(4.0 * dense.kappa[0])), integrator, courant=0.3, on_unstable="warn"
    )
    at = "current" if integrator == CD else "predicted"
    forces, gaps, _ = reference = dense.march(case, result.summary["dt"], gamma_of(result), 1.0, theta, theta, at)
    assert np.count_nonzero(forces) > 15
    assert gaps.max() > 0.005
    agrees(result, reference)
    accounts_close(result)


def test_automatic_gamma_is_twice_kappa():
    for case in (WALL, PAIR):
        assert gamma_of(ran(case, nitsche(1.0), steps=1)) == pytest.approx(2.0 * Dense(case).kappa, rel=1e-13)


def test_compiled_and_plain_runs_are_the_same_up_to_round_off():
    law = {"a": nitsche(-1.0), "b": nitsche(1.0)}
    case = with_law(PAIR, law["a"]) | {"bodies": PAIR["bodies"] | {"a": PAIR["bodies"]["a"] | {"fixed": []}}}
    case["contacts"] = {
        **PAIR["contacts"], "behind": {"body": "a.left", "wall": -0.01, "method": law["b"]},
    }  # fmt: skip
    one, other = run(case), run(case, compiled=False)
    for name in ("contact_force", "gap", "contact_work", "contact_energy"):
        assert np.abs(one.arrays[name] - other.arrays[name]).max() <= 1e-11 * np.abs(one.arrays[name]).max()


@pytest.mark.parametrize(("a", "b", "c"), [(1.0, 1.0, 1.0), (1.0, -0.3, -0.3), (0.0, 0.4, 0.0), (0.7, 0.0, 0.5)])
def test_coupled_points_are_solved_with_what_is_seen_and_what_is_pushed(a, b, c):
    """S is G^T M^-1 P, not symmetric, between contacts that share ends and the nodes beside them."""
    law = {"name": "any-end-force", "a": a, "b": b, "c": c, "gamma": 3.0}
    result = ran(STAR, law, steps=60, on_unstable="warn")
    dense = Dense(STAR)
    agrees(
        result,
        dense.march(with_law(STAR, law, steps=60), result.summary["dt"], gamma_of(result), a, b, c, "end"),
        1e-10,
    )
    assert (np.count_nonzero(result.arrays["contact_force"], axis=1) > 2).any()
    accounts_close(result)


def test_the_operator_of_the_loop_is_that_of_dense_matrices():
    law = {"name": "any-end-force", "a": 0.6, "b": -1.7, "c": 0.2, "gamma": 3.0}
    model = Model(percuss.load(with_law(STAR, law)))
    points, dense = March(model, compiled=False).arrays.step.points, Dense(STAR)
    G, P = dense.functionals(3.0 * dense.kappa, 0.6, -1.7)
    expected = G.T @ (dense.inverse[:, None] * P)
    assert np.abs(expected - expected.T).max() > 0.05 * np.abs(expected).max()
    found = np.diag(points.law.delassus)
    for p, point in enumerate(points.law):
        for other in points.others[point.other_start : point.other_stop]:
            found[p, other.point] = other.value
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())
    kappa = model.binding.points(range(5), model.dt).trace_stiffness
    np.testing.assert_allclose(kappa, dense.kappa, rtol=1e-13)


@functools.cache
def turned(direction):
    bodies = {
        "a": {"bar": {"length": 1.0, "elements": 6, "direction": list(direction)}, "material": STEEL, "area": 1.0,
              "velocity": 1.3},
        "b": {"bar": {"length": 1.4, "elements": 4, "direction": list(direction)},
              "at": [1.01 * x for x in direction], "material": BRASS, "area": 1.6, "velocity": 0.0,
              "fixed": ["right"]},
    }  # fmt: skip
    return ran({**PAIR, "bodies": bodies}, nitsche(-1.0))


def test_a_case_turned_in_space_has_the_same_forces():
    one, other = turned((1.0, 0.0)), turned((0.6, -0.8))
    assert np.count_nonzero(one.arrays["contact_force"]) > 15
    for name in ("contact_force", "gap"):
        assert np.abs(one.arrays[name] - other.arrays[name]).max() <= 1e-10 * np.abs(one.arrays[name]).max()
    accounts_close(other)


# ------------------------------------------------------------------------------------------------ consistency


@pytest.mark.parametrize("at", ["explicit", "end"])
@pytest.mark.parametrize("theta", THETAS)
@pytest.mark.parametrize("case", [WALL, PAIR], ids=["wall", "pair"])
def test_a_pressed_bar_stays_at_rest_with_the_exact_pressure_and_no_overlap(case, theta, at):
    """A penalty needs an overlap for that. Wu's predictor-corrector shows explicit laws a gap without the force."""
    pressure = 3.0
    contacts = {"c": {**case["contacts"]["c"], **({"wall": 1.0} if case is WALL else {})}}
    bodies = {name: body | {"at": float(name == "b"), "velocity": 0.0} for name, body in case["bodies"].items()}
    loads = {"push": {"constant": pressure, "on": "a.left"}}
    law = {"name": "any-end-force", "a": 1.0, "b": theta, "c": theta, "at": at}
    pressed = {**with_law(case, law), "contacts": contacts, "bodies": bodies, "loads": loads}
    march = March(Model(percuss.load(pressed)), compiled=False)
    K, bars = assemble(pressed).K, assemble(pressed)
    held = [bars.node("a.right"), *([bars.node("b.left"), bars.node("b.right")] if case is PAIR else [])]
    force = np.zeros(K.shape[0])
    force[bars.node("a.left")] = pressure
    if case is PAIR:  # both ends of the contact move together
        tie = np.eye(K.shape[0])[:, np.setdiff1d(np.arange(K.shape[0]), held[1:])]
        tie[held[1], held[0]] = 1.0
    else:
        tie = np.eye(K.shape[0])[:, np.setdiff1d(np.arange(K.shape[0]), held)]
    rest = tie @ np.linalg.solve(tie.T @ K @ tie, tie.T @ force)
    march.u[:], march.v[:] = rest, 0.0
    largest = 0.0
    for n in range(50):
        assert march.advance(march.stepper.amplitudes(n, 1), n, 1) == 1
        largest = max(largest, abs(march.arrays.step.points.state[0].multiplier - pressure))
    assert largest <= 1e-11 * pressure
    assert np.abs(march.u - rest).max() <= 1e-12 * np.abs(rest).max()


# ------------------------------------------------------------------------------------------------------ energy


@pytest.mark.parametrize("theta", THETAS)
def test_energy_changes_as_the_source_proves(theta):
    """``d/dt (E + theta (lambda^2 - F^2) / (2 gamma)) = (1 - theta) lambda g'`` while contact is closed (2015, part 1).

    Central difference keeps it in every step that neither opens nor closes the contact.
    """
    dense = Dense(PAIR)
    result = ran(PAIR, nitsche(theta))
    dt, (gamma,) = result.summary["dt"], gamma_of(result)
    force, gap, u = dense.march(with_law(PAIR, nitsche(theta)), dt, gamma_of(result), 1.0, theta, theta, "current")
    energy = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
    F, lam = (u @ dense.Sigma)[:, 0], force[:, 0]
    products = 0.5 * theta * (lam[1:] * lam[:-1] - F[1:] * F[:-1]) / gamma  # at n + 1/2
    total = energy[: products.size] + products
    change = np.diff(total) - 0.5 * (1.0 - theta) * lam[1:-1] * (gap[2:, 0] - gap[:-2, 0])
    steady = ((lam[:-2] > 0) == (lam[1:-1] > 0)) & ((lam[2:] > 0) == (lam[1:-1] > 0))
    assert np.count_nonzero(lam[1:-1][steady]) > 15
    assert np.abs(change[steady]).max() <= 1e-12 * energy.max()


def test_the_symmetric_variant_conserves_energy_between_switchings_and_the_run_is_held_to_it():
    result = ran(PAIR, nitsche(1.0))
    growth = result.summary["energy_growth"]
    assert growth["guarantee"] == "conserved between switchings"
    assert growth["kept"] is True
    assert growth["between_switchings"] <= 1e-13
    assert np.ptp(result.arrays["contact_energy"]) > 0.01 * result.summary["energy"]["initial"]
    assert "what contacts store of the gap that they see" in growth["quantity"]


def test_a_drive_elsewhere_that_ends_leaves_the_guarantee():
    loads = {"hold": {"prescribed-velocity": 1.0, "on": "a.left", "until": 0.016}}  # open, and strained
    growth = ran({**PAIR, "loads": loads}, nitsche(1.0)).summary["energy_growth"]
    assert growth["guarantee"] == "conserved between switchings"
    assert growth["kept"] is True
    bodies = PAIR["bodies"] | {"b": {k: v for k, v in PAIR["bodies"]["b"].items() if k != "fixed"}}
    loads = {"hold": {"prescribed-velocity": 0.0, "on": "b.left", "until": 0.02}}
    growth = ran({**PAIR, "loads": loads, "bodies": bodies}, nitsche(1.0)).summary["energy_growth"]
    assert growth["guarantee"] == "not guaranteed"


@pytest.mark.parametrize(("law", "integrator"), [
    (nitsche(1.0), WU),
    ({"name": "any-end-force", "gamma": 2.0}, CD),
    ({"name": "any-end-force", "gamma": 40.0}, WU),
])  # fmt: skip
def test_at_the_end_of_the_step_the_symmetric_variant_never_gains_energy(law, integrator):
    result = ran(PAIR, law, integrator)
    growth = result.summary["energy_growth"]
    assert growth["guarantee"] == "never grows"
    assert growth["kept"] is True
    assert np.count_nonzero(result.arrays["contact_force"]) > 15
    total = sum(result.arrays[name] for name in ("kinetic_energy", "elastic_energy", "contact_energy"))
    assert np.diff(total).max() <= 1e-12 * total.max()
    assert total[-1] < 0.999 * total[0]


def test_the_other_variants_are_guaranteed_nothing():
    for theta in (0.0, -1.0):
        certificate = ran(PAIR, nitsche(theta), steps=1).summary["certificate"]
        assert certificate["energy"] == "not guaranteed"
        assert "the slope of no energy" in certificate["energy_why"]


def test_the_variants_differ_in_energy_as_they_should():
    """In the impact of Hunek the symmetric one keeps nearly all energy, the others gain some."""
    gains = {}
    for theta in (1.0, 0.0, -1.0):
        energy = run(hunek(20, integrator=CD, contact=nitsche(theta))).summary["energy"]
        gains[theta] = energy["final"] / energy["initial"] - 1.0
    assert abs(gains[1.0]) < 0.003
    assert gains[-1.0] > 0.005
    assert gains[0.0] > 0.05


# -------------------------------------------------------------------------------------------------- certificate


def drawn_rows():
    rng = np.random.default_rng(4)
    certain = [(1.0, 0.8), (-1.0, 1.1), (-1.0, 3.0), (1.0, 1.5)]
    for k in range(16):
        x, bodies, contacts, count = 0.0, {}, {}, int(rng.integers(1, 4))
        for name in "abc"[:count]:
            length = rng.uniform(0.5, 1.5)
            bodies[name] = {
                "bar": {"length": length, "elements": int(rng.integers(2, 7))}, "at": x, "area": rng.uniform(0.5, 2.0),
                "material": {"young": rng.uniform(30.0, 100.0), "density": rng.uniform(0.005, 0.02)},
            }  # fmt: skip
            x += length + 0.01
        for one, other in itertools.pairwise(bodies):
            contacts[one + other] = {"between": [f"{one}.right", f"{other}.left"]}
        if rng.random() < 0.5 or count == 1:
            contacts["wall"] = {"body": f"{'abc'[count - 1]}.right", "wall": x}
        if rng.random() < 0.4:
            bodies["a"]["fixed"] = ["left"]
        theta, gamma = float(rng.choice([1.0, 0.4, 0.0, -0.4, -1.0])), float(rng.uniform(0.6, 4.0))  # over kappa
        theta, gamma = certain[k] if k < len(certain) else (theta, gamma)
        law = {"name": "any-end-force", "at": "explicit", "b": theta, "c": theta, "gamma": gamma}
        yield with_law({**WALL, "bodies": bodies, "contacts": contacts, "record": {"probes": []}}, law)


@pytest.mark.deep
def test_the_closed_form_finds_the_critical_step_of_the_step_itself():
    limits = []
    for case in drawn_rows():
        model = Model(percuss.load(case))
        assert closed_form(model) is DecoupledGapsCriterion
        by_gaps, step_itself = RunCriterion(model, DecoupledGapsCriterion), RunCriterion(model, step_criterion)
        assert by_gaps.critical_step == pytest.approx(step_itself.critical_step, rel=2e-6)
        limits.append(by_gaps.critical_step / by_gaps.free)
        for share in (0.98, *([1.02] if limits[-1] < 0.97 else [])) if limits[-1] else ():
            dt = share * by_gaps.critical_step
            assert by_gaps.assess_step(dt).stable == step_itself.assess_step(dt).stable
    assert min(limits) == 0.0
    assert max(limits) == pytest.approx(1.0)
    assert sum(0.1 < limit < 0.99 for limit in limits) > 4


def test_symmetric_laws_at_the_end_of_the_step_need_no_shorter_step_than_the_bodies():
    limits = []
    for case in drawn_rows():
        law = case["method"]["contact"] | {"at": "end", "b": 1.0}
        for integrator in (CD, WU):
            model = Model(percuss.load(with_law(case, law, integrator)))
            assert closed_form(model) is EnergyAtEndCriterion
            limit, step_itself = EnergyAtEndCriterion(model).critical_step, step_criterion(model)
            limits.append(limit / step_itself.free)
            if limit > 0.0:
                assert step_itself.assess_step(0.999 * limit).stable
            if limit < 0.97 * step_itself.free:
                assert not step_itself.assess_step(max(1.001 * limit, 0.01 * step_itself.free)).stable
    assert min(limits) == 0.0
    assert 0.1 < sorted(set(limits))[1] < 0.97
    assert max(limits) == pytest.approx(1.0)


@pytest.mark.parametrize("theta", [1.0, *(pytest.param(theta, marks=pytest.mark.deep) for theta in (0.0, -1.0))])
@pytest.mark.parametrize(("integrator", "at"), [(CD, "current"), (WU, "predicted")])
def test_the_certificate_says_what_the_radius_of_dense_matrices_says(integrator, at, theta):
    """With Wu's predictor-corrector a force that is the slope of no energy is damped negatively, or not."""
    dense, said = Dense(PAIR), set()
    for beta in (1.3, 2.0, 4.0, 9.0, 40.0):
        model = Model(percuss.load(with_law(PAIR, nitsche(theta, epsilon_s=float(beta * dense.kappa[0])), integrator)))
        found = verdict.certificate(model)["stable"]
        closed = dense.radius(model.dt, beta * dense.kappa, theta, at)
        opened = np.linalg.eigvals(dense.inverse[:, None] * dense.stiffness(beta * dense.kappa, theta)).real.max()
        assert found == ("yes" if closed < 1.0 + 1e-8 and opened * model.dt**2 <= 4.0 else "no")
        said.add(found)
    assert said == ({"yes", "no"} if (integrator, theta) != (WU, 0.0) else said)


def single(law, integrator, **body):
    bar = {"bar": {"length": 1.0, "elements": 1}, "material": STEEL, "area": 1.0, **body}
    case = {**WALL, "bodies": {"a": bar}, "record": {"probes": []}}
    return Model(percuss.load(with_law(case, law, integrator, courant=1.0 if integrator == CD else 0.3)))


def test_the_step_itself_is_not_asked_where_a_perturbation_opens_what_a_law_sees():
    law = {"name": "any-end-force", "at": "explicit", "b": 0.0, "c": 0.0}
    said = [verdict.certificate(single(law | {"gamma": gamma}, WU, fixed=["left"])) for gamma in (0.12, 0.13, 2.0)]
    assert [one["stable"] for one in said] == ["unknown", "no", "yes"]


def test_a_mode_of_the_free_bar_whose_end_element_a_law_stiffens_is_no_idle_motion():
    law = {"name": "any-end-force", "at": "explicit", "b": -1.0, "c": -1.0, "gamma": 0.9}
    model = single(law, CD)
    assert not RunCriterion(model, step_criterion).assess_step(model.dt).stable
    assert not RunCriterion(model, DecoupledGapsCriterion).assess_step(model.dt).stable


def test_a_force_that_takes_back_more_than_it_sees_has_no_guarantee():
    energies = [
        closed_contacts(model, model.dt).energy
        for model in (single({"name": "any-end-force", "at": "explicit", "gamma": gamma}, WU) for gamma in (2.0, 40.0))
    ]
    assert energies == ["never grows", "not guaranteed"]


def test_a_march_made_again_begins_with_the_same_records():
    march = March(Model(percuss.load(with_law(PAIR, nitsche(1.0)))), compiled=False)
    march.keep_beginning()
    (part,) = march.arrays.parts
    before = part.data.of_points.tobytes()
    march.run()
    assert part.data.of_points.tobytes() != before
    march.again()
    assert part.data.of_points.tobytes() == before


def test_the_symmetric_variant_takes_gamma_above_kappa():
    with pytest.raises(percuss.RunError, match="takes all stiffness of the end elements"):
        ran(WALL, nitsche(1.0, beta_s=0.99), steps=1)
    assert ran(WALL, nitsche(1.0, beta_s=1.01), steps=1).summary["certificate"]["stable"] == "yes"


def test_what_the_closed_form_does_not_cover_is_examined_by_the_step_itself():
    """Contacts that share an end, another law beside, one with other multiples."""
    penalty = {"name": "penalty", "beta_s": 0.3}
    wall = {"body": "a.left", "wall": -0.01, "method": penalty}
    row = {**PAIR, "contacts": {**PAIR["contacts"], "wall": wall}}
    cases = [
        with_law(STAR, nitsche(-1.0)),
        with_law(row, nitsche(1.0)),
        with_law(PAIR, {"name": "any-end-force", "at": "explicit", "b": 0.5}),
        with_law(PAIR, {"name": "any-end-force", "at": "end", "b": 0.5}),
        with_law(PAIR, nitsche(1.0), WU),
    ]  # fmt: skip
    for case in cases:
        model = Model(percuss.load(case))
        assert closed_form(model) is None
        assert verdict.criterion_of(model).by == "black-box"


# --------------------------------------------------------------------------------------- beside other things


def test_without_loads_the_force_of_end_elements_is_that_of_the_bulk_acceleration():
    one, other = ran(PAIR, nitsche(0.0, beta_s=0.8)), ran(PAIR, {"name": "nitsche", "beta_s": 0.8})
    for name in ("contact_force", "gap"):
        assert np.abs(one.arrays[name] - other.arrays[name]).max() <= 1e-11 * np.abs(one.arrays[name]).max()
    heavy = {**WALL, "loads": {"weight": {"gravity": 40.0}}}
    one, other = ran(heavy, nitsche(0.0, beta_s=0.8)), ran(heavy, {"name": "nitsche", "beta_s": 0.8})
    assert np.abs(one.arrays["contact_force"] - other.arrays["contact_force"]).max() > 1e-3


@pytest.mark.parametrize("other", ["lagrange", "uzawa", "penalty", "bipenalty"])
def test_it_stands_beside_other_laws_at_the_same_end(other):
    """`uzawa` has a kernel that sees all of S, also what the law of end forces pushes."""
    contacts = {name: dict(contact) for name, contact in STAR["contacts"].items()}
    for name in ("ac", "end"):
        contacts[name]["method"] = {"name": other}
    result = ran({**STAR, "contacts": contacts}, nitsche(1.0), on_unstable="warn", steps=200)
    forces = result.arrays["contact_force"]
    assert (np.count_nonzero(forces, axis=0) > 0).sum() >= 4
    accounts_close(result)
    if other == "lagrange":
        assert result.arrays["gap"][:, [1, 3]].min() >= -1e-13


def test_drives_and_intervals_change_what_is_seen_and_pushed_and_accounts_close():
    bodies = PAIR["bodies"] | {"b": {k: v for k, v in PAIR["bodies"]["b"].items() if k != "fixed"}}
    loads = {
        "hold": {"prescribed-velocity": 0.0, "on": "b.left", "until": 0.02},
        "pull": {"constant": -0.5, "on": "a.left"},
        "weight": {"gravity": 3.0},
    }  # fmt: skip
    case = {**PAIR, "bodies": bodies, "loads": loads}
    for law in (nitsche(1.0), nitsche(-1.0), {"name": "any-end-force", "until": 0.03}):
        result = ran(case, law, on_unstable="warn")
        accounts_close(result)
        assert np.count_nonzero(result.arrays["contact_force"]) > 5
    assert result.arrays["contact_force"][result.arrays["time"] > 0.03 + result.summary["dt"]].max() == 0.0


def test_a_law_that_does_not_act_leaves_the_stiffness_of_end_elements_alone():
    loads = {"push": {"constant": 2.0, "on": "a.left"}}
    far = {"c": {"body": "a.right", "wall": 50.0}}
    idle = ran({**WALL, "loads": loads}, {"name": "any-end-force", "until": 1e-9}, courant=0.3)
    without = ran({**WALL, "loads": loads, "contacts": far}, {"name": "penalty"}, courant=0.3)
    assert np.abs(idle.arrays["displacement"] - without.arrays["displacement"]).max() <= 1e-13


def test_a_bar_of_one_element_hands_its_push_to_the_support_beside():
    bodies = {"a": {"bar": {"length": 1.0, "elements": 1}, "material": STEEL, "area": 1.0, "fixed": ["left"]}}
    loads = {"push": {"constant": 2.0, "on": "a.right"}}
    case = {**WALL, "bodies": bodies, "contacts": {"c": {"body": "a.right", "wall": 1.001}}, "loads": loads}
    result = ran(case, nitsche(-1.0), courant=0.3)
    assert np.count_nonzero(result.arrays["contact_force"]) > 20
    accounts_close(result)


# ---------------------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("integrator", "changes", "reason"),
    [
        ("velocity-verlet", {}, "which only leap-frog schemes evaluate"),
        ({"name": "viscous-central-difference", "viscosity": 0.1}, {}, "has a viscous part"),
        (CD, {"method.mass": "redistributed"}, "an end without mass is in static balance with it"),
        (CD, {"bodies.a.element": "quadratic-bar"}, "body 'a' has cells line3"),
        (CD, {"bodies.a.element": "green-bar"}, "by their stiffness, and body 'a' is not linear"),
    ],
    ids=["stages", "viscous", "massless", "cells", "non-linear"],
)
def test_what_has_no_such_end_force_is_refused_with_its_reason(integrator, changes, reason):
    with pytest.raises(percuss.RefusedPair, match=reason):
        Model(percuss.load(with_law(WALL, nitsche(1.0), integrator)).with_overrides(changes))


def test_a_law_from_which_no_force_follows_is_named():
    law = {"name": "any-end-force", "a": -2.0, "b": 2.0, "gamma": 1.0}
    with pytest.raises(
        percuss.PluginError, match=r"any-end-force.*what the law sees to what it pushes is not positive"
    ):
        ran(WALL, law, courant=0.95, steps=1)


def test_other_variants_than_zero_have_no_bulk_acceleration():
    with pytest.raises(percuss.InputError, match="stress_from: acceleration is for theta = 0"):
        percuss.load(with_law(WALL, {"name": "nitsche", "theta": 1, "stress_from": "acceleration"}))
