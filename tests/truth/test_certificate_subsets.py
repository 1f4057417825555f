"""Certificates against full amplification matrices: every subset of closed contacts, every stretch of the run."""

import itertools

import numpy as np
import pytest
from hypothesis import assume, event, given
from hypothesis import strategies as st

import percuss
from amplification import CD, NOH_BATHE, WU, Bodies, largest_radius, radius
from percuss.certificate.verdict import certificate
from percuss.march.model_of_case import model_of
from strategies import UNIT, bar, case_of

GROWS = 1e-6  # a defective eigenvalue at 1 (a rigid motion) is computed to some 1e-7


def number(low, high):
    return st.floats(np.log(low), np.log(high)).map(lambda x: float(np.exp(x)))


@st.composite
def contact_law(draw):
    """A law in absolute numbers, soft to far too stiff for the step, light to far heavier than the end."""
    name = draw(st.sampled_from(["penalty", "penalty", "bipenalty", "bipenalty", "lagrange", "tied"]))
    if name in {"lagrange", "tied"}:
        return name
    law = {"name": name, "epsilon_s": draw(number(0.5, 300.0))}
    return law if name == "penalty" else {**law, "epsilon_m": draw(number(1e-4, 10.0))}


@st.composite
def joints(draw):
    """A bar whose right end meets one to three bars side by side, each with a law of its own; walls; drives that end.

    In half of the cases one law serves all contacts.
    """
    count = draw(st.integers(1, 3))
    bodies, contacts, loads = {}, {}, {}
    for k in range(count + 1):
        material = {"young": draw(number(0.3, 3.0)), "density": draw(number(0.3, 3.0))}
        elements, area = draw(st.integers(1, 4)), draw(number(0.3, 3.0))
        bodies[f"b{k}"] = bar(1.0, elements, 0.0 if k else -1.0, 0.0, material, area)
        far = "right" if k else "left"
        if draw(st.integers(0, 3)) == 0:
            bodies[f"b{k}"]["fixed"] = [far]
        elif k and draw(st.integers(0, 3)) == 0:
            contacts[f"wall{k}"] = {"body": f"b{k}.right", "wall": 1.0}
        if k:
            contacts[f"c{k}"] = {"between": ["b0.right", f"b{k}.left"]}
    if draw(st.integers(0, 2)) == 0:
        contacts["stop"] = {"body": "b0.right", "wall": draw(st.sampled_from([0.0, 0.5]))}
    common = draw(contact_law()) if draw(st.booleans()) else None
    for contact in contacts.values():
        contact["method"] = common or draw(contact_law())
    if draw(st.integers(0, 2)) == 0:
        end = draw(st.sampled_from(["b0.right", *(f"b{k}.left" for k in range(1, count + 1))]))
        window = draw(st.sampled_from([{"until": 6.0}, {"from": 3.0}, {"from": 3.0, "until": 6.0}]))
        loads["drive"] = {"prescribed-velocity": 0.0, "on": end, **window}
    return case_of(bodies, contacts, {"end": 10.0, "courant": 0.5}, loads, CD, "lagrange")


def loaded(case):
    try:
        return model_of(percuss.load(case))
    except (percuss.InputError, percuss.RefusedPair) as error:
        assume("no step is stable" not in str(error))
        assume(not any(words in str(error) for words in ("can move", "makes no sense", "free along")))
        raise


@pytest.mark.slow
@given(integrator=st.sampled_from([CD, WU, NOH_BATHE]), case=joints(), courant=st.floats(0.05, 1.6))
def test_a_yes_holds_for_every_subset_and_every_stretch(integrator, case, courant):
    """A certificate never says yes to a step that can grow, and no only to one that can."""
    case["method"]["integrator"], case["time"]["courant"] = integrator, courant
    model = loaded(case)
    found = certificate(model)
    bodies = Bodies(case)
    assert model.bodies.omega == pytest.approx(2.0 * max(bodies.fastest.values()), rel=1e-12)
    largest, when, closed = largest_radius(bodies, integrator, model.dt, 10.0)
    event(found["stable"])
    if found["stable"] in {"yes", "marginal"}:
        assert largest <= 1.0 + GROWS, (found["why"], when, closed)
    elif found["stable"] == "no" and (found["margin"] is None or found["margin"] > 1.05):
        assert largest > 1.0 + 1e-9, found["why"]
    else:
        assert found["why"]


