"""Masses that couple nodes, and ends in contact without mass: dense matrices, dispersion, exact and published figures.

`reciprocal` gives the inverse of a mass matrix that couples nodes; `redistributed` moves the mass of an end in contact
to the rest of its body.
"""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh, null_space
from scipy.sparse import csr_array

import against_dense
import dense
import percuss
from against_dense import LEAP_FROG
from amplification import Bodies, radius
from formulas import SCHEMES
from marks import deep
from percuss import Lumping
from percuss.certificate.verdict import certificate
from percuss.certificate.waves import waves
from percuss.contact.laws import points_of_law
from percuss.march.model_of_case import model_of
from percuss_methods.masses.reciprocal import Reciprocal
from percuss_methods.masses.redistributed import LEAST_SHARE, Redistributed
from strategies import hunek, nudged, turned, with_methods

DEEP = pytest.mark.deep
LAWS_OF_COUPLED = (
    {"name": "penalty", "beta_s": 0.7},
    {"name": "bipenalty", "beta_s": 1.5, "ratio": "matched"},
    {"name": "bipenalty", "beta_s": 0.25, "ratio": 1.0},
    {"name": "lagrange"},
)
LAWS_WITHOUT_MASS = (
    {"name": "penalty", "beta_s": 0.7},
    {"name": "penalty", "epsilon_s": 3.0},
    {"name": "regularised-lagrange", "beta_s": 2.0},
    {"name": "lagrange"},
)
CONSISTENCIES = (1.0, 0.375, -0.5, -1.5)
TO_NEIGHBOUR = {"name": "redistributed", "moved_to": "neighbour"}


def ran(case, overrides=None, registry=None):
    return percuss.run(percuss.load(case, registry=registry), overrides, compiled=False)


def with_mass(mass, *args, **options):
    """Return the case of Huněk with a mass."""
    case = hunek(*args, **options)
    case["method"]["mass"] = mass
    return case


def reciprocal(consistency):
    return {"name": "reciprocal", "consistency": consistency}


def shipped(name, end=None, **method):
    changes = {f"method.{key}": value for key, value in method.items()} | ({"time.end": end} if end else {})
    return percuss.run(percuss.load(f"cases/{name}.yaml"), changes)


# --------------------------------------------------------------------------------------------- matrices of the masses


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


@pytest.mark.parametrize("consistency", CONSISTENCIES)
def test_bands_are_those_of_the_element_matrices(consistency):
    bar = {"bar": {"length": 3.0, "elements": 9, "grading": 0.2}, "area": 1.5}
    bars = dense.assemble({"bodies": {"a": bar | {"material": {"young": 1.0, "density": 0.7}}}})
    element_mass = 0.7 * 1.5 * bars.lengths["a"]
    found = Reciprocal(consistency=consistency).inverse(element_mass, Lumping.of_line(9)).toarray()
    expected = reciprocal_inverse(bars, consistency)
    assert found == pytest.approx(expected, rel=1e-13, abs=1e-13 * np.abs(expected).max())
    assert (found == found.T).all()
    assert np.abs(np.triu(found, 2)).max() == 0.0
    assert np.linalg.eigvalsh(expected).min() > 0.0
    # A body that moves as a whole has its mass: C m = 1.
    assert expected @ np.diag(bars.M) == pytest.approx(np.ones(10), rel=1e-13)


@pytest.mark.parametrize("consistency", [*CONSISTENCIES, 0.0])
def test_waves_have_the_frequencies_of_the_dispersion_relation(consistency):
    """(omega h / c)^2 = 2 z + (s - 1) z^2, with z = 1 - cos(kappa h) and s = 1 / (1 - 2 b / 3)."""
    count = 40
    bars = dense.assemble({"bodies": {"a": {"bar": {"length": float(count), "elements": count}, "area": 1.0,
                                            "material": {"young": 1.0, "density": 1.0}}}})  # fmt: skip
    inverse = reciprocal_inverse(bars, consistency)
    s = 1.0 / (1.0 - 2.0 * consistency / 3.0)
    for k in (1, 7, 20, 33, count):
        wave = np.cos(np.pi * k * np.arange(count + 1) / count)
        z = 1.0 - math.cos(math.pi * k / count)
        # The ends are half elements of the same periodic row, so that standing waves are exact there too.
        assert inverse @ bars.K @ wave == pytest.approx((2.0 * z + (s - 1.0) * z**2) * wave, abs=1e-12)


