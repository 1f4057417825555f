"""Masses that couple nodes: reciprocal mass matrices against dense ones, dispersion relations and identities."""

import copy
import itertools
import math

import numpy as np
import pytest
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh

import percuss
from dense import assemble
from dense import march as dense_march
from percuss import Lumping
from percuss_methods.masses.reciprocal import Reciprocal
from strategies import hunek, nudged

LEAP_FROG = ("central-difference", "wu-predictor-corrector")
LAWS = (
    {"name": "penalty", "beta_s": 0.7},
    {"name": "bipenalty", "beta_s": 1.5, "ratio": "matched"},
    {"name": "bipenalty", "beta_s": 0.25, "ratio": 1.0},
    {"name": "lagrange"},
)
CONSISTENCIES = (1.0, 0.375, -0.5, -1.5)


def ran(case, overrides=None, **options):
    return percuss.run(percuss.load(case), overrides, compiled=False, **options)


def reciprocal_inverse(bars, consistency):
    """Return M^-1 from the matrices of the elements, with `numpy.linalg.inv` of each."""
    total, lumped = np.zeros(bars.M.shape), np.diag(bars.M)
    for name, lengths in bars.lengths.items():
        given = bars.given[name]
        for e, h in enumerate(lengths):
            mass = given["material"]["density"] * given["area"] * h
            consistent = mass / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
            element = (1.0 - consistency) * 0.5 * mass * np.eye(2) + consistency * consistent
            half = 0.5 * mass * np.eye(2)
            i = bars.start[name] + e
            total[i : i + 2, i : i + 2] += half @ np.linalg.inv(element) @ half
    return total / np.outer(lumped, lumped)


def reciprocal_mass(consistency):
    return lambda bars: np.linalg.inv(reciprocal_inverse(bars, consistency))


def uniform(count, consistency):
    """Return M^-1, K and the nodal masses of a free bar of equal elements with c = h = 1."""
    bars = assemble({"bodies": {"a": {"bar": {"length": float(count), "elements": count}, "area": 1.0,
                                      "material": {"young": 1.0, "density": 1.0}}}})  # fmt: skip
    return reciprocal_inverse(bars, consistency), bars.K, np.diag(bars.M)


# ----------------------------------------------------------------------------------------------------- the matrices


@pytest.mark.parametrize("consistency", CONSISTENCIES)
def test_bands_are_those_of_the_element_matrices(consistency):
    bar = {"bar": {"length": 3.0, "elements": 9, "grading": 0.2}, "area": 1.5}
    bars = assemble({"bodies": {"a": bar | {"material": {"young": 1.0, "density": 0.7}}}})
    element_mass = 0.7 * 1.5 * bars.lengths["a"]
    bands = Reciprocal(consistency=consistency).inverse(element_mass, Lumping.of_line(9))
    expected = reciprocal_inverse(bars, consistency)
    assert bands[0] == pytest.approx(np.diag(expected), rel=1e-13)
    assert bands[1, :-1] == pytest.approx(np.diag(expected, 1), rel=1e-13)
    assert np.abs(np.triu(expected, 2)).max() == 0.0
    assert np.linalg.eigvalsh(expected).min() > 0.0
    # A body that moves as a whole has its mass: C m = 1.
    assert expected @ np.diag(bars.M) == pytest.approx(np.ones(10), rel=1e-13)


@pytest.mark.parametrize("consistency", [*CONSISTENCIES, 0.0])
def test_waves_have_the_frequencies_of_the_dispersion_relation(consistency):
    """(omega h / c)^2 = 2 z + (s - 1) z^2, with z = 1 - cos(kappa h) and s = 1 / (1 - 2 b / 3)."""
    count = 40
    inverse, stiffness, _ = uniform(count, consistency)
    ends = np.zeros(count + 1)
    ends[[0, -1]] = 1.0
    s = 1.0 / (1.0 - 2.0 * consistency / 3.0)
    for k in (1, 7, 20, 33, count):
        wave = np.cos(np.pi * k * np.arange(count + 1) / count)
        z = 1.0 - math.cos(math.pi * k / count)
        # The ends are half elements of the same periodic row, so that standing waves are exact there too.
        assert inverse @ stiffness @ wave == pytest.approx((2.0 * z + (s - 1.0) * z**2) * wave, abs=1e-12)


