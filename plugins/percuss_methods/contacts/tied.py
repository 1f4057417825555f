"""A tied interface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from percuss import ContactLaw, ContactPoints, Doc, Trial, Unit

if TYPE_CHECKING:
    from percuss import Floats


class Intervals(NamedTuple):
    """When the interface is tied."""

    start: Floats  # (intervals,)
    stop: Floats  # (intervals,)


@dataclass(frozen=True)
class Tied(ContactLaw):
    """An interface that moves as one node: a continuous bar, as long as it is tied.

    Formula: ``lambda = -g'* / (dt s)``, g'* the gap rate after the bulk update; the rate vanishes at n + 1/2, and the
    force pulls as well as it pushes. Tied while the exact contact is closed, it is the twin whose error is that of the
    bulk alone. Keeps the critical step of the free bodies where all its nodes move freely. While tied the energy is
    conserved; the first step of an interval changes it by ``-g'* g'_{n-1/2} / (2 s)``, which may be more than nothing.
    """

    name = "tied"
    summary = "Interface tied at given times: the error of the bulk without that of the contact"
    references = ("Belytschko, Liu, Moran, Elkhodary: Nonlinear Finite Elements, Wiley 2014, ch. 10",)
    examples = ({}, {"during": ((0.0, 0.1), (0.2, 0.3))})
    expected_failures = {
        "exact-impact": "bars that are tied do not part: it is the twin of a contact, and no contact",
        "no-contact": "it ties two ends wherever they are",
    }

    during: Annotated[tuple[tuple[float, float], ...], Unit("time"), Doc("intervals (start, stop)")] | None = None

    def bind(self, points: ContactPoints, dt: float) -> Intervals:  # noqa: ARG002
        """Return the intervals."""
        during = np.array(((-np.inf, np.inf),) if self.during is None else self.during, dtype=float).reshape(-1, 2)
        return Intervals(np.ascontiguousarray(during[:, 0]), np.ascontiguousarray(during[:, 1]))

    @staticmethod
    def multipliers(bound: Intervals, trial: Trial, multiplier: Floats) -> None:
        """Set the multipliers that stop the gap rate while tied, zero otherwise."""
        middle = trial.time + 0.5 * trial.dt
        tied = False
        for i in range(bound.start.size):
            if bound.start[i] < middle < bound.stop[i]:
                tied = True
        for p in range(multiplier.size):
            multiplier[p] = -trial.predicted_rate[p] / (trial.rate_answer * trial.delassus[p]) if tied else 0.0
