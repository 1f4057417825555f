"""The methods against full matrices and the table of formulas, the identities between them, published figures."""

import copy
import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import against_dense
import dense
import formulas
import percuss
from marks import deep
from strategies import BRASS, CD, CORE, ROW, STEEL, UNIT, WU, bar, case_of, hunek, round_off, run, turned

# one end that meets a wall and another bar at once: S has entries off its diagonal
END_OF_TWO = case_of(
    {"a": bar(1.0, 6, 0.0, 0.2), "b": bar(1.5, 6, 1.0, 0.05, BRASS), "c": bar(1.0, 3, 1.0, -0.1, STEEL, 3.0)},
    {
        "ab": {"between": ["a.right", "b.left"]},
        "wall": {"body": "a.right", "wall": 1.001},
        "ca": {"between": ["c.left", "a.right"]},
    },
    {"steps": 300, "courant": 0.5, "on_unstable": "warn"},
    {"push": {"constant": 0.5, "on": "a.left"}},
)
LAWS = {
    "penalty": {"name": "penalty", "beta_s": 0.25},
    "penalty eps_s": {"name": "penalty", "epsilon_s": 100.0},
    "bipenalty r=1": {"name": "bipenalty", "beta_s": 0.25, "ratio": 1.0},
    "bipenalty matched": {"name": "bipenalty", "beta_s": 0.5, "ratio": "matched"},
    "bipenalty free-step": {"name": "bipenalty", "beta_s": 0.4, "ratio": "free-step"},
    "bipenalty eps": {"name": "bipenalty", "epsilon_s": 100.0, "epsilon_m": 4e-4},
    "lagrange": {"name": "lagrange"},
}


def exactly_as_dense(case):
    """Hold a run against the dense solver to what round-off may do; return whether the run does not hang on it."""
    result = run(case)
    within = round_off(case, result, ("contact_force", "gap", "displacement", "velocity"))
    if math.isfinite(within["contact_force"]):
        against_dense.agrees(result, dense.march(case), within)
    return math.isfinite(within["contact_force"])


@pytest.mark.parametrize("law", [deep(law) if " eps" in law else law for law in LAWS])
@pytest.mark.parametrize("integrator", [WU, CD])
@given(data=st.data())
def test_runs_equal_the_dense_solver(integrator, law, data):
    assume(exactly_as_dense(data.draw(against_dense.rows([LAWS[law]], integrators=[integrator]))))


@pytest.mark.parametrize("integrator", [WU, CD])
@pytest.mark.parametrize(
    "laws",
    [
        laws if pick in {0, 5} else deep(laws)
        for pick, laws in enumerate(itertools.permutations(["bipenalty r=1", "penalty eps_s", "lagrange"]))
    ],
)
def test_contacts_that_share_an_end_may_have_unlike_laws(integrator, laws):
    """Contacts that share an end and differ in eps_m / eps_s may grow, slowly: it is told and run."""
    case = {**copy.deepcopy(END_OF_TWO), "method": {"integrator": integrator, "contact": "lagrange"}}
    for contact, law in zip(case["contacts"].values(), laws, strict=True):
        contact["method"] = dict(LAWS[law])
    together = (np.abs(dense.march(case).force) > 0).sum(axis=1)
    assert together.max() >= 2, "never closed at the same time: nothing is coupled here"
    assert exactly_as_dense(case)


def test_three_bars_that_meet_pairwise_move_alike_though_their_forces_are_not_unique():
    """Four contacts of four ends: S is singular, the motion is unique all the same."""
    ends = ("a", "d"), ("b", "c")
    case = case_of(
        {
            "a": bar(1.0, 4, 0.0, 0.3), "d": bar(1.5, 5, -0.5, 0.2, BRASS),
            "b": bar(1.0, 4, 1.0, -0.1), "c": bar(2.0, 6, 1.0, 0.0, BRASS),
        },
        {f"{x}{y}": {"between": [f"{x}.right", f"{y}.left"]} for x in ends[0] for y in ends[1]},
        {"steps": 200, "courant": 0.5},
    )  # fmt: skip
    result = run({**case, "method": {"integrator": WU, "contact": "lagrange"}})
    gaps = result.arrays["gap"]
    moved = np.abs(result.arrays["displacement"]).max()
    assert gaps.min() > -1e-12 * moved
    assert result.summary["momentum"]["error"] < 1e-12
    assert result.summary["energy"]["ledger_error"] < 1e-12
    force = result.arrays["contact_force"]
    assert force.min() >= 0.0
    assert np.abs(force[:-1] * gaps[1:]).max() <= 1e-12 * force.max() * moved