def test_the_highest_frequencies_are_those_that_the_docstring_tells():
    count = 50
    for consistency, squared in ((1.0, 12.0), (0.375, 16.0 / 3.0), (0.0, 4.0), (-1.5, 2.0)):
        inverse, stiffness, _ = uniform(count, consistency)
        highest = np.linalg.eigvals(inverse @ stiffness).real.max()
        assert highest == pytest.approx(squared, rel=1e-12)
        case = hunek(7, integrator="central-difference", contact={"name": "lagrange"})
        case["method"]["mass"] = {"name": "reciprocal", "consistency": consistency}
        courant = 2.0 / math.sqrt(squared)
        critical = percuss.stability(percuss.load(case))[0]["courant_critical"]
        assert critical == pytest.approx(courant, rel=1e-9)
    # Consistent mass itself has the same highest frequency, sqrt(12) c / h.
    bars = assemble({"bodies": {"a": {"bar": {"length": 9.0, "elements": 9}, "area": 1.0,
                                      "material": {"young": 1.0, "density": 1.0}}}})  # fmt: skip
    consistent = np.zeros((10, 10))
    for e in range(9):
        consistent[e : e + 2, e : e + 2] += np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0
    assert eigh(bars.K, consistent, eigvals_only=True)[-1] == pytest.approx(12.0, rel=1e-12)


def test_below_the_least_consistency_the_shortest_wave_is_not_the_fastest():
    """Why the option has that bound: below it the frequency has its maximum inside the range of waves."""
    z = np.linspace(0.0, 2.0, 2001)
    for consistency, falls in ((-1.5, False), (-1.6, True)):
        squared = 2.0 * z + (1.0 / (1.0 - 2.0 * consistency / 3.0) - 1.0) * z**2
        assert (np.diff(squared) < 0.0).any() == falls


def test_long_waves_are_of_fourth_order_at_three_eighths():
    def error(consistency, kappa):
        z, s = 1.0 - math.cos(kappa), 1.0 / (1.0 - 2.0 * consistency / 3.0)
        return abs(math.sqrt(2.0 * z + (s - 1.0) * z**2) / kappa - 1.0)

    for consistency, order in ((1.0, 2), (0.0, 2), (0.375, 4)):
        assert math.log2(error(consistency, 0.2) / error(consistency, 0.1)) == pytest.approx(order, abs=0.05)
    # Without steps in time the phase error of long waves is (5/24) (kappa h)^2, for lumped mass -(1/24).
    assert error(1.0, 0.01) == pytest.approx(5.0 / 24.0 * 1e-4, rel=1e-3)
    assert error(0.0, 0.01) == pytest.approx(1.0 / 24.0 * 1e-4, rel=1e-3)


# -------------------------------------------------------------------------------------------- against dense matrices


@st.composite
def rows(draw):
    """Draw rows of one to three unlike bars, that hit each other or a wall, held, driven or loaded at the last end."""
    number = lambda low, high: draw(st.integers(round(100 * low), round(100 * high))) / 100  # noqa: E731
    names, bodies, at = "abc"[: draw(st.integers(1, 3))], {}, 0.0
    for k, name in enumerate(names):
        bodies[name] = {
            "bar": {
                "length": number(0.5, 3.0),
                "elements": draw(st.integers(2, 8)),
                "grading": draw(st.sampled_from([1.0, 0.5, 2.0])),
            },
            "material": {"young": number(20, 200), "density": number(0.01, 0.1)},
            "area": number(0.5, 2.0),
            "at": at,
            "velocity": number(0.1, 1.0) * (-1.0 if k else 1.0),
        }
        at = round(at + bodies[name]["bar"]["length"] + draw(st.sampled_from([0.0, 0.0, 0.02])), 6)
    contacts = {f"{a}{b}": {"between": [f"{a}.right", f"{b}.left"]} for a, b in itertools.pairwise(names)}
    if draw(st.booleans()):  # two contacts at one end
        first = bodies["a"]["bar"]["length"]
        contacts["stop"] = {"body": "a.right", "wall": round(first + draw(st.sampled_from([0.0, 0.01])), 6)}
    last, end = bodies[names[-1]], f"{names[-1]}.right"
    ending = draw(st.sampled_from(["wall", "fixed", "loaded", "driven"]))
    if len(names) == 1 and ending != "wall":
        contacts.setdefault("start", {"body": "a.left", "wall": -0.01})
    if ending == "wall":
        wall = round(last["at"] + last["bar"]["length"] + draw(st.sampled_from([0.0, 0.05])), 6)
        contacts.setdefault("stop" if len(names) == 1 else "wall", {"body": end, "wall": wall})
    elif "stop" in contacts and len(names) == 1:
        del contacts["stop"]
    loads = {}
    if ending == "fixed":
        last["fixed"] = ["right"]
    if ending == "loaded":
        loads["push"] = {"constant": number(-1.0, 1.0), "on": end}
    if ending == "driven":
        loads["drive"] = {"prescribed-velocity": number(-0.5, 0.5), "on": end}
    if ending != "driven" and draw(st.booleans()):
        loads["weight"] = {"gravity": number(-2.0, 2.0)}
    return {
        "percuss": 1,
        "bodies": bodies,
        "contacts": contacts,
        "loads": loads,
        "method": {"integrator": draw(st.sampled_from(LEAP_FROG)), "contact": dict(draw(st.sampled_from(LAWS)))},
        "time": {"steps": 100, "courant": number(0.15, 0.4), "on_unstable": "warn"},
        "record": {"probes": [f"{name}.{side}" for name in names for side in ("left", "right")]},
    }


