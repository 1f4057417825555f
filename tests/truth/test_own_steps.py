"""Leap-frog schemes in which each body has a step of its own, against dense matrices, central difference and theory."""

import copy
import math

import numpy as np
import pytest

import dense
import percuss
from percuss.certificate.black_box import examine
from percuss.certificate.closed_step import Motions
from percuss.certificate.verdict import certificate, settled
from percuss.march.march import March
from percuss.march.model_of_case import model_of

STIFF = {"young": 1e4, "density": 0.01}
SOFT = {"young": 100.0, "density": 0.01}
MIDDLE = {"young": 900.0, "density": 0.01}


def three_bars(contact="penalty", integrator="asynchronous", **time):
    """A stiff bar strikes a soft one, which strikes a wall later; a third one hangs at a fixed end: m = 1, 10 and 3."""
    return {
        "percuss": 1,
        "bodies": {
            "stiff": {"bar": {"length": 1.0, "elements": 10}, "material": STIFF, "area": 1.0, "velocity": 0.1},
            "soft": {"bar": {"length": 1.2, "elements": 12}, "at": 1.0, "material": SOFT, "area": 1.0, "velocity": 0.0},
            "hung": {
                "bar": {"length": 0.8, "elements": 8},
                "at": 2.2005,
                "material": MIDDLE,
                "area": 1.3,
                "velocity": 0.0,
                "fixed": ["right"],
            },
        },
        "contacts": {
            "tip": {"between": ["stiff.right", "soft.left"]},
            "rear": {"between": ["soft.right", "hung.left"]},
        },
        "loads": {
            "weight": {"gravity": 0.7},
            "push": {"constant": 0.02, "on": "stiff.left"},
        },
        "method": {"integrator": integrator, "contact": contact},
        "time": ({} if "end" in time else {"steps": 700}) | {"courant": 0.4} | time,
        "record": {"probes": [f"{name}.{end}" for name in ("stiff", "soft", "hung") for end in ("left", "right")]},
    }


def run(case):
    return percuss.run(percuss.load(case))


def two_bars(contact="penalty", courant=0.5, soft=40, **time):
    case = three_bars(contact, courant=courant, **time)
    del case["bodies"]["hung"], case["contacts"]["rear"], case["loads"]
    case["bodies"]["soft"]["bar"] = {"length": soft / 10, "elements": soft}
    case["record"] = {}
    return case


# ------------------------------------------------------------------------------------------------- the motion


@pytest.mark.parametrize("contact", ["penalty", pytest.param("bipenalty", marks=pytest.mark.deep), "lagrange"])
def test_motion_forces_and_energies_are_those_of_full_matrices(contact):
    law = {"name": contact} | ({} if contact == "lagrange" else {"beta_s": 0.3})
    case = three_bars(law, on_unstable="warn")
    assert model_of(percuss.load(case)).leaps == (1, 10, 3)
    result, reference = run(case), dense.march(case)
    force = result.arrays["contact_force"]
    assert (force != 0.0).any(axis=0).all()  # both contacts close
    scale = np.abs(reference.force).max()
    assert np.abs(force - reference.force).max() < 1e-9 * scale
    assert np.abs(result.arrays["gap"] - reference.gap).max() < 1e-12
    for k, probe in enumerate(case["record"]["probes"]):
        assert np.abs(result.arrays["displacement"][:, k, 0] - reference.displacement(probe)).max() < 1e-12
        assert np.abs(result.arrays["velocity"][:, k, 0] - reference.velocity(probe)).max() < 1e-10
    energy = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
    assert np.abs(energy - reference.energy).max() < 1e-11 * reference.energy.max()
    assert result.summary["energy"]["ledger_error"] < 1e-12
    assert result.summary["momentum"]["error"] < 1e-12


