"""The page of the study of solids: its sentences are in its rows, and its rows are what the shipped study gives."""

import pytest
import yaml

import percuss
import solids_study
from marks import deep
from pages import shown
from solids_study import CD, WU

SAMPLE = [
    ("tilted-blocks", "lagrange", WU, "mortar"),
    ("tilted-blocks", "bipenalty", CD, "gauss-points"),
    deep(("strip-impact", "penalty", WU, "node-to-segment")),
    deep(("box-impact", "penalty", CD, "node-to-segment")),
]


@pytest.mark.parametrize("name", solids_study.PARTS)
def test_what_the_page_says_is_in_the_rows(name):
    assert shown(name) == solids_study.PARTS[name](solids_study.Results())


def test_a_sentence_that_is_no_longer_true_is_seen():
    for law, number in (("lagrange", 9.0), ("penalty", 0.01)):
        changed = solids_study.Results()
        changed.rows.loc[changed.rows["law"] == law, "error"] = number
        with pytest.raises(AssertionError):
            solids_study.findings(changed)


@pytest.mark.parametrize("which", SAMPLE, ids=" ".join)
def test_a_row_is_what_the_study_gives(which, tmp_path):
    case, law, scheme, pairing = which
    plan = yaml.safe_load(solids_study.STUDY.read_text(encoding="utf-8"))
    plan |= {"cases": [str(solids_study.STUDY.parents[1] / f"{case}.yaml")], "paired": [{"refine": 0.5}]}
    plan |= {"methods": {"integrators": [scheme], "contacts": [law]}, "vary": {"method.pairing": [pairing]}}
    made = solids_study.rows(percuss.study(plan, tmp_path / "row.sqlite", 1).table).iloc[0]
    kept = solids_study.Results().rows.set_index([*solids_study.KEYS]).loc[*which, 0.5]
    for name in ("error", "displacement", "kept", "noise"):
        assert float(made[name]) == pytest.approx(kept[name], rel=1e-2), name
    assert made["judge"] == kept["judge"]


def test_every_run_of_the_study_is_in_the_rows_or_refused():
    plan = yaml.safe_load(solids_study.STUDY.read_text(encoding="utf-8"))
    lines = solids_study.Results().rows
    laws, pairings = plan["methods"]["contacts"], plan["vary"]["method.pairing"]
    assert set(lines["law"]) == set(laws)
    # Lagrange multipliers and the other laws without compliance are refused on Gauss points.
    sharp = {"lagrange", "moreau-jean"}
    there = {(case, law, pairing) for case in set(lines["case"]) for law in laws for pairing in pairings}
    refused = {one for one in there if one[1] in sharp and one[2] == "gauss-points"}
    assert set(zip(lines["case"], lines["law"], lines["pairing"], strict=True)) == there - refused
    assert len(lines) == 4 * len(there - refused)
