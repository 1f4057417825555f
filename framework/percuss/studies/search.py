"""Search for the cheapest candidate that meets bounds: a branch and bound over lines of meshes.

A *line* is a pair of methods with its options and its step, on all meshes. What a candidate costs is known before it
runs: its number of steps times nodes times stages. How far it is from the bounds is known afterwards, as its *excess*,
the largest ratio of a number to its bound. On a line the excess is taken as a power of the mesh, a h^q, with q from the
runs of the line, or else the median of those of all lines. That predicts the coarsest mesh that meets the bounds, and
lines run in the order of what they are predicted to cost there.

A candidate runs only if it is cheaper than the best so far. A line that is predicted to cost more runs once, on the
finest of its meshes that are cheaper: if it misses the bounds there, it is settled. While nothing meets the bounds,
lines are refined, whatever is predicted. So a search ends when all lines are settled or the runs are spent, and it ends
without an answer only if nothing is left that could be one.

Beside the most promising line of each pair others are looked for, which differ in the step or in one option.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, zip_longest
from statistics import median
from typing import Protocol

from percuss.studies.candidates import Candidate

USUAL_ORDER = 1.0  # of the error of a force in L1, until two meshes of a line tell
ORDERS = (0.3, 3.0)
SMALLEST_EXCESS = 1e-9  # smaller ones are round-off, and say nothing of a coarser mesh
LARGEST_STRIDE = 4.0  # from a mesh that misses the bounds to the next
LAST = 99  # rank of lines that come after those beside another one
PARTS = 8  # a batch is this part of the runs that are left


class Bench(Protocol):
    """Where candidates are run."""

    @property
    def room(self) -> int:
        """Number of candidates that may still be run."""

    def cost(self, candidate: Candidate) -> float:
        """Return the cost of a candidate, infinite if it is known to miss the bounds; it rises with the refinement."""

    def fits(self, candidate: Candidate) -> bool:
        """Return whether a candidate can be run."""

    def ask(self, candidates: Sequence[Candidate]) -> Sequence[float]:
        """Run candidates and return the excess of each, infinite if it is not known; of fewer if no more are to be."""


@dataclass(eq=False)
class Line:
    """A pair with its options and its step on all meshes.

    Attributes
    ----------
    candidate
        The candidate on the mesh of the case.
    parent
        The line beside which it was found; until it has runs of its own, that one's are its prediction.
    rank
        How many lines were found there before it.
    runs
        Excess of its runs, by refinement.
    refused
        Whether it cannot be run.
    """

    candidate: Candidate
    parent: Line | None = None
    rank: int = 0
    runs: dict[float, float] = field(default_factory=dict)
    refused: bool = False

    def on(self, refine: float) -> Candidate:
        """Return its candidate on a mesh."""
        return replace(self.candidate, refine=refine)

    @property
    def far(self) -> bool:
        """Whether the line beside which it was found has other options."""
        own, others = self.candidate, (self.parent or self).candidate
        return own != replace(others, courant=own.courant)

    def known(self) -> list[float]:
        """Return the meshes of its runs with a finite excess, the nearest to the bounds first."""
        finite = (refine for refine, excess in self.runs.items() if excess < math.inf)
        return sorted(finite, key=lambda refine: abs(math.log(max(self.runs[refine], SMALLEST_EXCESS))))

    def order(self) -> float | None:
        """Return the order with which its excess falls beside the bounds, None until two meshes tell."""
        known = [refine for refine in self.known() if self.runs[refine] > SMALLEST_EXCESS][:2]
        if len(known) < 2:
            return None
        fallen = math.log(self.runs[known[0]] / self.runs[known[1]]) / math.log(known[1] / known[0])
        return min(max(fallen, ORDERS[0]), ORDERS[1])

    def meeting(self, usual: float) -> float:
        """Return the refinement at which it is predicted to meet the bounds, infinite if its runs do not tell.

        `usual` is the order that is taken until its own is known.
        """
        if not self.runs:
            return self.parent.meeting(usual) if self.parent is not None else 1.0
        for refine in self.known():
            exponent = math.log(max(self.runs[refine], SMALLEST_EXCESS)) / (self.order() or usual)
            return refine * math.exp(min(exponent, 100.0))
        return math.inf


class Search:
    """A search for the cheapest candidate.

    Parameters
    ----------
    first
        Candidates that run before all others.
    later
        Candidates that take part as well.
    meshes
        Refinements, rising.
    beside
        Function that returns the candidates beside one, the most promising first.
    bench
        Where candidates are run.
    """

    def __init__(
        self,
        first: Sequence[Candidate],
        later: Sequence[Candidate],
        meshes: Sequence[float],
        beside: Callable[[Candidate], Sequence[Candidate]],
        bench: Bench,
    ) -> None:
        self.meshes, self.beside, self.bench = meshes, beside, bench
        self.lines: dict[str, Line] = {}
        self.first = [self._line(one) for one in first]
        for one in later:
            self._line(one, rank=LAST)
        self.usual = USUAL_ORDER
        self.followed: set[Line] = set()  # those beside which lines take part

    def _line(self, candidate: Candidate, parent: Line | None = None, rank: int = 0) -> Line:
        """Return the line of a candidate, which takes part from now on."""
        start = replace(candidate, refine=1)
        return self.lines.setdefault(start.key, Line(start, parent, rank))

    def run(self) -> None:
        """Run candidates until all lines are settled or the runs are spent."""
        batch = [line.on(1) for line in self.first]
        while batch and self.bench.room > 0:
            for one, excess in zip(batch, self.bench.ask(batch), strict=False):
                self._line(one).runs[one.refine] = excess
            batch = self._batch()

    def best(self) -> tuple[float, Line | None]:
        """Return cost and line of the cheapest candidate that meets the bounds, of equal ones that with less excess."""
        met = [
            (self.bench.cost(line.on(refine)), excess, key)
            for key, line in self.lines.items()
            for refine, excess in line.runs.items()
            if excess <= 1.0
        ]
        cost, _, key = min(met, default=(math.inf, 0.0, ""))
        return cost, self.lines.get(key)

    def left(self, line: Line, cost: float) -> list[float]:
        """Return the meshes of a line that could meet the bounds at less than a cost.

        They are coarser than all that meet the bounds and finer than the finest that misses them, or than the second
        of these where one has met them: errors do not fall strictly. A line of which no run tells anything has none,
        but where nothing meets the bounds.
        """
        if line.refused or line.meeting(self.usual) == math.inf > cost:
            return []
        met = min((refine for refine, excess in line.runs.items() if excess <= 1.0), default=math.inf)
        missed = sorted((refine for refine in line.runs if refine < met), reverse=True)
        low = next(iter(missed[met < math.inf :]), 0.0)
        cheaper = bisect_left(self.meshes, cost, key=lambda refine: self.bench.cost(line.on(refine)))
        between = self.meshes[bisect_right(self.meshes, low) : min(bisect_left(self.meshes, met), cheaper)]
        return [refine for refine in between if refine not in line.runs]

    def _batch(self) -> list[Candidate]:
        """Return the candidates to run next, of one line each.

        They come in turn from two kinds of lines: those that are predicted to be cheaper than the best or differ in the
        step, and those with other options, first from the pair of which fewest have run. All others come last.
        """
        cost, _ = self.best()
        self.usual = median([order for line in self.lines.values() if (order := line.order())] or [USUAL_ORDER])
        ran = sorted((line for line in self.lines.values() if line.runs), key=self._predicted)
        self._follow({line.candidate.pair: line for line in reversed(ran)}.values())
        lines = sorted(self.lines.values(), key=lambda line: (self._predicted(line), line.rank))
        near = [line for line in lines if (self._predicted(line) < cost if line.runs else not line.far)]
        near.sort(key=lambda line: not line.runs and line.rank > 1)
        tries = Counter(line.candidate.pair for line in ran if line.far)
        far = [line for line in lines if line.far and not line.runs]
        far.sort(key=lambda line: (tries[line.candidate.pair], line.rank))
        turns = (near, far) if self.bench.room % 2 else (far, near)
        batch: list[Candidate] = []
        for line in dict.fromkeys((*filter(None, chain.from_iterable(zip_longest(*turns))), *ran)):
            left = self.left(line, cost)
            if left and self.bench.fits(one := line.on(self._next(line, left))):
                batch.append(one)
            elif left:
                line.refused = True
            if len(batch) >= max(1, self.bench.room // PARTS):
                break
        if not batch and cost == math.inf and self._follow(ran):  # not those of each pair alone
            return self._batch()
        return batch

    def _follow(self, leading: Iterable[Line]) -> bool:
        """Let the lines beside others take part; return whether one of those was not followed before."""
        new = [line for line in leading if line not in self.followed]
        self.followed.update(new)
        for line in new:
            for rank, one in enumerate(filter(self.bench.fits, self.beside(line.candidate)), 1):
                self._line(one, line, rank)
        return bool(new)

    def _predicted(self, line: Line) -> float:
        """Return what a line is predicted to cost where it meets the bounds."""
        refine = line.meeting(self.usual)
        mesh = self.meshes[min(bisect_left(self.meshes, refine), len(self.meshes) - 1)]
        return self.bench.cost(line.on(mesh)) * max(refine / mesh, 1.0) ** 2

    def _next(self, line: Line, left: Sequence[float]) -> float:
        """Return the mesh on which a line runs next: that on which it is predicted to meet, if it is left."""
        wanted = min(line.meeting(self.usual), LARGEST_STRIDE * max(line.runs, default=math.inf))
        return left[min(bisect_left(left, wanted * (1.0 - 1e-9)), len(left) - 1)]
