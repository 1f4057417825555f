"""Masses that couple nodes: reciprocal mass matrices against dense ones, dispersion relations and identities."""

import copy
import math

import numpy as np
import pytest
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh, null_space

import percuss
from dense import assemble, march_stages
from dense import march as dense_march
from formulas import SCHEMES
from percuss import Lumping
from percuss.contact.laws import points_of_law
from percuss_methods.masses.reciprocal import Reciprocal
from strategies import hunek, nudged, number, unlike_bars

LEAP_FROG = ("central-difference", "wu-predictor-corrector")
LAWS = (
    {"name": "penalty", "beta_s": 0.7},
    {"name": "bipenalty", "beta_s": 1.5, "ratio": "matched"},
    {"name": "bipenalty", "beta_s": 0.25, "ratio": 1.0},
    {"name": "lagrange"},
)
CONSISTENCIES = (1.0, 0.375, -0.5, -1.5)


def ran(case, overrides=None, **options):
    return percuss.run(percuss.load(case), overrides, compiled=False, **options)


def reciprocal_inverse(bars, consistency):
    """Return M^-1 from the matrices of the elements, with `numpy.linalg.inv` of each."""
    total, lumped = np.zeros(bars.M.shape), np.diag(bars.M)
    for name, lengths in bars.lengths.items():
        given = bars.given[name]
        for e, h in enumerate(lengths):
            mass = given["material"]["density"] * given["area"] * h
            consistent = mass / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
            element = (1.0 - consistency) * 0.5 * mass * np.eye(2) + consistency * consistent
            half = 0.5 * mass * np.eye(2)
            i = bars.start[name] + e
            total[i : i + 2, i : i + 2] += half @ np.linalg.inv(element) @ half
    return total / np.outer(lumped, lumped)


def reciprocal_mass(consistency):
    return lambda bars: np.linalg.inv(reciprocal_inverse(bars, consistency))


def uniform(count, consistency):
    """Return M^-1, K and the nodal masses of a free bar of equal elements with c = h = 1."""
    bars = assemble({"bodies": {"a": {"bar": {"length": float(count), "elements": count}, "area": 1.0,
                                      "material": {"young": 1.0, "density": 1.0}}}})  # fmt: skip
    return reciprocal_inverse(bars, consistency), bars.K, np.diag(bars.M)


# ----------------------------------------------------------------------------------------------------- the matrices


@pytest.mark.parametrize("consistency", CONSISTENCIES)
def test_bands_are_those_of_the_element_matrices(consistency):
    bar = {"bar": {"length": 3.0, "elements": 9, "grading": 0.2}, "area": 1.5}
    bars = assemble({"bodies": {"a": bar | {"material": {"young": 1.0, "density": 0.7}}}})
    element_mass = 0.7 * 1.5 * bars.lengths["a"]
    found = Reciprocal(consistency=consistency).inverse(element_mass, Lumping.of_line(9)).toarray()
    expected = reciprocal_inverse(bars, consistency)
    assert np.diag(found) == pytest.approx(np.diag(expected), rel=1e-13)
    assert np.diag(found, 1) == pytest.approx(np.diag(expected, 1), rel=1e-13)
    assert (found == found.T).all()
    assert np.abs(np.triu(expected, 2)).max() == 0.0
    assert np.linalg.eigvalsh(expected).min() > 0.0
    # A body that moves as a whole has its mass: C m = 1.
    assert expected @ np.diag(bars.M) == pytest.approx(np.ones(10), rel=1e-13)


@pytest.mark.parametrize("consistency", [*CONSISTENCIES, 0.0])
def test_waves_have_the_frequencies_of_the_dispersion_relation(consistency):
    """(omega h / c)^2 = 2 z + (s - 1) z^2, with z = 1 - cos(kappa h) and s = 1 / (1 - 2 b / 3)."""
    count = 40
    inverse, stiffness, _ = uniform(count, consistency)
    ends = np.zeros(count + 1)
    ends[[0, -1]] = 1.0
    s = 1.0 / (1.0 - 2.0 * consistency / 3.0)
    for k in (1, 7, 20, 33, count):
        wave = np.cos(np.pi * k * np.arange(count + 1) / count)
        z = 1.0 - math.cos(math.pi * k / count)
        # The ends are half elements of the same periodic row, so that standing waves are exact there too.
        assert inverse @ stiffness @ wave == pytest.approx((2.0 * z + (s - 1.0) * z**2) * wave, abs=1e-12)


