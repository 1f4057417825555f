"""The contact equation: the rows of every law at every point, and the one solver of all of them.

Over the points of a step ``(diag(sigma) + diag(w) S) lambda = gamma``, with ``S = N^T M^-1 N`` sparse; equations where
a law leaves the sign free, complementarity where it does not, both together where a case mixes laws. A point that
shares no node with another is solved exactly in one division; coupled points by projected Gauss-Seidel sweeps, which
converge for every symmetric positive semi-definite S, until no multiplier moves by more than `TOLERANCE` of the
largest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.errors import PluginError
from percuss.methods.interfaces import ContactPoints, Judged, LeapFrog, Rows

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.methods.interfaces import Floats

TOLERANCE = 1e-14
ROUNDING = float(np.finfo(np.float64).eps)
SWEEPS = 10_000

# How a point stores energy. A law whose force follows from the gap at the end of the step is a spring there, and its
# energy the mean of two ends; a law judged at the current gap is one of stiffness and inertia between two steps.
NOTHING, BY_END, BY_CURRENT = 0, 1, 2
NEVER = -1  # a law that acts at no gap: the run is outside its intervals
SUMMED = ("multiplier", "active", "impulse", "peak", "deepest", "overlap", "closed", "first", "last")


# One record a contact point. What its law says, what the step finds there, what is summed up over the run.
JUDGED = np.dtype(
    [
        ("weight_gap", "f8"),
        ("weight_rate", "f8"),
        ("weight_acceleration", "f8"),
        ("sigma", "f8"),
        ("answer", "f8"),  # w
        ("end_stiffness", "f8"),  # 1/sigma of explicit laws, nan where there is none
        ("sees_predicted_gap", "i8"),  # 1 where the law is shown the predicted gap, else 0
        ("sees_predicted_rate", "i8"),
        ("sees_acceleration", "i8"),  # 1 where the law is shown the bulk acceleration of the gap
        ("always", "i8"),  # 1 where the law is active at any gap, 0 where at a negative one, NEVER where it rests
        ("never_pulls", "i8"),  # 1 where the multiplier must not be negative
        ("own", "i8"),  # 1 where a kernel of the law's own gives the multiplier
        ("stores", "i8"),  # how the law stores energy: NOTHING, BY_END or BY_CURRENT
        ("surplus", "f8"),  # by what w exceeds that of a gap judged at the end of the step
    ]
)
POINT = np.dtype(
    [
        *((name, JUDGED[name]) for name in JUDGED.names or ()),
        ("initial_gap", "f8"),
        ("delassus", "f8"),  # diagonal of S
        ("kappa", "f8"),  # stiffness at the end of the step, of points that store BY_END
        ("start", "i8"),  # its entries of N, from start to stop
        ("stop", "i8"),
        ("other_start", "i8"),  # its other entries of S
        ("other_stop", "i8"),
        ("gap", "f8"),  # at t_n
        ("predicted_gap", "f8"),
        ("rate", "f8"),  # at n - 1/2
        ("predicted_rate", "f8"),
        ("multiplier", "f8"),
        ("found_before", "f8"),  # multiplier of the sweep before, where kernels and rows are solved in turn
        ("pushed_by_others", "f8"),  # gap acceleration that other laws bring, for kernels that use it
        ("stored", "f8"),  # energy at n - 1/2, after the step that at n + 1/2
        ("active", "i8"),  # 1 where the law acted, or stored energy, in the step before
        ("impulse", "f8"),
        ("peak", "f8"),
        ("deepest", "f8"),  # largest overlap
        ("overlap", "f8"),  # sum of overlaps
        ("closed", "i8"),  # steps with a force
        ("first", "i8"),  # first step with a force, -1 before
        ("last", "i8"),
    ]
)
ENTRY = np.dtype([("place", "i8"), ("normal", "f8"), ("response", "f8")])  # place in `special`, N, M^-1 N
OTHER = np.dtype([("point", "i8"), ("value", "f8")])  # off-diagonal entries of S


@dataclass(frozen=True)
class Side:
    """One side of a contact point: a node, the coefficients of N there, and what M^-1 makes of them."""

    node: int
    normal: Floats  # (dim,)
    response: Floats  # (dim,)


def broadcast(rows: Rows, points: ContactPoints, law: str) -> dict[str, Any]:
    """Return a law's rows with one value a point, refusing what a law must not say.

    Raises
    ------
    PluginError
        If a row is out of bounds or has the wrong shape.
    """
    count = len(points.names)
    out: dict[str, Any] = {}
    for field in ("sigma", "gap", "rate", "acceleration"):
        value = np.asarray(getattr(rows, field), dtype=float)
        if value.shape not in {(), (count,)}:
            raise PluginError(
                f"contact law {law}: rows.{field} has shape {value.shape}, expected ({count},) or a number"
            )
        if not np.isfinite(value).all():
            raise PluginError(f"contact law {law}: rows.{field} is not finite")
        out[field] = np.broadcast_to(value, (count,))
    if (out["sigma"] < 0).any():
        raise PluginError(f"contact law {law}: rows.sigma is negative, expected a compliance of at least 0")
    for field, known in (
        ("at", ("explicit", "end")),
        ("active", ("gap < 0", "all")),
        ("sign", ("free", ">= 0")),
    ):
        if getattr(rows, field) not in known:
            raise PluginError(f"contact law {law}: rows.{field} is {getattr(rows, field)!r}, expected one of {known}")
        out[field] = getattr(rows, field)
    out["during"] = intervals(rows, law)
    return out


def intervals(rows: Rows, law: str) -> Floats | None:
    """Return the (K, 2) intervals of time in which a law acts, None for a law that always does.

    Raises
    ------
    PluginError
        If they are not pairs of a start and a stop that is not before it.
    """
    if rows.during is None:
        return None
    during = np.asarray(rows.during, dtype=float)
    if during.size == 0:
        return np.zeros((0, 2))
    if during.ndim != 2 or during.shape[1] != 2 or not (during[:, 0] <= during[:, 1]).all():
        raise PluginError(
            f"contact law {law}: rows.during is {rows.during!r}, expected pairs (start, stop), stop not before start"
        )
    return during


def judge(rows: dict[str, Any], table: LeapFrog, delassus: Floats, law: str) -> Any:
    """Return the (P,) `JUDGED` records that follow from a law's rows and an integrator's table.

    Raises
    ------
    PluginError
        If nothing resists the contact: sigma and w are both zero.
    """
    judged: Judged = getattr(table, rows["at"])
    answer = sum(rows[f] * a for f, a in zip(("gap", "rate", "acceleration"), judged.answer, strict=True))
    if ((rows["sigma"] + answer * delassus) <= 0).any():
        raise PluginError(
            f"contact law {law}: sigma and the answer of the judged state are both zero, so no force follows; "
            "give a compliance, or judge at the end of the step"
        )
    out = np.zeros(delassus.size, dtype=JUDGED)
    for weight in ("gap", "rate", "acceleration"):
        out[f"weight_{weight}"] = rows[weight]
    out["sigma"], out["answer"] = rows["sigma"], answer
    with np.errstate(divide="ignore"):
        out["end_stiffness"] = np.where((rows["sigma"] > 0) & (rows["at"] == "explicit"), 1.0 / rows["sigma"], np.nan)
    out["sees_predicted_gap"] = judged.gap == "predicted"
    out["sees_predicted_rate"] = judged.rate == "predicted"
    out["sees_acceleration"] = judged.acceleration == "bulk"
    out["always"] = rows["active"] == "all"
    out["never_pulls"] = rows["sign"] == ">= 0"
    # what a unit multiplier adds to the gap at the end is the same for every leap-frog scheme
    out["surplus"] = answer - rows["gap"] * table.end.answer[0]
    out["stores"] = storage(rows, judged)
    return out


def storage(rows: dict[str, Any], judged: Judged) -> Any:
    """Return how the points of a law store energy, (P,): NOTHING, BY_END or BY_CURRENT."""
    inert = (rows["acceleration"] != 0) & (judged.acceleration == "bulk")
    plain = (rows["rate"] == 0) & (rows["sigma"] > 0)
    if judged.gap == "predicted":
        return np.where(plain & ~inert, BY_END, NOTHING)
    whole = (judged.acceleration == "bulk" and judged.answer[2] == 1) | (rows["acceleration"] == 0)
    return np.where(plain & whole & (judged.answer[0] == 0), BY_CURRENT, NOTHING)


def own_multipliers(count: int) -> Any:
    """Return (count,) `JUDGED` records of a law that is no rows: nothing but the mark that its kernel speaks."""
    out = np.zeros(count, dtype=JUDGED)
    out["own"], out["end_stiffness"] = 1, np.nan
    return out


def delassus_rows(sides: Sequence[Sequence[Side]]) -> tuple[Floats, list[dict[int, float]]]:
    """Return S = N^T M^-1 N as its diagonal and the rows of the rest.

    Parameters
    ----------
    sides
        Of each point, its sides.

    Returns
    -------
    diagonal : (P,) array
    others
        Of each point, the other points it shares a node with, and S there.
    """
    at_node: dict[int, list[tuple[int, Side]]] = {}
    for p, row in enumerate(sides):
        for side in row:
            at_node.setdefault(side.node, []).append((p, side))
    entries: list[dict[int, float]] = [{} for _ in sides]
    for meeting in at_node.values():
        for p, mine in meeting:
            for q, theirs in meeting:
                entries[p][q] = entries[p].get(q, 0.0) + float(mine.normal @ theirs.response)
    diagonal = np.array([row.pop(p, 0.0) for p, row in enumerate(entries)])
    return diagonal, entries


def point_records(
    judged: Any, gaps: Sequence[float], sides: Sequence[Sequence[Side]], place: dict[int, int]
) -> tuple[Any, Any, Any]:
    """Return the record arrays (points, entries, others) of the loop.

    Parameters
    ----------
    judged : (P,) JUDGED
        What the laws say.
    gaps
        Initial gap of each point.
    sides
        Its sides.
    place
        Node to its first entry among the special nodes.
    """
    diagonal, rows = delassus_rows(sides)
    points = np.recarray(len(sides), dtype=POINT)
    points[:] = np.zeros((), dtype=POINT)
    for name in JUDGED.names or ():
        points[name] = judged[name]
    points["initial_gap"], points["delassus"] = gaps, diagonal
    compliance = points["sigma"] + points["surplus"] * diagonal
    spring = (points["stores"] == BY_END) & (compliance > 0)
    points["kappa"] = np.divide(points["weight_gap"], compliance, out=np.zeros_like(diagonal), where=spring)
    points["first"] = points["last"] = -1
    entries = [
        (place[side.node] + d, normal, response)
        for row in sides
        for side in row
        for d, (normal, response) in enumerate(zip(side.normal, side.response, strict=True))
    ]
    stops = np.cumsum([sum(side.normal.size for side in row) for row in sides], dtype=np.int64)
    points["start"][1:], points["stop"] = stops[:-1], stops
    others = [(q, value) for row in rows for q, value in row.items()]
    stops = np.cumsum([len(row) for row in rows], dtype=np.int64)
    points["other_start"][1:], points["other_stop"] = stops[:-1], stops
    return (
        points,
        np.array(entries, dtype=ENTRY).view(np.recarray),
        np.array(others, dtype=OTHER).view(np.recarray),
    )


def carry_over(before: Any, after: Any) -> None:
    """Let the sums of points go on after a change of drives, or of the laws that act.

    A node with prescribed velocity does not move under contact forces, so that the effective stiffness of a contact,
    and the energy stored in it, jump when a drive starts or ends. That jump counts as a change of energy like any
    other: no work goes with it.

    Parameters
    ----------
    before, after : (P,) POINT
        The points up to the change, and the fresh ones behind it.
    """
    for name in SUMMED:
        after[name] = before[name]
    after.stored = before.stored


def solve(points: Any, others: Any, dt: float) -> bool:
    """Find the multipliers of all points that are rows; return whether they converged.

    The multipliers of laws with a kernel of their own are there already and act on the others as known forces.
    """
    for i in range(points.size):
        p = points[i]
        if p.own == 0:
            p.multiplier = 0.0
            if acts(p):
                value = right_side(p, dt) / (p.sigma + p.answer * p.delassus)
                if value > 0.0 or p.never_pulls == 0:
                    p.multiplier = value
    return others.size == 0 or sweep(points, others, dt)


def stored(p: Any, rate: float, dt: float) -> float:
    """Return the energy a point stores at n + 1/2, where `rate` is the gap rate there."""
    if p.always == NEVER:
        return 0.0
    after = p.gap + dt * rate
    if p.stores == BY_END:
        # a law that pulls as it pushes is a spring both ways
        now = min(p.gap, 0.0) if p.always == 0 or p.never_pulls == 1 else p.gap
        then = min(after, 0.0) if p.always == 0 or p.never_pulls == 1 else after
        return 0.25 * p.kappa * (now * now + then * then)  # type: ignore[no-any-return]
    if p.stores == BY_CURRENT and (p.gap < 0.0 or p.multiplier != 0.0):
        return 0.5 * (p.weight_gap * p.gap * after + p.weight_acceleration * rate * rate) / p.sigma  # type: ignore[no-any-return]
    return 0.0


def rounded(p: Any, rate: float, reach: float, dt: float) -> float:
    """Return what rounding may do in a step to the energy of a point, in units of the rounding unit.

    Displacements up to `reach` are kept to that unit: the force works on the error of the gap, and what the law makes
    of the error works on the motion of the gap; for a spring at the end of the step that is of second order.
    """
    noise = abs(p.multiplier) + ROUNDING * reach * p.kappa
    if p.stores == BY_CURRENT:
        noise += (p.weight_gap * dt + p.weight_acceleration / dt) / p.sigma * (abs(p.rate) + abs(rate))
    return reach * noise  # type: ignore[no-any-return]


def seen_gap(p: Any) -> float:
    """Return the gap a point's law is shown."""
    return p.predicted_gap if p.sees_predicted_gap == 1 else p.gap  # type: ignore[no-any-return]


