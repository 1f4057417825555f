"""Ends in contact without mass: against dense matrices, exact solutions, published figures and identities."""

import copy
import itertools
import math

import numpy as np
import pytest
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh

import percuss
from dense import System, assemble
from percuss import Lumping
from percuss.certificate.waves import waves
from percuss.march.model_of_case import model_of
from percuss_methods.masses.redistributed import LEAST_SHARE, Redistributed
from strategies import hunek, nudged, number, unlike_bars

LEAP_FROG = ("central-difference", "wu-predictor-corrector")
TO_NEIGHBOUR = {"name": "redistributed", "moved_to": "neighbour"}
LAWS = (
    {"name": "penalty", "beta_s": 0.7},
    {"name": "penalty", "epsilon_s": 3.0},
    {"name": "regularised-lagrange", "beta_s": 2.0},
    {"name": "lagrange"},
)


def ran(case, overrides=None, **options):
    return percuss.run(percuss.load(case), overrides, compiled=False, **options)


def shipped(name, **method):
    return percuss.run(percuss.load(f"cases/{name}.yaml"), {f"method.{key}": value for key, value in method.items()})


# ------------------------------------------------------------------------------------------ against dense matrices


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


def closing(matrix, right, sigma):
    """Return x >= 0 with (matrix + diag sigma) x - right >= 0 and one of both 0, by trying every active set."""
    count = right.size
    for size in range(count + 1):
        for some in itertools.combinations(range(count), size):
            active, x = list(some), np.zeros(count)
            if active:
                part = (matrix + np.diag(sigma))[np.ix_(active, active)]
                assume(np.linalg.cond(part) < 1e8)  # else forces of contacts that hold the same end are not unique
                x[active] = np.linalg.solve(part, right[active])
            rest = (matrix + np.diag(sigma)) @ x - right
            if (x >= 0.0).all() and (np.delete(rest, active) >= 0.0).all():
                return x
    raise AssertionError


def march(case, to):
    """March a row of bars with full matrices; return the forces, the gaps and the displacements of all steps."""
    system, law = System(case), case["method"]["contact"]
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
    fastest = max(2.0 * math.sqrt(b["material"]["young"] / b["material"]["density"]) / bars.lengths[n].min()
                  for n, b in case["bodies"].items())  # fmt: skip
    dt = case["time"]["courant"] * 2.0 / fastest
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
                multiplier[direct] = closing(dt**2 * S, -predicted[direct], sigma[direct])
        pushed = pushed + dt * inverse * (N @ np.where(balanced, 0.0, multiplier))
        after = u + dt * pushed
        # Static balance of the ends without mass: K_00 u_0 + K_01 u_1 = N_0 lambda.
        free = -yielding @ bars.K[np.ix_(empty, full)] @ after[full]
        after[empty] = free
        known = np.zeros(count)
        if balanced.any():
            N0 = N[np.ix_(empty, np.flatnonzero(balanced))]
            open_gap = (g0 + N.T @ after)[balanced]
            known[balanced] = closing(N0.T @ yielding @ N0, -open_gap, sigma[balanced])
            after[empty] = free + yielding @ N0 @ known[balanced]
        for history, values in zip(histories, (multiplier, gap, u), strict=True):
            history.append(values.copy())
        u, v = after, (after - u) / dt
    return *map(np.array, histories), bars


@st.composite
def rows(draw):
    """Draw rows of one to three unlike bars.

    Elements may be unlike, or single; the last end may be held or loaded; two contacts may share the first end.
    """
    names, bodies, contacts = draw(unlike_bars(fewest_elements=1))
    if len(names) > 1 and draw(st.booleans()):  # a wall that the second bar does not see: two contacts at one end
        first = bodies["a"]["bar"]["length"]
        contacts["stop"] = {"body": "a.right", "wall": round(first + draw(st.sampled_from([0.0, 0.01])), 6)}
    ending = draw(st.sampled_from(["wall", "fixed", "loaded"])) if len(names) > 1 else "wall"
    last = bodies[names[-1]]
    if ending == "fixed":
        last["fixed"] = ["right"]
    else:
        wall = round(last["at"] + last["bar"]["length"] + draw(st.sampled_from([0.0, 0.05])), 6)
        contacts["wall"] = {"body": f"{names[-1]}.right", "wall": wall}
    loads = {"push": {"constant": draw(number(0.1, 1.0)), "on": f"{names[-1]}.right"}} if ending == "loaded" else {}
    return {
        "percuss": 1,
        "bodies": bodies,
        "contacts": contacts,
        "loads": loads,
        "method": {"integrator": draw(st.sampled_from(LEAP_FROG)), "contact": dict(draw(st.sampled_from(LAWS)))},
        "time": {"steps": 120, "courant": draw(number(0.2, 0.6)), "on_unstable": "warn"},
        "record": {"probes": [f"{name}.{side}" for name in names for side in ("left", "right")]},
    }


