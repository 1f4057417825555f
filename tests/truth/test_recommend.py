"""Recommendations: what a search finds is the cheapest of what it may choose from, and is found again from its file."""

import dataclasses
import json
import math

import numpy as np
import pytest

import percuss
from command_line import percuss_command
from percuss.case.options import options_of
from percuss.methods.registry import Registry
from percuss.studies import recommendation
from percuss.studies.candidates import Candidate, drawn, evaluations, neighbours
from percuss.studies.recommendation import Bounds, Tried, bound_of, front, recommend
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
    answer = found(small, energy=0.05)
    best = answer.best
    assert best.error <= 0.05
    assert best.energy <= 0.05
    assert best.meets
    assert best.cost == min(one.cost for one in answer.tried if one.meets)
    assert answer.second.candidate.pair != best.candidate.pair
    assert answer.second.cost >= best.cost
    assert answer.study.command(best.key).startswith("percuss run ")
    assert answer.beside is not None
    ran = {one.candidate.key for one in answer.tried}
    case = percuss.load(small)
    for one in neighbours(best.candidate, case.registry):
        if one.key not in ran:
            with pytest.raises(percuss.InputError):
                case.with_overrides(one.changes)


def test_a_search_is_found_again_from_its_file(small):
    first = found(small)
    again = found(small)
    assert again.study.found == len(again.tried) == len(first.tried)  # nothing was run again
    assert [one.candidate for one in again.tried] == [one.candidate for one in first.tried]
    assert again.best == first.best
    other = found(small, seed=1, out="other.sqlite")
    assert [one.candidate for one in other.tried] != [one.candidate for one in first.tried]


def test_a_search_that_was_interrupted_goes_on(small, monkeypatch):
    rounds, made = [], recommendation.study

    def interrupted(*args, **kwargs):
        rounds.append(args)
        if len(rounds) == 3:
            raise KeyboardInterrupt
        return made(*args, **kwargs)

    with monkeypatch.context() as patched:
        patched.setattr(recommendation, "study", interrupted)
        with pytest.raises(KeyboardInterrupt):
            found(small)
    stored = {row["key"]: row["seconds"] for row in percuss.open_study("small-recommend.sqlite").as_records()}
    answer = found(small)
    assert len(stored) < len(answer.tried)
    assert answer.best is not None
    made_later = {row["key"]: row["seconds"] for row in answer.study.as_records()}
    assert {key: made_later[key] for key in stored} == stored  # to the last digit of a clock: none was run again


@pytest.mark.parametrize("bounds", [{"error": 1e-9}, {"error": 1e-300}, {"error": None, "energy": 1e-300},
                                    {"error": 0.5, "seconds": 1e-300}])  # fmt: skip
def test_no_run_meets_a_bound_that_cannot_be_met(bounds, small):
    answer = found(small, runs=12, **bounds)
    assert answer.best is None
    assert answer.second is None
    assert answer.nearest.excess == min(one.excess for one in answer.tried)
    assert len(answer.tried) <= 12
    assert answer.beside is None


def test_without_an_exact_solution_the_error_is_that_of_a_finer_mesh(small):
    text = SMALL.replace("young: 100, density: 0.01}", "young: 100, density: 0.01, yield_stress: 1e6, tangent: 0.1}")
    text = text.replace("material: {", "material: {name: bilinear-plastic, ")
    small.write_text(text, encoding="utf-8")
    answer = found(small, error=0.2, runs=40)
    assert answer.estimated
    best = answer.best
    rows = {one.candidate.key: one for one in answer.tried}
    finer = rows[dataclasses.replace(best.candidate, refine=2 * best.candidate.refine).key]
    records = {row["key"]: row for row in answer.study.as_records()}
    coarse, fine = records[best.key], records[finer.key]
    changes = [abs(coarse[name] - fine[name]) / abs(fine[name]) for name in ("peak_force", "impulse")]
    assert best.error == pytest.approx(max(changes), rel=1e-12)


def test_a_method_of_a_plug_in_takes_part(small):
    (small.parent / "half.py").write_text(
        '''
from dataclasses import dataclass
from percuss import ContactLaw, LinearLaw, hookimpl


@dataclass(frozen=True)
class Half(ContactLaw):
    """Formula: ``lambda = <-k g>``."""

    name = "half"
    summary = "half of EA/h"

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=2 / points.stiffness)


@hookimpl
def percuss_contacts():
    return [Half]
''',
        encoding="utf-8",
    )
    answer = found(small, plugins=[small.parent / "half.py"], runs=20, contacts=["lagrange", "half"])
    assert {one.candidate.contact for one in answer.tried if one.status == "done"} == {"lagrange", "half"}


# ------------------------------------------------------------------------------------------------------- candidates


@pytest.mark.parametrize("law", REGISTRY.names("contacts"))
def test_options_that_are_drawn_and_neighbours_are_within_their_bounds(law):
    random = np.random.default_rng(0)
    candidate = Candidate("noh-bathe", law)
    for _ in range(40):
        for one in (drawn(candidate, REGISTRY, random), *neighbours(candidate, REGISTRY)):
            REGISTRY.get("contacts", law)  # known
            for key, value in one.contact_options.items():
                option = options_of(REGISTRY.get("contacts", law))[key]
                assert option.unit in ("", "1")
                assert isinstance(value, str) or math.isfinite(value)
            assert 0 < one.courant <= 2
            assert one.refine >= 1
            assert one.pair == candidate.pair
        candidate = drawn(candidate, REGISTRY, random)