def test_displacements_inside_the_bodies_are_recorded_at_the_time_of_the_record():
    """Nodes inside a body are advanced by m steps at a time: snapshots and the last displacement go back to t_n."""
    case = three_bars({"name": "penalty", "beta_s": 0.3}, steps=333)
    reference = dense.march(case)
    model = model_of(percuss.load(case))
    outcome = March(model).run()
    assert np.abs(outcome.final_displacement - reference.u[333]).max() < 1e-12
    case["record"]["fields"] = 111
    stress = run(case).fields["stress"]
    u = reference.u[:: 333 // 111][: stress.shape[0]]
    nodes = [(0, 11, 0.1, 1e4), (11, 24, 0.1, 100.0), (24, 33, 0.1, 900.0)]
    expected = np.concatenate([young / h * np.diff(u[:, lo:hi], axis=1) for lo, hi, h, young in nodes], axis=1)
    assert np.abs(stress - expected).max() < 1e-9 * np.abs(expected).max()


@pytest.mark.deep
def test_in_two_dimensions_and_with_cells_the_same_impact_gives_the_same_force():
    case = two_bars(steps=400)
    force = run(case).arrays["contact_force"]
    turned = copy.deepcopy(case)
    for body in turned["bodies"].values():
        body["bar"]["direction"] = [0.6, 0.8]
        body["at"] = [0.6 * body.get("at", 0.0), 0.8 * body.get("at", 0.0)]
    assert np.abs(run(turned).arrays["contact_force"] - force).max() < 1e-9 * force.max()
    cells = copy.deepcopy(case)
    for body in cells["bodies"].values():
        body["element"] = {"name": "spectral-bar", "order": 1}
    assert np.abs(run(cells).arrays["contact_force"] - force).max() < 1e-9 * force.max()


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


def test_plain_python_agrees():
    model = model_of(percuss.load(three_bars(steps=60)))
    plain, compiled = March(model, compiled=False).run(), March(model).run()
    for name in plain.record.energy.dtype.names[:6]:
        assert np.abs(plain.record.energy[name] - compiled.record.energy[name]).max() < 1e-15


# --------------------------------------------------------------------------------------------------- energy


def test_without_contact_the_energy_between_two_kicks_is_constant():
    """Lew et al. (2003): each subsystem is a symplectic leap-frog of its own step, without drift over long runs."""
    case = two_bars(courant=0.95, steps=20000)
    del case["contacts"]
    for body in case["bodies"].values():
        body |= {"fixed": ["right"], "velocity": 0.1}
    case["bodies"]["soft"]["at"] = 3.0
    result = run(case)
    energy = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-11
    assert result.summary["certificate"]["stable"] == "yes"
    internal, elastic = result.arrays["internal_work"], result.arrays["elastic_energy"]
    assert np.abs(internal - elastic).max() < 1e-11 * energy[0]


@pytest.mark.parametrize("element", ["bar", pytest.param("green-bar", marks=pytest.mark.deep)])
def test_the_ledger_closes_whatever_the_contact_does(element):
    case = three_bars("lagrange", on_unstable="warn", steps=4000)
    for body in case["bodies"].values():
        body["element"] = element
    result = run(case)
    assert result.summary["energy"]["ledger_error"] < 1e-11
    assert result.summary["certificate"]["energy"] == "not guaranteed"


def test_energy_errors_vanish_with_the_step():
    """The error of an asynchronous step in stored energy falls with the step, and contact makes it of first order."""
    errors = [run(two_bars(courant=c, end=0.05)).summary["energy"]["bodies_error"] for c in (0.4, 0.2, 0.1)]
    assert errors[1] < 0.6 * errors[0]
    assert errors[2] < 0.6 * errors[1]


# ------------------------------------------------------------------------------------------------- certificate


def period_matrix(case, stiffness):
    """Return the amplification of (u, dt v) over a period of 10 steps, from full matrices and the formula alone."""
    bars = dense.assemble(case)
    dt = case["time"]["courant"] * 0.1 / 1000.0
    size, mass = bars.x.size, np.diag(bars.M)
    own = np.where(np.arange(size) < bars.stop["stiff"], 1, 10)
    normal = np.zeros(size)
    normal[bars.node("stiff.right")], normal[bars.node("soft.left")] = -1.0, 1.0
    spring = stiffness * np.outer(normal, normal)
    whole = np.eye(2 * size)
    for n in range(10):
        acts = np.where(n % own == 0, own, 0)
        kick = -(dt**2) / mass[:, None] * (acts[:, None] * bars.K + spring)
        step = np.block([[np.eye(size) + kick, np.eye(size)], [kick, np.eye(size)]])
        whole = step @ whole
    return whole


@pytest.mark.parametrize("courant", [0.3, 0.7])
@pytest.mark.parametrize("beta", [0.5, 20.0, 200.0])
def test_the_amplification_is_that_of_full_matrices(courant, beta):
    case = two_bars({"name": "penalty", "beta_s": beta}, courant=courant, on_unstable="warn", steps=10)
    model = model_of(percuss.load(case))
    for closed in ((), (0,)):
        radius = np.abs(np.linalg.eigvals(period_matrix(case, len(closed) * beta * 1000.0))).max()
        found = examine(Motions(model), model.dt, closed)
        assert not found.doubt
        # two translations in full matrices are defective, and leave the root of round-off
        assert found.radius == pytest.approx(radius, rel=1e-6)


def test_one_mass_between_two_springs_has_the_resonance_of_the_text():
    """Fong, Darve, Lew (2008): two potentials of one mass, kicked with steps h and m h, resonate as m h omega nears pi.

    Two bars of one element, tied at one end each and fixed at the other, are such a mass. The step is unstable where
    the trace of its matrix of a period, of two rows, exceeds 2.
    """
    bar = {"bar": {"length": 1.0, "elements": 1}, "area": 1.0, "velocity": 0.1}
    case = {
        "percuss": 1,
        "bodies": {
            "stiff": {**bar, "material": {"young": 1600.0, "density": 0.01}, "fixed": ["left"]},
            "soft": {**bar, "at": 1.0, "material": SOFT, "fixed": ["right"]},
        },
        "contacts": {"tip": {"between": ["stiff.right", "soft.left"]}},
        "method": {"integrator": "asynchronous", "contact": "tied"},
        "time": {"steps": 1, "on_unstable": "warn"},
    }
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


@pytest.mark.parametrize("courant", [0.5, 0.7])
def test_resonance_of_tied_bars_is_found_and_real(courant):
    """Steps of unlike length resonate below the limit of each body; r-RESPA and AVI are known for it."""
    case = two_bars("tied", courant=courant, end=1.0, on_unstable="warn")
    judged = certificate(model_of(percuss.load(case)))
    assert judged["stable"] == "no"
    assert "resonate" in judged["cure"]
    result = run(case)
    energy = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
    assert energy.max() > 1e3 * energy[0]
    assert result.summary["energy"]["ledger_error"] < 1e-9  # the growth is in the accounts
    synchronous = copy.deepcopy(case)
    synchronous["method"]["integrator"] = "central-difference"
    energy = run(synchronous).arrays["kinetic_energy"] + run(synchronous).arrays["elastic_energy"]
    assert energy.max() < 1.1 * energy[0]


@pytest.mark.parametrize("contact", ["penalty", "lagrange", "tied"])
@pytest.mark.parametrize("courant", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_a_step_that_is_called_stable_does_not_grow(contact, courant):
    case = two_bars(contact, courant=courant, end=1.0, on_unstable="warn")
    result = run(case)
    energy = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
    if result.summary["certificate"]["stable"] == "yes":
        assert energy.max() < 1.3 * energy[0]
    assert result.summary["certificate"]["stable"] in {"yes", "no"}
    assert result.summary["certificate"]["dt_critical"] is None


def test_what_the_certificate_cannot_know_is_unknown_with_the_reason():
    def why(case):
        judged = certificate(model_of(percuss.load(case)))
        assert judged["stable"] == "unknown"
        return judged["why"]

    assert "has a kernel" in why(two_bars("hunt-crossley"))
    follows = two_bars()
    follows["loads"] = {"bed": {"spring-dashpot": {"stiffness": 5.0}, "on": "soft.right"}}
    assert "'bed'" in why(follows)
    odd = two_bars()
    odd["bodies"]["third"] = copy.deepcopy(odd["bodies"]["soft"]) | {
        "at": 90.0,
        "material": {"young": 1.83, "density": 0.01},
    }
    odd["bodies"]["fourth"] = copy.deepcopy(odd["bodies"]["soft"]) | {
        "at": 190.0,
        "material": {"young": 2.5, "density": 0.01},
    }
    assert math.lcm(1, 10, 73, 63) > 256
    assert "45990-th" in why(odd)
    assert "Krylov" in why(two_bars(soft=400))


def test_the_step_has_to_be_given():
    with pytest.raises(percuss.InputError, match="some step is known"):
        settled(percuss.load(two_bars(courant="auto")))


def test_refused_combinations():
    massless = two_bars("lagrange")
    massless["method"]["mass"] = "redistributed"
    with pytest.raises(percuss.RefusedPair, match="asynchronous gives no internal forces that act in every step"):
        model_of(percuss.load(massless))


# -------------------------------------------------------------------------------------------------- the cost


def test_internal_forces_of_a_body_that_is_not_due_are_not_evaluated():
    """Its elements are made to give nan between two kicks: nothing shows until the next one."""
    march = March(model_of(percuss.load(two_bars(steps=40))))
    march.compile()
    march.advance(march.stepper.amplitudes(0, 11), 0, 11)
    ((block, _, _),) = march.arrays.blocks
    values = block.element[0]
    values.flags.writeable = True
    values[10:] = np.nan
    march.advance(march.stepper.amplitudes(11, 9), 11, 9)
    assert np.isfinite(march.v).all()
    march.advance(march.stepper.amplitudes(20, 1), 20, 1)
    assert np.isfinite(march.v[:10]).all()
    assert np.isnan(march.v[11:]).all()
