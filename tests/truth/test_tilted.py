"""Two blocks, one of which is tilted: contact points open and close one after the other.

Regularised Lagrange as a complementarity problem never gains energy, whatever points share nodes. Central difference
with bipenalty does, by what an independent program found.
"""

import math

import pytest

import percuss
from percuss.certificate.verdict import certificate
from percuss.march.model import Model

TILT = 0.03  # rad
PAIRINGS = ["node-to-segment", "gauss-points", {"name": "gauss-points", "points_on_facet": 3}, "mortar"]
# beta_s counts Young's modulus there, here the modulus of longitudinal waves
MODULUS = 0.7 / (1.3 * 0.4)


def tilted(integrator, law, pairing, beta_s, courant=0.9):
    turned = 0.5 * math.cos(TILT) + 0.25 * math.sin(TILT)  # from the middle of a block to its left corner
    body = {"material": {"young": 1.0, "density": 1.0, "poisson": 0.3}}
    return percuss.load({
        "percuss": 1,
        "bodies": {
            "left": {"block": {"size": [1, 0.5], "elements": [10, 5]}, "at": [0, 0], "velocity": [0.01, 0], **body},
            "right": {"block": {"size": [1, 0.5], "elements": [10, 7]}, "at": [0.5 + turned, 0],
                      "velocity": [-0.01, 0], "angle": math.degrees(TILT), **body},
        },
        "contacts": {"seam": {"between": ["left.right", "right.left"]}},
        "method": {"integrator": integrator, "contact": {**law, "beta_s": beta_s / MODULUS}, "pairing": pairing},
        "time": {"courant": courant, "end": 6.0, "on_unstable": "warn"},
    })  # fmt: skip


@pytest.mark.parametrize("beta_s", [0.25, 1.0, 10.0, 1000.0])
@pytest.mark.parametrize("pairing", PAIRINGS, ids=str)
def test_regularised_lagrange_never_gains_energy(pairing, beta_s):
    case = tilted("wu-predictor-corrector", {"name": "regularised-lagrange"}, pairing, beta_s)
    assert certificate(Model(case))["energy"] == "never grows"
    result = percuss.run(case)
    energy = result.summary["energy"]
    assert energy["max"] <= energy["initial"] * (1.0 + 1e-12)
    assert energy["final"] < 0.999 * energy["initial"]
    assert energy["ledger_closed"]
    assert result.summary["momentum"]["balanced"]


@pytest.mark.parametrize("pairing", PAIRINGS, ids=str)
def test_no_guarantee_is_given_where_points_of_bipenalty_share_nodes(pairing):
    """With bars a matched bipenalty is regularised Lagrange; a point that its neighbours open may pull."""
    case = tilted("wu-predictor-corrector", {"name": "bipenalty", "ratio": "matched"}, pairing, 1.0)
    assert certificate(Model(case))["energy"] == "not guaranteed"


@pytest.mark.parametrize(
    ("pairing", "published"),
    [("node-to-segment", (1.01, 1.05)), ("gauss-points", (1.01, 1.03)), ("mortar", (1.01, 1.06))],
)
def test_central_difference_with_bipenalty_gains_the_published_energy(pairing, published):
    found = []
    for beta_s in (0.25, 1.0):
        energy = percuss.run(
            tilted("central-difference", {"name": "bipenalty", "ratio": "matched"}, pairing, beta_s)
        ).summary["energy"]
        found.append(energy["max"] / energy["initial"])
    assert found == pytest.approx(published, abs=0.015)


def test_a_mean_gap_of_mortar_begins_at_no_less_than_zero():
    """Of the tilted block that touches with its corner a mean by dual functions would be negative."""
    case = tilted("wu-predictor-corrector", {"name": "regularised-lagrange"}, "mortar", 1.0)
    gaps = [point.gap for point in Model(case).contact_points]
    assert min(gaps) == 0.0
    assert max(gaps) > 0.01
