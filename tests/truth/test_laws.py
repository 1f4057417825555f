"""Contact laws of the wider family: identities between them, restitution, energy, bonds, and limits of the step.

Their runs are held against their published formulas in `test_methods.py`.
"""

import functools
import itertools
import math

import numpy as np
import pytest

import percuss
from dense import assemble
from formulas import STIFFNESS
from marks import deep
from percuss.certificate.verdict import certificate
from percuss.contact.law_trials import trial_of
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.testing.subject import sample_points
from strategies import BRASS, CD, FIRST, REGISTRY, ROW, STEEL, WU, bar, case_of, hunek, run

# One bar of one element meets two others and a wall, all at one end.
STAR = case_of(
    {"a": bar(1.0, 3, 0.0, 1.0), "b": bar(1.4, 2, 1.002, -0.1, BRASS, 0.6), "c": bar(0.7, 2, 1.0035, -0.3, STEEL, 0.8)},
    {
        "ab": {"between": ["a.right", "b.left"]},
        "ac": {"between": ["a.right", "c.left"]},
        "wall": {"body": "a.right", "wall": 1.005},
        "behind": {"body": "a.left", "wall": -0.01},
        "end": {"body": "b.right", "wall": 2.43},
        "last": {"body": "c.right", "wall": 1.73},
    },
    {"steps": 600, "courant": 0.5},
)


def case_with(case, law, integrator=CD, **time):
    return {**case, "method": {"integrator": integrator, "contact": law}, "time": {**case["time"], **time}}


def played(case):
    """Return a run in plain Python where the law has a kernel of its own, which would take seconds to compile."""
    return run(case, compiled=case["method"]["contact"]["name"] not in {"uzawa", "energy-conserving-penalty"})


@functools.cache
def ran(options, integrator=CD):
    """Return the run of the row by a law, given by its options as pairs."""
    return played(case_with(ROW, dict(options), integrator))


# ------------------------------------------------------------------------------------------ Nitsche, refusals


def test_a_pressed_bar_under_nitsche_stays_at_rest_with_the_exact_pressure_and_no_overlap():
    """The method is consistent: a penalty needs an overlap for that."""
    pressure = 3.0
    bodies = {"a": ROW["bodies"]["a"] | {"velocity": 0.0}}
    contacts, loads = {"c": {"body": "a.right", "wall": 1.0}}, {"push": {"constant": pressure, "on": "a.left"}}
    pressed = {**case_with(ROW, {"name": "nitsche"}), "bodies": bodies, "contacts": contacts, "loads": loads}
    pressed["record"] = {"probes": []}
    bars, march = assemble(pressed), March(model_of(percuss.load(pressed)), compiled=False)
    free = np.arange(bars.K.shape[0]) != bars.node("a.right")
    rest, force = np.zeros((2, free.size))
    force[bars.node("a.left")] = pressure
    rest[free] = np.linalg.solve(bars.K[np.ix_(free, free)], force[free])
    march.u[:], march.v[:] = rest, 0.0
    for n in range(50):
        assert march.advance(march.stepper.amplitudes(n, 1), n, 1) == 1
        assert march.arrays.step.points.state[0].multiplier == pytest.approx(pressure, rel=1e-11)
    assert np.abs(march.u - rest).max() <= 1e-12 * np.abs(rest).max()


OVERLAP_FREE = {"name": "bipenalty", "ratio": "zero-penetration"}
WEAK_BOND = {"name": "cohesive", "strength": 1.0, "length": 1e-3, "epsilon_s": STIFFNESS}


@pytest.mark.parametrize(
    ("case", "law", "integrator", "why"),
    [
        (ROW, "nitsche", WU, "would be another method"),
        *((ROW, law, "noh-bathe", "computes several forces in a step")
          for law in ("moreau-jean", "paoli-schatzman", "energy-conserving-penalty")),
        *((ROW, OVERLAP_FREE, integrator, f"{integrator} shows the gap before") for integrator in (CD, "noh-bathe")),
        (STAR, OVERLAP_FREE, WU, "shares an end with another contact"),
        (STAR, WEAK_BOND, WU, "give a greater length or stiff"),
    ],
    ids=str,
)  # fmt: skip
def test_what_a_law_is_not_shown_or_cannot_do_is_refused(case, law, integrator, why):
    with pytest.raises((percuss.RefusedPair, percuss.InputError), match=why):
        run(case_with(case, law, integrator))


# -------------------------------------------------------------------------------------------------- identities


def same(one, other, within):
    for name in ("contact_force", "gap", "displacement", "velocity"):
        a, b = one.arrays[name], other.arrays[name]
        assert np.abs(a - b).max() <= within * np.abs(b).max(), name


