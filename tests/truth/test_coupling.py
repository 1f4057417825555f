"""Kernels of contact laws where contacts share an end: against full matrices and every set of pressing contacts."""

import itertools
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dense
import percuss
from marks import deep
from percuss import ContactLaw, Doc, Ge, Le, Unit, coupled_rate
from percuss.certificate import verdict
from percuss.contact.laws import ignored_couplings
from percuss.jit import jit_disabled
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.reporting.explanation import explanation
from strategies import CD, bar, case_of, with_methods


class Bound(NamedTuple):
    e: float


@dataclass(frozen=True)
class NewtonImpact(ContactLaw):
    """Impulses at the velocity level.

    Formula: where ``g* <= 0``: ``0 <= lambda, g'_{n+1/2} + e g'_{n-1/2} >= 0``, one of them zero; else ``lambda = 0``.
    """

    name = "newton-impact"
    summary = "impulses at the velocity level"
    uses_coupling = True
    e: Annotated[float, Ge(0), Le(1), Unit("1"), Doc("restitution")] = 0.0

    def bind(self, points, dt):
        return Bound(self.e)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        multiplier[:] = 0.0
        for _ in range(1000):
            moved = 0.0
            for p in range(multiplier.size):
                if trial.predicted_gap[p] <= 0.0:
                    before = multiplier[p]
                    rate = coupled_rate(trial, multiplier, p) + bound.e * trial.rate[p]
                    multiplier[p] = max(before - rate / (trial.rate_response * trial.delassus[p]), 0.0)
                    moved = max(moved, abs(multiplier[p] - before))
            if moved <= 1e-14 * multiplier.max():
                break


@dataclass(frozen=True)
class Alone(ContactLaw):
    """Impulses at the velocity level, each contact by itself. Formula: as `newton-impact`."""

    name = "alone"
    summary = "impulses at the velocity level, each contact by itself"

    def bind(self, points, dt):
        return Bound(0.0)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            multiplier[p] = 0.0
            if trial.predicted_gap[p] <= 0.0:
                multiplier[p] = max(-trial.predicted_rate[p] / (trial.rate_response * trial.delassus[p]), 0.0)


REGISTRY = with_methods(NewtonImpact, Alone)


def of_laws(case, laws):
    """Return the forces of laws of which the contacts of an end are solved together, for `dense.march`."""
    system = dense.System(case)
    S = system.Nf.T @ np.linalg.solve(system.Mf, system.Nf)

    def forces(before, now, free, _w, dt, _u):
        right, weight, may = free.copy(), np.full(free.size, dt * dt), np.ones(free.size, dtype=bool)
        for p, law in enumerate(laws):
            if law["name"] == "paoli-schatzman":
                right[p] += law["restitution"] * before[p]
            elif law["name"] != "lagrange":  # impulses at the velocity level
                e = law.get("e", law.get("restitution", 0.0))
                right[p] = (free[p] - now[p] + e * (now[p] - before[p])) / dt
                weight[p], may[p] = dt, free[p] <= 0.0
        x = np.zeros(free.size)
        x[may] = dense.complementary((weight[:, None] * S)[np.ix_(may, may)], right[may])
        return x

    return forces


SHARED = case_of(
    {"hammer": bar(10, 50, 0, 0.1), "upper": bar(10, 50, 10, area=0.5), "lower": bar(10, 50, 10, area=0.5)},
    {"one": {"between": ["hammer.right", "upper.left"]}, "two": {"between": ["hammer.right", "lower.left"]}},
    {"end": 0.03, "courant": 0.5},
)


def marched(case, *, compiled=False):
    """Return forces and gaps of a march without its certificate, (steps + 1, contacts)."""
    made = March(model_of(case), compiled=compiled)
    outcome = made.run()
    assert outcome.kernels.compiled is compiled or jit_disabled()
    return outcome.record.contact_force, outcome.record.gap


