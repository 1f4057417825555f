"""Mesh tying: an interface that is tied in given intervals of time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from percuss import ContactLaw, ContactPoints, Doc, LinearLaw, Unit


@dataclass(frozen=True)
class Tied(ContactLaw):
    """Mesh tying: both sides of the interface move as one node, so that the bars are continuous while they are tied.

    Formula: ``g'_{n+1/2} = 0``, which at ends in no other contact gives ``lambda = -g'* / (dt s)``, g'* the gap rate
    after the bulk update. The force pulls as well as it pushes. In a run that is tied while the exact contact is
    closed, the error is that of the bulk alone. Keeps the critical step of the free bodies; if it acts in every step,
    only the critical step of the joined bodies counts, which may be longer. While tied the energy is conserved; the
    first step of an interval changes it by ``-g'* g'_{n-1/2} / (2 s)``, which may be positive.
    """

    name = "tied"
    summary = "Interface tied at given times: the error of the bulk without that of the contact"
    references = ("Belytschko, Liu, Moran, Elkhodary: Nonlinear Finite Elements, Wiley 2014, ch. 10",)
    bond = True
    tied_during = "during"
    examples = ({}, {"during": ((0.0, 0.1), (0.2, 0.3))})
    expected_failures = {
        "exact-impact": "tied bars do not part: the law joins two ends and models no contact",
        "no-contact": "it ties two ends wherever they are",
    }

    during: Annotated[tuple[tuple[float, float], ...], Unit("time"), Doc("intervals (start, stop)")] | None = None

    def __post_init__(self) -> None:
        for start, stop in self.during or ():
            if not start <= stop:
                raise ValueError(f"the interval from {start:g} to {stop:g} ends before it starts")

    def bind(self, points: ContactPoints, dt: float) -> LinearLaw:  # noqa: ARG002
        """Return the linear law ``g' = 0`` at the end of the step, active in the intervals."""
        during = None if self.during is None else np.array(self.during, dtype=float).reshape(-1, 2)
        return LinearLaw(at="end", sigma=0.0, gap=0.0, rate=1.0, active="all", during=during)