def test_without_restitution_the_impact_law_on_gaps_is_the_lagrange_method():
    one, other = ran((("name", "paoli-schatzman"),), WU), ran((("name", "lagrange"),), WU)
    for name in ("contact_force", "gap", "displacement", "velocity", "kinetic_energy", "elastic_energy"):
        np.testing.assert_array_equal(one.arrays[name], other.arrays[name])


@pytest.mark.parametrize("beta_s", [0.3, 30.0])
def test_the_regularised_lagrange_method_is_the_matched_bipenalty_of_wu(beta_s):
    one = ran((("name", "regularised-lagrange"), ("beta_s", beta_s)))
    same(one, ran((("name", "bipenalty"), ("beta_s", beta_s), ("ratio", "matched")), WU), 1e-11)


def bonded(strength, length, speed, gap=0.0, end=2.0):
    """Return a run of two bars, bonded, of which the second is pulled away at a speed."""
    bars = {"a": bar(1.0, 8, fixed=["left"]), "b": bar(1.0, 8, 1.0 + gap)}
    law = {"name": "cohesive", "strength": strength, "length": length, "epsilon_s": STIFFNESS}
    pull = {"pull": {"prescribed-velocity": speed, "on": "b.right"}}
    case = case_of(bars, {"bond": {"between": ["a.right", "b.left"]}}, {"end": end, "courant": 0.25}, pull)
    return run({**case, "method": {"integrator": CD, "contact": law}})


def test_a_bond_follows_its_envelope_and_takes_the_energy_to_break_it():
    strength, length = 2.0, 0.2
    result = bonded(strength, length, 0.5)
    gap, force = result.arrays["gap"][:, 0], result.arrays["contact_force"][:, 0]
    onset = strength / STIFFNESS
    greatest = np.maximum.accumulate(np.maximum(gap, 0.0))
    envelope = np.where(
        greatest <= onset, STIFFNESS * greatest, strength * np.maximum(length - greatest, 0.0) / (length - onset)
    )
    secant = np.divide(envelope, greatest, out=np.full(gap.size, STIFFNESS), where=greatest > onset)
    expected = np.where(gap > 0.0, -secant * gap, -STIFFNESS * gap)
    assert greatest[-1] > length
    assert np.abs(force - expected).max() <= 1e-12 * strength
    assert 0.98 * strength < -force.min() <= strength
    assert np.count_nonzero((gap > 0.0) & (gap < 0.999 * greatest)) > 5  # it unloads somewhere
    broken = 0.5 * strength * length
    assert result.provenance["resolved"]["contacts"]["bond"]["energy_to_break"] == pytest.approx(broken)
    assert result.arrays["contact_dissipation"][-1] == pytest.approx(broken, rel=1e-12)
    assert -result.summary["energy"]["contact_work"] == pytest.approx(broken, rel=2e-3)  # as a spring's in steps
    assert result.summary["energy"]["ledger_error"] <= 1e-12


def test_bodies_that_come_from_beyond_the_length_are_not_bonded():
    law = {"epsilon_s": STIFFNESS}
    case = {**ROW, "bodies": {name: dict(body) for name, body in ROW["bodies"].items()}}
    bond = run(case_with(case, {"name": "cohesive", "strength": 1e-3, "length": 1e-3, **law}))
    spring = run(case_with(case, {"name": "penalty", **law}, CD))
    same(bond, spring, 1e-12)


@pytest.mark.parametrize("gap", [0.05, 0.3])
def test_a_bond_that_is_stretched_or_broken_from_the_start_has_dissipated_nothing_yet(gap):
    arrays = bonded(2.0, 0.2, 1.0, gap, 0.3).arrays
    lost, given = arrays["contact_dissipation"], arrays["contact_energy"]
    assert lost[0] == 0.0
    assert (np.diff(lost) >= -1e-15).all()
    assert lost[-1] == (
        0.0 if gap > 0.2 else pytest.approx(given[0] - arrays["contact_work"][-1] - given[-1], rel=0.05)
    )


@pytest.mark.parametrize("iterations", [deep(1), 2, 3, deep(10)])
def test_an_odd_number_of_iterations_halves_the_limit_of_uzawas_method(iterations):
    """The last iterate is a penalty at the predicted gap of ``theta_k = 1 - (1 - theta)^k``, stable up to 1."""
    even = iterations % 2 == 0

    def case(theta):
        beta_s = theta / (4.0 * 0.5**2)  # theta = 4 C^2 beta_s between equal bars
        return hunek(4, integrator=CD, contact={"name": "uzawa", "beta_s": beta_s, "iterations": iterations})

    for theta in (0.95, 1.05, 1.9):
        found = certificate(model_of(percuss.load(case(theta))))
        assert found["theta"] == pytest.approx(1.0 - (1.0 - theta) ** iterations, rel=1e-9)
        assert found["stable"] == ("yes" if even or theta < 1.0 else "no")
    if even:
        assert run(case(2.1)).arrays["contact_force"].max() == 0.0


