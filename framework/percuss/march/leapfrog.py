"""The stepper of leap-frog schemes: displacement at t_n, velocity at t_n - dt/2."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contact.walls import before_the_start, round_or_moving, velocities
from percuss.march.starting_state import starting_velocity
from percuss.mesh.loads import amplitude
from percuss.step import loop

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats
    from percuss.step.build import Kernels
    from percuss.step.part import Part
    from percuss.step.record import Record
    from percuss.step.records import Step


class LeapFrogStepper:
    """The stepper of a leap-frog scheme, an implementation of `percuss.march.stepper.Stepper`.

    Parameters
    ----------
    model
        The model to integrate in time.
    """

    energy_at = 0.5
    force_at = 0.0
    levels = 2

    def __init__(self, model: Model) -> None:
        self.model = model
        # Displacements and velocities, those of walls behind those of the nodes.
        nodal, walls = model.bodies.n_nodes * model.dim, round_or_moving(model.case).values()
        self._u: Floats = np.zeros(nodal + len(walls) * model.dim)
        self._v: Floats = np.zeros(self._u.size)
        self.u: Floats = self._u[:nodal]
        self.v: Floats = self._v[:nodal]
        self.v[:] = starting_velocity(model).ravel()
        self._of_walls = [load for _, load in walls if load is not None]
        self._v[nodal:] = np.ravel([before_the_start(load, model.dt, model.dim) for _, load in walls])
        self.columns = len(model.case.loads) + 1
        self._acting = [
            (load.column, model.bodies.with_moment(model.bodies.nodes[load.node], load.force))
            for load in model.loads.nodal_forces
            if not load.load.follows  # whose forces differ from step to step
        ]
        self._impulse = model.bodies.no_impulse()
        self.step: Step
        self.parts: Sequence[Part[Any]]

    def set_step(self, step: Step, parts: Sequence[Part[Any]], kernels: Kernels, midpoint: float) -> None:  # noqa: ARG002
        """Use the arrays and actions of the next stretch of the run."""
        self.step, self.parts, self._loop = step, parts, kernels.loop(loop.advance)

    def changing_arrays(self) -> list[Any]:
        """Return displacement, velocity and the impulse of the loads."""
        return [self._u, self._v, self._impulse]

    def start(self) -> None:
        """Do nothing, as a leap-frog scheme needs no acceleration before its first step."""

    def _zeros(self, count: int) -> Floats:
        return np.zeros((count, 2 * self.columns + len(self.model.bodies) * self.model.dim))

    def amplitudes(self, first: int, count: int) -> Floats:
        """Return forces at t_n, prescribed velocities at t_n + dt/2 and accelerations of bodies at t_n."""
        model, dim = self.model, self.model.dim
        loads = list(model.case.loads.values())
        t = np.asarray((first + np.arange(count)) * model.dt, dtype=np.float64)
        amplitudes = self._zeros(count)
        for column, spec in enumerate(loads, start=1):
            if spec.acts_as == "velocity":
                of_load = amplitude(spec, t + 0.5 * model.dt, model.dt, average=False)
                if spec in self._of_walls:  # which stand still while their load is off
                    of_load = velocities(spec, t + 0.5 * model.dt, model.dt)
                amplitudes[:, self.columns + column] = of_load
            else:
                amplitudes[:, column] = amplitude(spec, t, model.dt, average=True)
        for body_force in model.loads.body_forces:
            column = loads.index(body_force.load) + 1
            factor = amplitudes[:, column]
            if (leap := model.leaps[body_force.body]) > 1:
                # It acts together with the internal forces of the body, for as many steps.
                factor = leap * amplitude(body_force.load, t, leap * model.dt, average=True)
                factor[(first + np.arange(count)) % leap > 0] = 0.0
            start = 2 * self.columns + body_force.body * dim
            amplitudes[:, start : start + dim] += factor[:, None] * body_force.acceleration
        return amplitudes

    def advance(self, amplitudes: Floats, record: Record, first: int, count: int) -> int:
        """Make `count` steps; return `count`, or the number of steps before the first one that failed a check."""
        return self._loop(self.step, record, amplitudes, self._u, self._v, first, count)

    def step_without_loads(self, record: Record, state: Floats) -> Floats:
        """Return displacement and velocity after one step without loads given in time, (2, nodes * dim).

        Where bodies have steps of their own, these are as many steps as it takes until all of them act together.
        """
        self.u[:], self.v[:] = state
        self.advance(self._no_loads, record, self.model.period, self.model.period)
        return np.stack([self.u, self.v])

    @cached_property
    def _no_loads(self) -> Floats:
        amplitudes = self._zeros(self.model.period)
        amplitudes[:, [force.column for force in self.model.facts.forces]] = 1.0
        return amplitudes

    def load_impulse(self, amplitudes: Floats) -> Floats:
        """Return the impulse of the loads up to and including the steps of `amplitudes`, with its moment."""
        model = self.model
        if model.case.loads:
            total = np.zeros_like(self._impulse)
            # NumPy adds the terms of an array of its own in pairs, with less round-off.
            forces, accelerations = amplitudes[:, : self.columns].copy(), amplitudes[:, 2 * self.columns :].copy()
            sums = forces.sum(axis=0)
            for column, force in self._acting:
                total += sums[column] * force
            bodies, of_bodies = model.bodies.values(), accelerations.sum(axis=0).reshape(-1, model.dim)
            weights = np.array([body.mass.sum() for body in bodies])
            total[: model.dim] += weights @ of_bodies
            centres = np.array([body.centre for body in bodies])
            moments = model.bodies.with_moment(centres, weights[:, None] * of_bodies)[:, model.dim :]
            total[model.dim :] += moments.sum(axis=0)
            self._impulse += model.dt * total
        impulse = self._impulse.copy()
        for part in self.parts:
            if (own := part.impulse()) is not None:  # of ends of bars, whose moments are not asked
                impulse[: own.size] += own
        return impulse
