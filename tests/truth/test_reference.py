"""A finer run as judge: its errors are those against an exact solution but for its own error, and it is one for all."""

import math

import numpy as np
import pytest
from support.places import CASES

import percuss
from marks import deep
from percuss.case.quantities import by_two, percent
from percuss.march.model_of_case import model_of
from percuss.reporting.study_data import columns, records
from percuss.reporting.terminal import _error_lines, _ranks, comparison_lines
from percuss.reporting.verdict import answer, comparison_verdict, run_verdict
from percuss.results import reference
from percuss.results.reference import _at_nodes, case_of
from percuss.studies.comparison import metrics
from percuss.studies.tasks import two_references

BLOCKS = CASES / "tilted-blocks.yaml"


def hidden(monkeypatch):
    """Hide the exact solutions, so that a case that has one is judged by a finer run."""
    monkeypatch.setattr("percuss.results.assemble.exact_solution", lambda *_: (None, "", "hidden"))


@pytest.mark.parametrize("name", ["unlike", deep("strip-unlike")])
def test_an_estimate_is_the_true_error_but_for_the_error_of_the_finer_run(name, monkeypatch):
    case = percuss.load(CASES / f"{name}.yaml", {"time": {"courant": 0.7, "end": 0.2}, "expect": ()})
    true = percuss.run(case)
    own = percuss.run(case_of(case.with_overrides({"reference.refine": 3}), 0.2)).summary["exact"]["displacement_error"]
    hidden(monkeypatch)
    judged = percuss.run(case, {"reference.refine": 3})
    exact, finer = (result.arrays[f"contact_force_{kind}"] for result, kind in ((true, "exact"), (judged, "finer")))
    force = true.arrays["contact_force"]
    known = np.isfinite(exact) & np.isfinite(finer)
    assert known.sum() >= known.size - 2 * known.shape[1]
    (of_run, of_finer, between) = (
        np.abs(np.where(known, part, 0.0)).sum() for part in (force - exact, finer - exact, force - finer)
    )
    assert of_finer < 0.7 * of_run
    assert abs(of_run - between) <= of_finer * (1.0 + 1e-9)
    (told,) = (contact["force_error_l1"] for contact in judged.summary["estimated"]["contacts"].values())
    assert told == pytest.approx(between / np.abs(np.where(known, finer, 0.0)).sum(), rel=1e-9)
    error, estimate = true.summary["exact"]["displacement_error"], judged.summary["estimated"]["displacement_error"]
    assert own < 0.9 * error
    assert abs(estimate - error) < 1.1 * own  # their norms are on unlike meshes
    assert judged.summary["exact"] is None
    (contact,) = judged.summary["estimated"]["contacts"].values()
    assert contact["overshoot"] is None  # that of the finer run is in it too
    assert not any("overshoot" in str(line) for line in _error_lines(judged.summary))
    assert any("overshoot" in str(line) for line in _error_lines(true.summary))


def test_one_finer_run_judges_all_methods_steps_and_meshes(monkeypatch):
    marched, march = [], reference._march
    monkeypatch.setattr(reference, "_march", lambda case, *how: marched.append(case) or march(case, *how))
    case = percuss.load(BLOCKS, {"reference.refine": 2, "time.end": 1.0, "expect": (), "title": "finer runs"})
    vary = {"time.courant": [0.5, 0.9], "refine": [0.5, 1]}
    runs = percuss.compare(case, contacts=["lagrange", "penalty"], vary=vary)
    assert [run.status for run in runs] == ["done"] * 8
    assert len(marched) == 2  # of two laws
    judges = {run.result.summary["estimated"]["solution"] for run in runs}
    judge = "refine 2 with wu-predictor-corrector and"
    assert judges == {f"{judge} lagrange, mortar and {judge} penalty, mortar"}
    errors = {run.varied["refine"]: run.result.summary["estimated"]["displacement_error"] for run in runs}
    assert errors[1] < errors[0.5]


def test_displacements_between_the_nodes_of_the_finer_mesh_are_those_of_its_cells():
    case = percuss.load(BLOCKS, {"expect": ()})
    coarse, fine = model_of(case), model_of(case.with_overrides({"refine": 1.6}))
    gradient = np.array([[0.3, -0.2], [0.1, 0.4]])
    for name, body in coarse.bodies.items():
        moved = _at_nodes(body.mesh.nodes, fine.bodies[name], fine.bodies[name].mesh.nodes @ gradient)
        assert np.abs(moved - body.mesh.nodes @ gradient).max() < 1e-12


