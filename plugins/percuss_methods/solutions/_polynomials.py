"""Functions of time that are polynomials between given times: loads followed to round-off, waves, forces, works."""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import numpy as np

FIT = 1e-12  # error of a load's polynomials over its largest value
COEFFICIENTS = 8  # of a polynomial that follows a smooth load: about 15 of them follow a cycle of a sine to `FIT`
EPSILON = float(np.finfo(float).eps)
LINE = 16.0 * EPSILON  # values that are off a straight line by no more, over the largest of them, lie on it
SHORTEST = 1e-9  # over the time a load acts: where a piece as short as that does not follow, the load is not smooth
INSTANT = 1e-12  # over the time looked at: what lasts no longer is a coincidence of fronts that missed by round-off
DENSE = 4096  # times at which a load is compared once more with what was made of it


class PiecewisePolynomial:
    """A function of time, given by coefficients of powers of the time since each piece began, and its integral.

    Parameters
    ----------
    times : (n,) array
        When the pieces begin, in ascending order.
    pieces : (n, k) array
        Their coefficients, the constant first.
    """

    def __init__(self, times: Any, pieces: Any) -> None:
        self.times, self.pieces = times, pieces
        self.sums = np.concatenate([[0.0], np.cumsum(integrated(pieces[:-1], np.diff(times)))])

    def _at(self, t: Any) -> tuple[Any, Any]:
        i = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, self.times.size - 1)
        return i, t - self.times[i]

    def __call__(self, t: Any) -> Any:
        """Return the value at t."""
        i, s = self._at(t)
        return evaluated(self.pieces[i], s)

    def integral(self, t: Any) -> Any:
        """Return the integral from the first time to t."""
        i, s = self._at(t)
        return self.sums[i] + integrated(self.pieces[i], s)

    def antiderivative(self) -> PiecewisePolynomial:
        """Return the integral from the first time on as such a function itself."""
        powers = np.arange(1, self.pieces.shape[1] + 1)
        return PiecewisePolynomial(self.times, np.column_stack([self.sums, self.pieces / powers]))

    def pieces_from(self, times: Any, late: float = 0.0) -> Any:
        """Return the coefficients (n, k) of this function, `late` after its time, in pieces that begin at `times`."""
        i, s = self._at(times - late)
        return moved(self.pieces[i], s)

    def supremum(self, start: float, stop: float) -> float:
        """Return the least upper bound of the values between two times; what lasts but an instant does not count.

        The largest value is that at an end of a piece, or where the polynomial has a slope of zero.
        """
        first = max(int(np.searchsorted(self.times, start, side="right")) - 1, 0)
        last = max(int(np.searchsorted(self.times, stop, side="left")), first + 1)
        times, pieces = self.times[first:last], self.pieces[first:last]
        begins = np.clip(times, start, stop) - times
        ends = np.clip(np.append(times[1:], stop), start, stop) - times
        if first == 0 and start < times[0]:
            begins[0] = start - times[0]  # the first piece holds before it began, too
        lasting = ends - begins > INSTANT * (stop - start)
        if not lasting.any():
            return float(self(np.asarray(start)))
        pieces, begins, ends = pieces[lasting], begins[lasting], ends[lasting]
        largest = float(max(evaluated(pieces, begins).max(), evaluated(pieces, ends).max()))
        if pieces.shape[1] <= 2:  # straight lines
            return largest
        pieces = moved(pieces, begins)
        spans = ends - begins
        room = (np.abs(pieces[:, 1:]) * spans[:, None] ** np.arange(1, pieces.shape[1])).sum(axis=1)
        bound = pieces[:, 0] + room
        for k in np.argsort(-bound):
            if bound[k] <= largest:
                break
            scaled = pieces[k] * spans[k] ** np.arange(pieces.shape[1])
            slope = scaled[1:] * np.arange(1, scaled.size)
            size = float(np.abs(slope).max())
            if size == 0.0:
                continue
            # what is round-off of the largest coefficient would have roots of its own, far away or anywhere
            degree = int(np.flatnonzero(np.abs(slope) > EPSILON * size)[-1])
            roots = np.roots(slope[degree::-1])
            inside = np.clip(roots.real[np.abs(roots.imag) < 1e-6], 0.0, 1.0)
            if inside.size:
                largest = max(largest, float(evaluated(scaled[None, :], inside).max()))
        return largest


