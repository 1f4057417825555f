"""The event loop of `bars-in-a-row`: waves as piecewise polynomials at the ends of bars, exact but for round-off.

A uniform bar carries two simple waves, p to the right and q to the left: velocity p + q, compressive force Z (p - q).
What leaves an end arrives at the other one a transit T later, changed only by gravity, g T / 2. So the state of a row
is what has left each end of each bar: a history of pieces ``c0 + c1 s + c2 s^2 + ...``, s since the piece began, with
two coefficients where all loads are straight lines between their kinks.
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
    size: Any  # (J, 2) size of the velocities at either side, whose round-off they carry


class Histories(NamedTuple):
    """H piecewise polynomials, each with the times at which its pieces begin."""

    times: Any  # (H, capacity)
    pieces: Any  # (H, capacity, K)
    count: Any  # (H,)


class Forces(NamedTuple):
    """What each junction did: pieces of the contact force, and whether it was closed."""

    times: Any  # (J, capacity)
    pieces: Any  # (J, capacity, K)
    closed: Any  # (J, capacity)
    count: Any  # (J,)


class Limits(NamedTuple):
    """End, closing speed that is none over the size of the velocities at a contact, and round-off of the times."""

    end: float
    tolerance: float
    quantum: float


@numba.njit(cache=True, error_model="numpy")
def moved(c: Any, s: float, out: Any) -> None:
    """Set `out` to the polynomial `c` seen from s later."""
    out[:] = c
    if s != 0.0:
        for low in range(c.shape[0] - 1):
            for m in range(c.shape[0] - 2, low - 1, -1):
                out[m] += s * out[m + 1]


@numba.njit(cache=True, error_model="numpy")
def value(c: Any, s: float) -> float:
    """Return the polynomial at s."""
    out = c[c.shape[0] - 1]
    for m in range(c.shape[0] - 2, -1, -1):
        out = out * s + c[m]
    return out


@numba.njit(cache=True, error_model="numpy")
def derivative(c: Any, order: int, s: float) -> float:
    """Return a derivative of the polynomial at s."""
    out = 0.0
    for m in range(c.shape[0] - 1, order - 1, -1):
        factor = 1.0
        for k in range(order):
            factor *= m - k
        out = out * s + factor * c[m]
    return out


@numba.njit(cache=True, error_model="numpy")
def area(c: Any, s: float) -> float:
    """Return the integral of the polynomial from 0 to s."""
    out = 0.0
    for m in range(c.shape[0] - 1, -1, -1):
        out = out * s + c[m] / (m + 1)
    return out * s


@numba.njit(cache=True, error_model="numpy")
def variation(c: Any, span: float) -> float:
    """Return a bound of how far the polynomial departs from its first value within the span."""
    reach, out = 1.0, 0.0
    for m in range(1, c.shape[0]):
        reach *= span
        out += abs(c[m]) * reach
    return out


@numba.njit(cache=True, error_model="numpy")
def straight(c: Any) -> bool:
    """Return whether the polynomial is a line."""
    return not np.any(c[2:])


@numba.njit(cache=True, error_model="numpy")
def stretches(c: Any, order: int, span: float, ends: Any, spare: Any) -> int:
    """Write the ends of the stretches of (0, span] on which a derivative of the polynomial keeps its sign.

    From the highest derivative down: between two zeros of the next higher one a derivative is monotone, and has one
    zero at most, found by bisection. Return how many stretches there are; order 0 is the polynomial itself.
    """
    degree = c.shape[0] - 1
    while degree > 0 and c[degree] == 0.0:
        degree -= 1
    ends[0] = span
    n = 1
    for m in range(degree - 1, order - 1, -1):
        count, lo = 0, 0.0
        for k in range(n):
            hi = ends[k]
            negative = derivative(c, m, lo) < 0.0
            if negative != (derivative(c, m, hi) < 0.0):
                a, b = lo, hi
                for _ in range(200):
                    mid = 0.5 * (a + b)
                    if mid <= a or mid >= b:
                        break
                    if (derivative(c, m, mid) < 0.0) == negative:
                        a = mid
                    else:
                        b = mid
                if b < span:
                    spare[count] = b
                    count += 1
            lo = hi
        spare[count] = span
        n = count + 1
        ends[:n] = spare[:n]
    return n


@numba.njit(cache=True, error_model="numpy")
def crossing(c: Any, lo: float, hi: float) -> float:
    """Return where the polynomial, monotone and not negative at lo, becomes negative before hi."""
    if straight(c):
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
def first_negative(c: Any, span: float, tolerance: float, ends: Any, spare: Any) -> float:
    """Return the first place in (0, span) behind which the polynomial is below zero, or inf."""
    if c[0] - variation(c, span) >= -tolerance:
        return np.inf
    n = stretches(c, 1, span, ends, spare)
    lo = 0.0
    for k in range(n):
        hi = ends[k]
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
def first_contact(gap: float, c: Any, span: float, tolerance: float, ends: Any, spare: Any) -> float:
    """Return when a gap that shrinks at the speed `c` is used up, or inf; at `tolerance` on average it does not."""
    if straight(c):
        found = used_up(gap, c[0], 0.5 * c[1])
        return found if found < span else np.inf
    if gap > (abs(c[0]) + variation(c, span)) * span:
        return np.inf
    # between the zeros of the speed the gap is monotone
    count = stretches(c, 0, span, ends, spare)
    lo = 0.0
    for k in range(count):
        hi = ends[k]
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
    """Return the sign that the polynomial takes right behind 0: -1, 0 or 1."""
    reach = 1.0
    for k in range(c.shape[0]):
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
    for m in range(c.shape[0]):
        if abs(work[m] - c[m]) * reach > 1e-15 * scale:
            return False
        reach *= span
    return True


@numba.njit(cache=True, error_model="numpy")
def measure_sizes(row: Row, j: int, c: Any) -> None:
    """Let the sizes of the velocities at a junction grow with what arrives there, and with what comes through it.

    Round-off is that of the velocities which took part. Of those at the other side of a contact no more comes through
    than the impedances let pass: bars 1e10 times stiffer than their neighbours move 1e10 times less, and exactly so.
    """
    for k in range(2):
        neighbour = row.side[j, k, NEIGHBOUR]
        if neighbour >= 0:
            arrived = max(abs(c[WAVE + k, 0]), row.size[neighbour, 1 - k])
            row.size[j, k] = max(row.size[j, k], arrived)
    if row.contact[j] == 1:
        for k in range(2):
            if row.side[j, k, KIND] == FREE:
                share = 1.0
                if row.side[j, 1 - k, KIND] == FREE:
                    own, other = row.number[j, k, IMPEDANCE], row.number[j, 1 - k, IMPEDANCE]
                    share = min(1.0, 2.0 * other / (own + other))
                row.size[j, k] = max(row.size[j, k], share * row.size[j, 1 - k])


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
            for m in range(c.shape[1]):
                c[CLOSING, m] += sign * (2.0 * c[WAVE + k, m] + c[ACTING + k, m] / impedance)
        elif kind == DRIVEN:
            for m in range(c.shape[1]):
                c[CLOSING, m] += sign * c[ACTING + k, m]
    return give


@numba.njit(cache=True, error_model="numpy")
def settle(row: Row, j: int, reach: float, span: float, limits: Limits, c: Any, roots: Any) -> float:
    """Close or open a contact that must be now; return how long it will stay so, or inf if past `reach`.

    A closing speed within the tolerance of zero is zero: what follows decides, and where nothing does the contact
    stays as it is. So a grazing contact, gap and force both zero, does not chatter.
    """
    tolerance = limits.tolerance * max(row.size[j, 0], row.size[j, 1])
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
            switch = first_negative(c[CLOSING], reach, tolerance, roots[0], roots[1])
        else:
            switch = first_contact(row.gap[j], c[CLOSING], reach, tolerance, roots[0], roots[1])
        if switch > INSTANT * limits.quantum:
            return switch
        row.closed[j] = 1 - row.closed[j]  # it would not stay so for any time
        row.gap[j] = 0.0
    return np.inf


@numba.njit(cache=True, error_model="numpy")
def leave(row: Row, waves: Histories, j: int, near: float, span: float, c: Any) -> None:
    """Send the leaving waves of a junction off."""
    t = row.clock[j]
    for k in range(2):
        h = row.side[j, k, LEAVES]
        if h < 0:
            continue
        sign = -1.0 if k == 0 else 1.0
        for m in range(c.shape[1]):
            if row.side[j, k, KIND] == FREE:
                push = c[ACTING + k, m] + sign * c[FORCE, m]
                c[LEAVING, m] = c[WAVE + k, m] + push / row.number[j, k, IMPEDANCE]
            else:
                c[LEAVING, m] = c[ACTING + k, m] - c[WAVE + k, m]
        if continues(waves, h, t, c[LEAVING], row.size[j, k], span, c[SPARE]):
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
    roots: Any,
) -> float:
    """Work a junction off up to its next event, at most to `limit`; return how long that took."""
    t = row.clock[j]
    near = max(1e-12 * span, 2.0 * limits.quantum)
    next_ = min(arrivals(row, waves, loads, j, near, c), limit)
    measure_sizes(row, j, c)
    give = closing(row, j, c)
    switch = np.inf
    if row.contact[j] == 1:
        switch = settle(row, j, next_ - t, span, limits, c, roots)
        if switch < next_ - t:
            ticks = max(np.rint((t + switch) / limits.quantum), np.rint(t / limits.quantum) + 1.0)
            next_ = min(ticks * limits.quantum, next_)
        else:
            switch = np.inf
    for m in range(c.shape[1]):
        c[FORCE, m] = c[CLOSING, m] / give if row.contact[j] == 1 and row.closed[j] == 1 else 0.0
    f = forces.count[j]
    forces.times[j, f] = t
    forces.closed[j, f] = row.closed[j]
    forces.pieces[j, f] = c[FORCE]
    forces.count[j] += 1
    leave(row, waves, j, near, span, c)
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
    c = np.zeros((SPARE + 1, waves.pieces.shape[2]))
    roots = np.zeros((2, c.shape[1] + 1))
    for _ in range(row.clock.size):
        for j in range(row.clock.size):
            measure_sizes(row, j, c)
    while True:
        j = np.argmin(row.clock)
        if row.clock[j] >= limits.end:
            return DONE
        limit, span = horizon(row, j, limits.end)
        stuck = 0
        while row.clock[j] < limit:
            if not room(row, waves, forces, j):
                return FULL
            took = event(row, waves, loads, forces, j, limit, span, limits, c, roots)
            stuck = stuck + 1 if took <= INSTANT * limits.quantum else 0
            if stuck > MOST_AT_ONCE:
                return STUCK