@pytest.mark.parametrize("integrator", [WU, CD])
def test_tied_bars_are_one_bar(integrator):
    """The ends have their mass in common, and the tie pulls, too."""
    push = {"push": {"half-sine": {"peak": 0.3, "duration": 0.01}, "on": "a.left"}}
    halves, seam = {"a": bar(1.0, 10), "b": bar(1.0, 10, 1.0)}, {"ab": {"between": ["a.right", "b.left"]}}
    tied, whole = (
        run(case_of(bars, contacts, {"steps": 300, "courant": 0.5}, push, integrator, "tied"))
        for bars, contacts in ((halves, seam), ({"a": bar(2.0, 20)}, {}))
    )
    u, of_one = tied.arrays["displacement"][:, [0, 3]], whole.arrays["displacement"]
    assert tied.arrays["contact_force"].min() < -0.1
    assert np.abs(u - of_one).max() <= 1e-12 * np.abs(of_one).max()
    assert tied.summary["energy"]["ledger_error"] <= 1e-12


# -------------------------------------------------------------------------- against the table of formulas: schemes

STAGED = {
    "penalty": {"name": "penalty", "beta_s": 0.5},
    "bipenalty": {"name": "bipenalty", "beta_s": 2.0, "ratio": 1.0},
    "softened": {**formulas.SOFTENED, **formulas.STIFF},  # a law with a kernel of its own sees the gaps of each stage
    "lagrange": {"name": "lagrange"},
}


def touching(integrator, contact):
    """The bars of Huněk touch and approach; the long one is held."""
    return hunek(6, courant=0.55, integrator=integrator, contact=contact, end=0.6)


def loaded(integrator, contact):
    """The bars fly free at first, under weight, a force and a drive."""
    case = touching(integrator, contact)
    case["bodies"]["long"]["at"] = 10.01
    case["loads"] = {
        "weight": {"gravity": -0.05},
        "push": {"half-sine": {"peak": 0.02, "duration": 0.3}, "on": "long.left"},
        "drive": {"harmonic": {"mean": 0.1, "value": 0.04, "frequency": 3}, "on": "short.left", "as": "velocity"},
    }
    return case


@pytest.mark.slow
@pytest.mark.parametrize("make", [touching, loaded])
@pytest.mark.parametrize("law", STAGED)
@pytest.mark.parametrize(
    "scheme",
    # each scheme is compiled for several seconds
    [name if name in {*CORE, "velocity-verlet"} else deep(name) for name in formulas.SCHEMES],
)
def test_multi_stage_runs_equal_full_matrices(scheme, law, make, registry):
    """In one dimension, and along a direction in three."""
    published = formulas.SCHEMES[scheme]
    for unit in (np.ones(1), np.array([2.0, 1.0, -2.0]) / 3.0):
        flat = make(scheme, STAGED[law])
        flat["time"]["on_unstable"] = "warn"
        case = percuss.load(flat if unit.size == 1 else turned(flat, unit), registry=registry)
        averages = law == "softened" and scheme in {"chung-lee", "hulbert-chung"}  # their mean of two forces may pull
        if averages or (law == "lagrange" and published.ends is None):
            with pytest.raises(percuss.RefusedPair) as refused:
                percuss.run(case)
            assert refused.value.said_by == scheme
            return
        result = percuss.run(case, compiled=scheme != "force-gradient")
        kernel = np.vectorize(lambda gap: formulas.softened(None, gap, None, None, None))
        steps, dt = result.summary["steps"], result.summary["dt"]
        bars, u, v = dense.march_stages(flat, published, steps, dt, kernel if law == "softened" else None)
        assert (result.arrays["contact_force"] != 0).sum() > 10, "no contact: the test says little"
        for k, name in enumerate(("short.left", "short.right", "long.left")):
            for found, expected in ((result.arrays["displacement"], u), (result.arrays["velocity"], v)):
                part = found[:, k] @ unit
                assert np.abs(part - expected[:, bars.node(name)]).max() < 1e-11 * np.abs(expected).max()
                assert np.abs(found[:, k] - np.outer(part, unit)).max() < 1e-12 * np.abs(expected).max()
        assert result.summary["momentum"]["error"] < 1e-13
        if law == "lagrange":  # every stage sees to the next one
            assert result.summary["contacts"]["tip"]["penetration"]["largest"] < 1e-13
        if law == "penalty" and scheme == "noh-bathe" and make is touching:
            gaps = bars.x[bars.node("long.left")] - bars.x[bars.node("short.right")]
            gaps = gaps + u[:, bars.node("long.left")] - u[:, bars.node("short.right")]
            assert result.summary["contacts"]["tip"]["penetration"]["largest"] > 1.001 * -gaps.min() > 0.0