# -------------------------------------------------------------------------------------------- against dense matrices


@st.composite
def rows(draw):
    """Draw rows of one to three unlike bars, that hit each other or a wall, held, driven or loaded at the last end."""
    names, bodies, contacts = draw(unlike_bars(fewest_elements=2))
    if draw(st.booleans()):  # two contacts at one end
        first = bodies["a"]["bar"]["length"]
        contacts["stop"] = {"body": "a.right", "wall": round(first + draw(st.sampled_from([0.0, 0.01])), 6)}
    last, end = bodies[names[-1]], f"{names[-1]}.right"
    ending = draw(st.sampled_from(["wall", "fixed", "loaded", "driven"]))
    if len(names) == 1 and ending != "wall":
        contacts.setdefault("start", {"body": "a.left", "wall": -0.01})
    if ending == "wall":
        wall = round(last["at"] + last["bar"]["length"] + draw(st.sampled_from([0.0, 0.05])), 6)
        contacts.setdefault("stop" if len(names) == 1 else "wall", {"body": end, "wall": wall})
    elif "stop" in contacts and len(names) == 1:
        del contacts["stop"]
    loads = {}
    if ending == "fixed":
        last["fixed"] = ["right"]
    if ending == "loaded":
        loads["push"] = {"constant": draw(number(-1.0, 1.0)), "on": end}
    if ending == "driven":
        loads["drive"] = {"prescribed-velocity": draw(number(-0.5, 0.5)), "on": end}
    if ending != "driven" and draw(st.booleans()):
        loads["weight"] = {"gravity": draw(number(-2.0, 2.0))}
    return {
        "percuss": 1,
        "bodies": bodies,
        "contacts": contacts,
        "loads": loads,
        "method": {"integrator": draw(st.sampled_from(LEAP_FROG)), "contact": dict(draw(st.sampled_from(LAWS)))},
        "time": {"steps": 100, "courant": draw(number(0.15, 0.4)), "on_unstable": "warn"},
        "record": {"probes": [f"{name}.{side}" for name in names for side in ("left", "right")]},
    }


@pytest.mark.deep
@settings(max_examples=12, deadline=None, derandomize=True, phases=(Phase.generate,))
@given(rows(), st.sampled_from(CONSISTENCIES))
def test_rows_of_bars_move_as_dense_matrices_move_them(case, consistency):
    case["method"]["mass"] = {"name": "reciprocal", "consistency": consistency}
    mass = reciprocal_mass(consistency)
    dense = dense_march(case, mass=mass)
    peak = np.abs(dense.force).max()
    assume(0.0 < peak < 1e3)
    other = dense_march(nudged(case, 1e-12), mass=mass).force
    assume(np.abs(other - dense.force).max() < 1e-8 * peak)  # else round-off decides about openings
    result = ran(case)
    scale = np.abs(dense.u).max()
    assert np.abs(result.arrays["contact_force"] - dense.force).max() < 1e-7 * peak
    assert np.abs(result.arrays["gap"] - dense.gap).max() < 1e-8 * max(scale, np.abs(dense.gap).max())
    ends = [dense.bars.node(probe) for probe in case["record"]["probes"]]
    assert np.abs(result.arrays["displacement"][..., 0] - dense.u[:, ends]).max() < 1e-8 * scale
    energy = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
    assert np.abs(energy - dense.energy).max() < 1e-9 * dense.energy.max()
    assert result.summary["energy"]["ledger_error"] < 1e-12
    assert result.summary["momentum"]["error"] < 1e-12
    if result.summary["certificate"]["stable"] == "yes":
        assert result.summary["energy_growth"]["kept"] is not False


