"""The pictures of the pages show what percuss draws today: their texts and axes, and not their pixels."""

import json
import math

import pytest

pytest.importorskip("matplotlib")

import gallery
import pages

ALWAYS = {"hunek", "compared", "family"}  # the pictures of the first pages; each takes some seconds
NIGHTLY = {"oblique-spheres", "two-spheres"}


def mark_of(name):
    return () if name in ALWAYS else pytest.mark.nightly if name in NIGHTLY else pytest.mark.deep


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(name, marks=mark_of(name)) for name in gallery.ALL])
def test_a_picture_shows_what_is_drawn_today(name, tmp_path):
    """`python tests/support/gallery.py` draws the pictures anew."""
    pages.fill(tmp_path)
    kept, made = gallery.kept(name), gallery.drawn(gallery.figure_of(name, tmp_path))
    for there, panel in zip(kept["panels"], made["panels"], strict=True):
        size = max(map(abs, there["limits"]))
        within = {"rel": 1e-2, "abs": math.inf if name in gallery.ROUND_OFF else 1e-2 * size}
        assert panel.pop("limits") == pytest.approx(there.pop("limits"), **within)
    assert pages.alike(json.dumps(kept), json.dumps(made))


@pytest.mark.parametrize("name", gallery.ALL)
def test_a_picture_is_small_and_on_a_page(name):
    assert (gallery.FOLDER / f"{name}.png").stat().st_size <= gallery.LARGEST
    assert f"gallery/{name}.png)" in pages.everything()
