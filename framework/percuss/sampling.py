"""Points of a study: every combination of varied values, values that go together, points drawn from a box."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

__all__ = ["Sample", "combinations"]


@dataclass(frozen=True)
class Sample:
    """Points to be drawn from a box.

    Attributes
    ----------
    count, seed
        How many; the same seed draws the same points.
    method
        By independent numbers, or by one of the evenly filling sequences of `scipy.stats.qmc`.
    axes
        Lower end, upper end and whether logarithms are evenly spread, by path.
    """

    count: int
    method: Literal["random", "latin-hypercube", "sobol", "halton"]
    seed: int
    axes: Mapping[str, tuple[float, float, bool]]

    def points(self) -> list[dict[str, float]]:
        """Return the points, in the order drawn."""
        import numpy as np

        size = len(self.axes)
        if self.method == "random":
            unit = np.random.default_rng(self.seed).random((self.count, size))
        else:
            from scipy.stats import qmc

            kinds = {"latin-hypercube": qmc.LatinHypercube, "sobol": qmc.Sobol, "halton": qmc.Halton}
            with warnings.catch_warnings():
                # Sobol's sequence is even at powers of two only; any count is the user's to choose
                warnings.filterwarnings("ignore", message="The balance properties of Sobol", category=UserWarning)
                unit = kinds[self.method](size, rng=np.random.default_rng(self.seed)).random(self.count)
        return [
            {path: _at(float(share), *axis) for share, (path, axis) in zip(row, self.axes.items(), strict=True)}
            for row in unit
        ]


def _at(share: float, first: float, last: float, log: bool) -> float:
    if log:
        return math.exp(math.log(first) + share * (math.log(last) - math.log(first)))
    return first + share * (last - first)


def combinations(
    varied: Mapping[str, Sequence[Any]], paired: Sequence[Mapping[str, Any]] = (), sample: Sample | None = None
) -> list[dict[str, Any]]:
    """Return every combination of the varied values, with each of the paired points and each of those drawn."""
    grid = [dict(zip(varied, values, strict=True)) for values in itertools.product(*varied.values())]
    drawn: Sequence[Mapping[str, Any]] = sample.points() if sample is not None else [{}]
    return [{**one, **two, **three} for one in grid for two in (paired or [{}]) for three in drawn]
