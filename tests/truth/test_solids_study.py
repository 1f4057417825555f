"""The page of the study of solids: its sentences are in its rows, and its rows are what the shipped study gives."""

import pandas as pd
import pytest
import yaml

import percuss
import solids_study
from pages import shown
from solids_study import CD, WU

SAMPLE = [
    ("tilted-blocks", "lagrange", WU, "mortar"),
    ("tilted-blocks", "bipenalty", CD, "gauss-points"),
    pytest.param(("strip-impact", "penalty", WU, "node-to-segment"), marks=pytest.mark.deep),
    pytest.param(("box-impact", "penalty", CD, "node-to-segment"), marks=pytest.mark.deep),
]


RESULTS = solids_study.Results()
CURVED, LAWS = ("disk-on-wall", "ball-on-wall"), ("penalty", "bipenalty", "regularised-lagrange")


def test_the_table_of_the_page_is_that_of_the_rows():
    assert shown("errors on surfaces") == solids_study.matrix(RESULTS)


def test_what_the_page_concludes_is_in_the_rows():
    error, noise, grown, kept = (RESULTS.of(name) for name in ("error", "noise", "growth", "kept"))
    pairs = [(law, scheme) for law in (*LAWS, "lagrange") for scheme in (CD, WU)]
    for strip, bars in {"strip-impact": "hunek", "strip-unlike": "unlike"}.items():
        for pair in pairs:  # a strip errs as its bar, and the pairing matters little
            assert error[strip, *pair, "mortar"] == pytest.approx(float(RESULTS.bars[pair][bars]), rel=0.05)
            assert error[strip, *pair, "node-to-segment"] < 1.2 * error[strip, *pair, "mortar"]
    for case in CURVED:  # a round body needs a law without compliance; at a wall the pairings are one
        soft = min(error[case, law, scheme, "mortar"] for law in LAWS for scheme in (CD, WU))
        assert error[case, "lagrange", WU, "mortar"] < 0.2 * soft
        assert all(error[case, *pair, "mortar"] == error[case, *pair, "node-to-segment"] for pair in pairs)
    assert noise["box-impact", "penalty", CD, "mortar"] > 1.5 * noise["box-impact", "penalty", WU, "mortar"]
    assert max(grown[key] for key in grown if key[1] in ("regularised-lagrange", "lagrange")) < 1e-10
    assert max(abs(kept[key] - 100.0) for key in kept if key[1] == "penalty" and key[2] == CD) < 0.3
    assert kept["tilted-blocks", "bipenalty", CD, "mortar"] > 100.5
    tilted = {key: value for key, value in error.items() if key[0] == "tilted-blocks"}
    assert tilted["tilted-blocks", "lagrange", WU, "mortar"] == min(tilted.values())


@pytest.mark.parametrize("which", SAMPLE, ids=" ".join)
def test_a_row_is_what_the_study_gives(which, tmp_path):
    case, law, scheme, pairing = which
    plan = yaml.safe_load(solids_study.STUDY.read_text(encoding="utf-8"))
    plan |= {"cases": [str(solids_study.STUDY.parents[1] / f"{case}.yaml")], "paired": [{"refine": 0.5}]}
    plan |= {"methods": {"integrators": [scheme], "contacts": [law]}, "vary": {"method.pairing": [pairing]}}
    head, line = solids_study.rows(percuss.study(plan, tmp_path / "row.sqlite", 1).table)
    made = dict(zip(head, line, strict=True))
    (kept,) = [
        one
        for one in RESULTS.lines
        if one["refine"] == "0.5" and (one["case"], one["law"], one["integrator"], one["pairing"]) == which
    ]
    for name in ("error", "displacement", "kept", "noise"):
        assert float(made[name]) == pytest.approx(float(kept[name]), rel=1e-2), name
    assert made["judge"] == kept["judge"]


def test_every_run_of_the_study_is_in_the_rows_or_refused():
    plan = yaml.safe_load(solids_study.STUDY.read_text(encoding="utf-8"))
    lines = pd.DataFrame(RESULTS.lines)
    laws, pairings = plan["methods"]["contacts"], plan["vary"]["method.pairing"]
    assert set(lines["law"]) == set(laws)
    # Lagrange multipliers and the other laws without compliance are refused on Gauss points.
    sharp = {"lagrange", "moreau-jean"}
    there = {(case, law, pairing) for case in set(lines["case"]) for law in laws for pairing in pairings}
    refused = {one for one in there if one[1] in sharp and one[2] == "gauss-points"}
    assert set(zip(lines["case"], lines["law"], lines["pairing"], strict=True)) == there - refused
    assert len(lines) == 4 * len(there - refused)
