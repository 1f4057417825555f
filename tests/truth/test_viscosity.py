"""Stiffness-proportional viscosity of leap-frog schemes, with the strain rate of half a step before.

Its limit is derived from the step itself, and is the one that the literature quotes; motion and dissipated energy are
those of dense matrices.
"""

import math

import numpy as np
import pytest
from scipy.linalg import eigh

import dense
import percuss
from percuss.certificate.verdict import certificate
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from strategies import hunek, turned

VISCOSITIES = [0.0, 0.06, 0.3, 2.0]


def viscous(viscosity):
    return {"name": "viscous-central-difference", "viscosity": viscosity}


# ------------------------------------------------------------------------------------------- the limit of a mode


def step_of(x, b):
    """Return the step of u and dt v of ``u'' + omega^2 (u + beta_d u') = 0``, x = (omega dt)^2, b = beta_d / dt.

    ``dt v += -x (u + b dt v)``, then ``u += dt v``.
    """
    return np.array([[1.0 - x, 1.0 - x * b], [-x, 1.0 - x * b]])


def radius(x, b):
    return np.abs(np.linalg.eigvals(step_of(x, b))).max()


@pytest.mark.parametrize("beta_d", [0.0, 0.01, 0.3, 1.0, 5.0])
def test_the_limit_of_the_lagging_rate_is_the_quoted_one(beta_d):
    """dt = 2/omega (sqrt(1 + xi^2) - xi), xi = omega beta_d / 2, is exact: a root leaves through -1 there."""
    omega = 1.7
    xi = 0.5 * omega * beta_d
    dt = 2.0 / omega * (math.sqrt(1.0 + xi**2) - xi)
    for share in (0.1, 0.5, 0.999):
        assert radius((share * omega * dt) ** 2, beta_d / (share * dt)) <= 1.0 + 1e-12
    assert radius((1.001 * omega * dt) ** 2, beta_d / (1.001 * dt)) > 1.0 + 1e-4
    roots = np.linalg.eigvals(step_of((omega * dt) ** 2, beta_d / dt))
    assert np.abs(roots + 1.0).min() < 1e-7
    # the same as 2 / sqrt(1 + 2 viscosity)
    assert omega * dt == pytest.approx(2.0 / math.sqrt(1.0 + 2.0 * beta_d / dt), rel=1e-12)
    # a mode of low frequency has the damping ratio xi of the text, up to terms of higher order
    for low in (1e-2, 1e-3):
        assert -math.log(radius(low**2, 0.3)) / low == pytest.approx(0.5 * low * 0.3, rel=low)
    # with the rate at the time of the force viscosity would not shorten the step: (v_- + v_+) / 2
    x, b = 3.999, 0.3
    middle = np.linalg.solve([[1.0, -1.0], [0.0, 1.0 + 0.5 * x * b]], [[1.0, 0.0], [-x, 1.0 - 0.5 * x * b]])
    assert np.abs(np.linalg.eigvals(middle)).max() < 1.0


@pytest.mark.parametrize("viscosity", VISCOSITIES)
def test_the_certificate_has_that_limit(viscosity):
    case = hunek(20, courant=0.4, integrator=viscous(viscosity))
    del case["contacts"]
    judged = certificate(model_of(percuss.load(case)))
    assert judged["stable"] == "yes"
    assert judged["courant_critical"] == pytest.approx(1.0 / math.sqrt(1.0 + 2.0 * viscosity), rel=1e-9)


@pytest.mark.deep
@pytest.mark.parametrize("beta_s", [0.1, 0.5, 4.0])
def test_the_limit_with_a_closed_penalty(beta_s):
    """Viscosity acts in the bodies alone: 4/dt^2 M - (1 + 2 viscosity) K - K_p is positive definite below the limit.

    All matrices are symmetric, so that each root z with its mode x obeys a quadratic equation of Rayleigh quotients.
    """
    viscosity = 0.3
    case = hunek(4, courant=0.2, integrator=viscous(viscosity), contact={"name": "penalty", "beta_s": beta_s})
    system = dense.System(case)
    ((eps, _),) = system.penalties(1.0)
    stiffness = system.bars.K[np.ix_(system.free, system.free)]
    whole = (1.0 + 2.0 * viscosity) * stiffness + eps * system.Nf @ system.Nf.T
    dt = 2.0 / math.sqrt(eigh(whole, system.Mf, eigvals_only=True)[-1])
    judged = certificate(model_of(percuss.load(case)))
    assert judged["by"] == "black-box"
    assert judged["dt_critical"] == pytest.approx(dt, rel=1e-5)


# ------------------------------------------------------------------------------------------------------ the motion


