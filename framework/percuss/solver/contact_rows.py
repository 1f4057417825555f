"""What laws and integrator say of the contact points, as the records that the compiled loop reads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.errors import PluginError
from percuss.methods.interfaces import ContactPoints, ContactState, LeapFrog, LinearLaw
from percuss.solver.compiled.contact_equation import BY_CURRENT, BY_END, ENTRY, LAW, NOTHING, OTHER, POINT

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.methods.interfaces import Floats

SUMMED = ("multiplier", "active", "impulse", "peak", "deepest", "overlap", "closed", "first", "last")


@dataclass(frozen=True)
class Side:
    """One side of a contact point: a node, the coefficients of N there, and what M^-1 makes of them."""

    node: int
    normal: Floats  # (dim,)
    response: Floats  # (dim,)


def broadcast(rows: LinearLaw, points: ContactPoints, law: str) -> dict[str, Any]:
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


def intervals(rows: LinearLaw, law: str) -> Floats | None:
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


def law_records(rows: dict[str, Any], table: LeapFrog, delassus: Floats, law: str) -> Any:
    """Return the (P,) `LAW` records that follow from a law's rows and an integrator's table.

    Raises
    ------
    PluginError
        If nothing resists the contact: sigma and w are both zero.
    """
    state: ContactState = getattr(table, rows["at"])
    response = sum(rows[f] * a for f, a in zip(("gap", "rate", "acceleration"), state.response, strict=True))
    if ((rows["sigma"] + response * delassus) <= 0).any():
        raise PluginError(
            f"contact law {law}: sigma and the response of the judged state are both zero, so no force follows; "
            "give a compliance, or judge at the end of the step"
        )
    out = np.zeros(delassus.size, dtype=LAW)
    for weight in ("gap", "rate", "acceleration"):
        out[f"weight_{weight}"] = rows[weight]
    out["sigma"], out["response"] = rows["sigma"], response
    with np.errstate(divide="ignore"):
        out["end_stiffness"] = np.where((rows["sigma"] > 0) & (rows["at"] == "explicit"), 1.0 / rows["sigma"], np.nan)
    out["sees_predicted_gap"] = state.gap == "predicted"
    out["sees_predicted_rate"] = state.rate == "predicted"
    out["sees_acceleration"] = state.acceleration == "bulk"
    out["always"] = rows["active"] == "all"
    out["never_pulls"] = rows["sign"] == ">= 0"
    # what a unit multiplier adds to the gap at the end is the same for every leap-frog scheme
    out["surplus"] = response - rows["gap"] * table.end.response[0]
    out["stores"] = storage(rows, state)
    return out


def storage(rows: dict[str, Any], state: ContactState) -> Any:
    """Return how the points of a law store energy, (P,): NOTHING, BY_END or BY_CURRENT."""
    inert = (rows["acceleration"] != 0) & (state.acceleration == "bulk")
    plain = (rows["rate"] == 0) & (rows["sigma"] > 0)
    if state.gap == "predicted":
        return np.where(plain & ~inert, BY_END, NOTHING)
    whole = (state.acceleration == "bulk" and state.response[2] == 1) | (rows["acceleration"] == 0)
    return np.where(plain & whole & (state.response[0] == 0), BY_CURRENT, NOTHING)


def own_multipliers(count: int) -> Any:
    """Return (count,) `LAW` records of a law that is no rows: nothing but the mark that its kernel speaks."""
    out = np.zeros(count, dtype=LAW)
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
    for contact_pair in at_node.values():
        for p, mine in contact_pair:
            for q, theirs in contact_pair:
                entries[p][q] = entries[p].get(q, 0.0) + float(mine.normal @ theirs.response)
    diagonal = np.array([row.pop(p, 0.0) for p, row in enumerate(entries)])
    return diagonal, entries


def point_records(
    laws: Any, gaps: Sequence[float], sides: Sequence[Sequence[Side]], place: dict[int, int]
) -> tuple[Any, Any, Any]:
    """Return the record arrays (points, entries, others) of the loop.

    Parameters
    ----------
    laws : (P,) LAW
        What the laws say.
    gaps
        Initial gap of each point.
    sides
        Its sides.
    place
        Node to its first entry among the boundary degrees of freedom.
    """
    diagonal, rows = delassus_rows(sides)
    points = np.recarray(len(sides), dtype=POINT)
    points[:] = np.zeros((), dtype=POINT)
    for name in LAW.names or ():
        points[name] = laws[name]
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