def redistributed(bars, case, to):
    """Return the nodal masses of a row of bars, one body after the other, with those of ends in contact moved."""
    mass = np.diag(bars.M).copy()
    sides = [side for one in case["contacts"].values() for side in one.get("between", [one.get("body")])]
    busy = {load.get("on") for load in case.get("loads", {}).values()}
    busy |= {f"{name}.{end}" for name, body in case["bodies"].items() for end in body.get("fixed", ())}
    empty = sorted({bars.node(side) for side in sides if side not in busy})
    for name in case["bodies"]:
        nodes = np.arange(bars.start[name], bars.stop[name])
        ends = [node for node in nodes if node in empty]
        if len(ends) == nodes.size:  # an element between two contacts keeps its mass
            empty = [node for node in empty if node not in ends]
        elif ends and to == "neighbour":
            for node in ends:
                mass[node + 1 if node == nodes[0] else node - 1] += mass[node]
            mass[ends] = 0.0
        elif ends:
            rest = np.setdiff1d(nodes, ends)
            for moments in range(min(3, rest.size), 0, -1):
                # The nearest masses relative to the lumped ones, by the equations of Lagrange's multipliers.
                powers = (bars.x[nodes] - bars.x[nodes].mean()) ** np.arange(moments)[:, None]
                at = rest - nodes[0]
                system = np.zeros((rest.size + moments,) * 2)
                system[: rest.size, : rest.size] = np.diag(1.0 / mass[rest])
                system[: rest.size, rest.size :], system[rest.size :, : rest.size] = powers[:, at].T, powers[:, at]
                right = np.append(np.zeros(rest.size), powers[:, np.array(ends) - nodes[0]] @ mass[ends])
                moved = np.linalg.solve(system, right)[: rest.size]
                if (mass[rest] + moved >= 0.5 * mass[rest]).all():
                    break
            mass[rest] += moved
            mass[ends] = 0.0
    return mass, empty


@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    st.lists(st.floats(0.05, 2.0), min_size=1, max_size=40), st.sampled_from([(1, 0), (0, 1), (1, 1)]), st.booleans()
)
def test_moved_mass_keeps_the_moments_that_it_promises(element_mass, ends, to_neighbour):
    element_mass = np.array(element_mass)
    line = Lumping.of_line(element_mass.size)
    first, last = map(bool, ends)
    method = Redistributed(moved_to="neighbour" if to_neighbour else "body")
    in_contact = np.array([first, *[False] * (element_mass.size - 1), last])
    lumped, mass = method.nodal(element_mass, line), method.nodal_in_contact(element_mass, line, in_contact)
    mirrored = method.nodal_in_contact(element_mass[::-1], line, in_contact[::-1])
    assert mass == pytest.approx(mirrored[::-1], rel=1e-9)
    if element_mass.size == 1 and first and last:
        assert (mass == lumped).all()
        return
    assert ((mass == 0.0) == [first, *[False] * (mass.size - 2), last]).all()
    assert mass.sum() == pytest.approx(element_mass.sum(), rel=1e-12)
    position = np.append(0.0, np.cumsum(element_mass)) / element_mass.sum()
    kept = [abs((mass - lumped) @ position**power) < 1e-10 * element_mass.sum() for power in range(3)]
    if to_neighbour:
        assert (mass[2:-2] == lumped[2:-2]).all()
        return
    inner = mass > 0.0
    share = mass[inner] / lumped[inner] - 1.0
    assert share.min() >= LEAST_SHARE - 1.0 - 1e-12
    moments = max(power + 1 for power in range(3) if all(kept[: power + 1]))
    # A polynomial of fewer coefficients than moments are kept is the nearest relative change, by its normal equations.
    powers = np.vander(position[inner], min(moments, inner.sum()))
    assert share == pytest.approx(powers @ np.linalg.lstsq(powers, share, rcond=None)[0], abs=1e-8)
    if element_mass.min() > 0.8 and element_mass.max() < 1.2 and element_mass.size >= 5 and not (first and last):
        assert moments == 3


# -------------------------------------------------------------------------------------------- against dense matrices