def evaluated(c: Any, s: Any) -> Any:
    """Return polynomials (..., k) at s."""
    out = c[..., -1] + 0.0 * s
    for m in range(c.shape[-1] - 2, -1, -1):
        out = out * s + c[..., m]
    return out


def integrated(c: Any, s: Any) -> Any:
    """Return the integral of polynomials (..., k) from 0 to s."""
    out = c[..., -1] / c.shape[-1] + 0.0 * s
    for m in range(c.shape[-1] - 2, -1, -1):
        out = out * s + c[..., m] / (m + 1)
    return out * s


def moved(c: Any, s: Any) -> Any:
    """Return polynomials (n, k) as powers of the time since s."""
    out = np.array(c)
    count = out.shape[1]
    for low in range(count - 1):
        for m in range(count - 2, low - 1, -1):
            out[:, m] += s * out[:, m + 1]
    return out


def product(one: Any, other: Any) -> Any:
    """Return the products of polynomials (n, k) and (n, l)."""
    out = np.zeros((one.shape[0], one.shape[1] + other.shape[1] - 1))
    for m in range(one.shape[1]):
        out[:, m : m + other.shape[1]] += one[:, m : m + 1] * other
    return out


def widened(c: Any, count: int) -> Any:
    """Return polynomials with zeros up to `count` coefficients."""
    return np.pad(c, ((0, 0), (0, count - c.shape[1])))


def total(parts: list[tuple[Any, Any]]) -> tuple[Any, Any]:
    """Return the sum of functions given as (times, pieces)."""
    if len(parts) == 1:
        return parts[0]
    times = np.unique(np.concatenate([times for times, _ in parts]))
    count = max(pieces.shape[1] for _, pieces in parts)
    return times, sum(widened(PiecewisePolynomial(*part).pieces_from(times), count) for part in parts)


# ------------------------------------------------------------------------------------------------ loads


class LoadHistory(NamedTuple):
    """A load over absolute time, up to when it could be followed, and why not farther (empty where to the end)."""

    times: Any
    pieces: Any
    known: float
    reason: str


def load_history(factor: float, spec: Any, end: float, quantum: float, most: int) -> LoadHistory:
    """Return a load as polynomials that begin at multiples of `quantum`; it is zero outside its window.

    Parameters
    ----------
    factor
        By which its amplitude is multiplied.
    spec
        The load of the case.
    end, quantum
        Up to when it is wanted, and the unit of the times.
    most
        Pieces after which it is followed no farther.
    """
    start = spec.start if math.isfinite(spec.start) else 0.0
    first, last = max(start, 0.0), min(spec.stop, end)
    nothing = np.zeros(1), np.zeros((1, 2))
    if first >= last:
        return LoadHistory(*nothing, end, "")
    inner = sorted(start + k for k in spec.load.kinks() if first < start + k < last)
    edges = np.array([first, *inner, last]) - start
    begins, stops, pieces, known = followed(lambda clock: factor * spec.load.amplitude(clock), edges, most)
    # A time is off by half a quantum at most. The piece is stretched, so that its values at both ends stay: what is
    # continuous stays continuous, however steep it is.
    times = np.rint((begins + start) / quantum) * quantum
    spans = np.rint((stops + start) / quantum) * quantum - times
    some = spans > 0.0
    stretch = (stops - begins)[some] / spans[some]
    times, pieces = times[some], pieces[some] * stretch[:, None] ** np.arange(pieces.shape[1])
    if first > 0.0 or not times.size:
        times, pieces = np.append(0.0, times), np.vstack([np.zeros((1, pieces.shape[1])), pieces])
    if known < edges[-1]:
        reason = (
            f"takes more than {most} polynomial pieces (most_fronts)"
            if begins.size >= most
            else "is not smooth there, although its `kinks` do not say so"
        )
        return LoadHistory(times, pieces, start + known, f"load '{spec.name}' ({spec.load.name}) {reason}")
    if last < end or spec.stop <= end:
        times = np.append(times, np.rint(last / quantum) * quantum)
        pieces = np.vstack([pieces, np.zeros((1, pieces.shape[1]))])
    return LoadHistory(times, pieces, end, "")


