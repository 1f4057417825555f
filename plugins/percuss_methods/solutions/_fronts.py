"""The event loop of `bars-in-a-row`: waves as piecewise polynomials at the ends of bars, exact but for round-off.

A uniform bar carries two simple waves, p to the right and q to the left: velocity p + q, compressive force Z (p - q). A
wave that leaves one end arrives at the other end one transit time T later, changed only by gravity, g T / 2. The state
of a chain is therefore the history of the waves that left each end of each bar, in pieces ``c0 + c1 s + c2 s^2 + ...``
with s the time since the start of the piece, and with two coefficients where all loads are straight lines between their
kinks.
A junction (a free, fixed or driven end, an end at a wall, two bars that meet) turns arriving waves into leaving waves.
It can be computed independently of all others up to one transit time beyond the times reached by its neighbours.

These functions run as plain Python, and compiled where there are many events. Copies are loops, because an assignment
to a slice compiles the message of an error about shapes, which takes as long as a tenth of all the rest.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

ABSENT, FREE, DRIVEN, WALL = 0, 1, 2, 3  # kinds of a side of a junction; a fixed end is a driven one without load

# columns of `Junctions.side`: numbers of the arriving history, of the leaving history and of the load or velocity that
# acts, kind of the side, and number of the junction at the other end of its bar
ARRIVES, LEAVES, LOAD, KIND, NEIGHBOUR = 0, 1, 2, 3, 4
# columns of `Junctions.number`: transit time, impedance and gravity of the side's bar
TRANSIT, IMPEDANCE, GRAVITY = 0, 1, 2
# indices of the polynomials in the work array `c`: arriving waves and loads of both sides, closing speed, contact
# force, leaving wave, and a spare one
WAVE, ACTING, CLOSING, FORCE, LEAVING, SPARE = 0, 2, 4, 5, 6, 7

DONE, FULL, STUCK, PAUSED = 0, 1, 2, 3

INSTANT = 4.0  # number of quanta up to which a duration counts as zero
MOST_AT_ONCE = 1000  # largest number of consecutive events without duration at a junction


class Junctions(NamedTuple):
    """J junctions with two sides each; waves to the right arrive at the first side."""

    side: Any  # (J, 2, 5) integers
    number: Any  # (J, 2, 3)
    contact: Any  # (J,) 1 for a contact, 0 for any other end
    closed: Any  # (J,) 1 while a contact is closed, else 0
    gap: Any  # (J,)
    clock: Any  # (J,) time up to which the junction is computed
    pointer: Any  # (J, 4) number of the arriving piece, and of the piece of the load, of both sides
    size: Any  # (J, 2) size of the velocities at both sides, to which round-off is relative


class Histories(NamedTuple):
    """H piecewise polynomials, each with the times at which its pieces begin."""

    times: Any  # (H, capacity)
    pieces: Any  # (H, capacity, K)
    count: Any  # (H,) number of pieces


class Forces(NamedTuple):
    """Histories of the junctions: pieces of the contact force, and whether the contact was closed."""

    times: Any  # (J, capacity)
    pieces: Any  # (J, capacity, K)
    closed: Any  # (J, capacity)
    count: Any  # (J,) number of pieces


class Limits(NamedTuple):
    """End of the computation, relative tolerance of the closing speed, and quantum of the times.

    A closing speed counts as zero up to `tolerance` times the size of the velocities at the contact.
    """

    end: float
    tolerance: float
    quantum: float


def shifted(c: Any, s: float, out: Any) -> None:
    """Set `out` to the polynomial `c` with its origin shifted by s."""
    for m in range(c.shape[0]):
        out[m] = c[m]
    if s != 0.0:
        for low in range(c.shape[0] - 1):
            for m in range(c.shape[0] - 2, low - 1, -1):
                out[m] += s * out[m + 1]


def value(c: Any, s: float) -> float:
    """Return the value of the polynomial at s."""
    out = c[c.shape[0] - 1]
    for m in range(c.shape[0] - 2, -1, -1):
        out = out * s + c[m]
    return out


def derivative(c: Any, order: int, s: float) -> float:
    """Return the derivative of an order of the polynomial at s."""
    out = 0.0
    for m in range(c.shape[0] - 1, order - 1, -1):
        factor = 1.0
        for k in range(order):
            factor *= m - k
        out = out * s + factor * c[m]
    return out


def integral(c: Any, s: float) -> float:
    """Return the integral of the polynomial from 0 to s."""
    out = 0.0
    for m in range(c.shape[0] - 1, -1, -1):
        out = out * s + c[m] / (m + 1)
    return out * s


def variation(c: Any, span: float) -> float:
    """Return a bound of the deviation of the polynomial from its value at 0 within the span."""
    reach, out = 1.0, 0.0
    for m in range(1, c.shape[0]):
        reach *= span
        out += abs(c[m]) * reach
    return out


def is_line(c: Any) -> bool:
    """Return whether the polynomial is a straight line."""
    terms = 0
    for m in range(2, c.shape[0]):
        if c[m] != 0.0:
            terms += 1
    return terms == 0


def sign_intervals(c: Any, order: int, span: float, ends: Any, spare: Any) -> int:
    """Write the ends of the intervals of (0, span] in which a derivative of the polynomial keeps its sign.

    The derivatives are treated from the highest one down: between two zeros of the next higher derivative a derivative
    is monotone and has at most one zero, which is found by bisection. Return the number of intervals; order 0 is the
    polynomial itself. A literal as `order` would make numba compile this function once for each.
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
        for k in range(n):
            ends[k] = spare[k]
    return n


