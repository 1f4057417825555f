"""Cases as plain mappings: hand-made ones, drawn ones, and what a change far below any meaning does to them."""

from __future__ import annotations

import copy
import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, event
from hypothesis import strategies as st

import percuss
from marks import deep
from percuss.case.options import options_of
from percuss.march.model_of_case import model_of
from percuss.methods.registry import Registry
from percuss.results.runner import examined_run
from percuss.testing import Subject, draws

NUDGE = 1e-12  # relative; what it does to a run is what round-off may do
HANGS = 1e-4  # a nudge that moves the answer by more: the run depends on round-off and is compared with nothing
FLOOR = 1e-13  # of the peak
SLACK = 10.0  # round-off may do that many times what the nudges tried here did
LAWS_OF_SURFACES = {
    "lagrange": {},
    "penalty": {"beta_s": 0.25},
    "bipenalty": {"beta_s": 1.0},
    "regularised-lagrange": {"beta_s": 1.0},
}
COMPARED = ("contact_force", "gap", "displacement", "velocity", "kinetic_energy", "elastic_energy", "contact_work")


WU, CD = "wu-predictor-corrector", "central-difference"
UNIT = {"young": 1.0, "density": 1.0}
STEEL = {"young": 100.0, "density": 0.01}
BRASS = {"young": 49.0, "density": 0.02}


def bar(length, elements, at=0.0, velocity=0.0, material=STEEL, area=1.0, fixed=(), **options):
    return {
        "bar": {"length": length, "elements": elements, **options},
        "at": at, "velocity": velocity, "material": dict(material), "area": area, "fixed": list(fixed),
    }  # fmt: skip


def case_of(bodies, contacts, time, loads=None, integrator=None, contact=None, **more):
    """Return a case of bars, with a probe at each end, and perhaps an integrator and a law for all contacts."""
    method = {"integrator": integrator, "contact": contact}
    return {
        "percuss": 1,
        "bodies": bodies,
        "contacts": contacts,
        "loads": loads or {},
        "time": time,
        "record": {"probes": [f"{name}.{end}" for name in bodies for end in ("left", "right")]},
        **({"method": {name: value for name, value in method.items() if value}} if integrator else {}),
        **more,
    }


# Two unlike bars between two walls, with many impacts at four ends of which none is shared.
ROW = case_of(
    {"a": bar(1.0, 5, 0.0, 1.6, grading=1.5), "b": bar(1.4, 4, 1.01, -1.2, BRASS, 1.6)},
    {
        "wall": {"body": "a.left", "wall": -0.0123},
        "ab": {"between": ["a.right", "b.left"]},
        "end": {"body": "b.right", "wall": 2.4317},
    },
    {"steps": 500, "courant": 0.5},
)


def hunek(n=100, courant=0.5, integrator="wu-predictor-corrector", contact=None, end=0.8):
    """The two touching bars of Huněk, the longer one with 2 n elements."""
    bodies = {"short": bar(10.0, n, velocity=0.1), "long": bar(20.0, 2 * n, 10.0, fixed=["right"])}
    contact = contact or {"name": "bipenalty", "beta_s": 0.25, "ratio": 1.0}
    return {
        **case_of(bodies, {"tip": {"between": ["short.right", "long.left"]}}, {"end": end, "courant": courant}),
        "method": {"integrator": integrator, "contact": contact},
        "record": {"probes": ["short.left", "short.right", "long.left"]},
    }


def turned(case, direction):
    """Return a case of bars along x along a direction in one, two or three dimensions."""
    unit = np.array(direction) / np.linalg.norm(direction)
    out = copy.deepcopy(case)
    for one in out["bodies"].values():
        (sign,) = one["bar"].get("direction", [1])
        one["bar"]["direction"] = [sign * number for number in direction]
        one["at"] = list(one.get("at", 0.0) * unit)
        if isinstance(one.get("velocity"), list):
            one["velocity"] = list(one["velocity"][0] * unit)
    for one in out["contacts"].values():
        if "wall" in one:
            one["wall"] = list(one["wall"] * unit)
    for one in out.get("loads", {}).values():
        if "gravity" in one:
            value = one["gravity"]["value"] if isinstance(one["gravity"], dict) else one["gravity"]
            one["gravity"] = list((value if isinstance(value, float | int) else value[0]) * unit)
        if "direction" in one:
            one["direction"] = list(one["direction"][0] * unit)
    return out


