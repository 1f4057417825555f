"""Contact laws with state variables: exact restitution of rigid bodies, and when the variables are carried over."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import brentq

import percuss
from blocks import SEAM, block, loaded
from marks import deep
from percuss.certificate.closed_step import ClosedStep, Motions
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from strategies import bar, case_of, hunek, turned, with_methods

SOFT = 1e-3  # EA/h of the contact over that of the only element of a bar, which therefore moves as a rigid body


def rigid_bounce(law, **options):
    """Return the result of a bar of one element that bounces off a wall with a soft law."""
    law = {"name": law, "beta_s": SOFT, **options}
    bars, contacts = {"a": bar(1.0, 1, velocity=1.0)}, {"wall": {"body": "a.right", "wall": 1.0}}
    case = case_of(bars, contacts, {"end": 1.3, "courant": 0.02}, None, "central-difference", law)
    return percuss.run(percuss.load(case))


def restitution(result):
    momentum = result.summary["momentum"]
    return -momentum["final"][0] / momentum["initial"][0]


@pytest.mark.parametrize("e", [0.9, 0.5])
def test_rigid_bodies_leave_a_walton_braun_spring_at_e_times_their_speed(e):
    result = rigid_bounce("walton-braun", restitution=e)
    assert restitution(result) == pytest.approx(e, abs=3e-4)
    energy = result.summary["energy"]
    lost = result.arrays["contact_dissipation"][-1]
    assert lost == pytest.approx((1.0 - e**2) * energy["initial"], rel=1e-3)
    assert lost == pytest.approx(-energy["contact_work"], rel=1e-5)
    assert energy["ledger_error"] < 1e-13


@pytest.mark.parametrize("e", [0.9, 0.5])
def test_rigid_bodies_leave_a_hunt_crossley_spring_as_its_equation_of_motion_says(e):
    """The equation of motion m x'' = -k x^n (1 + a x') is separable: its integral holds for any k, n and m."""
    a = 1.5 * (1.0 - e)
    left = a - math.log1p(a)
    exact = brentq(lambda v: left + a * v + math.log1p(-a * v), 1e-9, min(1.0, 1.0 / a - 1e-9))
    result = rigid_bounce("hunt-crossley", restitution=e)
    assert restitution(result) == pytest.approx(exact, abs=3e-4)
    assert result.arrays["contact_dissipation"][-1] == pytest.approx(
        -result.summary["energy"]["contact_work"], rel=2e-4
    )
    assert abs(exact - e) < 1.1 * (1.0 - e) ** 2  # the paper: e to first order in 1 - e


class Nothing(NamedTuple):
    scale: percuss.Floats


@dataclass(frozen=True)
class Counting(percuss.ContactLaw):
    """Formula: lambda = 0; counts the steps, and the calls of the second point."""

    name = "counting"
    summary = "Counts the steps"
    state = 2
    uses_coupling = True

    def bind(self, points, dt):
        return Nothing(np.ones(len(points.names)))

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            multiplier[p] = 0.0
            trial.after[p, 0] = trial.before[p, 0] + bound.scale[p]
            # The second variable is written in the first step alone, and keeps its value.
            if trial.before[p, 0] == 0.0:
                trial.after[p, 1] = 7.0 + p


COUNTING = with_methods(Counting)


def counted(integrator, **changes):
    """Return a run in plain Python of a law that counts, and its state variables, (records, contacts, 2)."""
    case = hunek(10)
    case["contacts"]["wall"] = {"body": "short.left", "wall": -1.0}
    case |= {"time": {"steps": 20, "courant": 0.5}, "method": {"integrator": integrator, "contact": "counting"}}
    march = March(model_of(percuss.load(case | changes, registry=COUNTING)), compiled=False)
    march.keep_beginning()
    return march, march.run(None, marginal=False).histories["contact_state"].reshape(-1, 2, 2)


LET_GO = {"drive": {"prescribed-velocity": 0.1, "on": "long.left", "until": 0.01}}


@pytest.mark.parametrize(
    ("integrator", "loads"), [("central-difference", {}), ("noh-bathe", {}), ("central-difference", LET_GO)]
)
def test_state_variables_are_carried_over_once_a_step(integrator, loads):
    """A multi-stage scheme calls the kernel several times a step, and before the first step; drives may end.

    A march that begins again begins with state variables of zero.
    """
    march, states = counted(integrator, loads=loads)
    again = march.again().run(None, marginal=False).histories["contact_state"].reshape(-1, 2, 2)
    for found in (states, again):
        assert found[:, :, 0].tolist() == [[n, n] for n in range(1, 22)]
        assert (found[:, :, 1] == [7.0, 8.0]).all()


def test_an_examined_step_leaves_state_variables_alone():
    model = model_of(percuss.load(hunek(5, contact="walton-braun", integrator="central-difference")))
    step = ClosedStep(Motions(model), model.dt, [0])
    assert step.linear()
    assert not step.march.arrays.variables.before.any()
    assert step.march.arrays.variables.after.any()


COHESIVE = {"name": "cohesive", "strength": 0.04, "length": 0.2}


@pytest.mark.parametrize(("law", "dim"), [deep("walton-braun", 2), deep("walton-braun", 3), (COHESIVE, 2)], ids=str)
def test_the_state_of_surfaces_is_that_of_their_points_saved_read_and_drawn(law, dim, tmp_path):
    shape = {"elements": [2, 2, 1][:dim], "size": [1.0, 0.5, 0.5][:dim]}
    bodies = {"left": block(0.0, 0.1, **shape), "right": block(1.0, -0.1, **shape)}
    method = {"integrator": "central-difference", "contact": law, "pairing": "mortar"}
    result = percuss.run(loaded(bodies, SEAM, method, {"steps": 4, "courant": 0.4}, record={"fields": 2}))
    result.save(tmp_path / "a.nc")
    opened = percuss.open_result(tmp_path / "a.nc")
    state = opened.histories["contact_state"]
    assert state.dims == ("time", "point", "state_variable")
    assert state["point_contact"].values.tolist() == opened.field_arrays["point_contact"]
    assert np.array_equal(state, result.arrays["contact_state"], equal_nan=True)
    opened.plot(tmp_path / "a.png")


# ------------------------------------------------------------------------------------------------------- materials

YOUNG, DENSITY, YIELD = 100.0, 0.01, 0.02
PLASTIC = {"name": "bilinear-plastic", "young": YOUNG, "density": DENSITY, "yield_stress": YIELD}


def struck_wall(material, velocity, elements, direction=(1,), *, compiled=True):
    """Return a result of a plastic bar that strikes a wall, before the first wave comes back from its other end."""
    body = bar(10.0, elements, velocity=velocity, material=material, area=2.0)
    contacts, time = {"wall": {"body": "a.right", "wall": 10.0}}, {"end": 0.09, "courant": 0.8}
    case = case_of({"a": body}, contacts, time, None, "central-difference", "lagrange")
    return percuss.run(percuss.load(turned(case, direction)), compiled=compiled)


@pytest.mark.deep
def test_a_plastic_bar_presses_a_wall_with_the_force_of_its_two_waves():
    """The elastic wave carries the yield stress, and the slower plastic wave the rest of the change of velocity.

    Both are simple waves, as the material is linear on either side of the yield stress: ``Z_e = rho c_e`` and
    ``Z_p = rho c_p`` are their impedances (von Karman and Duwez 1950, doi 10.1063/1.1699544).
    """
    c_e = math.sqrt(YOUNG / DENSITY)
    velocity, tangent = 0.1, 0.25
    c_p = math.sqrt(tangent) * c_e
    elastic_change = YIELD / (DENSITY * c_e)
    exact = 2.0 * (YIELD + DENSITY * c_p * (velocity - elastic_change))
    assert exact == pytest.approx(0.12)
    errors = []
    for elements in (100, 400):
        result = struck_wall({**PLASTIC, "tangent": tangent}, velocity, elements)
        force, time = result.arrays["contact_force"][:, 0], result.arrays["time"]
        errors.append(abs(force[(time > 0.02) & (time < 0.09)].mean() / exact - 1.0))
    assert errors[1] < 0.4 * errors[0] < 4e-3
    energy = result.summary["energy"]
    assert energy["ledger_error"] < 1e-13
    assert energy["bodies_error"] < 2e-3
    # Behind the plastic wave the plastic strain p is that of its stress; with kinematic hardening Y p is dissipated.
    stress = exact / 2.0
    hardening = YOUNG * tangent / (1.0 - tangent)
    strain = (stress - YIELD) / hardening
    dissipated = YIELD * strain * 2.0 * c_p * time[-1]
    assert energy["dissipated"] == pytest.approx(dissipated, rel=0.02)


@pytest.mark.parametrize("compiled", [False, deep(True)], ids=["plain", "compiled"])
def test_a_plastic_bar_turned_in_the_plane_does_the_same(compiled):
    straight, plane = (
        struck_wall(PLASTIC, 0.1, 40, direction, compiled=compiled).arrays for direction in ((1,), (0.6, 0.8))
    )
    for name in ("contact_force", "internal_work", "dissipated_energy", "elastic_energy"):
        assert plane[name] == pytest.approx(straight[name], abs=1e-12), name


def test_the_stress_field_of_a_plastic_bar_is_that_of_its_history():
    case = hunek(10, integrator="central-difference", contact="lagrange", end=0.1)
    case["bodies"]["short"]["material"] = {**PLASTIC, "tangent": 0.0}
    case["record"] |= {"fields": 40}
    fields = percuss.run(percuss.load(case), compiled=False).fields
    short = fields["stress"][:, np.array(fields["body"]) == "short"].to_numpy()
    assert np.abs(short).max() == pytest.approx(YIELD, rel=1e-9)  # without hardening there is no more
    assert (short == -YIELD).any()
