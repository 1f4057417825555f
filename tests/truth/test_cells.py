"""Elements of more than two nodes against dispersion relations, matrices of exact integrals, and two-node bars."""

import numpy as np
import pytest
from numpy.polynomial import Legendre, Polynomial

import percuss
from marks import deep
from percuss.certificate.black_box import BlackBox
from percuss.certificate.linear_laws import linear_laws
from percuss.certificate.matrices import operator_of
from percuss.contact.laws import points_of_law
from percuss.march.model_of_case import model_of
from percuss.mesh.stresses import stress_field
from strategies import CORE, CORE_LAWS, FIRST, LEAPFROG, bar, case_of, hunek, is_refused, largest, pair_id, run

SPECTRAL = [{"name": "spectral-bar", "order": order} for order in (1, 2, 3, 4)]
ELEMENTS = ["quadratic-bar", *SPECTRAL[1:]]


def element_id(element):
    return element if isinstance(element, str) else f"order-{element['order']}"


def order_of(element):
    return 2 if element == "quadratic-bar" else element["order"]


def one_bar(element, elements=4, **more):
    """Return a case of one bar of material c = 100, rho A = 0.01."""
    body = bar(2.0, elements, **more) | {"element": element}
    case = case_of({"a": body}, {}, {"steps": 1, "courant": 1.0}, None, "central-difference", "penalty")
    return case | {"record": {"probes": ["a.left"]}}


def made(case):
    return model_of(percuss.load(case))


def frequencies(case):
    """Return omega h / c squared of all modes, from the matrices of the certificate."""
    operator = operator_of(made(case))
    stiffness, root = operator.stiffness.toarray(), np.sqrt(operator.mass.diagonal())
    h = case["bodies"]["a"]["bar"]["length"] / case["bodies"]["a"]["bar"]["elements"]
    return np.linalg.eigvalsh(stiffness / root[:, None] / root) * (h / 100.0) ** 2


def exact_matrices(order, lengths, gauss_lobatto=True):
    """Return stiffness and lumped mass over E A and rho A of a line of elements, by exact integrals of polynomials.

    Nodes stand along the line; the mass of node a is the integral of its shape function, its row sum.
    """
    inner = np.sort(Legendre.basis(order).deriv().roots()) if gauss_lobatto else np.linspace(-1, 1, order + 1)[1:-1]
    nodes = np.array([-1.0, *inner, 1.0])
    shapes = [
        np.prod([Polynomial([-b, 1.0]) / (nodes[a] - b) for k, b in enumerate(nodes) if k != a])
        for a in range(order + 1)
    ]
    size = order * len(lengths) + 1
    stiffness, mass, place = np.zeros((size, size)), np.zeros(size), np.zeros(size)
    for e, h in enumerate(lengths):
        for a, one in enumerate(shapes):
            whole = one.integ()
            mass[order * e + a] += (whole(1.0) - whole(-1.0)) * h / 2
            place[order * e + a] = sum(lengths[:e]) + 0.5 * h * (1.0 + nodes[a])
            for b, other in enumerate(shapes):
                product = (one.deriv() * other.deriv()).integ()
                stiffness[order * e + a, order * e + b] += (product(1.0) - product(-1.0)) * 2 / h
    return stiffness, mass, place


# ------------------------------------------------------------------------------------------ mesh and matrices