# ----------------------------------------------------------------------------- against the table of formulas: laws


def agrees(result, truth, within=1e-8):  # full restitution multiplies round-off by ten thousand
    force = truth.force
    closings = np.count_nonzero((force[1:] > 0.0) & (force[:-1] == 0.0), axis=0)
    assert np.count_nonzero(closings) >= 2, "too few contacts close"
    assert np.abs(result.arrays["contact_force"] - force).max() <= within * force.max()
    assert np.abs(result.arrays["gap"] - truth.gap).max() <= within * np.abs(truth.gap).max()
    assert result.summary["energy"]["ledger_error"] <= 1e-12
    assert result.summary["momentum"]["error"] <= 1e-12


@pytest.mark.parametrize("name", formulas.LAWS)
def test_runs_equal_the_published_formula(name):
    """Kernels that take seconds to compile run in plain Python."""
    contact, law = formulas.LAWS[name]
    case = {**ROW, "method": {"integrator": WU if name.endswith("predicted") else CD, "contact": contact}}
    result = run(case, compiled=name not in {"uzawa", "conserving"})
    agrees(result, dense.march(case, law=formulas.gapwise(law)))


def test_nitsche_reads_the_normal_force_of_the_end_elements():
    """Between bodies the mean, each side weighted by the mass of the node of the other."""
    bars = dense.assemble(ROW)

    def tension(end, u):
        node = bars.node(end)
        inner = node + 1 if end.endswith("left") else node - 1
        return bars.end(end)[0] * (u[inner] - u[node]) * (1.0 if end.endswith("left") else -1.0)

    def forces(_before, now, _free, _w, _dt, u):
        sides = (("a.left",), ("a.right", "b.left"), ("b.right",))
        means = [np.average([tension(end, u) for end in one], weights=[bars.end(end)[2] for end in reversed(one)])
                 for one in sides]  # fmt: skip
        return np.maximum(-np.array(means) - gamma * now, 0.0)

    case = {**ROW, "method": {"integrator": CD, "contact": "nitsche"}, "time": {"steps": 150, "courant": 0.5}}
    result = run(case)
    gamma = np.array([one["epsilon_s"] for one in result.provenance["resolved"]["contacts"].values()])
    agrees(result, dense.march(case, law=forces))


# ------------------------------------------------------------------------------------------- exact identities


@given(case=against_dense.rows([LAWS["lagrange"]], integrators=[WU]))
def test_the_lagrange_method_is_the_same_with_both_integrators(case):
    one, other = (run(case, {"method.integrator": integrator}) for integrator in (WU, CD))
    for history in ("contact_force", "gap", "displacement", "velocity", "kinetic_energy", "elastic_energy"):
        np.testing.assert_array_equal(one.arrays[history], other.arrays[history])


def one_contact(integrator=WU, contact=None, courant=0.5):
    """Unlike graded bars with a gap: one contact, nothing symmetric."""
    bars = {"a": bar(1.0, 8, 0.0, 0.4, grading=1.5), "b": bar(1.4, 6, 1.01, -0.1, BRASS, 1.6, fixed=["right"])}
    seam = {"ab": {"between": ["a.right", "b.left"]}}
    return case_of(bars, seam, {"steps": 400, "courant": courant}, None, integrator, contact)


def compliance(case, result):
    """Return eps_s, eps_m and s of the only contact of a case, from its provenance and the masses of its ends."""
    out, bars = result.provenance["resolved"]["contacts"]["ab"], dense.assemble(case)
    return out["epsilon_s"], out.get("epsilon_m", 0.0), sum(1.0 / bars.end(end)[2] for end in ("a.right", "b.left"))


