"""Good input: what a case becomes, and what overrides make of it."""

import json
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

import percuss
from percuss.case.case import load
from percuss.case.specs import Address
from percuss.errors import InputError

BAR = {"length": 10, "elements": 4}
STEEL = {"young": 100, "density": 0.01}


def mapping(**changes):
    """Return a small right case, its top-level entries changed."""
    case = {
        "percuss": 1,
        "bodies": {
            "a": {"bar": BAR, "material": STEEL, "area": 1, "velocity": 0.1},
            "b": {"bar": BAR, "material": STEEL, "area": 2, "at": 10},
        },
        "contacts": {"tip": {"between": ["a.right", "b.left"]}},
        "time": {"end": 1, "courant": 0.5},
    }
    return {key: value for key, value in {**case, **changes}.items() if value is not None}


def from_text(tmp_path, text):
    file = tmp_path / "case.yaml"
    file.write_text(text, encoding="utf-8")
    return load(file)


def text(extra=""):
    return (
        "percuss: 1\nbodies:\n"
        "  a: {bar: {length: 1e1, elements: 4}, material: {young: 1.0e+2, density: 1e-2}, area: 1}\n"
        "time: {step: 1e-3, steps: 10}\n" + extra
    )


def test_contacts():
    walls = {
        "tip": {"between": ["a.right", "b.left"], "method": "lagrange"},
        "end": {"body": "b.right", "wall": 20.5},
    }
    case = load(mapping(contacts=walls, method={"contact": {"name": "penalty", "beta_s": 2}}))
    tip, end = case.contacts.values()
    assert (tip.sides, end.sides) == ((Address("a", "right"), Address("b", "left")), (Address("b", "right"),))
    assert (str(tip.sides[0]), end.wall) == ("a.right", 20.5)
    assert (type(tip.law).name, end.law) == ("lagrange", case.method.contact)
    assert (tip.own_law, end.own_law) == (True, False)


def test_loads(tmp_path):
    loads = """\
loads:
  push: {constant: 2, on: a.left, from: -1, until: 5}
  pull: {ramp: {value: 1, duration: 2}, on: [a.left, a.right]}
  weight: {gravity: -9.81}
  drive: {half-sine: {peak: 1, duration: 2}, on: a.left, as: velocity}
"""
    case = from_text(tmp_path, text(loads))
    push, pull, weight, drive = case.loads.values()
    assert push.load.value == 2.0
    assert (push.on, push.acts_as, push.direction) == ((Address("a", "left"),), "force", None)
    assert (push.start, push.stop) == (-1.0, 5.0)
    assert (pull.start, pull.stop) == (-np.inf, np.inf)
    assert pull.on == (Address("a", "left"), Address("a", "right"))
    assert (weight.on, weight.acts_as, weight.direction) == ((), "acceleration", (1.0,))
    assert drive.acts_as == "velocity"


def test_dimensions():
    bodies = {
        "a": {"bar": {**BAR, "direction": [1, 1]}, "material": STEEL, "area": 1, "velocity": [0, 1]},
        "b": {"bar": BAR, "material": STEEL, "area": 1, "at": 10, "velocity": 2},
    }
    case = load(mapping(bodies=bodies, loads={"weight": {"gravity": -9.81}, "wind": {"gravity": [0, 2]}}))
    assert case.dimension == 2
    assert (case.bodies["a"].at, case.bodies["b"].at) == ((0.0, 0.0), (10.0, 0.0))
    assert (case.bodies["a"].velocity, case.bodies["b"].velocity) == ((0.0, 1.0), 2.0)
    assert (case.loads["weight"].direction, case.loads["wind"].direction) == ((1.0, 0.0), (0.0, 2.0))


def test_expectations():
    expect = [
        {"quantity": "contact_force", "during": [0, 1], "mean": 2, "within": "1.5 %", "source": "exact"},
        {"quantity": "velocity", "probe": "a.right", "at": 1, "value": 0.5, "within": 1e-3, "source": "paper"},
        {"quantity": "energy.final", "value": 1, "within": 0, "source": "frozen on 2026-11-21"},
    ]
    force, velocity, energy = load(mapping(expect=expect)).expect
    assert (force.contact, force.statistic, force.value, force.relative) == ("tip", "mean", 2.0, True)
    assert force.within == pytest.approx(0.015)
    assert (force.during, force.at, force.path) == ((0.0, 1.0), None, ("expect", 0))
    assert (velocity.probe, velocity.at, velocity.component) == (Address("a", "right"), 1.0, 0)
    assert (velocity.statistic, velocity.within, velocity.relative) == ("value", 1e-3, False)
    assert (energy.quantity, energy.contact, energy.source) == ("energy.final", None, "frozen on 2026-11-21")


