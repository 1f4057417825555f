"""The record of a march: what is kept of its steps, and whether that fits into memory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from percuss.solver import size_limits
from percuss.solver.compiled import leapfrog_loop

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from percuss.methods.interfaces import Floats, Integers
    from percuss.solver.model import Model
import math
from typing import TYPE_CHECKING

from percuss.errors import Problem, TooLargeError

if TYPE_CHECKING:
    from percuss.solver.model import Model


def prepared(
    model: Model, probes: Sequence[int], place: Mapping[int, int], points: int
) -> tuple[leapfrog_loop.Record, Floats]:
    """Return the empty record of a run, and the times of its rows.

    Parameters
    ----------
    model
        The model to march.
    probes
        Nodes whose motion is kept.
    place
        Node to its first entry among the boundary degrees of freedom.
    points
        Number of contact points.
    """
    dim, every, steps = model.dim, model.case.record.every, model.steps
    n = np.arange(0, steps + 1, every)
    if steps % every:
        n = np.append(n, steps)
    rows = n.size
    elements = field_elements(model)
    snapshots = model.case.record.fields
    field_every = max(1, steps // snapshots) if snapshots else 0
    taken = steps // field_every + 1 if snapshots else 0
    ends = np.stack([elements, elements + 1], axis=1).ravel()
    field_dof = (ends[:, None] * dim + np.arange(dim)).ravel() if snapshots else np.zeros(0, dtype=np.int64)

    def empty(rows: int, columns: int) -> Floats:
        return np.full((rows, columns), np.nan)

    record = leapfrog_loop.Record(
        every=every,
        last=steps,
        multiplier=empty(rows, points),
        gap=empty(rows, points),
        end_force=empty(rows, points),
        displacement=empty(rows, len(probes) * dim),
        velocity=empty(rows, len(probes) * dim),
        probe=np.array([place[p] + d for p in probes for d in range(dim)], dtype=np.int64),
        energy=empty(rows, 5),
        field_every=field_every,
        field=empty(taken, field_dof.size),
        field_dof=field_dof,
    )
    return record, np.asarray(n * model.dt, dtype=np.float64)


def field_elements(model: Model) -> Integers:
    """Return the first nodes of the elements whose stress is kept for the space-time picture."""
    kept = [
        body.start + np.unique(np.linspace(0, body.stiffness.size - 1, min(body.stiffness.size, 400)).round())
        for body in model.bodies.values()
    ]
    return np.concatenate(kept).astype(np.int64)


COPIES = 2  # of a record: as marched, and in the order of the case


def recordable(model: Model) -> Model:
    """Return a model as it is; refuse one whose records would not fit into memory, and say how many would.

    Raises
    ------
    InputError
        With what to do about it.
    """
    case = model.case
    problems: list[Problem] = []
    probes = case.record.probes
    ends = len(probes) if probes is not None else sum(len(contact_pair.nodes) for contact_pair in model.contact_pairs)
    row = 8.0 * (3 * len(model.contact_pairs) + 2 * ends * model.dim + 8)
    size = COPIES * row * (model.steps / case.record.every)
    if not size_limits.fits(size):
        every = case.record.every * 10 ** math.ceil(
            math.log10(size / (size_limits.SHARE * (size_limits.memory() or 1)))
        )
        message = (
            f"expected records that fit into memory, found {model.steps:.4g} steps, whose records take "
            f"{size_limits.in_words(size)}, {size_limits.in_this_machine()}"
        )
        advice = f"Keep one of many, as `record: {{every: {every}}}`, or shorten the run."
        problems.append(case.problem(("record", "every") if case.record.every > 1 else ("time",), message, advice))
    snapshots = min(case.record.fields, model.steps) + 1.0
    elements = sum(min(body.stiffness.size, 400) for body in model.bodies.values())
    size = 8.0 * COPIES * snapshots * 2 * elements * model.dim
    if case.record.fields and not size_limits.fits(size):
        message = (
            f"expected snapshots that fit into memory, found {snapshots:.4g}, which take "
            f"{size_limits.in_words(size)}, {size_limits.in_this_machine()}"
        )
        problems.append(case.problem(("record", "fields"), message, "A picture needs some hundreds."))
    if problems:
        raise TooLargeError(problems)
    return model