def reordered(case):
    """Return a case whose bodies and contacts stand in the other order."""
    return case | {name: dict(reversed(case[name].items())) for name in ("bodies", "contacts")}


def swapped(case):
    """Return a case whose contacts name their other side first."""
    contacts = {name: one | ({"between": one["between"][::-1]} if "between" in one else {})
                for name, one in case["contacts"].items()}  # fmt: skip
    return case | {"contacts": contacts}


UNITS = dict(zip(("length", "mass", "time"), draws.OTHER_UNITS, strict=True))


def unit(kind, units=UNITS):
    return draws.unit_factor(kind, tuple(units.values()))


def converted(case, units=UNITS):
    """Return a case of bars along x in other units of length, mass and time."""
    scales = tuple(units.values())

    def load(one):
        name, kind = next(iter(one)), "acceleration" if "gravity" in one else one.get("as") or "velocity"
        options = options_of(REGISTRY.get("loads", name))
        given = one[name] if isinstance(one[name], dict) else {next(iter(options)): one[name]}
        factors = {key: unit(kind if options[key].unit == "amplitude" else options[key].unit, units) for key in given}
        value = {key: draws.scaled(given[key], factors[key]) for key in given}
        return {name: value} | draws.converted({key: one[key] for key in one if key != name}, scales)

    loads = {name: load(one) for name, one in case.get("loads", {}).items()}
    return draws.converted(case, scales) | {"loads": loads}


def run(case, overrides=None, **kwargs):
    return percuss.run(percuss.load(case), overrides, **kwargs)


def examined(case, **kwargs):
    """Run a case as the kit does: its critical step is not searched where the black box would have to tell it."""
    return examined_run(percuss.load(case), **kwargs)


def finished(case, stopped=None, **kwargs):
    """Run a drawn case; one that is refused or stopped is no example. `stopped` is asked first whether it may stop."""
    try:
        return examined(case, **kwargs)
    except (percuss.RefusedPair, percuss.RunError) as error:
        event(type(error).__name__)
        if stopped and isinstance(error, percuss.RunError):
            stopped(case)
    assume(False)
    raise AssertionError


def nudged(case, nudge):
    """Return the case with every velocity, load and gap moved by about `nudge` of itself, unlike ones unlike."""
    out = copy.deepcopy(case)
    for k, one in enumerate(out["bodies"].values()):
        factor = 1.0 + nudge * (-1) ** k * (1.0 + 0.3 * k)
        velocity = one.get("velocity", 0.0)
        one["velocity"] = [factor * v for v in velocity] if isinstance(velocity, list) else factor * velocity
        one["area"] *= 1.0 + 0.1 * nudge * (k + 1)
    return out


def largest(values):
    return float(np.nanmax(np.abs(values), initial=0.0)) if values.size else 0.0


def apart(one, other, names=COMPARED):
    """Return by how much two results differ in each history, over its peak."""
    out = {}
    for name in names:
        a, b = one.arrays[name], other.arrays[name]
        assert a.shape == b.shape, name
        out[name] = largest(a - b) / (largest(a) or 1.0)
    return out


def round_off(case, base=None, names=COMPARED):
    """Return what round-off may do to each history of a case, over its peak; infinite where it depends on it."""
    base = base if base is not None else run(case)
    worst = dict.fromkeys(names, FLOOR)
    for nudge in (NUDGE, -NUDGE):
        try:
            moved = apart(base, examined(nudged(case, nudge), certify=lambda *_: base.summary["certificate"]), names)
        except percuss.RunError:
            return dict.fromkeys(names, math.inf)
        for name, value in moved.items():
            worst[name] = max(worst[name], SLACK * value) if value < HANGS else math.inf
    return worst if all(map(math.isfinite, worst.values())) else dict.fromkeys(names, math.inf)


# ------------------------------------------------------------------------------------------------ drawn cases

REGISTRY = Registry.load()


def _is_swept(name):
    """Return whether an integrator has one step for all bodies; of the others see test_own_steps."""
    return not getattr(REGISTRY.get("integrators", name)().bind(1.0), "own_steps", False)


