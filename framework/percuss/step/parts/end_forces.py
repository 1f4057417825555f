"""Laws that see or push more than the gap: the end force ``F = Sigma^T u`` of their contact points.

Such a law is evaluated at ``G^T u + g_0``, ``G = N + sees Sigma``, and pushes ``P = N + pushes Sigma``. The entries of
a contact point contain ``M^-1 P``, also at the nodes beside its ends, so that multipliers act as those of any law. What
the law sees stands in the place of the gap while the contact equation is solved; the gap comes back after that. In the
functions, `e` is the record of such a point, `p` that of its contact point and `q` that of a boundary degree of
freedom.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from percuss.contact.equation import BY_CURRENT, NEVER, ROUNDING, stored_energy

END_FORCE = np.dtype(
    [
        ("point", "i8"),  # index of the contact point
        ("start", "i8"),  # its entries of Sigma are those from start to stop
        ("stop", "i8"),
        ("sees", "f8"),
        ("pushes", "f8"),
        ("softens", "f8"),
        ("stores", "i8"),  # how the point stores energy in terms of what it sees, as `LAW.stores`
        ("force", "f8"),  # F at t_n
        ("gap", "f8"),  # the gaps and gap rates themselves, while the point shows what its law sees
        ("predicted_gap", "f8"),
        ("rate", "f8"),
        ("predicted_rate", "f8"),
        ("seen_gap", "f8"),  # what the law sees at t_n
        ("seen_rate", "f8"),  # and at n - 1/2
        ("stored", "f8"),  # stored energy at n - 1/2, after the step that at n + 1/2
        ("active", "i8"),  # 1 if the contact had a force or stored energy in the step before
    ]
)
END_FORCE_ENTRY = np.dtype(
    [("place", "i8"), ("row", "f8"), ("response", "f8")]
)  # in `boundary_dofs`, Sigma, M^-1 Sigma


def soften_end_elements(points: Any, end_forces: Any, rows: Any, boundary_dofs: Any, dt: float) -> None:
    """Find the end forces at t_n, and add the velocity change by what acts whether contacts are closed or open."""
    for i in range(end_forces.size):
        e = end_forces[i]
        e.force = 0.0
        for k in range(e.start, e.stop):
            e.force += rows[k].row * boundary_dofs[rows[k].place].old_u
    for i in range(end_forces.size):
        e = end_forces[i]
        force = softening(points, e) * e.force
        if force != 0.0:
            for k in range(e.start, e.stop):
                boundary_dofs[rows[k].place].new_v += dt * rows[k].response * force


def softening(points: Any, e: Any) -> float:
    """Return the factor of Sigma Sigma^T that a point takes from the stiffness; 0 while its law does not act."""
    return 0.0 if points[e.point].always == NEVER else e.softens


def show_end_forces(points: Any, end_forces: Any, rows: Any, boundary_dofs: Any, dt: float) -> None:
    """Put what the laws see in the place of gaps and gap rates, which are kept."""
    for i in range(end_forces.size):
        e = end_forces[i]
        p = points[e.point]
        rate = 0.0
        predicted_force = 0.0
        predicted_rate = 0.0
        for k in range(e.start, e.stop):
            q = boundary_dofs[rows[k].place]
            rate += rows[k].row * q.old_v
            predicted_force += rows[k].row * (q.old_u + dt * q.new_v)
            predicted_rate += rows[k].row * q.new_v
        e.gap = p.gap
        e.predicted_gap = p.predicted_gap
        e.rate = p.rate
        e.predicted_rate = p.predicted_rate
        p.gap += e.sees * e.force
        p.predicted_gap += e.sees * predicted_force
        p.rate += e.sees * rate
        p.predicted_rate += e.sees * predicted_rate
        e.seen_gap = p.gap
        e.seen_rate = p.rate


def show_gaps(points: Any, end_forces: Any) -> None:
    """Put gaps and gap rates back."""
    for i in range(end_forces.size):
        e = end_forces[i]
        p = points[e.point]
        p.gap = e.gap
        p.predicted_gap = e.predicted_gap
        p.rate = e.rate
        p.predicted_rate = e.predicted_rate


def work_and_energy(
    points: Any, end_forces: Any, rows: Any, entries: Any, boundary_dofs: Any, total: Any, dt: float
) -> tuple[float, float, float]:
    """Return the work of what is pushed beyond the gap, the stored energy, and its steady change, after a step.

    The force ``c Sigma F_n`` does the work ``c F_n (F_{n+1} - F_{n-1}) / 2`` and stores ``-c F_n F_{n+1} / 2``, both
    without loss. A law that pushes what it sees stores the energy of any law, of what it sees. The steady change is
    that of work and stored energy at points with BY_CURRENT that neither open nor close.
    """
    work = 0.0
    energy_sum = 0.0
    steady_change = 0.0
    for i in range(end_forces.size):
        e = end_forces[i]
        p = points[e.point]
        before = 0.0
        after = 0.0
        size = 0.0
        reach = 0.0
        for k in range(e.start, e.stop):
            q = boundary_dofs[rows[k].place]
            before += rows[k].row * q.old_v
            after += rows[k].row * q.new_v
            size += abs(rows[k].row)
            reach = max(reach, abs(q.old_u) + dt * abs(q.new_v))
        seen_rate = e.sees * after
        for k in range(p.start, p.stop):
            seen_rate += entries[k].normal * boundary_dofs[entries[k].place].new_v
        softens = softening(points, e)
        point_work = 0.5 * dt * (e.pushes * p.multiplier + softens * e.force) * (before + after)
        energy = -0.5 * softens * e.force * (e.force + dt * after)
        # The energy of a law is computed from what it sees, which stands in the place of the gap again.
        gap, stores = p.gap, p.stores
        p.gap = e.seen_gap
        p.stores = e.stores
        law_energy = stored_energy(p, seen_rate, dt)
        p.gap = gap
        p.stores = stores
        active = 1 if p.multiplier != 0.0 or law_energy != 0.0 else 0
        energy += law_energy
        noise = size * (abs(e.pushes * p.multiplier) + abs(softens * e.force))
        if e.stores == BY_CURRENT:
            if e.active == active:
                by_gap = 0.5 * dt * p.multiplier * (p.rate + seen_rate - e.sees * after)
                steady_change += by_gap + point_work + energy - e.stored
            noise += (1.0 + abs(e.sees) * size) * (
                p.weight_gap * dt / p.sigma * (abs(e.seen_rate) + abs(seen_rate)) + ROUNDING * reach * p.kappa
            )
        total.round_off += reach * noise
        work += point_work
        energy_sum += energy
        e.stored = energy
        e.active = active
    return work, energy_sum, steady_change
