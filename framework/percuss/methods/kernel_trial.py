"""A law's own kernel tried before it runs, in plain Python.

Compiled code writes where it was told not to and leaves unset what a kernel forgets; numbers that come of that look
like any others. Calls in plain Python, with arrays that cannot be written and multipliers that are no number, tell
before the run. Every call is made a second time after all the others: another answer to the same question is one that
depends on what was asked before, or on chance.
"""

from __future__ import annotations

import itertools
import weakref
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.errors import PluginError
from percuss.methods.blame import line_in_plugin
from percuss.methods.interfaces import LinearLaw, Trial

if TYPE_CHECKING:
    from percuss.methods.interfaces import ContactLaw, ContactPoints

DEPTHS = (1e-6, 1e-3)  # of the gaps that a kernel is tried with
SHARES_OF_THE_RUN = (0.13, 0.31, 0.5, 0.77, 0.98)  # times at which a law is asked whether it changes with time
LAST = 32  # points of a law whose every instance is tried; with more, the first instance of its class
LOWEST_INDEX = -2  # a lower index of a bound array is taken for a mistake: the last two are read on purpose
_TRIED: weakref.WeakKeyDictionary[type, set[Any]] = weakref.WeakKeyDictionary()


def bound_of(law: ContactLaw, points: ContactPoints, dt: float) -> Any:
    """Return what a law binds at some points: its rows, or read-only arrays for its kernel, which was tried.

    Raises
    ------
    PluginError
        If `bind` returned anything but rows or a NamedTuple, or the kernel fails.
    """
    bound = law.bind(points, dt)
    if isinstance(bound, LinearLaw):
        return bound
    if not (isinstance(bound, tuple) and hasattr(bound, "_fields")):
        found = "nothing" if bound is None else f"a {type(bound).__name__}"
        wanted = "LinearLaw, or a NamedTuple of what its kernel `multipliers` needs"
        raise PluginError(f"contact law {law.name}: bind returned {found}, expected {wanted}")
    bound = read_only(bound)
    count = len(points.names)
    key = (count, repr(law)) if count <= LAST else count
    if key not in _TRIED.setdefault(type(law), set()):
        _try(law, bound, points, dt)
        _TRIED[type(law)].add(key)
    return bound


