"""The stepper of multi-stage schemes: displacement and velocity at t_n, loads at the times of the stages.

The arrays of its state are longer than those of the nodes; `percuss.step.stages` explains why.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.march.starting_state import initial_velocity
from percuss.mesh.loads import amplitude
from percuss.record_arrays import record_array
from percuss.step.build import Scheme
from percuss.step.integrator_check import ends_of, kernel_of, table_of_stage, uses_internal
from percuss.step.stages import BODY_FORCE, StageAmplitudes, State, System, advance, begin

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats, LeapFrog, Stages
    from percuss.step.build import Kernels
    from percuss.step.part import Part
    from percuss.step.record import Record
    from percuss.step.records import Step


class MultistageStepper:
    """The stepper of a multi-stage scheme, an implementation of `percuss.march.stepper.Stepper`.

    Parameters
    ----------
    model
        The model to integrate in time.
    stages
        The stages as the integrator of the model defines them.
    """

    energy_at = 1.0
    force_at = 0.5

    def __init__(self, model: Model, stages: Stages) -> None:
        self.model, self.stages = model, stages
        self.nodal = model.bodies.n_nodes * model.dim
        self.columns = len(model.case.loads) + 1
        size = self.nodal + len(model.contact_points) + len(model.loads.constraints) + self.columns
        kept = model.case.method.integrator.kept
        self.levels = 2 + kept
        self.state = State(np.zeros(size), np.zeros(size), np.zeros((kept, size)))
        self.u: Floats = self.state.u[: self.nodal]
        self.v: Floats = self.state.v[: self.nodal]
        self.v[:] = initial_velocity(model).ravel()
        self.amplitude_sums = np.zeros(self.columns)
        self.ends = ends_of(stages, model.dt)
        self.responses = self._responses(model.tables)
        loads = list(model.case.loads.values())
        bodies, rows = list(model.bodies.values()), []
        for k, body_force in enumerate(model.loads.body_forces):
            body, column = bodies[body_force.body], loads.index(body_force.load) + 1
            rows.append((body.start, body.stop, k * model.dim, column, 0.0))
        self.body_forces = record_array(rows, BODY_FORCE)
        self.axes = np.array([body_force.acceleration for body_force in model.loads.body_forces], dtype=float).ravel()
        integrator = model.case.method.integrator
        kernel = kernel_of(integrator)
        self.scheme = Scheme(kernel, stages.numbers, uses_internal(kernel), f"integrator {integrator.name}")
        self.system: System

    def _zeros(self, count: int) -> StageAmplitudes:
        return StageAmplitudes(
            np.zeros((count, len(self.stages.times), self.columns)), np.zeros((count, 2, self.columns))
        )

    def _responses(self, tables: Sequence[LeapFrog]) -> Floats:
        """Return w of each contact point in the states of each table, (tables, points)."""
        responses = [self.model.law_records(table)[1]["response"] for table in tables]
        return np.array(responses, dtype=float).reshape(len(tables), len(self.model.contact_points))

    def changing_arrays(self) -> list[Any]:
        """Return displacement, velocity, the arrays kept between steps, and the sums of the load amplitudes."""
        return [*self.state, self.amplitude_sums]

    def set_step(self, step: Step, parts: Sequence[Part[Any]], kernels: Kernels, midpoint: float) -> None:  # noqa: ARG002
        """Use the arrays and actions of the next stretch of the run."""
        stages, columns, model = self.stages, self.columns, self.model
        self.system = System(
            step, model.bodies.mass_of_dofs, model.bodies.inverse_mass_of_dofs, self.body_forces, self.axes,
            np.array([constraint.active(midpoint) for constraint in model.loads.constraints], dtype=np.int64),
            self.responses, self.ends, np.array(stages.times, dtype=float),
            np.zeros((len(stages.times), columns)), np.zeros((2, columns)), self.amplitude_sums, np.zeros(1),
        )  # fmt: skip
        self.numbers, self.in_stages = kernels.scheme(self.scheme, self.system)
        self._advance, self._begin = (kernels.loop(loop, self.scheme) for loop in (advance, begin))

    def amplitudes(self, first: int, count: int) -> StageAmplitudes:
        """Return forces at the times of the stages, and prescribed velocities at both ends of each step."""
        model = self.model
        t = np.asarray((first + np.arange(count)) * model.dt, dtype=np.float64)
        amplitudes = self._zeros(count)
        for column, spec in enumerate(model.case.loads.values(), start=1):
            if spec.acts_as == "velocity":
                for k in range(2):
                    amplitudes.speed[:, k, column] = amplitude(spec, t + k * model.dt, model.dt, average=False)
            else:
                for k, fraction in enumerate(self.stages.times):
                    amplitudes.force[:, k, column] = amplitude(spec, t + fraction * model.dt, model.dt, average=True)
        return amplitudes

    def start(self) -> None:
        """Fill the arrays kept between steps with the acceleration at t = 0."""
        system, model = self.system, self.model
        for column, spec in enumerate(model.case.loads.values(), start=1):
            if spec.acts_as != "velocity":
                system.amplitude[-1, column] = amplitude(spec, np.zeros(1), model.dt, average=True)[0]
        system.speed[:] = self.amplitudes(0, 1).speed[0]
        # The last stage is evaluated, and its time has to be t = 0.
        system.clock[0] = -system.times[-1] * model.dt
        last = system.ends[-1].copy(), system.responses[-1].copy()
        if self.stages.start:
            system.ends[-1] = self.stages.start
            system.responses[-1] = self._responses([table_of_stage(*self.stages.start)])
        self._begin(self.in_stages, system.times.size - 1, *self.state)
        system.ends[-1], system.responses[-1] = last

    def advance(self, amplitudes: Any, record: Record, first: int, count: int) -> int:
        """Make `count` steps; return `count`, or the number of steps before the first one that failed a check."""
        return self._advance(self.system, self.numbers, record, amplitudes, self.state, first, count)

    def step_without_loads(self, record: Record, state: Floats) -> Floats:
        """Return the nodal state after one step without loads given in time, (levels, nodes * dim)."""
        for array in self.state:
            array.fill(0.0)
        kept = self.state.kept[:, : self.nodal]
        self.u[:], self.v[:], kept[:] = state[0], state[1], state[2:]
        self.advance(self._no_loads, record, 1, 1)
        return np.concatenate([self.u[None], self.v[None], kept])

    @cached_property
    def _no_loads(self) -> StageAmplitudes:
        amplitudes = self._zeros(1)
        amplitudes.force[..., [force.column for force in self.model.facts.forces]] = 1.0
        return amplitudes

    def load_impulse(self, amplitudes: Any) -> Floats:  # noqa: ARG002  the loop sums them step by step
        """Return the impulse of the loads on all bodies so far, with its moment."""
        model, bodies = self.model, list(self.model.bodies.values())
        total = model.bodies.no_impulse()
        for force in model.loads.on_nodes:
            total += self.amplitude_sums[force.column] * model.bodies.with_moment(
                model.bodies.nodes[force.node], force.force
            )
        for body_force, record in zip(model.loads.body_forces, self.body_forces, strict=True):
            body = bodies[body_force.body]
            weight = self.amplitude_sums[record.column] * body.mass.sum() * body_force.acceleration
            total += model.bodies.with_moment(body.centre, weight)
        return model.dt * total