@pytest.mark.parametrize("scheme", ["velocity-verlet", "noh-bathe"])
def test_stages_accelerate_as_dense_matrices_do(scheme):
    """Contact by a penalty, gravity, a load on an end and a held end, in the stages of a scheme."""
    case = hunek(6, integrator=scheme, contact={"name": "penalty", "beta_s": 0.7}, courant=0.25)
    case["bodies"]["short"]["bar"]["grading"] = 0.4
    case["loads"] = {"weight": {"gravity": 0.3}, "push": {"constant": 0.01, "on": "short.left"}}
    case["time"] = {"steps": 90, "courant": 0.2}
    case["method"]["mass"] = {"name": "reciprocal", "consistency": 0.8}
    result = ran(case)
    bars, u, _ = march_stages(case, SCHEMES[scheme], 90, result.summary["dt"], mass=reciprocal_mass(0.8))
    expected = u[:, [bars.node(probe) for probe in case["record"]["probes"]]]
    assert result.arrays["contact_force"].max() > 0.0
    assert np.abs(result.arrays["displacement"][..., 0] - expected).max() < 1e-10 * np.abs(expected).max()
    assert result.summary["momentum"]["error"] < 1e-12


# -------------------------------------------------------------------------------------------------------- stability


def dense_matrices(case, consistency):
    """Return M, K and N of the free nodes of a case."""
    bars = assemble(case)
    mass = np.linalg.inv(reciprocal_inverse(bars, consistency))
    free = np.delete(np.arange(bars.x.size), bars.node("long.right"))
    normal = np.zeros(bars.x.size)
    normal[[bars.node("short.right"), bars.node("long.left")]] = -1.0, 1.0
    return bars, mass[np.ix_(free, free)], bars.K[np.ix_(free, free)], normal[free]


@pytest.mark.parametrize("consistency", [1.0, pytest.param(-1.5, marks=pytest.mark.deep)])
@pytest.mark.parametrize(
    "law", [LAWS[0], *(pytest.param(law, marks=pytest.mark.deep) for law in LAWS[1:]), {"name": "tied"}]
)
@pytest.mark.parametrize("integrator", [LEAP_FROG[0], pytest.param(LEAP_FROG[1], marks=pytest.mark.deep)])
def test_the_critical_step_is_that_of_dense_matrices(consistency, law, integrator):
    case = hunek(7, integrator=integrator, contact=dict(law), courant=0.2)
    case["bodies"]["short"] |= {"area": 2.0, "bar": {"length": 10.0, "elements": 7, "grading": 0.3}}
    case["method"]["mass"] = {"name": "reciprocal", "consistency": consistency}
    certificate = ran(case).summary["certificate"]
    bars, mass, stiffness, normal = dense_matrices(case, consistency)
    motions = null_space(normal[None]) if law["name"] == "tied" else np.eye(normal.size)  # a tie is never open
    tops = eigh(motions.T @ stiffness @ motions, motions.T @ mass @ motions, eigvals_only=True)
    free = 2.0 / math.sqrt(tops[-1])
    assert certificate["dt_critical_free"] == pytest.approx(free, rel=1e-10)
    assert certificate["by"] == "linear-laws"

    def grows(dt):
        """Whether the bodies grow without contact, or a power of the amplification matrix of (u_n, u_n-1) with it."""
        sides = [bars.end("short.right"), bars.end("long.left")]
        eye, inverse = np.eye(normal.size), np.linalg.inv(mass)
        step = 2.0 * eye - dt**2 * inverse @ stiffness
        if law["name"] in {"lagrange", "tied"}:
            back = eye - np.outer(inverse @ normal, normal) / (normal @ inverse @ normal)
            top, before = back @ step, -back
        else:
            ratio = dt**2 if law.get("ratio") == "matched" else 1.0 / min(side[1] for side in sides) ** 2
            spring = law["beta_s"] * min(sides)[0]
            inertia = spring * ratio if law["name"] == "bipenalty" else 0.0
            if integrator == "central-difference":
                whole = np.linalg.inv(mass + inertia * np.outer(normal, normal))
                step = 2.0 * eye - dt**2 * whole @ (stiffness + spring * np.outer(normal, normal))
                top, before = step, -eye
            else:
                s = normal @ inverse @ normal
                pull = dt**2 * spring / (1.0 + inertia * s) * np.outer(inverse @ normal, normal)
                top, before = (eye - pull) @ step, -(eye - pull)
        matrix = np.block([[top, before], [eye, np.zeros_like(eye)]])
        moduli = np.abs(np.linalg.eigvals(matrix))
        return dt > free or (moduli > 1.0 + 1e-7).any()

    critical = certificate["dt_critical"]
    assert critical <= free * (1.0 + 1e-9)
    for share in (0.3, 0.6, 0.9, 0.99, 0.9999):
        assert not grows(share * critical)
    assert grows(1.001 * critical)