def runs_as(case, march):
    """Hold a run against a march, where round-off does not decide about openings; return both."""
    force, gap, u, bars = march(case)
    peak, scale = np.abs(force).max(), np.abs(u).max()
    assume(0.0 < peak < 1e3)
    assume(np.abs(march(nudged(case, 1e-12))[0] - force).max() < 1e-8 * peak)
    result = ran(case)
    assert np.abs(result.arrays["contact_force"] - force).max() < 1e-7 * peak
    assert np.abs(result.arrays["gap"] - gap).max() < 1e-8 * max(scale, np.abs(gap).max())
    ends = [bars.node(probe) for probe in case["record"]["probes"]]
    assert np.abs(result.arrays["displacement"][..., 0] - u[:, ends]).max() < 1e-8 * scale
    summary = result.summary
    if summary["certificate"]["stable"] == "yes":
        assert summary["energy"]["ledger_error"] < 1e-12
        assert summary["momentum"]["error"] < 1e-12
        assert summary["energy_growth"]["kept"] is not False
    return result


@DEEP
@settings(max_examples=12, deadline=None, derandomize=True, phases=(Phase.generate,))
@given(against_dense.rows(LAWS_OF_COUPLED, 2, ("wall", "fixed", "loaded", "driven")), st.sampled_from(CONSISTENCIES))
def test_rows_of_coupled_masses_move_as_dense_matrices_move_them(case, consistency):
    case["method"]["mass"], found = reciprocal(consistency), []

    def march(case):
        found.append(dense.march(case, mass=reciprocal_mass(consistency)))
        return found[-1].force, found[-1].gap, found[-1].u, found[-1].bars

    result, expected = runs_as(case, march), found[0].energy
    energy = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
    assert np.abs(energy - expected).max() < 1e-9 * expected.max()
    assert result.summary["energy"]["ledger_error"] < 1e-12
    assert result.summary["momentum"]["error"] < 1e-12


def march_without_mass(case, to):
    """March a row of bars with full matrices; return the forces, the gaps and the displacements of all steps."""
    system, law = dense.System(case), case["method"]["contact"]
    bars, N, g0, held = system.bars, system.N, system.g0, system.driven
    mass, empty = redistributed(bars, case, to)
    count, total, force = len(case["contacts"]), mass.size, system.force(0.0)
    full = np.setdiff1d(np.arange(total), empty)
    explicit, sigma = np.full(count, law["name"] == "penalty"), np.zeros(count)
    if law["name"] != "lagrange":
        softer = [min(bars.end(end)[0] for end in ends) for ends in system.ends]
        sigma = 1.0 / np.array([law["epsilon_s"] if "epsilon_s" in law else law["beta_s"] * one for one in softer])
    balanced = np.array([bool(np.abs(N[empty, k]).any()) for k in range(count)], dtype=bool)
    yielding = np.linalg.inv(bars.K[np.ix_(empty, empty)]) if empty else np.zeros((0, 0))
    inverse = np.zeros(total)
    inverse[full] = 1.0 / mass[full]
    inverse[held] = 0.0
    dt = case["time"]["courant"] / max(system.fastest.values())

    def closing(matrix, gaps, sigma):
        matrix = matrix + np.diag(sigma)
        assume(
            not gaps.size or np.linalg.cond(matrix) < 1e8
        )  # else forces of contacts that hold the same end are not unique
        return dense.complementary(matrix, gaps)

    u, v, known = np.zeros(total), bars.v - 0.5 * dt * inverse * force, np.zeros(count)
    v[held] = 0.0
    histories = [], [], []
    for _ in range(case["time"]["steps"] + 1):
        gap = g0 + N.T @ u
        pushed = v + dt * inverse * (force - bars.K @ u + N @ np.where(balanced, known, 0.0))
        predicted = g0 + N.T @ (u + dt * pushed)
        multiplier, direct = np.where(balanced, known, 0.0), ~balanced
        if direct.any():
            S = N[:, direct].T @ (inverse[:, None] * N[:, direct])
            judged = gap if case["method"]["integrator"] == "central-difference" else predicted
            if explicit.any():
                multiplier[direct] = np.maximum(-judged[direct], 0.0) / sigma[direct]
            else:
                multiplier[direct] = closing(dt**2 * S, predicted[direct], sigma[direct])
        pushed = pushed + dt * inverse * (N @ np.where(balanced, 0.0, multiplier))
        after = u + dt * pushed
        # Static balance of the ends without mass: K_00 u_0 + K_01 u_1 = N_0 lambda.
        free = -yielding @ bars.K[np.ix_(empty, full)] @ after[full]
        after[empty] = free
        known = np.zeros(count)
        if balanced.any():
            N0 = N[np.ix_(empty, np.flatnonzero(balanced))]
            known[balanced] = closing(N0.T @ yielding @ N0, (g0 + N.T @ after)[balanced], sigma[balanced])
            after[empty] = free + yielding @ N0 @ known[balanced]
        for history, values in zip(histories, (multiplier, gap, u), strict=True):
            history.append(values.copy())
        u, v = after, (after - u) / dt
    return *map(np.array, histories), bars


