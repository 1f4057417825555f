"""Functions of time in cubic pieces: loads fitted to round-off, waves evaluated and integrated."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

FIT = 1e-12  # error of a load's cubic pieces over its largest value
FINEST = 2**16  # most pieces between two kinks


class Cubics:
    """A piecewise-cubic function of time and its integral."""

    def __init__(self, times: Any, pieces: Any) -> None:
        self.times, self.pieces = times, pieces
        spans = np.diff(times)
        parts = _area(pieces[:-1], spans)
        self.sums = np.concatenate([[0.0], np.cumsum(parts)])

    def _at(self, t: Any) -> tuple[Any, Any]:
        i = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, self.times.size - 1)
        return i, t - self.times[i]

    def __call__(self, t: Any) -> Any:
        i, s = self._at(t)
        c = self.pieces[i]
        return c[..., 0] + s * (c[..., 1] + s * (c[..., 2] + s * c[..., 3]))

    def integral(self, t: Any) -> Any:
        """Return the integral from the first time to t."""
        i, s = self._at(t)
        return self.sums[i] + _area(self.pieces[i], s)


def _area(c: Any, s: Any) -> Any:
    """Return the integral of cubics from 0 to s."""
    return s * (c[..., 0] + s * (c[..., 1] / 2 + s * (c[..., 2] / 3 + s * c[..., 3] / 4)))


def load_pieces(factor: float, spec: Any, end: float) -> tuple[Any, Any, float]:
    """Return a load over absolute time as (times, (n, 4) cubics), zero outside its window, and up to when it holds."""
    start = spec.start if np.isfinite(spec.start) else 0.0
    first, last = max(start, 0.0), min(spec.stop, end)
    times, cubics = [0.0], [np.zeros(4)]
    if first >= last:
        return np.array(times), np.array(cubics), end
    inner = sorted(start + k for k in spec.load.kinks() if first < start + k < last)
    edges = [first, *inner, last]
    if first == 0.0:
        times, cubics = [], []
    for a, b in itertools.pairwise(edges):
        known = _fit(lambda t: factor * spec.load.amplitude(t - start), a, b, times, cubics, abs(factor))
        if known < b:
            return np.array(times), np.array(cubics), known
    if last < end or spec.stop <= end:
        times.append(last)
        cubics.append(np.zeros(4))
    return np.array(times), np.array(cubics), end


# inside: a jump at an end of the interval belongs to the neighbour; irrational: no period of a load fits all of them
NODES = 0.5 - 0.5 * np.cos(np.pi * (np.arange(4) + 0.5) / 4)
INVERSE = np.linalg.inv(np.vander(NODES, 4, increasing=True))
CHECKS = np.sort(np.arange(1, 9) * 0.5 * (np.sqrt(5.0) - 1.0) % 1.0)


def _fit(function: Any, a: float, b: float, times: list[float], cubics: list[Any], factor: float) -> float:
    """Append cubic pieces that follow a smooth function on (a, b) to `FIT` of its size.

    Return b, or up to when the function was followed where that takes more pieces than `FINEST`.
    """
    probe = np.linspace(a, b, 65)[1:-1]
    size = float(np.abs(function(probe)).max()) or factor
    least = a + 2.0**-20 * (b - a)
    n = 1
    while True:
        edges = np.linspace(a, b, n + 1)
        width = edges[1] - edges[0]
        inside = edges[:-1, None] + NODES * width
        values = function(inside.ravel()).reshape(n, 4)
        size = max(size, float(np.abs(values).max()))
        c = values @ INVERSE.T
        at = edges[:-1, None] + CHECKS * width
        error = np.abs(np.vander(CHECKS, 4, increasing=True) @ c.T - function(at.ravel()).reshape(n, -1).T).max()
        if error <= FIT * size or b <= least:
            break
        if n < FINEST:
            n *= 2
        else:
            b = 0.5 * (a + b)
    c[np.abs(c) < 1e-13 * size] = 0.0
    times.extend(edges[:-1])
    cubics.extend(c / width ** np.arange(4))
    return b


def sum_of_pieces(made: list[tuple[Any, Any]]) -> tuple[Any, Any]:
    """Add piecewise cubics."""
    if len(made) == 1:
        return made[0]
    times = np.unique(np.concatenate([t for t, _ in made]))
    total = np.zeros((times.size, 4))
    for t, c in made:
        i = np.clip(np.searchsorted(t, times, side="right") - 1, 0, None)
        total += _moved(c[i], times - t[i])
    return times, total


def _moved(c: Any, s: Any) -> Any:
    """Return cubics (n, 4) seen from s later."""
    return np.stack(
        [
            c[:, 0] + s * (c[:, 1] + s * (c[:, 2] + s * c[:, 3])),
            c[:, 1] + s * (2 * c[:, 2] + 3 * s * c[:, 3]),
            c[:, 2] + 3 * s * c[:, 3],
            c[:, 3],
        ],
        axis=1,
    )
