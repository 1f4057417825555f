"""Ends that meet without a contact are told."""

import pytest

from percuss import load, run
from percuss.march.model_of_case import model_of
from percuss.reporting.explanation import explanation

BAR = {"bar": {"length": 1.0, "elements": 4}, "area": 0.04, "material": {"young": 1.0, "density": 1.0}}


def two(gap=0.1, **more):
    """Two bars in a row of which the first moves towards the second."""
    return {
        "percuss": 1,
        "bodies": {"a": {**BAR, "velocity": 1.0}, "b": {**BAR, "at": 1.0 + gap}},
        "time": {"end": 0.5, "courant": 0.5},
        **more,
    }


def foreseen(case):
    return explanation(model_of(load(case))).data["notes"]


def notes_of(case):
    return run(load(case)).summary["notes"]


@pytest.mark.parametrize("probes", [[], ["a.right", "b.left"]])
def test_bodies_that_pass_through_each_other_without_a_contact_are_noted(probes):
    (note,) = notes_of(two(record={"probes": probes}))
    assert note == "a.right passes through b.left, by 0.4 at most: no contact is declared between them"


def test_a_check_says_which_ends_will_meet_without_a_contact():
    (note,) = foreseen(two())
    assert note == (
        "a.right and b.left will meet at time 0.1 if their bodies keep their first velocities, and no contact is "
        "declared between them"
    )
    assert foreseen(two(gap=0.0)) == ["a.right and b.left touch, and no contact is declared between them"]
    assert foreseen(two(gap=0.6)) == []


def test_nothing_is_noted_of_a_declared_contact_nor_of_experiments_on_one_line():
    ab = {"ab": {"between": ["a.right", "b.left"]}}
    assert notes_of(two(contacts=ab)) == []
    case = two(contacts={**ab, "cd": {"between": ["c.right", "d.left"]}})
    case["bodies"] |= {"c": {**BAR, "velocity": 1.0}, "d": {**BAR, "at": 1.2}}
    assert notes_of(case) == []
    assert foreseen(case) == []