@pytest.mark.parametrize("element", [*ELEMENTS, SPECTRAL[0]], ids=element_id)
def test_nodes_masses_and_stiffness_are_those_of_exact_integrals(element):
    case = one_bar(element, elements=5)
    case["bodies"]["a"]["bar"]["grading"] = 3.0
    body = made(case).bodies["a"]
    order = order_of(element)
    stiffness, mass, place = exact_matrices(order, body.mesh.lengths)
    assert body.mesh.lengths.size == 5
    np.testing.assert_allclose(body.mesh.nodes[:, 0], place, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(body.mass, 0.01 * mass, rtol=1e-12)
    found = operator_of(made(case)).stiffness.toarray()
    np.testing.assert_allclose(found, 100.0 * stiffness, rtol=1e-10, atol=1e-10 * 100.0 * stiffness.max())
    (kind, cells), *others = body.mesh.cells.items()
    assert not others
    assert kind == ("line" if order == 1 else f"line{order + 1}")
    assert cells.shape == (5, order + 1)
    # VTK's order: the ends first
    np.testing.assert_array_equal(cells[:, 0], order * np.arange(5))
    np.testing.assert_array_equal(cells[:, 1], order * np.arange(1, 6))
    assert body.mesh.regions["right"].nodes == (5 * order,)


# ------------------------------------------------------------------------------------- dispersion, critical steps


def test_modes_of_quadratic_bars_lie_on_both_branches_of_the_dispersion_relation():
    count = 7
    acoustic, optical = [], []
    for j in range(count + 1):  # a free bar has the modes cos(k x), k h = j pi / n
        s = np.sin(0.5 * j * np.pi / count) ** 2
        roots = np.sort(np.roots([1.0, -(24.0 - 4.0 * s), 96.0 * s]))
        acoustic.append(roots[0])
        optical.append(roots[1])
    # at k h = pi a free end is a crest, which the acoustic branch has in the middle of the elements
    expected = [*acoustic[:-1], *optical]
    np.testing.assert_allclose(frequencies(one_bar("quadratic-bar", count)), np.sort(expected), rtol=1e-9, atol=1e-9)


def test_the_highest_frequencies_are_those_in_closed_form():
    # of Gauss-Lobatto-Legendre elements: 4, 24, 42 + 6 sqrt(29), from the odd and even modes of one element
    for element, largest_eigenvalue in zip(SPECTRAL, (4.0, 24.0, 42.0 + 6.0 * np.sqrt(29.0)), strict=False):
        assert frequencies(one_bar(element, 3))[-1] == pytest.approx(largest_eigenvalue, rel=1e-9)


@pytest.mark.parametrize("element", [*ELEMENTS, SPECTRAL[0]], ids=element_id)
def test_courant_number_one_is_the_critical_step_of_the_exact_matrices(element):
    case = one_bar(element, 6)
    model = made(case)
    stiffness, mass, _ = exact_matrices(order_of(element), model.bodies["a"].mesh.lengths)
    highest = np.sqrt(np.linalg.eigvals(1e4 * stiffness / mass[:, None]).real.max())
    assert model.dt == pytest.approx(2.0 / highest, rel=1e-10)
    assert operator_of(model).free_step() == pytest.approx(2.0 / highest, rel=1e-10)
    if element in ("quadratic-bar", SPECTRAL[1]):
        assert 100.0 * model.dt / (2.0 / 6.0) == pytest.approx(1.0 / np.sqrt(6.0), rel=1e-12)


@pytest.mark.parametrize("element", [*ELEMENTS, SPECTRAL[0]], ids=element_id)
def test_the_error_of_a_frequency_is_of_twice_the_order(element):
    order = order_of(element)
    mode = {1: 1, 2: 2, 3: 4, 4: 6}[order]  # high enough that round-off is far below the error
    errors = []
    for count in (8, 16):
        found = np.sqrt(frequencies(one_bar(element, count))[mode])
        exact = mode * np.pi / count
        errors.append(abs(found - exact) / exact)
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2 * order, abs=0.15)


# ------------------------------------------------------------------------------------------------------ runs


VISCOUS = {"name": "viscous-central-difference", "viscosity": 0.3}


@pytest.mark.parametrize("compiled", [False, deep(True)], ids=["plain", "compiled"])
@pytest.mark.parametrize("integrator", ["central-difference", "velocity-verlet", deep(VISCOUS)], ids=str)
@pytest.mark.parametrize(
    "element",
    [ELEMENTS[0], *map(deep, ELEMENTS[1:])],
    ids=element_id,
)
def test_a_run_is_that_of_dense_matrices(element, integrator, compiled):
    """Velocity Verlet has the displacements of central difference."""
    case = one_bar(element, 4, velocity=0.3, grading=2.0)
    case["loads"] = {"push": {"constant": 1.5, "on": "a.right"}}
    case["method"]["integrator"] = integrator
    case["time"] = {"steps": 50, "courant": 0.7}
    model, result = made(case), percuss.run(percuss.load(case), compiled=compiled)
    stiffness, mass, _ = exact_matrices(order_of(element), model.bodies["a"].mesh.lengths)
    force, dt, lag = np.append(np.zeros(mass.size - 1), 1.5), model.dt, 0.3 * model.dt * (integrator is VISCOUS)
    u, v, history = np.zeros(mass.size), 0.3 - 0.5 * dt * force / (0.01 * mass), []
    for _ in range(51):
        history.append(u[0])
        v = v + dt * (force - 100.0 * stiffness @ (u + lag * v)) / (0.01 * mass)
        u = u + dt * v
    found = result.arrays["displacement"][:, 0, 0]
    np.testing.assert_allclose(found, history[: found.size], rtol=0, atol=1e-8 * largest(np.array(history)))
    if integrator != "velocity-verlet":
        assert result.summary["energy"]["ledger_error"] < 1e-11


