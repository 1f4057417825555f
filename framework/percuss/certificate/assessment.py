"""What all stability criteria share: the assessment of a step, and the search for the largest stable one."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

# Relative distance from the limit within which a step is marginal.
MARGINAL_DISTANCE = 1e-9
MOST_TRIALS = 200  # steps tried in the search for the critical one
SMALLEST_NUMBER = 2.2250738585072014e-308  # of those with all their digits
SMALLEST_RELATIVE_TOLERANCE = 2.0**-50  # the least that SciPy accepts
# Number of contacts that a reason names, so that it stays readable.
MOST_NAMED = 6

Answer = Literal["stable", "no growth found", "grows", "unknown"]


@dataclass(frozen=True)
class Assessment:
    """Assessment of one step by a stability criterion.

    Attributes
    ----------
    answer
        ``stable`` where nothing grows in any combination of closed contacts, which is certain; ``no growth found``
        where growth was looked for in vain and may be there; ``grows``; ``unknown`` where the criterion cannot tell.
    worst
        Contacts that suffice to make the step unstable while they are closed; empty where none are needed.
    theta
        theta of Wu's predictor-corrector in that combination, or the largest one found.
    doubt
        Why the answer is less than certain; empty where it is certain.
    stretch
        Number of the stretch of the run that is assessed.
    by
        What assessed it, where that is not the criterion itself.
    """

    answer: Answer
    worst: list[int] = field(default_factory=list)
    theta: float | None = None
    doubt: str = ""
    stretch: int = 0
    by: str = ""

    @property
    def conclusive(self) -> bool:
        """Whether the answer is certain."""
        return self.answer in {"stable", "grows"}

    @property
    def stable(self) -> bool:
        """Whether nothing grows as far as is known."""
        return self.answer in {"stable", "no growth found"}


def named(names: Sequence[str], points: Sequence[int]) -> list[str]:
    """Return the names of contacts at some contact points, each once."""
    return list(dict.fromkeys(names[p] for p in points))


def quoted(names: Sequence[str], points: Sequence[int]) -> str:
    """Return the names of contacts in quotes, of many contacts the first `MOST_NAMED` and the number of the others."""
    found = named(names, points)
    first = ", ".join(f"'{name}'" for name in found[:MOST_NAMED])
    more = len(found) - MOST_NAMED
    return f"{first} and {more} more" if more > 0 else first


def signed_distance(*shares: float) -> float:
    """Return the excess of a step from the shares of what would make it unstable: 0 where the largest share is 1."""
    largest = max(shares)
    return (largest - 1.0) / (largest + 1.0) if math.isfinite(largest) else 1.0


def largest_step_below(excess: Callable[[float], float], free: float, tolerance: float = 1e-11) -> float:
    """Return the largest stable step, `free` where contact does not lower it; `excess` is that of `largest_step`."""
    just_below = free * (1.0 - 0.1 * MARGINAL_DISTANCE)
    return free if excess(just_below) <= 0.0 else largest_step(excess, just_below, tolerance)


def largest_step(excess: Callable[[float], float], start: float, tolerance: float = 1e-11) -> float:
    """Return the largest step, within a relative `tolerance`, up to which steps are stable, searching from `start`.

    Parameters
    ----------
    excess
        A number at most 0 where a step is stable, and above 0 where it is not, between -1 and 1. Where it varies
        continuously with the step a few trials suffice; where it is only -1 or 1 each trial halves the bracket.
    start
        Step at which the search begins.
    tolerance
        Relative distance from the limit within which the returned step lies. It is stable itself.
    """
    from scipy.optimize import brentq

    trials: dict[float, float] = {}

    def tried(dt: float) -> float:
        if dt not in trials:
            value = excess(dt)
            # The search ends where a value is 0, although longer steps may be stable, too.
            trials[dt] = 1.0 if math.isnan(value) else value if value > 0.0 else min(value, -SMALLEST_NUMBER)
        return trials[dt]

    lo = hi = start
    while tried(lo) > 0.0:
        hi, lo = lo, 0.5 * lo
        if lo < 1e-12 * start:
            return 0.0
    while tried(hi) <= 0.0:
        lo, hi = hi, 2.0 * hi
        if hi > 1e3 * start:
            return math.inf
    distance = 0.25 * tolerance * lo
    tolerances = {"xtol": distance, "rtol": SMALLEST_RELATIVE_TOLERANCE}
    root, _ = brentq(tried, lo, hi, **tolerances, maxiter=MOST_TRIALS, full_output=True, disp=False)
    # The limit may have been approached from one side only.
    near = [root - 2.0 * distance, root + 2.0 * distance]
    while True:
        unstable = min(dt for dt, value in trials.items() if value > 0.0)
        stable = max(dt for dt, value in trials.items() if value <= 0.0 and dt < unstable)
        middle = 0.5 * (stable + unstable)
        if unstable - stable <= tolerance * unstable or middle in (stable, unstable):
            return stable
        inside = [dt for dt in near if stable < dt < unstable]
        tried(inside[0] if inside else middle)
