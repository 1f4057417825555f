"""What holds for every drawn case and every registered pair: balances, and that nothing depends on how one looks.

The registries are swept as they are: a plug-in that is installed later is drawn into these tests by itself.
"""

import copy
import functools
import itertools
import math
import os

import numpy as np
import pytest
from hypothesis import assume, event, given
from hypothesis import strategies as st

import percuss
import strategies
from marks import deep
from percuss.certificate import verdict
from percuss.march.model_of_case import model_of
from strategies import (
    CD,
    CORE_PAIRS,
    FIRST,
    INTEGRATORS,
    LEAPFROG,
    PAIRS,
    REGISTRY,
    apart,
    bar,
    case_of,
    converted,
    each_integrator,
    number,
    pair_id,
    reordered,
    round_off,
    rows,
    swapped,
    turned,
    unit,
    with_pair,
)

pytestmark = pytest.mark.slow

INVARIANT = ("contact_force", "gap", "kinetic_energy", "elastic_energy", "contact_work", "external_work")
# With few draws each law with each integrator, and all options with Wu's; with many draws those of the core: each pair
# compiles kernels.
EACH_PAIR = pytest.mark.parametrize(
    "pair",
    [pair for pair in PAIRS if pair[1] in FIRST or pair[0] == "wu-predictor-corrector"]
    if os.environ.get("HYPOTHESIS_PROFILE", "quick") == "quick"
    else CORE_PAIRS,
    ids=pair_id,
)
SOME_PAIR = st.sampled_from(CORE_PAIRS)


def never_stopped(case):
    """Whatever its pair: with Wu and theta below 1, or a multiplier judged at the end of the step, nothing grows."""
    integrator, contact = case["method"]["integrator"], case["method"]["contact"]["name"]
    if case["time"]["courant"] >= REGISTRY.get("integrators", integrator).critical_courant:
        return  # at the limit the highest frequency of a free bar grows with time, though not exponentially
    theta = verdict.verdict_alone(model_of(percuss.load(case)))["theta"]
    assert contact != "lagrange"
    assert not (integrator == "wu-predictor-corrector" and contact == "bipenalty" and theta < 0.5)


finished = functools.partial(strategies.finished, stopped=never_stopped)


# --------------------------------------------------------------------------------------------------- balances


@pytest.mark.deep
@EACH_PAIR
@given(case=rows())
def test_momentum_and_energy_are_accounted_for(pair, case):
    result = finished(with_pair(case, pair), certify=verdict.unasked)
    assert result.summary["momentum"]["error"] <= 1e-12
    if pair[0] in LEAPFROG:  # of others see test_schemes
        assert result.summary["energy"]["ledger_error"] <= 1e-12


def gap_rates(case, result):
    """Return the gap rates from the velocities of the probes, (time, contact); bars along x."""
    velocity = dict(zip(result.coordinates["probe"], result.arrays["velocity"][:, :, 0].T, strict=True))
    out = np.zeros_like(result.arrays["gap"])
    for k, one in enumerate(case["contacts"].values()):
        ends = one["between"] if "between" in one else [one["body"]]
        sign = 1.0 if ends[0].endswith(".right") else -1.0
        out[:, k] = sign * ((velocity[ends[1]] if len(ends) > 1 else 0.0) - velocity[ends[0]])
    return out