# Inside: a jump at an end of the interval belongs to the neighbour. Irrational: no period of a load fits all of them.
NODES = 0.5 - 0.5 * np.cos(np.pi * (np.arange(COEFFICIENTS) + 0.5) / COEFFICIENTS)
CHECKS = np.arange(1, COEFFICIENTS + 2) * 0.5 * (np.sqrt(5.0) - 1.0) % 1.0
PLACES = np.concatenate([NODES, CHECKS])
# each node as far from those before it as can be: then Newton's differences lose no digits
FAR_APART = [0]
while len(FAR_APART) < COEFFICIENTS:
    distances = np.abs(NODES[:, None] - NODES[FAR_APART]).prod(axis=1)
    FAR_APART.append(int(distances.argmax()))


def followed(function: Any, edges: Any, most: int) -> tuple[Any, Any, Any, float]:
    """Follow a function that is smooth between `edges` by polynomials.

    Straight lines are found as such, with two coefficients, whatever their slope. Where it is curved, an interval is
    cut until polynomials of `COEFFICIENTS` follow to `FIT` of the largest value, or to what round-off of the time
    itself makes of the function there.

    Returns
    -------
    begins, stops, pieces
        Of the polynomials, in order.
    known
        The last edge, or up to when the function could be followed.
    """
    least = SHORTEST * (edges[-1] - edges[0])
    wide = np.diff(edges) > 64.0 * np.spacing(np.abs(edges[1:]))  # a shorter interval is a jump
    begins, stops = edges[:-1][wide], edges[1:][wide]
    made = [(begins[:0], stops[:0], np.zeros((0, COEFFICIENTS)))]
    size, known = 0.0, float(edges[-1])
    for looked in itertools.count():
        while begins.size:
            pieces, error, noise, largest = _interpolated(function, begins, stops)
            size = max(size, largest)
            good = error <= FIT * size + noise
            made.append((begins[good], stops[good], pieces[good]))
            rough = ~good & ~(stops - begins > least)
            known = min([known, *begins[rough]])
            bad = ~good & ~rough
            begins, stops = _cut(begins[bad], stops[bad], error[bad] / (FIT * size + noise[bad]))
            pending = begins < known
            begins, stops = begins[pending], stops[pending]
            known = min(known, _limit(made, begins, most, known))
            begins, stops = begins[begins < known], stops[begins < known]
        made = [_in_order(made, known)]
        if looked == 2 or not made[0][0].size:
            break
        # a feature so narrow that none of the places saw it
        missed = _missed(function, *made[0], size)
        if not missed.any():
            break
        begins, stops = _cut(made[0][0][missed], made[0][1][missed], np.full(int(missed.sum()), np.inf))
        made = [(made[0][0][~missed], made[0][1][~missed], made[0][2][~missed])]
    begins, stops, pieces = made[0]
    if not pieces[:, 2:].any():
        pieces = pieces[:, :2]
    return begins, stops, pieces, known


