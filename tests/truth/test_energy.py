"""What a pair of methods guarantees of the energy, along every step: kept where it is said, seen where it is broken."""

import itertools
import math
from unittest import mock

import numpy as np
import pytest
from hypothesis import assume, event, given, settings
from hypothesis import strategies as st

import percuss
from percuss.certificate import verdict
from percuss.certificate.closed_laws import closed_laws
from percuss.march.model_of_case import model_of
from percuss.step import loop as leapfrog_loop
from strategies import (
    CD,
    FIRST,
    INTEGRATORS,
    LEAPFROG,
    PAIRS,
    PLAIN_PAIRS,
    UNIT,
    WU,
    bar,
    case_of,
    each_integrator,
    each_pair,
    finished,
    number,
    pair_id,
    rows,
    run,
    with_pair,
)

WITHIN = 1e-12


def steady(case):
    """Return the case with drives that never let go: what a contact stores depends on which of its nodes are held."""
    loads = {
        name: {k: v for k, v in one.items() if k not in {"from", "until"}} if one.get("as") == "velocity" else one
        for name, one in case["loads"].items()
    }
    return {**case, "loads": loads}


def energy(result):
    """Return E + V - W at each t_n+1/2 and the largest energy or work, from the histories alone.

    What a viscous scheme has taken counts as energy: contacts are held to what they add.
    """
    names = ("kinetic_energy", "elastic_energy", "external_work", "contact_energy")
    kinetic, elastic, work, stored = (result.arrays[name] for name in names)
    scale = max(np.abs(part).max() for part in (kinetic, elastic, work))
    return kinetic + elastic + stored - work + result.arrays.get("dissipated_energy", 0.0), scale


def rise(result):
    """Return the largest rise of E + V - W above its smallest value so far, over the largest energy or work."""
    values, scale = energy(result)
    return float((values - np.minimum.accumulate(values)).max() / scale) if scale > 0 else 0.0


def drift(result):
    """Return the largest sum of changes of E + V - W in steps at which no contact opened or closed."""
    values, scale = energy(result)
    closed = result.arrays["contact_force"] != 0
    stays = (closed[1:] == closed[:-1]).all(axis=1)
    return float(np.abs(np.cumsum(np.diff(values)[stays])).max(initial=0.0) / scale) if scale > 0 else 0.0


def closings(result):
    """Return how often a contact closed."""
    acts = result.arrays["contact_force"] != 0
    return int((acts[1:] & ~acts[:-1]).sum())


def between_two_walls(law, integrator=WU, steps=10_000, courant=0.5, elements=12, **record):
    """A bar that flies to and fro."""
    contacts = {"left": {"body": "a.left", "wall": -0.013}, "right": {"body": "a.right", "wall": 1.02}}
    time = {"steps": steps, "courant": courant}
    return case_of({"a": bar(1.0, elements, velocity=1.0)}, contacts, time, None, integrator, law, record=record)


def is_guaranteed(integrator, law):
    """Whether a pair guarantees anything of the energy of a bar that meets walls; without contact others do too."""
    model = model_of(percuss.load(between_two_walls(law, integrator)))
    return closed_laws(model, model.dt).energy in {"never grows", "conserved between switchings"}


GUARANTEED = [pair for pair in PAIRS if pair[0] in LEAPFROG and is_guaranteed(*pair)]
# Of the other pairs each law and each integrator once: nothing is guaranteed of them that a run could break.
PENALTY = next(law for law in FIRST if law["name"] == "penalty")
WITHOUT_GUARANTEE = [pair for pair in PAIRS if pair[1] == PENALTY or (pair[0] == CD and pair[1] in FIRST)]


# ------------------------------------------------------------------------------------------- what is guaranteed


def test_the_pairs_that_guarantee_something_are_these():
    both = {"lagrange", "paoli-schatzman", "penalty", "regularised-lagrange"}
    found = {(integrator, law["name"]) for integrator, law in GUARANTEED}
    assert found >= {(WU, "bipenalty"), *itertools.product((CD, WU), both)}


