"""The contact equation of all points of a step, and its solver.

Over the active points of a step ``(diag(sigma) + diag(w) S) lambda = gamma``, with ``S = N^T M^-1 N`` sparse. Where the
law leaves the sign of the multiplier free this is an equation, where it excludes tension a complementarity condition; a
case may have both. A point that shares no node with another is solved exactly by one division. Coupled points are
solved by projected Gauss-Seidel sweeps, which converge for every symmetric positive semi-definite S, until no
multiplier changes by more than `TOLERANCE` times the largest.
"""

from __future__ import annotations

from typing import NamedTuple

from percuss.contact.points import FROM_LINE, FROM_PART, Points
from percuss.methods.interfaces import Floats
from percuss.record_arrays import Records, Row
from percuss.step.actions import CONTACT_EQUATION, LAWS, perform

TOLERANCE = 1e-14
SWEEPS = 10_000


class Equation(NamedTuple):
    """The points of a step whose contact equation is solved at once."""

    points: Points
    now: Records  # percuss.step.records.NOW


def see(points: Points, boundary: Records, dt: float) -> None:
    """Compute gap and gap rate of each point, the current values and those predicted without contact."""
    for i in range(points.law.size):
        row = points.row[i]
        gap = row.initial_gap
        predicted_gap = row.initial_gap
        rate = 0.0
        predicted_rate = 0.0
        for k in range(row.start, row.stop):
            entry = points.entries[k]
            q = boundary[entry.place]
            gap += entry.normal * q.old_u
            predicted_gap += entry.normal * (q.old_u + dt * q.new_v)
            rate += entry.normal * q.old_v
            predicted_rate += entry.normal * q.new_v
        state = points.state[i]
        state.gap = gap
        state.predicted_gap = predicted_gap
        state.rate = rate
        state.predicted_rate = predicted_rate


def find_multipliers(now: Row, actions: object, n: int, u: Floats, v: Floats) -> None:
    """Find the multipliers of all points in a step or stage; `solved` of the step says whether the solution converged.

    Laws with a kernel set theirs first, one law after the other; the contact equation is then solved with these forces.
    What solves it is called until it moves no multiplier any more.
    """
    perform(actions, LAWS, n, u, v, v)
    for _ in range(SWEEPS):
        now.moved = 0.0
        now.largest = 0.0
        perform(actions, CONTACT_EQUATION, n, u, v, v)
        if now.moved <= TOLERANCE * now.largest:
            return
    now.solved = 0


def solve_equation(equation: Equation, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Solve the contact equation of all points at once."""
    now = equation.now[0]
    if not solve(equation.points, now.span, FROM_LINE):
        now.solved = 0


def solve(points: Points, span: float, source: int) -> bool:
    """Find the multipliers of all points of a source, FROM_LINE or FROM_PART; return whether they converged.

    The multipliers of all other points are given and act on these as external forces.
    """
    for i in range(points.law.size):
        law = points.law[i]
        if law.source == source:
            state = points.state[i]
            state.multiplier = 0.0
            if is_active(law, state):
                row = points.row[i]
                value = right_side(law, state, span) / (row.sigma + row.response * row.delassus)
                if value > 0.0 or law.never_pulls == 0:
                    state.multiplier = value
    return points.others.size == 0 or sweep_points(points, span, source)


def sweep_points(points: Points, span: float, source: int) -> bool:
    """Sweep over the coupled points of a source until no multiplier changes any more; return whether they converged."""
    states = points.state
    for _ in range(SWEEPS):
        moved = 0.0
        largest = 0.0
        for i in range(states.size):
            law, row, state = points.law[i], points.row[i], states[i]
            if law.source == source and row.other_start < row.other_stop and is_active(law, state):
                gamma = right_side(law, state, span)
                for k in range(row.other_start, row.other_stop):
                    other = points.others[k]
                    gamma -= row.response * other.value * states[other.point].multiplier
                value = gamma / (row.sigma + row.response * row.delassus)
                if value < 0.0 and law.never_pulls == 1:
                    value = 0.0
                moved = max(moved, abs(value - state.multiplier))
                state.multiplier = value
            largest = max(largest, abs(state.multiplier))
        if moved <= TOLERANCE * largest:
            return True
    return False


def shown_gap(law: Row, state: Row) -> float:
    """Return the gap that the law of a point uses, current or predicted."""
    return state.predicted_gap if law.sees_predicted_gap == 1 else state.gap  # type: ignore[no-any-return]


def is_active(law: Row, state: Row) -> bool:
    """Return whether the law of a point is active at the gap that it uses."""
    return law.always == 1 or (law.always == 0 and shown_gap(law, state) < 0.0)


def right_side(law: Row, state: Row, span: float) -> float:
    """Return gamma of a point: minus its law's weights times the gap, gap rate and gap acceleration that it uses."""
    rate = state.predicted_rate if law.sees_predicted_rate == 1 else state.rate
    gamma = -law.weight_gap * shown_gap(law, state) - law.weight_rate * rate
    if law.sees_acceleration == 1:
        gamma -= law.weight_acceleration * (state.predicted_rate - state.rate) / span
    return gamma  # type: ignore[no-any-return]


def push(points: Points, boundary: Records, dt: float) -> None:
    """Add the velocity change dt M^-1 N lambda by the contact forces."""
    for i in range(points.law.size):
        row, multiplier = points.row[i], points.state[i].multiplier
        if multiplier != 0.0 and points.law[i].source != FROM_PART:
            for k in range(row.start, row.stop):
                entry = points.entries[k]
                boundary[entry.place].new_v += dt * entry.response * multiplier
