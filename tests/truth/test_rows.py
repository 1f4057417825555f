"""N and S of contact points are those of dense matrices, on bars and on surfaces, with supports and drives.

Rows may turn and move in every step: the loop knows no dimension, and its ledger closes all the same.
"""

from typing import NamedTuple

import numpy as np
import pytest

import percuss
from blocks import SEAM, alone, block, loaded, plane_at
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.step.actions import BULK, Action
from strategies import LAWS_OF_SURFACES as LAWS

BAR = {"material": {"young": 100.0, "density": 0.01}, "area": 1.0}
ROW = {
    "bodies": {
        "a": {**BAR, "bar": {"length": 2.0, "elements": 4, "direction": [3, 4]}},
        "b": {**BAR, "bar": {"length": 1.0, "elements": 3, "direction": [3, 4]}, "at": [1.2, 1.6]},
        "c": {**BAR, "bar": {"length": 1.0, "elements": 3, "direction": [3, 4]}, "at": [1.8, 2.4], "fixed": ["right"]},
    },
    "contacts": {"ab": {"between": ["a.right", "b.left"]}, "bc": {"between": ["b.right", "c.left"]},
                 "wall": {"body": "a.left", "wall": [0.0, 0.0]}},
    "loads": {"drive": {"prescribed-velocity": 0.1, "on": "b.right", "until": 0.5}},
    "method": {"contact": {"name": "regularised-lagrange", "beta_s": 1.0}},
}  # fmt: skip


def seam(cells, other, pairing, dim, more=None):
    """Two blocks of unlike meshes, of which the second is held at its outer face and rolls along its bottom."""
    (left, right), held = (
        (
            block(at, 0.0, [2] + [count] * (dim - 1), 0.3, size=[1.0] * dim)
            for at, count in ((0.0, cells), (1.0, other))
        ),
        ["right", {"on": "bottom", "along": "y"}],
    )
    method = {"contact": {"name": "regularised-lagrange", "beta_s": 1.0}, "pairing": pairing}
    return model_of(loaded({"left": left, "right": right | {"fixed": held}}, SEAM | (more or {}), method))


def dense(model, midpoint):
    """Return N^T M^-1 N from dense matrices, with the directions that supports and drives hold taken away."""
    bodies, dim = model.bodies, model.dim
    inverse = np.zeros((bodies.n_nodes * dim,) * 2)
    for body in bodies.values():
        own = slice(body.start * dim, body.stop * dim)
        of_nodes = np.diag(1.0 / body.mass) if body.inverse is None else body.inverse.toarray()
        inverse[own, own] = np.kron(of_nodes, np.eye(dim))
    normals = free = model.contact_points.matrix(bodies.n_nodes).toarray()
    for constraint in model.loads.constraints:
        if constraint.active(midpoint):
            held = np.zeros((bodies.n_nodes, dim))
            held[constraint.node] = constraint.direction
            free = free - np.outer(held.ravel(), held.ravel() @ free)
    return normals.T @ inverse @ free


@pytest.mark.parametrize("mass", ["lumped", "reciprocal"])
@pytest.mark.parametrize("midpoint", [0.1, 0.9])
def test_rows_of_bars_are_those_of_dense_matrices(mass, midpoint):
    case = {"percuss": 1, **ROW, "time": {"end": 1.0, "courant": 0.5}}
    model = model_of(percuss.load({**case, "method": {**ROW["method"], "mass": mass}}))
    expected = dense(model, midpoint)
    assert model.rows_at(midpoint).matrix().toarray() == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(("pairing", "dim"), [("gauss-points", 2), ("mortar", 2), ("node-to-segment", 3)])
def test_rows_of_surfaces_are_those_of_dense_matrices_in_any_order(pairing, dim):
    model = seam(3, 2, pairing, dim)
    rows, expected = model.rows_at(0.1), dense(model, 0.1)
    assert rows.matrix().toarray() == pytest.approx(expected, rel=1e-12, abs=1e-12)
    order = np.random.default_rng(1).permutation(len(model.contact_points))
    permuted = rows.permuted(order.tolist()).matrix().toarray()
    assert permuted == pytest.approx(expected[np.ix_(order, order)], rel=1e-12, abs=1e-12)
    assert len(model.rows) == 1


def test_points_that_meet_a_node_crosswise_stand_in_the_rows_of_one_another():
    """Their entry of S is 0, and yet they share a node."""
    floor = {"body": "left.bottom", "wall": plane_at([0.0, 0.0], [0.0, 1.0])}
    model = seam(2, 2, "node-to-segment", 2, {"floor": floor})
    matrix, contact = model.rows_at(0.1).matrix().tocoo(), model.contact_points.contact
    across = contact[matrix.row] != contact[matrix.col]
    assert across.sum() == 2
    assert not matrix.data[across].any()


# --------------------------------------------------------------- rows that turn and move in every step


class Turning(NamedTuple):
    """Rows that are renewed in every step."""

    row: np.recarray
    entries: np.recarray
    mass: np.ndarray  # of the node of each entry
    span: float  # angle of a step


def turn(data, n, u, v, a):
    """Turn the normals of all points, and move their walls."""
    angle = 0.3 + data.span * n
    cosine, sine = np.cos(angle), np.sin(angle)
    for i in range(data.row.size):
        row = data.row[i]
        row.initial_gap = -0.003 + 0.002 * np.sin(0.7 * n + i)
        row.delassus = 0.0
        for k in range(row.start, row.stop):
            entry = data.entries[k]
            entry.normal = cosine if (k - row.start) % 2 == 0 else sine
            entry.response = entry.normal / data.mass[k]
            row.delassus += entry.normal * entry.response


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize(
    ("integrator", "law"), [("central-difference", "penalty"), ("wu-predictor-corrector", "lagrange")]
)
def test_rows_that_turn_and_move_in_every_step_leave_the_ledger_closed(integrator, law, compiled):
    body = block(0.0, -0.2, [6, 3], size=[0.6, 0.3])
    method = {"integrator": integrator, "contact": {"name": law, **LAWS[law]}, "pairing": "node-to-segment"}
    case = alone(body, 0.0, "left", method=method, time={"step": 0.02, "steps": 80, "on_unstable": "warn"})
    march = March(model_of(case), compiled=compiled)
    step = march.arrays.step
    mass = step.boundary["mass"][step.points.entries["place"]]
    turning = Action(BULK, turn, Turning(step.points.row, step.points.entries, mass, 0.2), order=-1)
    march.arrays.actions = [*march.arrays.actions, turning]
    march.use(march.kernels, march.arrays.actions)
    outcome = march.run()
    energy = outcome.record.energy[: outcome.records]
    assert outcome.done == 80
    assert outcome.record.contact_force.max() > 1e-3
    assert np.abs(energy.contact_work).max() > 1e-5
    error = energy.kinetic_energy + energy.elastic_energy - energy.contact_work - outcome.totals.energy_before
    assert np.abs(error).max() < 1e-13 * max(outcome.totals.energy_before, np.abs(energy.contact_work).max())
