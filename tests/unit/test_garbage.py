"""The pause in the search for garbage begins and ends where it should, and cases and results are made inside it."""

import gc

import pytest

import percuss
from percuss.garbage import collection_paused
from strategies import hunek


def test_the_search_goes_on_after_the_pause_whatever_happens_in_it():
    assert gc.isenabled()
    with collection_paused():
        with collection_paused():
            assert not gc.isenabled()
        assert not gc.isenabled()
    assert gc.isenabled()
    with pytest.raises(ValueError, match="wrong"), collection_paused():
        raise ValueError("wrong")
    assert gc.isenabled()


def test_a_search_that_was_off_stays_off():
    gc.disable()
    try:
        with collection_paused():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_nothing_is_searched_while_a_case_is_read():
    """With a search after every other object there would be hundreds; a few are made before and after the pause."""
    searches = []
    case = percuss.load(hunek(n=2))

    def noted(phase, info):
        searches.append(phase)

    threshold = gc.get_threshold()
    gc.callbacks.append(noted)
    gc.set_threshold(1)
    try:
        case.with_overrides({"refine": 2})
    finally:
        gc.set_threshold(*threshold)
        gc.callbacks.remove(noted)
    assert len(searches) < 100
