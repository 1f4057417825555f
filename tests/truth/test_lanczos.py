"""The criterion of Lanczos runs against full matrices: no false yes or no, and nothing open but near the limit."""

import numpy as np
import pytest
from hypothesis import assume, event, given
from hypothesis import strategies as st

import percuss
from blocks import SEAM, block, loaded, plane_at
from percuss.certificate import glance
from percuss.certificate.black_box import BlackBox
from percuss.certificate.criteria import RunCriterion
from percuss.certificate.lanczos import CHANCE, Lanczos, products_for, why_not_covered
from percuss.certificate.linear_laws import doubts_of, linear_laws
from percuss.certificate.verdict import certificate, settled, verdict_alone
from percuss.errors import InputError, RefusedPair
from percuss.march.model_of_case import model_of, with_step
from percuss.mesh.cell_stiffness import stiffness_of_cells
from solid_figures import CENTRAL, GAUSS, MORTAR, NODES, WU

SHARES = [0.5, 0.8, 0.95, 0.985, 1.001, 1.05, 1.3]  # of the critical step
ELEMENTS = [("quad4", 2), ("quad4-one-point", 2), ("tri3", 2), ("hex8", 3), ("hex8-one-point", 3), ("tet4", 3)]


@st.composite
def solids(draw):
    """Two blocks of unlike meshes and materials, perhaps on rollers or held, that meet with walls and a law each."""
    element, dim = draw(st.sampled_from(ELEMENTS))
    cells = {"tri3": "tri3", "tet4": "tet4"}.get(element)
    poisson, more = draw(st.sampled_from([0.0, 0.3, 0.45])), {} if cells else {"element": element}
    bodies = {}
    for name, at in (("left", 0.0), ("right", 1.0)):
        count = [draw(st.integers(1, 4)) for _ in range(dim)]
        bodies[name] = block(at, 0.1 if name == "left" else -0.1, count, poisson, cells, [1.0, 0.7, 0.5][:dim], **more)
        bodies[name]["material"] |= {"young": draw(st.floats(0.2, 5.0)), "density": draw(st.floats(0.2, 5.0))}
    bodies["left"]["fixed"] = draw(st.sampled_from([[], ["left"], [{"on": "left", "along": "x"}]]))
    law = {"name": draw(st.sampled_from(["penalty", "penalty", "bipenalty", "lagrange", "regularised-lagrange"]))}
    if law["name"] != "lagrange":
        law["beta_s"] = draw(st.sampled_from([0.2, 1.0, 5.0]))
    if law["name"] == "bipenalty":
        law["ratio"] = draw(st.sampled_from([0.1, 0.5]))
    contacts = dict(SEAM)
    if draw(st.booleans()):
        contacts["floor"] = {"body": "right.bottom", "wall": plane_at([0.0] * dim, [0.0, 0.0, 1.0][-dim:])}
    method = {"integrator": draw(st.sampled_from([CENTRAL, WU, "noh-bathe"])), "contact": law}
    method["pairing"] = draw(st.sampled_from([NODES, GAUSS, MORTAR]))
    return loaded(bodies, contacts, method, {"courant": 0.5, "steps": 3})


def highest(model, stiffness):
    """The largest eigenvalue of M^-1 (K + N D N^T) of full matrices that know nothing of rows of differences."""
    bodies, size = model.bodies, model.bodies.mass_of_dofs.size
    matrix = np.zeros((size, size))
    for body in bodies.values():
        place = slice(body.start * model.dim, body.stop * model.dim)
        matrix[place, place] = stiffness_of_cells(body.spec.element, body.spec.material, body.view).toarray()
    normals = model.contact_points.matrix(bodies.n_nodes).toarray()
    matrix += normals @ np.diag(stiffness) @ normals.T
    free = np.eye(size)
    for one in model.loads.constraints:
        held = np.zeros(size)
        held[one.node * model.dim : (one.node + 1) * model.dim] = one.direction
        free -= np.outer(held, held)
    root = 1.0 / np.sqrt(bodies.mass_of_dofs)
    return np.linalg.eigvalsh(free @ (root[:, None] * matrix * root) @ free)[-1]


@pytest.mark.slow
@given(case=solids())
def test_no_yes_and_no_no_is_false_and_nothing_is_open_but_near_the_critical_step(case):
    try:
        model = model_of(case)
    except (InputError, RefusedPair):
        assume(False)
    assume(not doubts_of(model))
    assert not why_not_covered(model)
    quick, exact = RunCriterion(model, Lanczos), RunCriterion(model, linear_laws)
    critical = exact.critical_step
    event(f"limited by contact: {critical < 0.999 * exact.free}")
    lanczos = quick.criteria[0]
    assert lanczos._highest(np.zeros(len(model.contact_points)), 200)[0] == pytest.approx(
        highest(model, np.zeros(len(model.contact_points))), rel=1e-9, abs=1e-12
    )
    for share in SHARES:
        dt = share * critical
        found = quick.assess_step(dt)
        known = exact.assess_step(dt)
        assert found.answer in {"unknown", known.answer} or not known.conclusive
        if found.answer == "grows":  # by the contacts that it names alone
            named = np.isin(np.arange(len(model.contact_points)), found.worst)
            harmful = np.where(named, lanczos._harmful(dt), 0.0)
            assert highest(model, harmful) > lanczos._limit(dt)
        elif found.answer == "stable":
            assert highest(model, lanczos._harmful(dt)) < lanczos._limit(dt)
        else:
            assert "theta" in found.doubt
    assert quick.critical_step <= critical * (1.0 + 1e-9)
    if lanczos.bounds.theta(0.99 * critical)[0] < 1.0:
        assert quick.critical_step > 0.99 * critical