def test_the_finer_run_keeps_what_the_case_is_and_leaves_how_it_is_computed():
    case = percuss.load(
        BLOCKS,
        {
            "reference": {"refine": 2, "contact": "regularised-lagrange"},
            "method.contact": "penalty",
            "method.integrator": "central-difference",
            "contacts.seam.pairing": "node-to-segment",
            "expect": (),
        },
    )
    finer = case_of(case, 2.0)
    assert [finer.refine, finer.time.end, finer.time.courant] == [2, 2.0, 0.5]
    seam = finer.contacts["seam"]
    assert [seam.law.name, seam.pairing.name] == ["regularised-lagrange", "mortar"]
    assert finer.method.integrator.name == "wu-predictor-corrector"
    own = case.with_overrides({"contacts.seam.method": {"name": "tied"}})
    assert case_of(own, 2.0).contacts["seam"].law.name == "tied"
    bond = {"name": "cohesive", "strength": 0.2, "length": 0.5}
    assert case_of(case.with_overrides({"method.contact": bond}), 2.0).contacts["seam"].law.strength == 0.2


def box(at, elements, speed):
    return {
        "block": {"size": [1.0, 1.0, 0.5], "elements": elements},
        "at": [0.0, 0.0, at],
        "material": {"young": 1.0, "density": 1.0, "poisson": 0.3},
        "velocity": [0.0, 0.0, speed],
    }


PAIRINGS = ["mortar", "node-to-segment"]


@pytest.mark.parametrize(
    "changes", [{}, {"method.friction": None, "contacts.seam.friction": {"name": "coulomb", "mu": 0.3}}]
)
def test_the_finer_run_slides_with_the_friction_of_the_case(changes):
    """Friction and large sliding are what the case is, wherever it says so."""
    case = percuss.load(CASES / "slide-off.yaml", {"reference": {"refine": 2}, **changes})
    (seam,) = case_of(case, 0.1).contacts.values()
    assert (seam.friction.name, seam.friction.mu, seam.sliding, seam.pairing.name) == (
        "coulomb", 0.3, "large", "mortar"
    )  # fmt: skip


@pytest.mark.parametrize("order", [PAIRINGS, PAIRINGS[::-1]])
def test_runs_of_two_pairings_are_judged_by_both_and_favoured_by_neither(order):
    """Against each finer run alone the pairing that made it comes out ahead."""
    case = percuss.load(
        {
            "percuss": 1,
            "bodies": {"upper": box(0.5, [3, 3, 2], -0.01), "lower": box(0.0, [2, 2, 2], 0.0)},
            "contacts": {"seam": {"between": ["upper.bottom", "lower.top"]}},
            "method": {"contact": "lagrange", "pairing": "mortar"},
            "time": {"end": 1.0, "courant": 0.5},
            "reference": {"refine": 2},
        }
    )
    single = {
        (pairing, judge): percuss.run(case, {"method.pairing": pairing, "reference.pairing": judge}).summary[
            "estimated"
        ]
        for pairing in PAIRINGS
        for judge in PAIRINGS
    }
    assert all(single[one, one]["displacement_error"] < single[one, other]["displacement_error"]
               for one, other in (PAIRINGS, PAIRINGS[::-1]))  # fmt: skip
    runs = percuss.compare(case, vary={"method.pairing": order})
    for run in runs:
        estimated, pairing = run.result.summary["estimated"], run.varied["method.pairing"]
        for found, judge in ((estimated, "mortar"), (estimated["second"], "node-to-segment")):
            assert found["contacts"] == single[pairing, judge]["contacts"]
            assert found["displacement_error"] == single[pairing, judge]["displacement_error"]
        error = metrics(run)["displacement_error"]
        assert error == max(single[pairing, judge]["displacement_error"] for judge in PAIRINGS)
    errors = [metrics(run)["displacement_error"] for run in runs]
    apart = estimated["apart"]["displacement_error"]
    assert abs(errors[0] - errors[1]) < apart < 0.2
    table, judges = list(comparison_lines("", runs))
    cells = next(column.cells for column in table.columns if column.head == "displ.")
    for cell, pairing in zip(cells, order, strict=True):
        assert cell == " / ".join(percent(single[pairing, judge]["displacement_error"]) for judge in PAIRINGS)
    assert "lagrange, mortar and refine 2 with wu-predictor-corrector and lagrange, node-to-segment" in judges
    (told,) = comparison_verdict("box", runs)
    assert told.startswith("box: 2 of 2 runs share the first rank (")
    assert "differ by less than the two finer runs that judge them" in told


