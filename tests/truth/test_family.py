"""The page of the whole family: its sentences are in its tables, and its tables are what the shipped study gives."""

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
MEDIANS = family.read("medians")[0][2:]  # names of the columns
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
    changed.columns["error"]["penalty", "central-difference"] = 0.5
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
    assert {law for law, _ in TABLES.errors} <= free


def cells(lines):
    return {(line[0], line[1]): line[2:] for line in lines[1:]}


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
    errors_of, medians_of = cells(family.errors(table)), cells(family.summary(table))
    for there, made in zip(
        [line for line in family.read("masses") if tuple(line[1:3]) in SAMPLE],
        family.masses(table)[1:],
        strict=True,
    ):
        assert there[:3] == made[:3]
        for one, other in zip(there[3:], made[3:], strict=True):
            assert close(one, other, 0.06), (there, made)
    tables = {pair: (errors_of[pair], medians_of[pair]) for pair in SAMPLE}
    page = cells(family.read("errors")), cells(family.read("medians"))
    for pair, (errors, medians) in tables.items():
        for there, made in zip(page[0][pair], errors, strict=True):
            assert close(there, made, 0.06), (pair, there, made)
        fifty = MEDIANS.index("of fifty")  # which depends on round-off
        assert abs(float(page[1][pair].pop(fifty)) - float(medians.pop(fifty))) < 10.0
        for there, made in zip(page[1][pair][:-1], medians[:-1], strict=True):  # the last one is a time
            assert close(there, made, 0.06) or max(family.number(there), family.number(made)) < 1e-10, (pair, there)
        assert min(family.number(page[1][pair][-1]), family.number(medians[-1])) > 0.0  # times