@pytest.mark.parametrize(
    "law",
    [
        {"name": "penalty", "beta_s": 0.4},
        {"name": "bipenalty", "beta_s": 0.25, "ratio": 1.0},
        {"name": "bipenalty", "beta_s": 10.0, "ratio": "matched"},
        {"name": "bipenalty", "beta_s": 1.0, "ratio": 0.3},
    ],
    ids=str,
)
def test_wu_is_a_backward_penalty_of_another_stiffness(law):
    case = one_contact(WU, law)
    result = run(case)
    eps_s, eps_m, s = compliance(case, result)
    dt = result.summary["dt"]
    theta = dt**2 * eps_s * s / (1.0 + eps_m * s)
    assert theta < 1.0
    assert result.summary["certificate"]["theta"] == pytest.approx(theta, rel=1e-12)
    kappa = eps_s / (1.0 + (eps_m - dt**2 * eps_s) * s)
    if law.get("ratio") == "matched":
        assert kappa == pytest.approx(eps_s, rel=1e-13)
    force, gap = result.arrays["contact_force"][:, 0], result.arrays["gap"][:, 0]
    judged = kappa * np.maximum(-gap[1:], 0.0)
    # a gap is a difference of displacements: its round-off, times kappa, is all that may be left
    noise = 8 * np.finfo(float).eps * kappa * np.abs(result.arrays["displacement"]).max()
    assert force.max() > 0
    assert np.abs(force[:-1] - judged).max() <= 1e-13 * force.max() + noise
    end = result.arrays["contact_force_end"][:, 0]
    assert np.abs(end - (1.0 - theta) * (1.0 + eps_m * s) * force).max() <= 1e-13 * end.max() + noise


def test_matched_bipenalty_tends_to_the_lagrange_method():
    stiff = run(hunek(contact={"name": "bipenalty", "beta_s": 1e8, "ratio": "matched"}))
    exact = run(hunek(contact={"name": "lagrange"}))
    for history, within in (("contact_force", 1e-5), ("displacement", 1e-6)):
        peak = np.abs(exact.arrays[history]).max()
        assert np.abs(stiff.arrays[history] - exact.arrays[history]).max() <= within * peak, history


@pytest.mark.parametrize(
    "stiffness", [{}, {"beta_s": 0.1}, {"beta_s": 30.0}, {"beta_s": 1e8}, {"epsilon_s": 1e6}], ids=str
)
def test_a_mass_that_leaves_no_overlap_gives_the_lagrange_method_at_any_stiffness(stiffness):
    law = {"name": "bipenalty", "ratio": "zero-penetration", **stiffness}
    case = one_contact(WU, law)
    result, exact = run(case), run(one_contact(WU, {"name": "lagrange"}))
    eps_s, eps_m, s = compliance(case, result)
    assert result.summary["dt"] ** 2 * eps_s * s / (1.0 + eps_m * s) == pytest.approx(1.0, rel=1e-12)
    assert result.summary["certificate"]["stable"] in {"yes", "marginal"}
    # 1 + eps_m s is of the size of eps_s dt^2 s: the force has that many roundings of the overlap
    within = 1e-12 * (1.0 + eps_s * s * result.summary["dt"] ** 2 / 1e8)
    for history in ("contact_force", "displacement"):
        peak = np.abs(exact.arrays[history]).max()
        assert np.abs(result.arrays[history] - exact.arrays[history]).max() <= within * peak, history
    assert result.arrays["gap"].min() >= -1e-15 * np.abs(result.arrays["displacement"]).max()


def test_bipenalty_without_mass_is_the_penalty_method():
    for integrator in (WU, CD):
        one = run(one_contact(integrator, {"name": "bipenalty", "beta_s": 0.4, "ratio": math.inf}))
        other = run(one_contact(integrator, {"name": "penalty", "beta_s": 0.4}))
        np.testing.assert_array_equal(one.arrays["contact_force"], other.arrays["contact_force"])


# ---------------------------------------------------------------------------------------------- benchmark runs


def during(result, start, end, name="contact_force"):
    time = result.arrays["time"]
    return result.arrays[name][(time >= start - 1e-12) & (time <= end + 1e-12), 0]


def test_the_papers_figure():
    """Bars of Huněk, the settings of the paper's Fig. 2; the exact force is .05 on [0, .2] and [.4, .6]."""
    result = run(hunek())
    exact = 0.05
    for start in (0.02, 0.42):
        plateau = during(result, start, start + 0.16)
        assert plateau.mean() == pytest.approx(exact, rel=0.002)
        assert plateau.max() < 1.02 * exact
    assert result.arrays["contact_force"].max() < 1.02 * exact
    assert np.abs(during(result, 0.22, 0.38)).max() < 0.02 * exact
    assert result.summary["contacts"]["tip"]["impulse"] == pytest.approx(0.02, rel=0.01)
    # what an independent solver gives
    assert result.arrays["contact_force"].max() / exact == pytest.approx(1.012, abs=0.001)
    assert during(result, 0.02, 0.18).mean() / exact == pytest.approx(1.0, abs=0.0005)
    assert result.summary["energy"]["final"] / 5e-4 == pytest.approx(0.9957, abs=0.0015)


