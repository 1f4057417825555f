"""The growth rate of steady sliding: figures of a program written apart, full matrices, and runs that grow so."""

import csv
import json

import numpy as np
import pytest
from scipy.linalg import block_diag, eigvals
from scipy.optimize import curve_fit

import percuss
from blocks import SEAM, block, loaded
from command_line import percuss_command
from percuss.certificate.closed_laws import closed_laws
from percuss.certificate.flutter import flutter_of
from percuss.certificate.verdict import settled
from sliding import growth_rate
from solid_figures import CENTRAL, GAUSS, MORTAR, NODES, RATES

DEEP = pytest.mark.deep
PENALTY, REGULARISED = {"name": "penalty", "beta_s": 1.0}, {"name": "regularised-lagrange", "beta_s": 1.0}
FLOOR = {"floor": {"body": "block.bottom", "wall": {"point": [0, 0], "normal": [0, 1]}}}


def sliding(law=PENALTY, cells=(8, 4), poisson=0.3, mu=0.3, velocity=(1.0, 0.0), **more):
    """Return the case of a block that slides on a floor."""
    bodies = {"block": block([0.0, 0.0], velocity, cells, poisson, size=[1.0, 0.5])}
    method = {"integrator": CENTRAL, "contact": law, "pairing": NODES, "friction": {"name": "coulomb", "mu": mu}}
    return loaded(bodies, FLOOR, method, **more)


def flutter(case):
    return flutter_of(settled(case).model)


