"""Piecewise polynomials of time, for waves, forces and work, and the approximation of loads by them."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss import progress

if TYPE_CHECKING:
    from percuss import ProblemLoad

FIT = 1e-12  # error of the polynomials that approximate a load, relative to its largest value
COEFFICIENTS = 8  # of each of these polynomials; about 15 of them approximate a cycle of a sine with an error of `FIT`
EPSILON = float(np.finfo(float).eps)
LINE = 16.0 * EPSILON  # largest deviation of values on a straight line, relative to the largest value
SHORTEST = 1e-9  # piece length, relative to the time a load acts, at which an inaccurate fit shows a load not smooth
INSTANT = 1e-12  # relative duration of a piece up to which it results from fronts that missed each other by round-off
BLOCK = 8192  # number of intervals that are approximated at once
PROBES = np.arange(1, 33) * 0.5 * (np.sqrt(5.0) - 1.0) % 1.0  # irrational places at which a load is probed
DENSE = 4096  # number of times at which a load is finally compared with its polynomials


class PiecewisePolynomial:
    """A piecewise polynomial of time, with coefficients of powers of the time since each piece began, and its integral.

    Parameters
    ----------
    times : (n,) array
        Times at which the pieces begin, in ascending order.
    pieces : (n, k) array
        Coefficients of the pieces, the constant first.
    """

    def __init__(self, times: Any, pieces: Any) -> None:
        self.times, self.pieces = times, pieces
        self.sums = np.concatenate([[0.0], np.cumsum(integrated(pieces[:-1], np.diff(times)))])

    def _locate(self, t: Any) -> tuple[Any, Any]:
        """Return the number of the piece at t and the time since it began."""
        i = np.maximum(np.searchsorted(self.times, t, side="right") - 1, 0)
        return i, t - self.times[i]

    def __call__(self, t: Any) -> Any:
        """Return the value at t."""
        i, s = self._locate(t)
        return evaluated(self.pieces[i], s)

    def integral(self, t: Any) -> Any:
        """Return the integral from the first time to t."""
        i, s = self._locate(t)
        return self.sums[i] + integrated(self.pieces[i], s)

    def antiderivative(self) -> PiecewisePolynomial:
        """Return the integral from the first time on as a piecewise polynomial."""
        powers = np.arange(1, self.pieces.shape[1] + 1)
        return PiecewisePolynomial(self.times, np.column_stack([self.sums, self.pieces / powers]))

    def pieces_from(self, times: Any, delay: float = 0.0) -> Any:
        """Return the coefficients (n, k) of this function, delayed by `delay`, in pieces that begin at `times`."""
        i, s = self._locate(times - delay)
        return shifted(self.pieces[i], s)

    def supremum(self, start: float, stop: float) -> float:
        """Return the least upper bound of the values between two times, without pieces that last only an instant.

        The largest value of a piece is at one of its ends or where its slope is zero.
        """
        first = max(int(np.searchsorted(self.times, start, side="right")) - 1, 0)
        last = max(int(np.searchsorted(self.times, stop, side="left")), first + 1)
        times, pieces = self.times[first:last], self.pieces[first:last]
        begins = np.clip(times, start, stop) - times
        ends = np.clip(np.append(times[1:], stop), start, stop) - times
        if first == 0 and start < times[0]:
            begins[0] = start - times[0]  # the first piece also holds before its begin
        lasting = ends - begins > INSTANT * (stop - start)
        if not lasting.any():
            return float(self(np.asarray(start)))
        pieces, begins, ends = pieces[lasting], begins[lasting], ends[lasting]
        largest = float(max(evaluated(pieces, begins).max(), evaluated(pieces, ends).max()))
        if pieces.shape[1] <= 2:  # a straight line is largest at an end
            return largest
        pieces = shifted(pieces, begins)
        spans = ends - begins
        variation = (np.abs(pieces[:, 1:]) * spans[:, None] ** np.arange(1, pieces.shape[1])).sum(axis=1)
        bound = pieces[:, 0] + variation
        for k in np.argsort(-bound):
            if bound[k] <= largest:
                break
            scaled = pieces[k] * spans[k] ** np.arange(pieces.shape[1])
            slope = scaled[1:] * np.arange(1, scaled.size)
            size = float(np.abs(slope).max())
            if size == 0.0:
                continue
            # leading coefficients that are round-off of the largest one would add roots at arbitrary places
            degree = int(np.flatnonzero(np.abs(slope) > EPSILON * size)[-1])
            roots = np.roots(slope[degree::-1])
            inside = np.clip(roots.real[np.abs(roots.imag) < 1e-6], 0.0, 1.0)
            if inside.size:
                largest = max(largest, float(evaluated(scaled[None, :], inside).max()))
        return largest


def evaluated(c: Any, s: Any) -> Any:
    """Return the values of polynomials (..., k) at s."""
    out = c[..., -1] + 0.0 * s
    for m in range(c.shape[-1] - 2, -1, -1):
        out = out * s + c[..., m]
    return out


def integrated(c: Any, s: Any) -> Any:
    """Return the integrals of polynomials (..., k) from 0 to s."""
    out = c[..., -1] / c.shape[-1] + 0.0 * s
    for m in range(c.shape[-1] - 2, -1, -1):
        out = out * s + c[..., m] / (m + 1)
    return out * s


def shifted(c: Any, s: Any) -> Any:
    """Return polynomials (n, k) with their origin shifted by s."""
    out = np.array(c)
    count = out.shape[1]
    for low in range(count - 1):
        for m in range(count - 2, low - 1, -1):
            out[:, m] += s * out[:, m + 1]
    return out


def product(first: Any, second: Any) -> Any:
    """Return the products of polynomials (n, k) and (n, l)."""
    out = np.zeros((first.shape[0], first.shape[1] + second.shape[1] - 1))
    for m in range(first.shape[1]):
        out[:, m : m + second.shape[1]] += first[:, m : m + 1] * second
    return out


def padded(c: Any, count: int) -> Any:
    """Return polynomials padded with zeros to `count` coefficients."""
    return np.pad(c, ((0, 0), (0, count - c.shape[1])))


def summed(parts: list[tuple[Any, Any]]) -> tuple[Any, Any]:
    """Return the sum of piecewise polynomials given as (times, pieces)."""
    if len(parts) == 1:
        return parts[0]
    times = np.unique(np.concatenate([times for times, _ in parts]))
    count = max(pieces.shape[1] for _, pieces in parts)
    return times, sum(padded(PiecewisePolynomial(*part).pieces_from(times), count) for part in parts)


# ------------------------------------------------------------------------------------------------ loads


class LoadHistory(NamedTuple):
    """A load as a piecewise polynomial of absolute time.

    Attributes
    ----------
    times : (n,) array
        Times at which the pieces begin.
    pieces : (n, k) array
        Coefficients of the pieces.
    reached
        Time up to which the load is approximated.
    reason
        Why the approximation ends early; empty where it reaches the end.
    """

    times: Any
    pieces: Any
    reached: float
    reason: str


def load_history(
    factor: float, spec: ProblemLoad, end: float, quantum: float, most_pieces: int, option: str, tell: Any
) -> LoadHistory:
    """Return a load as polynomials that begin at multiples of `quantum`, zero while it is switched off.

    Parameters
    ----------
    factor
        Factor of its amplitude.
    spec
        The load; it knows at which times it is not smooth.
    end, quantum
        Time up to which the load is needed, and unit of the times.
    most_pieces, option
        Number of pieces after which the approximation ends, and the option that bounds it.
    tell
        Called now and then with 0, the share of the waves that are computed by then.
    """
    edges, start = smooth_between(spec, end)
    nothing = np.zeros(1), np.zeros((1, 2))
    if edges.size < 2:
        return LoadHistory(*nothing, end, "")
    first, last = max(start, 0.0), min(spec.stop, end)
    begins, stops, pieces, reached = fitted(lambda time: factor * spec.load.amplitude(time), edges, most_pieces, tell)
    # Rounding changes a time by at most half a quantum. Each piece is stretched so that it keeps its values at both
    # ends and a continuous load stays continuous, however steep it is.
    times = np.rint((begins + start) / quantum) * quantum
    spans = np.rint((stops + start) / quantum) * quantum - times
    lasting = spans > 0.0
    stretch = (stops - begins)[lasting] / spans[lasting]
    times, pieces = times[lasting], pieces[lasting] * stretch[:, None] ** np.arange(pieces.shape[1])
    if first > 0.0 or not times.size:
        times, pieces = np.append(0.0, times), np.vstack([np.zeros((1, pieces.shape[1])), pieces])
    if reached < edges[-1]:
        reason = (
            f"takes more than {most_pieces} polynomial pieces ({option})"
            if begins.size >= most_pieces
            else "is not smooth there, although its `kinks` do not say so"
        )
        return LoadHistory(times, pieces, start + reached, f"load '{spec.name}' ({spec.load.name}) {reason}")
    if last < end or spec.stop <= end:
        times = np.append(times, np.rint(last / quantum) * quantum)
        pieces = np.vstack([pieces, np.zeros((1, pieces.shape[1]))])
    return LoadHistory(times, pieces, end, "")


def smooth_between(spec: ProblemLoad, end: float) -> tuple[Any, float]:
    """Return the times since a load began between which it is smooth, none if it does not act, and when it began."""
    start = spec.start if math.isfinite(spec.start) else 0.0
    first, last = max(start, 0.0), min(spec.stop, end)
    if first >= last:
        return np.zeros(0), start
    inner = sorted(start + k for k in spec.load.kinks() or () if first < start + k < last)
    return np.array([first, *inner, last]) - start, start


def pieces_needed(function: Any, edges: Any) -> float:
    """Return about how many polynomials a function takes, by their lengths at some times; inf if most find none.

    Parameters
    ----------
    function
        The function, smooth between `edges`.
    edges
        Times since the function began.
    """
    span = edges[-1] - edges[0]
    times = edges[0] + span * PROBES
    interval = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, edges.size - 2)
    lengths = np.diff(edges)[interval]
    count = np.full(times.size, np.inf)  # of pieces over the whole span, were all as short as here
    size, parts = 0.0, 1.0
    while np.isinf(count).any() and (lengths / parts).max() > SHORTEST * span:
        begins = np.clip(times - 0.5 * lengths / parts, edges[interval], edges[interval + 1] - lengths / parts)
        _, error, noise, largest = _interpolated(function, begins, begins + lengths / parts)
        size = max(size, largest)
        accurate = np.isinf(count) & (error <= FIT * size + noise)
        count[accurate] = 0.0 if parts == 1.0 else parts * span / lengths[accurate]
        parts *= 2.0
    rough = np.isinf(count)
    return np.inf if 2 * rough.sum() > rough.size else max(edges.size - 1.0, float(count[~rough].mean()))


# All points lie inside the interval, because a jump at its end belongs to the neighbour. The check points are
# irrational, so that no period of a load fits all of them.
NODES = 0.5 - 0.5 * np.cos(np.pi * (np.arange(COEFFICIENTS) + 0.5) / COEFFICIENTS)
CHECK_POINTS = np.arange(1, COEFFICIENTS + 2) * 0.5 * (np.sqrt(5.0) - 1.0) % 1.0
POINTS = np.concatenate([NODES, CHECK_POINTS])
# in this order each node is as far as possible from those before it, so that Newton's differences lose no digits
FAR_APART = [0]
while len(FAR_APART) < COEFFICIENTS:
    distances = np.abs(NODES[:, None] - NODES[FAR_APART]).prod(axis=1)
    FAR_APART.append(int(distances.argmax()))


def fitted(function: Any, edges: Any, most_pieces: int, tell: Any = progress) -> tuple[Any, Any, Any, float]:
    """Approximate a function that is smooth between `edges` by polynomials.

    Straight lines of any slope are recognised and get two coefficients. Where the function is curved, an interval is
    subdivided until polynomials with `COEFFICIENTS` coefficients have an error of at most `FIT` times the largest
    value, plus the effect of the round-off of time on the function.

    Returns
    -------
    begins, stops, pieces
        Start times, end times and coefficients of the polynomials, in order.
    reached
        Last edge, or the earlier time up to which the function could be approximated.
    """
    least = SHORTEST * (edges[-1] - edges[0])
    wide = np.diff(edges) > 64.0 * np.spacing(np.abs(edges[1:]))  # a shorter interval is a jump
    begins, stops = edges[:-1][wide], edges[1:][wide]
    parts = [(begins[:0], stops[:0], np.zeros((0, COEFFICIENTS)))]
    size, reached = 0.0, float(edges[-1])
    for attempt in itertools.count():
        while begins.size:
            blocks = []
            for k in range(0, begins.size, BLOCK):
                blocks.append(_interpolated(function, begins[k : k + BLOCK], stops[k : k + BLOCK]))
                tell(0.0)
            pieces, error, noise = (np.concatenate([block[k] for block in blocks]) for k in range(3))
            size = max([size, *(block[3] for block in blocks)])
            accurate = error <= FIT * size + noise
            parts.append((begins[accurate], stops[accurate], pieces[accurate]))
            rough = ~accurate & ~(stops - begins > least)
            reached = min([reached, *begins[rough]])
            coarse = ~accurate & ~rough
            begins, stops = _subdivided(begins[coarse], stops[coarse], error[coarse] / (FIT * size + noise[coarse]))
            pending = begins < reached
            begins, stops = begins[pending], stops[pending]
            reached = min(reached, _reach(parts, begins, most_pieces, reached))
            begins, stops = begins[begins < reached], stops[begins < reached]
        parts = [_in_order(parts, reached)]
        if attempt == 2 or not parts[0][0].size:
            break
        # a feature of the function may be so narrow that it lies between all points
        missed = _inaccurate(function, *parts[0], size)
        if not missed.any():
            break
        begins, stops = _subdivided(parts[0][0][missed], parts[0][1][missed], np.full(int(missed.sum()), np.inf))
        parts = [(parts[0][0][~missed], parts[0][1][~missed], parts[0][2][~missed])]
    begins, stops, pieces = parts[0]
    if not pieces[:, 2:].any():
        pieces = pieces[:, :2]
    return begins, stops, pieces, reached


def _interpolated(function: Any, begins: Any, stops: Any) -> tuple[Any, Any, Any, float]:
    """Return polynomials through the nodes, their errors at the check points, the round-off, and the largest value."""
    spans = stops - begins
    times = begins[:, None] + POINTS * spans[:, None]
    s = times - begins[:, None]  # from the rounded times, so that steep lines lose no accuracy
    values = np.asarray(function(times.ravel()), dtype=float).reshape(times.shape)
    size = np.abs(values).max(axis=1)
    order = np.argsort(POINTS)
    slopes = np.abs(np.diff(values[:, order]) / np.diff(s[:, order])).max(axis=1)
    noise = 4.0 * EPSILON * (np.abs(times).max(axis=1) * slopes + size)
    low, high = 0, COEFFICIENTS - 1
    slope = (values[:, high] - values[:, low]) / (s[:, high] - s[:, low])
    lines = np.stack([values[:, low] - slope * s[:, low], slope], axis=1)
    straight = np.abs(lines[:, :1] + lines[:, 1:] * s - values).max(axis=1) <= LINE * size
    pieces = padded(lines, COEFFICIENTS)
    error = np.zeros(begins.size)
    curved = ~straight
    if curved.any():
        u, v = s[curved] / spans[curved, None], values[curved]
        c = _newton(u[:, FAR_APART], v[:, FAR_APART])
        error[curved] = np.abs(evaluated(c[:, None, :], u[:, COEFFICIENTS:]) - v[:, COEFFICIENTS:]).max(axis=1)
        pieces[curved] = c / spans[curved, None] ** np.arange(COEFFICIENTS)
    return pieces, error, noise, float(size.max(initial=0.0, where=np.isfinite(size)))


def _newton(u: Any, v: Any) -> Any:
    """Return the coefficients (n, k) of n polynomials through k points each, by Newton's divided differences."""
    count = u.shape[1]
    d = np.array(v)
    for m in range(1, count):
        d[:, m:] = (d[:, m:] - d[:, m - 1 : -1]) / (u[:, m:] - u[:, : count - m])
    c = np.zeros_like(d)
    for m in range(count - 1, -1, -1):
        c[:, 1:] = c[:, :-1] - u[:, m : m + 1] * c[:, 1:]
        c[:, 0] = d[:, m] - u[:, m] * c[:, 0]
    return c


