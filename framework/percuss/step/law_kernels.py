"""Contact laws with a kernel: the only laws whose multipliers do not follow from the contact equation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.compiler.fingerprint import layout
from percuss.compiler.specialise import Specialiser
from percuss.contact.equation import OTHER, POINT
from percuss.methods.interfaces import Trial

if TYPE_CHECKING:
    from percuss.contact.bound_law import BoundLaw
    from percuss.methods.interfaces import Floats

Response = tuple[float, float]


def multipliers(bound: Any, trial: Trial, multiplier: Floats) -> None:
    """Set the multipliers of one law's points (slot for the kernel of the law)."""
    raise NotImplementedError


def remaining_laws(law: Any, points: Any, others: Any, dt: float, time: float, response: Response, first: int) -> None:
    """Apply the laws that are left (slot); do nothing where there is none."""


def apply_law(law: Any, points: Any, others: Any, dt: float, time: float, response: Response, first: int) -> None:
    """Let one law set the multipliers of its points, which start at index `first`, then apply the laws after it."""
    views, multiplier = law[1], law[2]
    stop = first + multiplier.size
    # The kernel uses the coupling and other laws act on the same ends: sum the gap accelerations by their multipliers.
    if law[3] == 1:
        for i in range(first, stop):
            point = points[i]
            point.pushed_by_others = 0.0
            for k in range(point.other_start, point.other_stop):
                neighbour = others[k].point
                if neighbour < first or neighbour >= stop:
                    point.pushed_by_others += others[k].value * points[neighbour].multiplier
    # A multiplier that the kernel does not set remains nan and stops the run.
    for i in range(multiplier.size):
        multiplier[i] = np.nan
        if views.shift.size > 0:
            views.shift[i] = 0.0
    # What the kernel does not write of the state remains as it was.
    for i in range(views.before.shape[0]):
        for k in range(views.before.shape[1]):
            views.after[i, k] = views.before[i, k]
    trial = Trial(
        views.gap, views.predicted_gap, views.rate, views.predicted_rate, views.delassus, dt, time, response[0],
        response[1], views.first_neighbour, views.neighbour, views.coupling, views.pushed_by_others,
        views.before, views.after, views.shift,
    )  # fmt: skip
    multipliers(law[0], trial, multiplier)
    remaining_laws(law[4], points, others, dt, time, response, stop)


def apply_laws(laws: Any, points: Any, others: Any, dt: float, time: float, response: Response) -> None:
    """Let every law with a kernel set its multipliers, one law after the other.

    `response` is the change of the predicted gap and of the predicted gap rate by a multiplier of 1/s.
    """
    remaining_laws(laws[2], points, others, dt, time, response, laws[1])


def nest(laws: Sequence[BoundLaw], points: Any, others: Any, state_before: Floats, state_after: Floats) -> Any:
    """Return the nested tuple from which the loop calls the kernels of laws.

    Parameters
    ----------
    laws
        The bound laws with a kernel, in the order of their points, which are the last points of the loop.
    points : (P,) POINT
        All contact points of the loop.
    others : OTHER
        The off-diagonal entries of S.
    state_before, state_after
        State variables of the laws, one law after the other, point by point.

    Returns
    -------
    tuple
        (1 if kernels and the contact equation have to be solved in turn, index of the first point, first law). A law is
        (bound arrays, `Trial`, multipliers, 1 if other laws act on the ends of its points, next law).
    """
    stop = points.size
    first = stop - sum(len(bound_law.where) for bound_law in laws)
    nested: Any = (0,)
    in_turn = 0
    end = state_before.size
    for bound_law in reversed(laws):
        first_point = stop - len(bound_law.where)
        coupled = bool(bound_law.law.uses_coupling)
        start = end - len(bound_law.where) * bound_law.law.state
        before, after = (
            array[start:end].reshape(len(bound_law.where), bound_law.law.state) for array in (state_before, state_after)
        )
        views, pushed = _trial(points, others, first_point, stop, coupled)
        before.flags.writeable = False
        shift = points["shift"][first_point : stop if bound_law.law.shifts else first_point]
        views = views._replace(before=before, after=after, shift=shift)
        in_turn = max(in_turn, pushed)
        nested = (bound_law.kernel_data, views, points["multiplier"][first_point:stop], pushed, nested)
        stop, end = first_point, start
    return (in_turn, first, nested)


def _trial(points: Any, others: Any, first: int, stop: int, coupled: bool) -> tuple[Trial, int]:
    """Return the states of the points from `first` to `stop`, and 1 if other laws act on their ends, else 0.

    The arrays are views of the records of the points. Times and responses are those of a step, which the loop sets. A
    law that does not use the coupling gets no neighbours, and 0.
    """
    starts, neighbours, values, pushed = [0], [], [], 0
    for point in points[first:stop]:
        for entry in others[point.other_start : point.other_stop] if coupled else ():
            if first <= entry.point < stop:
                neighbours.append(entry.point - first)
                values.append(entry.value)
            else:
                pushed = 1
        starts.append(len(neighbours))
    views: dict[str, Any] = {
        name: points[name][first:stop] for name in Trial._fields if name in (POINT.names or ()) and name != "shift"
    }
    rows: dict[str, Any] = {
        "first_neighbour": np.array(starts, dtype=np.int64),
        "neighbour": np.array(neighbours, dtype=np.int64),
        "coupling": np.array(values, dtype=np.float64),
    }
    for array in (*views.values(), *rows.values()):
        array.flags.writeable = False
    nothing = np.zeros((stop - first, 0))
    of_step: dict[str, Any] = dict.fromkeys(("dt", "time", "gap_response", "rate_response"), 0.0)
    return Trial(**views, **rows, **of_step, before=nothing, after=nothing, shift=np.zeros(0)), pushed


def bind(maker: Specialiser, laws: Sequence[tuple[Any, str]], *, entry: bool = False) -> Callable[..., None]:
    """Return the function that calls the kernels of all laws in turn; with `entry`, Python can call it.

    Each law is given by its kernel and the layout of what this kernel reads.
    """
    return maker.with_slots(maker.chain(apply_law, multipliers, remaining_laws, laws)).bind(apply_laws, entry=entry)


def compile_alone(bound_law: BoundLaw) -> None:
    """Compile the kernel of a bound law by itself; raise the compiler's error if it cannot be compiled."""
    points = np.recarray(len(bound_law.where), dtype=POINT)
    points[:] = np.ones((), dtype=POINT)
    points["other_start"] = points["other_stop"] = 0
    others = np.recarray(0, dtype=OTHER)
    size = len(bound_law.where) * bound_law.law.state
    nested = nest([bound_law], points, others, np.zeros(size), np.zeros(size))
    law = bound_law.kernel, layout(bound_law.kernel_data)
    bind(Specialiser(counting=True), [law], entry=True)(nested, points, others, 1.0, 0.0, (1.0, 1.0))
