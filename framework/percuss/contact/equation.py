"""The contact equation of all points of a step, and its solver.

Over the active points of a step ``(diag(sigma) + diag(w) S) lambda = gamma``, with ``S = N^T M^-1 N`` sparse. Where the
law leaves the sign of the multiplier free this is an equation, where it excludes tension a complementarity condition; a
case may have both. A point that shares no node with another is solved exactly by one division. Coupled points are
solved by projected Gauss-Seidel sweeps, which converge for every symmetric positive semi-definite S, until no
multiplier changes by more than `TOLERANCE` times the largest. In the functions, `p` is the record of a contact point.
"""

from __future__ import annotations

from typing import Any

import numpy as np

TOLERANCE = 1e-14
ROUNDING = float(np.finfo(np.float64).eps)
SWEEPS = 10_000

# How a closed contact stores energy at half steps. BY_END: the force follows from the gap at the end of the step, and
# the contact is a spring whose energy is the mean of those at both ends of the step. BY_CURRENT: the force follows from
# the current gap, and the energy is that of a stiffness and an inertia between two steps. BY_END_FORCE: the law sees or
# pushes more than the gap, and `percuss.step.parts.end_forces` says what is stored.
NOTHING, BY_END, BY_CURRENT, BY_END_FORCE = 0, 1, 2, 3
NEVER = -1  # value of `always` for a law outside its intervals of time, which is active at no gap

# Where the multiplier of a point comes from. WITH_MASS: from its linear law, and moves ends that have mass. BY_KERNEL:
# from the kernel of its law. WITHOUT_MASS: from its linear law, and holds an end without mass in static balance.
WITH_MASS, BY_KERNEL, WITHOUT_MASS = 0, 1, 2


# Each contact point has one record: the coefficients of its law, its state in the step, and sums over the run.
LAW = np.dtype(
    [
        ("weight_gap", "f8"),
        ("weight_rate", "f8"),
        ("weight_acceleration", "f8"),
        ("sigma", "f8"),
        ("response", "f8"),  # w, the factor of S in the contact equation
        ("end_stiffness", "f8"),  # 1/sigma of explicit laws, nan for other laws
        ("sees_predicted_gap", "i8"),  # 1 if the law uses the predicted gap, 0 for the current gap
        ("sees_predicted_rate", "i8"),  # 1 if the law uses the predicted gap rate, 0 for the current rate
        ("sees_acceleration", "i8"),  # 1 if the law uses the bulk acceleration of the gap
        ("always", "i8"),  # 1 if the law is active at any gap, 0 if only at a negative one, or NEVER
        ("never_pulls", "i8"),  # 1 if the multiplier must not be negative
        ("source", "i8"),  # where the multiplier comes from: WITH_MASS, BY_KERNEL or WITHOUT_MASS
        ("stores", "i8"),  # how the contact stores energy: NOTHING, BY_END or BY_CURRENT
        ("surplus", "f8"),  # w minus its value for the gap at the end of the step
    ]
)
POINT = np.dtype(
    [
        *((name, LAW[name]) for name in LAW.names or ()),
        ("initial_gap", "f8"),
        ("delassus", "f8"),  # diagonal of S
        (
            "kappa",
            "f8",
        ),  # effective stiffness, force over overlap at the end of the step, of points that store BY_END
        ("start", "i8"),  # its entries of N are those from start to stop
        ("stop", "i8"),
        ("other_start", "i8"),  # its off-diagonal entries of S are those from other_start to other_stop
        ("other_stop", "i8"),
        ("gap", "f8"),  # at t_n
        ("predicted_gap", "f8"),  # after the bulk update
        ("rate", "f8"),  # at n - 1/2
        ("predicted_rate", "f8"),  # after the bulk update
        ("multiplier", "f8"),
        ("coming", "f8"),  # multiplier of the next step, which ends without mass know already
        ("found_before", "f8"),  # multiplier of the sweep before, if kernels and contact equation are solved in turn
        ("shift", "f8"),  # of the displacements after the step, by a law that declares it
        ("pushed_by_others", "f8"),  # gap acceleration by the multipliers of other laws, for kernels that use it
        ("stored", "f8"),  # stored energy at n - 1/2, after the step that at n + 1/2
        ("active", "i8"),  # 1 if the contact had a force or stored energy in the step before
        ("impulse", "f8"),
        ("peak", "f8"),
        ("deepest", "f8"),  # largest overlap
        ("overlap", "f8"),  # sum of the overlaps over the steps
        ("closed", "i8"),  # number of steps with a force
        ("first", "i8"),  # first step with a force, -1 if there was none
        ("last", "i8"),  # last step with a force, -1 if there was none
    ]
)
ENTRY = np.dtype([("place", "i8"), ("normal", "f8"), ("response", "f8")])  # index in `boundary_dofs`, N, M^-1 N
OTHER = np.dtype([("point", "i8"), ("value", "f8")])  # off-diagonal entries of S