@pytest.mark.slow
@pytest.mark.parametrize("compiled", [deep(True), False], ids=["compiled", "plain"])
def test_two_contacts_at_one_end_press_as_a_dense_solution_has_it(compiled):
    """Each contact by itself would press twice as hard: of the two together the bar feels double."""
    case = {**SHARED, "method": {"integrator": CD, "contact": "newton-impact"}}
    expected = dense.march(case, law=of_laws(case, [{"name": "newton-impact"}] * 2)).force.max()
    assert expected == pytest.approx(0.0271484375, rel=1e-9)
    case = percuss.load(case, registry=REGISTRY)
    assert marched(case, compiled=compiled)[0].max() == pytest.approx(expected, rel=1e-12)
    assert ignored_couplings(model_of(case)) == []


@st.composite
def stars(draw):
    """Draw a bar that runs into others and perhaps a wall, all at one end: one law with a kernel, or linear laws."""
    share = st.integers(50, 150).map(lambda k: k / 100)

    def drawn(at, velocity):
        material = {"young": 100.0 * draw(share), "density": 0.01 * draw(share)}
        return bar(draw(share), draw(st.integers(1, 4)), at, velocity, material, draw(share))

    bodies = {"hammer": drawn(0.0, 1.0)}
    end = bodies["hammer"]["bar"]["length"]
    contacts = {}
    for name in "abc"[: draw(st.integers(1, 3))]:
        gap = draw(st.integers(1, 40)) * 1.234e-4
        bodies[name] = drawn(end + gap, -0.1)
        contacts[name] = {"between": ["hammer.right", f"{name}.left"]}
    if len(contacts) == 1 or draw(st.booleans()):
        contacts["wall"] = {"body": "hammer.right", "wall": end + draw(st.integers(1, 40)) * 1.357e-4}
    linear = [{"name": "lagrange"}, {"name": "moreau-jean", "restitution": 0.5},
              {"name": "paoli-schatzman", "restitution": 0.5}]  # fmt: skip
    kinds = [[{"name": "newton-impact", "e": 0.5}], [{"name": "newton-impact", "e": 0.25}], linear]
    laws = draw(st.sampled_from(kinds))
    for one in contacts.values():
        one["method"] = draw(st.sampled_from(laws))
    return {"percuss": 1, "bodies": bodies, "contacts": contacts, "time": {"steps": 40, "courant": 0.5}}


@pytest.mark.slow
@settings(max_examples=40)
@given(case=stars())
@pytest.mark.deep
def test_contacts_at_one_end_are_solved_together(case):
    case["method"] = {"integrator": CD}
    loaded = percuss.load(case, {"time.on_unstable": "warn"}, registry=REGISTRY)
    expected = dense.march(case, law=of_laws(case, [one["method"] for one in case["contacts"].values()]))
    force, gap = marched(loaded)
    assert np.abs(force - expected.force).max() <= 1e-9 * max(np.abs(expected.force).max(), 1e-12)
    assert np.abs(gap - expected.gap).max() <= 1e-11
    assert ignored_couplings(model_of(loaded)) == []


WEDGED = case_of(
    {
        "held": bar(1.5, 6, 0.0, 0.0, {"young": 137, "density": 0.65}, 1.7, ["left"]),
        "other": bar(1.4, 4, 1.5, -1.0, {"young": 204, "density": 0.77}, 1.3),
        "beside": bar(1.2, 3, 0.3, 0.0, {"young": 150, "density": 0.7}, 0.9),
    },
    {
        "held": {"between": ["held.right", "other.left"]},
        "wall": {"body": "other.left", "wall": 1.49},
        "beside": {"between": ["beside.right", "other.left"]},
    },
    {"step": 0.012, "steps": 60},
)
WEDGED["method"] = {"integrator": CD, "contact": {"name": "uzawa", "epsilon_s": 250.0, "iterations": 3}}