def crossing(c: Any, lo: float, hi: float) -> float:
    """Return the zero between lo and hi of a polynomial that is monotone there and not negative at lo."""
    if is_line(c):
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


def first_negative(c: Any, span: float, tolerance: float, ends: Any, spare: Any) -> float:
    """Return the first point of (0, span) after which the polynomial is negative, or inf."""
    if c[0] - variation(c, span) >= -tolerance:
        return np.inf
    n = sign_intervals(c, np.int64(1), span, ends, spare)
    lo = 0.0
    for k in range(n):
        hi = ends[k]
        if value(c, hi) < -tolerance:
            return crossing(c, lo, hi)
        lo = hi
    return np.inf


def closing_time(gap: float, speed: float, half: float) -> float:
    """Return the first time s > 0 at which ``gap - speed s - half s^2`` is zero, or inf."""
    if half == 0.0:
        return gap / speed if speed > 0.0 and gap > 0.0 else np.inf
    disc = speed * speed + 4.0 * half * gap
    if disc < 0.0:
        return np.inf
    root = np.sqrt(disc)
    if speed >= 0.0:
        # this form of the root has no cancellation; a gap of zero that opens has no root s > 0
        return 2.0 * gap / (speed + root) if gap > 0.0 else np.inf
    return (root - speed) / (2.0 * half) if half > 0.0 else np.inf


def first_contact(gap: float, c: Any, span: float, tolerance: float, ends: Any, spare: Any) -> float:
    """Return the first time at which a gap closes at the closing speed `c`, or inf.

    An average closing speed of at most `tolerance` does not close it.
    """
    if is_line(c):
        time = closing_time(gap, c[0], 0.5 * c[1])
        return time if time < span else np.inf
    if gap > (abs(c[0]) + variation(c, span)) * span:
        return np.inf
    # the gap is monotone between the zeros of the closing speed
    count = sign_intervals(c, np.int64(0), span, ends, spare)
    lo = 0.0
    for k in range(count):
        hi = ends[k]
        if gap - integral(c, hi) < -tolerance * hi and value(c, 0.5 * (lo + hi)) > 0.0:
            while True:
                mid = 0.5 * (lo + hi)
                if mid <= lo or mid >= hi:
                    return hi
                if gap - integral(c, mid) < 0.0:
                    hi = mid
                else:
                    lo = mid
        lo = hi
    return np.inf


def initial_sign(c: Any, tolerance: float, span: float) -> int:
    """Return the sign of the polynomial just after 0: -1, 1, or 0 if all its terms are within the tolerance."""
    reach = 1.0
    for k in range(c.shape[0]):
        term = c[k] * reach
        if term > tolerance:
            return 1
        if term < -tolerance:
            return -1
        reach *= span
    return 0