INTEGRATORS = [name for name in REGISTRY.names("integrators") if _is_swept(name)]
# Quick tests sweep the pairs of these integrators and laws; deep ones sweep every pair that is not refused, of other
# integrators with the first options of each law alone: each kernel is compiled for seconds.
CORE = ["central-difference", "noh-bathe", "wu-predictor-corrector"]
CORE_LAWS = ["bipenalty", "lagrange", "penalty", "tied"]
# those whose ledger closes to round-off; of others the closure is what the scheme itself takes from the energy or adds
LEAPFROG = [name for name in INTEGRATORS if isinstance(REGISTRY.get("integrators", name)().bind(1.0), percuss.LeapFrog)]
INVISCID = [name for name in LEAPFROG if REGISTRY.get("integrators", name)().bind(1.0).viscosity == 0.0]
LAWS = [
    {"name": name, **options}
    for name in REGISTRY.names("contacts")
    for options in REGISTRY.get("contacts", name).examples
]
FIRST = [next(law for law in LAWS if law["name"] == name) for name in REGISTRY.names("contacts")]
# given in time; those that follow the motion have tests of their own
LOADS = [
    {name: dict(options)}
    for name in REGISTRY.names("loads")
    if not issubclass(REGISTRY.get("loads", name), percuss.FollowingLoad)
    for options in REGISTRY.get("loads", name).examples
]
ALONG = [one for one in LOADS if not any(isinstance(o.get("value"), tuple) and "gravity" in one for o in one.values())]
ON_ENDS = [one for one in ALONG if "gravity" not in one]
FORCES = [one for one in ON_ENDS if REGISTRY.get("loads", next(iter(one))).acts_as != "velocity"]


def with_methods(*classes):
    """Return the registry with further methods."""
    registry = REGISTRY
    for cls in classes:
        registry = Subject.of(cls, registry).registry
    return registry


def is_refused(integrator, law):
    """Whether one of the two methods refuses the other."""
    case = case_of({"a": bar(1, 1)}, {"w": {"body": "a.right", "wall": 1}}, {"steps": 1, "courant": 0.5})
    try:
        model_of(percuss.load(case | {"method": {"integrator": integrator, "contact": law}}))
    except percuss.RefusedPair:
        return True
    return False


CORE_PAIRS = [pair for pair in itertools.product(CORE, LAWS) if pair[1]["name"] in CORE_LAWS]
PLAIN_PAIRS = [pair for pair in CORE_PAIRS if pair[1] in FIRST]
PAIRS = [
    (integrator, law)
    for integrator, law in itertools.product(INTEGRATORS, LAWS)
    if (integrator in CORE or law in FIRST) and not is_refused(integrator, law)
]


def pair_id(pair):
    return f"{pair[0]}+{'-'.join(map(str, pair[1].values()))}"


def each_integrator(names):
    """Parametrize a test by integrators; those that are not of the core are deep ones."""
    return pytest.mark.parametrize("integrator", [name if name in CORE else deep(name) for name in names])


def each_pair(pairs, quick=CORE_PAIRS):
    """Parametrize a test by pairs of methods, of which all but the `quick` ones are deep."""
    marked = [pair if pair in quick else deep(pair) for pair in pairs]
    return pytest.mark.parametrize("pair", marked, ids=[pair_id(pair) for pair in pairs])


def number(low, high):
    """Numbers that are easy to read in a failing example."""
    return st.integers(round(low * 100), round(high * 100)).map(lambda k: k / 100)


@st.composite
def unlike_bars(draw, fewest_elements=1, bars=3):
    """Draw names, bodies and contacts of a row of one to `bars` unlike bars, all of which but the first move left."""
    names, bodies, at = "abcd"[: draw(st.integers(1, bars))], {}, 0.0
    for k, name in enumerate(names):
        bodies[name] = {
            "bar": {
                "length": draw(number(0.5, 3.0)),
                "elements": draw(st.integers(fewest_elements, 8)),
                "grading": draw(st.sampled_from([1.0, 0.5, 2.0])),
            },
            "material": {"young": draw(number(20, 200)), "density": draw(number(0.01, 0.1))},
            "area": draw(number(0.5, 2.0)),
            "at": at,
            "velocity": draw(number(0.1, 1.0)) * (-1.0 if k else 1.0),
        }
        at = round(at + bodies[name]["bar"]["length"] + draw(st.sampled_from([0.0, 0.0, 0.02])), 6)
    return names, bodies, {f"{a}{b}": {"between": [f"{a}.right", f"{b}.left"]} for a, b in itertools.pairwise(names)}


