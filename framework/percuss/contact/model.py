"""The model: the arrays of a checked case, and what follows from them alone."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contact.features import together
from percuss.contact.limits import stiffness_limits
from percuss.contact.points import LAW, NOTHING, PointArrays, Rows, law_records, rows_of
from percuss.contact.sliding import at_every_position, largest_response, limits_at_every_position, sliding
from percuss.mesh.loads import acts_at, latest
from percuss.methods.interfaces import LeapFrog, Stages

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.contact.bound_law import BoundLaw
    from percuss.contact.features import Feature, Question
    from percuss.mesh.bodies import Bodies
    from percuss.mesh.loads import SupportsAndLoads
    from percuss.methods.interfaces import Floats


@dataclass(frozen=True, eq=False, repr=False)
class Model:
    """The arrays that describe a checked case: nodes, masses, elements, contact points, supports, loads, time step.

    A model never changes. One with another step, other laws or fewer supports is a copy with some fields replaced.

    Attributes
    ----------
    bodies
        The bodies by name, in the order of the case, and all their nodes.
    contact_points
        The contact points, in the order of the case.
    loads
        Supports, drives and loads.
    dt, steps
        Time step and number of steps; Courant number 1 where the case gives no step.
    stages
        Stages of a multi-stage scheme; None for a leap-frog scheme.
    tables
        The states at which contact laws are evaluated, one table for each stage, or one for a leap-frog scheme.
    rows
        The rows of N and S while each set of supports and drives of the run acts, by the numbers of these.
    features
        The facts about the optional features that the model has.
    laws
        The bound laws, linear laws before laws with a kernel. The loop solves linear laws with the contact equation;
        the other laws fill their part of the multipliers last in this order, by kernels of their own.
    never_active
        Contact points whose law is not active at any time, in the model of a stretch of a run.
    run
        The model of the whole run, in the model of a stretch; else None.
    """

    case: Case
    bodies: Bodies
    contact_points: PointArrays
    loads: SupportsAndLoads
    dt: float
    steps: int
    stages: Stages | None
    tables: tuple[LeapFrog, ...]
    rows: Mapping[tuple[int, ...], Rows] = field(default_factory=dict)
    features: tuple[Feature, ...] = ()
    laws: tuple[BoundLaw, ...] = ()
    never_active: tuple[int, ...] = ()
    run: Model | None = None

    @property
    def whole(self) -> Model:
        """The model of the whole run, also for the model of a stretch."""
        return self.run or self

    @property
    def dim(self) -> int:
        """Number of space dimensions."""
        return self.case.dimension

    @property
    def courant(self) -> float:
        """Courant number of the element with the highest frequency omega, ``omega dt / 2``: c dt/h of a bar."""
        return 0.5 * self.dt * self.bodies.omega

    @cached_property
    def slowing(self) -> Floats:
        """By what the damping of its body raises the inertia of each node, 1 + alpha dt/2, (nodes,).

        It is 1 at nodes that supports and drives move, and at ends on which forces depend on the motion.
        """
        slowing = np.ones(self.bodies.n_nodes)
        for body in self.bodies.values():
            if body.spec.damping is not None:
                slowing[body.start : body.stop] += 0.5 * self.dt * body.spec.damping.mass
        slowing[[constraint.node for constraint in self.whole.loads.constraints]] = 1.0
        slowing[[force.node for force in self.facts.forces]] = 1.0
        return slowing

    @property
    def multistage(self) -> bool:
        """Whether the integrator is a multi-stage scheme; if not, it is a leap-frog scheme."""
        return self.stages is not None

    @cached_property
    def facts(self) -> Feature:
        """These facts together, as those of one feature; neutral where the model has none."""
        return together(self.features)

    def why(self, question: Question) -> str:
        """Return what the first feature that has an answer to a question says, in words; empty if none has."""
        return next(filter(None, (feature.why(question, self) for feature in self.features)), "")

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
        instants = [t for one in self.loads.constraints if one.load for t in (one.load.start, one.load.stop)]
        if laws:
            instants += [t for one in self.laws if one.during is not None for t in one.during.ravel().tolist()]
        finite = np.array([t for t in instants if math.isfinite(t)])
        # The change takes effect in the first step whose midpoint lies after the instant, as in `acts_at`.
        cuts = np.clip(np.floor(latest(finite) / self.dt + 0.5), 0, total).astype(int)
        return list(itertools.pairwise(sorted({0, total, *cuts.tolist()})))

    def active_constraints(self, midpoint: float) -> tuple[int, ...]:
        """Return the numbers of the supports and drives that act in the step around `midpoint`."""
        return tuple(k for k, constraint in enumerate(self.loads.constraints) if constraint.active(midpoint))

    def inactive_points(self, midpoint: float) -> tuple[int, ...]:
        """Return the contact points whose law is not active in the step around `midpoint`."""
        inactive = set(self.never_active)
        for bound_law in self.laws:
            during = bound_law.during
            if during is not None and not acts_at(midpoint, during[:, 0], during[:, 1]).any():
                inactive.update(bound_law.where)
        return tuple(sorted(inactive))

    def rows_at(self, midpoint: float) -> Rows:
        """Return the rows of N and S for the supports and drives that act in the step around `midpoint`."""
        return self.rows[self.active_constraints(midpoint)]

    def rows_of_step(self, midpoint: float) -> Rows:
        """Return the rows of N, and S by the inertia that forces meet in the step around `midpoint`."""
        if (self.slowing == 1.0).all():
            return self.rows_at(midpoint)
        constraints = [self.loads.constraints[k] for k in self.active_constraints(midpoint)]
        return rows_of(self.contact_points, self.bodies, constraints, self.dt, self.slowing)

    @cached_property
    def delassus(self) -> Any:
        """The Delassus operator S of the first step, sparse, (P, P)."""
        return self.rows_at(0.5 * self.dt).matrix()

    @cached_property
    def largest_delassus(self) -> tuple[Floats, Floats]:
        """The largest diagonal entry of S over the run, and the largest sum of absolute values of a row, (P,) each.

        The sums are those at every position where surfaces slide.
        """
        rows = self.rows.values()
        diagonal, sums = (np.max([getattr(one, name) for one in rows], axis=0) for name in ("delassus", "sums"))
        return diagonal, at_every_position(self.case, self.bodies, self.contact_points, sums)

    def largest_response(self, contact: str) -> float:
        """Return a bound of the largest eigenvalue of S W of a contact that slides, W the areas, at every position."""
        return largest_response(self.case, self.bodies, self.contact_points, contact)

    @cached_property
    def stiffness_limits(self) -> Callable[[float], Floats]:
        """The function that gives `ContactPoints.stiffness_limit` for a time step, (P,) [force/length]."""
        if sliding(self.case):
            _, sums = self.largest_delassus
            return partial(limits_at_every_position, self.bodies, self.contact_points, sums)
        return stiffness_limits(self.bodies, self.contact_points, self.rows.values())

    @cached_property
    def tied_points(self) -> tuple[int, ...]:
        """The contact points of masses that are tied in every step of the run or stretch, in ascending order."""
        tied = {p for bound_law in self.laws if bound_law.ties and bound_law.during is None for p in bound_law.where}
        return tuple(sorted(p for p in tied.difference(self.never_active) if not self.balanced[p]))

    def law_records(self, table: LeapFrog | None = None) -> tuple[list[int], Any]:
        """Return the order of the contact points in the loop, and their law records in that order, (P,) `LAW`."""
        table, delassus = table or self.tables[-1], self.rows_at(0.5 * self.dt).delassus
        order = [point for bound_law in self.laws for point in bound_law.where]
        parts = [self.records_of(bound_law, table, delassus[list(bound_law.where)]) for bound_law in self.laws]
        records = np.concatenate(parts) if parts else np.zeros(0, dtype=LAW)
        if self.stages is not None:
            records["stores"] = NOTHING
        return order, records

    def records_of(self, bound_law: BoundLaw, table: LeapFrog, delassus: Floats) -> Any:
        """Return the records of a law at its points, where S has the diagonal `delassus`, (P,) `LAW`."""
        records = law_records(bound_law, table, delassus)
        return self.facts.records(bound_law, records, delassus) if self.facts.records else records


def rows_over_the_run(model: Model) -> dict[tuple[int, ...], Rows]:
    """Return the rows of N and S while each set of supports and drives of a run acts, by the numbers of these."""
    rows: dict[tuple[int, ...], Rows] = {}
    for start, _ in model.segments(laws=False):
        active = model.active_constraints((start + 0.5) * model.dt)
        if active not in rows:
            constraints = [model.loads.constraints[k] for k in active]
            rows[active] = rows_of(model.contact_points, model.bodies, constraints, model.dt)
    return rows