def continues(waves: Any, h: int, t: float, c: Any, scale: float, span: float, work: Any) -> bool:
    """Return whether the polynomial `c` that begins at t continues the last piece of a history up to round-off."""
    last = waves.count[h] - 1
    shifted(waves.pieces[h, last], t - waves.times[h, last], work)
    reach = 1.0
    for m in range(c.shape[0]):
        if abs(work[m] - c[m]) * reach > 1e-15 * scale:
            return False
        reach *= span
    return True


def measure_sizes(junctions: Junctions, j: int, c: Any) -> None:
    """Increase the sizes of the velocities at a junction to those that arrive there and those that it transmits.

    Round-off is relative to the velocities that take part. A contact transmits no more of the velocity of its other
    side than the impedances allow: bars 1e10 times stiffer than their neighbours move 1e10 times less, with a round-off
    that is as much smaller.
    """
    for k in range(2):
        neighbour = junctions.side[j, k, NEIGHBOUR]
        if neighbour >= 0:
            arrived = max(abs(c[WAVE + k, 0]), junctions.size[neighbour, 1 - k])
            junctions.size[j, k] = max(junctions.size[j, k], arrived)
    if junctions.contact[j] == 1:
        for k in range(2):
            if junctions.side[j, k, KIND] == FREE:
                share = 1.0
                if junctions.side[j, 1 - k, KIND] == FREE:
                    own, other = junctions.number[j, k, IMPEDANCE], junctions.number[j, 1 - k, IMPEDANCE]
                    share = min(1.0, 2.0 * other / (own + other))
                junctions.size[j, k] = max(junctions.size[j, k], share * junctions.size[j, 1 - k])


def horizon(junctions: Junctions, j: int, end: float) -> tuple[float, float]:
    """Return the time up to which a junction can be computed, and the shortest transit time of its bars."""
    limit, span = end, np.inf
    for k in range(2):
        neighbour = junctions.side[j, k, NEIGHBOUR]
        if neighbour >= 0:
            limit = min(limit, junctions.clock[neighbour] + junctions.number[j, k, TRANSIT])
            span = min(span, junctions.number[j, k, TRANSIT])
    return limit, span


def arriving_piece(
    history: Histories, h: int, i: int, t: float, near: float, late: float, out: Any
) -> tuple[int, float]:
    """Set `out` to the piece of a history that arrives at t with a delay `late`, and find the next arrival.

    Pieces that arrive within `near` after t count as arrived, so that fronts that differ by round-off form one event.
    Return the number of the piece and the time at which the next piece arrives.
    """
    while i + 1 < history.count[h] and history.times[h, i + 1] + late <= t + near:
        i += 1
    shifted(history.pieces[h, i], max(t - late - history.times[h, i], 0.0), out)
    following = history.times[h, i + 1] + late if i + 1 < history.count[h] else np.inf
    return i, following


def arrivals(junctions: Junctions, waves: Histories, loads: Histories, j: int, near: float, c: Any) -> float:
    """Collect the waves and loads that arrive at a junction now; return the time of the next arrival."""
    t = junctions.clock[j]
    following = np.inf
    for k in range(2):
        for m in range(c.shape[1]):
            c[WAVE + k, m] = 0.0
            c[ACTING + k, m] = 0.0
        h = junctions.side[j, k, ARRIVES]
        if h >= 0:
            late = junctions.number[j, k, TRANSIT]
            junctions.pointer[j, k], next_time = arriving_piece(
                waves, h, junctions.pointer[j, k], t, near, late, c[WAVE + k]
            )
            c[WAVE + k, 0] += 0.5 * junctions.number[j, k, GRAVITY] * late
            following = min(following, next_time)
        h = junctions.side[j, k, LOAD]
        if h >= 0:
            junctions.pointer[j, 2 + k], next_time = arriving_piece(
                loads, h, junctions.pointer[j, 2 + k], t, near, 0.0, c[ACTING + k]
            )
            following = min(following, next_time)
    return following