@settings(max_examples=40, deadline=None, derandomize=True, phases=(Phase.generate,))
@given(rows(), st.sampled_from(CONSISTENCIES))
def test_rows_of_bars_move_as_dense_matrices_move_them(case, consistency):
    case["method"]["mass"] = {"name": "reciprocal", "consistency": consistency}
    mass = reciprocal_mass(consistency)
    dense = dense_march(case, mass=mass)
    peak = np.abs(dense.force).max()
    assume(0.0 < peak < 1e3)
    other = dense_march(nudged(case, 1e-12), mass=mass).force
    assume(np.abs(other - dense.force).max() < 1e-8 * peak)  # else round-off decides about openings
    result = ran(case)
    scale = np.abs(dense.u).max()
    assert np.abs(result.arrays["contact_force"] - dense.force).max() < 1e-7 * peak
    assert np.abs(result.arrays["gap"] - dense.gap).max() < 1e-8 * max(scale, np.abs(dense.gap).max())
    ends = [dense.bars.node(probe) for probe in case["record"]["probes"]]
    assert np.abs(result.arrays["displacement"][..., 0] - dense.u[:, ends]).max() < 1e-8 * scale
    energy = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
    assert np.abs(energy - dense.energy).max() < 1e-9 * dense.energy.max()
    assert result.summary["energy"]["ledger_error"] < 1e-12
    assert result.summary["momentum"]["error"] < 1e-12
    if result.summary["certificate"]["stable"] == "yes":
        assert result.summary["energy_growth"]["kept"] is not False


@pytest.mark.parametrize("scheme", ["velocity-verlet", "noh-bathe"])
def test_stages_accelerate_as_dense_matrices_do(scheme):
    """Contact by a penalty, gravity, a load on an end and a held end, in the stages of a scheme."""
    case = hunek(6, integrator=scheme, contact={"name": "penalty", "beta_s": 0.7}, courant=0.25)
    case["bodies"]["short"]["bar"]["grading"] = 0.4
    case["loads"] = {"weight": {"gravity": 0.3}, "push": {"constant": 0.01, "on": "short.left"}}
    case["time"] = {"steps": 90, "courant": 0.2}
    case["method"]["mass"] = {"name": "reciprocal", "consistency": 0.8}
    result = ran(case)
    bars = assemble(case)
    mass = np.linalg.inv(reciprocal_inverse(bars, 0.8))
    free = np.delete(np.arange(bars.x.size), bars.node("long.right"))
    normal = np.zeros(bars.x.size)
    normal[[bars.node("short.right"), bars.node("long.left")]] = -1.0, 1.0
    push = mass.sum(axis=1) * 0.3
    push[bars.node("short.left")] += 0.01
    stiffness = 0.7 * min(bars.end("short.right")[0], bars.end("long.left")[0])
    dt = result.summary["dt"] if "dt" in result.summary else float(np.diff(result.arrays["time"])[0])

    def acceleration(u):
        pressing = stiffness * max(-float(normal @ u), 0.0) * normal
        a = np.zeros(u.size)
        a[free] = np.linalg.solve(mass[np.ix_(free, free)], (push - bars.K @ u + pressing)[free])
        return a

    u, v = np.zeros(bars.x.size), bars.v.copy()
    v[bars.node("long.right")] = 0.0
    a, displacements = acceleration(u), []
    p = 0.54
    a0, a1, a2 = p * dt, 0.5 * (p * dt) ** 2, 0.5 * p * dt
    a3, a4 = (1.0 - p) * dt, 0.5 * ((1.0 - p) * dt) ** 2
    q1 = (1.0 - 2.0 * p) / (2.0 * p * (1.0 - p))
    q2, q0 = 0.5 - p * q1, -q1 - (0.5 - p * q1) + 0.5
    a5, a6, a7 = q0 * a3, (0.5 + q1) * a3, q2 * a3
    for _ in range(91):
        displacements.append(u)
        if scheme == "velocity-verlet":
            after = u + dt * v + 0.5 * dt**2 * a
            following = acceleration(after)
            u, v, a = after, v + 0.5 * dt * (a + following), following
            continue
        inside = u + a0 * v + a1 * a
        first = acceleration(inside)
        speed = v + a2 * (a + first)
        after = inside + a3 * speed + a4 * first
        following = acceleration(after)
        u, v, a = after, speed + a5 * a + a6 * first + a7 * following, following
    ends = [bars.node(probe) for probe in case["record"]["probes"]]
    expected = np.array(displacements)[:, ends]
    assert result.arrays["contact_force"].max() > 0.0
    assert np.abs(result.arrays["displacement"][..., 0] - expected).max() < 1e-10 * np.abs(expected).max()
    assert result.summary["momentum"]["error"] < 1e-12