def acts(p: Any) -> bool:
    """Return whether the law of a point acts at the gap it is shown."""
    return p.always == 1 or (p.always == 0 and seen_gap(p) < 0.0)


def right_side(p: Any, dt: float) -> float:
    """Return gamma of a point: what its law makes of the judged state."""
    rate = p.predicted_rate if p.sees_predicted_rate == 1 else p.rate
    gamma = -p.weight_gap * seen_gap(p) - p.weight_rate * rate
    if p.sees_acceleration == 1:
        gamma -= p.weight_acceleration * (p.predicted_rate - p.rate) / dt
    return gamma  # type: ignore[no-any-return]


def sweep(points: Any, others: Any, dt: float) -> bool:
    """Sweep over coupled points until no multiplier moves; return whether that came to pass."""
    for _ in range(SWEEPS):
        moved = 0.0
        largest = 0.0
        for i in range(points.size):
            p = points[i]
            if p.own == 0 and p.other_start < p.other_stop and acts(p):
                gamma = right_side(p, dt)
                for k in range(p.other_start, p.other_stop):
                    gamma -= p.answer * others[k].value * points[others[k].point].multiplier
                value = gamma / (p.sigma + p.answer * p.delassus)
                if value < 0.0 and p.never_pulls == 1:
                    value = 0.0
                moved = max(moved, abs(value - p.multiplier))
                p.multiplier = value
            largest = max(largest, abs(p.multiplier))
        if moved <= TOLERANCE * largest:
            return True
    return False
