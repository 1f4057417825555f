"""Recommendations: what a search finds is the cheapest of what it may choose from, and is found again from its file."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from typer.testing import CliRunner

import percuss
from marks import deep
from percuss.case.options import options_of
from percuss.cli.main import app
from percuss.march.model_of_case import model_of
from percuss.methods.registry import Registry
from percuss.reporting.recommendation_words import bounds_in_words, recommendation_lines, recommendation_verdict
from percuss.studies import recommendation
from percuss.studies.candidates import Candidate, evaluations, meshes, neighbours
from percuss.studies.recommendation import (
    GUARANTEE,
    STABLE,
    Search,
    Tried,
    bound_of,
    front,
    recommend,
    why_never,
)
from percuss.studies.study import Session
from percuss.studies.study_table import rerun_rows
from places import CASES

REGISTRY = Registry.load()
SMALL = """
percuss: 1
bodies:
  a: {bar: {length: 1, elements: 6}, material: {young: 100, density: 0.01}, area: 1, velocity: 1}
contacts:
  wall: {body: a.right, wall: 1}
method: {integrator: central-difference, contact: lagrange}
time: {steps: 20, courant: 0.5}
"""
INTEGRATORS, CONTACTS = ["central-difference", "wu-predictor-corrector"], ["lagrange", "penalty"]


@pytest.fixture
def small(tmp_path, monkeypatch):
    """A bar that hits a wall."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yaml").write_text(SMALL, encoding="utf-8")
    return tmp_path / "small.yaml"


def found(small, **kwargs):
    given = {"error": 0.05, "runs": 60, "workers": 1, "integrators": INTEGRATORS, "contacts": CONTACTS, **kwargs}
    return recommend(small, **given)


def test_the_recommended_run_meets_the_bounds_and_no_run_does_so_cheaper(small):
    answer = found(small, energy=0.05, contacts=CONTACTS[:1])
    best = answer.best
    assert best.error <= 0.05
    assert best.energy <= 0.05
    assert best.evaluations == min(one.evaluations for one in answer.tried if one.meets)
    assert answer.left == 0
    told = "\n".join(map(str, recommendation_lines(answer)))
    assert answer.as_dict()["best"]["command"] in told
    assert f"time: {{courant: {best.candidate.courant:g}}}" in told
    ran = [one.candidate for one in answer.tried]
    case = percuss.load(small)
    for one in neighbours(best.candidate, case.registry):
        try:
            case.with_overrides(one.changes)
        except percuss.InputError:
            continue
        assert any(dataclasses.replace(other, refine=best.candidate.refine).key == one.key for other in ran), one


def test_a_search_begins_with_a_case_that_has_a_time_step(small):
    small.write_text(SMALL.replace("steps: 20, courant: 0.5", "steps: 20, step: 0.0005"), encoding="utf-8")
    answer = found(small, error=None, energy=0.5, runs=12, contacts=CONTACTS[:1])
    assert answer.best.energy <= 0.5


@pytest.mark.deep
def test_a_search_that_was_interrupted_goes_on(small, monkeypatch):
    rounds, made = [], Session.make

    def interrupted(*args):
        rounds.append(args)
        if len(rounds) == 3:
            raise KeyboardInterrupt
        return made(*args)

    with monkeypatch.context() as patched:
        patched.setattr(Session, "make", interrupted)
        with pytest.raises(KeyboardInterrupt):
            found(small)
        rounds.pop(1)
        done = CliRunner().invoke(app, ["recommend", str(small), "--error", "5%", "--workers", "1"])
    assert done.exit_code == 130
    assert "interrupted: the same command continues from here" in done.output
    stored = {row["key"]: row["seconds"] for row in percuss.open_study("small-recommend.sqlite").as_records()}
    answer = found(small)
    assert len(stored) < len(answer.tried)
    made_later = {row["key"]: row["seconds"] for row in answer.study.as_records()}
    assert made_later.items() >= stored.items()  # to the last digit of a clock: none was run again


def test_no_run_meets_a_bound_that_cannot_be_met(small):
    answer = found(small, runs=12, error=1e-30)
    assert answer.best is None
    assert answer.front[-1].excess == min(one.excess for one in answer.tried)
    assert len(answer.tried) == 12
    assert list(recommendation_verdict(answer))[-1].startswith("No run meets the bounds; the nearest is ")


