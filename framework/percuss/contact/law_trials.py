"""States of contact points, and the multipliers of a contact law's kernel in plain Python in these states."""

from __future__ import annotations

import itertools
import types
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from percuss.jit import Kernel
from percuss.methods.blame import breach, plain_function
from percuss.methods.interfaces import Trial
from percuss.methods.plugin_calls import kernel_faults, read_only

if TYPE_CHECKING:
    from percuss.methods.interfaces import ContactLaw, ContactPoints, Floats

DEPTHS = (1e-6, 1e-3)  # magnitudes of the gaps in the trial states
MOTIONS = 16  # that a point of a trial state may have
SHARES_OF_THE_RUN = (0.0, 0.13, 0.31, 0.5, 0.77, 0.98)  # times at which multipliers are compared
COUPLED = -0.3  # off-diagonal entry of S of neighbours over the root of the product of their own
SENTINEL = -1.2345678901234567e-301  # a value that no kernel computes


def changes_with_time(law: ContactLaw, bound: object, points: ContactPoints, dt: float, end: float) -> bool:
    """Return whether a law's kernel gives different multipliers for one state at different times up to `end`."""
    kernel, count = plain_kernel(law), len(points.names)
    # Each point of a state has a motion of its own: of many points a few states have all motions.
    for state in list(trial_states(count, dt))[:: min(count, MOTIONS)]:
        trial = trial_of(points, dt, state, law)
        found = [multipliers_of(law, kernel, bound, trial._replace(time=share * end)) for share in SHARES_OF_THE_RUN]
        if any(not np.array_equal(multipliers, found[0]) for multipliers in found):
            return True
    return False


def trial_states(count: int, dt: float) -> Iterator[list[Floats]]:
    """Yield the gap, predicted gap, gap rate and predicted rate of trial states, as (count,) arrays.

    Contact points are open, closed or just touching. Before the step and during it they approach, separate or rest,
    some of them so fast that the gap changes its sign. The deepest penetrations come last.
    """
    yield [np.zeros(count) for _ in range(4)]
    for depth in DEPTHS:
        slow, fast = 0.1 * depth / dt, 3.0 * depth / dt
        motions = np.array(list(itertools.product((depth, -depth), (slow, -slow), (slow, -slow, fast, -fast))))
        for shift in range(len(motions)):
            gap, rate, predicted = motions[(np.arange(count) + shift) % len(motions)].T
            yield [gap, gap + dt * predicted, rate, predicted]


def trial_of(
    points: ContactPoints,
    dt: float,
    state: Sequence[Floats],
    law: Any,
    before: Floats | None = None,
    *,
    strength: float = COUPLED,
) -> Trial:
    """Return the `Trial` of a state; the points of a law, or class of laws, that uses coupling are coupled in a chain.

    State variables are those of `before`, (points, k), zeros where it is None. The coupling of two neighbours is
    `strength` times the root of the product of their own entries of S; there is none for a strength of 0.
    """
    count, chained = len(points.names), law.uses_coupling and strength
    pairs = [(p, q) for p in range(count) for q in (p - 1, p + 1) if chained and 0 <= q < count]
    one, neighbour = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    first_neighbour = np.searchsorted(one, np.arange(count + 1))
    coupling = strength * np.sqrt(points.delassus[one] * points.delassus[neighbour])
    gap, predicted_gap, rate, predicted_rate = map(np.ascontiguousarray, state)
    before = np.zeros((count, law.state)) if before is None else before
    trial: Trial = read_only(Trial(
        gap, predicted_gap, rate, predicted_rate, points.delassus, dt, 0.0, dt * dt, dt, first_neighbour,
        np.ascontiguousarray(neighbour), coupling, before, before,
    ))  # fmt: skip
    return trial._replace(after=before.copy())


def multipliers_of(law: ContactLaw, kernel: Kernel, bound: object, trial: Trial) -> Floats:
    """Return the multipliers that a kernel computes for a state, (points,)."""
    multiplier = np.full(trial.gap.size, np.nan)
    with kernel_faults(law, "multipliers"):
        kernel(bound, trial, multiplier)
    if np.isnan(multiplier).any():
        point = int(np.isnan(multiplier).argmax())
        did, remedy = fault_of_nan(kernel, bound, trial, point, f"point {point} of {multiplier.size}")
        raise breach(law, "multipliers", f"multipliers {did}: {remedy} (at {describe_state(trial, point)})")
    if not np.isfinite(trial.after).all():
        point, variable = np.argwhere(~np.isfinite(trial.after))[0]
        left = f"multipliers leaves state variable {variable} of point {point} as {trial.after[point, variable]}"
        raise breach(law, "multipliers", f"{left}, expected a finite number (at {describe_state(trial, point)})")
    return multiplier


def fault_of_nan(kernel: Kernel, bound: object, trial: Trial, point: int, name: str) -> tuple[str, str]:
    """Return fault and remedy: why a kernel in plain Python left nan for the multiplier of a point of a name.

    It is called again with another initial value: if that value is still there, the kernel did not set the multiplier;
    if the result is now a number, it was computed from its own initial value.
    """
    filled = np.full(trial.gap.size, SENTINEL)
    again = trial._replace(after=trial.before.copy())
    with np.errstate(all="ignore"):
        kernel(bound, again, filled)
    remedy = "every branch of its kernel has to set every multiplier, 0.0 where nothing presses"
    if filled[point] == SENTINEL:
        return f"leaves the multiplier of {name} unset", remedy
    if not np.isnan(filled[point]):
        return f"uses the multiplier of {name} before it has set it", remedy
    remedy = "its kernel divides by zero, takes the root of a negative number, or the like"
    return f"computes a multiplier of {name} that is not a number", remedy


def describe_state(trial: Trial, point: int) -> str:
    """Return the gaps and gap rates of a contact point in a trial, in words."""
    return (
        f"gap {trial.gap[point]:.6g}, predicted gap {trial.predicted_gap[point]:.6g}, gap rate "
        f"{trial.rate[point]:.6g}, predicted rate {trial.predicted_rate[point]:.6g}"
    )


def plain_kernel(law: ContactLaw) -> types.FunctionType:
    """Return the kernel of a contact law as plain Python, also of one that its author has compiled."""
    kind: Any = type(law)
    return cast("types.FunctionType", plain_function(kind.multipliers))