# -------------------------------------------------------------------------------------------------------- identities


def test_without_consistency_it_is_lumped_to_the_last_bit():
    case = hunek(12)
    lumped = percuss.run(percuss.load(case))
    reciprocal = percuss.run(percuss.load(case), {"method.mass": {"name": "reciprocal", "consistency": 0.0}})
    for name in ("contact_force", "gap", "displacement", "kinetic_energy"):
        assert (lumped.arrays[name] == reciprocal.arrays[name]).all()
    # With hardly any it is nearly that, by the way of all masses that couple nodes.
    nearly = percuss.run(percuss.load(case), {"method.mass": {"name": "reciprocal", "consistency": 1e-9}})
    assert 0.0 < np.abs(nearly.arrays["displacement"] - lumped.arrays["displacement"]).max() < 1e-8


@pytest.mark.parametrize(
    ("mass", "contact"),
    [({"name": "reciprocal", "consistency": 0.7}, {"name": "bipenalty", "beta_s": 0.5}), ("redistributed", "lagrange")],
    ids=["reciprocal", "redistributed"],
)
def test_a_row_that_is_turned_in_the_plane_moves_as_on_the_line(mass, contact):
    case = hunek(6, contact=contact)
    case["method"]["mass"] = mass
    case["loads"] = {"push": {"constant": 0.02, "on": "short.left"}}
    turned = copy.deepcopy(case)
    for body in turned["bodies"].values():
        body["bar"]["direction"] = [0.6, 0.8]
        body["at"] = [0.6 * body.get("at", 0.0), 0.8 * body.get("at", 0.0)]
    line, plane = ran(case), ran(turned)
    assert np.abs(plane.arrays["contact_force"] - line.arrays["contact_force"]).max() < 1e-12
    along = plane.arrays["displacement"] @ np.array([0.6, 0.8])
    assert np.abs(along - line.arrays["displacement"][..., 0]).max() < 1e-12
    assert plane.summary["energy"]["ledger_error"] < 1e-12


@pytest.mark.deep
def test_other_methods_balance_with_it():
    """Viscosity, bodies that are not linear, loads that follow the motion, laws with a kernel."""
    for change in (
        {"method.integrator": "viscous-central-difference", "method.contact": "penalty"},
        {"bodies.long.element": "green-bar"},
        {"bodies.short.material": {"name": "bilinear-plastic", "young": 100.0, "density": 0.01, "yield_stress": 0.02}},
        {"loads": {"end": {"absorbing": {}, "on": "short.left"}}},
        {"loads": {"end": {"spring-dashpot": {"stiffness": 3.0, "damping": 0.4}, "on": "short.left"}}},
        {"method.contact": "uzawa"},
        {"method.contact": "hunt-crossley"},
        {"loads": {"shake": {"harmonic": {"value": 0.2, "frequency": 3.0}, "on": "long.right", "as": "velocity",
                             "from": 0.1, "until": 0.3}}, "bodies.long.fixed": []},
    ):  # fmt: skip
        case = hunek(10, courant=0.3, end=0.5)
        case["method"]["mass"] = {"name": "reciprocal", "consistency": 0.9}
        result = ran(case, change)
        assert result.arrays["contact_force"].max() > 0.0, change
        assert result.summary["energy"]["ledger_error"] < 1e-12, change
        assert result.summary["momentum"]["error"] < 1e-12, change