@pytest.mark.slow
@each_pair([pair for pair in PAIRS if pair in (*PLAIN_PAIRS, *GUARANTEED, *WITHOUT_GUARANTEE)], PLAIN_PAIRS)
@given(case=rows())
def test_the_guarantee_of_the_certificate_is_kept(pair, case):
    result = finished(with_pair(steady(case), pair))
    certificate, found = result.summary["certificate"], result.summary["energy_growth"]
    guarantee = certificate["energy"]
    event(guarantee)
    assert found["guarantee"] == guarantee
    assert (found["kept"] is None) == (found["allowed"] is None) == (guarantee in {"unknown", "not guaranteed"})
    if certificate["stable"] != "yes":
        return
    if guarantee == "never grows":
        assert rise(result) <= WITHIN
    elif guarantee == "conserved between switchings":
        assert drift(result) <= WITHIN
    assert found["kept"] is not False
    assert not [note for note in result.summary["notes"] if note.startswith("energy ")]


@pytest.mark.deep
@pytest.mark.parametrize(
    "pair", [pair for pair in PAIRS if pair[0] in LEAPFROG and (pair[1] in FIRST or pair[0] == WU)], ids=pair_id
)
@given(case=rows())
def test_the_watch_tells_what_the_histories_show(pair, case):
    """The loop sums the work of contacts; the histories hold the energies of the bodies."""
    result = finished(with_pair(steady(case), pair), certify=verdict.unasked)
    steps, found = result.summary["steps"], result.summary["energy_growth"]
    values, scale = energy(result)
    assume(scale > 0)
    above = (values - np.minimum.accumulate(values))[:steps]  # the step beyond the end does not count
    peak = np.abs(values).max() + np.abs(result.arrays["contact_work"]).max() + scale
    assert found["largest"] * scale <= above.max(initial=0.0) * (1 + 1e-9) + 1e-12 * peak
    if found["largest"] > 1e-9:
        assert above[found["step"]] >= found["largest"] * scale * (1 - 1e-9) - 1e-12 * peak
        assert found["time"] == pytest.approx(result.arrays["time_half"][found["step"]], rel=1e-12)
    grown = result.arrays["contact_work"] + result.arrays["contact_energy"]
    assert np.abs(grown - grown[0] - values + values[0]).max() <= 1e-12 * peak
    share = result.arrays["energy_growth"]  # over the largest energy up to then, which is at least this
    names = ("kinetic_energy", "elastic_energy", "external_work", "contact_work")
    sofar = np.maximum.accumulate(np.abs([result.arrays[name] for name in names]).max(axis=0))
    assert (np.abs(share) * sofar <= np.abs(grown - grown[0]) * (1 + 1e-12)).all()
    assert (np.sign(share) == np.sign(grown - grown[0])).all()


NEVER = {
    "penalty": {"name": "penalty", "beta_s": 0.4},
    "matched": {"name": "bipenalty", "beta_s": 10.0, "ratio": "matched"},
    "matched, stiff": {"name": "bipenalty", "beta_s": 1e8, "ratio": "matched"},
    "ratio 1": {"name": "bipenalty", "beta_s": 0.25, "ratio": 1.0},
    "near theta 1": {"name": "bipenalty", "beta_s": 2.0 * (1 - 1e-9), "ratio": math.inf},
    "lagrange": {"name": "lagrange"},
}


@pytest.mark.parametrize("law", NEVER)
def test_energy_never_grows_over_many_impacts(law):
    result = run(between_two_walls(NEVER[law]))
    assert closings(result) > 25
    assert rise(result) <= WITHIN
    found = result.summary["energy_growth"]
    assert found["guarantee"] == "never grows"
    assert found["kept"] is True
    assert found["largest"] <= WITHIN < found["allowed"] < 20 * WITHIN


def at_stable_step(case):
    """Return the case with a step below the critical one, where its own is known to be above that."""
    model = model_of(percuss.load(case))
    if verdict.certificate(model, search="without black box")["stable"] != "no":
        return case
    found = verdict.certificate(model)
    if not found["courant_critical"]:
        return case
    return {**case, "time": {**case["time"], "courant": 0.9 * found["courant_critical"]}}