def impact(element, law, integrator="central-difference", n=6, **more):
    """Return the two bars of Hunek with an element."""
    case = hunek(n, integrator=integrator, contact=law, **more)
    for body in case["bodies"].values():
        body["element"] = element
    return case


@pytest.mark.deep
@pytest.mark.parametrize(
    "law", [law if law["name"] in CORE_LAWS else deep(law) for law in FIRST], ids=lambda law: law["name"]
)
def test_order_one_is_the_two_node_bar(law):
    integrator = next(name for name in CORE if not is_refused(name, law))
    histories = [run(impact(element, law, integrator)).arrays for element in ("bar", SPECTRAL[0])]
    for name in ("contact_force", "gap", "displacement", "elastic_energy"):
        two_nodes, cells = (arrays[name] for arrays in histories)
        size = max(largest(two_nodes), 1e-6)  # of the lengths and forces here; a tied gap is round-off
        np.testing.assert_allclose(cells, two_nodes, rtol=0, atol=1e-9 * size, err_msg=name)


PAIRS = [
    (integrator, law) for integrator in CORE for law in FIRST if not is_refused(integrator, law)
]  # of the first options of every law


OF_CORE = [pair for pair in PAIRS if pair[1]["name"] in CORE_LAWS]


@pytest.mark.parametrize("compiled", [False, deep(True)], ids=["plain", "compiled"])
@pytest.mark.parametrize(
    ("element", "pair"),
    [
        *(("quadratic-bar", pair) if pair in OF_CORE else deep("quadratic-bar", pair) for pair in PAIRS),
        *(deep(SPECTRAL[2], pair) for pair in OF_CORE),  # a law sees the ends of a body, and no element
    ],
    ids=lambda value: pair_id(value) if isinstance(value, tuple) else element_id(value),
)
def test_impacts_keep_momentum_and_close_the_ledger(element, pair, compiled):
    integrator, law = pair
    result = percuss.run(percuss.load(impact(element, law, integrator)), compiled=compiled)
    assert result.status == "done"
    assert result.summary["momentum"]["error"] < 1e-11
    assert result.summary["energy_growth"]["kept"] is not False  # what the certificate guarantees of the energy
    if integrator in LEAPFROG:
        assert result.summary["energy"]["ledger_error"] < 1e-11
    if law["name"] != "tied":  # which pulls, too
        assert result.summary["contacts"]["tip"]["impulse"] == pytest.approx(0.02, rel=0.3)


@pytest.mark.parametrize("integrator", ["central-difference", "wu-predictor-corrector"])
@pytest.mark.parametrize("element", ["quadratic-bar", deep(SPECTRAL[2])], ids=element_id)
@pytest.mark.parametrize(
    "law", [{"name": "penalty", "beta_s": 2.0}, {"name": "bipenalty", "beta_s": 2.0, "ratio": 2.0}]
)
def test_linear_laws_and_black_box_agree_on_the_critical_step(element, law, integrator):
    model = made(impact(element, law, integrator, n=3))
    rows, step = linear_laws(model).critical_step, BlackBox(model).critical_step
    assert rows == pytest.approx(step, rel=1e-5)
    assert rows < 2.0 / model.bodies.omega


@pytest.mark.parametrize("element", [*ELEMENTS, SPECTRAL[0]], ids=element_id)
def test_the_stiffest_contact_that_a_step_allows_is_that_of_exact_matrices(element):
    case = one_bar(element, 4)
    case["contacts"] = {"w": {"body": "a.right", "wall": 2.0}}
    case["time"]["courant"] = 0.9
    model = made(case)
    stiffness, mass, _ = exact_matrices(order_of(element), model.bodies["a"].mesh.lengths)
    reserve = np.diag(4.0 / model.dt**2 * 0.01 * mass) - 100.0 * stiffness
    limit = 1.0 / np.linalg.inv(reserve)[-1, -1]
    assert points_of_law(model, [0], model.dt).stiffness_limit[0] == pytest.approx(limit, rel=1e-7)


