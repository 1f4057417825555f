"""The contact points as records of the compiled loop, from the contact laws and the integrator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contact.points import (
    BY_CURRENT,
    BY_END,
    CONTACT,
    ENTRY,
    FROM_KERNEL,
    LAW,
    NOTHING,
    OTHER,
    STATE,
    SUMS,
    Points,
)
from percuss.methods.blame import breach
from percuss.methods.interfaces import ContactState, LeapFrog, LinearLaw
from percuss.record_arrays import empty_records, record_array

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.contact.bound_law import BoundLaw
    from percuss.methods.interfaces import Floats


@dataclass(frozen=True)
class Side:
    """One side of a contact point: its node, the coefficients of N there, and those of M^-1 N.

    At an end without mass 1/m is replaced by ``1 / (k dt^2)``, k the stiffness of the end element, and `beside` is the
    node beside it; elsewhere that is None.
    """

    node: int
    normal: Floats  # (dim,)
    response: Floats  # (dim,)
    beside: int | None = None


def law_records(bound_law: BoundLaw, table: LeapFrog, delassus: Floats) -> Any:
    """Return the (P,) `LAW` records of a bound law with an integrator, without the rows of their points.

    The records of a law with a kernel contain nothing but the mark for it.

    Parameters
    ----------
    bound_law
        The law.
    table
        The states at which the integrator evaluates explicit laws and laws at the end of the step.
    delassus : (P,) array
        Diagonal of S at the points of the law [1/mass].

    Raises
    ------
    PluginError
        If sigma and w are both zero, so that no force follows.
    """
    records = np.zeros(delassus.size, dtype=LAW)
    linear = bound_law.linear
    if linear is None:
        records["source"], records["end_stiffness"] = FROM_KERNEL, np.nan
        return records
    state: ContactState = getattr(table, linear.at)
    sigma = np.asarray(linear.sigma)
    weights = linear.gap, linear.rate, linear.acceleration
    response = sum(weight * unit_response for weight, unit_response in zip(weights, state.response, strict=True))
    if ((sigma + response * delassus) <= 0).any():
        raise breach(
            bound_law.law,
            "bind",
            "sigma and the response of the state at which it is evaluated are both zero, so no force follows; give a "
            "compliance, or evaluate it at the end of the step",
        )
    records["weight_gap"], records["weight_rate"], records["weight_acceleration"] = weights
    records["sigma"], records["response"] = sigma, response
    with np.errstate(divide="ignore"):
        records["end_stiffness"] = np.where((sigma > 0) & (linear.at == "explicit"), 1.0 / sigma, np.nan)
    records["sees_predicted_gap"] = state.gap == "predicted"
    records["sees_predicted_rate"] = state.rate == "predicted"
    records["sees_acceleration"] = state.acceleration == "bulk"
    records["always"] = linear.active == "all"
    records["never_pulls"] = linear.sign == ">= 0"
    # With every leap-frog scheme a unit multiplier changes the gap at the end of the step by the same amount.
    records["surplus"] = response - linear.gap * table.end.response[0]
    records["stores"] = energy_storage(linear, state)
    return records


def energy_storage(linear: LinearLaw, state: ContactState) -> Any:
    """Return how the points of a linear law store energy, (P,): NOTHING, BY_END or BY_CURRENT."""
    sigma, rate, acceleration = (np.asarray(value) for value in (linear.sigma, linear.rate, linear.acceleration))
    has_inertia = (acceleration != 0) & (state.acceleration == "bulk")
    elastic = (rate == 0) & (sigma > 0)
    if state.gap == "predicted":
        return np.where(elastic & ~has_inertia, BY_END, NOTHING)
    full_response = (state.acceleration == "bulk" and state.response[2] == 1) | (acceleration == 0)
    return np.where(elastic & full_response & (state.response[0] == 0), BY_CURRENT, NOTHING)


def balanced(point_sides: Sequence[Side]) -> bool:
    """Return whether a side of a contact point has no mass, so that the static balance of that side gives its force."""
    return any(side.beside is not None for side in point_sides)


def delassus_rows(sides: Sequence[Sequence[Side]]) -> tuple[Floats, list[dict[int, float]]]:
    """Return S = N^T M^-1 N as its diagonal and its off-diagonal entries.

    The equation of a point with a side without mass has the response of such sides alone: what its force moves of the
    other side, and of other points, comes a step later.

    Parameters
    ----------
    sides
        The sides of each point.

    Returns
    -------
    diagonal : (P,) array
    others
        For each point, a map from every other point that shares a node with it to their entry of S.
    """
    at_node: dict[int, list[tuple[int, Side]]] = {}
    for p, point_sides in enumerate(sides):
        in_balance = balanced(point_sides)
        for side in point_sides:
            if in_balance and side.beside is None:
                continue
            at_node.setdefault(side.node, []).append((p, side))
    entries: list[dict[int, float]] = [{} for _ in sides]
    for node_sides in at_node.values():
        for p, first in node_sides:
            for q, second in node_sides:
                entries[p][q] = entries[p].get(q, 0.0) + float(first.normal @ second.response)
    diagonal = np.array([point_sides.pop(p, 0.0) for p, point_sides in enumerate(entries)])
    return diagonal, entries


def point_records(
    laws: Any, of_contact: Sequence[int], gaps: Sequence[float], sides: Sequence[Sequence[Side]], place: dict[int, int]
) -> Points:
    """Return the records of all contact points of a loop.

    Parameters
    ----------
    laws : (P,) LAW
        Records of the laws.
    of_contact
        Number of the contact of each point.
    gaps
        Initial gap of each point.
    sides
        The sides of each point.
    place
        Map from each boundary node to the index of its first boundary degree of freedom.
    """
    diagonal, rows = delassus_rows(sides)
    law, sums = empty_records(len(sides), LAW), empty_records(len(sides), SUMS)
    law[:] = laws
    law["contact"], law["initial_gap"], law["delassus"] = of_contact, gaps, diagonal
    compliance = laws["sigma"] + laws["surplus"] * diagonal
    is_spring = (laws["stores"] == BY_END) & (compliance > 0)
    law["kappa"] = np.divide(laws["weight_gap"], compliance, out=np.zeros_like(diagonal), where=is_spring)
    contacts = empty_records(max(of_contact, default=-1) + 1, CONTACT)
    contacts["first"] = contacts["last"] = -1
    entries = [
        (place[side.node] + d, normal, response if side.beside is None else 0.0)
        for row in sides
        for side in row
        for d, (normal, response) in enumerate(zip(side.normal, side.response, strict=True))
    ]
    stops = np.cumsum([sum(side.normal.size for side in row) for row in sides], dtype=np.int64)
    law["start"][1:], law["stop"] = stops[:-1], stops
    others = [(q, value) for row in rows for q, value in row.items()]
    stops = np.cumsum([len(row) for row in rows], dtype=np.int64)
    law["other_start"][1:], law["other_stop"] = stops[:-1], stops
    state = empty_records(len(sides), STATE)
    return Points(law, state, sums, contacts, record_array(entries, ENTRY), record_array(others, OTHER))


def carry_over(before: Points, after: Points) -> None:
    """Continue the sums of the points after a change of the active drives or laws.

    A node with prescribed velocity does not move under contact forces, so that the effective stiffness of a contact,
    and the energy stored in it, jump when a drive starts or ends. That jump counts as a change of energy like any
    other, because no work corresponds to it.

    Parameters
    ----------
    before, after
        The points before the change, and the new records after it, whose sums are set.
    """
    after.sums[:] = before.sums
    after.contacts[:] = before.contacts
    after.state["multiplier"] = before.state["multiplier"]
