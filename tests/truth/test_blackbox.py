"""The black box against the linear laws, closed forms and one another; and that a wrong one would be seen."""

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import assume, event, given
from test_stability import beside_another, wall

import long_bars
import percuss
from marks import deep
from percuss.certificate.black_box import BlackBox, ClosedStepStability, combinations, examine
from percuss.certificate.closed_laws import closed_laws
from percuss.certificate.closed_step import ClosedStep, Motions
from percuss.certificate.linear_laws import linear_laws
from percuss.certificate.verdict import certificate
from percuss.march.model_of_case import model_of
from percuss.studies.columns import RowSettings, column_by_name
from percuss.testing import Subject
from percuss.testing.demands.contacts import impact
from strategies import (
    CD,
    INVISCID,
    LAWS,
    LEAPFROG,
    PAIRS,
    PLAIN_PAIRS,
    REGISTRY,
    WU,
    bar,
    case_of,
    each_pair,
    hunek,
    rows,
    with_methods,
    with_pair,
)  # fmt: skip

LONG = 36  # 2**36 steps


def made(case):
    return model_of(percuss.load(case))


def is_covered(law):
    """Whether the linear laws tell of the closed contact of a law with central difference."""
    model = made(hunek(1, integrator=CD, contact=law))
    return not closed_laws(model, model.dt).doubts


# a tie acts whether its gap is open or closed: no run is one of its bodies by themselves
ROW_LAWS = [law for law in LAWS if law["name"] != "tied" and is_covered(law)]
# of a viscous scheme with contact the linear laws do not tell: the black box is asked
ROW_PAIRS = [pair for pair in PAIRS if pair[1] in ROW_LAWS and (pair[0] in INVISCID or pair[0] not in LEAPFROG)]


def drawn_model(case, pair):
    try:
        return made(with_pair(case, pair))
    except (percuss.InputError, percuss.RefusedPair) as error:  # an end between two walls, a refused pair
        event(type(error).__name__)
    assume(False)
    raise AssertionError