@DEEP
@settings(max_examples=12, deadline=None, derandomize=True, phases=(Phase.generate,))  # shrinking takes minutes
@given(against_dense.rows(LAWS_WITHOUT_MASS, 1, ("wall", "fixed", "loaded")), st.sampled_from(["body", "neighbour"]))
def test_rows_of_ends_without_mass_move_as_dense_matrices_move_them(case, to):
    case["method"]["mass"] = {"name": "redistributed", "moved_to": to}
    runs_as(case, lambda case: march_without_mass(case, to))


@pytest.mark.parametrize("scheme", ["velocity-verlet", "noh-bathe"])
def test_stages_accelerate_as_dense_matrices_do(scheme):
    """Contact by a penalty, gravity, a load on an end and a held end, in the stages of a scheme."""
    case = with_mass(reciprocal(0.8), 6, integrator=scheme, contact={"name": "penalty", "beta_s": 0.7})
    case["bodies"]["short"]["bar"]["grading"] = 0.4
    case["loads"] = {"weight": {"gravity": 0.3}, "push": {"constant": 0.01, "on": "short.left"}}
    case["time"] = {"steps": 90, "courant": 0.2}
    result = ran(case)
    bars, u, _ = dense.march_stages(case, SCHEMES[scheme], 90, result.summary["dt"], mass=reciprocal_mass(0.8))
    expected = u[:, [bars.node(probe) for probe in case["record"]["probes"]]]
    assert result.arrays["contact_force"].max() > 0.0
    assert np.abs(result.arrays["displacement"][..., 0] - expected).max() < 1e-10 * np.abs(expected).max()
    assert result.summary["momentum"]["error"] < 1e-12


@dataclass(frozen=True)
class FiveDiagonals(percuss.Mass):
    """A mass of a test. Formula: as it says."""

    name = "mine"
    summary = "a mass of a test"
    references = ("none",)

    def nodal(self, element_mass, lumping):
        return lumping.at_nodes(element_mass)

    def inverse(self, element_mass, lumping):
        lumped = lumping.at_nodes(element_mass)
        second = np.diff(np.eye(lumped.size), 2, axis=0)
        full = np.diag(lumped) + 0.1 * element_mass.mean() * second.T @ second
        return csr_array(full / np.outer(lumped, lumped))


def test_an_inverse_of_five_diagonals_moves_bars_as_dense_matrices_do():
    case = with_mass("mine", 7, courant=0.2)
    case["bodies"]["short"]["bar"]["grading"] = 0.5
    case["loads"] = {"push": {"constant": 0.02, "on": "short.left"}, "weight": {"gravity": 0.1}}

    def mass(bars):
        lumped, total = np.diag(bars.M), bars.M.copy()
        for name, lengths in bars.lengths.items():
            given, nodes = bars.given[name], slice(bars.start[name], bars.stop[name])
            second = np.diff(np.eye(lengths.size + 1), 2, axis=0)
            element = given["material"]["density"] * given["area"] * lengths
            total[nodes, nodes] += 0.1 * element.mean() * second.T @ second
        return np.linalg.inv(total / np.outer(lumped, lumped))

    result = percuss.run(percuss.load(case, registry=with_methods(FiveDiagonals)), compiled=False)
    expected = dense.march(case, mass=mass)
    assert expected.force.max() > 0.01
    assert np.abs(result.arrays["contact_force"] - expected.force).max() < 1e-10
    ends = [expected.bars.node(probe) for probe in case["record"]["probes"]]
    assert np.abs(result.arrays["displacement"][..., 0] - expected.u[:, ends]).max() < 1e-10
    assert result.summary["energy"]["ledger_error"] < 1e-12
    system = dense.System(case, mass=mass)
    stiffness = system.bars.K[np.ix_(system.free, system.free)]
    free = 2.0 / math.sqrt(eigh(stiffness, system.Mf, eigvals_only=True)[-1])
    found = certificate(model_of(percuss.load(case, registry=with_methods(FiveDiagonals))))
    assert found["dt_critical_free"] == pytest.approx(free, rel=1e-9)


# -------------------------------------------------------------------------------------------------------- stability