@each_integrator(INTEGRATORS)
@given(case=rows())
def test_the_accounts_are_those_of_the_histories(integrator, case):
    """Impulses and works summed by the loop against sums over what was recorded, in numpy."""
    result = finished(with_pair(case, (integrator, {"name": "penalty"})), certify=verdict.unasked)
    force, gap, dt = result.arrays["contact_force"], result.arrays["gap"], result.summary["dt"]
    steps = result.summary["steps"]
    for k, name in enumerate(result.coordinates["contact"]):
        found = result.summary["contacts"][name]
        peak = np.abs(force[:, k]).max()
        assert found["impulse"] == pytest.approx(dt * force[:steps, k].sum(), rel=1e-12, abs=1e-14 * peak * dt * steps)
        assert found["peak_force"] == pytest.approx(max(force[:, k].max(), 0.0), rel=1e-14)  # at t_N too
        assert found["closed_time"] == pytest.approx(dt * np.count_nonzero(force[:steps, k]), rel=1e-12)
        deepest, recorded = found["penetration"]["largest"], max(-gap[:, k].min(), 0.0)
        if integrator in LEAPFROG:
            assert deepest == pytest.approx(recorded, rel=1e-12)
        else:  # stages between the records count too
            assert deepest >= recorded * (1.0 - 1e-12)
    # work of the contacts, from gaps on either side of each step, or gap rates at its ends
    rate = gap_rates(case, result)
    work = np.zeros(steps)
    for n in range(1, steps):
        moved = 0.5 * (gap[n + 1] - gap[n - 1]) if integrator in LEAPFROG else 0.5 * dt * (rate[n] + rate[n + 1])
        work[n] = work[n - 1] + force[n] @ moved
    mine = result.arrays["contact_work"][:steps] - result.arrays["contact_work"][0]
    scale = np.abs(mine).max() + np.abs(force).max(initial=0.0) * np.abs(gap).max(initial=0.0) * 1e-3
    assert np.abs(mine - work).max() <= 1e-11 * scale


@pytest.mark.parametrize("integrator", [deep(one) if one.startswith("viscous") else one for one in LEAPFROG])
@given(case=rows())
def test_lagrange_multipliers_are_complementary_to_the_gaps(integrator, case):
    result = finished(with_pair(case, (integrator, {"name": "lagrange"})), certify=verdict.unasked)
    force, gap = result.arrays["contact_force"], result.arrays["gap"]
    assume(force.size)
    moved = np.abs(result.arrays["displacement"]).max() + np.abs(gap).max()
    assert force.min() >= 0.0
    assert gap.min() >= -1e-12 * moved
    assert np.abs(force[:-1] * gap[1:]).max() <= 1e-12 * force.max() * moved


# ------------------------------------------------------------------------------------------------- invariances


def same(base_case, base, other, factors=None):
    """Hold what must not change against what a nudge does; `factors` are the units of the other run."""
    allowed = round_off(base_case, base, INVARIANT)
    if math.isinf(allowed["contact_force"]):
        event("depends on round-off")
        return
    scaled = copy.copy(other)
    scaled.arrays = {k: v / (factors or {}).get(k, 1.0) for k, v in other.arrays.items() if k in INVARIANT}
    moved = apart(base, scaled, INVARIANT)
    energy = max(np.abs(base.arrays[k]).max() for k in ("kinetic_energy", "elastic_energy", "external_work"))
    for name in INVARIANT:
        peak = np.abs(base.arrays[name]).max(initial=0.0)
        # energies and works are parts of one sum, gaps differences of displacements: round-off is of the whole
        whole = energy if "energy" in name or "work" in name else peak
        if name == "gap":
            whole = max(peak, np.abs(base.arrays["displacement"]).max())
        if peak > 0.0:
            assert moved[name] <= max(allowed[name], 1e-13 * whole / peak), name


@given(case=rows(), pair=SOME_PAIR, shift=number(-5, 5))
def test_nothing_changes_under_translation(case, pair, shift):
    case = with_pair(case, pair)
    moved = copy.deepcopy(case)
    for one in moved["bodies"].values():
        one["at"] += shift
    for one in moved["contacts"].values():
        if "wall" in one:
            one["wall"] += shift
    same(case, finished(case), finished(moved))


@given(
    case=rows(),
    pair=SOME_PAIR,
    direction=st.just([-1]) | st.lists(st.integers(-3, 3), min_size=2, max_size=3).filter(any),
)
def test_nothing_changes_under_rotation_or_in_a_mirror(case, pair, direction):
    case = with_pair(case, pair)
    same(case, finished(case), finished(turned(case, direction)))


@given(case=rows(), pair=SOME_PAIR)
def test_nothing_changes_with_the_order_of_bodies_sides_and_contacts(case, pair):
    case = with_pair(case, pair)
    base, other = finished(case), finished(reordered(swapped(case)))
    for name in ("contact_force", "gap", "contact_force_end"):
        if name in other.arrays:
            other.arrays[name] = other.arrays[name][:, ::-1]
    same(case, base, other)


