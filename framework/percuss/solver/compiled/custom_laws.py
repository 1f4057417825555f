"""The one escape from the contact equation: laws whose multipliers come from a kernel of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.methods.interfaces import Trial
from percuss.methods.kernel_trial import kernel_of
from percuss.solver.compiled.contact_equation import OTHER, POINT
from percuss.solver.compiler.fingerprint import layout
from percuss.solver.compiler.specialise import Specialiser, compile_error

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integers

Response = tuple[float, float]


class Sight(NamedTuple):
    """What a law sees of its points: read-only views of their records, so that compiled code cannot write them."""

    gap: Floats
    predicted_gap: Floats
    rate: Floats
    predicted_rate: Floats
    delassus: Floats
    first_neighbour: Integers
    neighbour: Integers
    coupling: Floats
    pushed_by_others: Floats


def multipliers(bound: Any, trial: Trial, multiplier: Floats) -> None:
    """Slot: fill the multipliers of one law's points."""
    raise NotImplementedError


def tail(bound: Any, points: Any, others: Any, dt: float, time: float, response: Response, first: int) -> None:
    """Slot: the laws behind this one; none unless bound."""


def one_law(bound: Any, points: Any, others: Any, dt: float, time: float, response: Response, first: int) -> None:
    """Let one law fill the multipliers of its points, which start at `first`, then those behind it."""
    seen, multiplier = bound[1], bound[2]
    stop = first + multiplier.size
    if bound[3] == 1:
        for i in range(first, stop):
            p = points[i]
            p.pushed_by_others = 0.0
            for k in range(p.other_start, p.other_stop):
                q = others[k].point
                if q < first or q >= stop:
                    p.pushed_by_others += others[k].value * points[q].multiplier
    for i in range(multiplier.size):
        multiplier[i] = np.nan
    trial = Trial(
        seen.gap, seen.predicted_gap, seen.rate, seen.predicted_rate, seen.delassus, dt, time, response[0], response[1],
        seen.first_neighbour, seen.neighbour, seen.coupling, seen.pushed_by_others,
    )  # fmt: skip
    multipliers(bound[0], trial, multiplier)
    tail(bound[4], points, others, dt, time, response, stop)


def laws(bound: Any, points: Any, others: Any, dt: float, time: float, response: Response) -> None:
    """Let every law that is not rows fill its multipliers; a template around `first_law`.

    `response` is what a multiplier of 1/s adds to the predicted gap and to the predicted rate.
    """
    first_law(bound[2], points, others, dt, time, response, bound[1])


def first_law(bound: Any, points: Any, others: Any, dt: float, time: float, response: Response, first: int) -> None:
    """Slot: the first law that is not rows; nothing to do where there is none."""


def nest(entries: list[dict[str, Any]], points: Any, others: Any) -> Any:
    """Return what the loop hands to the kernels of laws that are not rows.

    Parameters
    ----------
    entries
        The bound laws, in the order of their points, which are the last ones.
    points : (P,) POINT
        All contact points of the loop.
    others : OTHER
        The entries of S off its diagonal.

    Returns
    -------
    tuple
        (whether kernels and rows are solved in turn, first point, (bound arrays, `Sight`, multipliers, whether other
        laws push these points, (...))).
    """
    stop = points.size
    first = stop - sum(len(entry["where"]) for entry in entries)
    nested: Any = (0,)
    in_turn = 0
    for entry in reversed(entries):
        begin = stop - len(entry["where"])
        coupled = bool(entry["law"].uses_coupling)
        seen, work_of_nodal_forces = _sight(points, others, begin, stop, coupled)
        in_turn = max(in_turn, work_of_nodal_forces)
        nested = (entry["bound"], seen, points["multiplier"][begin:stop], work_of_nodal_forces, nested)
        stop = begin
    return (in_turn, first, nested)


def _sight(points: Any, others: Any, begin: int, stop: int, coupled: bool) -> tuple[Sight, int]:
    """Return what a law sees of its points from `begin` to `stop`, and 1 where other laws push them, else 0."""
    starts, neighbours, values, work_of_nodal_forces = [0], [], [], 0
    for p in points[begin:stop]:
        for other in others[p.other_start : p.other_stop] if coupled else ():
            if begin <= other.point < stop:
                neighbours.append(other.point - begin)
                values.append(other.value)
            else:
                work_of_nodal_forces = 1
        starts.append(len(neighbours))
    views: dict[str, Any] = {name: points[name][begin:stop] for name in Sight._fields if name in (POINT.names or ())}
    rows: dict[str, Any] = {
        "first_neighbour": np.array(starts, dtype=np.int64),
        "neighbour": np.array(neighbours, dtype=np.int64),
        "coupling": np.array(values, dtype=np.float64),
    }
    for array in (*views.values(), *rows.values()):
        array.flags.writeable = False
    return Sight(**views, **rows), work_of_nodal_forces


def bind(maker: Specialiser, entries: list[dict[str, Any]], *, entry: bool = False) -> Callable[..., None]:
    """Return the kernel that calls those of all laws in turn; called from Python where it is an `entry`."""
    behind: Any = None
    for bound in reversed(entries):
        kernel = bound.get("kernel") or kernel_of(bound["law"])
        slots = {multipliers: kernel} | ({tail: behind} if behind is not None else {})
        part = maker.with_slots(slots, about=layout(bound["bound"]))
        part.checked = True
        behind = part.bind(one_law)
    return maker.with_slots({first_law: behind} if behind is not None else {}).bind(laws, entry=entry)


def why_not(entry: dict[str, Any]) -> Exception | None:
    """Return why the kernel of a bound law cannot be compiled, or None."""
    points = np.recarray(len(entry["where"]), dtype=POINT)
    points[:] = np.ones((), dtype=POINT)
    points["other_start"] = points["other_stop"] = 0
    others = np.recarray(0, dtype=OTHER)
    bound = nest([entry], points, others)
    try:
        bind(Specialiser(counting=True), [entry], entry=True)(bound, points, others, 1.0, 0.0, (1.0, 1.0))
    except compile_error() as error:
        return error
    return None