def of_unlike_bars(mass, law, integrator="central-difference"):
    case = with_mass(mass, 7, integrator=integrator, contact=dict(law), courant=0.2)
    case["bodies"]["short"] |= {"area": 2.0, "bar": {"length": 10.0, "elements": 7, "grading": 0.3}}
    return case


@pytest.mark.parametrize("consistency", [1.0, deep(-1.5)])
@pytest.mark.parametrize("law", [LAWS_OF_COUPLED[0], *map(deep, LAWS_OF_COUPLED[1:]), {"name": "tied"}])
@pytest.mark.parametrize("integrator", [LEAP_FROG[0], deep(LEAP_FROG[1])])
def test_the_critical_step_of_coupled_masses_is_that_of_dense_matrices(consistency, law, integrator):
    case = of_unlike_bars(reciprocal(consistency), law, integrator)
    found = certificate(model_of(percuss.load(case)))
    bodies = Bodies(case, reciprocal_mass(consistency))
    motions = null_space(bodies.Nf.T) if law["name"] == "tied" else np.eye(bodies.free.size)  # a tie is never open
    stiffness = bodies.bars.K[np.ix_(bodies.free, bodies.free)]
    tops = eigh(motions.T @ stiffness @ motions, motions.T @ bodies.Mf @ motions, eigvals_only=True)
    free, critical = 2.0 / math.sqrt(tops[-1]), found["dt_critical"]
    assert found["dt_critical_free"] == pytest.approx(free, rel=1e-10)
    assert found["by"] == "linear-laws"
    assert critical <= free * (1.0 + 1e-9)
    for share in (0.3, 0.6, 0.9, 0.99, 0.9999):
        assert radius(bodies, integrator, share * critical, bodies.fixed, [0]) <= 1.0 + 1e-7
    assert 1.001 * critical > free or radius(bodies, integrator, 1.001 * critical, bodies.fixed, [0]) > 1.0 + 1e-7


@pytest.mark.parametrize("law", [*LAWS_WITHOUT_MASS, {"name": "tied"}])
@pytest.mark.parametrize("to", ["body", deep("neighbour")])
def test_the_critical_step_without_mass_at_ends_is_that_of_dense_matrices(to, law):
    case = of_unlike_bars({"name": "redistributed", "moved_to": to}, law)
    found = certificate(model_of(percuss.load(case)))
    system = dense.System(case)
    bars, (normal,) = system.bars, system.N.T
    mass, empty = redistributed(bars, case, to)
    assert set(empty) == set(np.flatnonzero(normal))
    steps = []
    for closed in (False, True):
        stiffness = bars.K.copy()
        if closed:  # a rigid contact is a very stiff one
            softer = min(bars.end("short.right")[0], bars.end("long.left")[0])
            spring = law.get("epsilon_s", law.get("beta_s", 1e9) * softer)
            stiffness += spring * np.outer(normal, normal)
        full = np.setdiff1d(np.arange(mass.size), [*empty, bars.node("long.right")])
        inside, across = stiffness[np.ix_(empty, empty)], stiffness[np.ix_(empty, full)]
        condensed = stiffness[np.ix_(full, full)] - across.T @ np.linalg.solve(inside, across)
        steps.append(2.0 / math.sqrt(eigh(condensed, np.diag(mass[full]), eigvals_only=True)[-1]))
    assert found["dt_critical_free"] == pytest.approx(steps[0], rel=1e-9)
    assert found["dt_critical"] == pytest.approx(min(steps), rel=1e-8)
    assert found["by"] == "linear-laws"


@pytest.mark.parametrize(("consistency", "courant"), [(-1.5, 1.3), (-1.5, 0.4), (1.0, 0.5), (1.0, 0.9)])
def test_the_stiffness_limit_of_a_contact_is_that_of_dense_matrices(consistency, courant):
    """1 / sum of 1/r of both sides, r the dynamic stiffness of a free body at its end, at most at 0.99 of its limit."""
    case = with_mass(reciprocal(consistency), 8, courant=courant, contact={"name": "penalty", "beta_s": 0.1})
    del case["bodies"]["long"]["fixed"]
    model = model_of(percuss.load(case))
    bars, softness = dense.assemble(case), 0.0
    mass = reciprocal_mass(consistency)(bars)
    for name, end in (("short", -1), ("long", 0)):
        nodes = slice(bars.start[name], bars.stop[name])
        body, stiffness = mass[nodes, nodes], bars.K[nodes, nodes]
        step = min(model.dt, 0.99 * 2.0 / math.sqrt(eigh(stiffness, body, eigvals_only=True)[-1]))
        softness += np.linalg.inv(4.0 / step**2 * body - stiffness)[end, end]
    assert points_of_law(model, [0], model.dt).stiffness_limit == pytest.approx([1.0 / softness], rel=1e-8)


