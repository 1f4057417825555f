"""The schema agrees with the checks: what is right validates, what is wrong in itself does not."""

import json
from pathlib import Path

import jsonschema
import pytest
import yaml

import places
from percuss.case.json_schema import case_schema, schema_of
from percuss.case.quantities import MEASURABLE, SUMMARY
from percuss.case.source import Source
from percuss.case.specs import _existing_quantity
from percuss.methods.registry import Registry
from percuss.studies.layout import study_schema

BASE = yaml.safe_load((Path(__file__).parent / "input_errors.yaml").read_text(encoding="utf-8"))["base"]

FULL = """\
percuss: 1
title: Everything
source: nowhere
plugins: [law.py]
bodies:
  a: {bar: {length: 10, elements: 4, grading: 2, direction: [1, 0]}, material: {young: 1e2, density: 1},
      area: 1, fixed: [left]}
  b: {bar: {length: 1, elements: 1}, element: bar, material: {name: elastic, young: 1, density: 1},
      area: 1, at: [1, 0], velocity: [0, 1]}
contacts:
  tip: {between: [a.right, b.left], method: {name: penalty, beta_s: 1}}
  end: {body: b.right, wall: [2, 0]}
loads:
  push: {table: {time: [0, 1], value: [0, 1]}, on: [a.left], from: 0, until: 1, direction: [0, 1], as: force}
  pull: {constant: 1, on: a.left}
  pulse: {table: {file: pulse.csv}, on: b}
  weight: {gravity: [0, -9.81]}
refine: 2
method: {integrator: central-difference, contact: {ratio: matched}, mass: lumped}
time: {step: 1e-3, steps: 100, on_unstable: warn}
record: {every: 2, probes: [], fields: 3}
expect:
  - {quantity: gap, contact: tip, during: [0, 1], mean: 0, within: 1.5%, source: frozen on 2026-01-01}
  - {quantity: steps, value: 100, within: 0, source: exact}
"""


def lists(value):
    """Return plain data as JSON has it: lists for tuples."""
    if isinstance(value, dict):
        return {key: lists(item) for key, item in value.items()}
    return [lists(item) for item in value] if isinstance(value, tuple) else value


def plain(text):
    return lists(Source.parse(text, "case.yaml").data)


@pytest.fixture(scope="module")
def schema():
    return case_schema(Registry.load())


@pytest.fixture(scope="module")
def validator(schema):
    return jsonschema.Draft202012Validator(schema)


def test_it_is_a_schema_and_json(schema):
    jsonschema.Draft202012Validator.check_schema(schema)
    assert json.loads(json.dumps(schema, allow_nan=False)) == schema


@pytest.mark.parametrize("cls", Registry.load().components.values(), ids=lambda cls: f"{cls.family}-{cls.name}")
def test_the_schema_of_a_method_allows_its_examples(cls):
    validator = jsonschema.Draft202012Validator(schema_of(cls))
    assert [error.message for example in cls.examples for error in validator.iter_errors(lists(example))] == []


@pytest.mark.parametrize("text", [FULL, BASE], ids=["everything", "base"])
def test_a_good_case_validates(validator, text):
    assert [error.message for error in validator.iter_errors(plain(text))] == []