# -------------------------------------------------------------------------------------------------------- stability


def dense_pencil(case, consistency):
    """Return M, K and N of the free nodes of a case."""
    bars = assemble(case)
    mass = np.linalg.inv(reciprocal_inverse(bars, consistency))
    free = np.delete(np.arange(bars.x.size), bars.node("long.right"))
    normal = np.zeros(bars.x.size)
    normal[[bars.node("short.right"), bars.node("long.left")]] = -1.0, 1.0
    return bars, mass[np.ix_(free, free)], bars.K[np.ix_(free, free)], normal[free]


@pytest.mark.parametrize("consistency", CONSISTENCIES)
@pytest.mark.parametrize("law", [*LAWS, {"name": "tied"}])
@pytest.mark.parametrize("integrator", LEAP_FROG)
def test_the_critical_step_is_that_of_dense_matrices(consistency, law, integrator):
    case = hunek(7, integrator=integrator, contact=dict(law), courant=0.2)
    case["bodies"]["short"] |= {"area": 2.0, "bar": {"length": 10.0, "elements": 7, "grading": 0.3}}
    case["method"]["mass"] = {"name": "reciprocal", "consistency": consistency}
    certificate = ran(case).summary["certificate"]
    bars, mass, stiffness, normal = dense_pencil(case, consistency)
    free = 2.0 / math.sqrt(eigh(stiffness, mass, eigvals_only=True)[-1])
    assert certificate["dt_critical_free"] == pytest.approx(free, rel=1e-10)
    assert certificate["by"] == "pencil"

    def grows(dt):
        """Whether the bodies grow without contact, or a power of the amplification matrix of (u_n, u_n-1) with it."""
        sides = [bars.end("short.right"), bars.end("long.left")]
        eye, inverse = np.eye(normal.size), np.linalg.inv(mass)
        step = 2.0 * eye - dt**2 * inverse @ stiffness
        if law["name"] in {"lagrange", "tied"}:
            back = eye - np.outer(inverse @ normal, normal) / (normal @ inverse @ normal)
            top, before = back @ step, -back
        else:
            ratio = dt**2 if law.get("ratio") == "matched" else 1.0 / min(side[1] for side in sides) ** 2
            spring = law["beta_s"] * min(sides)[0]
            inertia = spring * ratio if law["name"] == "bipenalty" else 0.0
            if integrator == "central-difference":
                whole = np.linalg.inv(mass + inertia * np.outer(normal, normal))
                step = 2.0 * eye - dt**2 * whole @ (stiffness + spring * np.outer(normal, normal))
                top, before = step, -eye
            else:
                s = normal @ inverse @ normal
                pull = dt**2 * spring / (1.0 + inertia * s) * np.outer(inverse @ normal, normal)
                top, before = (eye - pull) @ step, -(eye - pull)
        matrix = np.block([[top, before], [eye, np.zeros_like(eye)]])
        moduli = np.abs(np.linalg.eigvals(matrix))
        return dt > free or (moduli > 1.0 + 1e-7).any()

    critical = certificate["dt_critical"]
    assert critical <= free * (1.0 + 1e-9)
    for share in (0.3, 0.6, 0.9, 0.99, 0.9999):
        assert not grows(share * critical)
    assert grows(1.001 * critical)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("integrator", LEAP_FROG)
def test_a_chosen_step_is_stable_and_just_above_the_critical_one_is_not(law, integrator):
    case = hunek(9, integrator=integrator, contact=dict(law), courant="auto", end=0.5)
    case["time"]["on_unstable"] = "warn"  # central difference has no bound on what bipenalty gains at each opening
    case["method"]["mass"] = {"name": "reciprocal", "consistency": -1.5}
    summary = ran(case).summary
    assert summary["certificate"]["stable"] == "yes"
    assert summary["certificate"]["margin"] == pytest.approx(0.9, rel=1e-6)
    above = copy.deepcopy(case)
    above["time"] = {"end": 0.1, "step": 1.001 * summary["certificate"]["dt_critical"], "on_unstable": "warn"}
    assert ran(above).summary["certificate"]["stable"] == "no"
