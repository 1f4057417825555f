"""The certificate before a run: critical steps against published and closed forms, verdicts, cures."""

import math
import re

import numpy as np
import pytest

import long_bars
import percuss
import places
from percuss.certificate.assessment import largest_step, largest_step_below
from percuss.certificate.black_box import examine
from percuss.certificate.closed_step import Motions
from percuss.certificate.verdict import certificate, verdict_alone
from percuss.march.model_of_case import model_of
from strategies import UNIT, bar, case_of, hunek

HUNEK = places.CASES / "hunek.yaml"
N = 60

# critical Courant numbers of a bar of 60 elements on a rigid wall, central difference (Kopacka et al. 2018, Fig. 1 of
# Kolman et al.); beta_s to the number, ratio by row
TABLE = {
    math.inf: {0.25: 0.9924, 1.0: 0.9102, 10.0: 0.4254, 100.0: 0.1407},
    5.0: {0.25: 0.9951, 1.0: 0.9398, 10.0: 0.6, 100.0: 0.4666},
    2.0: {0.25: 0.9981, 1.0: 0.9744, 2.0: 0.9306, 10.0: 0.7892, 100.0: 0.7169},
    1.5: {0.25: 0.9991, 1.0: 0.988, 10.0: 0.874, 100.0: 0.8234},
    1.0: {0.25: 1.0, 1.0: 1.0, 10.0: 1.0, 100.0: 1.0},
}
ROWS = [(ratio, beta, critical) for ratio, row in TABLE.items() for beta, critical in row.items()]


def wall(beta, ratio, integrator="central-difference", courant=0.5):
    law = {"name": "bipenalty", "beta_s": beta, "ratio": ratio}
    bars, contacts = {"b": bar(1.0, N, material=UNIT)}, {"w": {"body": "b.left", "wall": 0.0}}
    return case_of(bars, contacts, {"steps": 1, "courant": courant}, None, integrator, law)


def beside_another(case):
    """Return a case of `wall` with the wall replaced by an unlike, finer bar."""
    other = bar(1.0, 80, -1.0, material={"young": 3.0, "density": 2.0}, area=2.0)
    return case | {"bodies": case["bodies"] | {"c": other}, "contacts": {"w": {"between": ["c.right", "b.left"]}}}


def certified(case):
    return certificate(model_of(percuss.load(case)))


@pytest.mark.parametrize(("ratio", "beta", "critical"), ROWS)
def test_the_published_critical_courant_numbers(ratio, beta, critical):
    """By the certificate, by the black box, and of bars without end in closed form."""
    model = model_of(percuss.load(wall(beta, ratio)))
    found = certificate(model)["dt_critical"] * N
    assert round(found, 4) == critical
    motions = Motions(model)
    below = critical - (1e-9 if critical == 1 else 0.5e-4)
    assert examine(motions, below / N, [0]).stable
    assert not examine(motions, (critical + 0.5e-4) / N, [0]).stable
    endless = long_bars.critical_step([(1.0, 1.0)], beta, beta / (4.0 * ratio))
    assert round(endless, 4) == critical
    if math.isinf(ratio):  # the penalty method
        expected = math.sqrt(2 / (1 + math.sqrt(1 + beta**2)))
        assert endless == pytest.approx(expected, rel=1e-9)
        assert found == pytest.approx(expected, rel=1e-3 if beta < 1.0 else 1e-9)  # 60 elements are not quite endless


@pytest.mark.parametrize(("beta", "ratio"), [(0.25, 1.0), (10.0, 1.0), (10.0, 0.5), (100.0, 5.0)])
def test_theta_of_wu_is_the_closed_form(beta, ratio):
    courant = 0.4
    found = certified(wall(beta, ratio, "wu-predictor-corrector", courant))
    theta = 2 * courant**2 * beta / (1 + beta / (2 * ratio))
    assert found["theta"] == pytest.approx(theta, rel=1e-12)
    critical = min(1.0, math.sqrt((1 + beta / (2 * ratio)) / (2 * beta)))
    assert found["dt_critical"] * N == pytest.approx(critical, rel=1e-8)


@pytest.mark.parametrize(
    ("changes", "stable", "energy"),
    [
        ({}, "yes", "never grows"),
        ({"method.contact": "lagrange", "time.courant": 1}, "marginal", "never grows"),
        (
            {"method.contact": "penalty", "method.integrator": "central-difference"},
            "yes",
            "conserved between switchings",
        ),
        ({"method.integrator": "central-difference"}, "yes", "not guaranteed"),
        ({"method.contact.beta_s": 10, "time.courant": 0.9}, "no", "not guaranteed"),
        ({"method.contact.beta_s": 1e6, "method.contact.ratio": "matched", "time.courant": 0.9}, "yes", "never grows"),
        ({"time.courant": 1.01}, "no", "not guaranteed"),
        ({"method.contact": "tied"}, "yes", "not guaranteed"),
    ],
)
def test_verdicts(changes, stable, energy):
    found = certificate(model_of(percuss.load(HUNEK, changes)))
    assert (found["stable"], found["energy"]) == (stable, energy)
    assert found["why"]
    assert found["energy_why"]
    assert bool(found["cure"]) == (stable == "no")