def solve(points: Any, others: Any, dt: float, source: int) -> bool:
    """Find the multipliers of all points of a source, WITH_MASS or WITHOUT_MASS; return whether they converged.

    The multipliers of laws with a kernel are given and act on the other points as external forces.
    """
    for i in range(points.size):
        p = points[i]
        if p.source == source:
            p.multiplier = 0.0
            if is_active(p):
                value = right_side(p, dt) / (p.sigma + p.response * p.delassus)
                if value > 0.0 or p.never_pulls == 0:
                    p.multiplier = value
    return others.size == 0 or sweep(points, others, dt, source)


def stored_energy(p: Any, rate: float, dt: float) -> float:
    """Return the energy that a closed contact stores at n + 1/2, where the gap rate is `rate`."""
    if p.always == NEVER:
        return 0.0
    after = p.gap + dt * rate
    if p.stores == BY_END:
        # A law that is active at any gap and may pull is a spring in tension too; any other only in compression.
        closing_now = min(p.gap, 0.0) if p.always == 0 or p.never_pulls == 1 else p.gap
        closing_after = min(after, 0.0) if p.always == 0 or p.never_pulls == 1 else after
        return 0.25 * p.kappa * (closing_now * closing_now + closing_after * closing_after)  # type: ignore[no-any-return]
    if p.stores == BY_CURRENT and (p.gap < 0.0 or p.multiplier != 0.0):
        return 0.5 * (p.weight_gap * p.gap * after + p.weight_acceleration * rate * rate) / p.sigma  # type: ignore[no-any-return]
    return 0.0


def rounding_energy(p: Any, rate: float, reach: float, dt: float) -> float:
    """Return a bound on the change of a point's energy by round-off in a step, over the rounding unit.

    Displacements up to `reach` have a relative error of one unit. The contact force does work on the error of the gap,
    and the force that follows from this error does work on the motion of the gap; for a spring at the end of the step
    (BY_END) the latter is of second order.
    """
    noise = abs(p.multiplier) + ROUNDING * reach * p.kappa
    if p.stores == BY_CURRENT:
        noise += (p.weight_gap * dt + p.weight_acceleration / dt) / p.sigma * (abs(p.rate) + abs(rate))
    if p.source == WITHOUT_MASS:  # the end element turns the error of a displacement into one of its force
        noise += (abs(p.rate) + abs(rate)) / (dt * p.delassus)
    return reach * noise  # type: ignore[no-any-return]


def shown_gap(p: Any) -> float:
    """Return the gap that the law of a point uses, current or predicted."""
    return p.predicted_gap if p.sees_predicted_gap == 1 else p.gap  # type: ignore[no-any-return]


def is_active(p: Any) -> bool:
    """Return whether the law of a point is active at the gap that it uses."""
    return p.always == 1 or (p.always == 0 and shown_gap(p) < 0.0)


def right_side(p: Any, dt: float) -> float:
    """Return gamma of a point: minus its law's weights times the gap, gap rate and gap acceleration that it uses."""
    rate = p.predicted_rate if p.sees_predicted_rate == 1 else p.rate
    gamma = -p.weight_gap * shown_gap(p) - p.weight_rate * rate
    if p.sees_acceleration == 1:
        gamma -= p.weight_acceleration * (p.predicted_rate - p.rate) / dt
    return gamma  # type: ignore[no-any-return]


def sweep(points: Any, others: Any, dt: float, source: int) -> bool:
    """Sweep over the coupled points of a source until no multiplier changes any more; return whether they converged."""
    for _ in range(SWEEPS):
        moved = 0.0
        largest = 0.0
        for i in range(points.size):
            p = points[i]
            if p.source == source and p.other_start < p.other_stop and is_active(p):
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
