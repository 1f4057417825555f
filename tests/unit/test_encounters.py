"""Ends that meet without a contact, and contacts whose ends have slid off each other, are told."""

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


def test_so_are_bars_along_any_line_of_a_plane():
    case = two()
    case["bodies"]["a"] |= {"at": [0.6, 0.8], "velocity": [0.6, 0.8], "bar": {**BAR["bar"], "direction": [-3.0, -4.0]}}
    case["bodies"]["b"] |= {"at": [1.26, 1.68], "bar": {**BAR["bar"], "direction": [-3.0, -4.0]}}
    (note,) = notes_of(case)
    assert note == "a.left passes through b.right, by 0.4 at most: no contact is declared between them"
    case["bodies"]["b"]["at"] = [1.27, 1.68]
    assert notes_of(case) == []


def test_a_contact_that_presses_where_its_ends_have_slid_off_each_other_is_noted():
    """Their faces are squares of side 0.2, and move sideways at 1."""
    case = two(gap=0.0, contacts={"ab": {"between": ["a.right", "b.left"]}})
    case["bodies"]["a"] |= {"velocity": [0.1, 1.0]}
    case["bodies"]["b"] |= {"velocity": [-0.1, 0.0], "at": [1.0, 0.0]}
    (note,) = notes_of(case)
    assert note.startswith(
        "contact 'ab' presses from time 0.25 on although its ends have slid off each other: they are"
    )
    assert "and 0.2 wide" in note
    case["bodies"]["a"]["velocity"] = [0.1, 0.3]
    assert notes_of(case) == []


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