@dataclass(frozen=True)
class DashpotBehind(percuss.ContactLaw):
    """A spring and a dashpot. Formula: ``lambda = -eps_s (g + tau g')``."""

    name = "dashpot-behind"
    summary = "Spring and dashpot"

    def bind(self, points, dt):
        return percuss.LinearLaw(at="explicit", sigma=2.0 / points.stiffness, rate=2.0 * dt)


COUPLED = "the mass reciprocal, which couples nodes, is examined only with linear laws"
UNKNOWN = [
    ("reciprocal", {"method.contact": "uzawa"}, COUPLED, "has a kernel of its own"),
    (
        "reciprocal",
        {"method.integrator": "viscous-central-difference", "method.contact": "penalty"},
        COUPLED,
        "viscous",
    ),
    (
        "reciprocal",
        {"method.integrator": "noh-bathe", "method.contact": "lagrange"},
        COUPLED,
        "end of a step of stages",
    ),
    ("reciprocal", {"loads": {"end": {"absorbing": {}, "on": "short.right"}}}, COUPLED, "in contact"),
    ("redistributed", {"method.contact": "dashpot-behind"}, "", "weighs the gap rate"),
]


@pytest.mark.parametrize(("mass", "change", "first", "reason"), UNKNOWN)
def test_what_only_the_black_box_could_tell_is_unknown(mass, change, first, reason):
    case = with_mass(mass, 5, courant=0.3, end=0.05)
    registry = with_methods(DashpotBehind)
    summary = ran(case, change, registry).summary
    found = summary["certificate"]
    assert (found["stable"], found["dt_critical"]) == ("unknown", None)
    assert first in found["why"]
    assert reason in found["why"]
    with pytest.raises(percuss.InputError, match="which couples nodes" if first else reason):
        ran(case, change | {"time.courant": "auto"}, registry)
    if mass == "redistributed":
        assert summary["energy"]["ledger_error"] < 1e-13
        assert summary["energy"]["contact_work"] < 0.0


@pytest.mark.parametrize(
    ("mass", "law", "why", "of_waves"),
    [
        ("reciprocal", "penalty", COUPLED[:37], "waves are measured with diagonal masses"),
        *(("redistributed", law, "ends without mass are examined only with linear laws in gap or gap rate",
           "waves are measured of ends with mass") for law in ("moreau-jean", "penalty")),
    ],
)  # fmt: skip
def test_criteria_that_do_not_cover_a_mass_say_so(mass, law, why, of_waves, capfd):
    case = percuss.load(with_mass(mass, 5, integrator="central-difference", contact={"name": law}))
    (row,) = percuss.stability(case, by=("black-box",))
    assert row["courant_critical"] is None
    assert why in row["reason"]
    assert capfd.readouterr() == ("", "")
    with pytest.raises(percuss.PercussError, match=of_waves):
        waves(model_of(case))


def test_the_critical_step_of_a_hundred_elements():
    """The share that the docstring tells."""
    case = percuss.load("cases/doyen-impact.yaml", {"method.mass": "redistributed", "method.contact": "lagrange"})
    assert round(certificate(model_of(case))["courant_critical"], 4) == 0.9963


# -------------------------------------------------------------------------------------------------------- identities


def test_without_consistency_it_is_lumped_to_the_last_bit():
    case = hunek(12)
    lumped, none, nearly = (
        percuss.run(percuss.load(case), {"method.mass": mass}) for mass in ("lumped", reciprocal(0.0), reciprocal(1e-9))
    )
    for name in ("contact_force", "gap", "displacement", "kinetic_energy"):
        assert (lumped.arrays[name] == none.arrays[name]).all()
    # With hardly any it is nearly that, by the way of all masses that couple nodes.
    assert 0.0 < np.abs(nearly.arrays["displacement"] - lumped.arrays["displacement"]).max() < 1e-8