def _subdivided(begins: Any, stops: Any, excess: Any) -> tuple[Any, Any]:
    """Return the parts of intervals, 2 to 8 of each, as many as the excess of its error over the tolerance requires."""
    if not begins.size:
        return begins, stops
    guess = np.nan_to_num(excess, nan=np.inf, posinf=np.inf) ** (1.0 / COEFFICIENTS)
    parts = np.clip(np.ceil(1.05 * guess), 2, 8).astype(int)
    interval = np.repeat(np.arange(begins.size), parts)
    share = (np.arange(interval.size) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[interval]
    starts = begins[interval] + share * (stops - begins)[interval]
    ends = np.append(starts[1:], stops[-1])
    last_part = np.cumsum(parts) - 1
    ends[last_part] = stops
    return starts, ends


def _reach(parts: list[tuple[Any, Any, Any]], begins: Any, most_pieces: int, reached: float) -> float:
    """Return the time up to which `most_pieces` pieces suffice."""
    all_begins = np.concatenate([begins, *[part[0] for part in parts]])
    if all_begins.size <= most_pieces:
        return reached
    return float(np.partition(all_begins, most_pieces)[most_pieces])


def _in_order(parts: list[tuple[Any, Any, Any]], reached: float) -> tuple[Any, Any, Any]:
    """Return begins, stops and coefficients of all pieces that begin before `reached`, in order of time."""
    begins, stops, pieces = (np.concatenate([part[k] for part in parts]) for k in range(3))
    order = np.argsort(begins, kind="stable")
    order = order[begins[order] < reached]
    return begins[order], stops[order], pieces[order]


def _inaccurate(function: Any, begins: Any, stops: Any, pieces: Any, size: float) -> Any:
    """Return a mask of the polynomials that deviate from the function at `DENSE` times spread over all of them."""
    times = begins[0] + (np.arange(DENSE) + 0.5 * (np.sqrt(5.0) - 1.0)) / DENSE * (stops[-1] - begins[0])
    i = np.clip(np.searchsorted(begins, times, side="right") - 1, 0, None)
    inside = times < stops[i]
    times, i = times[inside], i[inside]
    deviation = np.abs(evaluated(pieces[i], times - begins[i]) - np.asarray(function(times), dtype=float))
    slope = np.abs(pieces[i, 1:] * np.arange(1, pieces.shape[1]) * (stops - begins)[i, None] ** np.arange(
        pieces.shape[1] - 1)).sum(axis=1)  # fmt: skip
    mask = np.zeros(begins.size, dtype=bool)
    mask[i[deviation > 8.0 * (FIT * size + 4.0 * EPSILON * (np.abs(times) * slope + size))]] = True
    return mask