# ---------------------------------------------------------------------------------------------------------- accuracy


def test_the_consistency_that_the_docstring_gives_for_a_step_cancels_its_error():
    """b = 3 (1 - C^2) / (2 (4 - C^2)): errors of space and of time cancel in fourth order."""
    courant, kappa = 0.6, np.array([0.1, 0.2])
    consistency = 1.5 * (1.0 - courant**2) / (4.0 - courant**2)
    z, s = 1.0 - np.cos(kappa), 1.0 / (1.0 - 2.0 * consistency / 3.0)
    omega = 2.0 / courant * np.arcsin(0.5 * courant * np.sqrt(2.0 * z + (s - 1.0) * z**2))
    errors = np.abs(omega / kappa - 1.0)
    assert math.log2(errors[1] / errors[0]) == pytest.approx(4.0, abs=0.05)
    assert 4.0 * s * courant**2 <= 4.0  # below the critical step, as for every C up to 1
    results = [
        percuss.run(
            percuss.load("cases/smooth-pulse.yaml"),
            {"time.courant": 0.5, "method.contact": "lagrange", "method.mass": mass},
        ).summary["exact"]["contacts"]["joint"]["force_error_l1"]
        for mass in ("lumped", {"name": "reciprocal", "consistency": 0.3}, {"name": "reciprocal", "consistency": 1.0})
    ]
    assert results[1] < results[0] / 10.0
    assert (
        results[2] > 5.0 * results[0]
    )  # the element matrices as they are make waves faster than lumped ones slow them


# ---------------------------------------------------------------------------------------------- unknown, and refused


def test_what_only_the_black_box_could_tell_is_unknown():
    case = hunek(5, courant=0.3, end=0.05)
    case["method"]["mass"] = "reciprocal"
    for change, reason in (
        ({"method.contact": "uzawa"}, "has a kernel of its own"),
        ({"method.integrator": "viscous-central-difference", "method.contact": "penalty"}, "viscous"),
        ({"method.integrator": "noh-bathe", "method.contact": "lagrange"}, "end of a step of stages"),
        ({"loads": {"end": {"absorbing": {}, "on": "short.right"}}}, "in contact"),
    ):
        certificate = ran(case, change).summary["certificate"]
        assert certificate["stable"] == "unknown", change
        assert "the mass reciprocal, which couples nodes, is examined only with linear laws" in certificate["why"]
        assert reason in certificate["why"]
        with pytest.raises(percuss.InputError, match="which couples nodes"):
            ran(case, change | {"time.courant": "auto"})


def test_criteria_that_do_not_cover_it_say_so():
    from percuss.certificate.waves import waves
    from percuss.march.model_of_case import model_of

    case = hunek(5, contact={"name": "penalty", "beta_s": 0.5})
    case["method"]["mass"] = "reciprocal"
    rows = percuss.stability(percuss.load(case), by=("linear-laws", "black-box"))
    assert [row["courant_critical"] is None for row in rows] == [False, True]
    assert all("the mass reciprocal, which couples nodes" in row["reason"] for row in rows[1:])
    with pytest.raises(percuss.PercussError, match="waves are measured with diagonal masses"):
        waves(model_of(percuss.load(case)))


def test_bars_whose_ends_it_couples_are_refused_where_something_acts():
    case = hunek(1)
    case["bodies"]["long"]["bar"]["elements"] = 1
    case["method"]["mass"] = "reciprocal"
    with pytest.raises(percuss.InputError, match="expected more than 1 elements in body 'long', found 1"):
        ran(case)
    del case["bodies"]["long"]["fixed"]
    result = ran(case, {"time.courant": 0.3})  # contact alone may couple the ends
    assert result.arrays["contact_force"].max() > 0.0
    assert result.summary["energy"]["ledger_error"] < 1e-12


# --------------------------------------------------------------------------------- matrices of held and tied ends