def read_only(value: Any) -> Any:
    """Return a bound value with views of its arrays that cannot be written; tuples are looked into."""
    if isinstance(value, np.ndarray):
        view = value.view()
        view.flags.writeable = False
        return view
    if isinstance(value, tuple):
        parts = [read_only(item) for item in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return value


def _try(law: ContactLaw, bound: Any, points: ContactPoints, dt: float) -> None:
    """Call the kernel of a law in many states, and once more in each of them.

    Raises
    ------
    PluginError
        If it fails, leaves a multiplier without a number, or does not give the same answers the second time.
    """
    kernel: Any = kernel_of(law)
    kernel = getattr(kernel, "py_func", kernel)
    before = _mutable(kernel)
    states = list(_states(len(points.names), dt))
    first = [_called(law, kernel, bound, _trial(points, dt, state, law)) for state in states]
    for name, value in _mutable(kernel).items():
        if value != before[name]:
            raise PluginError(
                f"contact law {law.name}: multipliers changes `{name}`: a kernel keeps nothing between calls; what it "
                "needs is in what `bind` returns and in the trial"
            )
    read: list[int] = []
    watched = _watching(bound, read)
    for state, answer in zip(states, first, strict=True):
        trial = _trial(points, dt, state, law)
        again = _called(law, kernel, watched, trial)
        if read:
            raise PluginError(
                f"contact law {law.name}: multipliers reads a bound array at index {read[0]}, which counts from its "
                f"end, in the state with {seen(trial, 0)}: check the index, or write `array.size - n` where the end is "
                "meant"
            )
        if not np.array_equal(answer, again):
            point = int((answer != again).argmax())
            raise PluginError(
                f"contact law {law.name}: multipliers gives {answer[point]:.17g} for point {point}, and "
                f"{again[point]:.17g} when it is asked the same again after other calls: the kernel keeps state "
                "between calls, or draws random numbers; what it needs is in what `bind` returns and in the trial"
            )


def changes_with_time(law: ContactLaw, bound: Any, points: ContactPoints, dt: float, end: float) -> bool:
    """Return whether the kernel of a law answers the same state differently at different times up to `end`."""
    kernel: Any = kernel_of(law)
    kernel = getattr(kernel, "py_func", kernel)
    for state in _states(len(points.names), dt):
        trial = _trial(points, dt, state, law)
        answer = _called(law, kernel, bound, trial)
        for share in SHARES_OF_THE_RUN:
            if not np.array_equal(answer, _called(law, kernel, bound, trial._replace(time=share * end))):
                return True
    return False


class _Watched(np.ndarray):
    """An array that notes the lowest index it is read at; plain Python and compiled code take -5 for the fifth last."""

    read: list[int]

    def __array_finalize__(self, other: Any) -> None:
        self.read = getattr(other, "read", [])

    def __getitem__(self, index: Any) -> Any:
        places = index if isinstance(index, tuple) else (index,)
        self.read += [int(place) for place in places if isinstance(place, int | np.integer) and place < LOWEST_INDEX]
        return super().__getitem__(index)


def _watching(value: Any, read: list[int]) -> Any:
    """Return a bound value whose arrays note in `read` at which negative indices they are read."""
    if isinstance(value, np.ndarray):
        view = value.view(_Watched)
        view.read = read
        return view
    if isinstance(value, tuple):
        parts = [_watching(item, read) for item in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return value


def _states(count: int, dt: float) -> Iterator[list[Any]]:
    """Yield gap, predicted gap, gap rate and predicted rate of some states, the deepest last; (count,) arrays.

    Points are open, closed and just touching; before the step and in it they close, part or rest, also so fast that
    the gap changes its sign.
    """
    place = np.arange(count)
    yield [np.zeros(count) for _ in range(4)]
    for depth in DEPTHS:
        slow, fast = 0.1 * depth / dt, 3.0 * depth / dt
        every = list(itertools.product((depth, -depth), (slow, -slow), (slow, -slow, fast, -fast)))
        for shift in range(len(every)):
            gap, rate, predicted = np.array(every)[(place + shift) % len(every)].reshape(count, 3).T
            yield [gap, gap + dt * predicted, rate, predicted]


def _trial(points: ContactPoints, dt: float, state: list[Any], law: ContactLaw) -> Trial:
    """Return a state as a kernel sees it; points of a law that takes account of it are coupled in a chain."""
    count = len(points.names)
    rows = [[q for q in (p - 1, p + 1) if 0 <= q < count] if law.uses_coupling else [] for p in range(count)]
    pairs = [(p, q) for p, row in enumerate(rows) for q in row]
    coupling = np.array([-0.3 * np.sqrt(points.delassus[p] * points.delassus[q]) for p, q in pairs], dtype=float)
    gap, predicted_gap, rate, predicted_rate, first, neighbour, coupling, pushed = (
        read_only(np.ascontiguousarray(array))
        for array in (
            *state,
            np.cumsum([0, *(len(row) for row in rows)], dtype=np.int64),
            np.array([q for _, q in pairs], dtype=np.int64),
            coupling,
            np.zeros(count),
        )
    )
    return Trial(
        gap, predicted_gap, rate, predicted_rate, points.delassus, dt, 0.0, dt * dt, dt, first, neighbour, coupling,
        pushed,
    )  # fmt: skip


def _called(law: ContactLaw, kernel: Any, bound: Any, trial: Trial) -> Any:
    """Return the multipliers of a state, (points,)."""
    multiplier = np.full(trial.gap.size, np.nan)
    try:
        with np.errstate(all="ignore"):
            kernel(bound, trial, multiplier)
    except Exception as error:
        text = f"{type(error).__name__}: {error}"
        if isinstance(error, ValueError) and "read-only" in str(error):
            text = "it changes what it was handed; it may write to the multiplier alone"
        where = line_in_plugin(error)
        raise PluginError(f"{where + ': ' if where else ''}contact law {law.name}: multipliers: {text}") from error
    if np.isnan(multiplier).any():
        point = int(np.isnan(multiplier).argmax())
        raise PluginError(
            f"contact law {law.name}: multipliers leaves point {point} of {multiplier.size} without a number: "
            f"set every entry, 0.0 where nothing presses (at {seen(trial, point)})"
        )
    return multiplier


def seen(trial: Trial, point: int) -> str:
    """Return in words what a kernel saw of a point."""
    return (
        f"gap {trial.gap[point]:.6g}, predicted gap {trial.predicted_gap[point]:.6g}, gap rate "
        f"{trial.rate[point]:.6g}, predicted rate {trial.predicted_rate[point]:.6g}"
    )


def _mutable(kernel: Any) -> dict[str, str]:
    """Return what the lists and the like that a kernel names look like, those of classes too."""
    kinds = (list, dict, set, bytearray, np.ndarray)
    names = kernel.__globals__
    found = {name: names[name] for name in kernel.__code__.co_names if name in names}
    inside = {
        f"{name}.{part}": value
        for name, owner in found.items()
        if isinstance(owner, type)
        for part, value in vars(owner).items()
    }
    return {name: repr(value) for name, value in {**found, **inside}.items() if isinstance(value, kinds)}


def kernel_of(law: ContactLaw) -> Callable[..., None]:
    """Return a law's own kernel.

    Raises
    ------
    PluginError
        If it has none, and its `bind` returned no rows either.
    """
    kernel = getattr(type(law), "multipliers", None)
    if kernel is None:
        raise PluginError(
            f"contact law {law.name}: bind returned no LinearLaw, and the class has no static method "
            "`multipliers(bound, trial, multiplier)`"
        )
    return kernel  # type: ignore[no-any-return]