@st.composite
def boxed(draw):
    """Unlike bars that fly to and fro between two walls for 10 000 steps."""
    case = draw(rows(bars=3))
    case["loads"] = {name: one for name, one in case["loads"].items() if one.get("as") != "velocity"}
    bodies, last = case["bodies"], list(case["bodies"].values())[-1]
    for one in bodies.values():
        one.pop("fixed", None)
    names = list(bodies)
    end = last["at"] + last["bar"]["length"]
    case["contacts"] |= {
        "wall-left": {"body": f"{names[0]}.left", "wall": -draw(number(0.01, 0.1))},
        "wall-right": {"body": f"{names[-1]}.right", "wall": round(end + draw(number(0.01, 0.1)), 6)},
    }
    bodies[names[0]]["velocity"] = draw(number(0.2, 1))
    case["time"]["steps"] = 10_000
    case["record"] = {"every": 25, "probes": []}
    return case


@pytest.mark.nightly
@pytest.mark.parametrize("pair", GUARANTEED, ids=pair_id)
@settings(max_examples=max(4, settings.default.max_examples // 3))  # each draw is a long run
@given(case=boxed())
def test_ten_thousand_steps_with_repeated_impacts_never_break_the_guarantee(pair, case):
    with mock.patch(
        "percuss.results.assemble.exact_solution", return_value=(None, "", "not asked for")
    ):  # it takes minutes
        result = finished(at_stable_step(with_pair(case, pair)))
    certificate, found = result.summary["certificate"], result.summary["energy_growth"]
    assert found["kept"] is not False
    if certificate["stable"] != "yes":  # of some laws it never is known
        event(certificate["stable"])
        return
    event(certificate["energy"])
    if certificate["energy"] == "never grows":
        assert rise(result) <= WITHIN
        assert found["largest"] <= WITHIN
    if certificate["energy"] == "conserved between switchings":
        assert found["between_switchings"] <= WITHIN


# -------------------------------------------------------------------------------------------------- the account


@each_integrator(INTEGRATORS)
@pytest.mark.parametrize("every", [7, 10_000])
def test_the_watch_sees_every_step_whatever_is_recorded(integrator, every):
    law = {"name": "penalty", "beta_s": 0.5}
    one = run(between_two_walls(law, integrator, 700))
    other = run(between_two_walls(law, integrator, 700, every=every))
    a, b = one.summary["energy_growth"], other.summary["energy_growth"]
    assert (a["step"], a["kept"], a["guarantee"]) == (b["step"], b["kept"], b["guarantee"])
    # shares of the largest energy that was recorded
    assert b["largest"] == pytest.approx(a["largest"], rel=0.1)


def test_the_step_beyond_the_end_does_not_count():
    """The run is cut at the step in which it grows most, which is then the one that completes the last record."""
    law = {"name": "penalty", "beta_s": 1.0}
    whole = run(between_two_walls(law, CD, 700)).summary["energy_growth"]
    step = whole["step"]
    cut = run(between_two_walls(law, CD, step)).summary["energy_growth"]
    assert cut["largest"] < 0.999 * whole["largest"]
    assert run(between_two_walls(law, CD, step + 1)).summary["energy_growth"]["step"] == step


# ------------------------------------------------------------------------------------------------ planted defects


def warned(case):
    return {**case, "time": {**case["time"], "on_unstable": "warn"}}


def twice(points, boundary, dt):
    """Let every multiplier act twice."""
    for row, state in zip(points.row, points.state, strict=True):
        for entry in points.entries[row.start : row.stop]:
            boundary[entry.place].new_v += 2 * dt * entry.response * state.multiplier


def a_step_late():
    """Return a push of contacts whose closed points press with the force of the step before."""
    before, right = [np.zeros(2)], leapfrog_loop.push

    def behind(points, *others):
        multiplier = points.state.multiplier
        asked = multiplier.copy()
        closed = (asked != 0) & (before[0] != 0)
        multiplier[closed] = before[0][closed]
        before[0] = asked
        right(points, *others)

    return behind


SOFT = {"name": "penalty", "beta_s": 0.1}


@pytest.mark.usefixtures("loop_anew")
@pytest.mark.parametrize(
    ("integrator", "law", "place", "defect", "broken", "said"),
    [
        *((WU, NEVER[law], "push", twice, rise, "energy grew") for law in ("penalty", "matched", "lagrange")),
        (CD, SOFT, "push", a_step_late(), drift, "energy changed"),  # conserved between switchings
    ],
)
def test_a_force_that_acts_twice_or_a_step_late_is_seen(monkeypatch, integrator, law, place, defect, broken, said):
    monkeypatch.setattr(leapfrog_loop, place, defect)
    result = run(warned(between_two_walls(law, integrator, 300)), compiled=False)
    assert broken(result) > 1e-6
    assert (result.summary["energy"]["ledger_error"] > 1e-6) == (defect is twice)
    growth = result.summary["energy_growth"]
    assert growth["kept"] is False
    (note,) = (note for note in result.summary["notes"] if note.startswith(said))
    assert f"{integrator} with {law['name']}" in note
    assert broken is drift or f"step {growth['step']}," in note


# ------------------------------------------------------------------------------------- changes of supports and drives


def let_go(beta_s, **window):
    """Two bars pressed together, the end of one of them held for a part of the run."""
    loads = {
        "push": {"ramp": {"value": 1, "duration": 4}, "on": "a.left"},
        "back": {"ramp": {"value": -1, "duration": 4}, "on": "b.right"},
        "hold": {"prescribed-velocity": 0, "on": "b.left", **window},
    }
    bars = {"a": bar(1.0, 10, material=UNIT), "b": bar(1.0, 10, 1.0, material=UNIT)}
    seam, law = {"c": {"between": ["a.right", "b.left"]}}, {"name": "penalty", "beta_s": beta_s}
    return case_of(bars, seam, {"end": 12, "courant": 0.5}, loads, WU, law)


@pytest.mark.parametrize("window", [{"until": 6.01}, {"from": 6.01}, {"from": 3.3, "until": 7.7}], ids=str)
@pytest.mark.parametrize("beta_s", [0.25, 0.9])
def test_growth_counts_what_a_change_of_drives_brings(beta_s, window):
    """The sum of energies less work, from the histories alone, rises by what the result says, guarantee or none."""
    result = percuss.run(percuss.load(let_go(beta_s, **window)))
    arrays, told = result.arrays, result.summary["energy_growth"]
    dt, gap = result.summary["dt"], arrays["gap"][:, 0]
    stiffness, mass = beta_s / 0.1, 0.05
    start, stop = window.get("from", 0.0), window.get("until", np.inf)
    middle = arrays["time"] + 0.5 * dt
    s = np.where((start < middle) & (middle < stop), 1.0, 2.0) / mass
    kappa = stiffness / (1.0 - dt**2 * stiffness * s)
    overlap = np.maximum(-gap, 0.0)
    last = arrays["kinetic_energy"].size - 1  # g_{n+1} of the last record is not recorded
    stored = 0.25 * kappa[:last] * (overlap[:last] ** 2 + overlap[1 : last + 1] ** 2)
    total = (arrays["kinetic_energy"] + arrays["elastic_energy"] - arrays["external_work"])[:last] + stored
    np.testing.assert_allclose(arrays["contact_energy"][:last], stored, atol=1e-13)
    rise = (total[1:] - np.minimum.accumulate(total[1:])).max()
    parts = ("kinetic_energy", "elastic_energy", "external_work", "contact_work")
    scale = max(np.abs(arrays[name]).max() for name in parts)
    assert told["largest"] == pytest.approx(rise / scale, rel=1e-9, abs=1e-12)
    if "until" in window:  # contact is closed then: its effective stiffness rises as the end is let go
        assert rise > 1e-3 * scale
        assert told["guarantee"] == "not guaranteed"
        why = result.summary["certificate"]["energy_why"]
        assert "a drive starts or ends at contact 'c'" in why
        assert f"at {window['until'] - window['until'] % dt:.6g}"[:4] in why
    else:  # it falls, and what is stored with it
        assert rise <= 1e-12 * scale
        assert (told["guarantee"], told["kept"]) == ("never grows", True)