@pytest.mark.parametrize(("consistency", "courant"), [(-1.5, 1.3), (-1.5, 0.4), (1.0, 0.5), (1.0, 0.9)])
def test_the_stiffness_limit_of_a_contact_is_that_of_dense_matrices(consistency, courant):
    """1 / sum of 1/r of both sides, r the dynamic stiffness of a free body at its end, at most at 0.99 of its limit."""
    from percuss.march.model_of_case import model_of

    case = hunek(8, courant=courant, contact={"name": "penalty", "beta_s": 0.1})
    del case["bodies"]["long"]["fixed"]
    case["method"]["mass"] = {"name": "reciprocal", "consistency": consistency}
    model = model_of(percuss.load(case))
    bars, softness = assemble(case), 0.0
    mass = np.linalg.inv(reciprocal_inverse(bars, consistency))
    for name, end in (("short", -1), ("long", 0)):
        nodes = slice(bars.start[name], bars.stop[name])
        body, stiffness = mass[nodes, nodes], bars.K[nodes, nodes]
        step = min(model.dt, 0.99 * 2.0 / math.sqrt(eigh(stiffness, body, eigvals_only=True)[-1]))
        softness += np.linalg.inv(4.0 / step**2 * body - stiffness)[end, end]
    assert points_of_law(model, [0], model.dt).stiffness_limit == pytest.approx([1.0 / softness], rel=1e-8)


SOURCE = '''
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from percuss import Mass


@dataclass(frozen=True)
class Mine(Mass):
    """A mass of a test.

    Formula: as it says.
    """

    name = "mine"
    summary = "a mass of a test"
    references = ("none",)

    def nodal(self, element_mass, lumping):
        return lumping.at_nodes(element_mass)

    def inverse(self, element_mass, lumping):
        lumped = lumping.at_nodes(element_mass)
        full = np.diag(lumped)
{body}
        full = full / np.outer(lumped, lumped)
        found = csr_array(full + np.tril(full, -1).T)
        return {answer}
'''


PENTADIAGONAL = """
        second = np.zeros((lumped.size - 2, lumped.size))
        for i in range(lumped.size - 2):
            second[i, i : i + 3] = 1.0, -2.0, 1.0
        full = full + np.tril(0.1 * element_mass.mean() * second.T @ second)
"""


def plugin(tmp_path, body="", answer="found"):
    path = tmp_path / "mine.py"
    path.write_text(SOURCE.format(body=body, answer=answer))
    return path


def test_an_inverse_of_five_diagonals_moves_bars_as_dense_matrices_do(tmp_path):
    case = hunek(7, courant=0.2)
    case["bodies"]["short"]["bar"]["grading"] = 0.5
    case["loads"] = {"push": {"constant": 0.02, "on": "short.left"}, "weight": {"gravity": 0.1}}
    case["method"]["mass"] = "mine"

    def mass(bars):
        lumped, total = np.diag(bars.M), bars.M.copy()
        for name, lengths in bars.lengths.items():
            given, nodes = bars.given[name], slice(bars.start[name], bars.stop[name])
            second = np.diff(np.eye(lengths.size + 1), 2, axis=0)
            element = given["material"]["density"] * given["area"] * lengths
            total[nodes, nodes] += 0.1 * element.mean() * second.T @ second
        return np.linalg.inv(total / np.outer(lumped, lumped))

    loaded = percuss.load(case, plugins=[plugin(tmp_path, PENTADIAGONAL)])
    result = percuss.run(loaded, compiled=False)
    dense = dense_march(case, mass=mass)
    assert dense.force.max() > 0.01
    assert np.abs(result.arrays["contact_force"] - dense.force).max() < 1e-10
    ends = [dense.bars.node(probe) for probe in case["record"]["probes"]]
    assert np.abs(result.arrays["displacement"][..., 0] - dense.u[:, ends]).max() < 1e-10
    assert result.summary["energy"]["ledger_error"] < 1e-12
    held = np.delete(np.arange(dense.bars.x.size), dense.bars.node("long.right"))
    full = dense.bars.M[np.ix_(held, held)]
    free = 2.0 / math.sqrt(eigh(dense.bars.K[np.ix_(held, held)], full, eigvals_only=True)[-1])
    assert result.summary["certificate"]["dt_critical_free"] == pytest.approx(free, rel=1e-9)
