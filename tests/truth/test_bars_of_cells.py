"""Bodies of cells that are bars: blocks, boxes and cylinders without contraction or between rollers, force by force.

Also the critical steps of their cells, which an independent program found.
"""

import itertools

import numpy as np
import pytest

from blocks import alone, bar, block, impact
from percuss.certificate.verdict import certificate
from percuss.march.model_of_case import model_of
from solid_figures import STEPS
from strategies import LAWS_OF_SURFACES

WU, CD = "wu-predictor-corrector", "central-difference"
NODES, GAUSS, MORTAR = "node-to-segment", "gauss-points", "mortar"
DEEP = pytest.mark.deep
# Elements of the left body and of an unlike right one, the section, what a body is beside, and where rollers hold it.
KINDS = {
    "quad4": ([20, 4], [20, 6], 0.2, {}, {"bottom": "y", "top": "y"}),
    "hex8": ([10, 2, 3], [10, 3, 5], 0.06, {}, {"front": "y", "back": "y", "bottom": "z", "top": "z"}),
    "quad4-one-point": ([10, 2], [10, 3], 0.2, {"element": "quad4-one-point"}, {}),
    "hex8-one-point": ([10, 2, 3], [10, 3, 5], 0.06, {"element": "hex8-one-point"}, {}),
    "rings": ([4, 20], [7, 20], 0.25 * np.pi, {"plane": "axisymmetric"}, {"left": "x", "right": "x"}),
}


def pair(kind, poisson, *, unlike):
    """Return two bodies of cells that meet, the bars that they are, and their contacts."""
    elements, others, area, more, rollers = KINDS[kind]
    count = max(elements)
    modulus, fixed = 1.0, []
    if poisson:
        modulus = (1.0 - poisson) / (1.0 + poisson) / (1.0 - 2.0 * poisson)  # of longitudinal waves
        fixed = [{"on": side, "along": axis} for side, axis in rollers.items()]
    bodies, bars = {}, {}
    for name, at, speed, counts in (("left", 0.0, 0.5, elements), ("right", 1.0, -0.5, others if unlike else elements)):
        body = block(at, speed, counts, poisson, fixed=fixed, **more)
        if kind == "rings":  # cylinders along y
            body |= {"at": [0.0, at], "velocity": [0.0, speed]}
            body["block"]["size"] = [0.5, 1.0]
        bodies[name], bars[name] = body, bar(at, speed, count, area, modulus)
    sides = ("top", "bottom") if kind == "rings" else ("right", "left")
    return bodies, bars, {"tip": {"between": [f"left.{sides[0]}", f"right.{sides[1]}"]}}


ROWS = [
    # kind, integrator, law, pairing, Poisson's ratio, unlike meshes
    *(("quad4", *each, 0.0, False) for each in itertools.product((CD, WU), LAWS_OF_SURFACES, (NODES, GAUSS, MORTAR))),
    ("quad4", WU, "regularised-lagrange", MORTAR, 0.3, False),
    *(("hex8", CD, law, NODES, 0.0, False) for law in LAWS_OF_SURFACES),
    ("hex8", WU, "regularised-lagrange", MORTAR, 0.0, True),
    ("hex8", WU, "regularised-lagrange", MORTAR, 0.3, False),
    ("quad4-one-point", WU, "regularised-lagrange", NODES, 0.0, False),
    *(("rings", WU, "regularised-lagrange", pairing, poisson, pairing == MORTAR)
      for pairing in (NODES, GAUSS, MORTAR) for poisson in (0.0, 0.3)),
]  # fmt: skip
MORE = [
    *(("quad4", "velocity-verlet", *each, 0.0, False)
      for each in itertools.product(LAWS_OF_SURFACES, (NODES, GAUSS, MORTAR))),
    *(("hex8", WU, *each, 0.0, False) for each in itertools.product(LAWS_OF_SURFACES, (NODES, GAUSS))),
    *(("hex8", CD, law, GAUSS, 0.0, False) for law in LAWS_OF_SURFACES),
    *(("hex8", WU, law, MORTAR, 0.0, True) for law in LAWS_OF_SURFACES if law != "regularised-lagrange"),
    ("hex8-one-point", WU, "regularised-lagrange", NODES, 0.0, False),
]  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "integrator", "law", "pairing", "poisson", "unlike"),
    [
        pytest.param(*row, marks=mark)
        for rows, mark in ((ROWS, ()), (MORE, DEEP))
        for row in rows
        if row[2:4] != ("lagrange", GAUSS)  # which are refused
    ],
)
def test_bodies_that_nothing_strains_across_are_bars(kind, integrator, law, pairing, poisson, unlike):
    """A uniform pressure passes between unlike meshes by mortar alone."""
    bodies, bars, contacts = pair(kind, poisson, unlike=unlike)
    step = {"quad4": 0.02, "rings": 0.01}.get(kind, 0.03)
    found, expected = impact(bodies, integrator, law, step, pairing, contacts), impact(bars, integrator, law, step)
    force, of_bar = found.arrays["contact_force"], expected.arrays["contact_force"]
    along, across = (1, [0]) if kind == "rings" else (0, slice(1, None))
    u, of_bars = found.arrays["displacement"], expected.arrays["displacement"][..., 0]
    assert of_bar.max() > 0.01
    assert np.abs(force - of_bar).max() < 1e-10 * of_bar.max()
    assert np.abs(u[..., along] - of_bars).max() < 1e-12 * np.abs(of_bars).max()
    assert np.abs(u[..., across]).max() < 1e-12 * np.abs(of_bars).max()
    assert found.summary["momentum"]["balanced"]
    assert found.summary["energy"]["ledger_closed"] is expected.summary["energy"]["ledger_closed"]
    assert found.summary["exact"]["contacts"]["tip"]["force_error_l1"] < 0.5


@pytest.mark.parametrize(
    ("cells", "plane", "poisson"), [(*key, ratio) for key, ratios in STEPS.items() for ratio in ratios]
)
def test_critical_steps_are_those_of_an_independent_program(cells, plane, poisson):
    """Steps times the speed of longitudinal waves over the cell, of one cell alone and of a block of 7 or 20 a side.

    At an axis the first cell beside it limits the step.
    """
    element, assembled = STEPS[cells, plane][poisson]
    dim, count, within = (3, 7, 1e-3) if plane == "" else (2, 20, 6e-4 if plane == "axisymmetric" else 1e-3)
    body = block(0.0, 0.0, [count] * dim, poisson, cells, [1.0] * dim, **({"plane": plane} if plane else {}))
    model = model_of(alone(body, method={"integrator": CD}))
    speed, found = np.sqrt(model.bodies["a"].modulus), certificate(model)
    assert 2.0 / model.bodies.omega * speed * count == pytest.approx(element, abs=within)
    assert found["dt_critical_free"] * speed * count == pytest.approx(assembled, abs=within)
    assert found["stable"] == "yes"