KERNEL_LAWS = [law for law in FIRST if hasattr(REGISTRY.get("contacts", law["name"]), "multipliers")]


@pytest.mark.parametrize("law", KERNEL_LAWS, ids=lambda law: law["name"])
def test_gaps_and_rates_near_zero_leave_finite_forces(law):
    """Waves die out through all numbers down to the smallest, so that bodies that touch meet at speeds of 1e-320."""
    kind = REGISTRY.get("contacts", law["name"])
    points, dt = sample_points(1), 1e-3
    bound = kind(**{key: value for key, value in law.items() if key != "name"}).bind(points, dt)
    trial = trial_of(points, dt, [np.zeros(1)] * 4, kind)
    near_zero = [sign * size for size in (5e-324, 1e-310, 1e-160) for sign in (1.0, -1.0)] + [0.0]
    for gap, rate, predicted in itertools.product(near_zero, repeat=3):
        values = (np.array([value]) for value in (gap, predicted, rate, (predicted - gap) / dt))
        state = trial._replace(
            **dict(zip(("gap", "predicted_gap", "rate", "predicted_rate"), values, strict=True)), before=trial.after
        )
        multiplier = np.full(1, np.nan)
        kind.multipliers(bound, state._replace(after=state.before.copy()), multiplier)
        assert np.isfinite(multiplier).all(), (gap, rate, predicted)


# ------------------------------------------------------------------------------------------------- restitution


def particle(law, young=1e-30, *, certified=False, **time):
    """A node of mass 1 that next to nothing holds to the rest of its bar, and strikes a wall with the speed 1."""
    bars = {"a": bar(1.0, 1, velocity=1.0, material={"young": young, "density": 2.0})}
    contact, time = {"wall": {"body": "a.right", "wall": 1.0 + 0.1234}}, {"step": 0.01, "steps": 40, **time}
    case = case_of(bars, contact, time, None, CD, law)
    if certified:
        return certificate(model_of(percuss.load(case)))
    result = run(case)
    return result, -np.diff(result.arrays["gap"][:, 0]) / result.summary["dt"]  # speeds towards the wall


@pytest.mark.parametrize("e", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("law", [{"name": "moreau-jean"}, {"name": "moreau-jean", "gate": "current"},
                                 {"name": "paoli-schatzman"}], ids=str)  # fmt: skip
def test_a_node_leaves_with_the_restitution_times_its_speed(law, e):
    result, speed = particle({**law, "restitution": e})
    force, gap = result.arrays["contact_force"][:, 0], result.arrays["gap"][:, 0]
    presses = np.flatnonzero(force > 1e-9)
    assert speed[0] == pytest.approx(1.0, rel=1e-12)
    assert speed[-1] == pytest.approx(-e, abs=1e-12)
    first = int(presses[0])
    if law["name"] == "moreau-jean":
        assert list(presses) == [first]  # one impulse
        assert (gap[first] < 0.0) == ("gate" in law)
        assert gap.min() >= -0.01
    else:
        assert presses.size <= 2
        assert np.abs(speed[first + 1 :] + e).max() <= 1e-12  # from the second step on
        assert gap.min() >= -0.01
    kinetic = result.arrays["kinetic_energy"]
    assert kinetic[0] - kinetic[-1] == pytest.approx(0.5 * (1.0 - e**2), abs=1e-12)


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_the_restitution_of_the_dashpot_is_that_of_schwager_and_poeschel(share):
    """Their contact ends where the force does, not where the overlap does.

    Published for a share below and above 1/sqrt(2) of critical damping, and written here for any by the arctangent of
    two arguments; at critical damping it is exp(-2).
    """
    if share < 1.0:
        root = math.sqrt(1.0 - share**2)
        exact = math.exp(-share / root * math.atan2(2.0 * share * root, 2.0 * share**2 - 1.0))
    else:
        exact = math.exp(-2.0)
    law = {"name": "damped-penalty", "epsilon_s": 100.0, "damping": share}
    for step, within in ((0.04, 0.04), (0.005, 0.008)):
        result, speed = particle(law, step=step, steps=round(1.0 / step))
        assert result.arrays["contact_force"].min() == 0.0
        assert -speed[-1] == pytest.approx(exact, abs=within)


@pytest.mark.parametrize("share", [0.0, 0.03, 0.5])
def test_the_critical_step_of_the_dashpot_is_that_of_a_rate_half_a_step_late(share):
    """omega dt = 2 (sqrt(1 + damping^2) - damping), the limit of central difference with lagged damping."""
    law = {"name": "damped-penalty", "epsilon_s": 100.0, "damping": share}
    found = particle(law, 1e-10, certified=True)
    expected = 0.2 * (math.sqrt(1.0 + share**2) - share)
    assert found["dt_critical"] == pytest.approx(expected, rel=1e-6)


# ------------------------------------------------------------------------------------------------------ energy


def bodies_energy(result):
    return result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]