def _interpolated(function: Any, begins: Any, stops: Any) -> tuple[Any, Any, Any, float]:
    """Return polynomials through the nodes, their errors at the checks, the round-off, and the largest value."""
    spans = stops - begins
    at = begins[:, None] + PLACES * spans[:, None]
    s = at - begins[:, None]  # where the function really is asked: steep lines lose nothing
    values = np.asarray(function(at.ravel()), dtype=float).reshape(at.shape)
    size = np.abs(values).max(axis=1)
    order = np.argsort(PLACES)
    slopes = np.abs(np.diff(values[:, order]) / np.diff(s[:, order])).max(axis=1)
    noise = 4.0 * EPSILON * (np.abs(at).max(axis=1) * slopes + size)
    low, high = 0, COEFFICIENTS - 1
    slope = (values[:, high] - values[:, low]) / (s[:, high] - s[:, low])
    lines = np.stack([values[:, low] - slope * s[:, low], slope], axis=1)
    straight = np.abs(lines[:, :1] + lines[:, 1:] * s - values).max(axis=1) <= LINE * size
    pieces = widened(lines, COEFFICIENTS)
    error = np.zeros(begins.size)
    curved = ~straight
    if curved.any():
        u, v = s[curved] / spans[curved, None], values[curved]
        c = _newton(u[:, FAR_APART], v[:, FAR_APART])
        error[curved] = np.abs(evaluated(c[:, None, :], u[:, COEFFICIENTS:]) - v[:, COEFFICIENTS:]).max(axis=1)
        pieces[curved] = c / spans[curved, None] ** np.arange(COEFFICIENTS)
    return pieces, error, noise, float(size.max(initial=0.0, where=np.isfinite(size)))


def _newton(u: Any, v: Any) -> Any:
    """Return the coefficients (n, k) of the polynomials through k points each."""
    count = u.shape[1]
    d = np.array(v)
    for m in range(1, count):
        d[:, m:] = (d[:, m:] - d[:, m - 1 : -1]) / (u[:, m:] - u[:, : count - m])
    c = np.zeros_like(d)
    for m in range(count - 1, -1, -1):
        c[:, 1:] = c[:, :-1] - u[:, m : m + 1] * c[:, 1:]
        c[:, 0] = d[:, m] - u[:, m] * c[:, 0]
    return c


def _cut(begins: Any, stops: Any, excess: Any) -> tuple[Any, Any]:
    """Return the parts of intervals: as many as the error asks for, where it is so small that it tells."""
    if not begins.size:
        return begins, stops
    guess = np.nan_to_num(excess, nan=np.inf, posinf=np.inf) ** (1.0 / COEFFICIENTS)
    parts = np.clip(np.ceil(1.05 * guess), 2, 8).astype(int)
    at = np.repeat(np.arange(begins.size), parts)
    share = (np.arange(at.size) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[at]
    starts = begins[at] + share * (stops - begins)[at]
    ends = np.append(starts[1:], stops[-1])
    closing = np.cumsum(parts) - 1
    ends[closing] = stops
    return starts, ends


def _limit(made: list[tuple[Any, Any, Any]], begins: Any, most: int, known: float) -> float:
    """Return up to when `most` pieces reach."""
    every = np.concatenate([begins, *[part[0] for part in made]])
    if every.size <= most:
        return known
    return float(np.partition(every, most)[most])


def _in_order(made: list[tuple[Any, Any, Any]], known: float) -> tuple[Any, Any, Any]:
    begins, stops, pieces = (np.concatenate([part[k] for part in made]) for k in range(3))
    order = np.argsort(begins, kind="stable")
    order = order[begins[order] < known]
    return begins[order], stops[order], pieces[order]


def _missed(function: Any, begins: Any, stops: Any, pieces: Any, size: float) -> Any:
    """Return which polynomials are off the function at times spread over all of them."""
    at = begins[0] + (np.arange(DENSE) + 0.5 * (np.sqrt(5.0) - 1.0)) / DENSE * (stops[-1] - begins[0])
    i = np.clip(np.searchsorted(begins, at, side="right") - 1, 0, None)
    inside = at < stops[i]
    at, i = at[inside], i[inside]
    off = np.abs(evaluated(pieces[i], at - begins[i]) - np.asarray(function(at), dtype=float))
    slope = np.abs(pieces[i, 1:] * np.arange(1, pieces.shape[1]) * (stops - begins)[i, None] ** np.arange(
        pieces.shape[1] - 1)).sum(axis=1)  # fmt: skip
    missed = np.zeros(begins.size, dtype=bool)
    missed[i[off > 8.0 * (FIT * size + 4.0 * EPSILON * (np.abs(at) * slope + size))]] = True
    return missed
