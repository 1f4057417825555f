"""The scoreboard in the pages is what the shipped study gives, and its findings are in the data."""

import re

import pytest

import pages
import scoreboard
from percuss.certificate.verdict import SHARE_OF_CRITICAL_STEP
from percuss.methods.registry import Registry

pytestmark = pytest.mark.deep

NUMBER = r"\d+(?:\.\d+)?"


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """Return the rows of the study."""
    return scoreboard.rows(tmp_path_factory.mktemp("scoreboard"))


def cells(text):
    return [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in text.strip().splitlines()]


def numbers(text):
    return [float(number) for number in re.findall(NUMBER, text)]


def test_the_readme_has_the_scoreboard_of_today(table):
    there = cells(pages.shown("scoreboard"))
    made = cells(scoreboard.scoreboard(table))
    assert len(there) == len(made)
    for line, other in zip(there, made, strict=True):
        for one, two in zip(line, other, strict=True):
            if re.fullmatch(r"[\d.]+", two):
                # two digits are shown, and the second may turn on another machine
                assert float(one) == pytest.approx(float(two), rel=0.06), (line, other)
            else:
                assert one == two


def test_the_findings_of_the_readme_are_those_of_the_data(table):
    there, made = pages.shown("findings"), scoreboard.findings(table)
    assert re.sub(NUMBER, "#", there) == re.sub(NUMBER, "#", made)
    assert numbers(there) == pytest.approx(numbers(made), rel=0.06)


def test_the_reference_is_never_called_a_bound():
    section = pages.section("## The scoreboard")
    for text in (section, scoreboard.STUDY.read_text(encoding="utf-8")):
        assert not re.search(r"\bfloor\b|no contact law can", text)
    assert "reference" in section


def test_limits_in_the_prose_are_those_of_the_code():
    integrator = Registry.load().get("integrators", "noh-bathe")
    limits = pages.texts()["plugins/STABILITY.md"]
    row = next(line for line in limits.splitlines() if line.startswith("| `noh-bathe`"))
    assert f"without contact up to a Courant number of {integrator.critical_courant:.3g} |" in row
    assert f"takes {SHARE_OF_CRITICAL_STEP:g} of the critical step" in pages.everything()


def test_the_twin_is_the_same_for_both_integrators(table):
    error = scoreboard.numbers(table, "force_error_l1")
    one, other = (error[integrator, "tied"] for integrator in (scoreboard.CD, scoreboard.WU))
    assert one.to_numpy() == pytest.approx(other.to_numpy(), rel=1e-6)


def test_every_run_of_the_scoreboard_has_a_true_error_that_does_not_hang_on_round_off(table):
    assert table["status"].eq("done").all()
    assert table["force_error_l1"].notna().all()
    assert not table["fragile"][table["case"] != scoreboard.MANY].any()