@pytest.mark.parametrize(
    ("mass", "contact"), [(reciprocal(0.7), {"name": "bipenalty", "beta_s": 0.5}), ("redistributed", "lagrange")]
)
def test_a_row_that_is_turned_in_the_plane_moves_as_on_the_line(mass, contact):
    case = with_mass(mass, 6, contact=contact)
    case["loads"] = {"push": {"constant": 0.02, "on": "short.left"}}
    line, plane = ran(case), ran(turned(case, [0.6, 0.8]))
    assert np.abs(plane.arrays["contact_force"] - line.arrays["contact_force"]).max() < 1e-12
    along = plane.arrays["displacement"] @ np.array([0.6, 0.8])
    assert np.abs(along - line.arrays["displacement"][..., 0]).max() < 1e-12
    assert plane.summary["energy"]["ledger_error"] < 1e-12


PLASTIC = {"name": "bilinear-plastic", "young": 100.0, "density": 0.01, "yield_stress": 0.02}
SHAKE = {"harmonic": {"value": 0.2, "frequency": 3.0}, "on": "long.right", "as": "velocity", "from": 0.1, "until": 0.3}
DASHPOT_ON_END = {"spring-dashpot": {"stiffness": 3.0, "damping": 0.4}, "on": "short.left"}
HELD_ON = {"loads": {"push": {"prescribed-velocity": 0.05, "on": "long.left"}}, "method.contact": "lagrange"}
BESIDE = [
    ("reciprocal", {"method.integrator": "viscous-central-difference", "method.contact": "penalty"}),
    ("reciprocal", {"bodies.long.element": "green-bar"}),
    ("reciprocal", {"bodies.short.material": PLASTIC}),
    ("reciprocal", {"loads": {"end": {"absorbing": {}, "on": "short.left"}}}),
    ("reciprocal", {"loads": {"end": DASHPOT_ON_END}}),
    ("reciprocal", {"method.contact": "uzawa"}),
    ("reciprocal", {"method.contact": "hunt-crossley"}),
    ("reciprocal", {"loads": {"shake": SHAKE}, "bodies.long.fixed": []}),
    ("reciprocal", {"bodies.long.bar.elements": 1, "bodies.long.fixed": []}),  # contact alone may couple its two ends
    ("redistributed", HELD_ON),  # a held end in contact keeps its mass, and is met by one without
]


@pytest.mark.parametrize(("mass", "change"), [row if k >= 8 else deep(*row) for k, row in enumerate(BESIDE)])
def test_other_methods_balance_with_it(mass, change):
    """Viscosity, bodies that are not linear, loads that follow the motion, laws with a kernel, drives, held ends."""
    mass = reciprocal(0.9) if mass == "reciprocal" else mass
    result = ran(with_mass(mass, 10, courant=0.3, end=0.5), change)
    assert result.arrays["contact_force"].max() > 0.0
    assert result.summary["energy"]["ledger_error"] < 1e-12
    assert result.summary["momentum"]["error"] < 1e-12


@pytest.mark.parametrize("law", LAWS_WITHOUT_MASS, ids=lambda law: "-".join(map(str, law.values())))
@pytest.mark.parametrize("name", ["doyen-impact", "unlike", *map(deep, ("hunek", "carpenter"))])
def test_the_ledger_closes_and_both_integrators_are_one_method(name, law):
    results = [shipped(name, mass="redistributed", integrator=integrator, contact=law) for integrator in LEAP_FROG]
    for result in results:
        summary = result.summary
        assert summary["energy"]["ledger_error"] < 1e-13
        assert summary["momentum"]["error"] < 1e-12
        assert summary["energy_growth"]["kept"] is True
        assert summary["certificate"]["stable"] == "yes"
        assert summary["certificate"]["energy"] == "conserved between switchings"
    for history in ("contact_force", "gap", "displacement", "kinetic_energy", "elastic_energy", "contact_work"):
        assert (results[0].arrays[history] == results[1].arrays[history]).all()


def test_a_run_goes_on_where_a_drive_changes_and_again_from_its_beginning():
    """The coming force is part of the state: a second stretch continues with it."""
    case = with_mass("redistributed", 6, integrator="central-difference", contact={"name": "lagrange"}, end=0.3)
    hold = {"prescribed-velocity": 0.0, "on": "long.right", "from": 0.1}
    held, driven = ran(case), ran(case, {"loads": {"hold": hold}, "bodies.long.fixed": []})
    early = held.arrays["time"] < 0.2  # no wave comes back from the far end
    assert np.abs((held.arrays["contact_force"] - driven.arrays["contact_force"])[early]).max() < 1e-15
    assert driven.summary["energy"]["ledger_error"] < 1e-13


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
    case = percuss.load("cases/smooth-pulse.yaml", {"time.courant": 0.5, "method.contact": "lagrange"})
    lumped, best, most = (
        percuss.run(case, {"method.mass": mass}).summary["exact"]["contacts"]["joint"]["force_error_l1"]
        for mass in ("lumped", reciprocal(0.3), reciprocal(1.0))
    )
    assert best < lumped / 10.0
    assert most > 5.0 * lumped  # the element matrices as they are make waves faster than lumped ones slow them


