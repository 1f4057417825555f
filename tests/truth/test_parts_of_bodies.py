"""Materials and elements that are not linear against exact motions; scaled masses against eigenvalues.

All runs are short and made in plain Python, because to compile their kernels would take longer.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import quad
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import ellipk

import percuss
from percuss import Lumping
from percuss_methods.elements.green_bar import GreenBarElement
from percuss_methods.masses.scaled import Scaled
from percuss_methods.materials.ramberg_osgood import RambergOsgood
from strategies import STEEL, bar, case_of, hunek

YOUNG, DENSITY, SCALE = 100.0, 0.01, 0.05
CURVED = {"name": "ramberg-osgood", **STEEL, "yield_stress": SCALE}


def ran(case):
    return percuss.run(percuss.load({"method": {"integrator": "central-difference"}} | case), compiled=False)


# -------------------------------------------------------------------------------------------------- simple waves


def strain_of(stress, alpha=3 / 7, exponent=5.0):
    """Return the strain of Ramberg and Osgood at a stress."""
    return stress / YOUNG * (1.0 + alpha * (abs(stress) / SCALE) ** (exponent - 1.0))


def stress_of(strain):
    """Return the stress of Ramberg and Osgood at a strain, found by bisection."""
    return brentq(lambda stress: strain_of(stress) - strain, -YOUNG, YOUNG, xtol=1e-16, rtol=1e-15)


def tangent_of(strain):
    """Return the slope of the curve of Ramberg and Osgood at a strain."""
    return YOUNG / (1.0 + 3 / 7 * 5.0 * (abs(stress_of(strain)) / SCALE) ** 4)


def green_stress(strain):
    """Return the second Piola-Kirchhoff stress of an elastic bar whose length has changed by a share `strain`."""
    return 0.5 * YOUNG * ((1.0 + strain) ** 2 - 1.0)


def green_tangent(strain):
    """Return the slope of the axial force over the area, ``P = E lambda (lambda^2 - 1) / 2``."""
    return 0.5 * YOUNG * (3.0 * (1.0 + strain) ** 2 - 1.0)


@pytest.mark.deep
@pytest.mark.parametrize(
    ("body", "fastest", "stress", "tangent"),
    [
        ({"material": CURVED}, 0.11, stress_of, tangent_of),
        ({"material": STEEL, "element": "green-bar"}, 17.0, green_stress, green_tangent),
    ],
    ids=["ramberg-osgood", "green-bar"],
)
def test_a_simple_wave_travels_at_the_speed_of_the_tangent(body, fastest, stress, tangent):
    """The end of a bar is pushed with a velocity that grows linearly in time up to `fastest`.

    A strain leaves the end when ``v = integral of c d(strain)`` is reached there, and runs at its own speed
    ``c = sqrt(tangent / density)`` through the bar before the motion. That is the solution of von Karman and Duwez
    (1950), doi 10.1063/1.1699544, for a ramp instead of a jump. Both bodies become softer, so that the wave
    spreads out and no shock forms.
    """
    rise, end, length = 0.04, 0.09, 10.0

    def speed(strain):
        return math.sqrt(tangent(strain) / DENSITY)

    def velocity(strain):
        return -quad(speed, 0.0, strain)[0]

    largest = brentq(lambda strain: velocity(strain) - fastest, -0.4, 0.0)
    assert speed(largest) < 0.7 * speed(0.0)
    strains = np.linspace(largest, 0.0, 100)
    speeds = np.array([speed(strain) for strain in strains])
    starts = rise * np.array([velocity(strain) for strain in strains]) / fastest
    stresses = np.array([stress(strain) for strain in strains])
    errors = []
    for elements in (50, 100):
        push = {"ramp": {"value": fastest, "duration": rise}, "on": "a.left", "as": "velocity"}
        bars = {"a": bar(length, elements, area=2.0) | body}
        case = case_of(bars, {}, {"end": end, "courant": 0.9}, {"push": push}) | {"record": {"fields": 1000}}
        result = ran(case)
        field = result.fields["stress"]
        places = speeds * (float(field["time"][-1]) - starts)
        assert (np.diff(places) > 0.0).all()
        exact = np.interp((np.arange(elements) + 0.5) * length / elements, places, stresses)
        errors.append(np.abs(field.to_numpy()[-1] - exact).mean() / np.abs(exact).max())
    assert errors[1] < 0.6 * errors[0]
    assert errors[1] < 2e-3
    assert result.summary["energy"]["ledger_error"] < 1e-13
    assert result.summary["energy"]["bodies_error"] < 1e-3


# ------------------------------------------------------------------------------------------ Ramberg and Osgood


@pytest.mark.parametrize(("alpha", "exponent"), [(3 / 7, 5.0), (0.5, 1.5), (1e-3, 40.0), (50.0, 3.0), (1.0, 1.001)])
def test_the_stress_of_ramberg_and_osgood_solves_their_equation(alpha, exponent):
    material = RambergOsgood(young=YOUNG, density=DENSITY, yield_stress=SCALE, alpha=alpha, exponent=exponent)
    parameters = np.array(material.parameters())
    for size in np.geomspace(1e-12, 1e3, 31):
        for strain in (size, -size):
            stress = material.stress(parameters, strain)
            assert strain_of(stress, alpha, exponent) == pytest.approx(strain, rel=1e-15 * (2.0 + exponent))
    assert material.stress(parameters, 0.0) == 0.0


def test_the_energy_of_ramberg_and_osgood_is_the_integral_of_the_stress():
    material = RambergOsgood(young=YOUNG, density=DENSITY, yield_stress=SCALE)
    parameters = np.array(material.parameters())
    for strain in (1e-4, -6e-4, 2e-3):
        expected, _ = quad(stress_of, 0.0, strain, epsabs=1e-16, epsrel=1e-12)
        assert material.energy_density(parameters, strain, strain) == pytest.approx(expected, rel=1e-11)


# ------------------------------------------------------------------------------------------------ Green's strain


def test_a_bar_that_swings_through_large_angles_is_a_pendulum():
    """A point mass on a bar is released from the horizontal: its period is ``T = 4 sqrt(L / g) K(1/2)``.

    It passes below the support twice a period. The bar carries up to three times the weight of the mass, and is that
    much longer: a share of 3e-5 here.
    """
    length, gravity = 2.0, 0.1
    period = 4.0 * math.sqrt(length / gravity) * ellipk(0.5)
    pendulum = bar(length, 1, area=2.0, fixed=["left"], direction=[1.0, 0.0]) | {"element": "green-bar"}
    case = case_of({"a": pendulum}, {}, {"end": 0.8 * period, "courant": 0.9}, {"weight": {"gravity": [0.0, -gravity]}})
    result = ran(case)
    place = np.array([length, 0.0]) + result.arrays["displacement"][:, 1]
    time = result.arrays["time"]
    assert np.linalg.norm(place, axis=1) == pytest.approx(length, rel=3e-5)
    assert place[:, 0].min() == pytest.approx(-length, rel=1e-4)
    across = place[:, 0]
    before = np.flatnonzero(np.diff(np.sign(across)))
    passes = time[before] - across[before] * np.diff(time)[before] / np.diff(across)[before]
    assert passes == pytest.approx([0.25 * period, 0.75 * period], rel=2e-5)
    assert result.summary["energy"]["ledger_error"] < 1e-13
    # of order dt^2: the energy between two displacements leaves out ``S |change of d|^2 / 4``, S the stress
    assert result.summary["energy"]["bodies_error"] < 2e-5


# --------------------------------------------------------------------------------------------------- scaled masses


@settings(max_examples=50, deadline=None, derandomize=True)
@given(arrays(float, st.integers(1, 12), elements=st.floats(0.05, 2.0)), st.floats(0.01, 1.0))
def test_scaled_masses_allow_the_step_that_they_promise_and_add_no_more_than_that(lengths, least_step):
    """Of every element alone the critical step is 2 over its frequency: that of the 2 x 2 problem, and of the chain."""
    area, speed = 2.0, math.sqrt(YOUNG / DENSITY)
    promised = least_step * lengths.max() / speed
    material_mass = DENSITY * area * lengths
    scaled = Scaled(least_step=least_step)
    mass = scaled.nodal(material_mass, Lumping.of_line(lengths.size))
    shape = np.array([[1.0, -1.0], [-1.0, 1.0]])
    stiffness, needed = np.zeros((mass.size, mass.size)), np.zeros(mass.size)
    for i, length in enumerate(lengths):
        own = YOUNG * area / length * shape
        stiffness[i : i + 2, i : i + 2] += own
        step = 2.0 / math.sqrt(eigh(own, 0.5 * material_mass[i] * np.eye(2), eigvals_only=True)[-1])
        needed[i : i + 2] += 0.5 * material_mass[i] * max(1.0, promised / step) ** 2
    assert mass == pytest.approx(needed, rel=1e-12)
    assert 2.0 / math.sqrt(eigh(stiffness, np.diag(mass), eigvals_only=True)[-1]) >= promised * (1.0 - 1e-9)


def test_a_rigid_rotation_leaves_a_green_bar_without_force():
    from percuss.mesh.element_probe import ElementProbe
    from percuss.testing.demands.bodies import line

    material = percuss.load(hunek(2)).bodies["short"].material
    mesh = line(1, 2)
    probe = ElementProbe(GreenBarElement(), material, percuss.BodyMesh(mesh, 1.3))
    for angle in (1e-3, 0.5, 2.0, math.pi):
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        moved = mesh.nodes @ turn.T + np.array([0.3, -0.1])
        assert np.abs(probe.force(0, (moved - mesh.nodes).ravel())).max() < 1e-13
        axis = turn @ mesh.direction
        stretched = (moved + np.outer([0.0, 0.5 * mesh.lengths[0]], axis) - mesh.nodes).ravel()
        expected = 1.3 * YOUNG * 1.5 * (1.5**2 - 1.0) / 2.0 * axis
        assert probe.force(0, stretched) == pytest.approx(np.concatenate([expected, -expected]), abs=1e-11)


def test_a_bar_of_scaled_mass_takes_a_longer_step_and_has_the_momentum_of_its_added_mass():
    steps = []
    for mass in ("lumped", {"name": "scaled", "least_step": 0.5}):
        bars = {"a": bar(1.0, 20, velocity=0.1, area=2.0, grading=0.1)}
        case = case_of(bars, {"wall": {"body": "a.right", "wall": 1.0}}, {"end": 0.06, "courant": "auto"})
        case["method"] = {"integrator": "central-difference", "contact": "lagrange", "mass": mass}
        result = ran(case)
        summary = result.summary
        assert summary["certificate"]["stable"] == "yes"
        assert summary["energy"]["ledger_error"] < 1e-13
        assert summary["energy_growth"]["kept"] is not False
        steps.append(summary["dt"])
        lengths = percuss.load(case).bodies["a"].shape.mesh(np.zeros(1), 1).lengths
        allowed = 0.5 * lengths.max()
        heavier = np.where(lengths < allowed, (allowed / lengths) ** 2, 1.0) if isinstance(mass, dict) else 1.0
        assert summary["momentum"]["initial"] == pytest.approx([0.1 * DENSITY * 2.0 * (heavier * lengths).sum()])
    assert steps[1] == pytest.approx(5.0 * steps[0], rel=0.1)
    assert steps[1] > 0.9 * allowed / math.sqrt(YOUNG / DENSITY)