@pytest.mark.deep
def test_without_an_exact_solution_the_error_is_the_measured_difference_from_a_finer_run(small):
    """Of a bar that yields: a run of its own with the same finer run has the same error, to the last bit."""
    text = SMALL.replace("young: 100, density: 0.01}", "young: 100, density: 0.01, yield_stress: 0.3, tangent: 0.3}")
    small.write_text(text.replace("material: {", "material: {name: bilinear-plastic, "), encoding="utf-8")
    answer = found(small, error=0.2, runs=10, contacts=CONTACTS[:1], integrators=INTEGRATORS[:1])
    assert all(one.candidate.refine <= 2 for one in answer.tried)
    told = "\n".join(map(str, recommendation_lines(answer)))
    assert "an estimate, against a finer run (refine 4 with wu-predictor-corrector and lagrange): L1 norm of" in told
    end = {"time.end": percuss.run(percuss.load(small)).summary["end"], "time.steps": None}
    one = answer.best or answer.front[-1]
    run = percuss.run(percuss.load(small, {**end, **one.candidate.changes, "reference.refine": 4}))
    assert one.error == run.summary["estimated"]["contacts"]["wall"]["force_error_l1"]


ADDS_ENERGY = '''
from dataclasses import dataclass
from percuss import ContactLaw, LinearLaw, hookimpl


@dataclass(frozen=True)
class Adds(ContactLaw):
    """Formula: ``lambda = <-k (g - 3 dt g')>``."""

    name = "adds"
    summary = "pushes harder where the gap opens"

    def bind(self, points, dt):
        return LinearLaw(at="end", sigma=4 / points.stiffness, rate=-3 * dt, sign=">= 0")


@hookimpl
def percuss_contacts():
    return [Adds]
'''


def test_a_run_whose_energy_grows_is_recommended_only_within_a_bound_that_allows_it(small):
    small.write_text(SMALL.replace("steps: 20", "steps: 60"), encoding="utf-8")  # until the bar has left the wall
    (small.parent / "adds.py").write_text(ADDS_ENERGY, encoding="utf-8")
    law = {"contacts": ["adds"], "plugins": [small.parent / "adds.py"]}
    given = {"error": 5.0, "runs": 10, "integrators": INTEGRATORS[:1], **law}
    answer = found(small, **given)
    accurate = [row for row in answer.study.as_records() if row["status"] == "done" and row["force_error_l1"] <= 5.0]
    grown = {row["key"]: max(row["energy_kept"], row["energy_max"]) - 1.0 for row in accurate}
    assert max(grown.values()) > 0.01
    assert all(grown[one.key] <= 0.01 for one in answer.tried if one.meets)
    assert "energy grown by at most 1 %" in bounds_in_words(answer.bounds)
    allowed = found(small, **given, energy=10.0)
    assert any(0.01 < one.energy <= 10.0 for one in allowed.tried if one.meets)


@pytest.mark.parametrize(
    ("stable", "guarantee", "kept", "reason", "never"),
    [
        ("yes", "not guaranteed", 1.0, "", False),
        ("unknown", "unknown", 1.0, "", False),
        ("marginal", "never grows", 1.0, "", False),
        ("marginal", "conserved between switchings", 1.0, "", True),
        ("marginal", "unknown", 1.0, "", True),
        ("no", "not guaranteed", 1.0, "", True),
        ("yes", "never grows", None, "", True),  # the ledger is open
        ("yes", "never grows", 1.0, "not a valid result: momentum does not balance", True),
    ],
)
def test_what_is_never_recommended(stable, guarantee, kept, reason, never):
    row = {"reason": reason, STABLE: stable, GUARANTEE: guarantee, "energy_kept": kept}
    assert bool(why_never(row)) == never


# ------------------------------------------------------------------------------------------------------- candidates


@pytest.mark.parametrize("law", REGISTRY.names("contacts"))
def test_options_of_neighbours_are_within_their_bounds_and_reach_their_ends(law):
    random = np.random.default_rng(0)
    candidate, seen = Candidate("noh-bathe", law), {}
    for _ in range(40):
        beside = neighbours(candidate, REGISTRY)
        for one in beside:
            for key, value in one.contact_options.items():
                option = options_of(REGISTRY.get("contacts", law))[key]
                assert option.unit in ("", "1")
                assert isinstance(value, str) or math.isfinite(value)
                seen.setdefault(key, set()).add(value)
            assert 0 < one.courant <= 2
            assert one.refine == candidate.refine
            assert one.pair == candidate.pair
        candidate = beside[random.integers(len(beside))]
    assert {0.0, 1.0} <= seen.get("restitution", {0.0, 1.0})