def closing_speed(junctions: Junctions, j: int, c: Any) -> float:
    """Set the closing speed of the gap without contact force; return the admittance, its decrease by a unit force."""
    admittance = 0.0
    for m in range(c.shape[1]):
        c[CLOSING, m] = 0.0
    for k in range(2):
        sign = 1.0 if k == 0 else -1.0
        kind = junctions.side[j, k, KIND]
        if kind == FREE:
            impedance = junctions.number[j, k, IMPEDANCE]
            admittance += 1.0 / impedance
            for m in range(c.shape[1]):
                c[CLOSING, m] += sign * (2.0 * c[WAVE + k, m] + c[ACTING + k, m] / impedance)
        elif kind == DRIVEN:
            for m in range(c.shape[1]):
                c[CLOSING, m] += sign * c[ACTING + k, m]
    return admittance


def switch_contact(
    junctions: Junctions, j: int, reach: float, span: float, limits: Limits, c: Any, roots: Any
) -> float:
    """Close or open a contact that must switch now; return the time for which it keeps its state, inf beyond `reach`.

    A closing speed within the tolerance of zero counts as zero: the higher terms decide, and if these are zero too the
    contact keeps its state. A grazing contact, with gap and force both zero, therefore does not chatter.
    """
    tolerance = limits.tolerance * max(junctions.size[j, 0], junctions.size[j, 1])
    sign = initial_sign(c[CLOSING], tolerance, reach)
    if junctions.closed[j] == 1 and sign < 0 and c[CLOSING, 0] <= tolerance:
        junctions.closed[j] = 0
        junctions.gap[j] = 0.0
    elif junctions.closed[j] == 0 and junctions.gap[j] <= tolerance * span and sign > 0:
        junctions.closed[j] = 1
        junctions.gap[j] = 0.0
    speed = c[CLOSING, 0]
    for _ in range(2):
        closed = junctions.closed[j] == 1
        if abs(speed) <= tolerance:
            c[CLOSING, 0] = max(speed, 0.0) if closed else min(speed, 0.0)
        if closed:
            switch = first_negative(c[CLOSING], reach, tolerance, roots[0], roots[1])
        else:
            switch = first_contact(junctions.gap[j], c[CLOSING], reach, tolerance, roots[0], roots[1])
        if switch > INSTANT * limits.quantum:
            return switch
        junctions.closed[j] = 1 - junctions.closed[j]  # the contact would keep its state for an instant only
        junctions.gap[j] = 0.0
    return np.inf


def send_waves(junctions: Junctions, waves: Histories, j: int, near: float, span: float, c: Any) -> None:
    """Append the leaving waves of a junction to their histories, unless they continue the last pieces."""
    t = junctions.clock[j]
    for k in range(2):
        h = junctions.side[j, k, LEAVES]
        if h < 0:
            continue
        sign = -1.0 if k == 0 else 1.0
        for m in range(c.shape[1]):
            if junctions.side[j, k, KIND] == FREE:
                push = c[ACTING + k, m] + sign * c[FORCE, m]
                c[LEAVING, m] = c[WAVE + k, m] + push / junctions.number[j, k, IMPEDANCE]
            else:
                c[LEAVING, m] = c[ACTING + k, m] - c[WAVE + k, m]
        if continues(waves, h, t, c[LEAVING], junctions.size[j, k], span, c[SPARE]):
            continue
        if waves.count[h] > 1 and t <= waves.times[h, waves.count[h] - 1] + near:
            waves.count[h] -= 1  # an event at the same instant replaces the last piece
        waves.times[h, waves.count[h]] = t
        for m in range(c.shape[1]):
            waves.pieces[h, waves.count[h], m] = c[LEAVING, m]
        waves.count[h] += 1


def has_room(junctions: Junctions, waves: Histories, forces: Forces, j: int) -> bool:
    """Return whether the histories of a junction have room for another event."""
    for k in range(2):
        h = junctions.side[j, k, LEAVES]
        if h >= 0 and waves.count[h] >= waves.times.shape[1] - 1:
            return False
    return forces.count[j] < forces.times.shape[1] - 1


