"""The arrays of a model, and what follows from them alone: all that its checks and its rows need."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contact.features import together
from percuss.contact.limits import stiffness_limits
from percuss.contact.rows import Rows, rows_of
from percuss.mesh.loads import latest
from percuss.methods.interfaces import LeapFrog, Stages

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.contact.bound_law import BoundLaw
    from percuss.contact.features import Feature, Question
    from percuss.contact.points import PointArrays
    from percuss.mesh.bodies import Bodies
    from percuss.mesh.loads import SupportsAndLoads
    from percuss.methods.interfaces import Floats


@dataclass(frozen=True, init=False, eq=False, repr=False)
class ModelArrays:
    """The arrays of a model, without how they are made.

    Attributes
    ----------
    dt, steps
        Time step and number of steps; Courant number 1 where the case gives no step.
    bodies
        The bodies by name, in the order of the case, and all their nodes.
    contact_points
        The contact points, in the order of the case.
    loads
        Supports, drives and loads.
    stages
        Stages of a multi-stage scheme; None for a leap-frog scheme.
    tables
        The states at which contact laws are evaluated, one table for each stage, or one for a leap-frog scheme.
    laws
        The bound laws, linear laws before laws with a kernel. The loop solves linear laws with the contact equation;
        the other laws fill their part of the multipliers last in this order, by kernels of their own.
    """

    case: Case
    dt: float
    steps: int
    bodies: Bodies
    contact_points: PointArrays
    loads: SupportsAndLoads
    stages: Stages | None
    tables: tuple[LeapFrog, ...]
    laws: tuple[BoundLaw, ...]

    @property
    def dim(self) -> int:
        """Number of space dimensions."""
        return self.case.dimension

    @property
    def multistage(self) -> bool:
        """Whether the integrator is a multi-stage scheme; if not, it is a leap-frog scheme."""
        return self.stages is not None

    @cached_property
    def features(self) -> tuple[Feature, ...]:
        """The facts about the optional features that the model has."""
        raise NotImplementedError

    @cached_property
    def facts(self) -> Feature:
        """These facts together, as those of one feature; neutral where the model has none."""
        return together(self.features)

    def why(self, question: Question) -> str:
        """Return what the first feature that has an answer to a question says, in words; empty if none has."""
        return next(filter(None, (feature.why(question) for feature in self.features)), "")

    def why_altered(self, *needed: str) -> str:
        """Return which feature alters something that another one needs, in words; empty if none does."""
        return next((f"{one.name} gives no {one.alters}" for one in self.features if one.alters in needed), "")

    @cached_property
    def balanced(self) -> Any:
        """Whether the force of each contact point follows from a static balance, (P,)."""
        return np.array([p in self.facts.balanced for p in range(len(self.contact_points))], dtype=bool)

    @property
    def leaps(self) -> tuple[int, ...]:
        """The number of steps from one action of the internal forces of each body to the next."""
        return self.facts.leaps or (1,) * len(self.bodies)

    @property
    def period(self) -> int:
        """The number of steps after which the internal forces of all bodies act in the same step again."""
        return math.lcm(*self.leaps)

    @property
    def sums_internal_work(self) -> bool:
        """Whether the energy ledger counts the work of the internal forces instead of the elastic energy.

        In linear bodies both are the same under a leap-frog scheme without viscosity whose internal forces act in every
        step. Of a multi-stage scheme the work has no such form.
        """
        return not self.multistage and bool(self.bodies.why_not_linear or self.facts.sums_internal_work)

    def segments(self, *, laws: bool = True) -> list[tuple[int, int]]:
        """Return intervals of steps (first, one past last) within which no support, drive or law starts or ends.

        The trial step after the last step is included. Without `laws`, the intervals of time in which laws are active
        do not split the run.
        """
        total = self.steps + 1
        instants = [
            instant
            for constraint in self.loads.constraints
            if constraint.load is not None
            for instant in (constraint.load.start, constraint.load.stop)
        ]
        if laws:
            instants += [
                instant
                for bound_law in self.laws
                if bound_law.during is not None
                for instant in bound_law.during.ravel()
            ]
        cuts = {0, total}
        for instant in instants:
            if math.isfinite(instant):
                # The change takes effect in the first step whose midpoint lies after the instant, as in `acts_at`.
                step = math.floor(latest(instant) / self.dt + 0.5)
                cuts.add(min(max(step, 0), total))
        edges = sorted(cuts)
        return list(itertools.pairwise(edges))

    @cached_property
    def _rows(self) -> dict[tuple[int, ...], Rows]:
        return {}

    def rows_at(self, midpoint: float) -> Rows:
        """Return the rows of N and S for the supports and drives active at a time, made once for each set of these."""
        active = tuple(k for k, constraint in enumerate(self.loads.constraints) if constraint.active(midpoint))
        if active not in self._rows:
            constraints = [self.loads.constraints[k] for k in active]
            self._rows[active] = rows_of(self.contact_points, self.bodies, constraints, self.dt)
        return self._rows[active]

    def rows_over_the_run(self) -> Iterator[Rows]:
        """Yield the rows of each stretch of the run in which other supports or drives act."""
        for start, _ in self.segments(laws=False):
            yield self.rows_at((start + 0.5) * self.dt)

    @cached_property
    def largest_delassus(self) -> tuple[Floats, Floats]:
        """The largest diagonal entry of S over the run, and the largest sum of absolute values of a row, (P,) each."""
        rows = list(self.rows_over_the_run())
        return np.max([one.delassus for one in rows], axis=0), np.max([one.sums for one in rows], axis=0)

    @cached_property
    def stiffness_limits(self) -> Callable[[float], Floats]:
        """The function that gives `ContactPoints.stiffness_limit` for a time step, (P,) [force/length]."""
        return stiffness_limits(self.bodies, self.contact_points, self.rows_over_the_run())