@pytest.mark.parametrize("compiled", [False, True], ids=["plain", "compiled"])
@pytest.mark.parametrize("dim", [1, 3])
def test_motion_and_dissipated_energy_are_those_of_dense_matrices(dim, compiled):
    case = hunek(5, courant=0.6, integrator=viscous(0.3), contact={"name": "penalty", "beta_s": 0.5}, end=0.5)
    expected = dense.march(case, viscosity=0.3)
    K, dt = expected.bars.K, expected.dt
    rates = np.diff(expected.u, axis=0, prepend=expected.u[:1]) / dt  # half a step before; the bars begin rigidly
    taken = 0.3 * dt**2 * np.cumsum(np.einsum("ni,ij,nj->n", rates, K, expected.v))
    nodes = [expected.bars.node(end) for end in case["record"]["probes"]]
    direction = [1.0] if dim == 1 else [2 / 3, 1 / 3, -2 / 3]
    result = percuss.run(percuss.load(turned(case, direction)), compiled=compiled)
    along, scale = result.arrays["displacement"] @ np.array(direction), np.abs(expected.u).max()
    np.testing.assert_allclose(along, expected.u[:, nodes], atol=1e-12 * scale)
    assert result.arrays["contact_force"].max() > 0.0
    dissipated = result.arrays["dissipated_energy"]
    np.testing.assert_allclose(dissipated, taken, atol=1e-12 * taken[-1])
    energy = result.summary["energy"]
    assert energy["ledger_closed"]
    assert energy["ledger_error"] < 1e-13
    assert energy["dissipated"] > 0.01 * energy["initial"]
    stored = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
    lost = energy["initial"] + result.arrays["contact_work"] + result.arrays["external_work"] - stored
    assert lost[-1] == pytest.approx(dissipated[-1], rel=1e-10)


def test_without_viscosity_it_is_central_difference():
    one, other = (
        percuss.run(percuss.load(hunek(5, courant=0.6, integrator=integrator, contact={"name": "penalty"})))
        for integrator in ("central-difference", viscous(0.0))
    )
    assert one.arrays.keys() == other.arrays.keys()
    for name, values in one.arrays.items():
        np.testing.assert_array_equal(values, other.arrays[name])


# ------------------------------------------------------------------------------------------------ what is refused


def test_bodies_that_are_not_linear_are_refused():
    case = hunek(5, courant=0.5, integrator=viscous(0.1))
    case["bodies"]["short"]["element"] = "green-bar"
    with pytest.raises(percuss.InputError, match="expected linear bodies with the viscous"):
        percuss.run(percuss.load(case))


@pytest.mark.parametrize("dim", [1, 2])
def test_bodies_of_several_blocks_move_as_one(dim):
    """The bulk update goes from block to block of nodes; the strain rate of the element between two belongs to both."""
    count, steps, viscosity = 2500, 40, 0.4
    direction = np.array([1.0] if dim == 1 else [0.6, -0.8])
    case = {
        "percuss": 1,
        "bodies": {
            "a": {
                "bar": {"length": 1.0, "elements": count, "direction": direction.tolist()},
                "material": {"young": 1.0, "density": 1.0}, "area": 1.0, "velocity": (0.1 * direction).tolist(),
                "fixed": ["left"],
            }
        },
        "method": {"integrator": viscous(viscosity)},
        "loads": {"push": {"constant": 0.02, "on": "a.right"}},
        "time": {"steps": steps, "courant": 0.5},
    }  # fmt: skip
    model = model_of(percuss.load(case))
    march = March(model)
    start = np.random.default_rng(3).standard_normal((2, count + 1)) * 1e-3
    march.u[:] = np.outer(start[0], direction).ravel()
    march.v[:] = np.outer(start[1], direction).ravel()
    u, v, dt = start[0].copy(), start[1].copy(), model.dt
    march.compile()
    march.run()
    push = np.zeros(count + 1)
    push[-1] = 0.02
    for _ in range(steps + 1):
        stress = count * np.diff(u + viscosity * dt * v)
        force = push + np.append(stress, 0.0) - np.insert(stress, 0, 0.0)
        v = v + dt * force / model.bodies.mass
        v[0] = 0.0
        u = u + dt * v
    moved = march.u.reshape(-1, dim) @ direction
    np.testing.assert_allclose(moved, u, atol=1e-11 * np.abs(u).max())


def test_viscosity_takes_the_ripple_of_a_penalty():
    """What it is for: the force of an impact oscillates less about the exact one."""
    errors = []
    for integrator in ("central-difference", viscous(0.3)):
        case = hunek(50, courant=0.6, integrator=integrator, contact={"name": "penalty", "beta_s": 0.5})
        result = percuss.run(percuss.load(case))
        errors.append(result.summary["exact"]["contacts"]["tip"]["force_error_l1"])
    assert errors[1] < 0.7 * errors[0]
