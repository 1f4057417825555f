"""The stepper of leap-frog schemes: displacement at t_n, velocity at t_n - dt/2."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.march.starting_state import starting_velocity
from percuss.mesh.loads import amplitude
from percuss.step.loop import LoadAmplitudes

if TYPE_CHECKING:
    from percuss.march.model import Model
    from percuss.methods.interfaces import Floats
    from percuss.step.build import Kernels
    from percuss.step.loop import Loop, Record


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
    keeps_constraints = False

    def __init__(self, model: Model) -> None:
        self.model = model
        self.v: Floats = np.zeros(model.n_nodes * model.dim)
        self.u: Floats = np.zeros(model.n_nodes * model.dim)
        self.v[:] = starting_velocity(model).ravel()
        self.loop: Loop
        self._impulse = np.zeros(model.dim)

    def _zeros(self, count: int) -> LoadAmplitudes:
        columns = len(self.model.case.loads) + 1
        return LoadAmplitudes(
            np.zeros((count, columns)),
            np.zeros((count, columns)),
            np.zeros((count, len(self.model.bodies) * self.model.dim)),
        )

    def changing_arrays(self) -> list[Any]:
        """Return displacement, velocity and the impulse of the loads."""
        return [self.u, self.v, self._impulse]

    def set_loop(self, loop: Loop) -> None:
        """Use the arrays of the next stretch of the run."""
        self.loop = loop

    def start(self, kernels: Kernels) -> None:
        """Do nothing, as a leap-frog scheme needs no acceleration before its first step."""

    def amplitudes(self, first: int, count: int) -> LoadAmplitudes:
        """Return forces at t_n, prescribed velocities at t_n + dt/2 and accelerations of bodies at t_n."""
        model, dim = self.model, self.model.dim
        loads = list(model.case.loads.values())
        t = np.asarray((first + np.arange(count)) * model.dt, dtype=np.float64)
        amplitudes = self._zeros(count)
        for column, spec in enumerate(loads, start=1):
            if spec.acts_as == "velocity":
                amplitudes.velocity[:, column] = amplitude(spec, t + 0.5 * model.dt, model.dt, average=False)
            else:
                amplitudes.force[:, column] = amplitude(spec, t, model.dt, average=True)
        for body_force in model.body_forces:
            column = loads.index(body_force.load) + 1
            factor = amplitudes.force[:, column]
            if model.own_steps and (own_step := model.own_steps[body_force.body]) > 1:
                # It acts together with the internal forces of the body, for as many steps.
                factor = own_step * amplitude(body_force.load, t, own_step * model.dt, average=True)
                factor[(first + np.arange(count)) % own_step > 0] = 0.0
            amplitudes.body_acceleration[:, body_force.body * dim : (body_force.body + 1) * dim] += (
                factor[:, None] * body_force.acceleration
            )
        return amplitudes

    def advance(self, kernels: Kernels, amplitudes: Any, record: Record, first: int, count: int) -> int:
        """Make `count` steps; return `count`, or the number of steps before the first one that failed a check."""
        done: int = kernels.loop.advance(self.loop, amplitudes, record, self.u, self.v, self.model.dt, first, count)
        return done

    def step_without_loads(self, kernels: Kernels, record: Record, state: Floats) -> Floats:
        """Return displacement and velocity after one step without loads given in time, (2, nodes * dim).

        Where bodies have steps of their own, these are as many steps as it takes until all of them act together.
        """
        self.u[:], self.v[:] = state
        self.advance(kernels, self._no_loads, record, self.model.period, self.model.period)
        return np.stack([self.u, self.v])

    @cached_property
    def _no_loads(self) -> LoadAmplitudes:
        amplitudes = self._zeros(self.model.period)
        amplitudes.force[:, [follower.column for follower in self.model.followers]] = 1.0
        return amplitudes

    def load_impulse(self, amplitudes: Any) -> Floats:
        """Return the impulse of the loads on all bodies up to and including the steps of `amplitudes`, (dim,)."""
        model = self.model
        if model.case.loads:
            total = np.zeros(model.dim)
            force_sums = amplitudes.force.sum(axis=0)
            for nodal_force in model.nodal_forces:
                total += force_sums[nodal_force.column] * nodal_force.force
            weights = np.array([body.mass.sum() for body in model.bodies.values()])
            total += weights @ amplitudes.body_acceleration.sum(axis=0).reshape(-1, model.dim)
            self._impulse += model.dt * total
        impulse = self._impulse.copy()
        for follower, record in zip(model.followers, self.loop.boundary.followers, strict=True):
            impulse += record.impulse * follower.direction
        return impulse
