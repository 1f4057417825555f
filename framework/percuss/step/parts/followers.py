"""Loads that follow the motion of an end: their forces, from the kernels of their classes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.compiler.fingerprint import layout
from percuss.compiler.specialise import Specialiser
from percuss.methods.slots import follow

if TYPE_CHECKING:
    from percuss.mesh.loads import Follower

# The force of a load that follows the motion of a node along `axes` from index `axis` on.
FOLLOWER = np.dtype(
    [
        ("place", "i8"),
        ("axis", "i8"),
        ("inverse_mass", "f8"),
        ("column", "i8"),
        ("start", "f8"),  # time at which the load is switched on, from which it counts its own
        ("stop", "f8"),  # time at which it is switched off
        ("displacement", "f8"),  # of the node along the axis
        ("velocity", "f8"),  # of the node along the axis, as it is without this force
        ("response", "f8"),  # change of that velocity by a force of 1
        ("share", "f8"),  # fraction of the step in which the load is on
        ("force", "f8"),
        ("impulse", "f8"),  # sum over the steps of a leap-frog scheme
    ]
)
DOUBLINGS = 60
HALVINGS = 200
ROUND_OFF = 1e-15


def residual(numbers: Any, clock: float, follower: Any, force: float) -> float:
    """Return the force of the kernel at the velocity that `force` causes, minus `force`."""
    velocity = follower.velocity + follower.response * force
    wanted: float = follower.share * follow(numbers, clock, follower.displacement, velocity) - force
    return wanted


def force_of(numbers: Any, clock: float, follower: Any) -> float:
    """Return the force that is that of the kernel at the velocity that the force itself causes; nan if none is found.

    A force that does not grow with the velocity lies between zero and that of the velocity without it, so that
    bisection finds it. Where it jumps, as friction does at rest, the result is the force between both sides of the
    jump that keeps the velocity there.
    """
    low, at_low = 0.0, residual(numbers, clock, follower, 0.0)
    if follower.response == 0.0 or at_low == 0.0:
        return at_low
    scale = abs(at_low)
    high, at_high = at_low, residual(numbers, clock, follower, at_low)
    for _ in range(DOUBLINGS):
        if at_low * at_high <= 0.0:
            break
        low, at_low, high = high, at_high, 2.0 * high
        at_high = residual(numbers, clock, follower, high)
    if not at_low * at_high <= 0.0:
        return np.nan
    for k in range(HALVINGS):
        if abs(at_high) <= ROUND_OFF * (scale + abs(high)) or abs(high - low) <= ROUND_OFF * (abs(low) + abs(high)):
            return high
        # The secant is exact for a linear kernel; every third time the bracket is halved.
        force = 0.5 * (low + high) if k % 3 == 2 else high - at_high * (high - low) / (at_high - at_low)
        at_force = residual(numbers, clock, follower, force)
        if at_low * at_force > 0.0:
            low, at_low = high, at_high
        high, at_high = force, at_force
    return high


def remaining_loads(load: Any, followers: Any, time: float, i: int) -> None:
    """Set the forces of the loads that are left (slot); do nothing where there is none."""


def apply_load(load: Any, followers: Any, time: float, i: int) -> None:
    """Set the force of load `i`, then those of the loads after it."""
    follower = followers[i]
    clock = min(max(time, follower.start), follower.stop) - follower.start
    follower.force = force_of(load[0], clock, follower)
    remaining_loads(load[1], followers, time, i + 1)


def apply_loads(loads: Any, followers: Any, time: float) -> None:
    """Set the forces of all loads that follow the motion of an end, for the motion in their records."""
    remaining_loads(loads, followers, time, 0)


def nest(followers: Sequence[Follower]) -> Any:
    """Return the nested tuple (numbers, next load) from which the loop calls the kernels."""
    nested: Any = (0,)
    for follower in reversed(followers):
        nested = (follower.numbers, nested)
    return nested


def bind(maker: Specialiser, loads: Sequence[tuple[Any, str]], *, entry: bool = False) -> Callable[..., None]:
    """Return the function that calls the kernels of all loads in turn; with `entry`, Python can call it.

    Each load is given by its kernel and the layout of the numbers that this reads.
    """
    return maker.with_slots(maker.chain(apply_load, follow, remaining_loads, loads)).bind(apply_loads, entry=entry)


def compile_alone(follower: Follower) -> None:
    """Compile the kernel of a load by itself; raise the compiler's error if it cannot be compiled."""
    followers = np.recarray(1, dtype=FOLLOWER)
    followers[:] = np.zeros((), dtype=FOLLOWER)
    load = follower.kernel, layout(follower.numbers)
    bind(Specialiser(counting=True), [load], entry=True)(nest([follower]), followers, 0.0)