@pytest.mark.deep
@settings(max_examples=12, deadline=None, derandomize=True, phases=(Phase.generate,))  # shrinking takes minutes
@given(rows(), st.sampled_from(["body", "neighbour"]))
def test_rows_of_bars_move_as_dense_matrices_move_them(case, to):
    case["method"]["mass"] = {"name": "redistributed", "moved_to": to}
    force, gap, displacement, bars = march(case, to)
    peak = np.abs(force).max()
    assume(0.0 < peak < 1e3)
    other = march(nudged(case, 1e-12), to)[0]
    assume(np.abs(other - force).max() < 1e-8 * peak)  # else round-off decides about openings
    result = ran(case)
    assert np.abs(result.arrays["contact_force"] - force).max() < 1e-7 * peak
    assert np.abs(result.arrays["gap"] - gap).max() < 1e-8 * np.abs(displacement).max()
    ends = [bars.node(probe) for probe in case["record"]["probes"]]
    assert (
        np.abs(result.arrays["displacement"][..., 0] - displacement[:, ends]).max() < 1e-8 * np.abs(displacement).max()
    )
    summary = result.summary
    if summary["certificate"]["stable"] == "yes":
        assert summary["energy"]["ledger_error"] < 1e-12
        assert summary["momentum"]["error"] < 1e-12
        assert summary["energy_growth"]["kept"] is not False


# ------------------------------------------------------------------------------------------------- mass matrices


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


# ------------------------------------------------------------------------------------------------------ stability


@pytest.mark.parametrize("law", [*LAWS, {"name": "tied"}])
@pytest.mark.parametrize("to", ["body", "neighbour"])
def test_the_critical_step_is_that_of_dense_matrices(to, law):
    case = hunek(7, integrator="central-difference", contact=dict(law))
    case["bodies"]["short"] |= {"area": 2.0, "bar": {"length": 10.0, "elements": 7, "grading": 0.3}}
    case["method"]["mass"] = {"name": "redistributed", "moved_to": to}
    certificate = ran(case).summary["certificate"]
    bars = assemble(case)
    mass, empty = redistributed(bars, case, to)
    left, right = bars.node("short.right"), bars.node("long.left")
    assert set(empty) == {left, right}
    normal = np.zeros(mass.size)
    normal[[left, right]] = -1.0, 1.0
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
    assert certificate["dt_critical_free"] == pytest.approx(steps[0], rel=1e-9)
    assert certificate["dt_critical"] == pytest.approx(min(steps), rel=1e-8)
    assert certificate["by"] == "linear-laws"


def test_the_critical_step_of_a_hundred_elements():
    """The share that the docstring tells."""
    certificate = shipped("doyen-impact", mass="redistributed", contact="lagrange").summary["certificate"]
    assert round(certificate["courant_critical"], 4) == 0.9963


def test_a_law_that_the_certificate_cannot_condense_is_unknown(tmp_path):
    (tmp_path / "laws.py").write_text(PLUGIN)
    case = hunek(8, integrator="central-difference", contact={"name": "dashpot-behind"})
    case |= {"plugins": [str(tmp_path / "laws.py")]}
    case["method"]["mass"] = "redistributed"
    result = ran(case)
    certificate = result.summary["certificate"]
    assert certificate["stable"] == "unknown"
    assert "weighs the gap rate" in certificate["why"]
    assert certificate["dt_critical"] is None
    assert result.summary["energy"]["ledger_error"] < 1e-13
    assert result.summary["energy"]["contact_work"] < 0.0
    with pytest.raises(percuss.InputError, match="weighs the gap rate"):
        ran(case, {"time.courant": "auto"})


# --------------------------------------------------------------------------------------------------- exact solutions

PLUGIN = '''
from dataclasses import dataclass
from percuss import ContactLaw, LinearLaw


@dataclass(frozen=True)
class DashpotBehind(ContactLaw):
    """A spring and a dashpot. Formula: ``lambda = -eps_s (g + tau g')``."""

    name = "dashpot-behind"
    summary = "Spring and dashpot"

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=2.0 / points.stiffness, rate=2.0 * dt)
'''


@pytest.mark.parametrize("law", LAWS, ids=lambda law: "-".join(map(str, law.values())))
@pytest.mark.parametrize(
    "name", ["doyen-impact", "unlike", *(pytest.param(one, marks=pytest.mark.deep) for one in ("hunek", "carpenter"))]
)
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


