"""The record arrays of a run: their shapes, and whether they fit into memory."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from percuss.errors import Problem, TooLargeError
from percuss.solver import size_limits
from percuss.solver.compiled import leapfrog_loop

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from percuss.methods.interfaces import Floats, Integers
    from percuss.solver.model import Model

COPIES = 2  # of each record array: one in the order of the loop, one in the order of the case


def empty_record(
    model: Model, probes: Sequence[int], place: Mapping[int, int], points: int
) -> tuple[leapfrog_loop.Record, Floats]:
    """Return the record arrays of a run, filled with nan, and the time of each of their rows.

    Parameters
    ----------
    model
        The model of the run.
    probes
        Nodes whose displacement and velocity are recorded.
    place
        Map from each boundary node to the index of its first boundary degree of freedom.
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
    snapshot_count = steps // field_every + 1 if snapshots else 0
    ends = np.stack([elements, elements + 1], axis=1).ravel()
    field_dof = (ends[:, None] * dim + np.arange(dim)).ravel() if snapshots else np.zeros(0, dtype=np.int64)

    def nan_array(count: int, columns: int) -> Floats:
        return np.full((count, columns), np.nan)

    record = leapfrog_loop.Record(
        every=every,
        last=steps,
        multiplier=nan_array(rows, points),
        gap=nan_array(rows, points),
        end_force=nan_array(rows, points),
        displacement=nan_array(rows, len(probes) * dim),
        velocity=nan_array(rows, len(probes) * dim),
        probe=np.array([place[p] + d for p in probes for d in range(dim)], dtype=np.int64),
        energy=nan_array(rows, 5),
        field_every=field_every,
        field=nan_array(snapshot_count, field_dof.size),
        field_dof=field_dof,
    )
    return record, np.asarray(n * model.dt, dtype=np.float64)


def field_elements(model: Model) -> Integers:
    """Return the first node of each element whose stress is recorded for the space-time picture.

    At most 400 elements of each body are taken, evenly spaced.
    """
    first_nodes = [
        body.start + np.unique(np.linspace(0, body.stiffness.size - 1, min(body.stiffness.size, 400)).round())
        for body in model.bodies.values()
    ]
    return np.concatenate(first_nodes).astype(np.int64)


def recordable(model: Model) -> Model:
    """Return the model unchanged, or refuse it if its records or snapshots do not fit into memory.

    Raises
    ------
    InputError
        With the memory that they would take, and how to reduce it.
    """
    case = model.case
    problems: list[Problem] = []
    probes = case.record.probes
    ends = len(probes) if probes is not None else sum(len(contact_pair.nodes) for contact_pair in model.contact_pairs)
    row_bytes = 8.0 * (3 * len(model.contact_pairs) + 2 * ends * model.dim + 8)
    size_bytes = COPIES * row_bytes * (model.steps / case.record.every)
    if not size_limits.fits_in_memory(size_bytes):
        every = case.record.every * 10 ** math.ceil(
            math.log10(size_bytes / (size_limits.MEMORY_SHARE * (size_limits.memory() or 1)))
        )
        message = (
            f"expected records that fit into memory, found {model.steps:.4g} steps, whose records take "
            f"{size_limits.bytes_in_words(size_bytes)}, {size_limits.memory_in_words()}"
        )
        advice = f"Keep one of many, as `record: {{every: {every}}}`, or shorten the run."
        problems.append(case.problem(("record", "every") if case.record.every > 1 else ("time",), message, advice))
    snapshots = min(case.record.fields, model.steps) + 1.0
    elements = sum(min(body.stiffness.size, 400) for body in model.bodies.values())
    size_bytes = 8.0 * COPIES * snapshots * 2 * elements * model.dim
    if case.record.fields and not size_limits.fits_in_memory(size_bytes):
        message = (
            f"expected snapshots that fit into memory, found {snapshots:.4g}, which take "
            f"{size_limits.bytes_in_words(size_bytes)}, {size_limits.memory_in_words()}"
        )
        problems.append(case.problem(("record", "fields"), message, "A picture needs some hundreds."))
    if problems:
        raise TooLargeError(problems)
    return model
