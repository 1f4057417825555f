"""What a march carries for a scheme that is no leap-frog: longer arrays, stages, and loads at their times."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.solver.compiled.multistage_loop import BODY_FORCE, Given, System
from percuss.solver.integrator_check import ends_of

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Stages
    from percuss.solver.compiled.bulk import Bulk
    from percuss.solver.compiled.leapfrog_loop import Boundary, Record
    from percuss.solver.model import Model


class State(NamedTuple):
    """Displacement, velocity and what is kept between steps; entries of the nodes first."""

    u: Floats  # (size,)
    v: Floats  # (size,)
    kept: Floats  # (kept, size)


class Staged:
    """The arrays of a march in stages.

    Parameters
    ----------
    model
        The model to march; its integrator returned `said`.
    said
        Stages of the integrator.
    """

    def __init__(self, model: Model, said: Stages) -> None:
        self.model, self.said = model, said
        self.nodal = model.n_nodes * model.dim
        self.columns = len(model.case.loads) + 1
        size = self.nodal + len(model.contact_pairs) + len(model.constraints) + self.columns
        kept = model.case.method.integrator.kept
        self.state = State(np.zeros(size), np.zeros(size), np.zeros((kept, size)))
        self.state.v[: self.nodal] = model.initial_velocity.ravel()
        self.given = np.zeros(self.columns)
        self.ends = ends_of(said, model.dt)
        order = [p for entry in model.laws for p in entry["where"]]
        delassus = model.delassus(0.5 * model.dt)
        self.responses = np.array([model.law_records(delassus, table)[1]["response"] for table in model.tables])
        self.responses = self.responses.reshape(len(said.times), len(order))
        loads = list(model.case.loads.values())
        bodies = list(model.bodies.values())
        rows = [
            (bodies[one.body].start, bodies[one.body].stop, k * model.dim, loads.index(one.load) + 1, 0.0)
            for k, one in enumerate(model.body_forces)
        ]
        self.body_forces = np.array(rows, dtype=BODY_FORCE).view(np.recarray)
        self.axes = np.array([one.acceleration for one in model.body_forces], dtype=float).ravel()
        self._quiet = Given(np.zeros((0, 1, 1)), np.zeros((0, 2, 1)))
        self.system: System

    def changing(self) -> list[Any]:
        """Return what a step changes, beyond what that of a leap-frog scheme does."""
        return [*self.state, self.given]

    def renew(self, groups: Any, masses: Bulk, boundary: Boundary, bound: Any, midpoint: float) -> None:
        """Take up the boundary of a run of steps around `midpoint` with the same drives."""
        said, columns = self.said, self.columns
        self.system = System(
            groups, masses, boundary, bound, self.body_forces, self.axes,
            np.array([h.active(midpoint) for h in self.model.constraints], dtype=np.int64),
            self.responses, self.ends, np.array(said.times, dtype=float), self.model.dim,
            np.zeros((len(said.times), columns)), np.zeros((2, columns)), np.zeros((1, columns)), self.given,
            np.array([0.0, self.model.dt, 1.0]),
        )  # fmt: skip

    def drive(self, first: int, count: int) -> Given:
        """Return the amplitudes of the loads for `count` steps from step `first`."""
        model, stages = self.model, len(self.said.times)
        if not model.case.loads:
            if self._quiet.force.shape[0] < count:
                self._quiet = Given(np.zeros((count, stages, 1)), np.zeros((count, 2, 1)))
            return self._quiet
        t = np.asarray((first + np.arange(count)) * model.dt, dtype=np.float64)
        force, speed = np.zeros((count, stages, self.columns)), np.zeros((count, 2, self.columns))
        for column, spec in enumerate(model.case.loads.values(), start=1):
            if spec.acts_as == "velocity":
                for k in range(2):
                    speed[:, k, column] = model.amplitude(spec, t + k * model.dt, average=False)
            else:
                for k, fraction in enumerate(self.said.times):
                    force[:, k, column] = model.amplitude(spec, t + fraction * model.dt, average=True)
        return Given(force, speed)

    def start(self, kernel: Any, state: State | None = None) -> None:
        """Fill what is kept with the acceleration at t = 0."""
        state = state or self.state
        system, model = self.system, self.model
        for column, spec in enumerate(model.case.loads.values(), start=1):
            if spec.acts_as != "velocity":
                system.amplitude[-1, column] = model.amplitude(spec, np.zeros(1), average=True)[0]
        system.speed[:] = self.drive(0, 1).speed[0]
        system.clock[0] = -system.times[-1] * model.dt  # so that the last stage is that of t = 0
        kernel(system, *state)

    def advance(
        self, kernel: Any, given: Given, record: Record, first: int, count: int, state: State | None = None
    ) -> int:
        """March; return how many steps were done when one was not sound, else `count`."""
        done: int = kernel(
            self.system, self.said.numbers, given, record, *(state or self.state), self.model.dt, first, count
        )
        return done

    def load_impulse(self) -> Floats:
        """Return the impulse of the loads on all bodies so far, (dim,)."""
        model, total = self.model, np.zeros(self.model.dim)
        for push in model.nodal_forces:
            total += self.given[push.column] * push.force
        bodies = list(model.bodies.values())
        for pull, row in zip(model.body_forces, self.body_forces, strict=True):
            total += self.given[row.column] * bodies[pull.body].mass.sum() * pull.acceleration
        return model.dt * total