@pytest.mark.parametrize("mass", ["redistributed", TO_NEIGHBOUR])
def test_ten_bounces_keep_as_much_energy_as_published_figures_say(mass):
    """Of 500, the work of the weight on the way down: .98 with exact contact, .999 with a spring behind the end."""
    for law, expected, within in (
        ({"name": "lagrange"}, 0.98, 0.005),
        ({"name": "penalty", "beta_s": 0.25}, 0.9997, 1e-4),
    ):
        result = percuss.run(
            percuss.load("cases/doyen-bounce.yaml"),
            {
                "method.mass": mass,
                "method.integrator": "central-difference",
                "method.contact": law,
                "time.end": 10 * 16 / 3,
            },
        )
        assert 1.0 + result.summary["energy"]["contact_work"] / 500.0 == pytest.approx(expected, abs=within)
        # Two periods of the bar have two contacts of the same impulse: the weight over the time, but for what is lost.
        assert result.summary["contacts"]["foot"]["impulse"] == pytest.approx(1000.0 * 16 / 3, rel=0.01)


def test_the_force_converges_with_the_mesh():
    errors = []
    for refine in (1, 2, 4, 8):
        result = percuss.run(
            percuss.load("cases/doyen-impact.yaml"),
            {"refine": refine, "method.mass": "redistributed", "method.contact": {"name": "lagrange"}},
        )
        errors.append(result.summary["exact"]["contacts"]["foot"]["force_error_l1"])
    assert all(np.array(errors[1:]) < 0.65 * np.array(errors[:-1]))


def test_a_run_goes_on_where_a_drive_changes_and_again_from_its_beginning():
    """The coming force is part of the state: a second stretch continues with it."""
    case = hunek(6, integrator="central-difference", contact={"name": "lagrange"}, end=0.3)
    case["method"]["mass"] = "redistributed"
    driven = copy.deepcopy(case)
    driven["loads"] = {"hold": {"prescribed-velocity": 0.0, "on": "long.right", "from": 0.1}}
    driven["bodies"]["long"].pop("fixed")
    results = [ran(one) for one in (case, driven)]
    early = results[0].arrays["time"] < 0.2  # no wave comes back from the far end
    assert np.abs((results[0].arrays["contact_force"] - results[1].arrays["contact_force"])[early]).max() < 1e-15
    assert results[1].summary["energy"]["ledger_error"] < 1e-13


# --------------------------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"method.contact": "bipenalty"}, "redistributed.*weighs the gap acceleration"),
        (
            {"method.integrator": "viscous-central-difference"},
            "redistributed.*viscous-central-difference gives no internal forces that follow from the strain alone",
        ),
        ({"method.contact": "uzawa"}, "redistributed.*its kernel takes the gap as given"),
        ({"method.integrator": "velocity-verlet", "method.contact": "penalty"}, "redistributed.*in the stages"),
        ({"bodies.long.element": "green-bar"}, "expected linear bodies.*green-bar"),
        ({"bodies.long.element": "quadratic-bar"}, "expected elements of two nodes at ends in contact"),
    ],
)
def test_what_has_no_static_balance_is_refused(change, reason):
    case = hunek(4, integrator="central-difference", contact="lagrange")
    case["method"]["mass"] = "redistributed"
    with pytest.raises((percuss.RefusedPair, percuss.InputError), match=f"(?s){reason}"):
        ran(case, change)


@pytest.mark.parametrize("law", ["moreau-jean", "penalty"])
def test_the_black_box_is_not_asked_where_ends_have_no_mass(law, capfd):
    case = hunek(4, integrator="central-difference", contact={"name": law})
    case["method"]["mass"] = "redistributed"
    (row,) = percuss.stability(percuss.load(case), by=("black-box",))
    assert row["courant_critical"] is None
    assert row["reason"].startswith("ends without mass are examined only with linear laws in gap or gap rate")
    assert capfd.readouterr() == ("", "")
    with pytest.raises(percuss.PercussError, match="waves are measured of ends with mass"):
        waves(model_of(percuss.load(case)))


def test_a_held_end_in_contact_keeps_its_mass_and_is_met_by_one_without():
    case = hunek(5, contact="lagrange", end=0.3)
    case["method"]["mass"] = "redistributed"
    case["loads"] = {"push": {"prescribed-velocity": 0.05, "on": "long.left"}}
    result = ran(case)
    assert result.arrays["contact_force"].max() > 0.01
    assert result.summary["energy"]["ledger_error"] < 1e-13
    assert result.summary["momentum"]["error"] < 1e-13


def test_the_force_of_an_impact_does_not_oscillate():
    """A force of 300 for 2/3: the penalty at an end with mass rings throughout, what an end without mass keeps is a
    wave of dispersion behind the front."""
    noise, late = {}, {}
    for mass in ("redistributed", "lumped"):
        law = {"name": "lagrange"} if mass == "redistributed" else {"name": "penalty", "beta_s": 2.0}
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
