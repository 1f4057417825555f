"""The bounds of cells and closed contacts: no step that they call stable is above the critical one of the operator."""

import numpy as np
import pytest

from blocks import SEAM, block, loaded, plane_at
from marks import deep
from percuss.certificate.bounds import Bounds
from percuss.certificate.closed_laws import closed_laws
from percuss.certificate.criteria import RunCriterion
from percuss.certificate.linear_laws import linear_laws
from percuss.certificate.verdict import certificate, settled
from percuss.errors import InputError, RefusedPair
from percuss.march.model_of_case import model_of
from percuss.methods.registry import Registry
from solid_figures import CENTRAL, GAUSS, MORTAR, NODES, WU

SOFT, STIFF = {"name": "penalty", "beta_s": 0.5}, {"name": "penalty", "beta_s": 4.0}
LAWS = [*Registry.load().names("contacts"), STIFF, {"name": "bipenalty", "beta_s": 4.0, "ratio": 0.4}]


def boxes(contact, integrator=WU, pairing=MORTAR, dim=2, courant=0.4, own=None):
    """Two boxes of unlike meshes, of which the left one slides along a wall."""
    size, rollers = [1.0, 1.0, 0.8][:dim], [{"on": "left", "along": "x"}]
    bodies = {
        "left": block(0.0, 0.0, [2, 3, 3][:dim], 0.3, size=size, fixed=rollers),
        "right": block(1.0, -0.1, [2] * dim, 0.3, size=size),
    }
    floor = {"body": "left.bottom", "wall": plane_at([0.0] * dim, [0.0, 0.0, 1.0][-dim:])}
    contacts = {**SEAM, "floor": floor | ({"method": own} if own else {})}
    method = {"integrator": integrator, "contact": contact, "pairing": pairing}
    return loaded(bodies, contacts, method, {"courant": courant, "steps": 3, "on_unstable": "warn"})


@pytest.mark.parametrize("dim", [2, deep(3)])
@pytest.mark.parametrize("pairing", [GAUSS, *map(deep, (NODES, MORTAR))])
@pytest.mark.parametrize("integrator", [WU, CENTRAL, deep("noh-bathe")])
def test_a_step_below_the_bound_is_stable_and_the_bound_is_near(integrator, pairing, dim):
    tried = 0
    for contact in LAWS:
        try:
            model = model_of(boxes(contact, integrator, pairing, dim))
        except (InputError, RefusedPair):
            continue
        bounds, exact = RunCriterion(model, Bounds), RunCriterion(model, linear_laws)
        known = bounds.assess_step(1e-3 * bounds.free)
        if known.answer == "unknown":
            assert closed_laws(model, model.dt).doubts or "differ in eps_m" in known.doubt
            assert np.isnan(bounds.critical_step)
            continue
        assert bounds.free <= exact.free
        assert 0.8 * exact.critical_step < bounds.critical_step <= exact.critical_step * (1.0 + 1e-9)
        assert bounds.assess_step(0.999 * bounds.critical_step).answer == "stable"
        assert bounds.assess_step(1.001 * bounds.critical_step).answer == "unknown"
        tried += 1
    assert tried >= 4


def test_contacts_that_differ_in_inertia_are_not_proved_stable():
    model = model_of(boxes(STIFF, own={"name": "bipenalty", "beta_s": 0.5, "ratio": 0.1}))
    assert "differ in eps_m / eps_s" in RunCriterion(model, Bounds).assess_step(1e-3 * model.dt).doubt
    same = model_of(boxes(STIFF, own=SOFT))
    assert RunCriterion(same, Bounds).assess_step(1e-3 * same.dt).answer == "stable"


@pytest.mark.parametrize("contact", ["lagrange", "regularised-lagrange", SOFT])
def test_a_large_body_has_the_verdict_and_the_energy_of_a_small_one(monkeypatch, contact):
    small = certificate(model_of(boxes(contact, dim=3)))
    monkeypatch.setattr("percuss.mesh.size_limits.MOST_FACTORED", 20)
    large = certificate(model_of(boxes(contact, dim=3)))
    assert (large["stable"], large["energy"], large["by"]) == ("yes", small["energy"], "bounds")
    assert large["dt_proven"] < small["dt_critical"]
    assert small["by"] == "linear-laws"
    assert large["dt_critical"] is large["dt_critical_free"] is None
    chosen = settled(boxes(contact, dim=3, courant="auto")).model
    assert 0.99 * 0.9 * small["dt_critical"] < chosen.dt < 0.9 * small["dt_critical"]
    assert certificate(chosen)["stable"] == "yes"


def test_of_a_large_body_a_motion_that_grows_is_found_and_what_is_known_is_said(monkeypatch):
    small = certificate(model_of(boxes(STIFF, CENTRAL, dim=3, courant=0.97)))
    monkeypatch.setattr("percuss.mesh.size_limits.MOST_FACTORED", 20)
    above = certificate(model_of(boxes(STIFF, CENTRAL, dim=3, courant=0.97)))
    assert (above["stable"], above["worst"]) == ("no", ["floor"])  # which suffices at this step
    assert {"floor"} < set(small["worst"])  # at the critical one the tip belongs to it
    beyond = certificate(model_of(boxes(STIFF, CENTRAL, dim=3, courant=1.3)))
    assert (beyond["stable"], beyond["worst"]) == ("no", [])
    with_kernel = certificate(model_of(boxes("hunt-crossley", dim=3)))
    assert with_kernel["stable"] == "unknown"
    assert "hunt-crossley has a kernel of its own" in with_kernel["why"]
    with pytest.raises(InputError, match=r"(?s)of which some step is known to be stable.*Give a step"):
        settled(boxes("hunt-crossley", dim=3, courant="auto"))
