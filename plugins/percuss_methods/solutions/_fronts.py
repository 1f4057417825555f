"""The event loop of `bars-in-a-row`: waves as piecewise cubics at the ends of bars, exact but for round-off.

A uniform bar carries two simple waves, p to the right and q to the left: velocity p + q, compressive force Z (p - q).
What leaves an end arrives at the other one a transit T later, changed only by gravity, g T / 2. So the state of a row
is what has left each end of each bar: a history of pieces ``c0 + c1 s + c2 s^2 + c3 s^3``, s since the piece began.
A junction (a free, fixed, driven or touching end, two bars that meet) turns arriving waves into leaving ones. It can
be worked out alone up to a transit beyond the clocks of its neighbours.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np

ABSENT, FREE, DRIVEN, WALL = 0, 1, 2, 3  # what a side of a junction is

# columns of `Row.side`: which history arrives and leaves, which load or velocity acts, what the side is, and the
# junction at the other end of its bar
ARRIVES, LEAVES, LOAD, KIND, NEIGHBOUR = 0, 1, 2, 3, 4
# columns of `Row.number`: transit, impedance and gravity of the side's bar
TRANSIT, IMPEDANCE, GRAVITY = 0, 1, 2
# rows of the scratch: arriving waves, loads, closing speed, force, leaving wave
WAVE, ACTING, CLOSING, FORCE, LEAVING, SPARE = 0, 2, 4, 5, 6, 7

DONE, FULL, STUCK = 0, 1, 2
INSTANT = 4.0  # quanta: a shorter time is none
MOST_AT_ONCE = 1000  # events of no length in a row at one junction


class Row(NamedTuple):
    """J junctions of two sides each; the first is where waves to the right arrive."""

    side: Any  # (J, 2, 5) integers
    number: Any  # (J, 2, 3)
    contact: Any  # (J,) 1 where it is one
    closed: Any  # (J,)
    gap: Any  # (J,)
    clock: Any  # (J,) time up to which it is worked out
    pointer: Any  # (J, 4) piece that arrives, and piece of the load, of either side


class Histories(NamedTuple):
    """H piecewise cubics, each with the times at which its pieces begin."""

    times: Any  # (H, capacity)
    pieces: Any  # (H, capacity, 4)
    count: Any  # (H,)


class Forces(NamedTuple):
    """What each junction did: pieces of the contact force, and whether it was closed."""

    times: Any  # (J, capacity)
    pieces: Any  # (J, capacity, 4)
    closed: Any  # (J, capacity)
    count: Any  # (J,)


class Limits(NamedTuple):
    """End, size of a velocity, size below which a closing speed is none, and round-off of the times."""

    end: float
    scale: float
    tolerance: float
    quantum: float


@numba.njit(cache=True, error_model="numpy")
def moved(c: Any, s: float, out: Any) -> None:
    """Set `out` to the cubic `c` seen from s later."""
    out[0] = c[0] + s * (c[1] + s * (c[2] + s * c[3]))
    out[1] = c[1] + s * (2.0 * c[2] + s * 3.0 * c[3])
    out[2] = c[2] + s * 3.0 * c[3]
    out[3] = c[3]


@numba.njit(cache=True, error_model="numpy")
def value(c: Any, s: float) -> float:
    """Return the cubic at s."""
    return c[0] + s * (c[1] + s * (c[2] + s * c[3]))


@numba.njit(cache=True, error_model="numpy")
def area(c: Any, s: float) -> float:
    """Return the integral of the cubic from 0 to s."""
    return s * (c[0] + s * (c[1] / 2.0 + s * (c[2] / 3.0 + s * c[3] / 4.0)))


@numba.njit(cache=True, error_model="numpy")
def turns(c: Any, span: float, out: Any) -> int:
    """Write the ends of the stretches of (0, span] on which the cubic is monotone; return how many."""
    n = 0
    a, b, d = 3.0 * c[3], 2.0 * c[2], c[1]
    if a == 0.0:
        if b != 0.0:
            r = -d / b
            if 0.0 < r < span:
                out[n] = r
                n += 1
    else:
        disc = b * b - 4.0 * a * d
        if disc > 0.0:
            w = -0.5 * (b + (np.sqrt(disc) if b >= 0.0 else -np.sqrt(disc)))
            r1 = w / a
            r2 = d / w if w != 0.0 else r1
            lo, hi = min(r1, r2), max(r1, r2)
            if 0.0 < lo < span:
                out[n] = lo
                n += 1
            if lo < hi and 0.0 < hi < span:
                out[n] = hi
                n += 1
    out[n] = span
    return n + 1


@numba.njit(cache=True, error_model="numpy")
def crossing(c: Any, lo: float, hi: float) -> float:
    """Return where the cubic, monotone and not negative at lo, becomes negative before hi."""
    if c[2] == 0.0 and c[3] == 0.0:
        return min(max(-c[0] / c[1], lo), hi)
    for _ in range(200):
        mid = 0.5 * (lo + hi)
        if mid <= lo or mid >= hi:
            break
        if value(c, mid) < 0.0:
            hi = mid
        else:
            lo = mid
    return hi


@numba.njit(cache=True, error_model="numpy")
def first_negative(c: Any, span: float, tolerance: float, work: Any) -> float:
    """Return the first place in (0, span) behind which the cubic is below zero, or inf."""
    n = turns(c, span, work)
    lo = 0.0
    for k in range(n):
        hi = work[k]
        if value(c, hi) < -tolerance:
            return crossing(c, lo, hi)
        lo = hi
    return np.inf


@numba.njit(cache=True, error_model="numpy")
def used_up(gap: float, speed: float, half: float) -> float:
    """Return the first time behind 0 at which ``gap - speed s - half s^2`` is zero, or inf."""
    if half == 0.0:
        return gap / speed if speed > 0.0 and gap > 0.0 else np.inf
    disc = speed * speed + 4.0 * half * gap
    if disc < 0.0:
        return np.inf
    root = np.sqrt(disc)
    if speed >= 0.0:
        # in this form nothing is lost; a gap of zero that opens has no root behind 0
        return 2.0 * gap / (speed + root) if gap > 0.0 else np.inf
    return (root - speed) / (2.0 * half) if half > 0.0 else np.inf


@numba.njit(cache=True, error_model="numpy")
def zeros(c: Any, span: float, work: Any, roots: Any) -> int:
    """Write the zeros of the cubic in (0, span), and span; return how many."""
    n = turns(c, span, work)
    count = 0
    lo = 0.0
    for k in range(n):
        hi = work[k]
        sign = value(c, lo) < 0.0
        if sign != (value(c, hi) < 0.0):
            a, b = lo, hi
            while True:
                mid = 0.5 * (a + b)
                if mid <= a or mid >= b:
                    break
                if (value(c, mid) < 0.0) == sign:
                    a = mid
                else:
                    b = mid
            roots[count] = b
            count += 1
        lo = hi
    roots[count] = span
    return count + 1


@numba.njit(cache=True, error_model="numpy")
def first_contact(gap: float, c: Any, span: float, tolerance: float, work: Any, roots: Any) -> float:
    """Return when a gap that shrinks at the speed `c` is used up, or inf; at `tolerance` on average it does not."""
    if c[2] == 0.0 and c[3] == 0.0:
        found = used_up(gap, c[0], 0.5 * c[1])
        return found if found < span else np.inf
    # between the zeros of the speed the gap is monotone
    count = zeros(c, span, work, roots)
    lo = 0.0
    for k in range(count):
        hi = roots[k]
        if gap - area(c, hi) < -tolerance * hi and value(c, 0.5 * (lo + hi)) > 0.0:
            while True:
                mid = 0.5 * (lo + hi)
                if mid <= lo or mid >= hi:
                    return hi
                if gap - area(c, mid) < 0.0:
                    hi = mid
                else:
                    lo = mid
        lo = hi
    return np.inf


@numba.njit(cache=True, error_model="numpy")
def leaning(c: Any, tolerance: float, span: float) -> int:
    """Return the sign that the cubic takes right behind 0: -1, 0 or 1."""
    reach = 1.0
    for k in range(4):
        term = c[k] * reach
        if term > tolerance:
            return 1
        if term < -tolerance:
            return -1
        reach *= span
    return 0


@numba.njit(cache=True, error_model="numpy")
def continues(waves: Any, h: int, t: float, c: Any, scale: float, span: float, work: Any) -> bool:
    """Return whether a history goes on at t as its last piece said it would."""
    last = waves.count[h] - 1
    moved(waves.pieces[h, last], t - waves.times[h, last], work)
    reach = 1.0
    for m in range(4):
        if abs(work[m] - c[m]) * reach > 1e-15 * scale:
            return False
        reach *= span
    return True


@numba.njit(cache=True, error_model="numpy")
def horizon(row: Row, j: int, end: float) -> tuple[float, float]:
    """Return up to when a junction can be worked out, and the shortest transit of its bars."""
    limit, span = end, np.inf
    for k in range(2):
        neighbour = row.side[j, k, NEIGHBOUR]
        if neighbour >= 0:
            limit = min(limit, row.clock[neighbour] + row.number[j, k, TRANSIT])
            span = min(span, row.number[j, k, TRANSIT])
    return limit, span


@numba.njit(cache=True, error_model="numpy")
def seen(history: Histories, h: int, i: int, t: float, near: float, late: float, out: Any) -> tuple[int, float]:
    """Set `out` to the piece of a history that arrives at t, `late` after it left; return its place and the next time.

    Pieces within `near` of t count as arrived: fronts that differ by round-off are settled as one event.
    """
    while i + 1 < history.count[h] and history.times[h, i + 1] + late <= t + near:
        i += 1
    moved(history.pieces[h, i], max(t - late - history.times[h, i], 0.0), out)
    following = history.times[h, i + 1] + late if i + 1 < history.count[h] else np.inf
    return i, following


@numba.njit(cache=True, error_model="numpy")
def arrivals(row: Row, waves: Histories, loads: Histories, j: int, near: float, c: Any) -> float:
    """Gather what arrives and acts at a junction now; return when something else does."""
    t = row.clock[j]
    following = np.inf
    for k in range(2):
        c[WAVE + k, :] = 0.0
        c[ACTING + k, :] = 0.0
        h = row.side[j, k, ARRIVES]
        if h >= 0:
            late = row.number[j, k, TRANSIT]
            row.pointer[j, k], next_ = seen(waves, h, row.pointer[j, k], t, near, late, c[WAVE + k])
            c[WAVE + k, 0] += 0.5 * row.number[j, k, GRAVITY] * late
            following = min(following, next_)
        h = row.side[j, k, LOAD]
        if h >= 0:
            row.pointer[j, 2 + k], next_ = seen(loads, h, row.pointer[j, 2 + k], t, near, 0.0, c[ACTING + k])
            following = min(following, next_)
    return following


@numba.njit(cache=True, error_model="numpy")
def closing(row: Row, j: int, c: Any) -> float:
    """Set how fast the gap closes where no contact force acts; return how much a unit force gives way."""
    give = 0.0
    c[CLOSING, :] = 0.0
    for k in range(2):
        sign = 1.0 if k == 0 else -1.0
        kind = row.side[j, k, KIND]
        if kind == FREE:
            impedance = row.number[j, k, IMPEDANCE]
            give += 1.0 / impedance
            for m in range(4):
                c[CLOSING, m] += sign * (2.0 * c[WAVE + k, m] + c[ACTING + k, m] / impedance)
        elif kind == DRIVEN:
            for m in range(4):
                c[CLOSING, m] += sign * c[ACTING + k, m]
    return give


@numba.njit(cache=True, error_model="numpy")
def settle(row: Row, j: int, reach: float, span: float, limits: Limits, c: Any, roots: Any) -> float:
    """Close or open a contact that must be now; return how long it will stay so, or inf if past `reach`.

    A closing speed within the tolerance of zero is zero: what follows decides, and where nothing does the contact
    stays as it is. So a grazing contact, gap and force both zero, does not chatter.
    """
    tolerance = limits.tolerance
    lean = leaning(c[CLOSING], tolerance, reach)
    if row.closed[j] == 1 and lean < 0 and c[CLOSING, 0] <= tolerance:
        row.closed[j] = 0
        row.gap[j] = 0.0
    elif row.closed[j] == 0 and row.gap[j] <= tolerance * span and lean > 0:
        row.closed[j] = 1
        row.gap[j] = 0.0
    speed = c[CLOSING, 0]
    for _ in range(2):
        closed = row.closed[j] == 1
        if abs(speed) <= tolerance:
            c[CLOSING, 0] = max(speed, 0.0) if closed else min(speed, 0.0)
        if closed:
            switch = first_negative(c[CLOSING], reach, tolerance, c[SPARE])
        else:
            switch = first_contact(row.gap[j], c[CLOSING], reach, tolerance, c[SPARE], roots)
        if switch > INSTANT * limits.quantum:
            return switch
        row.closed[j] = 1 - row.closed[j]  # it would not stay so for any time
        row.gap[j] = 0.0
    return np.inf


@numba.njit(cache=True, error_model="numpy")
def leave(row: Row, waves: Histories, j: int, near: float, span: float, scale: float, c: Any) -> None:
    """Send the leaving waves of a junction off."""
    t = row.clock[j]
    for k in range(2):
        h = row.side[j, k, LEAVES]
        if h < 0:
            continue
        sign = -1.0 if k == 0 else 1.0
        for m in range(4):
            if row.side[j, k, KIND] == FREE:
                push = c[ACTING + k, m] + sign * c[FORCE, m]
                c[LEAVING, m] = c[WAVE + k, m] + push / row.number[j, k, IMPEDANCE]
            else:
                c[LEAVING, m] = c[ACTING + k, m] - c[WAVE + k, m]
        if continues(waves, h, t, c[LEAVING], scale, span, c[SPARE]):
            continue
        if waves.count[h] > 1 and t <= waves.times[h, waves.count[h] - 1] + near:
            waves.count[h] -= 1  # the same instant, settled anew
        waves.times[h, waves.count[h]] = t
        waves.pieces[h, waves.count[h]] = c[LEAVING]
        waves.count[h] += 1


@numba.njit(cache=True, error_model="numpy")
def room(row: Row, waves: Histories, forces: Forces, j: int) -> bool:
    """Return whether the histories of a junction have room for another event."""
    for k in range(2):
        h = row.side[j, k, LEAVES]
        if h >= 0 and waves.count[h] >= waves.times.shape[1] - 1:
            return False
    return forces.count[j] < forces.times.shape[1] - 1


@numba.njit(cache=True, error_model="numpy")
def event(
    row: Row,
    waves: Histories,
    loads: Histories,
    forces: Forces,
    j: int,
    limit: float,
    span: float,
    limits: Limits,
    c: Any,
) -> float:
    """Work a junction off up to its next event, at most to `limit`; return how long that took."""
    t = row.clock[j]
    near = max(1e-12 * span, 2.0 * limits.quantum)
    next_ = min(arrivals(row, waves, loads, j, near, c), limit)
    give = closing(row, j, c)
    switch = np.inf
    if row.contact[j] == 1:
        switch = settle(row, j, next_ - t, span, limits, c, c[SPARE + 1])
        if switch < next_ - t:
            ticks = max(np.rint((t + switch) / limits.quantum), np.rint(t / limits.quantum) + 1.0)
            next_ = min(ticks * limits.quantum, next_)
        else:
            switch = np.inf
    for m in range(4):
        c[FORCE, m] = c[CLOSING, m] / give if row.contact[j] == 1 and row.closed[j] == 1 else 0.0
    f = forces.count[j]
    forces.times[j, f] = t
    forces.closed[j, f] = row.closed[j]
    forces.pieces[j, f] = c[FORCE]
    forces.count[j] += 1
    leave(row, waves, j, near, span, limits.scale, c)
    if row.contact[j] == 1:
        if row.closed[j] == 1 or switch < np.inf:
            row.gap[j] = 0.0
        else:
            row.gap[j] = max(row.gap[j] - area(c[CLOSING], next_ - t), 0.0)
    row.clock[j] = next_
    return next_ - t


@numba.njit(cache=True, error_model="numpy")
def march(row: Row, waves: Histories, loads: Histories, forces: Forces, limits: Limits) -> int:
    """Work the junctions off up to the end; return DONE, FULL where a history is full, STUCK where events pile up.

    All times are multiples of the quantum, a round-off of the end: so sums of transits are exact, and fronts that took
    the same transits in another order since a common closing arrive at the same instant and merge.
    """
    c = np.zeros((SPARE + 2, 4))
    while True:
        j = np.argmin(row.clock)
        if row.clock[j] >= limits.end:
            return DONE
        limit, span = horizon(row, j, limits.end)
        stuck = 0
        while row.clock[j] < limit:
            if not room(row, waves, forces, j):
                return FULL
            took = event(row, waves, loads, forces, j, limit, span, limits, c)
            stuck = stuck + 1 if took <= INSTANT * limits.quantum else 0
            if stuck > MOST_AT_ONCE:
                return STUCK
