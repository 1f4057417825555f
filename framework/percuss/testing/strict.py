"""A minimal reference implementation of the time loop for chains of bars, with full matrices in plain NumPy.

It shares no code with the time loop of the solver and gives a method no more than the contract promises: all arrays are
read-only, objects have no other than the promised attributes, and the output of a kernel is filled with nan before the
call.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.contact.law_trials import multipliers_of, plain_kernel, trial_of
from percuss.jsonable import Data
from percuss.methods.interfaces import ContactPoints, ContactState, LeapFrog, LinearLaw, Stages
from percuss.methods.plugin_calls import read_only
from percuss.step.integrator_check import ends_of, plain_step, table_of_stage
from percuss.testing.subject import NotApplicable

if TYPE_CHECKING:
    from percuss.methods.interfaces import ContactLaw, Floats, Integrator

TOUCHING = 1e-9  # relative to the element length; a smaller initial gap counts as zero


@dataclass(frozen=True)
class Histories:
    """Histories of a run at t_n, n = 0 ... N, as (N + 1, contacts) and (N + 1, nodes) arrays."""

    contact_force: Floats
    gap: Floats
    displacement: Floats


class End(NamedTuple):
    """An end of a bar."""

    outer: int  # its node
    outward: float  # direction out of the bar
    position: float
    stiffness: float  # EA/h of the elements of the bar
    frequency: float  # their 2c/h
    length: float  # their h


class StrictSystem:
    """A chain of bars along x with contacts, stepped by an integrator and a contact law through the contract alone.

    Parameters
    ----------
    case
        Mapping of a case in one dimension: bars, each with elements of equal length, contacts between them and with
        walls, fixed ends, constant forces on ends. The method of the case is ignored.
    integrator, law
        Instances of the integrator and of the contact law.

    Attributes
    ----------
    dt, steps
        Time step and number of steps.
    points : ContactPoints
        Contact points as the law receives them.
    """

    def __init__(self, case: Data, integrator: Integrator, law: ContactLaw) -> None:
        self.integrator, self.law = integrator, law
        self._assemble(case)
        self._fastest = max(frequency for _, frequency in self._bodies)
        self.dt: float = case["time"].get("step") or case["time"]["courant"] * 2.0 / self._fastest
        self.steps: int = case["time"]["steps"]
        self._assemble_contacts(case)
        self._middle = 0.5 * self.dt  # middle of the current step, which decides whether a law acts in an interval
        self.scheme = integrator.bind(self.dt)
        self.bound = read_only(law.bind(self.points, self.dt))
        self._state_before = self._state_after = np.zeros((len(self.points.names), law.state))

    def _assemble(self, case: Data) -> None:
        """Set stiffness matrix, lumped mass, loads, initial velocity and held degrees of freedom of the bodies."""
        total = sum(body["bar"]["elements"] + 1 for body in case["bodies"].values())
        self.stiffness, self.mass = np.zeros((total, total)), np.zeros(total)
        self.force, self.velocity = np.zeros(total), np.zeros(total)
        self.held = np.zeros(total, dtype=bool)
        self._ends: dict[str, End] = {}
        self._bodies: list[tuple[slice, float]] = []  # nodes and 2c/h
        first = 0
        for name, body in case["bodies"].items():
            n, length, area, at = body["bar"]["elements"], body["bar"]["length"], body["area"], body["at"]
            young, density, h, last = body["material"]["young"], body["material"]["density"], length / n, first + n
            of_element = young * area / h, 2.0 * math.sqrt(young / density) / h, h
            for e in range(first, last):
                self.stiffness[e : e + 2, e : e + 2] += of_element[0] * np.array([[1.0, -1.0], [-1.0, 1.0]])
                self.mass[e : e + 2] += 0.5 * density * area * h
            self.velocity[first : last + 1] = body["velocity"]
            self._ends[f"{name}.left"] = End(first, -1.0, at, *of_element)
            self._ends[f"{name}.right"] = End(last, 1.0, at + length, *of_element)
            self._bodies.append((slice(first, last + 1), of_element[1]))
            for end in body.get("fixed", ()):
                self.held[self._ends[f"{name}.{end}"].outer] = True
            first = last + 1
        for load in case.get("loads", {}).values():
            self.force[self._ends[load["on"]].outer] += load["constant"]
        self.velocity[self.held] = 0.0
        self.response = np.where(self.held, 0.0, 1.0 / self.mass)

    def _assemble_contacts(self, case: Data) -> None:
        """Set N, initial gaps, Delassus operator and contact points."""
        contacts = case["contacts"]
        self.normal = np.zeros((self.mass.size, len(contacts)))
        self.initial_gap = np.zeros(len(contacts))
        sides = [
            [self._ends[end] for end in contact.get("between", [contact.get("body")])] for contact in contacts.values()
        ]
        for p, (contact, ends) in enumerate(zip(contacts.values(), sides, strict=True)):
            opposite = ends[1].position if len(ends) == 2 else contact["wall"]
            gap = ends[0].outward * (opposite - ends[0].position)
            self.initial_gap[p] = 0.0 if gap <= TOUCHING * min(end.length for end in ends) else gap
            for end in ends:
                self.normal[end.outer, p] = -end.outward
        self.delassus = self.normal.T @ (self.response[:, None] * self.normal)
        softer = [min(ends, key=lambda end: (end.stiffness, end.frequency)) for ends in sides]
        alike = [all(np.allclose(end[3:5], ends[0][3:5], rtol=1e-12) for end in ends) for ends in sides]
        self.points = ContactPoints(
            names=tuple(contacts),
            stiffness=locked([end.stiffness for end in softer]),
            frequency=locked([min(end.frequency for end in ends) for ends in sides]),
            mass=locked([2.0 * end.stiffness / end.frequency**2 for end in softer]),
            equal_sides=locked(alike, bool),
            delassus=locked(np.diag(self.delassus)),
            coupling=locked(np.abs(self.delassus).sum(axis=1) / np.diag(self.delassus)),
            weight=locked([1.0] * len(sides)),
            limits=self._limits,
        )

    def _limits(self) -> Floats:
        """Return `ContactPoints.stiffness_limit`, computed with dense inverses of the matrices of the bodies."""
        uses = np.count_nonzero(self.normal, axis=1)
        share = np.zeros(self.mass.size)
        for nodes, frequency in self._bodies:
            ends = [end for end in (0, -1) if uses[nodes][end]]
            if not ends:
                continue
            step = min(self.dt, 0.99 * 2.0 / frequency)
            whole = 4.0 / step**2 * np.diag(self.mass[nodes]) - self.stiffness[nodes, nodes]
            inner = np.linalg.inv(np.linalg.inv(whole)[np.ix_(ends, ends)])
            both = abs(inner[0, -1]) / math.sqrt(inner[0, 0] * inner[-1, -1]) if len(ends) == 2 else 0.0
            share[nodes][ends] = uses[nodes][ends] / (np.diag(inner) * (1.0 - both))
        share[self.held] = 0.0
        return np.asarray(1.0 / (np.abs(self.normal) > 0).T.dot(share))

    def march(self) -> Histories:
        """Return the histories of all steps and of one more step, whose force is the last one of the histories."""
        records = self._leap_frog(self.scheme) if isinstance(self.scheme, LeapFrog) else self._in_stages(self.scheme)
        return Histories(*(np.array(column) for column in zip(*records, strict=True)))

    def _leap_frog(self, table: LeapFrog) -> Iterator[tuple[Floats, Floats, Floats]]:
        """Yield contact forces, gaps and displacements of each step of a leap-frog scheme."""
        dt, u = self.dt, np.zeros(self.mass.size)
        v = self.velocity - 0.5 * dt * self.response * self.force
        for n in range(self.steps + 1):
            self._middle = (n + 0.5) * dt
            internal = self._actions(n, own=table.own_steps) * (self.stiffness @ (u + table.viscosity * dt * v))
            bulk = self.response * (self.force - internal)
            gap, rate, acceleration = self.initial_gap + self.normal.T @ u, self.normal.T @ v, self.normal.T @ bulk
            predicted_rate = rate + dt * acceleration
            seen = gap, gap + dt * predicted_rate, rate, predicted_rate
            multiplier = self.multipliers(table, seen, acceleration, n * dt)
            yield multiplier, gap, u
            self._state_before = self._state_after
            v = v + dt * (bulk + self.response * (self.normal @ multiplier))
            u = u + dt * v

    def _actions(self, step: int, *, own: bool) -> Floats:
        """Return the factor of the internal forces of each node in a step: 1, or m in every m-th, else 0."""
        factor = np.ones(self.mass.size)
        for nodes, frequency in self._bodies if own else ():
            every = math.floor(self._fastest / frequency * (1.0 + TOUCHING))
            factor[nodes] = every if step % every == 0 else 0.0
        return factor

    def _in_stages(self, stages: Stages) -> Iterator[tuple[Floats, Floats, Floats]]:
        """Yield contact forces, gaps and displacements of each step of a multi-stage scheme.

        The contact force of a step is its contact impulse over dt.
        """
        dt, size, points = self.dt, self.mass.size, len(self.points.names)
        ends = ends_of(stages, dt)
        if not stages.end and isinstance(self.bound, LinearLaw) and self.bound.at == "end":
            raise NotApplicable("the scheme declares no `end`")
        clock = [0.0]

        def accelerations(_: object, stage: int, u: Floats, v: Floats, a: Floats) -> None:
            bulk = self.response * (self.force - self.stiffness @ u[:size])
            gap, rate = self.initial_gap + self.normal.T @ u[:size], self.normal.T @ v[:size]
            acceleration, (r_v, r_a, s_a) = self.normal.T @ bulk, ends[stage]
            seen = gap, gap + r_v * rate + r_a * acceleration, rate, rate + s_a * acceleration
            time = clock[0] + stages.times[stage] * dt
            multiplier = self.multipliers(table_of_stage(r_v, r_a, s_a), seen, acceleration, time)
            a[:size] = bulk + self.response * (self.normal @ multiplier)
            # a scheme treats all entries of a state alike, so that the velocity of these entries becomes the impulse
            a[size:] = multiplier

        def internal(_: object, stage: int, u: Floats, f: Floats) -> None:  # noqa: ARG001  signature of the slot
            f[:size] = self.response * (self.stiffness @ u[:size])
            f[size:] = 0.0

        step = plain_step(self.integrator, accelerations, internal)
        u, v = np.zeros(size + points), np.append(self.velocity, np.zeros(points))
        kept = np.zeros((type(self.integrator).kept, u.size))
        last = ends[-1].copy()
        ends[-1] = stages.start or last
        for row in kept:
            accelerations(None, len(stages.times) - 1, u, v, row)
        ends[-1] = last
        for n in range(self.steps + 1):
            clock[0], u[size:], v[size:] = n * dt, 0.0, 0.0
            self._middle = (n + 0.5) * dt
            before = u[:size].copy()
            step(stages.numbers, None, u, v, kept, dt)
            self._state_before = self._state_after
            yield v[size:] / dt, self.initial_gap + self.normal.T @ before, before

    def multipliers(self, table: LeapFrog, seen: Sequence[Floats], acceleration: Floats, time: float) -> Floats:
        """Return the multipliers, (contacts,).

        Parameters
        ----------
        table
            States in which laws are evaluated.
        seen
            Gap, gap after the bulk update, gap rate, gap rate after the bulk update.
        acceleration, time
            Bulk acceleration of the gap, and time.
        """
        if isinstance(self.bound, LinearLaw):
            return self._by_linear_law(self.bound, table, seen, acceleration)
        r_gap, r_rate, _ = table.end.response
        trial = trial_of(self.points, self.dt, seen, self.law, self._state_before, strength=0.0)
        trial = trial._replace(time=time, gap_response=r_gap, rate_response=r_rate)
        if self.law.uses_coupling:  # all contacts obey this law, so that no other law acts at their ends
            off = self.delassus - np.diag(np.diag(self.delassus))
            row, column = np.nonzero(off)
            first = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=len(off)))])
            neighbours = {"first_neighbour": locked(first, int), "neighbour": locked(column, int)}
            trial = trial._replace(**neighbours, coupling=locked(off[row, column]))
        multiplier: Floats = multipliers_of(self.law, plain_kernel(self.law), self.bound, trial)
        self._state_after = trial.after
        return multiplier

    def _acts(self) -> bool:
        """Return whether a linear law acts in the present step."""
        if not isinstance(self.bound, LinearLaw) or self.bound.during is None:
            return True
        return any(start < self._middle < stop for start, stop in self.bound.during)

    def _by_linear_law(self, law: LinearLaw, table: LeapFrog, seen: Sequence[Floats], acceleration: Floats) -> Floats:
        """Return the multipliers, (contacts,), of a linear law."""
        count = len(self.points.names)
        state: ContactState = getattr(table, law.at)
        gap, rate = seen[state.gap == "predicted"], seen[2 + (state.rate == "predicted")]
        weights = [
            np.broadcast_to(np.asarray(weight, float), count) for weight in (law.gap, law.rate, law.acceleration)
        ]
        sigma = np.broadcast_to(np.asarray(law.sigma, dtype=float), count)
        response = sum(weight * unit for weight, unit in zip(weights, state.response, strict=True))
        right = -weights[0] * gap - weights[1] * rate
        if state.acceleration == "bulk":
            right = right - weights[2] * acceleration
        active = np.flatnonzero(((gap < 0.0) | (law.active == "all")) & self._acts())
        left = np.diag(sigma) + np.asarray(response)[:, None] * self.delassus
        out = np.zeros(count)
        out[active] = _solved(left[np.ix_(active, active)], right[active], free=law.sign == "free")
        return out


def _solved(left: Floats, right: Floats, *, free: bool) -> Floats:
    """Return the solution x of ``left x = right``, or of ``0 <= x, left x - right >= 0, x (left x - right) = 0``."""
    count = right.size
    if free and count:
        return np.asarray(np.linalg.solve(left, right), dtype=float)
    best, least = np.zeros(count), math.inf
    scale = float(np.abs(right).max(initial=0.0))
    for size in range(count + 1):
        for subset in itertools.combinations(range(count), size):
            x = np.zeros(count)
            closed = list(subset)
            x[closed] = np.linalg.lstsq(left[np.ix_(closed, closed)], right[closed], rcond=None)[0]
            residual = left @ x - right
            violation = max(-float(residual.min(initial=0.0)), -float((x * np.diag(left)).min(initial=0.0)))
            if violation < least - 1e-13 * scale:
                best, least = x, violation
    return best


def locked(values: object, kind: type = float) -> Any:
    """Return a read-only array of values."""
    array: Any = np.array(values, dtype=kind)
    array.flags.writeable = False
    return array
