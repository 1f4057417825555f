"""Trial calls of a contact law's kernel in plain Python, made before the first run of its source.

Compiled code can write to arrays that are meant to be read only, and can leave multipliers unset that a kernel forgets;
the resulting numbers look like any others. Trial calls in plain Python, with read-only arrays and with multipliers that
start as nan, find such mistakes before the run. Every call is repeated after all the others: a different result for the
same state shows that the kernel depends on earlier calls or on chance.
"""

from __future__ import annotations

import itertools
import types
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from percuss.compiling import Kernel
from percuss.errors import PluginError
from percuss.methods.blame import breach, plain_function
from percuss.methods.first_run import first_asked
from percuss.methods.interfaces import Trial
from percuss.methods.plugin_calls import called_twice, kernel_faults, mapped, read_only

if TYPE_CHECKING:
    from percuss.methods.interfaces import ContactLaw, ContactPoints, Floats

DEPTHS = (1e-6, 1e-3)  # magnitudes of the gaps in the trial states
SHARES_OF_THE_RUN = (0.13, 0.31, 0.5, 0.77, 0.98)  # times at which multipliers are compared with those at t = 0
COUPLED = -0.3  # off-diagonal entry of S of neighbours over the root of the product of their own
# Up to this number of contact points every instance of a law is tried; above it, one instance of its class for each
# number of points.
MOST_POINTS = 32
SENTINEL = -1.2345678901234567e-301  # a value that no kernel computes
LOWEST_INDEX = -2  # A lower index of a bound array counts as a mistake; -1 and -2 are used on purpose.


def try_kernel(law: ContactLaw, bound: object, points: ContactPoints, dt: float) -> None:
    """Call the kernel of a third-party law in many states, twice, before the first run of its source.

    Raises
    ------
    PluginError
        If the kernel fails, leaves a multiplier unset, changes a global variable, reads a bound array at an index below
        `LOWEST_INDEX`, or gives other multipliers the second time.
    """
    count = len(points.names)
    tried = f"{count} {law!r}" if count <= MOST_POINTS else str(count)
    with first_asked(f"multipliers {tried}", law) as due:
        if due:
            _try_twice(law, bound, points, dt)


def _try_twice(law: ContactLaw, bound: object, points: ContactPoints, dt: float) -> None:
    kernel = plain_kernel(law)
    globals_before = _mutable_globals(kernel)
    low_indices: list[int] = []
    bound = _with_watched_arrays(bound, low_indices)

    def call_in_all_states() -> list[tuple[Floats, ...]]:
        results: list[tuple[Floats, ...]] = []
        for state in _trial_states(len(points.names), dt):
            # The state variables that the kernel leaves are those that it finds in the next state.
            trial = trial_of(points, dt, state, law, results[-1][1] if results else None)
            results.append((multipliers_of(law, kernel, bound, trial), trial.after, trial.shift))
            if low_indices:
                raise _breach(
                    law,
                    f"reads a bound array at index {low_indices[0]}, which counts from its end, in the state with "
                    f"{describe_state(trial, 0)}: check the index, or write `array.size - n` where the end is meant",
                )
        return results

    called_twice(law, "multipliers", call_in_all_states, [()])
    for name, value in _mutable_globals(kernel).items():
        if value != globals_before[name]:
            raise _breach(
                law,
                f"changes `{name}`: a kernel keeps nothing between calls; what it needs is in what `bind` returns and "
                "in the trial, and what it remembers in `trial.before` and `trial.after`",
            )


def _breach(law: ContactLaw, message: str) -> PluginError:
    """Return the error for a kernel of a law that does what its contract forbids."""
    return breach(law, "multipliers", f"multipliers {message}")


def changes_with_time(law: ContactLaw, bound: object, points: ContactPoints, dt: float, end: float) -> bool:
    """Return whether a law's kernel gives different multipliers for one state at different times up to `end`."""
    kernel = plain_kernel(law)
    states = list(_trial_states(len(points.names), dt))
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


class _WatchedArray(np.ndarray):
    """An array that records the indices below `LOWEST_INDEX` at which it is read.

    Plain Python and compiled code both take index -5 for the fifth entry from the end, so that such a mistake raises no
    error.
    """

    low_indices: list[int]

    def __array_finalize__(self, other: object) -> None:
        self.low_indices = getattr(other, "low_indices", [])

    def __getitem__(self, index: Any) -> Any:
        indices = index if isinstance(index, tuple) else (index,)
        self.low_indices += [int(i) for i in indices if isinstance(i, int | np.integer) and i < LOWEST_INDEX]
        return super().__getitem__(index)


def _with_watched_arrays(value: object, low_indices: list[int]) -> Any:
    """Return a bound value whose arrays record in `low_indices` the indices below `LOWEST_INDEX` that are read."""
    if isinstance(value, np.ndarray):
        view = value.view(_WatchedArray)
        view.low_indices = low_indices
        return view
    return mapped(lambda item: _with_watched_arrays(item, low_indices), value) if isinstance(value, tuple) else value


def _trial_states(count: int, dt: float) -> Iterator[list[Floats]]:
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
    first_neighbour, neighbour, coupling, pushed_by_others = read_only(
        (
            np.cumsum([0, *map(len, neighbours)], dtype=np.int64),
            np.array([q for _, q in pairs], dtype=np.int64),
            np.array([strength * np.sqrt(points.delassus[p] * points.delassus[q]) for p, q in pairs], dtype=float),
            np.zeros(count),
        )
    )
    gap, predicted_gap, rate, predicted_rate = read_only(tuple(map(np.ascontiguousarray, state)))
    before = read_only(np.zeros((count, law.state)) if before is None else before)
    return Trial(
        gap, predicted_gap, rate, predicted_rate, points.delassus, dt, 0.0, dt * dt, dt, first_neighbour, neighbour,
        coupling, pushed_by_others, before, before.copy(), np.zeros(count if law.shifts else 0),
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
        raise _breach(law, f"{did}: {remedy} (at {describe_state(trial, point)})")
    for what, values in (("the shift of point {}", trial.shift), ("state variable {1} of point {0}", trial.after)):
        if not np.isfinite(values).all():
            place = tuple(np.argwhere(~np.isfinite(values))[0])
            left = f"leaves {what.format(*place)} as {values[place]}, expected a finite number"
            raise _breach(law, f"{left} (at {describe_state(trial, place[0])})")
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
    again = trial._replace(after=trial.before.copy(), shift=np.zeros_like(trial.shift))
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


def _mutable_globals(kernel: types.FunctionType) -> dict[str, str]:
    """Return the text form of each mutable global variable that a kernel names, attributes of classes included."""
    kinds = (list, dict, set, bytearray, np.ndarray)
    names = kernel.__globals__
    globals_used = {name: names[name] for name in kernel.__code__.co_names if name in names}
    class_attributes = {
        f"{name}.{part}": value
        for name, owner in globals_used.items()
        if isinstance(owner, type)
        for part, value in vars(owner).items()
    }
    return {
        name: repr(value) for name, value in {**globals_used, **class_attributes}.items() if isinstance(value, kinds)
    }


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