@given(case=rows(), pair=SOME_PAIR)
def test_nothing_changes_with_the_units(case, pair):
    assume(set(pair[1]) <= {"name", "beta_s", "beta_m", "ratio", "epsilon_s", "epsilon_m"})
    case = with_pair(case, pair)
    factors = dict.fromkeys(INVARIANT, unit("energy")) | {"contact_force": unit("force"), "gap": unit("length")}
    same(case, finished(case), finished(converted(case)), factors)


@pytest.mark.deep
@given(case=rows(), pair=SOME_PAIR)
def test_plain_python_gives_what_compiled_code_gives(case, pair):
    case = with_pair(case, pair)
    case["time"]["steps"] = min(case["time"]["steps"], 60)
    plain = finished(case, compiled=False)
    assert plain.summary["compiled"] is False
    same(case, finished(case), plain)


# The unit of time decides on which side of a tie round-off leaves instants at the midpoints of steps.
AB = {"ab": {"between": ["a.right", "b.left"]}}
TIMES_OF_A_SECOND = (1.0, 3.0, 1.1, 0.7, 1e6)


def begun_and_ended_at_midpoints(second, of):
    material = {"young": 1.0 / second**2, "density": 1.0}
    bars = {name: bar(1.0, 5, at, speed / second, material) for name, at, speed in (("a", 0.0, 0.1), ("b", 1.0, -0.1))}
    during = ((0.35 * second, 0.95 * second), (1.15 * second, 2.25 * second))
    law = {"name": "tied", "during": during} if of == "law" else "lagrange"
    drive = {"prescribed-velocity": 0.3 / second, "on": "a.left", "from": during[0][0], "until": during[0][1]}
    time, drives = {"end": 3.0 * second, "step": 0.1 * second}, {"drive": drive} if of == "drive" else {}
    return case_of(bars, AB, time, drives, CD, law)


@pytest.mark.parametrize("of", ["law", "drive"])
def test_what_begins_or_ends_at_the_midpoint_of_a_step_does_so_in_any_unit_of_time(of):
    peaks = []
    for second in TIMES_OF_A_SECOND:
        result = percuss.run(percuss.load(begun_and_ended_at_midpoints(second, of)))
        peaks.append(result.arrays["contact_force"].sum() * second**2)
    assert np.allclose(peaks, peaks[0], rtol=1e-12)


def test_of_two_sides_of_the_same_stiffness_none_is_the_softer_one_by_round_off():
    """EA/h of both is .3/.1 and .15/.05; their masses are not the same, nor does naming them in another order tell."""
    masses = []
    for area, order in itertools.product((1.0, 1.1, 0.7), ("ab", "ba")):
        bars = {
            "a": bar(0.7, 7, 0.0, 0.0, {"young": 0.3, "density": 1.0}, area),
            "b": bar(0.35, 7, 0.7, 0.0, {"young": 0.15, "density": 3.0}, area),
        }
        contacts = AB if order == "ab" else {"ab": {"between": ["b.left", "a.right"]}}
        time = {"end": 1.0, "courant": 0.5}
        case = case_of({name: bars[name] for name in order}, contacts, time, None, CD, "penalty")
        masses.append(model_of(percuss.load(case)).contact_points.mass[0] / area)
    assert np.allclose(masses, masses[0], rtol=1e-12)


def test_a_step_in_which_the_exact_force_presses_for_a_tenth_of_the_time_is_counted_alike_in_any_unit():
    """The exact force is that of two equal bars, from 0 to 2: the last step in which it acts ends its tenth there."""
    for steps in (12, 15, 17, 21):
        ripples = []
        for second in TIMES_OF_A_SECOND:
            case = begun_and_ended_at_midpoints(second, "none")
            case["time"] = {"end": 3.0 * second, "step": 2.0 * second / (steps - 0.4)}
            ripples.append(REGISTRY.get("measures", "ripple")().of(percuss.run(percuss.load(case))))
        assert np.allclose(ripples, ripples[0], rtol=1e-9)