def advance(
    junctions: Junctions,
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
    """Compute a junction up to its next event, at most to `limit`; return the duration covered."""
    t = junctions.clock[j]
    near = max(1e-12 * span, 2.0 * limits.quantum)
    next_time = min(arrivals(junctions, waves, loads, j, near, c), limit)
    measure_sizes(junctions, j, c)
    admittance = closing_speed(junctions, j, c)
    switch = np.inf
    if junctions.contact[j] == 1:
        switch = switch_contact(junctions, j, next_time - t, span, limits, c, roots)
        if switch < next_time - t:
            ticks = max(np.rint((t + switch) / limits.quantum), np.rint(t / limits.quantum) + 1.0)
            next_time = min(ticks * limits.quantum, next_time)
        else:
            switch = np.inf
    for m in range(c.shape[1]):
        c[FORCE, m] = c[CLOSING, m] / admittance if junctions.contact[j] == 1 and junctions.closed[j] == 1 else 0.0
    f = forces.count[j]
    for m in range(c.shape[1]):
        forces.pieces[j, f, m] = c[FORCE, m]
    forces.times[j, f] = t
    forces.closed[j, f] = junctions.closed[j]
    forces.count[j] += 1
    send_waves(junctions, waves, j, near, span, c)
    if junctions.contact[j] == 1:
        if junctions.closed[j] == 1 or switch < np.inf:
            junctions.gap[j] = 0.0
        else:
            junctions.gap[j] = max(junctions.gap[j] - integral(c[CLOSING], next_time - t), 0.0)
    junctions.clock[j] = next_time
    return next_time - t


def knockout(clock: Any) -> Any:
    """Return the tree of a knockout among the junctions, in which the one that is computed the least far goes on.

    Place p of the tree holds the number of the winner of places 2p and 2p + 1, and place 1 that of the first of all.
    The last half holds the junctions in their order, and -1 where there is none; of two with equal times the one with
    the smaller number goes on.
    """
    leaves = 1
    while leaves < clock.size:
        leaves *= 2
    tree = np.full(2 * leaves, -1)
    for j in range(clock.size):
        tree[leaves + j] = j
    for place in range(leaves - 1, 0, -1):
        decide(tree, clock, place)
    return tree


def decide(tree: Any, clock: Any, place: int) -> None:
    """Set the winner at one place of a knockout from the two places below."""
    left, right = tree[2 * place], tree[2 * place + 1]
    tree[place] = right if right >= 0 and clock[right] < clock[left] else left


def spread_sizes(junctions: Junctions, c: Any) -> None:
    """Spread the sizes of the velocities before the first event over the whole row, there and back until none grows."""
    count = junctions.clock.size
    for _ in range(count):
        grown = 0
        for k in range(2 * count):
            j = k if k < count else 2 * count - 1 - k
            left, right = junctions.size[j, 0], junctions.size[j, 1]
            measure_sizes(junctions, j, c)
            if junctions.size[j, 0] != left or junctions.size[j, 1] != right:
                grown += 1
        if grown == 0:
            return


def march(
    junctions: Junctions, waves: Histories, loads: Histories, forces: Forces, limits: Limits, fresh: int, most: int
) -> int:
    """Compute all junctions up to the end; return DONE, FULL if a history is full, STUCK, or PAUSED to be called again.

    STUCK means that more than `MOST_AT_ONCE` consecutive events of a junction had no duration. PAUSED means that `most`
    events are computed, and changes nothing but the time at which they are; `fresh` is 0 when it goes on, else 1.

    All times are multiples of the quantum, the round-off of the end time. Sums of transit times are therefore exact,
    and fronts that took the same transits in another order since a common closing arrive at the same instant and merge.
    """
    c = np.zeros((SPARE + 1, waves.pieces.shape[2]))
    roots = np.zeros((2, c.shape[1] + 1))
    if fresh == 1:
        spread_sizes(junctions, c)
    first = knockout(junctions.clock)
    events = 0
    while True:
        j = first[1]
        if junctions.clock[j] >= limits.end:
            return DONE
        if events >= most:
            return PAUSED
        limit, span = horizon(junctions, j, limits.end)
        stuck = 0
        while junctions.clock[j] < limit:
            if not has_room(junctions, waves, forces, j):
                return FULL
            duration = advance(junctions, waves, loads, forces, j, limit, span, limits, c, roots)
            events += 1
            stuck = stuck + 1 if duration <= INSTANT * limits.quantum else 0
            if stuck > MOST_AT_ONCE:
                return STUCK
        place = (first.size // 2 + j) // 2
        while place > 0:
            decide(first, junctions.clock, place)
            place //= 2
