"""The page of the whole family: its sentences are in its tables, and its tables are what the shipped study gives."""

import itertools
import math
import re

import pandas as pd
import pytest
import yaml

import family
import pages
from percuss import LeapFrog
from percuss.methods.registry import Registry
from percuss.studies.candidates import needed_quantities

TABLES = family.Tables()
SAMPLE = (
    ("penalty", "wu-predictor-corrector"),
    ("lagrange", "tchamwa-wielgosz"),
    ("uzawa", "velocity-verlet"),
    ("moreau-jean", "central-difference"),
    ("walton-braun", "noh-bathe"),
    ("penalty", "central-difference"),  # the others are compared to it
)


@pytest.mark.parametrize("name", family.PARTS)
def test_what_the_pages_say_is_in_the_files(name):
    assert pages.shown(name) == family.PARTS[name](TABLES)


def test_a_sentence_that_is_no_longer_true_is_seen():
    changed = family.Tables()
    changed.medians.loc[("penalty", "central-difference"), "error"] = 0.5
    with pytest.raises(AssertionError):
        family.findings(changed)
    with pytest.raises(AssertionError):
        family.advice(changed)


def gives_own_steps(scheme):
    return isinstance(scheme, LeapFrog) and scheme.own_steps


def test_the_study_has_every_method_that_needs_no_quantity_of_the_case():
    registry, plan = Registry.load(), yaml.safe_load(family.STUDY.read_text(encoding="utf-8"))
    schemes = {name: registry.get("integrators", name)().bind(1.0) for name in registry.names("integrators")}
    # A scheme of own steps is central difference in rows of bodies alike.
    left_out = {name for name, scheme in schemes.items() if gives_own_steps(scheme)}
    assert set(plan["methods"]["integrators"]) == set(schemes) - left_out
    laws = {name: registry.get("contacts", name) for name in registry.names("contacts")}
    free = {name for name, law in laws.items() if not law.tied_during and not needed_quantities(law)}
    assert set(plan["methods"]["contacts"]) == free
    assert set(TABLES.errors.index.unique("law")) <= free


def close(one, other, within):
    """Return whether two cells agree: their words, and their numbers to within a fraction."""
    numbers = [[float(x) for x in re.findall(r"\d+(?:\.\d+)?(?:e-?\d+)?", text)] for text in (one, other)]
    words = [re.sub(r"[\d.e-]+", "#", text) for text in (one, other)]
    return words[0] == words[1] and all(
        math.isclose(a, b, rel_tol=within, abs_tol=1e-9) for a, b in zip(*numbers, strict=True)
    )


@pytest.mark.nightly
def test_the_tables_are_those_of_the_study(tmp_path):
    """A sample of the pairs is run again, on all cases, meshes and steps; two digits are shown."""
    plan = yaml.safe_load(family.STUDY.read_text(encoding="utf-8"))
    plan["cases"] = [str((family.STUDY.parent / case).resolve()) for case in plan["cases"]]
    made = []
    for law, scheme in SAMPLE:
        plan["methods"] = {"integrators": [scheme], "contacts": [law]}
        made.append(family.rows(tmp_path / f"{law}-{scheme}.sqlite", plan))
    table = pd.concat(made, ignore_index=True)
    for name, make in family.MADE.items():
        there, kept = make(table), family.read(name)
        kept = kept[kept.index.droplevel("mass").isin(SAMPLE)] if name == "masses" else kept.loc[list(SAMPLE)]
        assert set(kept.index) == set(there.index)
        for pair, column in itertools.product(kept.index, kept):
            one, other = kept.loc[pair, column], there.loc[pair, column]
            if column == "of fifty":  # which depends on round-off
                assert abs(float(one) - float(other)) < 10.0, pair
            elif column == "cost":  # a time
                assert min(float(one), float(other)) > 0.0, pair
            else:
                tiny = column == "overlap" and float(other) < 1e-10 > float(one)
                assert tiny or close(one, other, 0.06), (pair, column, one, other)
