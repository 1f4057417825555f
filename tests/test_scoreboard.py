"""The scoreboard in the README is what the shipped study gives, and its findings are in the data."""

import re

import pytest

import scoreboard

README = (scoreboard.ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """Return the rows of the study."""
    return scoreboard.rows(tmp_path_factory.mktemp("scoreboard"))


def cells(text):
    return [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in text.strip().splitlines()]


def test_the_readme_has_the_scoreboard_of_today(table):
    shown = cells(README.partition(scoreboard.BEGIN)[2].partition(scoreboard.END)[0])
    made = cells(scoreboard.scoreboard(table))
    assert len(shown) == len(made)
    for line, other in zip(shown, made, strict=True):
        for one, two in zip(line, other, strict=True):
            if re.fullmatch(r"[\d.]+", two):
                # two digits are shown, and the second may turn on another machine
                assert float(one) == pytest.approx(float(two), rel=0.06), (line, other)
            else:
                assert one == two


def value(table, case, pair, name):
    integrator, contact = pair
    one = table[(table["case"] == case) & (table["integrator"] == integrator) & (table["contact"] == contact)]
    return float(one[name].iloc[0])


CD, WU = "central-difference", "wu-predictor-corrector"


@pytest.mark.parametrize("case", ["hunek", "unlike", "carpenter", "doyen-impact", "cradle"])
def test_a_spring_judged_late_is_at_the_floor(table, case):
    ringing = value(table, case, (CD, "penalty"), "force_error_l1")
    calm = value(table, case, (WU, "penalty"), "force_error_l1")
    floor = value(table, case, (WU, "tied"), "force_error_l1")
    assert 1.5 < ringing / calm < 11.5
    assert calm < 1.5 * floor


def test_multipliers_are_at_the_floor(table):
    for case in dict.fromkeys(table["case"]):
        floor = value(table, case, (CD, "tied"), "force_error_l1")
        one, other = (value(table, case, (integrator, "lagrange"), "force_error_l1") for integrator in (CD, WU))
        assert one == pytest.approx(other, rel=1e-6)
        assert one < 1.1 * floor
    for case in ("preloaded", "smooth-pulse"):
        best = value(table, case, (WU, "lagrange"), "force_error_l1")
        worse = [value(table, case, (i, law), "force_error_l1") for i in (CD, WU) for law in ("penalty", "bipenalty")]
        assert 8 < min(worse) / best < max(worse) / best < 95


def test_who_is_calm_pays_in_energy(table):
    kept = {
        pair: value(table, "doyen-bounce", pair, "energy_kept")
        for pair in ((WU, "penalty"), (WU, "bipenalty"), (CD, "penalty"), (CD, "bipenalty"), (CD, "lagrange"))
    }
    assert max(kept[WU, "penalty"], kept[WU, "bipenalty"]) < 0.25
    assert 0.7 < kept[CD, "lagrange"] < 0.8
    assert 0.97 < kept[CD, "penalty"] < 1
    assert 1.1 < kept[CD, "bipenalty"] < 1.25
