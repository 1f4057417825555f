"""States of contact points, and the multipliers of a contact law's kernel in plain Python in these states."""

from __future__ import annotations

import itertools
import types
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from percuss.jit import Kernel
from percuss.methods.blame import breach, plain_function
from percuss.methods.interfaces import Trial
from percuss.methods.plugin_calls import kernel_faults, read_only

if TYPE_CHECKING:
    from percuss.methods.interfaces import ContactLaw, ContactPoints, Floats

DEPTHS = (1e-6, 1e-3)  # magnitudes of the gaps in the trial states
SHARES_OF_THE_RUN = (0.13, 0.31, 0.5, 0.77, 0.98)  # times at which multipliers are compared with those at t = 0
COUPLED = -0.3  # off-diagonal entry of S of neighbours over the root of the product of their own
SENTINEL = -1.2345678901234567e-301  # a value that no kernel computes


def changes_with_time(law: ContactLaw, bound: object, points: ContactPoints, dt: float, end: float) -> bool:
    """Return whether a law's kernel gives different multipliers for one state at different times up to `end`."""
    kernel = plain_kernel(law)
    states = list(trial_states(len(points.names), dt))
    for state in states:
        trial = _TimeWatched(*trial_of(points, dt, state, law))
        multipliers = multipliers_of(law, kernel, bound, trial)
        # A compiled function that the kernel calls may read the time unseen: the last state is tried in any case.
        if not trial.time_read and state is not states[-1]:
            continue
        for share in SHARES_OF_THE_RUN:
            if not np.array_equal(multipliers, multipliers_of(law, kernel, bound, trial._replace(time=share * end))):
                return True
    return False


class _TimeWatched(Trial):
    """A state that knows whether its time, or its fields in order, have been read."""

    time_read = False

    @property
    def time(self) -> float:
        """The time."""
        return cast("float", self[Trial._fields.index("time")])

    def __getitem__(self, index: Any) -> Any:
        self.time_read = True
        return super().__getitem__(index)

    def __iter__(self) -> Iterator[Any]:
        self.time_read = True
        return super().__iter__()


def trial_states(count: int, dt: float) -> Iterator[list[Floats]]:
    """Yield the gap, predicted gap, gap rate and predicted rate of trial states, as (count,) arrays.

    Contact points are open, closed or just touching. Before the step and during it they approach, separate or rest,
    some of them so fast that the gap changes its sign. The deepest penetrations come last.
    """
    point_numbers = np.arange(count)
    yield [np.zeros(count) for _ in range(4)]
    for depth in DEPTHS:
        slow, fast = 0.1 * depth / dt, 3.0 * depth / dt
        motions = list(itertools.product((depth, -depth), (slow, -slow), (slow, -slow, fast, -fast)))
        for shift in range(len(motions)):
            gap, rate, predicted = np.array(motions)[(point_numbers + shift) % len(motions)].reshape(count, 3).T
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
    count, chained = len(points.names), bool(law.uses_coupling and strength)
    neighbours = [[q for q in (p - 1, p + 1) if 0 <= q < count] if chained else [] for p in range(count)]
    pairs = [(p, q) for p, row in enumerate(neighbours) for q in row]
    first_neighbour, neighbour, coupling = read_only(
        (
            np.cumsum([0, *map(len, neighbours)], dtype=np.int64),
            np.array([q for _, q in pairs], dtype=np.int64),
            np.array([strength * np.sqrt(points.delassus[p] * points.delassus[q]) for p, q in pairs], dtype=float),
        )
    )
    gap, predicted_gap, rate, predicted_rate = read_only(tuple(map(np.ascontiguousarray, state)))
    before = read_only(np.zeros((count, law.state)) if before is None else before)
    return Trial(
        gap, predicted_gap, rate, predicted_rate, points.delassus, dt, 0.0, dt * dt, dt, first_neighbour, neighbour,
        coupling, before, before.copy(),
    )  # fmt: skip


def multipliers_of(law: ContactLaw, kernel: Kernel, bound: object, trial: Trial) -> Floats:
    """Return the multipliers that a kernel computes for a state, (points,)."""
    multiplier = np.full(trial.gap.size, np.nan)
    with kernel_faults(law, "multipliers"):
        kernel(bound, trial, multiplier)
    if np.isnan(multiplier).any():
        point = int(np.isnan(multiplier).argmax())
        did, remedy = fault_of_nan(kernel, bound, trial, point)
        did = did.format(f"point {point} of {multiplier.size}")
        raise breach(law, "multipliers", f"multipliers {did}: {remedy} (at {describe_state(trial, point)})")
    if not np.isfinite(trial.after).all():
        point, variable = np.argwhere(~np.isfinite(trial.after))[0]
        left = f"multipliers leaves state variable {variable} of point {point} as {trial.after[point, variable]}"
        raise breach(law, "multipliers", f"{left}, expected a finite number (at {describe_state(trial, point)})")
    return multiplier


SET_ALL = "every branch of its kernel has to set every multiplier, 0.0 where nothing presses"
# What a kernel that leaves nan for a multiplier did to a point, ``{}``, and the remedy.
UNSET = ("leaves the multiplier of {} unset", SET_ALL)
USED_UNSET = ("uses the multiplier of {} before it has set it", SET_ALL)
COMPUTED = (
    "computes a multiplier of {} that is not a number",
    "its kernel divides by zero, takes the root of a negative number, or the like",
)


def fault_of_nan(kernel: Kernel, bound: object, trial: Trial, point: int) -> tuple[str, str]:
    """Return fault and remedy: why a kernel in plain Python left nan for the multiplier of a point.

    It is called again with another initial value: if that value is still there, the kernel did not set the multiplier;
    if the result is now a number, it was computed from its own initial value.
    """
    filled = np.full(trial.gap.size, SENTINEL)
    again = trial._replace(after=trial.before.copy())
    with np.errstate(all="ignore"):
        kernel(bound, again, filled)
    if filled[point] == SENTINEL:
        return UNSET
    return COMPUTED if np.isnan(filled[point]) else USED_UNSET


def describe_state(trial: Trial, point: int) -> str:
    """Return the gaps and gap rates of a contact point in a trial, in words."""
    return (
        f"gap {trial.gap[point]:.6g}, predicted gap {trial.predicted_gap[point]:.6g}, gap rate "
        f"{trial.rate[point]:.6g}, predicted rate {trial.predicted_rate[point]:.6g}"
    )


def kernel_of(law: ContactLaw) -> Callable[..., None]:
    """Return the kernel of a contact law that is not a linear law.

    Raises
    ------
    PluginError
        If its class has no kernel.
    """
    kernel = getattr(type(law), "multipliers", None)
    if kernel is None:
        missing = "the class has no static method `multipliers(bound, trial, multiplier)`"
        raise breach(law, "bind", f"bind returned no LinearLaw, and {missing}")
    return kernel  # type: ignore[no-any-return]


def plain_kernel(law: ContactLaw) -> types.FunctionType:
    """Return the kernel of a contact law as plain Python, also of one that its author has compiled."""
    return cast("types.FunctionType", plain_function(kernel_of(law)))
