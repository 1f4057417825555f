"""Leap-frog schemes in which each body has a step of its own, against dense matrices, central difference and theory."""

import math

import numpy as np
import pytest

import dense
import percuss
from marks import deep
from percuss.certificate.verdict import certificate, settled
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from strategies import bar, case_of, run

STIFF = {"young": 1e4, "density": 0.01}
SOFT = {"young": 100.0, "density": 0.01}
MIDDLE = {"young": 900.0, "density": 0.01}


def three_bars(contact="penalty", **time):
    """A stiff bar strikes a soft one, which strikes one that hangs at a fixed end later: m = 1, 10 and 3."""
    return case_of(
        {
            "stiff": bar(1.0, 10, 0.0, 0.1, STIFF),
            "soft": bar(1.2, 12, 1.0, 0.0, SOFT),
            "hung": bar(0.8, 8, 2.2005, 0.0, MIDDLE, 1.3, ["right"]),
        },
        {"tip": {"between": ["stiff.right", "soft.left"]}, "rear": {"between": ["soft.right", "hung.left"]}},
        ({} if "end" in time else {"steps": 700}) | {"courant": 0.4} | time,
        {"weight": {"gravity": 0.7}, "push": {"constant": 0.02, "on": "stiff.left"}},
        "asynchronous", contact,
    )  # fmt: skip


def two_bars(contact="penalty", courant=0.5, soft=40, **time):
    case = three_bars(contact, courant=courant, **time)
    del case["bodies"]["hung"], case["contacts"]["rear"], case["loads"]
    case["bodies"]["soft"]["bar"] = {"length": soft / 10, "elements": soft}
    case["record"] = {}
    return case


def judged(case):
    return certificate(model_of(percuss.load(case)))


def energy_of(result):
    return result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]