def test_neighbours_are_one_step_away():
    beside = neighbours(
        Candidate("chung-lee", "uzawa", {"beta": 1.01}, {"iterations": 5, "beta_s": 0.4}, 0.5, 2), REGISTRY
    )
    assert {one.courant for one in beside} == {0.4, 0.5, 0.63, 0.8}
    assert {one.contact_options["iterations"] for one in beside} == {1, 3, 5, 8, 100}


@pytest.mark.parametrize("counts", [[100], [100, 200], [7, 10, 50], [3, 4], [6], [1]])
def test_meshes_of_a_search_multiply_all_bodies_alike_down_to_one_element(counts):
    found = meshes(counts)
    assert found == sorted(set(found))
    assert 1 in found
    assert min(round(min(counts) * refine) for refine in found) == 1
    assert found[-1] > 60
    for refine in (refine for refine in found if refine * math.gcd(*counts) >= 1):
        assert all(round(n * refine) == pytest.approx(n * refine, rel=0.02) for n in counts)


# ------------------------------------------------------------------------------------------------------- search


PAIRS = [(integrator, law) for integrator in INTEGRATORS for law in ("lagrange", "moreau-jean", "paoli-schatzman")]
REFINEMENTS = meshes([100])


class Planted:
    """A bench without runs: on each mesh the excess is that of `excess`, and the cost that of a bar of 100 elements."""

    def __init__(self, runs, excess):
        self.room, self.excess, self.asked = runs, excess, []

    def cost(self, candidate):
        return math.ceil(100 * candidate.refine / candidate.courant) * (100 * candidate.refine + 1)

    def fits(self, candidate):
        return True

    def ask(self, candidates):
        made = candidates[: self.room]
        self.room -= len(made)
        self.asked += made
        return [self.excess(one) for one in made]


def planted(excess, runs, pairs=PAIRS):
    bench = Planted(runs, excess)
    first = [Candidate(*pair) for pair in pairs]
    search = Search(first, [], REFINEMENTS, REGISTRY, bench)
    search.run()
    return bench, search


def cheapest(bench, search):
    """Return the cheapest candidate that was run and meets the bounds, None if none does."""
    met = [one for one in bench.asked if bench.excess(one) <= 1]
    assert search.best() == min(map(bench.cost, met), default=math.inf)
    return min(met, key=lambda one: (bench.cost(one), bench.excess(one)), default=None)


def power_law(pair, refine, order, edge=None):
    """An excess that is 1 on the mesh `refine` for one pair, at the end 1 of its restitution if `edge`, else larger."""

    def excess(one):
        if one.courant > 1:
            return math.inf
        factor = 1.0 if one.pair == pair else 2.5
        if edge and one.pair == pair:
            factor *= edge ** (1.0 - one.contact_options.get("restitution", 0.0))
        return factor * (refine / one.refine) ** order

    return excess


@pytest.mark.parametrize(
    ("pair", "refine", "order", "edge"),
    [
        pytest.param(PAIRS[2], 0.0695, 1.0, None, id="coarser"),
        pytest.param(PAIRS[0], 8.9, 0.7, None, id="finer"),
        pytest.param(PAIRS[1], 0.31, 1.0, 4.0, id="edge of an option"),
        pytest.param(PAIRS[-1], 0.31, 1.0, None, id="last pair"),
    ],
)
def test_an_optimum_that_was_planted_is_found_within_three_runs_a_pair(pair, refine, order, edge):
    excess = power_law(pair, refine, order, edge)
    bench, search = planted(excess, 3 * len(PAIRS))
    options = {"restitution": 1.0} if edge else {}
    best = min(
        bench.cost(one)
        for one in (Candidate(*pair, {}, options, courant, mesh) for courant in (0.8, 0.9, 1.0) for mesh in REFINEMENTS)
        if excess(one) <= 1
    )
    found = cheapest(bench, search)
    assert found.pair == pair
    assert not edge or found.contact_options == options
    assert bench.cost(found) <= 1.26 * best  # meshes of a search are an eighth apart, so that their costs are a quarter
    assert len(bench.asked) <= 3 * len(PAIRS)


