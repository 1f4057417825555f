"""Rows of contact that turn and move in every step: the loop knows no dimension, and its ledger closes all the same."""

from typing import NamedTuple

import numpy as np
import pytest

from blocks import alone, block
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.step.actions import BULK, Action
from strategies import LAWS_OF_SURFACES as LAWS


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