def quotient(motions, dt, contacts):
    """Return the amplification matrix without the motions that are no instability."""
    matrix = ClosedStep(motions, dt, contacts).matrix()
    idle = motions.idle(dt, contacts)
    idle = np.kron(np.eye(matrix.shape[0] // idle.shape[0]), idle)
    rest = np.eye(matrix.shape[0]) - idle @ idle.T
    return rest @ matrix @ rest


def after(matrix, squarings=LONG):
    """Return the size of a matrix squared that often; infinite beyond all bounds."""
    for _ in range(squarings):
        with np.errstate(all="ignore"):
            matrix = matrix @ matrix
        if not np.isfinite(matrix).all() or np.abs(matrix).max() > 1e100:
            return math.inf
    return float(np.abs(matrix).max())


# ---------------------------------------------------------------------------------------------- closed forms


@pytest.mark.parametrize("integrator", [WU, CD])
def test_unlike_bars_have_a_closed_form_too(integrator):
    case = beside_another(wall(3.0, 2.0, integrator))
    sides = [(3.0 * 2.0 * 80, math.sqrt(2.0 / 3.0) / 80), (60.0, 1.0 / 60)]  # EA/h and h/c
    stiffness, frequency = 3.0 * 60.0, 2.0 / max(h_over_c for _, h_over_c in sides)
    inertia = stiffness / (2.0 * frequency**2)
    found = linear_laws(made(case)).critical_step
    expected = long_bars.critical_step(sides, stiffness, inertia, predicted=integrator == WU)
    assert found == pytest.approx(expected, rel=1e-6)


# ----------------------------------------------------------------------------------------------- the limit is tight


def check_the_limit_is_tight(model, judge_class=linear_laws):
    """Demand that 1 % below the critical step nothing grows in any combination, and 1 % above it does in the worst."""
    judge = judge_class(model)
    critical = judge.critical_step
    motions = Motions(model)
    below, above = 0.99 * critical, 1.01 * critical
    for contacts in combinations(len(model.contact_points)):
        found = examine(motions, below, contacts)
        assert found.radius <= 1 + 1e-9
        assert found.stable
        assert after(quotient(motions, below, contacts)) < 1e9
    worst = judge.assess_step(above).worst
    assert not examine(motions, above, worst).stable
    assert after(quotient(motions, above, worst)) == math.inf
    return critical


@pytest.mark.slow
@each_pair(ROW_PAIRS, PLAIN_PAIRS)
@given(case=rows(moving=False, loads=False, bars=3))
def test_the_limit_is_tight(pair, case):
    model = drawn_model(case, pair)
    critical = check_the_limit_is_tight(model)
    event("lowered by contact" if critical < 0.999 * linear_laws(model).free else "that of the bodies")


@pytest.mark.parametrize("scale", [1.0, 1.2])
def test_a_step_may_be_stable_though_theta_is_above_one_at_every_step(scale):
    """Contact damps all of a bar of one element whose other end is held."""
    case = wall(1.0, 1.0, WU)
    case["bodies"] = {"b": bar(1.0, 1, material={"young": 1.0, "density": 1.274}, fixed=["right"])}
    case["method"]["contact"] = {"name": "penalty", "stiffness": "from-step", "scale": scale}
    found = certificate(made(case))
    assert found["theta"] == pytest.approx(scale)
    assert found["stable"] == "yes"
    assert found["dt_critical"] == pytest.approx(found["dt_critical_free"])


def test_growth_beyond_all_numbers_is_growth():
    assert not ClosedStepStability(1e200, None).stable
    assert not ClosedStepStability(np.inf, 2.0).stable


def test_closing_a_contact_may_raise_the_limit():
    law = {"name": "bipenalty", "beta_s": 10.0, "ratio": "matched"}
    case = wall(1.0, 1.0, WU)
    case["bodies"]["b"]["bar"]["elements"] = 5
    case["method"]["contact"] = law
    motions = Motions(made(case))
    assert examine(motions, 1.009 / 5, [0]).stable
    assert not examine(motions, 1.009 / 5, []).stable
    found = certificate(model_of(percuss.load(case, {"time.courant": 1.009})))
    assert found["stable"] == "no"
    assert found["worst"] == []


@pytest.mark.parametrize("theta", [1 - 1e-6, 1 + 1e-6])
def test_the_verdict_turns_where_theta_is_one(theta):
    """The radius leaves 1 by less than 1e-11 there: only theta tells."""
    courant = 0.1
    beta = theta / (2 * courant**2)
    model = made(wall(beta, math.inf, WU, courant))
    found = examine(Motions(model), model.dt, [0])
    assert abs(found.radius - 1) < 1e-6
    assert found.theta == pytest.approx(theta, abs=1e-10)
    assert found.stable == (theta < 1)
    assert (certificate(model)["stable"] == "yes") == (theta < 1)


@pytest.mark.deep
def test_a_large_model_is_judged_by_a_krylov_iteration():
    for law in ({"name": "penalty", "beta_s": 10.0}, {"name": "bipenalty", "beta_s": 10.0, "ratio": 5.0}):
        model = made(hunek(n=200, integrator=CD, contact=law))
        assert BlackBox(model).critical_step == pytest.approx(linear_laws(model).critical_step, rel=1e-4)
    found = certificate(made(hunek(n=200, integrator="noh-bathe", contact={"name": "lagrange"})))
    assert "Krylov" in found["why"]
    assert (found["stable"], found["dt_critical"]) == ("unknown", None)  # what was not found may be there


# ------------------------------------------------------------------------------------------------- what it cannot say


class Hardness(NamedTuple):
    stiffness: percuss.Floats
    power: float
    later: float


@dataclass(frozen=True)
class Kernel(percuss.ContactLaw):
    """Formula: lambda = beta_s k (-g)^power, times `later` from half of the run on."""

    name = "kernel"
    summary = "A spring"
    beta_s: float = 1.0
    power: float = 1.0
    later: float = 1.0

    def bind(self, points, dt):
        return Hardness(self.beta_s * points.stiffness, self.power, self.later)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            multiplier[p] = bound.stiffness[p] * max(-trial.gap[p], 0.0) ** bound.power
            if trial.time >= 0.5:
                multiplier[p] *= bound.later


def at_wall(**options):
    method = {"integrator": CD, "contact": {"name": "kernel", **options}}
    return percuss.load({**wall(1.0, 1.0), "method": method}, registry=with_methods(Kernel))


@pytest.mark.slow
def test_a_law_that_is_not_linear_is_unknown_and_says_so():
    found = certificate(model_of(at_wall(power=1.5)))
    assert found["stable"] == "unknown"
    assert "not linear" in found["why"]
    assert percuss.run(at_wall(power=1.5)).status == "done"


@pytest.mark.deep
def test_a_penalty_written_as_a_kernel_has_the_limit_of_the_penalty():
    expected = linear_laws(made(wall(3.0, math.inf))).critical_step
    assert certificate(model_of(at_wall(beta_s=3.0)))["dt_critical"] == pytest.approx(expected, rel=2e-6)


@pytest.mark.deep
def test_a_law_that_changes_with_time_is_not_certified_by_its_first_step():
    """Soft at first and far too stiff from half of the run on."""
    assert certificate(model_of(at_wall(beta_s=0.1)))["stable"] == "yes"
    changes = {"time": {"end": 1.0, "courant": 0.5}}
    found = certificate(model_of(at_wall(beta_s=0.1, later=1e4).with_overrides(changes)))
    assert (found["stable"], found["dt_critical"]) == ("unknown", None)
    assert "kernel changes with time" in found["why"]


# ---------------------------------------------------------------------------------------------------- courant 1


@each_pair([pair for pair in ROW_PAIRS if pair[0] in LEAPFROG])
def test_courant_number_one_runs_where_the_law_allows_it(pair):
    case = hunek(n=20, courant=1.0, integrator=pair[0], contact=pair[1])
    found = certificate(made(case))
    above = found["dt_critical"] < found["dt_critical_free"] * (1 - 1e-9)
    assert found["stable"] == ("no" if above else "marginal")
    if not above:
        assert percuss.run(percuss.load(case)).status == "done"


@dataclass(frozen=True)
class OnVelocity(percuss.ContactLaw):
    """Stops the gap rate while the gap is closed, and never pulls: in a second stage there is little left to stop."""

    name = "on-velocity"
    summary = "An impulse on the velocity"

    def bind(self, points, dt):
        return Nothing(np.zeros(1))

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            lacking = -trial.predicted_rate[p] if trial.gap[p] <= 0.0 else 0.0
            multiplier[p] = max(lacking / (trial.delassus[p] * trial.rate_response), 0.0)


class Nothing(NamedTuple):
    none: np.ndarray


@pytest.mark.deep
def test_a_step_that_is_linear_here_and_not_there_is_unknown_and_not_forbidden():
    subject = Subject.of(OnVelocity, REGISTRY)
    case = subject.placed(impact((0.7, 30.0, 0.5, 1)), {}, "noh-bathe")
    known = certificate(model_of(subject.load(case)))
    assert known["stable"] == "unknown"
    assert "the closed step is not linear at longer steps" in known["why"]
    assert subject.run(case).status == "done"


# ------------------------------------------------------------------------------- laws of several lines of force


class Yielding(NamedTuple):
    stiffness: percuss.Floats
    strength: percuss.Floats


@dataclass(frozen=True)
class Crushing(percuss.ContactLaw):
    """Formula: lambda = k <-g - c>, where c grows so that lambda is the strength at most."""

    name = "crushing"
    summary = "Spring that yields"
    state = 1

    beta_s: float = 0.25
    strength: float = 0.04

    def bind(self, points, dt):
        return Yielding(self.beta_s * points.stiffness, self.strength * points.weight)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            crushed = max(trial.before[p, 0], -trial.gap[p] - bound.strength[p] / bound.stiffness[p])
            trial.after[p, 0] = crushed
            multiplier[p] = bound.stiffness[p] * max(-trial.gap[p] - crushed, 0.0)


@pytest.mark.parametrize(
    ("courant", "turned"),
    [
        row if row in ((0.55, False), (0.01, True)) else deep(*row)
        for row in itertools.product((0.55, 0.3, 0.1, 0.01), (False, True))
    ],
)
def test_what_is_said_of_a_law_that_yields_hangs_neither_on_the_step_nor_on_the_orientation(courant, turned):
    line = {"direction": [3, -4]} if turned else {}
    body = bar(2.47, 4, [0.0, 0.0] if turned else 0.0, 0.77, {"young": 143.38, "density": 0.1}, 0.51, **line)
    stop = {"body": "a.right", "wall": [1.494, -1.992] if turned else 2.49}
    case = case_of({"a": body}, {"stop": stop}, {"steps": 10, "courant": courant})

    def said(beta_s):
        method = {"integrator": CD, "contact": {"name": "crushing", "beta_s": beta_s}}
        registry = with_methods(Crushing)
        return certificate(model_of(percuss.load({**case, "method": method}, registry=registry)))["stable"]

    assert said(0.25) == "unknown"
    critical = math.sqrt(2.0 / (1.0 + math.sqrt(1.0 + 50.0**2)))  # of a spring that does not yield, on a long bar
    assert said(50.0) == ("no" if courant > critical else "unknown")


@pytest.mark.parametrize("e", [0.9, deep(0.5)])
def test_a_spring_that_is_stiffer_while_unloading_is_unstable_above_the_critical_step_of_that(e):
    def said(law, courant):
        return certificate(made(hunek(10, courant, CD, law)))["stable"]

    stiffest = {"name": "penalty", "beta_s": 4.0 / e**2}
    critical = certificate(made(hunek(10, 0.1, CD, stiffest)))["courant_critical"]
    law = {"name": "walton-braun", "beta_s": 4.0, "restitution": e}
    assert critical < 0.9
    assert said(law, 1.001 * critical) == "no"
    assert said(law, 0.999 * critical) == "unknown"


def test_the_curve_of_a_force_is_no_growth():
    """At small overlaps its slope differs a little from one perturbation to the next, which is no growth."""
    law = {"name": "softened-penalty", "clearance": 0.003, "pressure": 0.02, "epsilon_s": 60.0}
    case = hunek(6, 0.55, "velocity-verlet", law)
    case["loads"] = {"drive": {"prescribed-velocity": 0.1, "on": "short.left"}}
    assert certificate(made(case))["stable"] == "unknown"
    critical = math.sqrt(2.0 / (1.0 + math.sqrt(5.0)))  # of a penalty as stiff between equal bars without end
    case["time"]["courant"] = 1.03 * critical
    assert certificate(made(case))["stable"] == "no"


@pytest.mark.parametrize("law", [{"name": "damped-penalty"}, {"name": "energy-conserving-penalty"}, {"name": "uzawa"}])
def test_a_kernel_of_one_line_is_certain(law):
    assert certificate(made(hunek(10, 0.5, CD, law)))["stable"] == "yes"


def test_a_run_searches_no_critical_step_that_only_the_black_box_can_tell(monkeypatch):
    """`check` does, and `courant: auto` needs it."""
    law = {"name": "energy-conserving-penalty", "beta_s": 0.5}
    case, auto = (percuss.load(hunek(10, courant, CD, law)) for courant in (0.4, "auto"))
    checked, chosen = percuss.check(case).data["certificate"], percuss.run(auto).summary["certificate"]
    assert checked["by"] == chosen["by"] == "black-box"
    assert (checked["dt_critical_why"], chosen["dt_critical_why"]) == ("", "")
    assert chosen["dt_critical"] == pytest.approx(checked["dt_critical"], rel=2e-6)
    monkeypatch.setattr(BlackBox, "critical_step", property(lambda _: pytest.fail("it was searched")))
    found = percuss.run(case).summary["certificate"]
    assert (found["stable"], found["dt_critical"]) == ("yes", None)
    assert "`percuss check`" in found["dt_critical_why"]
    with pytest.raises(percuss.RunError, match="lower the step: `percuss check` searches how far"):
        percuss.run(case, {"time.courant": 1.2})


@pytest.mark.parametrize(("measured", "searched"), [("courant_critical", True), ("theta", False)])
def test_a_study_searches_the_critical_step_where_it_measures_it(measured, searched):
    rows = RowSettings((column_by_name(f"certificate.{measured}"),), nudge=False, histories=0, repeats=1)
    case = percuss.load(hunek(10, 0.4, CD, {"name": "energy-conserving-penalty", "beta_s": 0.5}))
    found = rows.run(case).summary["certificate"]
    assert (found["dt_critical"] is not None) == searched


@pytest.mark.deep
def test_a_krylov_iteration_gives_the_same_number_again():
    """SciPy draws vectors of its own; without a seed the sixth digit of the critical step is left to chance."""
    model = made(hunek(n=100, integrator=CD, contact={"name": "walton-braun", "beta_s": 30.0}))
    first, again = (BlackBox(model).critical_step for _ in range(2))
    assert first == again