@pytest.mark.parametrize("file", sorted(places.CASES.rglob("*.yaml")), ids=lambda file: file.name)
def test_an_editor_that_reads_yaml_1_1_finds_no_mistake(schema, file):
    """There `on` is a truth and `2e11` a text, unless they are written as "on" and 2.0e+11."""
    data = yaml.safe_load(file.read_text(encoding="utf-8"))
    known = study_schema(Registry.load()) if "percuss-study" in data else schema
    errors = jsonschema.Draft202012Validator(known).iter_errors(data)
    assert [f"{error.json_path}: {error.message[:100]}" for error in errors] == []


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("length: 10", "length: -10", "bodies.a.bar.length"),
        ("length: 10", "lenght: 10", "bodies.a.bar"),
        ("bar: {length: 10", "baar: {length: 10", None),
        ("percuss: 1", "percuss: 2", "percuss"),
        ("name: penalty, beta_s: 1", "name: lagrange, beta_s: 1", None),
        ("{constant: 1, ", "{constant: 1, ramp: {value: 1, duration: 1}, ", None),
        ("as: force", "as: power", "loads.push.as"),
        ("time: {step: 1e-3, ", "time: {courant: 1, step: 1e-3, ", "time"),
        ("steps: 100, on", "on", "time"),
        ("within: 1.5%", "within: wide", None),
        ("  tip: {between", "  1st: {between", "contacts"),
        ("contact: {ratio: matched}", "contact: {name: lagrange, ratio: 1}", "method.contact"),
        ("contact: {ratio: matched}", "contact: {name: penalty, beta_s: stiff}", "method.contact.beta_s"),
        ("contact: {ratio: matched}", "contact: penalti", "method.contact"),
        ("name: elastic, young: 1,", "name: elastic, young: -1,", "bodies.b.material.young"),
        ("quantity: gap", "quantity: gpa", "expect.0.quantity"),
    ],
)
def test_a_wrong_case_does_not_and_a_mistake_in_a_component_has_its_place(validator, old, new, place):
    """Not that of all forms that an entry may have, none of which fits."""
    assert old in FULL
    errors = list(validator.iter_errors(plain(FULL.replace(old, new, 1))))
    assert errors
    if place:
        assert {".".join(str(part) for part in error.absolute_path) for error in errors} == {place}


LAW = """
from dataclasses import dataclass
from typing import Annotated
from percuss import ContactLaw, Doc, Gt, Unit

@dataclass(frozen=True)
class Soft(ContactLaw):
    'A law of somebody else.'
    name = "soft"
    summary = "Somebody's law"
    stiffness: Annotated[float, Gt(0), Unit("force/length"), Doc("how soft")]

    def bind(self, points, dt):
        raise NotImplementedError
"""


def test_other_peoples_components_appear_with_unit_and_description(tmp_path):
    (tmp_path / "soft.py").write_text(LAW, encoding="utf-8")
    validator = jsonschema.Draft202012Validator(case_schema(Registry.load([tmp_path / "soft.py"])))
    laws = validator.schema["properties"]["method"]["properties"]["contact"]["then"]
    (soft,) = [one["then"] for one in laws["allOf"] if one["if"]["properties"]["name"] == {"const": "soft"}]
    assert soft["required"] == ["stiffness"]
    described = {"x-unit": "force/length", "description": "how soft [force/length]"}
    assert soft["properties"]["stiffness"] == {"type": "number", "exclusiveMinimum": 0, **described}
    assert validator.is_valid(plain(FULL.replace("{ratio: matched}", "{name: soft, stiffness: 2}")))
    # its option has no default, so its name alone says too little
    assert not validator.is_valid(plain(FULL.replace("{ratio: matched}", "soft")))


@pytest.mark.parametrize(
    "form", ["penalty", "{name: penalty}", "{name: penalty, beta_s: auto}", "{}", "{beta_s: 1, ratio: 1}", "lagrange"]
)
@pytest.mark.parametrize("place", ["contact: {ratio: matched}", "method: {name: penalty, beta_s: 1}"])
def test_every_form_of_a_component_is_right(validator, form, place):
    text = FULL.replace(place, f"{place.partition(':')[0]}: {form}", 1)
    assert [error.message for error in validator.iter_errors(plain(text))] == []
    assert Source.parse(text, "case.yaml").data != Source.parse(FULL, "case.yaml").data


def test_every_quantity_that_can_be_expected_is_offered_or_allowed(validator, schema):
    quantity = schema["properties"]["expect"]["items"]["properties"]["quantity"]
    offered = quantity["anyOf"][0]
    assert len(offered["enum"]) == len(offered["enumDescriptions"])
    assert {"contact_force", "impulse", "energy_growth.largest"} <= {*offered["enum"]}
    for name in [*offered["enum"], *SUMMARY, "contacts.tip.penetration.largest"]:
        _existing_quantity(name)
        assert validator.is_valid(plain(FULL.replace("quantity: steps", f"quantity: {name}"))), name
    assert set(MEASURABLE) <= {*offered["enum"]}