def stored(result, points):
    """Return the mean of the potentials at both ends of each step but the last, from recorded gaps."""
    gap = np.minimum(result.arrays["gap"], 0.0)
    stiffness = [result.provenance["resolved"]["contacts"][name]["epsilon_s"] for name in points]
    potentials = 0.5 * (gap**2 @ np.array(stiffness))
    return 0.5 * (potentials[1:] + potentials[:-1])


@pytest.mark.parametrize(("case", "beta_s"), [("row", 50.0), deep("row", 0.5), deep("star", 0.5), deep("star", 50.0)])
def test_a_force_by_difference_quotient_keeps_energy_over_all_impacts(case, beta_s):
    """Contacts open and close, at ends in several contacts too, and may be stiffer than an explicit step allows."""
    whole = {"row": ROW, "star": STAR}[case]
    result = played(case_with(whole, {"name": "energy-conserving-penalty", "beta_s": beta_s}))
    kept = bodies_energy(result)[:-1] + stored(result, whole["contacts"])
    pressing = result.arrays["contact_force"] > 0.0
    assert np.count_nonzero(pressing[1:] & ~pressing[:-1]) >= 10
    assert case == "row" or pressing[:, :3].sum(axis=1).max() >= 2
    assert stored(result, whole["contacts"]).max() > 0.01 * kept[0]
    assert np.abs(kept - kept[0]).max() <= 1e-12 * kept[0]


def test_the_work_of_an_impact_law_is_that_of_the_restitution():
    """(1 - e) / 2 of the force times the motion before it, in every step."""
    result = ran((("name", "moreau-jean"), ("gate", "current"), ("restitution", 0.5)))
    gap, force = result.arrays["gap"], result.arrays["contact_force"]
    expected = (0.5 * 0.5 * force[1:] * np.diff(gap, axis=0)).sum(axis=1)
    work = np.diff(bodies_energy(result))
    assert np.abs(work - expected).max() <= 1e-13 * bodies_energy(result)[0]
    assert expected.min() < 0.0


# ------------------------------------------------------------------------------------------------------ limits


@pytest.mark.deep
@pytest.mark.parametrize("courant", [0.5, 0.99])
@pytest.mark.parametrize(
    "law",
    [
        {"name": "energy-conserving-penalty"},
        {"name": "moreau-jean", "restitution": 0.5},
        {"name": "paoli-schatzman", "restitution": 0.5},
        {"name": "uzawa"},
        {"name": "nitsche"},
        {"name": "regularised-lagrange", "beta_s": 1e4},
    ],
    ids=str,
)
def test_what_is_said_to_keep_the_free_step_does(law, courant):
    uniform = {**ROW, "bodies": {**ROW["bodies"], "a": {**ROW["bodies"]["a"], "bar": {"length": 1.0, "elements": 5}}}}
    found = certificate(model_of(percuss.load(case_with(uniform, law, courant=courant, steps=20))))
    assert found["dt_critical"] == pytest.approx(found["dt_critical_free"], rel=1e-6)
    assert found["stable"] == "yes"


def test_nitsche_adds_energy_in_an_impact_and_less_stiffness_adds_much_more():
    """The automatic gamma lies where the force is nearest to the exact one."""
    gained, error = {}, {}
    for beta_s in ("auto", 0.5, 2.0):
        result = run(hunek(20, integrator=CD, contact={"name": "nitsche", "beta_s": beta_s}))
        energy = bodies_energy(result)
        gained[beta_s] = energy.max() / energy[0] - 1.0
        error[beta_s] = result.summary["exact"]["contacts"]["tip"]["force_error_l1"]
    assert 0.01 < gained["auto"] < 0.2
    assert gained[0.5] > 1.0
    assert error["auto"] < 0.12 < 0.4 < min(error[0.5], error[2.0])