@pytest.mark.parametrize(("cells", "column"), [(4, 0), (8, 1), (16, 2), pytest.param(24, 3, marks=DEEP)])
def test_growth_rates_are_those_of_a_program_written_apart(cells, column):
    for (poisson, mu), rates in RATES.items():
        found = flutter(sliding(cells=(cells, cells // 2), poisson=poisson, mu=mu))
        digits = len(rates[column].partition(".")[2])
        assert round(found.rate, digits) == float(rates[column]), (poisson, mu)
        assert ("no smaller step cures that" in found.told) == (found.rate > 0.0) == (rates[column] != "0")


@pytest.mark.parametrize(("law", "penalty"), [(PENALTY, True), (REGULARISED, True), ("lagrange", False)])
def test_growth_rates_are_those_of_full_matrices(law, penalty):
    """Also of gaps that are held closed, whose forces follow from an oblique projection."""
    for poisson, mu in ((0.0, 1.0), (0.3, 0.3), (0.45, 0.1)):
        truth = growth_rate(8, poisson, mu, penalty=penalty)
        assert truth > 0.01
        assert flutter(sliding(law, poisson=poisson, mu=mu)).rate == pytest.approx(truth, rel=1e-9)


def pencil(model, mu, direction):
    """Return the fastest growth of a model from the pencil of motions and forces together, by the QZ algorithm."""
    points, nodes, dim = model.contact_points, model.bodies.n_nodes, model.dim
    stiffness = block_diag(*(body.stiffness_matrix().toarray() for body in model.bodies.values()))
    mass, laws = np.diag(model.bodies.mass_of_dofs), closed_laws(model, model.dt)
    normals, tangents = points.matrix(nodes).toarray(), np.zeros((nodes * dim, len(points)))
    for entry, share in enumerate(points.share):
        dofs = points.node[entry] * dim + np.arange(dim)
        tangents[dofs, points.point[entry]] = share * np.array(direction) / np.linalg.norm(direction)
    ratio = laws.inertia * laws.compliance
    left = np.block([[stiffness, mu * tangents - normals], [normals.T, np.diag(laws.compliance)]])
    right = np.block([[mass, 0.0 * normals], [ratio[:, None] * normals.T, np.zeros((len(points),) * 2)]])
    squares = eigvals(left, right)
    squares = squares[np.abs(squares) < 10.0 * model.bodies.omega**2]  # others are those of the forces, at infinity
    return np.abs(np.sqrt(squares.astype(complex)).imag).max()


@pytest.mark.parametrize(
    ("law", "pairing"),
    [
        (PENALTY, NODES),
        (PENALTY, GAUSS),
        (PENALTY, MORTAR),
        (REGULARISED, GAUSS),
        ({"name": "bipenalty", "beta_s": 1.0}, NODES),
        ("lagrange", NODES),
        ("paoli-schatzman", MORTAR),
    ],
)
@pytest.mark.parametrize(("across", "speed"), [((3,), (0.0, -0.2)), ((2, 1), (0.0, 0.3, -0.4))])
def test_two_bodies_flutter_as_the_pencil_of_motions_and_forces_does(law, pairing, across, speed):
    """Along the slip of the start, in two and three dimensions; cells along the surfaces do not match."""
    if len(speed) == 3 and pairing == MORTAR:
        return
    more = {"size": [1.0, 0.6, 0.4][: len(speed)], "poisson": 0.3}
    left = block(0.0, 0.0, (3, *across), **more)
    right = block(1.0, speed, (2, *(count + 1 for count in across)), **more)
    method = {"integrator": CENTRAL, "contact": law, "pairing": pairing, "friction": {"name": "coulomb", "mu": 0.8}}
    model = settled(loaded({"left": left, "right": right}, SEAM, method)).model
    truth, found = pencil(model, 0.8, speed), flutter_of(model)
    assert truth > 0.01
    assert found.rate == pytest.approx(truth, rel=1e-6)
    assert found.told.startswith(f"while all {len(model.contact_points)} points slide along their slip at the start")


def test_slip_the_other_way_is_a_mirror_image_and_the_worst_axis_is_found():
    """A symmetric block grows alike either way; a smooth wall at its right, closed too, tells the ways apart."""
    one, other, rest = (flutter(sliding(velocity=(speed, 0.0))) for speed in (1.0, -1.0, 0.0))
    assert one.rate == pytest.approx(other.rate, rel=1e-9)
    assert rest.rate == pytest.approx(one.rate, rel=1e-9)
    wall = {"body": "block.right", "wall": {"point": [1, 0], "normal": [-1, 0]}, "friction": "none"}
    cases = [percuss.load(sliding(velocity=(v, 0.0)).data, {"contacts.wall": wall}) for v in (1.0, -1.0, 0.0)]
    one, other, rest = map(flutter, cases)
    assert abs(one.rate - other.rate) > 0.01
    assert rest.rate == pytest.approx(max(one.rate, other.rate), rel=1e-9)
    assert f"all 9 points slide along {'-' if other.rate > one.rate else ''}x," in rest.told


def test_without_friction_nothing_grows():
    """Zero rates are told as such, above what round-off may hide."""
    assert flutter(sliding(mu=0.0)) is None
    found = flutter(sliding(mu=1e-12))
    assert found.rate == 0.0
    assert "show no flutter above a rate of" in found.told


def test_far_points_stay_open():
    """Of a disk at a floor those points take part alone that are within a facet of the lowest one."""
    body = {"disk": {"radius": 1, "elements": 8}, "at": [0, 1], "velocity": [0.1, -0.1]}
    body["material"] = {"young": 1, "density": 1, "poisson": 0.3}
    floor = {"floor": {"body": "disk.skin", "wall": {"point": [0, 0], "normal": [0, 1]}}}
    method = {"contact": PENALTY, "pairing": NODES, "friction": {"name": "coulomb", "mu": 0.3}}
    model = settled(loaded({"disk": body}, floor, method)).model
    gaps, facet = np.sort(model.contact_points.gap), model.contact_points.facet[0]
    number = (gaps <= gaps[0] + facet).sum()
    assert 1 < number < gaps.size
    assert f"while the {number} of {gaps.size} closest points slide" in flutter_of(model).told


@pytest.mark.parametrize(
    ("law", "cells", "why"),
    [
        ("hunt-crossley", (2, 1), "hunt-crossley has a kernel of its own"),
        ("damped-penalty", (2, 1), "damped-penalty weighs the gap rate"),
        (PENALTY, (64, 32), "4290 degrees of freedom are more than 2000"),
    ],
)
def test_what_is_not_known_is_called_so(law, cells, why):
    found = flutter(sliding(law, cells))
    assert found.rate is None
    assert found.told == f"what the equations do while points slide is not known: {why}"


def pressed(law, courant, ramp, end):
    """Return a block that slides fast while its weight comes slowly, so that all points stay closed for long."""
    times = np.linspace(0.0, ramp, 41)
    weight = {"time": [*times.tolist(), 1e4], "value": [*(np.sin(0.5 * np.pi * times / ramp) ** 4).tolist(), 1.0]}
    loads = {"weight": {"table": weight, "on": "block", "direction": [0, -1], "as": "acceleration"}}
    return sliding(law, velocity=(1000.0, 0.0), loads=loads, time={"end": end, "courant": courant})


@DEEP
@pytest.mark.parametrize(
    ("law", "courant", "ramp", "window"),
    [(PENALTY, 0.5, 40.0, (46.0, 60.0)), (PENALTY, 0.1, 40.0, (46.0, 60.0)), ("lagrange", 0.5, 20.0, (25.0, 37.0))],
)
def test_a_run_grows_at_that_rate_at_any_step(law, courant, ramp, window):
    """Contact forces swing about the weight, ever wider, until points open; the last share is other, slower flutter."""
    rate, frequency = fitted(law, courant, ramp, window)
    found = flutter(sliding(law))
    assert rate == pytest.approx(found.rate, rel=0.01)
    assert frequency == pytest.approx(found.frequency, rel=0.005)


@DEEP
def test_forces_from_the_end_of_the_step_damp_by_a_share_of_it():
    rate = flutter(sliding(REGULARISED)).rate
    lost = [1.0 - fitted(REGULARISED, courant, 40.0, (46.0, 60.0))[0] / rate for courant in (0.5, 0.25)]
    assert lost[0] == pytest.approx(0.12, abs=0.03)
    assert lost[1] == pytest.approx(0.5 * lost[0], rel=0.15)


def fitted(law, courant, ramp, window):
    """Return growth rate and frequency of the force of a run in a window, while all of its points slide."""
    result = percuss.run(pressed(law, courant, ramp, window[1]))
    time = result.arrays["time"]
    within = (time > window[0]) & (time < window[1])
    assert result.arrays["sliding_area"][within].min() == pytest.approx(1.0)
    guess = flutter(sliding(law))

    def swing(t, mean, cosine, sine, rate, frequency):
        return mean + np.exp(rate * (t - window[0])) * (cosine * np.cos(frequency * t) + sine * np.sin(frequency * t))

    force = result.arrays["contact_force"][within, 0]
    start = (0.5, 1e-3, 1e-3, guess.rate, guess.frequency)
    return curve_fit(swing, time[within], force, p0=start, maxfev=20_000)[0][3:]


# ------------------------------------------------------------------------------------------------------ the commands


def test_check_and_stability_tell_it_and_a_run_names_check(tmp_path):
    case = tmp_path / "case.yaml"
    case.write_text(json.dumps(dict(sliding(time={"courant": 0.5, "steps": 3}).data)), encoding="utf-8")
    told = "while all 9 points slide along their slip at the start, the equations themselves flutter at a rate of 0.208"
    assert told in percuss_command("check", case).stdout
    data = json.loads(percuss_command("check", case, "--json").stdout)["flutter"]
    assert data["rate"] == pytest.approx(0.208, abs=5e-4)
    assert data["told"].startswith(told)
    rows = tmp_path / "rows.csv"
    asked = percuss_command("stability", case, "--vary", "method.friction.mu=0,0.3,1", "-o", rows)
    assert asked.returncode == 0
    assert "no smaller step cures that" in asked.stdout
    with rows.open(encoding="utf-8") as file:
        assert [row["flutter"][:5] for row in csv.DictReader(file)] == ["", "0.208", "0.906"]
    certificate = percuss.run(percuss.load(case)).summary["certificate"]
    assert "nothing is known of the step (`percuss check` tells how fast they grow)." in certificate["why"]
