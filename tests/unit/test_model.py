"""The model of a case never changes, models derived from it share its arrays; what has no model is told at once."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import percuss
import places
from percuss.contact.contact_problem import contact_problem
from percuss.contact.laws import parameters
from percuss.march.march import March
from percuss.march.model_of_case import model_of, with_laws, with_step
from strategies import hunek

HUNEK = places.CASES / "hunek.yaml"


def test_a_model_never_changes():
    model = model_of(percuss.load(hunek(6)))
    for thing, name in ((model, "dt"), (model, "anything"), (model.laws[0], "law")):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(thing, name, None)
    with pytest.raises(ValueError, match="read-only"):
        model.bodies.mass[0] = 1.0


def test_another_step_gives_another_model_equal_to_that_of_the_case_with_this_step():
    case = hunek(6, integrator="central-difference", contact={"name": "penalty", "stiffness": "from-step"})
    first = model_of(percuss.load(case))
    again = with_step(first, 0.5 * first.dt)
    whole = model_of(percuss.load(case, {"time": {"end": case["time"]["end"], "step": 0.5 * first.dt}}))
    assert again.bodies is first.bodies
    assert (again.dt, again.steps) == (whole.dt, whole.steps)
    assert first.dt == 2.0 * again.dt
    assert parameters(again) == parameters(whole) != parameters(first)
    assert (again.law_records()[1] == whole.law_records()[1]).all()


def test_another_law_gives_another_model_and_leaves_the_first_as_it_was():
    case = hunek(6, integrator="central-difference", contact={"name": "penalty", "beta_s": 0.25})
    first = model_of(percuss.load(case))
    law = first.laws[0].law
    stiffer = with_laws(first, {law: dataclasses.replace(law, beta_s=0.75)})
    assert stiffer.bodies is first.bodies
    assert parameters(stiffer)["tip"]["beta_s"] == 0.75
    assert parameters(first)["tip"]["beta_s"] == 0.25
    case["method"]["contact"]["beta_s"] = 0.75
    forces = [March(model).run().record.contact_force for model in (first, stiffer, model_of(percuss.load(case)))]
    assert np.array_equal(forces[1], forces[2])
    assert not np.array_equal(forces[0], forces[1])


@pytest.mark.parametrize(
    ("refine", "elements"), [(0.25, (25, 50)), (0.333, (33, 67)), (1e-9, (1, 1)), (1.5, (150, 300))]
)
def test_a_refinement_that_is_no_whole_number_is_rounded_to_whole_elements(refine, elements):
    options = {f"bodies.{name}.bar.elements": n for name, n in zip(("short", "long"), elements, strict=True)}
    refined, given = (percuss.run(percuss.load(HUNEK, changes)) for changes in ({"refine": refine}, options))
    assert refined.summary["nodes"] == sum(elements) + 2
    force = [result.histories["contact_force"].to_numpy() for result in (refined, given)]
    assert np.array_equal(*force)


def test_the_problem_of_an_exact_solution_knows_no_mesh_and_cannot_be_changed():
    problems = [contact_problem(model_of(percuss.load(HUNEK, {"refine": refine}))) for refine in (1, 3)]
    for problem in problems:
        assert [(contact.name, contact.ends) for contact in problem.contacts] == [
            ("tip", (("short", False), ("long", True)))
        ]
        lengths = {name: body.length for name, body in problem.bodies.items()}
        assert lengths == pytest.approx({"short": 10.0, "long": 20.0}, rel=1e-14)


def test_two_laws_that_an_integrator_refuses_are_both_named():
    """Everything that does not work together is told at once."""
    case = hunek(6, integrator="chung-lee", contact="uzawa")
    case["contacts"]["stop"] = {"body": "long.right", "wall": 30.0, "method": "lagrange"}
    case["bodies"]["long"]["fixed"] = []
    with pytest.raises(percuss.RefusedPair) as refused:
        model_of(percuss.load(case))
    told = str(refused.value)
    assert "uzawa" in told
    assert "lagrange" in told