@pytest.mark.parametrize(("order", "runs"), [(1.0, 60), (0.5, 60), (0.2, 120)])
def test_a_search_never_says_no_while_runs_are_left(order, runs):
    """Neither if the first refinement tells less than usual, nor if nothing can meet the bounds."""
    assert cheapest(*planted(power_law(PAIRS[0], 40.0, order), runs)) is not None
    bench, search = planted(power_law(PAIRS[0], 1e4, order), 60)
    assert (cheapest(bench, search), bench.room) == (None, 0)
    only = [("central-difference", "lagrange")]  # without options: it ends, when nothing is left
    bench, search = planted(power_law(only[0], 1e4, order), 10_000, only)
    assert bench.room > 0
    assert not any(search.left(choice, math.inf) for choice in search.choices.values())
    assert {one.courant for one in bench.asked} == {0.2, 0.25, 0.315, 0.4, 0.5, 0.63, 0.8, 0.9, 0.95, 1, 1.25, 1.6, 2}


def test_a_step_of_stages_counts_them():
    assert [evaluations(REGISTRY.get("integrators", name)()) for name in ("central-difference", "noh-bathe")] == [1, 2]


def test_the_front_is_what_nothing_dominates():
    random = np.random.default_rng(1)
    costs = random.integers(1, 30, (60, 2)).astype(float)
    kept = front([Tried(Candidate("a", "b"), "done", "", "yes", None, None, None, *pair, "") for pair in costs])
    nothing = [tuple(one) for one in costs if not any((other <= one).all() and (other < one).any() for other in costs)]
    assert [(one.evaluations, one.excess) for one in kept] == sorted(set(nothing))


# ------------------------------------------------------------------------------------------------------- bad input


def test_a_bound_is_a_number_or_percent():
    assert [bound_of(text, "--error") for text in ("1%", "0.5", "", "2e-3")] == [0.01, 0.5, None, 2e-3]


@pytest.mark.parametrize(
    ("case", "error"),
    [
        deep("hunek", 0.02),
        pytest.param("doyen-bounce", 0.01, marks=pytest.mark.nightly),
        pytest.param("unlike", 0.01, marks=pytest.mark.nightly),
    ],
)
def test_a_grid_of_all_that_may_be_chosen_has_hardly_anything_cheaper(case, error, tmp_path, monkeypatch):
    """By brute force over mesh and step of the pairs with their default options, by public means alone."""
    monkeypatch.chdir(tmp_path)
    file = CASES / f"{case}.yaml"
    laws = ["lagrange", "penalty", "moreau-jean"]
    answer = recommend(file, error=error, runs=60, workers=1, integrators=INTEGRATORS, contacts=laws)
    loaded = percuss.load(file)
    for integrator, law, courant in itertools.product(INTEGRATORS, laws, (0.3, 0.5, 0.7, 0.9, 0.95, 1.0)):
        for refine in (0.02, 0.04, 0.06, 0.08, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.75, 1, 1.25, 1.5, 2):
            candidate = Candidate(integrator, law, {}, {}, courant, refine)
            if planned(loaded, candidate) * 1.5 < answer.best.evaluations:
                assert not error_of(loaded, candidate) <= error, candidate


def planned(case, candidate):
    model = model_of(case.with_overrides({**recommendation._fixed(case, case.time.end), **candidate.changes}))
    return model.steps * len(model.bodies.nodes)


def error_of(case, candidate):
    try:
        result = percuss.run(case.with_overrides({**recommendation._fixed(case, case.time.end), **candidate.changes}))
    except percuss.RunError:
        return math.inf
    return max(one["force_error_l1"] for one in result.summary["exact"]["contacts"].values())


@pytest.mark.deep
def test_a_search_between_surfaces_tries_the_pairings_by_a_finer_run(tmp_path):
    """The finer run judges meshes at most half as fine, so that no finer mesh is tried."""
    blocks = (CASES / "tilted-blocks.yaml").read_text(encoding="utf-8").partition("expect:")[0]
    case = tmp_path / "blocks.yaml"
    case.write_text(blocks.replace("seam: {", "seam: {pairing: node-to-segment, "), encoding="utf-8")
    given = {"integrators": ["wu-predictor-corrector"], "contacts": ["penalty"], "runs": 20, "workers": 1}
    answer = recommend(case, error=0.08, changes={"reference.refine": 2}, out=tmp_path / "runs.sqlite", **given)
    assert {one.candidate.pairing for one in answer.tried} > {"mortar"}
    assert all(one.candidate.refine <= 1 for one in answer.tried)
    assert answer.study.cases["blocks"]["case"]["reference"]["refine"] == 2
    assert answer.study.cases["blocks"]["case"]["contacts"]["seam"]["pairing"] is None
    (again,) = rerun_rows(answer.study.path, answer.best.key)
    assert again.differences == ()