# --------------------------------------------------------------------------------------------- critical steps


def pressed(integrator, contact, courant, n=60, steps=6000, on="a.left", acts="force"):
    """A bar pressed on a wall by a load that rises over its period 4 and stays: the contact never opens."""
    press = {"press": {"ramp": {"value": 0.01, "duration": 4.0}, "on": on, "as": acts}}
    bars, contacts = {"a": bar(1.0, n, material=UNIT)}, {"w": {"body": "a.right", "wall": 1.0}}
    return case_of(bars, contacts, {"steps": steps, "courant": courant}, press, integrator, contact)


@pytest.mark.parametrize(("beta_s", "ratio"), [(1.0, math.inf), (2.0, 1.0), (4.0, 2.0), (10.0, 1.0), (100.0, 1.0)])
def test_the_critical_courant_number_of_a_closed_contact_with_wu(beta_s, ratio):
    """Growth beyond theta = 1 is slow: what the load left of motion grows instead of dying out."""
    critical = math.sqrt((1.0 + beta_s / (2.0 * ratio)) / (2.0 * beta_s))
    law = {"name": "bipenalty", "beta_s": beta_s, "ratio": ratio}

    def growth(factor):
        case = pressed(WU, law, critical * factor, n=10, steps=20000, on="a", acts="acceleration")
        result = run(case, {"time.on_unstable": "warn"})
        assert result.summary["certificate"]["theta"] == pytest.approx(factor**2, rel=1e-9)
        assert result.arrays["contact_force"][5000:].min() > 0.0
        parts = np.array_split(result.arrays["kinetic_energy"], 8)
        return parts[7].max() / parts[1].max()

    assert growth(0.999) < 1.0 < growth(1.001)


def test_the_papers_penalties_differ_less_among_each_other_than_from_the_truth():
    runs = {b: run(hunek(contact={"name": "bipenalty", "beta_s": b, "ratio": 1.0})) for b in (0.25, 1.0, 100.0)}
    force = {b: one.arrays["contact_force"][:, 0] for b, one in runs.items()}
    exact = runs[1.0].arrays["contact_force_exact"][:, 0]
    norm = np.linalg.norm(exact)
    errors = {b: np.linalg.norm(f - exact) / norm for b, f in force.items()}
    for a, b in itertools.combinations(force, 2):
        assert np.linalg.norm(force[a] - force[b]) / norm < max(errors[a], errors[b])
    assert [force[b].max() / 0.05 for b in (0.25, 1.0, 100.0)] == pytest.approx([1.012, 1.107, 1.138], abs=0.001)


def wall_limit(beta_s):
    return math.sqrt(2.0 / (1.0 + math.sqrt(1.0 + beta_s**2)))


@pytest.mark.parametrize(
    ("beta_s", "ratio", "critical"),
    [
        (1.0, math.inf, 0.9102), (10.0, 5.0, 0.6),
        *(deep(*values) for values in ((100.0, 2.0, 0.7169), (1.0, 1.5, 0.988))),
    ],
)  # fmt: skip
def test_the_critical_courant_number_of_a_closed_contact_with_central_difference(beta_s, ratio, critical):
    """Runs below and above some of the published numbers, all of which the certificate gives (`test_stability`)."""
    law = {"name": "bipenalty", "beta_s": beta_s, "ratio": ratio}
    if math.isinf(ratio):
        assert wall_limit(beta_s) == pytest.approx(critical, abs=5e-5)
        critical = wall_limit(beta_s)
    below = run(pressed(CD, law, critical * 0.998))
    assert below.arrays["contact_force"].max() < 1.2 * 0.01
    with pytest.raises(percuss.RunError, match="not started"):
        run(pressed(CD, law, critical * 1.002))
    above = pressed(CD, law, critical * 1.002)
    above["time"]["on_unstable"] = "warn"
    try:
        assert run(above).arrays["contact_force"].max() > 20.0 * 0.01
    except percuss.RunError as stopped:
        assert "no longer finite" in str(stopped)  # noqa: PT017
