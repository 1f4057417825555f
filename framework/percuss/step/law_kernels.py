"""Contact laws with a kernel: the only laws whose multipliers do not follow from the contact equation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.contact.points import STATE, Points
from percuss.jsonable import Entries
from percuss.methods.interfaces import Trial
from percuss.record_arrays import Records
from percuss.step.actions import LAWS, Action

if TYPE_CHECKING:
    from percuss.contact.bound_law import BoundLaw
    from percuss.methods.interfaces import Floats


class KernelLaw(NamedTuple):
    """A law with a kernel, as its action reads it. The views of its points and their times are those of a step."""

    bound: Any  # the arrays that the law has bound
    trial: Trial
    multiplier: Floats  # of its points
    now: Records  # percuss.step.records.NOW


def multipliers(bound: object, trial: Trial, multiplier: Floats) -> None:
    """Set the multipliers of one law's points (slot for the kernel of the law)."""
    raise NotImplementedError


def apply_law(law: KernelLaw, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Let one law set the multipliers of its points."""
    views, now = law.trial, law.now[0]
    # A multiplier that the kernel does not set remains nan and stops the run.
    for i in range(law.multiplier.size):
        law.multiplier[i] = np.nan
    # What the kernel does not write of the state remains as it was.
    for i in range(views.before.shape[0]):
        for k in range(views.before.shape[1]):
            views.after[i, k] = views.before[i, k]
    trial = Trial(
        views.gap, views.predicted_gap, views.rate, views.predicted_rate, views.delassus, now.dt, now.time,
        now.gap_response, now.rate_response, views.first_neighbour, views.neighbour, views.coupling,
        views.before, views.after,
    )  # fmt: skip
    multipliers(law.bound, trial, law.multiplier)


def kernel_laws(
    laws: Sequence[BoundLaw], points: Points, now: Any, variables: tuple[Floats, Floats]
) -> Iterator[Action]:
    """Yield the actions of the laws with a kernel.

    Parameters
    ----------
    laws
        The bound laws with a kernel, in the order of their points, which are the last points of the loop.
    points
        All contact points of the loop.
    now
        The step, `percuss.step.records.NOW`.
    variables
        State variables of the laws before and after a step, one law after the other, point by point.
    """
    first = points.law.size - sum(len(bound_law.where) for bound_law in laws)
    start = 0
    for bound_law in laws:
        count, law = len(bound_law.where), bound_law.law
        stop, end = first + count, start + count * law.state
        trial = _trial(points, first, stop, coupled=bool(law.uses_coupling))
        before, after = (array[start:end].reshape(count, law.state) for array in variables)
        before.flags.writeable = False
        trial = trial._replace(before=before, after=after)
        data = KernelLaw(bound_law.kernel_data, trial, points.state["multiplier"][first:stop], now)
        kernel: Any = bound_law.kernel
        name = f"contact law {law.name}"
        yield Action(LAWS, apply_law, data, {multipliers: kernel}, of_plugin=True, allocates=law.allocates, name=name)
        first, start = stop, end


def _trial(points: Points, first: int, stop: int, *, coupled: bool) -> Trial:
    """Return the states of the points from `first` to `stop`.

    The arrays are views of the records of the points. Times and responses are those of a step, which its action sets. A
    law that does not use the coupling gets no neighbours.
    """
    starts, neighbours, values = [0], [], []
    for row in points.row[first:stop]:
        for entry in points.others[row.other_start : row.other_stop] if coupled else ():
            neighbours.append(entry.point - first)
            values.append(entry.value)
        starts.append(len(neighbours))
    views: Entries = {name: points.state[name][first:stop] for name in Trial._fields if name in (STATE.names or ())}
    rows: Entries = {
        "delassus": points.row["delassus"][first:stop],
        "first_neighbour": np.array(starts, dtype=np.int64),
        "neighbour": np.array(neighbours, dtype=np.int64),
        "coupling": np.array(values, dtype=np.float64),
    }
    for array in (*views.values(), *rows.values()):
        array.flags.writeable = False
    nothing = np.zeros((stop - first, 0))
    of_step: Entries = dict.fromkeys(("dt", "time", "gap_response", "rate_response"), 0.0)
    return Trial(**views, **rows, **of_step, before=nothing, after=nothing)