@st.composite
def rows(draw, moving=True, loads=True, bars=4):
    """A row of 1 to 4 unlike bars, with walls, supports, drives and loads.

    Scales are those of unit bars, so that the examples of laws and loads make sense.
    """
    names, bodies, contacts = draw(unlike_bars(bars=bars))
    for body in bodies.values():
        body["velocity"] = draw(number(-1, 1)) if moving else 0.0
    found, ends = {}, {"left": f"{names[0]}.left", "right": f"{names[-1]}.right", "inner": "a.right"}
    if len(names) == 1:
        del ends["inner"]  # an end that is held while others strike it
    for side, end in ends.items():
        several = ["free", "fixed", "free" if side == "inner" else "wall", *(["driven", "loaded"] if loads else [])]
        what, name, (_, at) = draw(st.sampled_from(several)), end[0], end.split(".")
        if what == "wall":
            last = bodies[name]
            place = -draw(number(0, 0.1)) if at == "left" else last["at"] + last["bar"]["length"] + draw(number(0, 0.1))
            contacts[f"wall-{side}"] = {"body": end, "wall": round(place, 6)}
        elif what == "fixed":
            bodies[name]["fixed"] = [*bodies[name].get("fixed", []), at]
        elif what == "driven":
            found[f"drive-{side}"] = {**draw(st.sampled_from(ON_ENDS)), "on": end, "as": "velocity"}
        elif what == "loaded":
            found[f"push-{side}"] = {**draw(st.sampled_from(FORCES)), "on": end, "as": "force"}
    if len(names) == 1:  # something must be free to move
        bodies["a"]["fixed"] = bodies["a"].get("fixed", [])[:1]
    if loads and draw(st.booleans()):
        kind, on = draw(st.sampled_from([one for one in ALONG if one in FORCES or "gravity" in one])), [*names]
        acts = "acceleration" if "gravity" in kind else draw(st.sampled_from(["force", "acceleration"]))
        found["whole"] = {**kind, "as": acts, "on": draw(st.sampled_from([*names, on]))}
    for one in found.values():
        if draw(st.booleans()):
            one["from"] = draw(number(-0.1, 0.2))
        if draw(st.booleans()):
            one["until"] = round(one.get("from", 0.0) + draw(number(0.02, 0.5)), 6)
    time = {"steps": draw(st.integers(40, 400)), "courant": draw(number(0.3, 1.0))}
    return case_of(bodies, contacts, time, found)


def alike(case):
    """Return the case with every bar like the first one, the gaps between them kept."""
    out = copy.deepcopy(case)
    first = next(iter(out["bodies"].values()))
    first["bar"].pop("grading", None)
    old = new = 0.0
    for one in out["bodies"].values():
        at = round(new + one["at"] - old, 6)
        old, new = one["at"] + one["bar"]["length"], at + first["bar"]["length"]
        one |= {"at": at, "bar": dict(first["bar"]), "material": dict(first["material"]), "area": first["area"]}
    wall = out["contacts"].get("wall-right")
    if wall:
        wall["wall"] = round(wall["wall"] - old + new, 6)
    return out


def refuses_unlike_bars(law):
    """Whether a law says that it is for equal sides only."""
    bodies = {name: bar(1, k, k - 1, 0.0, {"young": k, "density": 1}, k) for name, k in (("a", 1), ("b", 2))}
    case = case_of(bodies, {"ab": {"between": ["a.right", "b.left"]}}, {"steps": 1, "courant": 0.5})
    # Central difference shows a law all that any law weighs.
    case |= {"method": {"integrator": CD, "contact": law}}
    try:
        model_of(percuss.load(case))  # the law is bound to its points; a run would compile the loop too
    except percuss.InputError as error:
        return "method.contact" in str(error)
    return False


FOR_EQUAL_SIDES = [law for law in LAWS if refuses_unlike_bars(law)]


def with_pair(case, pair):
    """Return the case with an integrator and a contact law, its bars made alike where the law asks for it."""
    case = alike(case) if pair[1] in FOR_EQUAL_SIDES else case
    return {**case, "method": {"integrator": pair[0], "contact": dict(pair[1])}}
