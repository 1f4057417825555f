"""What the penalty laws choose by themselves: the rule, the promise on every shipped case, what was measured."""

import itertools

import numpy as np
import pytest
from benchmarks.gain import row

import percuss
import places
from marks import deep
from percuss.certificate.verdict import certificate
from percuss.contact.laws import parameters
from percuss.march.model_of_case import model_of
from percuss.methods.registry import Registry
from strategies import hunek

pytestmark = pytest.mark.slow

# what is promised of one impact does not hold of fifty, in which small losses and delays add up
CASES = sorted(  # of bars: what is promised of solids is the step alone
    path
    for path in places.CASES.glob("*.yaml")
    if path.stem != "fifty-impacts" and "bar: " in path.read_text(encoding="utf-8")
)
WU, CD = "wu-predictor-corrector", "central-difference"
PAIRS = list(itertools.product([CD, WU], ["penalty", "bipenalty"]))
# penetration over the compression of an end element under the peak force, error of the force in L1, peak too high,
# energy gained and lost over the largest; what the docstrings promise, and what a spring holds at the end is lost too
PROMISE = {
    (CD, "penalty"): (4.5, 0.17, 0.2, 1e-3, 0.07),
    (WU, "penalty"): (1.8, 0.06, 0.2, 1e-12, 0.03),
    (CD, "bipenalty"): (2.8, 0.09, 0.2, 1e-2, 0.045),
    (WU, "bipenalty"): (2.4, 0.09, 0.2, 1e-12, 0.045),
}


def law_of(name):
    return Registry.load().get("contacts", name)


def changed(path, integrator, contact, courant):
    method = {"integrator": integrator, "contact": contact}
    return percuss.load(path, {"method": method, "time.courant": courant, "record.every": 1})


@pytest.mark.parametrize("courant", [deep(0.5), 0.9])
@pytest.mark.parametrize("pair", PAIRS, ids="+".join)
@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_auto_keeps_its_promise_on_every_case(path, pair, courant):
    case = changed(path, *pair, courant)
    result = percuss.run(case)
    assert result.summary["certificate"]["stable"] == "yes"
    penetration, force, peak, gained, lost = PROMISE[pair]
    arrays = result.arrays
    energy = arrays["kinetic_energy"] + arrays["elastic_energy"] - arrays["external_work"]
    scale = max(energy[0], np.abs(arrays["external_work"]).max())
    assert energy.max() - energy[0] <= gained * scale
    assert energy[0] - energy[-1] <= lost * scale
    if result.summary["exact"] is None:
        return  # nothing to hold the force against
    points = model_of(case).contact_points
    for k, name in enumerate(points.names):
        errors = result.summary["exact"]["contacts"][name]
        highest = np.nanmax(arrays["contact_force_exact"][:, k])
        if highest <= 0.0:
            continue
        compression = highest / points.stiffness[k]
        assert result.summary["contacts"][name]["penetration"]["largest"] <= penetration * compression
        assert errors["force_error_l1"] <= force
        assert errors["overshoot"] <= peak


def test_the_promise_is_that_of_the_docstrings():
    said = {name: law_of(name).__doc__ for name in ("penalty", "bipenalty")}
    for (_, name), (penetration, force, peak, gained, _) in PROMISE.items():
        text = " ".join(said[name].split())
        numbers = [f"{penetration:g}", f"{100 * force:g} %", f"{100 * peak:g} %"]
        numbers += [f"{100 * gained:g} %"] if gained > 1e-6 else []
        assert not [number for number in numbers if number not in text], name


@pytest.mark.parametrize("courant", [0.5, 0.99, *map(deep, (0.9, 0.95))])
@pytest.mark.parametrize("pair", PAIRS, ids="+".join)
@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_the_certificate_says_yes_to_auto(path, pair, courant):
    found = certificate(model_of(changed(path, *pair, courant)))
    assert found["stable"] == "yes", found["why"]
    assert found["theta"] is None or found["theta"] <= 0.8 * (1 + 1e-12)


@pytest.mark.parametrize("pair", PAIRS, ids="+".join)
@pytest.mark.parametrize("courant", [0.98, *map(deep, (0.9, 0.99))])
def test_auto_keeps_the_step_of_rows_of_unlike_bars(pair, courant):
    """Their faster side, which the law does not know, is at the Courant number of the case."""
    for k in range(10):
        case = row(np.random.default_rng([7, k]))
        method = {"integrator": pair[0], "contact": pair[1]}
        case |= {"method": method, "time": {"steps": 1, "courant": courant}}
        found = certificate(model_of(percuss.load(case)))
        assert found["stable"] == "yes", (k, found["why"])


