"""The pictures of the pages show what percuss draws today: its lines and texts, and not its pixels."""

import json
import math

import pytest

pytest.importorskip("matplotlib")

from PIL import Image

import gallery
import pages

ALWAYS = {"hunek", "two-bars", "compared", "family"}  # the pictures of the first pages; each takes some seconds


def agree(one, other, within):
    """Return whether two drawn things agree: their words, and their numbers to within a share of the largest."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(agree(one[key], other[key], within) for key in one)
    if isinstance(one, str):
        return pages.alike(one, other)
    if one and all(isinstance(value, (float, int, type(None))) for value in one):
        size = within * max((abs(value) for value in one if value is not None), default=0.0)
        return len(one) == len(other) and all(
            a is b is None or (a is not None and b is not None and math.isclose(a, b, rel_tol=within, abs_tol=size))
            for a, b in zip(one, other, strict=True)
        )
    return len(one) == len(other) and all(agree(a, b, within) for a, b in zip(one, other, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [name if name in ALWAYS else pytest.param(name, marks=pytest.mark.deep) for name in gallery.ALL]
)
def test_a_picture_shows_what_is_drawn_today(name, tmp_path):
    """`python tests/support/gallery.py` draws the pictures anew."""
    pages.fill(tmp_path)
    made = json.loads(json.dumps(gallery.drawn(gallery.figure_of(name, tmp_path))))
    within = math.inf if name in gallery.ROUND_OFF else 1e-2
    assert agree(gallery.kept(name), made, within), made


@pytest.mark.parametrize("name", gallery.ALL)
def test_a_picture_is_small_and_of_the_kept_data(name):
    path = gallery.FOLDER / f"{name}.png"
    assert path.stat().st_size <= gallery.LARGEST
    with Image.open(path) as picture:
        assert picture.text["drawn"] == gallery.digest(gallery.kept(name))
    assert f"gallery/{name}.png)" in pages.everything()


def test_the_gallery_shows_every_shipped_case():
    page = pages.texts()["cases/GALLERY.md"]
    for name in gallery.SHIPPED:
        assert f"(gallery/{name}.png)" in page


def test_a_changed_line_or_word_is_seen():
    shown = gallery.kept("hunek")
    for path in (("panels", 0, "lines", 0, "y"), ("panels", 0, "limits")):
        changed = json.loads(json.dumps(shown))
        part = changed
        for key in path:
            part = part[key]
        part[3] += 0.05
        assert not agree(shown, changed, 1e-2)
    assert agree(shown, shown, 1e-2)
    assert not agree(shown, {**shown, "words": ["another", *shown["words"][1:]]}, 1e-2)