def test_the_two_finer_runs_are_those_of_two_of_the_laws_and_pairings_that_work_together():
    case = percuss.load(BLOCKS, {"reference.refine": 2, "expect": ()})

    def chosen(contacts=(), **vary):
        points = [{f"method.{kind}": name} for kind, names in vary.items() for name in names]
        found = two_references(case, {name: name for name in contacts}, points)
        return [
            [one.name if one else None for one in (judge.contact, judge.pairing)] if judge else None
            for judge in (found.reference, found.reference.second)
        ]

    assert chosen() == [[None, None], None]
    assert chosen(["penalty"]) == [[None, None], None]
    assert chosen(["penalty", "lagrange"]) == [["lagrange", None], ["penalty", "mortar"]]
    assert chosen(["penalty", "bipenalty"]) == [["penalty", None], ["bipenalty", "mortar"]]
    assert chosen(pairing=PAIRINGS[::-1]) == [[None, "mortar"], ["lagrange", "node-to-segment"]]
    assert chosen(pairing=["gauss-points", *PAIRINGS]) == [[None, "mortar"], ["lagrange", "node-to-segment"]]
    case = case.with_overrides({"contacts.seam.pairing": "mortar"})
    assert chosen(pairing=["gauss-points", *PAIRINGS]) == [[None, "mortar"], ["lagrange", "node-to-segment"]]
    # lagrange refuses Gauss points: the law of the case stands in for it
    case = case.with_overrides({"method.contact": "penalty"})
    assert chosen(pairing=["mortar", "gauss-points"]) == [[None, "mortar"], ["penalty", "gauss-points"]]


def test_ranks_of_a_study_are_shared_by_what_its_two_finer_runs_cannot_tell_apart(tmp_path):
    study = {
        "percuss-study": 1,
        "cases": [str(BLOCKS), str(CASES / "strip-unlike.yaml")],
        "set": {"time.end": 1.0, "reference.refine": 2},
        "vary": {"method.contact": ["lagrange", "penalty"]},
        "measure": ["force_error_l1"],
    }
    made = percuss.study(study, tmp_path / "rows.sqlite", 1)
    first, second, apart = by_two("force_error_l1")
    rows, known = ([row for row in made.as_records() if row["case"] == name] for name in made.cases)
    assert [row["estimated.solution"] for row in known] == [None, None]
    assert all(math.isfinite(row["force_error_l1"]) for row in known)
    assert all(row["force_error_l1"] == max(row[first], row[second]) for row in rows)
    assert abs(rows[0]["force_error_l1"] - rows[1]["force_error_l1"]) < min(row[apart] for row in rows)
    assert _ranks([0.1, 0.12, 0.16, 0.19, 0.3], 0.05) == ["1", "1", "3", "3", "5"]
    judge = made.cases["tilted-blocks"]["case"]["reference"]["second"]
    assert judge == {"contact": "penalty", "pairing": "mortar"}
    assert "share the first rank" in next(answer(records(made.table, columns(made)), columns(made).measures))


def test_a_finer_run_that_cannot_judge_says_why():
    case = percuss.load(BLOCKS, {"expect": ()})
    same = percuss.run(case, {"reference.refine": 1}).summary
    assert same["estimated"] is None
    assert "the finer run (refine 1) is not finer than this run (refine 1)" in same["exact_reason"]
    unstable = percuss.run(case, {"reference": {"refine": 2, "courant": 3.0}}).summary
    assert unstable["estimated"] is None
    assert "the finer run that would judge it was not made: it is unstable" in unstable["exact_reason"]


def test_where_the_exact_solution_is_known_no_finer_run_is_made(monkeypatch):
    monkeypatch.setattr("percuss.results.reference._march", lambda *_: pytest.fail("a finer run was made"))
    summary = percuss.run(percuss.load(CASES / "strip-unlike.yaml", {"reference.refine": 2, "expect": ()})).summary
    assert summary["estimated"] is None
    assert summary["exact"] is not None


def test_estimates_are_called_estimates_in_words():
    runs = percuss.compare(
        percuss.load(BLOCKS, {"reference.refine": 2, "expect": ()}), vary={"time.courant": [0.5, 0.9]}
    )
    told = list(map(str, comparison_lines("", runs)))[-1]
    assert told.startswith("force, impulse, displ.: errors estimated by a finer run: refine 2 with")
    assert "has the smallest estimated force error" in next(comparison_verdict("", runs))
    words = " ".join(run_verdict(runs[0].result, "more"))
    assert " is off by about " in words
    assert "(an estimate, by a finer run: refine 2 with" in words