def root(courant, *elements):
    """sqrt(1 - C^2) of an endless bar; bars of so many elements, free at their other ends, are a little softer."""
    height = np.sqrt(1 - courant**2)
    finite = [np.tanh(2 * n * np.arctanh(height)) for n in elements]
    return height * len(finite) / sum(1 / one for one in finite)


@pytest.mark.parametrize(
    ("courant", "sides", "beta_s"),
    [
        # a rigid wall: x = 2 C^2 beta_s
        (0.5, 1, 0.5),
        (0.9, 1, 0.8 / (2 * 0.81)),
        (0.98, 1, 2 * root(0.98, 10) / (2 * 0.98**2)),
        # two equal bars: 4 C^2 beta_s
        (0.3, 2, 0.5),
        (0.6, 2, 0.5),
        (0.7, 2, 0.8 / (4 * 0.49)),
        (0.95, 2, 2 * root(0.95, 10, 20) / (4 * 0.95**2)),
        (1.0, 2, 2 * root(0.99, 10, 20) / (4 * 0.99**2)),
    ],
)
def test_the_rule(courant, sides, beta_s):
    case = hunek(10, courant, contact={"name": "penalty"})
    if sides == 1:
        del case["bodies"]["long"]
        case["contacts"] = {"tip": {"body": "short.right", "wall": 10.0}}
        case["record"] = {"probes": []}
    assert parameters(model_of(percuss.load(case)))["tip"]["beta_s"] == pytest.approx(beta_s, rel=1e-12)
    case["method"]["contact"] = {"name": "bipenalty"}  # matched: nothing lowers it
    assert parameters(model_of(percuss.load(case)))["tip"]["beta_s"] == 0.5


# ------------------------------------------------------------------------------------------------ what is measured


def wall_of_one_element(bars, moved, drives):
    """Return a case of bars or blocks: a body of 20 elements beside a soft, light one of a single element."""
    size = ({"bar": {"length": 1.0, "elements": n}, "area": 0.5} if bars else
            {"block": {"size": [1.0, 0.5], "elements": [n, min(n, 4)]}} for n in (20, 1))  # fmt: skip
    soft, stiff = ({"young": value, "density": value, **({} if bars else {"poisson": 0.0})} for value in (0.01, 1.0))
    work, wall = (
        {**one, "at": at if bars else [at, 0.0], "material": material}
        for one, at, material in zip(size, (1.0, 0.0), (stiff, soft), strict=True)
    )
    return {
        "percuss": 1, "bodies": {"work": work, "wall": {**wall, **moved}},
        "contacts": {"c": {"between": ["work.left", "wall.right"]}},
        "loads": {"drive": {"prescribed-velocity": 0.01, "on": ["wall.left", "wall.right"]} | drives} if drives else {},
        "method": {"integrator": CD, "contact": "penalty", **({} if bars else {"pairing": "node-to-segment"})},
        "time": {"step": 0.045, "steps": 1},
    }  # fmt: skip


@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("bars", [True, False])
def test_a_side_that_is_driven_or_held_throughout_is_rigid(bars, held):
    """It has the numbers of a wall, whatever its own are; a side that is let go has its own."""
    drive = {"direction": [1.0] if bars else [1.0, 0.0]}
    case = wall_of_one_element(bars, {"fixed": ["left", "right"]} if held else {}, {} if held else drive)
    still = {"body": "work.left", "wall": 1.0 if bars else {"point": [1.0, 0.0], "normal": [1.0, 0.0]}}
    wall = {**case, "bodies": {"work": case["bodies"]["work"]}, "loads": {}, "contacts": {"c": still}}

    def numbers(one, **changes):
        model = model_of(percuss.load(one, changes))
        points, epsilon = model.contact_points, np.full(len(model.contact_points), parameters(model)["c"]["epsilon_s"])
        return np.stack([points.stiffness, points.frequency, points.mass, points.equal_sides, epsilon], axis=1)

    np.testing.assert_allclose(numbers(case), numbers(wall), rtol=1e-12)
    if not held:
        let_go = numbers(case, **{"loads.drive.until": 10.0})
        np.testing.assert_allclose(let_go[:, 0], 0.01 / 20.0 * numbers(wall)[:, 0], rtol=1e-12)
        assert not let_go[:, 3].any()
