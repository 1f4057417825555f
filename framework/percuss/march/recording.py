"""The record arrays of a run: their shapes, and whether they fit into memory."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from percuss.errors import Problem, TooLargeError
from percuss.mesh import size_limits
from percuss.mesh.spots import shares_at
from percuss.record_arrays import empty_records
from percuss.step.record import ENERGIES, OF_CONTACTS, OF_PROBES, Record

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from percuss.case.case import Case
    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats, Integers

TIMES = 3  # columns of the time axis: the step, and the times of motion and of energy
# Copies of each record array while a result is made: in the order of the loop, in the order of the case, and one for
# the exact values and the differences from them.
COPIES = 3
MOST_OF_A_BAR = 400  # elements whose stress is recorded, evenly spaced


class Shapes(NamedTuple):
    """Shapes of the record arrays of a run.

    Attributes
    ----------
    rows
        Number of records, one in each row of every history.
    columns
        Number of columns of each history, by name.
    field_every
        Number of steps between two snapshots of the stress; 0 if none are taken.
    field
        Number of snapshots, and of degrees of freedom in each.
    """

    rows: int
    columns: dict[str, int]
    field_every: int
    field: tuple[int, int]

    @property
    def bytes_of_histories(self) -> float:
        """Memory of the histories and of their copies [bytes]."""
        return 8.0 * COPIES * self.rows * (sum(self.columns.values()) + TIMES)


def probe_nodes(model: Model) -> list[list[tuple[int, float]]]:
    """Return the nodes of each probe, with their shares in its displacement and velocity."""
    return [
        model.bodies[one.body].places(one.region) if one.region else shares_at(model.bodies[one.body], one)
        for one in model.case.recorded_ends
    ]


def record_shapes(model: Model) -> Shapes:
    """Return the shapes of the record arrays of a run."""
    record, steps = model.case.record, model.steps
    rows = steps // record.every + 1 + (steps % record.every > 0)  # the last step is recorded in any case
    motion = len(probe_nodes(model)) * model.dim
    columns = {
        **dict.fromkeys(OF_CONTACTS, len(model.case.contacts)),
        "contact_state": sum(law.state for law in model.contact_points.laws),
        "support_force": len(model.loads.supports) * model.dim,
        **dict.fromkeys(OF_PROBES, motion),
        "energy": len(ENERGIES.names or ()),
    }
    if not record.fields:
        return Shapes(rows, columns, 0, (0, 0))
    field_every = max(1, steps // record.fields)
    states = sum(
        numbers.size * model.bodies[name].volumes.shape[1] * model.bodies[name].spec.material.state
        for name, numbers in recorded_elements(model).items()
    )
    columns_of_field = sum(nodes.size for nodes in field_nodes(model)) * model.dim + states
    if not model.bodies.of_lines:  # velocities, pressures, and stresses of nine components
        columns_of_field += model.bodies.n_nodes * model.dim + len(model.contact_points)
        columns_of_field += 9 * sum(body.count for body in model.bodies.values())
    return Shapes(rows, columns, field_every, (steps // field_every + 1, columns_of_field))


def empty_record(model: Model, place: Mapping[int, int]) -> tuple[Record, Floats]:
    """Return the histories of a run, filled with nan, and the time of each of their rows.

    Parameters
    ----------
    model
        The model of the run.
    place
        Map from each boundary node to the index of its first boundary degree of freedom.
    """
    dim, every, steps = model.dim, model.case.record.every, model.steps
    n = np.arange(0, steps + 1, every)
    if steps % every:
        n = np.append(n, steps)
    shapes, probes = record_shapes(model), probe_nodes(model)
    of_bodies = field_nodes(model) if shapes.field_every else []
    ends = np.concatenate([np.zeros(0, dtype=np.int64), *(nodes.ravel() for nodes in of_bodies)])
    energy = empty_records(shapes.rows, ENERGIES)
    energy.view(np.ndarray).view(np.float64)[:] = np.nan
    record = Record(
        every=every,
        last=steps,
        **{name: np.full((shapes.rows, shapes.columns[name]), np.nan) for name in (*OF_CONTACTS, *OF_PROBES)},
        probe_start=np.cumsum([0, *(len(nodes) for nodes in probes for _ in range(dim))], dtype=np.int64),
        probe=np.array([place[p] + d for nodes in probes for d in range(dim) for p, _ in nodes], dtype=np.int64),
        probe_share=np.array([share for nodes in probes for _ in range(dim) for _, share in nodes], dtype=float),
        energy=energy,
        field_every=shapes.field_every,
        field=np.full((shapes.field[0], ends.size * dim), np.nan),
        field_dof=(ends[:, None] * dim + np.arange(dim)).ravel(),
    )
    return record, np.asarray(n * model.dt, dtype=np.float64)


def recorded_elements(model: Model) -> dict[str, Integers]:
    """Return the numbers, within each body, of the elements whose stress is recorded: all, of a bar some hundreds."""
    return {
        name: np.linspace(0, body.count - 1, min(body.count, MOST_OF_A_BAR) if body.is_bar else body.count)
        .round()
        .astype(np.int64)
        for name, body in model.bodies.items()
    }


def field_nodes(model: Model) -> list[Integers]:
    """Return the nodes whose displacement is recorded, in two axes for each body."""
    return [
        body.element_nodes(elements) if body.is_bar else np.arange(body.start, body.stop)[:, None]
        for body, elements in zip(model.bodies.values(), recorded_elements(model).values(), strict=True)
    ]


def recordable(model: Model) -> Model:
    """Return the model unchanged, or refuse it if its records or snapshots do not fit into memory.

    Raises
    ------
    InputError
        With the memory that they would take, and how to reduce it.
    """
    case = model.case
    problems: list[Problem] = []
    shapes = record_shapes(model)
    size_bytes = shapes.bytes_of_histories
    if too_large := size_limits.why_too_large(size_bytes):
        every = case.record.every * 10 ** math.ceil(
            math.log10(size_bytes / (size_limits.MEMORY_SHARE * (size_limits.memory() or 1)))
        )
        message = f"expected records that fit into memory, found {model.steps:.4g} steps, whose records {too_large}"
        advice = f"Keep one of many, as `record: {{every: {every}}}`, or shorten the run."
        problems.append(
            case.problem(("record", "every") if case.record.every > 1 else ("time",), message, advice, any_inside=True)
        )
    refuse_large(case, *shapes.field, problems)
    return model


def bytes_of_snapshots(snapshots: int, columns: int) -> float:
    """Return the memory of snapshots and of their copies [bytes]."""
    return 8.0 * COPIES * snapshots * columns


def refuse_large(case: Case, snapshots: int, columns: int, problems: Sequence[Problem] = ()) -> None:
    """Refuse snapshots that do not fit into memory, together with other problems.

    Raises
    ------
    InputError
        With all problems.
    """
    if too_large := size_limits.why_too_large(bytes_of_snapshots(snapshots, columns)):
        message = f"expected snapshots that fit into memory, found {snapshots:.4g}, which {too_large}"
        problems = [*problems, case.problem(("record", "fields"), message, "A picture needs some hundreds.")]
    if problems:
        raise TooLargeError(problems)