@pytest.mark.parametrize("mass", ["redistributed", TO_NEIGHBOUR])
def test_ten_bounces_keep_as_much_energy_as_published_figures_say(mass):
    """Of 500, the work of the weight on the way down: .98 with exact contact, .999 with a spring behind the end."""
    for law, expected, within in (
        ({"name": "lagrange"}, 0.98, 0.005),
        ({"name": "penalty", "beta_s": 0.25}, 0.9997, 1e-4),
    ):
        result = shipped("doyen-bounce", 10 * 16 / 3, mass=mass, integrator="central-difference", contact=law)
        assert 1.0 + result.summary["energy"]["contact_work"] / 500.0 == pytest.approx(expected, abs=within)
        # Two periods of the bar have two contacts of the same impulse: the weight over the time, but for what is lost.
        assert result.summary["contacts"]["foot"]["impulse"] == pytest.approx(1000.0 * 16 / 3, rel=0.01)


def test_the_force_converges_with_the_mesh():
    case = percuss.load("cases/doyen-impact.yaml", {"method.mass": "redistributed", "method.contact": "lagrange"})
    errors = np.array([
        percuss.run(case, {"refine": refine}).summary["exact"]["contacts"]["foot"]["force_error_l1"]
        for refine in (1, 2, 4, 8)
    ])  # fmt: skip
    assert (errors[1:] < 0.65 * errors[:-1]).all()


def test_the_force_of_an_impact_does_not_oscillate():
    """A force of 300 for 2/3: the penalty at an end with mass rings throughout, what an end without mass keeps is a
    wave of dispersion behind the front."""
    noise, late = {}, {}
    for mass, law in (("redistributed", {"name": "lagrange"}), ("lumped", {"name": "penalty", "beta_s": 2.0})):
        result = shipped("doyen-impact", mass=mass, integrator="central-difference", contact=law)
        force, time = result.arrays["contact_force"][:, 0], result.arrays["time"]
        noise[mass] = np.abs(np.diff(force)).sum() / 600.0  # up to 300 and down again
        late[mass] = np.abs(force[(time > 0.2) & (time < 0.6)] - 300.0).max() / 300.0
        if mass == "redistributed":
            assert result.summary["exact"]["contacts"]["foot"]["force_error_l1"] < 0.016
            assert result.summary["contacts"]["foot"]["impulse"] == pytest.approx(200.0, rel=0.005)
    assert noise["redistributed"] < 1.3
    assert late["redistributed"] < 0.01
    assert noise["lumped"] > 5.0
    assert late["lumped"] > 10.0 * late["redistributed"]


# --------------------------------------------------------------------------------------------------------- refusals

VISCOUS = "viscous-central-difference gives no internal forces that follow from the strain alone"
REFUSED = [
    ("redistributed", {"method.contact": "bipenalty"}, "redistributed.*weighs the gap acceleration"),
    ("redistributed", {"method.integrator": "viscous-central-difference"}, f"redistributed.*{VISCOUS}"),
    ("redistributed", {"method.contact": "uzawa"}, "redistributed.*its kernel takes the gap as given"),
    ("redistributed", {"method.integrator": "velocity-verlet", "method.contact": "penalty"},
     "redistributed.*in the stages"),
    ("redistributed", {"bodies.long.element": "green-bar"}, "expected linear bodies.*green-bar"),
    ("redistributed", {"bodies.long.element": "quadratic-bar"}, "expected elements of two nodes at ends in contact"),
    ("reciprocal", {"bodies.long.bar.elements": 1}, "expected more than 1 elements in body 'long', found 1"),
]  # fmt: skip


@pytest.mark.parametrize(("mass", "change", "reason"), REFUSED)
def test_what_a_mass_cannot_do_is_refused(mass, change, reason):
    case = with_mass(mass, 4, integrator="central-difference", contact="lagrange")
    with pytest.raises((percuss.RefusedPair, percuss.InputError), match=f"(?s){reason}"):
        ran(case, change)
