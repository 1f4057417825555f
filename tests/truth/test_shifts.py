"""Laws that shift displacements beside their force: decomposition contact response, and the account of their work."""

import copy

import numpy as np
import pytest
from test_laws import CD, ROW, STEEL, WU, agrees, bodies_energy, case_with, normals, particle

import percuss
from dense import assemble
from strategies import run

LAW = "decomposition-contact-response"


def reference(case, dt, steps, e):
    """March displacements and velocities in full matrices; return forces and gaps, (steps + 1, contacts)."""
    bars = assemble(case)
    inverse = 1.0 / np.diag(bars.M)
    N, g0 = normals(case, bars)
    s = np.einsum("ip,i,ip->p", N, inverse, N)
    u, v = np.zeros(bars.x.size), bars.v.copy()
    forces, gaps = [], []
    for _ in range(steps + 1):
        gap = g0 + N.T @ u
        v = v - dt * inverse * (bars.K @ u)
        rate = N.T @ v
        overlaps = gap + dt * rate < 0.0
        impulse = np.where(overlaps, np.maximum(-(1.0 + e) * rate, 0.0) / s, 0.0)
        v = v + inverse * (N @ impulse)
        u = u + dt * v
        # of no two contacts the same node, so that each gap is closed by itself
        u = u - inverse * (N @ np.where(overlaps, (g0 + N.T @ u) / s, 0.0))
        forces.append(impulse / dt)
        gaps.append(gap)
    return np.array(forces), np.array(gaps)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("integrator", [CD, WU])
def test_runs_equal_the_published_formula(integrator, e):
    result = run(case_with(ROW, {"name": LAW, "restitution": e}, integrator, steps=200))
    agrees(result, *reference(ROW, result.summary["dt"], 200, e))
    assert result.arrays["gap"].min() >= -1e-14


@pytest.mark.parametrize("e", [0.0, 0.3, 1.0])
def test_a_node_touches_and_leaves_with_the_restitution_times_its_speed(e):
    result, speed = particle({"name": LAW, "restitution": e})
    force, gap = result.arrays["contact_force"][:, 0], result.arrays["gap"][:, 0]
    (first,) = np.flatnonzero(force > 1e-9)
    assert speed[0] == pytest.approx(1.0, rel=1e-12)
    assert speed[-1] == pytest.approx(-e, abs=1e-12)
    assert gap[first + 1] == pytest.approx(0.0, abs=1e-15)
    assert gap.min() >= -1e-15
    kinetic = result.arrays["kinetic_energy"]
    assert kinetic[0] - kinetic[-1] == pytest.approx(0.5 * (1.0 - e**2), abs=1e-12)


LOADS = {
    "push": {"constant": 3.0, "on": "a.right"},
    "weight": {"gravity": 20.0},
    "damper": {"spring-dashpot": {"stiffness": 2.0, "damping": 0.1}, "on": "b.left"},
}


def loaded(element):
    case = copy.deepcopy(case_with(ROW, {"name": LAW, "restitution": 0.5}, steps=150))
    for body in case["bodies"].values():
        body["element"] = element
    return {**case, "loads": LOADS}


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("element", ["bar", pytest.param("green-bar", marks=pytest.mark.deep)])
def test_the_ledger_counts_the_work_of_shifts_whatever_else_acts(element, compiled):
    result = run(loaded(element), compiled=compiled)
    energy = result.summary["energy"]
    assert np.count_nonzero(result.arrays["contact_force"]) > 20
    assert energy["ledger_error"] <= 1e-12
    if element == "green-bar":
        assert energy["internal_work"] is not None


@pytest.mark.parametrize("load", [{"constant": 3.0, "on": "a.right"}, {"gravity": 20.0}], ids=["push", "weight"])
def test_loads_do_work_on_shifts(load):
    """The work of a step is the force times half the change of displacement from n-1 to n+1, shifts included."""
    bar = {"bar": {"length": 1.0, "elements": 1}, "material": STEEL, "area": 1.0, "velocity": 2.0}
    case = case_with(ROW, {"name": LAW, "restitution": 0.5}, steps=400)
    case |= {"bodies": {"a": bar}, "contacts": {"end": {"body": "a.right", "wall": 1.003}}}
    case |= {"loads": {"load": load}, "record": {"probes": ["a.left", "a.right"]}}
    result = run(case)
    shares = [0.0, load["constant"]] if "constant" in load else [20.0 * 0.5 * STEEL["density"]] * 2
    moved = (result.arrays["displacement"].reshape(401, 2) * shares).sum(axis=1)
    work = result.arrays["external_work"]
    assert np.count_nonzero(result.arrays["contact_force"]) > 20
    assert np.abs(np.diff(work)[:-1] - 0.5 * (moved[2:] - moved[:-2])).max() <= 1e-13 * np.abs(work).max()
    assert result.summary["energy"]["ledger_error"] <= 1e-12


def test_schemes_of_stages_refuse_shifts():
    with pytest.raises(percuss.RefusedPair, match="computes several forces in a step"):
        run(case_with(ROW, {"name": LAW}, "noh-bathe"))


def test_shifts_cost_energy_without_restitution_and_may_add_some_with_it():
    """The shift works against the stress of the end elements, and nothing bounds its work."""
    energy = {e: bodies_energy(run(case_with(ROW, {"name": LAW, "restitution": e}))) for e in (0.0, 1.0)}
    assert energy[0.0].max() <= energy[0.0][0] * (1.0 + 1e-12)
    assert energy[1.0].max() > 1.01 * energy[1.0][0]
