"""Two blocks, one of which is tilted: contact points open and close one after the other.

Regularised Lagrange as a complementarity problem never gains energy, whatever points share nodes. Central difference
with bipenalty does, by what an independent program found.
"""

import math

import pytest

import percuss
from blocks import SEAM, block, loaded
from percuss.certificate.verdict import certificate
from percuss.march.model_of_case import model_of

TILT = 0.03  # rad
PAIRINGS = ["node-to-segment", "gauss-points", {"name": "gauss-points", "points_on_facet": 3}, "mortar"]
# beta_s counts Young's modulus there, here the modulus of longitudinal waves
MODULUS = 0.7 / (1.3 * 0.4)
FREE_STEP = 0.06149807  # the critical one of the free blocks
WU, CENTRAL = "wu-predictor-corrector", "central-difference"


def tilted(integrator, law, pairing, beta_s):
    """Return a case with nine tenths of the step that is critical for the bodies, not for their stiffest cell."""
    turned = 0.5 * math.cos(TILT) + 0.25 * math.sin(TILT)  # from the middle of a block to its right corner
    size = [1, 0.5]
    bodies = {
        "left": block(0, 0.01, [10, 5], 0.3, size=size, angle=math.degrees(TILT)),
        "right": block(0.5 + turned, -0.01, [10, 7], 0.3, size=size),
    }
    method = {"integrator": integrator, "contact": {**law, "beta_s": beta_s / MODULUS}, "pairing": pairing}
    return loaded(bodies, SEAM, method, {"step": 0.9 * FREE_STEP, "end": 6.0, "on_unstable": "warn"})


@pytest.mark.parametrize("beta_s", [0.25, 1.0, 10.0, 1000.0])
@pytest.mark.parametrize("pairing", PAIRINGS, ids=str)
def test_regularised_lagrange_never_gains_energy(pairing, beta_s):
    case = tilted(WU, {"name": "regularised-lagrange"}, pairing, beta_s)
    found = certificate(model_of(case))
    assert found["energy"] == "never grows"
    assert found["dt_critical_free"] == pytest.approx(FREE_STEP, rel=1e-6)
    result = percuss.run(case)
    energy = result.summary["energy"]
    assert energy["max"] <= energy["initial"] * (1.0 + 1e-12)
    assert energy["final"] < 0.999 * energy["initial"]
    assert energy["ledger_closed"]
    assert result.summary["momentum"]["balanced"]


@pytest.mark.parametrize("pairing", PAIRINGS, ids=str)
def test_no_guarantee_is_given_where_points_of_bipenalty_share_nodes(pairing):
    """With bars a matched bipenalty is regularised Lagrange; a point that its neighbours open may pull."""
    case = tilted(WU, {"name": "bipenalty", "ratio": "matched"}, pairing, 1.0)
    assert certificate(model_of(case))["energy"] == "not guaranteed"


# The largest energy over that of the start, for beta_s of .25, 1, 2 and 10, by node-to-segment, gauss-points, mortar.
# That program measured gaps of mortar along the normals of the nodes themselves, which matters where much is gained.
TABLE = [
    (CENTRAL, "penalty", {}, [(1, 1, 1.6), (1, 1, 1), (1, 1, 2.4)]),
    (CENTRAL, "bipenalty", {"ratio": "free-step"},
     [(1.001, 1.004, 1.04, 2.6), (1.001, 1.002, 1.003, 1.24), (1.001, 1.006, 1.04)]),
    (CENTRAL, "bipenalty", {"ratio": "matched"},
     [(1.01, 1.05, 1.23, 1.1), (1.01, 1.03, 1.07, 1.3), (1.01, 1.06, 1.3, 1.2)]),
    (WU, "penalty", {}, [(1, 1, 1.35), (1, 1, 1.35), (1, 1, 1.35)]),
    (WU, "bipenalty", {"ratio": "matched"}, [(1, 1, 1, 1)] * 3),
]  # fmt: skip
CELLS = [
    (integrator, law, options, pairing, beta_s, published)
    for integrator, law, options, rows in TABLE
    for pairing, row in zip(("node-to-segment", "gauss-points", "mortar"), rows, strict=True)
    for beta_s, published in zip((0.25, 1.0, 2.0, 10.0), row, strict=False)
]


@pytest.mark.parametrize(
    ("integrator", "law", "options", "pairing", "beta_s", "published"),
    [
        pytest.param(*cell, marks=() if cell[2] == {"ratio": "matched"} and cell[4] == 1.0 else pytest.mark.deep)
        for cell in CELLS
    ],
)
def test_the_largest_energy_is_that_of_an_independent_program(integrator, law, options, pairing, beta_s, published):
    """What is gained agrees to a quarter while it is small; larger gains change with any detail of the set-up.

    Speed and time of the published figures are not known.
    """
    energy = percuss.run(tilted(integrator, {"name": law, **options}, pairing, beta_s)).summary["energy"]
    found = energy["max"] / energy["initial"]
    if published == 1:
        assert abs(found - 1.0) < 1e-12
    elif options == {"ratio": "matched"} and beta_s < 10.0:
        assert found - 1.0 == pytest.approx(published - 1.0, rel=0.25, abs=0.005)
    else:
        assert 0.45 * (published - 1.001) < found - 1.0 < 2.2 * (published - 0.9995)


def test_a_mean_gap_of_mortar_begins_at_no_less_than_zero():
    """Of the tilted block that touches with its corner a mean by dual functions would be negative."""
    case = tilted(WU, {"name": "regularised-lagrange"}, "mortar", 1.0)
    gaps = model_of(case).contact_points.gap
    assert min(gaps) == 0.0
    assert max(gaps) > 0.01