@pytest.mark.parametrize(
    "half", [Decimal("0.5"), Fraction(1, 2), np.longdouble(0.5), np.float32(0.5), np.array(0.5)], ids=type
)
def test_numbers_and_texts_of_libraries_are_numbers_and_texts(half):
    in_case = mapping(time={"end": 1, "courant": half})
    for case in (load(in_case), load(mapping(), {"time.courant": half})):
        assert type(case.time.courant) is float
        assert case.time.courant == 0.5
        assert json.loads(json.dumps(case.data))["time"]["courant"] == 0.5  # as a result stores it
    assert load(mapping(), {"method.contact": np.array(["penalty"])[0]}).method.contact.name == "penalty"


def test_the_mapping_given_is_not_changed():
    given = mapping(method={"contact": "bipenalty"})
    load(given, {"method.contact": "lagrange", "bodies.a.area": 3})
    assert given == mapping(method={"contact": "bipenalty"})


# ------------------------------------------------------------------------------------------------ overrides


def test_overrides_are_values_or_yaml():
    case = load(mapping(), {"bodies.a.area": 3, "time.end": "2e0", "bodies.a.at": "[-10]", "record": "{every: 5}"})
    a = case.bodies["a"]
    assert (a.area, case.time.end, a.at, case.record.every) == (3.0, 2.0, (-10.0,), 5)
    assert case.data["bodies"]["a"]["area"] == 3


BIPENALTY = {"contact": {"name": "bipenalty", "beta_s": 0.5, "ratio": 1}}
DROPPED = "method.contact: penalty has no option ratio: dropped"
KEPT = "method.contact: penalty keeps beta_s: 0.5 of bipenalty"
BOTH_DROPPED = "method.contact: lagrange has no option beta_s, ratio: dropped"


@pytest.mark.parametrize(
    ("overrides", "contact", "notes"),
    [
        ({"method.contact.name": "penalty"}, {"name": "penalty", "beta_s": 0.5}, (DROPPED, KEPT)),
        ({"method.contact.beta_s": 2, "method.contact": "penalty"}, {"name": "penalty", "beta_s": 2}, (DROPPED,)),
        ({"method.contact": "penalty", "method.contact.beta_s": 2}, {"name": "penalty", "beta_s": 2}, (DROPPED,)),
        ({"method.contact": "lagrange"}, {"name": "lagrange"}, (BOTH_DROPPED,)),
        ({"method.contact": "bipenalty"}, BIPENALTY["contact"], ()),
        ({"method.contact": "{name: penalty, epsilon_s: 7}"}, {"name": "penalty", "epsilon_s": 7}, ()),
    ],
)  # fmt: skip
def test_a_swap_keeps_the_options_that_the_new_component_has_and_tells_the_others(overrides, contact, notes):
    """In any order of the overrides."""
    case = load(mapping(method=BIPENALTY)).with_overrides(overrides)
    assert (case.data["method"]["contact"], case.notes) == (contact, notes)
    assert type(case.contacts["tip"].law).name == contact["name"]


def test_a_contact_keeps_its_own_method():
    contacts = {"tip": {"between": ["a.right", "b.left"], "method": "penalty"}}
    case = load(mapping(contacts=contacts), {"method.contact": "lagrange"})
    assert type(case.contacts["tip"].law).name == "penalty"
    assert load(mapping(contacts=contacts), {"contacts.tip.method.beta_s": 4}).contacts["tip"].law.beta_s == 4.0


def test_kept_options_are_still_placed_in_the_file(tmp_path):
    case = from_text(tmp_path, text("method: {contact: {name: penalty, beta_s: 1}}\n"))
    changed = case.with_overrides({"method.contact": "bipenalty"})
    assert changed.problem(("method", "contact", "beta_s"), "x").place.endswith("case.yaml:5:43")
    assert changed.problem(("method", "contact", "name"), "x").place == "--set method.contact=bipenalty"


@pytest.mark.parametrize("method", ["bind", "__post_init__"])
def test_a_plug_in_that_refuses_its_options_is_named(method, tmp_path):
    arguments = "self, points, dt" if method == "bind" else "self"
    (tmp_path / "refusing.py").write_text(
        "from dataclasses import dataclass\nfrom percuss.methods.interfaces import ContactLaw, LinearLaw\n"
        "@dataclass(frozen=True)\nclass Refusing(ContactLaw):\n    'Refusing.'\n"
        "    name = 'refusing'\n    summary = 'Refusing'\n"
        "    def bind(self, points, dt):\n        return LinearLaw('explicit', 1.0)\n"
        f"    def {method}({arguments}):\n        raise ValueError('boo')\n"
    )
    with pytest.raises(InputError) as caught:
        percuss.run(load(mapping(method={"contact": "refusing"}), plugins=[tmp_path / "refusing.py"]), compiled=False)
    said = f"method.contact: boo (raised in the plug-in {tmp_path / 'refusing.py'}:11)"
    assert said in str(caught.value)
