"""The contact equation of all points of a step, and the one solver of it.

Over the points of a step ``(diag(sigma) + diag(w) S) lambda = gamma``, with ``S = N^T M^-1 N`` sparse; equations where
a law leaves the sign free, complementarity where it does not, both together where a case mixes laws. A point that
shares no node with another is solved exactly in one division; coupled points by projected Gauss-Seidel sweeps, which
converge for every symmetric positive semi-definite S, until no multiplier moves by more than `TOLERANCE` of the
largest.
"""

from __future__ import annotations

from typing import Any

import numpy as np

TOLERANCE = 1e-14
ROUNDING = float(np.finfo(np.float64).eps)
SWEEPS = 10_000

# How a point stores energy. A law whose force follows from the gap at the end of the step is a spring there, and its
# energy the mean of two ends; a law judged at the current gap is one of stiffness and inertia between two steps.
NOTHING, BY_END, BY_CURRENT = 0, 1, 2
NEVER = -1  # a law that acts at no gap: the run is outside its intervals


# One record a contact point. What its law says, what the step finds there, what is summed up over the run.
LAW = np.dtype(
    [
        ("weight_gap", "f8"),
        ("weight_rate", "f8"),
        ("weight_acceleration", "f8"),
        ("sigma", "f8"),
        ("response", "f8"),  # w
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
        *((name, LAW[name]) for name in LAW.names or ()),
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
ENTRY = np.dtype([("place", "i8"), ("normal", "f8"), ("response", "f8")])  # place in `boundary_dofs`, N, M^-1 N
OTHER = np.dtype([("point", "i8"), ("value", "f8")])  # off-diagonal entries of S


def solve(points: Any, others: Any, dt: float) -> bool:
    """Find the multipliers of all points that are rows; return whether they converged.

    The multipliers of laws with a kernel of their own are there already and act on the others as known forces.
    """
    for i in range(points.size):
        p = points[i]
        if p.own == 0:
            p.multiplier = 0.0
            if acts(p):
                value = right_side(p, dt) / (p.sigma + p.response * p.delassus)
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
                    gamma -= p.response * others[k].value * points[others[k].point].multiplier
                value = gamma / (p.sigma + p.response * p.delassus)
                if value < 0.0 and p.never_pulls == 1:
                    value = 0.0
                moved = max(moved, abs(value - p.multiplier))
                p.multiplier = value
            largest = max(largest, abs(p.multiplier))
        if moved <= TOLERANCE * largest:
            return True
    return False