def test_neighbours_differ_in_one_thing():
    candidate = Candidate("chung-lee", "uzawa", {"beta": 1.01}, {"iterations": 5, "beta_s": 0.4}, 0.5, 2)
    beside = neighbours(candidate, REGISTRY)
    for one in beside:
        before, after = ({**c.changes, **c.changes.pop("method.contact")} for c in (candidate, one))
        changed = [key for key in after if after[key] != before.get(key) and not key.startswith("method.contact")]
        assert len(changed) == 1, (changed, one)
    assert {one.refine for one in beside} == {1, 2, 3}
    assert {one.courant for one in beside} == {0.4, 0.5, 0.625}
    assert {one.contact_options["iterations"] for one in beside} == {3, 5, 8}


def test_a_step_of_stages_counts_them():
    assert [evaluations(REGISTRY.get("integrators", name)()) for name in ("central-difference", "noh-bathe")] == [1, 2]


def tried(cost, excess):
    return Tried(Candidate("a", "b"), "done", "", "yes", excess, None, cost, cost, cost, excess, "")


def test_the_front_is_what_nothing_dominates():
    random = np.random.default_rng(1)
    runs = [tried(*pair) for pair in random.integers(1, 30, (60, 2)).astype(float)]
    kept = front(runs)
    for one in runs:
        dominated = any(o.cost <= one.cost and o.excess <= one.excess and (o.cost, o.excess) != (one.cost, one.excess)
                        for o in runs)  # fmt: skip
        assert ((one.cost, one.excess) in {(o.cost, o.excess) for o in kept}) is not dominated


# ------------------------------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(("text", "value"), [("1%", 0.01), ("0.5", 0.5), ("", None), ("2e-3", 2e-3)])
def test_a_bound_is_a_number_or_percent(text, value):
    assert bound_of(text, "--error") == value


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--error", "abc"], "--error: expected a number, found 'abc'"),
        (["--error", "-1"], "--error: expected a finite number greater than 0, found -1"),
        (["--error", "0"], "--error: expected a finite number greater than 0, found 0"),
        (["--error", "nan"], "--error: expected a finite number greater than 0, found nan"),
        (["--energy", "inf"], "--energy: expected a finite number greater than 0, found inf"),
        ([], "expected a bound on the error or on the energy, found none"),
        (["--time", "1"], "expected a bound on the error or on the energy, found none"),
        (["--error", "1%", "--measure", "noise"], "--measure: expected a true error, found 'noise'"),
        (["--error", "1%", "--contact", "lagrang"], "--contact: unknown contact law 'lagrang'"),
        (["--error", "1%", "--contact", "cohesive"], "'cohesive' needs a value of strength and length, which no"),
        (["--error", "1%", "--runs", "3"], "--runs: expected a number of at least 10, found 3"),
        (["--error", "1%", "--seed", "-1"], "--seed: expected a whole number of at least 0, found -1"),
        (["--error", "1%", "--plot", "x.gif"], "x.gif"),
    ],
)
def test_bad_input_is_one_message(words, message, tmp_path):
    done = percuss_command("recommend", CASES / "hunek.yaml", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_command_recommends_and_draws(tmp_path):
    words = [
        "recommend",
        CASES / "doyen-impact.yaml",
        "--integrator",
        "central-difference,wu-predictor-corrector",
        "--contact",
        "penalty,lagrange,regularised-lagrange,damped-penalty,moreau-jean,paoli-schatzman,nitsche",
        "--error",
        "5%",
        "--runs",
        "12",
        "--plot",
        "r.svg",
        "--seed",
        "2",
    ]
    told = percuss_command(*words, cwd=tmp_path)
    assert told.returncode == 0, told.stderr
    assert (tmp_path / "r.svg").exists()
    data = json.loads(percuss_command(*words, "--json", cwd=tmp_path).stdout)
    assert data["best"]["meets"]
    assert data["best"]["command"] in told.stdout
    assert f"Courant number {data['best']['time.courant']:g}" in told.stdout
    assert data["untried_pairs"] > 0
    assert "pairs were not tried" in told.stdout
    assert Bounds(**data["bounds"]).error == 0.05


@pytest.mark.slow
def test_what_the_picture_says_is_beside_its_legend(small):
    pytest.importorskip("matplotlib", reason="pictures need the extra percuss[plot]")
    from matplotlib.text import Text

    from percuss.reporting.recommendation_figure import recommendation_figure

    names = {"integrators": ["wu-predictor-corrector"], "contacts": ["decomposition-contact-response"]}
    figure = recommendation_figure(found(small, error=0.5, energy=0.5, runs=12, **names))
    figure.draw_without_rendering()
    said = next(text for text in figure.findobj(Text) if "; cheapest:" in text.get_text())
    assert said.get_window_extent().x1 < figure.legends[0].get_window_extent().x0


@pytest.mark.deep
def test_a_grid_of_all_that_may_be_chosen_has_nothing_cheaper(small):
    """By brute force over mesh and step of the pairs without options, by public means alone."""
    answer = found(small, error=0.02, runs=200, contacts=["lagrange"])
    best = answer.best
    case = percuss.load(small)
    for integrator in INTEGRATORS:
        for refine in range(1, best.candidate.refine + 1):
            for courant in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.99):
                candidate = Candidate(integrator, "lagrange", {}, {}, float(courant), refine)
                result = percuss.run(case.with_overrides({**recommendation._fixed(case), **candidate.changes}))
                cost = result.summary["steps"] * result.summary["nodes"]
                error = max(one["force_error_l1"] for one in result.summary["exact"]["contacts"].values())
                # two neighbours of the search are a factor of 1.25 apart
                assert error > 0.02 or cost > best.evaluations / 1.25