@pytest.mark.slow
@pytest.mark.parametrize("order", [("held", "wall", "beside"), ("beside", "wall", "held")], ids=" ".join)
@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "plain"])
def test_uzawas_iteration_is_one_for_all_contacts_of_an_end_in_any_order(order, compiled):
    """The formula of its docstring with full matrices."""
    case = {**WEDGED, "contacts": {name: WEDGED["contacts"][name] for name in order}}
    system, law = dense.System(case), case["method"]["contact"]
    S = system.Nf.T @ np.linalg.solve(system.Mf, system.Nf)

    def uzawa(_before, _now, free, _w, dt, _u):
        iterate = np.zeros(3)
        for _ in range(law["iterations"]):
            iterate = np.maximum(iterate - law["epsilon_s"] * (free + dt * dt * S @ iterate), 0.0)
        return iterate

    expected = dense.march(case, law=uzawa).force
    force, _ = marched(percuss.load(case, {"time.on_unstable": "warn"}), compiled=compiled)
    assert (expected > 0.0).all(axis=1).any()
    assert np.abs(force - expected).max() <= 1e-11 * expected.max()


def test_the_certificate_of_contacts_at_one_end_is_that_of_the_documented_iteration():
    """The closed step has an amplification matrix of the formula: it begins to grow at the critical step, not above."""
    case = percuss.load({**WEDGED, "time": {"step": 0.012, "steps": 10}})
    found = verdict.certificate(model_of(case))
    system, law = dense.System(WEDGED), WEDGED["method"]["contact"]
    inverse = np.linalg.inv(system.Mf)
    stiffness, eye = system.bars.K[np.ix_(system.free, system.free)], np.eye(len(inverse))

    def radius(dt, closed):
        normal = system.Nf[:, closed]
        S, of_gap = normal.T @ inverse @ normal, np.zeros((len(closed), len(closed)))
        for _ in range(law["iterations"]):
            of_gap = of_gap - law["epsilon_s"] * (np.eye(len(closed)) + dt * dt * S @ of_gap)
        back = eye + dt * dt * inverse @ normal @ of_gap @ normal.T
        A = np.block([[back @ (2.0 * eye - dt * dt * inverse @ stiffness), -back], [eye, np.zeros_like(eye)]])
        return np.abs(np.linalg.eigvals(A)).max()

    sets = [list(some) for size in (1, 2, 3) for some in itertools.combinations(range(3), size)]
    critical = found["dt_critical"]
    assert critical < 0.98 * found["dt_critical_free"]
    # free bodies move rigidly, with a double eigenvalue of 1 that rounding splits by the root of the rounding unit
    assert max(radius(critical * (1.0 - 1e-4), some) for some in sets) <= 1.0 + 1e-6
    assert max(radius(critical * (1.0 + 1e-3), some) for some in sets) > 1.0 + 1e-5


@pytest.mark.parametrize(
    ("other", "found"),
    [({"name": "newton-impact", "e": 0.5}, "other options"), ("lagrange", "lagrange"),
     ("alone", "alone")],
)  # fmt: skip
def test_a_law_that_solves_contacts_together_is_refused_where_one_of_the_end_has_another(other, found):
    def model(contacts):
        made = {**SHARED, "contacts": contacts, "method": {"contact": "newton-impact"}}
        return model_of(percuss.load(made, registry=REGISTRY))

    two = {"one": SHARED["contacts"]["one"], "two": {**SHARED["contacts"]["two"], "method": other}}
    said = "contacts.two: expected newton-impact with the options of contact 'one'.* solves all contacts there together"
    with pytest.raises(percuss.InputError, match=f"{said}; found {found}"):
        model(two)
    apart = {"one": SHARED["contacts"]["one"], "two": {"body": "hammer.left", "wall": -1.0, "method": other}}
    assert [bound_law.law.name for bound_law in model(apart).laws]


def test_what_a_kernel_ignores_is_said_by_check_and_by_the_run():
    method = {"integrator": "central-difference", "contact": "alone"}
    coarse = {f"bodies.{name}.bar.elements": 2 for name in SHARED["bodies"]} | {"time.on_unstable": "warn"}
    case = percuss.load({**SHARED, "method": method}, coarse, registry=REGISTRY)
    told = explanation(model_of(case))
    note = ("contacts 'one', 'two' share an end, and the kernel of law alone sees each of its contacts by itself: it "
            "ignores what the others at that end press in the same step")  # fmt: skip
    assert f"note: {note}" in told.text
    assert told.data["certificate"]["ignores"][0].startswith(note)
    (found,) = [one for one in percuss.run(case, compiled=False).summary["notes"] if "share an end" in one]
    assert found.startswith(note)