@pytest.mark.deep
@pytest.mark.parametrize("integrator", [CD, WU])
@given(case=joints())
def test_the_critical_step_is_tight_and_its_contacts_limit_it(integrator, case):
    """Below it no subset grows; a little above it the contacts that are named do, closed by themselves."""
    case["method"]["integrator"] = integrator
    case["time"]["courant"] = 0.02
    found = certificate(loaded(case))
    critical = found["dt_critical"]
    assume(found["stable"] == "yes" and found["worst"] and critical is not None)
    assume(critical < 0.9 * found["dt_critical_free"])
    bodies, names = Bodies(case), list(case["contacts"])
    largest, when, closed = largest_radius(bodies, integrator, 0.99 * critical, 10.0)
    assert largest <= 1.0 + GROWS, (found["why"], when, closed)
    worst = [names.index(name) for name in found["worst"]]
    event(f"{len(worst)} of {len(names)} contacts limit the step")
    above = 1.05 * critical
    times = bodies.times(above, 10.0)
    if found["stretch"] is not None:
        times = [time for time in times if found["stretch"][0] <= time <= found["stretch"][1]]
    assert times
    if integrator == WU and len(worst) > 1:
        case["time"] = {"end": 10.0, "step": above}
        just_above = certificate(loaded(case))
        if just_above["stable"] == "unknown":
            assert "too slowly to distinguish from rounding" in just_above["why"] or just_above["theta"] > 1.0
            return
        assert just_above["stable"] == "no"
    grown = max(radius(bodies, integrator, above, bodies.held_at(time), worst) for time in times)
    assert grown > 1.0 + 1e-9, found["why"]
    if len(worst) > 1:  # none of them can be spared
        for fewer in itertools.combinations(worst, len(worst) - 1):
            # the certificate asks a millionth above the critical step which contacts limit it
            spared = max(radius(bodies, integrator, (1 + 5e-7) * critical, bodies.held_at(t), fewer) for t in times)
            assert spared <= 1.0 + GROWS, (found["why"], fewer)


def two_bars(contacts, integrator, time, law="penalty"):
    """Return a case of two equal bars that touch."""
    bars = {name: bar(1.0, 10, at, 0.0, UNIT) for name, at in (("a", 0.0), ("b", 1.0))}
    return case_of(bars, contacts, time, None, integrator, law)


def test_unequal_contacts_on_one_end_can_grow_at_any_theta():
    """Each law by itself is far below theta = 1; eps_m / eps_s differs, and the closed step is not symmetric."""
    bars = {
        name: bar(1.0, n, at, material={"young": young, "density": 1.0}, area=area)
        for name, at, n, young, area in (("a", -1.0, 6, 1.0, 1.0), ("b", 0.0, 5, 2.0, 0.5), ("c", 0.0, 7, 0.5, 0.7))
    }
    contacts = {
        f"a{name}": {"between": ["a.right", f"{name}.left"],
                     "method": {"name": "bipenalty", "epsilon_s": stiffness, "epsilon_m": mass}}
        for name, stiffness, mass in (("b", 34.0, 2.0), ("c", 3.0, 0.009))
    }  # fmt: skip
    case = case_of(bars, contacts, {"end": 1.0, "courant": 0.5}, None, WU, "penalty")
    model = loaded(case)
    found = certificate(model)
    largest, _, closed = largest_radius(Bodies(case), WU, model.dt, 1.0)
    assert largest > 1.004
    assert closed == (0, 1)
    assert found["theta"] < 0.4
    assert (found["stable"], found["worst"], found["dt_critical"]) == ("no", ["ab", "ac"], 0.0)
    assert "share an end and differ in eps_m / eps_s" in found["why"]
    assert found["cure"].startswith("give contacts that share an end the same eps_m / eps_s")
    for contact in case["contacts"].values():
        contact["method"] = {**contact["method"], "epsilon_m": contact["method"]["epsilon_s"] * 0.05}
    assert certificate(loaded(case))["stable"] == "yes"
    assert largest_radius(Bodies(case), WU, model.dt, 1.0)[0] <= 1.0 + GROWS


def test_the_stretch_in_which_a_drive_has_let_go_is_told_with_its_time():
    hold = {"hold": {"prescribed-velocity": 0, "on": "b.left", "until": 6.01}}
    law = {"name": "penalty", "beta_s": 1.9}
    seam = {"c": {"between": ["a.right", "b.left"]}}
    case = two_bars(seam, WU, {"end": 60.0, "courant": 0.5}, law) | {"loads": hold}
    found = certificate(loaded(case))
    # s = 1/m while b.left is held, 2/m behind it: theta = 2 C^2 beta_s and 4 C^2 beta_s
    assert found["theta"] == pytest.approx(1.9, rel=1e-12)
    assert (found["stable"], found["worst"]) == ("no", ["c"])
    assert found["stretch"] == pytest.approx([6.0, 60.0])
    assert "from 6 to 60" in found["why"]
    case["loads"]["hold"]["until"] = 100.0
    held = certificate(loaded(case))
    assert held["theta"] == pytest.approx(0.95, rel=1e-12)
    assert (held["stable"], held["stretch"]) == ("yes", None)


def test_the_contact_that_limits_the_step_is_the_one_that_is_named():
    hard = {"name": "bipenalty", "epsilon_s": 100.0, "epsilon_m": 0.1}
    contacts = {
        "soft": {"between": ["a.right", "b.left"], "method": {"name": "penalty", "epsilon_s": 1e-9}},
        "hard": {"body": "b.right", "wall": 2.0, "method": hard},
    }
    case = two_bars(contacts, CD, {"end": 1.0, "step": 0.03})
    assert certificate(loaded(case))["worst"] == ["hard"]