@pytest.mark.deep
@pytest.mark.parametrize("contact", ["penalty", "bipenalty", "lagrange"])
def test_motion_forces_and_energies_are_those_of_full_matrices(contact):
    """Nodes inside a body are advanced by m steps at a time: snapshots and the last displacement go back to t_n."""
    case = three_bars({"name": contact} | ({} if contact == "lagrange" else {"beta_s": 0.3}), on_unstable="warn")
    case["record"]["fields"] = 111
    model = model_of(percuss.load(case))
    assert model.leaps == (1, 10, 3)
    result, reference = run(case), dense.march(case)
    force = result.arrays["contact_force"]
    assert (force != 0.0).any(axis=0).all()  # both contacts close
    assert np.abs(force - reference.force).max() < 1e-9 * np.abs(reference.force).max()
    assert np.abs(result.arrays["gap"] - reference.gap).max() < 1e-12
    for k, probe in enumerate(case["record"]["probes"]):
        node = reference.bars.node(probe)
        assert np.abs(result.arrays["displacement"][:, k, 0] - reference.u[:, node]).max() < 1e-12
        assert np.abs(result.arrays["velocity"][:, k, 0] - reference.v[:, node]).max() < 1e-10
    assert np.abs(energy_of(result) - reference.energy).max() < 1e-11 * reference.energy.max()
    assert result.summary["energy"]["ledger_error"] < 1e-12
    assert result.summary["momentum"]["error"] < 1e-12
    assert np.abs(March(model).run().final_displacement - reference.u[700]).max() < 1e-12
    stress = result.fields["stress"]
    u = reference.u[:: 700 // 111][: stress.shape[0]]
    nodes = [(0, 11, 0.1, 1e4), (11, 24, 0.1, 100.0), (24, 33, 0.1, 900.0)]
    expected = np.concatenate([young / h * np.diff(u[:, lo:hi], axis=1) for lo, hi, h, young in nodes], axis=1)
    assert np.abs(stress[: len(u)] - expected).max() < 1e-9 * np.abs(expected).max()


def test_bodies_alike_make_central_difference_to_the_last_bit():
    case = two_bars(steps=300)
    case["bodies"]["stiff"]["material"] = SOFT
    assert model_of(percuss.load(case)).period == 1
    ours = run(case)
    case["method"]["integrator"] = "central-difference"
    theirs = run(case)
    for name, values in theirs.arrays.items():
        assert np.array_equal(ours.arrays[name], values, equal_nan=True), name
    assert ours.summary["certificate"] == theirs.summary["certificate"]


def test_the_elements_of_a_body_that_is_not_due_are_left_alone():
    """They are made to give nan between two actions of their forces: nothing shows until the next one."""
    march = March(model_of(percuss.load(two_bars(steps=40))), compiled=False)
    march.advance(march.stepper.amplitudes(0, 11), 0, 11)
    ((block, _, _),) = march.arrays.blocks
    values = block.element[0]
    values.flags.writeable = True
    values[10:] = np.nan
    march.advance(march.stepper.amplitudes(11, 9), 11, 9)
    assert np.isfinite(march.v).all()
    march.advance(march.stepper.amplitudes(20, 1), 20, 1)
    assert np.isnan(march.v[11:]).all()


@pytest.mark.parametrize("element", ["bar", deep("green-bar")])
def test_the_ledger_closes_whatever_the_contact_does(element):
    case = three_bars("lagrange", on_unstable="warn", steps=4000)
    for body in case["bodies"].values():
        body["element"] = element
    result = run(case)
    assert result.summary["energy"]["ledger_error"] < 1e-11
    assert result.summary["certificate"]["energy"] == "not guaranteed"


def test_one_mass_between_two_springs_has_the_resonance_of_the_text():
    """Fong, Darve, Lew (2008): two potentials of one mass, kicked with steps h and m h, resonate as m h omega nears pi.

    Two bars of one element, tied at one end each and fixed at the other, are such a mass. The step is unstable where
    the trace of its matrix of a period, of two rows, exceeds 2.
    """
    case = case_of(
        {
            "stiff": bar(1.0, 1, 0.0, 0.1, {"young": 1600.0, "density": 0.01}, 1.0, ["left"]),
            "soft": bar(1.0, 1, 1.0, 0.1, SOFT, 1.0, ["right"]),
        },
        {"tip": {"between": ["stiff.right", "soft.left"]}},
        {"steps": 1, "on_unstable": "warn"}, None, "asynchronous", "tied",
    )  # fmt: skip
    said, true = [], []
    courants = np.arange(0.02, 1.0, 0.01)
    for courant in courants:
        case["time"]["courant"] = float(courant)
        model = model_of(percuss.load(case))
        assert model.leaps == (1, 4)
        said.append(certificate(model)["stable"])
        h, fast, slow = model.dt, 1600.0 / 0.01, 100.0 / 0.01  # springs over the mass of the joined ends
        period = np.eye(2)
        for n in range(4):
            kick = np.array([[1.0, 0.0], [-h * (fast + (4.0 * slow if n == 0 else 0.0)), 1.0]])
            period = np.array([[1.0, h], [0.0, 1.0]]) @ kick @ period
        true.append(abs(np.trace(period)) - 2.0)
    sure = np.abs(true) > 1e-6
    assert (np.array(said) == np.where(np.array(true) > 0.0, "no", "yes"))[sure].all()
    unstable = courants[np.array(said) == "no"]
    # omega h = C: half a period of the fast spring is m h at C = pi / 4, up to the dispersion of the step
    assert 0.7 < unstable.min() < math.pi / 4 < unstable.max() + 0.05 < 0.85


def test_what_the_certificate_cannot_know_is_unknown_with_the_reason():
    follows, odd = two_bars(), two_bars()
    follows["loads"] = {"bed": {"spring-dashpot": {"stiffness": 5.0}, "on": "soft.right"}}
    for name, at, young in (("third", 90.0, 1.83), ("fourth", 190.0, 2.5)):
        odd["bodies"][name] = odd["bodies"]["soft"] | {"at": at, "material": {"young": young, "density": 0.01}}
    assert math.lcm(1, 10, 73, 63) > 256
    reasons = {
        "has a kernel": two_bars("hunt-crossley"),
        "'bed'": follows,
        "45990-th": odd,
        "Krylov": two_bars(soft=400),
    }
    for why, case in reasons.items():
        found = judged(case)
        assert found["stable"] == "unknown"
        assert why in found["why"]
    with pytest.raises(percuss.InputError, match="some step is known"):
        settled(percuss.load(two_bars(courant="auto")))


def test_massless_ends_are_refused():
    case = two_bars("lagrange")
    case["method"]["mass"] = "redistributed"
    with pytest.raises(percuss.RefusedPair, match="asynchronous gives no internal forces that act in every step"):
        model_of(percuss.load(case))
