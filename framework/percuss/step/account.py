"""The account of a step: work and stored energy of the contacts, the growth of their energy, and whether it is sound.

The work of a contact is ``lambda N^T (u_{n+1} - u_{n-1}) / 2`` with the rows N of the step. It is not the difference of
two gaps: rows that turn or move between two steps do no work.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contact.points import BY_CURRENT, BY_END, NEVER, NOTHING, Points
from percuss.methods.interfaces import Floats
from percuss.record_arrays import Records, Row
from percuss.step.actions import BEFORE_ACCOUNT, perform

if TYPE_CHECKING:
    from percuss.step.records import Step

ROUNDING = float(np.finfo(np.float64).eps)
# Work below this fraction of the largest energy that a single force could add in one step counts as round-off.
NOISE = 1e-8


def account(step: Step, work: float, n: int, u: Floats, v: Floats) -> bool:
    """Add up the work and the contact energy of step n, and return whether the step is sound.

    Contact work far above the energy put in means an unstable step; a contact work of nan fails the comparison too.
    """
    total = step.totals[0]
    total.external_work += work
    total.largest_work = max(total.largest_work, abs(total.external_work))
    total.work_of_contacts = 0.0
    total.stored_by_points = 0.0
    total.steady_change = 0.0
    total.any_contact = 0
    perform(step.actions, BEFORE_ACCOUNT, n, u, v, v)
    add_up_contacts(step.points, step.boundary, total, n, step.now[0].dt)
    if total.any_contact == 1:
        total.contact_work += total.work_of_contacts
        # Points that were left out store no energy, except in state variables.
        total.contact_energy = total.stored_by_points + total.stored_by_laws
        total.round_off += abs(total.contact_work)
        track_growth(total, n)
    limit = total.growth * (total.began_with + total.largest_work) + total.floor + NOISE * total.step_energy
    return total.contact_work <= limit  # type: ignore[no-any-return]


def add_up_contacts(points: Points, boundary: Records, total: Row, n: int, dt: float) -> None:
    """Add up work, stored energy, impulses and overlaps of the contacts in a step."""
    for i in range(points.law.size):
        law, row, state, sums = points.law[i], points.row[i], points.state[i], points.sums[i]
        if takes_part(law, row, state, sums):
            total.any_contact = 1
            rate, reach = rate_and_reach(points, row, boundary, dt)
            work = 0.5 * dt * state.multiplier * (state.rate + rate)
            energy = stored_energy(law, row, state, law.stores, state.gap, rate, dt)
            active = 1 if state.multiplier != 0.0 or energy != 0.0 else 0
            if law.stores == BY_CURRENT and sums.active == active:
                total.steady_change += work + energy - sums.stored
            total.round_off += rounding_energy(law, row, state, rate, reach, dt)
            total.stored_by_points += energy
            total.work_of_contacts += work
            sums.stored = energy
            sums.active = active
        if state.multiplier != 0.0:
            impulse = dt * state.multiplier
            sums.impulse += impulse
            # A power costs the compiler a function of its own, a product nothing.
            total.step_energy = max(total.step_energy, impulse * impulse * row.delassus)
        if state.gap < 0.0:
            sums.deepest = max(sums.deepest, -state.gap)
    join_points(points)
    for i in range(points.contacts.size):
        contact = points.contacts[i]
        if contact.pressing == 1:
            contact.peak = max(contact.peak, contact.force)
            contact.closed += 1
            if contact.first < 0:
                contact.first = n
            contact.last = n
        if contact.gap < 0.0:
            contact.overlap -= contact.gap


def join_points(points: Points) -> None:
    """Set the force of each contact, the sum of those of its points, and its smallest gap."""
    for i in range(points.contacts.size):
        contact = points.contacts[i]
        contact.force = 0.0
        contact.gap = np.inf
        contact.pressing = 0
    for i in range(points.law.size):
        contact, row, state = points.contacts[points.law[i].contact], points.row[i], points.state[i]
        if row.start < row.stop:  # else it meets nothing
            contact.gap = min(contact.gap, state.gap)
        if state.multiplier != 0.0:
            contact.force += state.multiplier
            contact.pressing = 1


def rate_and_reach(points: Points, row: Row, boundary: Records, dt: float) -> tuple[float, float]:
    """Return the gap rate of a point after the step, and a bound of the displacements of its nodes."""
    rate = 0.0
    reach = 0.0
    for k in range(row.start, row.stop):
        q = boundary[points.entries[k].place]
        rate += points.entries[k].normal * q.new_v
        reach = max(reach, abs(q.old_u) + dt * abs(q.new_v))
    return rate, reach


def takes_part(law: Row, row: Row, state: Row, sums: Row) -> bool:
    """Return whether a contact may do work or store energy in a step.

    Without a force in this step and the one before, it may still store energy if its gap is closed, or if other
    contacts act on its ends.
    """
    may_store = law.stores != NOTHING and (state.gap < 0.0 or row.other_start < row.other_stop)
    return state.multiplier != 0.0 or sums.active == 1 or may_store  # type: ignore[no-any-return]


def stored_energy(law: Row, row: Row, state: Row, stores: int, gap: float, rate: float, dt: float) -> float:
    """Return the energy that a closed contact stores at n + 1/2.

    Parameters
    ----------
    law, row, state
        The records of its point.
    stores
        How it stores energy: NOTHING, BY_END or BY_CURRENT.
    gap, rate
        What its law sees: the gap at t_n, and the gap rate at n + 1/2.
    dt
        Time step.
    """
    if law.always == NEVER:
        return 0.0
    after = gap + dt * rate
    if stores == BY_END:
        # A law that is active at any gap and may pull is a spring in tension too; any other only in compression.
        closing_now = min(gap, 0.0) if law.always == 0 or law.never_pulls == 1 else gap
        closing_after = min(after, 0.0) if law.always == 0 or law.never_pulls == 1 else after
        return 0.25 * row.kappa * (closing_now * closing_now + closing_after * closing_after)  # type: ignore[no-any-return]
    if stores == BY_CURRENT and (gap < 0.0 or state.multiplier != 0.0):
        return 0.5 * (law.weight_gap * gap * after + law.weight_acceleration * rate * rate) / row.sigma  # type: ignore[no-any-return]
    return 0.0


def rounding_energy(law: Row, row: Row, state: Row, rate: float, reach: float, dt: float) -> float:
    """Return a bound on the change of a point's energy by round-off in a step, over the rounding unit.

    Displacements up to `reach` have a relative error of one unit. The contact force does work on the error of the gap,
    and the force that follows from this error does work on the motion of the gap; for a spring at the end of the step
    (BY_END) the latter is of second order.
    """
    noise = abs(state.multiplier) + ROUNDING * reach * row.kappa
    if law.stores == BY_CURRENT:
        noise += (law.weight_gap * dt + law.weight_acceleration / dt) / row.sigma * (abs(state.rate) + abs(rate))
    return reach * noise  # type: ignore[no-any-return]


def track_growth(total: Any, n: int) -> None:
    """Update the largest rise of contact work plus stored energy above its smallest value so far, and the drift.

    Bodies that touch at the start under load had a closed gap without a contact force one step before t = 0. The energy
    change that this causes in the first step is no growth, so that tracking starts after that step.
    """
    energy = total.contact_work + total.contact_energy
    if n == 0:
        total.least = energy
        return
    total.least = min(total.least, energy)
    if energy - total.least > total.rise:
        total.rise = energy - total.least
        total.rise_step = n
    total.drift += total.steady_change
    if abs(total.drift) > total.largest_drift:
        total.largest_drift = abs(total.drift)
        total.drift_step = n