@pytest.mark.parametrize("integrator", ["central-difference", "wu-predictor-corrector"])
@pytest.mark.parametrize("law", ["penalty", "bipenalty"])
def test_a_cure_cures(integrator, law):
    options = {"name": law, "beta_s": 50.0, **({"ratio": 3.0} if law == "bipenalty" else {})}
    changes = {"method.integrator": integrator, "method.contact": options, "time.courant": 0.9}
    case = percuss.load(HUNEK, changes)
    found = certificate(model_of(case))
    assert found["stable"] == "no"
    assert found["worst"] == ["tip"]
    for cure in found["cure"].split(", or "):
        if cure.startswith("lower"):
            option, value = "time", {"end": 0.8, "step": float(cure.split(" to ")[1].split(" ")[0])}
        else:
            words = cure.split()
            option, value = f"method.contact.{words[1]}", float(words[-1])
        assert certificate(model_of(case.with_overrides({option: value})))["stable"] in {"yes", "marginal"}


def test_what_no_step_cures_is_told():
    law = {"name": "penalty", "stiffness": "from-step", "scale": 3.0}
    found = certificate(model_of(percuss.load(HUNEK, {"method.contact": law})))
    assert found["stable"] == "no"
    assert found["cure"].startswith("set scale of penalty to at most 0.9999")
    cured = {**law, "scale": float(found["cure"].split()[-1])}
    assert certificate(model_of(percuss.load(HUNEK, {"method.contact": cured})))["stable"] == "yes"


@pytest.mark.parametrize("limit", [0.7, 1.0, 3.3, 1e-7])
@pytest.mark.parametrize(
    ("excess", "most_trials"),
    [
        (lambda x: math.copysign(1.0, x), 80),
        (math.tanh, 30),
        (lambda x: 1.0 if x > 0.1 else 10.0 * x if x > 0.0 else max(x, -1.0), 40),
    ],
    ids=["yes or no", "smooth", "with a corner"],
)
def test_the_search_ends_at_the_limit_on_its_stable_side(limit, excess, most_trials):
    trials = []

    def tried(dt):
        trials.append(dt)
        return excess(dt / limit - 1.0)

    found = largest_step(tried, 1.0)
    assert limit * (1.0 - 1e-11) <= found <= limit
    assert found in trials
    assert len(trials) <= most_trials


def test_a_search_below_the_free_step_never_ends_above_it():
    assert largest_step_below(lambda dt: 1.0 if 0.9 < dt < 1.0 else -1.0, 1.0) == pytest.approx(0.9, rel=1e-10)


def test_a_search_without_a_limit_says_so():
    assert largest_step(lambda dt: 1.0, 1.0) == 0.0
    assert largest_step(lambda dt: -1.0, 1.0) == math.inf


def test_bars_with_a_single_free_node_have_a_critical_step():
    """Two bars of one element, each held at its far end, press against one another."""
    case = hunek(1, integrator="central-difference", contact={"name": "penalty", "beta_s": 0.5}, end=0.1)
    case["bodies"]["long"]["bar"]["elements"] = 1
    case["bodies"]["short"] |= {"fixed": ["left"], "velocity": 0.0}
    model = model_of(percuss.load(case))
    found = certificate(model)
    # one node on each side: 4/dt^2 M - K - beta_s EA/h [[1, -1], [-1, 1]] is singular at the critical step
    stiffness = [float(body.stiffness[0]) for body in model.bodies.values()]
    mass = [float(body.mass[0]) for body in model.bodies.values()]
    penalty = 0.5 * min(stiffness)
    matrix = np.diag(stiffness) + penalty * np.array([[1.0, -1.0], [-1.0, 1.0]])
    highest = np.linalg.eigvals(matrix / np.array(mass)[:, None]).real.max()
    assert found["dt_critical"] == pytest.approx(2.0 / math.sqrt(highest), rel=1e-10)
    assert found["dt_critical_free"] == pytest.approx(
        2.0 / math.sqrt(max(k / m for k, m in zip(stiffness, mass, strict=True))), rel=1e-12
    )


@pytest.mark.parametrize("share", [0.9, 1.0, 1.1])
@pytest.mark.parametrize("law", [{"name": "penalty", "beta_s": 3.0}, {"name": "penalty", "beta_s": 0.1}])
def test_a_run_finds_the_verdict_of_a_check_without_a_search(law, share):
    """The law limits the step, or does not; at the critical step itself the run is marginal."""
    methods = {"method.integrator": "central-difference", "method.contact": law}
    limit = certificate(model_of(percuss.load(HUNEK, methods)))["dt_critical"]
    model = model_of(percuss.load(HUNEK, {**methods, "time": {"step": share * limit, "end": 1e-3}}))
    known, found = certificate(model), verdict_alone(model)
    assert found["stable"] == known["stable"] == {0.9: "yes", 1.0: "marginal", 1.1: "no"}[share]
    assert found["cure"] == known["cure"]
    assert (found["dt_critical"] is None) == (share < 1.0)


@pytest.mark.deep
def test_a_critical_step_that_was_not_searched_is_not_said_to_be_none():
    changes = {"method.integrator": "central-difference", "time.courant": 0.9}
    law = {"name": "walton-braun", "beta_s": 30.0}
    model = model_of(percuss.load(HUNEK, {**changes, "method.contact": law}))
    found = verdict_alone(model)
    assert (found["stable"], found["dt_critical"]) == ("no", None)
    assert found["cure"].startswith("lower the step: `percuss check` searches how far")
    (lowered,) = re.findall("^lower the step to ([0-9.e-]+) ", certificate(model)["cure"])
    stiffest = {"name": "penalty", "beta_s": 30.0 / 0.9**2}  # as it unloads
    limit = certificate(model_of(percuss.load(HUNEK, {**changes, "method.contact": stiffest})))["dt_critical"]
    assert float(lowered) == pytest.approx(limit, rel=1e-5)