# ------------------------------------------------------------------------------------------ stress, state variables


@pytest.mark.parametrize("element", ELEMENTS, ids=element_id)
def test_the_stress_of_an_element_is_the_mean_over_its_length(element):
    # which is E times the mean strain, the difference of the ends over the length, whatever happens between them
    model = made(one_bar(element, 3))
    body = model.bodies["a"]
    snapshots = np.cos(np.arange(5.0 * body.mesh.nodes.size) ** 2).reshape(5, -1)
    nodes = body.element_nodes(np.arange(3))
    stress, _ = stress_field(
        body, np.arange(3), snapshots[:, nodes][..., None], np.zeros((5, 3, body.volumes.shape[1], 0))
    )
    expected = 100.0 * (snapshots[:, nodes[:, 1]] - snapshots[:, nodes[:, 0]]) / body.mesh.lengths
    np.testing.assert_allclose(stress, expected, rtol=1e-7, atol=1e-7 * 100.0)


@pytest.mark.deep
@pytest.mark.parametrize("element", ["quadratic-bar", SPECTRAL[2]], ids=element_id)
def test_materials_remember_at_every_quadrature_point(element):
    steel = {"name": "bilinear-plastic", "young": 100.0, "density": 0.01, "yield_stress": 0.02, "tangent": 0.2}
    case = impact(element, {"name": "penalty"}, n=8)
    case["record"]["fields"] = 20
    for body in case["bodies"].values():
        body["material"] = steel
    result = run(case)
    assert result.summary["energy"]["ledger_error"] < 1e-11
    assert result.summary["momentum"]["error"] < 1e-11
    dissipated = result.arrays["dissipated_energy"]
    assert dissipated[-1] > 0.05 * result.arrays["kinetic_energy"][0]
    assert np.all(np.diff(dissipated) >= -1e-12)
    stored_and_dissipated = result.arrays["elastic_energy"] + dissipated
    np.testing.assert_allclose(
        stored_and_dissipated, result.arrays["internal_work"], rtol=0, atol=0.05 * result.arrays["kinetic_energy"][0]
    )


# -------------------------------------------------------------------------------------------------- refusals


@pytest.mark.deep
@pytest.mark.parametrize("element", ["quadratic-bar", SPECTRAL[3]], ids=element_id)
def test_an_absorbing_end_has_the_impedance_of_the_bar(element):
    # a bar that moves and is brought to rest: all of its energy leaves at the speed of waves, within the first transit
    case = one_bar(element, 40, velocity=0.2)
    case["loads"] = {"rest": {"absorbing": {}, "on": "a.right"}, "also": {"absorbing": {}, "on": "a.left"}}
    case["time"] = {"end": 0.04, "courant": 0.5}
    result = run(case)
    energy = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
    assert energy[-1] < 1e-3 * energy[0]
    assert result.summary["energy"]["ledger_error"] < 1e-11


@pytest.mark.deep
def test_a_smooth_wave_converges_faster_with_a_higher_order():
    """One period of a raised cosine, whose displacement has a jump in its third derivative, at equal numbers of nodes.

    The order of every element is at most that of the jump, about 3; the step is so short that its error is far less.
    """
    errors = {}
    for element in ("bar", "quadratic-bar", SPECTRAL[3]):
        order = 1 if element == "bar" else order_of(element)
        for nodes in (24, 96):
            case = one_bar(element, nodes // order)
            pulse = {"value": 0.5, "frequency": 1.0 / 0.012, "phase": -0.5 * np.pi, "mean": 0.5}
            case["loads"] = {"pulse": {"harmonic": pulse, "on": "a.left", "until": 0.012}}
            case["time"] = {"step": 0.018 / 4000, "steps": 4000}
            case["record"]["every"] = 4000
            errors[order, nodes] = run(case).summary["exact"]["displacement_error"]
    observed = {order: np.log2(errors[order, 24] / errors[order, 96]) / 2 for order in (1, 2, 4)}
    assert observed[1] == pytest.approx(2.0, abs=0.05)
    assert observed[2] == pytest.approx(3.0, abs=0.3)
    assert observed[4] > 2.8
    assert errors[2, 96] < 0.05 * errors[1, 96]
    assert errors[4, 96] < 0.5 * errors[2, 96]
