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
PAIRS = [(integrator, law) for integrator in (CD, WU) for law in ("penalty", "bipenalty", "lagrange")]


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


@pytest.mark.parametrize("case", ["hunek", "unlike", "carpenter", "doyen-impact", "sdnv100"])
def test_who_is_calm_pays_in_energy(table, case):
    kept = {pair: value(table, case, pair, "energy_kept") for pair in PAIRS}
    assert all(0.992 < kept[WU, law] < 0.9985 for law in ("penalty", "bipenalty"))
    assert all(0.9945 < kept[integrator, "lagrange"] < 0.9975 for integrator in (CD, WU))
    assert abs(kept[CD, "penalty"] - 1) < 2e-4


def test_two_bounces(table):
    kept = {pair: value(table, "doyen-bounce", pair, "energy_kept") for pair in PAIRS}
    assert kept[WU, "bipenalty"] == pytest.approx(0.985, abs=1e-3)
    assert kept[WU, "penalty"] == pytest.approx(0.986, abs=1e-3)
    assert kept[CD, "lagrange"] == pytest.approx(0.995, abs=1e-3)
    assert kept[CD, "penalty"] == pytest.approx(1, abs=3e-4)
    assert kept[CD, "bipenalty"] == pytest.approx(1.001, abs=3e-4)