def test_the_number_of_products_is_that_of_the_theorem():
    """1.648 sqrt(n) exp(-sqrt(e) (2k - 1)): Kuczynski and Wozniakowski 1992, theorem 4.2, for k products."""
    for margin, size in ((0.01, 1000), (0.01, 6_000_000), (1e-4, 50_000)):
        count = products_for(margin, size)

        def chance(products, margin=margin, size=size):
            return 1.648 * np.sqrt(size) * np.exp(-np.sqrt(margin) * (2 * products - 1))

        assert chance(count) <= CHANCE < chance(count - 1)


def big(integrator=CENTRAL, law=None, courant=0.5):
    """Blocks of more motions than are factored in a run."""
    bodies = {"left": block(0.0, 0.1, [20, 16]), "right": block(1.0, -0.1, [12, 10])}
    method = {"integrator": integrator, "contact": law or {"name": "penalty", "beta_s": 4.0}, "pairing": MORTAR}
    return loaded(bodies, SEAM, method, {"courant": courant, "steps": 3})


@pytest.mark.parametrize("integrator", [CENTRAL, WU])
def test_a_run_is_not_told_the_critical_step_that_a_check_searches(integrator):
    run, check = verdict_alone(model_of(big(integrator))), certificate(model_of(big(integrator)))
    assert run["stable"] == check["stable"] == "yes"
    assert run["by"] == "bounds"
    assert run["dt_critical"] is None
    assert "`percuss check` does" in run["dt_critical_why"]
    assert run["dt_proven"] <= check["dt_critical"] * (1.0 + 1e-9)
    assert run["dt_proven_why"]


def test_a_chosen_step_is_near_the_one_that_a_factor_finds():
    model = settled(big(courant="auto")).model
    critical = certificate(model)["dt_critical"]
    assert 0.99 * 0.9 * critical < model.dt <= 0.9 * critical
    found = verdict_alone(model)
    assert found["stable"] == "yes"
    assert found["by"] in {"bounds", "lanczos"}


def test_where_nothing_moves_no_step_is_chosen_and_none_is_told():
    """The block has more motions than are looked at in full matrices."""
    body = block([0.0, 0.0], 0.0, [200, 1], 0.3) | {"fixed": ["left", "right", "top", "bottom"]}
    case = {"percuss": 1, "bodies": {"a": body}, "contacts": {}, "time": {"courant": 0.5, "steps": 5}}
    assert "fast cell" not in str(percuss.check(percuss.load(case)))
    with pytest.raises(InputError, match="expected methods of which some step is known to be stable"):
        percuss.run(percuss.load(case, {"time.courant": "auto"}))


def under_a_kernel(count, courant=0.5, **law):
    """Blocks that meet under a law that no stiffness and inertia describe, or another one."""
    bodies = {"left": block(0.0, 0.1, [count, count]), "right": block(1.0, -0.1, [count, count])}
    law = law or {"name": "walton-braun", "beta_s": 40.0, "restitution": 0.6}
    method = {"integrator": CENTRAL, "contact": law, "pairing": NODES}
    return loaded(bodies, SEAM, method, {"courant": courant, "steps": 3})


def test_a_run_of_solids_does_not_wait_for_the_black_box(monkeypatch):
    """It says what it does not know, and that a check looks: at each contact by itself, on every line of its law."""
    monkeypatch.setattr(BlackBox, "assess_step", lambda *_: pytest.fail("it was asked"))
    found = percuss.run(under_a_kernel(3, 0.05)).summary["certificate"]
    assert (found["stable"], found["dt_critical"], found["by"]) == ("unknown", None, "none")
    assert found["why"].startswith("walton-braun has a kernel of its own")
    assert "`percuss check` looks for growth" in found["why"]


@pytest.mark.parametrize("count", [3, 8])
def test_growth_that_few_products_show_is_that_of_the_stiffest_line(count):
    """By full matrices of few motions and by Krylov's of more: the law unloads on a line that is stiffer."""
    stiffest = {"name": "penalty", "beta_s": 40.0 / 0.6**2}
    critical = certificate(model_of(under_a_kernel(count, **stiffest)))["courant_critical"]
    below, above = (verdict_alone(model_of(under_a_kernel(count, share * critical))) for share in (0.99, 1.01))
    assert (below["stable"], above["stable"]) == ("unknown", "no")
    assert (above["by"], above["worst"]) == ("black-box", ["tip"])
    assert "`percuss check` searches how far" in above["cure"]


def test_above_what_the_bodies_allow_a_run_looks_at_no_contact(monkeypatch):
    limit = certificate(model_of(under_a_kernel(2, name="penalty")))["dt_critical_free"]
    monkeypatch.setattr(glance, "grows_clearly", lambda *_: pytest.fail("it was asked"))
    model = model_of(under_a_kernel(2))
    found = verdict_alone(with_step(model, 1.0001 * limit))
    assert (found["stable"], found["by"], found["worst"]) == ("no", "lanczos", [])
    monkeypatch.setattr(glance, "MOST_MOTIONS", 0)  # nor of large solids
    assert verdict_alone(with_step(model, 0.99 * limit))["stable"] == "unknown"
