"""The time loop of a run: builds its arrays, runs the compiled loop in chunks and checks the state after each chunk."""

from __future__ import annotations

import copy
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.compiler.record_arrays import copied_records, empty_records, record_array
from percuss.compiler.specialise import compile_error
from percuss.compiling import compile_seconds
from percuss.contact.contact_rows import carry_over, point_records
from percuss.contact.equation import NEVER, SWEEPS
from percuss.errors import PercussError
from percuss.heartbeat import beat
from percuss.march import diagnosis, recording
from percuss.march.implicit import NOT_COMPILED, ImplicitStepper
from percuss.march.leapfrog import LeapFrogStepper
from percuss.march.multistage import MultistageStepper
from percuss.march.starting_state import initial_velocity
from percuss.march.stepper import Stepper
from percuss.march.stop import Kind, Stop
from percuss.mesh.block import Group
from percuss.mesh.cells import cell_arrays, has_cells
from percuss.mesh.coupled_masses import arrays_for_the_loop
from percuss.methods.plugin_calls import answer
from percuss.step import bulk
from percuss.step import law_kernels as custom_laws
from percuss.step import loop as leapfrog_loop
from percuss.step.build import Kernels, LoopParts, bind, bind_plain, keep
from percuss.step.end_force_rows import end_force_records
from percuss.step.parts import followers as following_loads
from percuss.step.parts.coupled_masses import NEIGHBOUR, coupled_kinetic
from percuss.step.parts.ends_without_mass import end_records
from percuss.step.parts.followers import FOLLOWER
from percuss.step.state_variables import StateVariables
from percuss.step.uniform_bars import uniform_bars

if TYPE_CHECKING:
    from percuss.contact.bound_law import BoundLaw
    from percuss.march.model import Model
    from percuss.methods.interfaces import Floats

CHUNK_SECONDS = 0.5
CHUNK_STEPS = 65536
CONTACT_WORK_GROWTH = 9.0  # contact work beyond this factor times the energy put in stops the run as unstable
KINETIC_GROWTH = 100.0  # kinetic energy beyond this factor times the energy put in stops the run as unstable
LARGEST_ENERGY = 1e200  # with stiffnesses and masses of at least 1e-100 the squares of motions stay below 1e300
SILENT_STRAIN = 1e-10  # the elastic energy of this strain in all elements counts as round-off

Progress = Callable[[int, int], None]


@dataclass
class Outcome:
    """The result of the time integration; contact points stand in the order of the loop."""

    records: int  # number of complete rows of `record`
    time: Floats
    record: leapfrog_loop.Record
    points: Any  # percuss.contact.equation.POINT, summed over the steps before t_N
    starting_velocity: Floats  # at -dt/2
    kinetic_before: float  # kinetic energy at -dt/2
    totals: SimpleNamespace  # `March.totals`, before the trial step
    load_impulse: Floats
    kernels: Kernels
    seconds: dict[str, float]
    status: str = "done"  # or "interrupted" or "unstable"
    done: int = 0  # number of completed steps, without the trial step
    reactions: Any = None  # sum of the reactions over the steps, one value for each constraint of the model
    final_velocity: Any = None  # at t_N - dt/2
    final_displacement: Any = None  # at t_N
    stop: Stop | None = None


class March:
    """The time integration of one run of a model.

    Parameters
    ----------
    model
        The model to integrate in time.
    compiled
        Whether to compile the loop where possible.
    kernels
        The bound loop of another run of this model; by default it is bound again.
    """

    def __init__(self, model: Model, *, compiled: bool = True, kernels: Kernels | None = None) -> None:
        started = time.perf_counter()
        self.model = model
        self.dim = model.dim
        self._beginning: list[bytes] = []
        self.order, self.law_records = model.law_records()
        self._arrays()
        self._begin()
        self.kernels = kernels or bind(self.parts, compiled=compiled and model.implicit is None)
        if model.implicit is not None:
            self.kernels = self.kernels._replace(reasons=(NOT_COMPILED.format(model.case.method.integrator.name),))
        self._is_compiled = False
        self.seconds = {"build": time.perf_counter() - started}

    def keep_beginning(self) -> None:
        """Keep the state before the first step, so that `again` can return to it."""
        stretches = sum(1 for _ in self.model.segments())
        # With the second stretch come other arrays, so that the first one has to be made again.
        self._beginning = self._saved_state() if stretches == 1 else []

    def again(self) -> March:
        """Return a march from the beginning of the same run, which overwrites state and records of this one."""
        march = copy.copy(self)
        march.seconds = {"build": 0.0}
        if not self._beginning:
            march._begin()
            return march
        march.reactions = np.zeros(len(self.model.constraints))
        march._restore_state(self._beginning)
        return march

    def _arrays(self) -> None:
        """Make the arrays that steps do not change, and those of the records."""
        model, dim = self.model, self.dim
        self.probes = recording.probe_nodes(model)
        contact_nodes = [node for contact_pair in model.contact_pairs for node in contact_pair.nodes]
        acted_nodes = model.acted_nodes
        self.moved_by = {node: model.body_of(node).response(node) for node in acted_nodes if model.couples_nodes}
        beside = [
            node
            for end in (*contact_nodes, *acted_nodes)
            if model.couples_nodes
            for node in model.body_of(end).response(end)
        ]
        beside += [node for end_force in model.end_forces(0.5 * model.dt).values() for node in end_force.nodes]
        self.boundary_nodes = list(dict.fromkeys([*contact_nodes, *acted_nodes, *beside, *self.probes]))
        self.place = {node: k * dim for k, node in enumerate(self.boundary_nodes)}
        self.internal_work = np.zeros(1 if model.sums_internal_work else 0)
        self.own_step = np.array(model.own_steps or [1] * len(model.bodies), dtype=np.int64)
        mass = np.repeat(model.mass, dim)
        work_space = (bulk.BLOCK + 2) * dim
        ahead = np.zeros(work_space if model.viscosity else 0)
        inverse = np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0.0)
        coupling, factor = arrays_for_the_loop(model.bodies.values(), dim)
        correction, before, change = (np.zeros(coupling.shape[1]) for _ in range(3))
        viscous_time, work = model.viscosity * model.dt, np.zeros(work_space)
        number = np.zeros(1, dtype=np.int64)
        self.bulk = bulk.Bulk(
            mass,
            inverse,
            work,
            viscous_time,
            ahead,
            dim,
            coupling,
            factor,
            correction,
            before,
            change,
            number,
            np.zeros(dim),
            np.zeros(len(model.bodies) * dim if model.body_forces else 0),
        )
        self.kernel_laws: Sequence[BoundLaw] = [bound_law for bound_law in model.laws if bound_law.linear is None]
        self.state_variables = StateVariables.of(model, self.kernel_laws)
        shifted = len(self.boundary_nodes) * dim if model.shifts else 0
        self.shifts, self.shifts_before = np.zeros(shifted), np.zeros(shifted)
        self.nested_loads = following_loads.nest(model.followers)
        self.groups, kinds = self._groups()
        self.parts = LoopParts(
            kinds,
            self.groups,
            self.kernel_laws,
            model.followers,
            None if model.stages is None else model.case.method.integrator,
            dim,
        )
        recorded_states = self.state_variables.of_elements(model, recording.recorded_elements(model))
        self.record, self.time = recording.empty_record(model, self.probes, self.place, recorded_states)

    def _begin(self) -> None:
        """Make the arrays of the state before the first step."""
        model, dim = self.model, self.dim
        self.reactions = np.zeros(len(model.constraints))
        self.stepper: Stepper
        if model.implicit is not None:
            self.stepper = ImplicitStepper(model, model.implicit)
        else:
            self.stepper = LeapFrogStepper(model) if model.stages is None else MultistageStepper(model, model.stages)
        self.u, self.v = self.stepper.u, self.stepper.v
        variables = self.state_variables
        for array in (variables.before, variables.after, self.internal_work, self.shifts, self.shifts_before):
            array[:] = 0.0
        dofs: list[tuple[Any, ...]] = []
        for node in self.boundary_nodes:
            body = model.body_of(node).number
            mass, own_step = model.mass[node], self.own_step[body]
            dofs += [(node * dim + axis, mass, body * dim + axis, *([0.0] * 4), own_step, 0.0) for axis in range(dim)]
        self.boundary = self._boundary_at(0.5 * model.dt, record_array(dofs, leapfrog_loop.BOUNDARY_DOF))
        self.uniform = uniform_bars(model, self.boundary_nodes)
        if self.boundary.ends_without_mass.size > 0:
            self._balance_at_rest()
        self._renew_stepper(0.5 * model.dt)

    def _balance_at_rest(self) -> None:
        """Put ends without mass into static balance with what a law presses or pulls before the first step."""
        dofs, speed = self.boundary.boundary_dofs, self.v.copy()
        leapfrog_loop.save_state(dofs, self.u, self.v)
        dofs["new_v"] = 0.0
        leapfrog_loop.balance_ends_without_mass(self.boundary, self.u, self.v, self.model.dt)
        self.v[:] = speed

    def _momenta(self) -> Floats:
        mass = self.model.mass[:, None]
        velocity = self.v.reshape(-1, self.dim)
        return np.concatenate(
            [
                (mass[body.start : body.stop] * velocity[body.start : body.stop]).sum(axis=0)
                for body in self.model.bodies.values()
            ]
        )

    def _groups(self) -> tuple[list[Group], list[tuple[Any, Any]]]:
        """Group the bodies by element and material class and bind their elements; return groups and classes."""
        from percuss.methods.interfaces import BodyMesh

        kinds: dict[tuple[type, type, Any], list[Any]] = {}
        for body in self.model.bodies.values():
            element = body.spec.element
            options = element if has_cells(element) else None  # bodies of cells share what follows from the options
            kinds.setdefault((type(element), type(body.spec.material), options), []).append(body)
        groups = []
        for bodies in kinds.values():
            element, meshes = bodies[0].spec.element, [BodyMesh(body.mesh, body.spec.area) for body in bodies]
            if has_cells(element):
                arrays: Any = cell_arrays(element, meshes)
            else:
                bound = [answer(body.spec.element, "bind", mesh) for body, mesh in zip(bodies, meshes, strict=True)]
                arrays = type(bound[0])(*(_read_only(np.concatenate(columns)) for columns in zip(*bound, strict=True)))
            counts = [body.volumes.size for body in bodies]
            groups.append(
                Group(
                    arrays,
                    _read_only(np.array([answer(body.spec.material, "parameters") for body in bodies], dtype=float)),
                    np.array([body.number for body in bodies], dtype=np.int64),
                    np.array([body.start for body in bodies], dtype=np.int64),
                    np.array([body.stop for body in bodies], dtype=np.int64),
                    np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64),
                    *self.state_variables.of_bodies(bodies),
                    self.internal_work,
                    self.own_step[[body.number for body in bodies]],
                )
            )
        return groups, [(element, material) for element, material, _ in kinds]

    def _boundary_at(self, midpoint: float, boundary_dofs: Any) -> leapfrog_loop.Boundary:
        """Return the boundary for the constraints and laws that are active at a time; all its sums start at zero."""
        model, dim = self.model, self.dim
        active = [
            (index, constraint)
            for index, constraint in enumerate(model.constraints)
            if self.stepper.keeps_constraints or constraint.active(midpoint)
        ]
        self.active_constraints = [index for index, _ in active]
        sides = model.contact_rows(midpoint).sides
        end_forces = self.model.end_forces(midpoint)
        sides = [end_forces[point].sides if point in end_forces else sides[point] for point in self.order]
        law_records = self.law_records
        if inactive := model.inactive_points(midpoint):
            law_records = law_records.copy()
            law_records["always"][np.isin(self.order, inactive)] = NEVER
        points, entries, others = point_records(
            law_records, [model.contact_pairs[point].gap for point in self.order], sides, self.place
        )
        self.nested_laws = custom_laws.nest(self.kernel_laws, points, others, *self.state_variables.of_laws())
        constraints = [
            (self.place[constraint.node], i * dim, self._mass_held(constraint.node), constraint.column, 0.0)
            for i, (_, constraint) in enumerate(active)
        ]
        shares = [
            (i, point, float(constraint.direction @ side.pushes))
            for i, (_, constraint) in enumerate(active)
            for point, point_sides in enumerate(sides)
            for side in point_sides
            if side.node == constraint.node and constraint.active(midpoint)
        ]
        nodal_forces = [
            (self.place[nodal_force.node], i * dim, model.mobility(nodal_force.node), nodal_force.column)
            for i, nodal_force in enumerate(model.nodal_forces, start=len(active))
        ]
        followers = []
        for i, follower in enumerate(model.followers, start=len(active) + len(model.nodal_forces)):
            place, mobility = self.place[follower.node], model.mobility(follower.node)
            times = follower.switched_on, follower.load.stop
            followers.append((place, i * dim, mobility, follower.column, *times, *([0.0] * 6)))
        axes = [
            *(constraint.direction for _, constraint in active),
            *(nodal_force.force for nodal_force in model.nodal_forces),
            *(follower.direction for follower in model.followers),
        ]
        return leapfrog_loop.Boundary(
            boundary_dofs,
            points,
            entries,
            others,
            end_records(sides, self.place),
            *end_force_records(end_forces, self.order, law_records, self.place, model.mass),
            self._neighbours(),
            record_array(constraints, leapfrog_loop.CONSTRAINT),
            record_array(shares, leapfrog_loop.SHARE),
            record_array(nodal_forces, leapfrog_loop.NODAL_FORCE),
            record_array(followers, FOLLOWER),
            np.array(axes, dtype=float).ravel(),
            empty_records(1, leapfrog_loop.TOTAL),
            self._momenta() if model.body_forces else np.zeros(0),
            self.state_variables.before,
            self.state_variables.after,
            self.state_variables.stored,
            self.state_variables.dissipated,
            self.state_variables.stored_by_laws,
            self.internal_work,
            self.shifts,
            self.shifts_before,
        )

    def _mass_held(self, node: int) -> float:
        """Return the mass that a reaction accelerates along with a node: its own where the mass is diagonal."""
        return 1.0 / self.model.mobility(node) if self.model.couples_nodes else float(self.model.mass[node])

    def _neighbours(self) -> Any:
        """Return the records of the nodes beside the ends on which loads, supports and drives act."""
        rows = [
            (self.place[node] + d, self.place[end] + d, value / response[end])
            for end, response in self.moved_by.items()
            for node, value in response.items()
            if node != end
            for d in range(self.dim)
        ]
        return record_array(rows, NEIGHBOUR)

    def switch(self, midpoint: float) -> None:
        """Change to the drives and laws that are active at `midpoint`, and continue all sums over the steps."""
        before = self.boundary
        self._add_reactions()
        after = self._boundary_at(midpoint, before.boundary_dofs)
        carry_over(before.points, after.points)
        after.followers["impulse"] = before.followers["impulse"]
        for name in ("stored", "active"):
            after.end_forces[name] = before.end_forces[name]
        self.boundary = after._replace(totals=before.totals)
        self._renew_stepper(midpoint)

    def _renew_stepper(self, midpoint: float) -> None:
        self.stepper.set_loop(
            leapfrog_loop.Loop(
                self._nested_groups(),
                self.bulk,
                self.boundary,
                self.nested_laws,
                self.nested_loads,
                self.uniform,
                self.dim,
                midpoint,
            )
        )

    def _add_reactions(self) -> None:
        """Add the reactions summed by the loop to those of the constraints of the model, and reset the former."""
        summed = self.boundary.constraints["reaction"]
        self.reactions[self.active_constraints] += summed
        summed[:] = 0.0

    # -- time integration --------------------------------------------------------------------------------

    def run(
        self,
        progress: Progress | None = None,
        *,
        marginal: bool = False,
        interrupted: threading.Event | None = None,
        interrupt_after: int | None = None,
    ) -> Outcome:
        """Integrate to the end of the run, or until it is stopped.

        Parameters
        ----------
        progress
            Called with (completed steps, number of steps) between chunks.
        marginal
            Whether the time step is the critical one, at which the motion of highest frequency of a bar may grow
            linearly with time.
        interrupted
            Event that ends the run after the next chunk of steps when it is set (`percuss.interrupt.interruptible`).
        interrupt_after
            Number of steps after which the run ends as if it were interrupted, as an earlier run was; None for none.
        """
        started = time.perf_counter()
        self.compile()
        self._start_stepper()
        settled, compiled = time.perf_counter(), compile_seconds()
        self.seconds["compile"] = settled - started
        outcome = self._empty_outcome()
        self._marginal = marginal
        totals, energy_before = self.boundary.totals, self._kinetic(self.v)
        totals["energy_before"], totals["began_with"] = energy_before, max(self.initial_energy, energy_before)
        totals["growth"] = CONTACT_WORK_GROWTH
        totals["floor"] = self.noise if self.model.case.time.on_unstable == "stop" else np.inf
        outcome.kinetic_before = energy_before
        # Plain Python would warn of overflow and invalid values; the checks after each chunk report them.
        with np.errstate(all="ignore"):
            self._march(outcome, progress, interrupted or threading.Event(), interrupt_after)
            self._add_reactions()
            outcome.reactions, outcome.final_velocity = self.reactions.copy(), self.v.copy()
            outcome.final_displacement = self._displacement(outcome.done)
            outcome.points = copied_records(self.boundary.points)
            outcome.totals = self.totals
            if outcome.status != "unstable":
                self._trial_step(outcome.done)
        every = self.record.every
        if outcome.status == "done":
            outcome.records = self.time.size
        else:  # a record needs the step after it: the last record is complete only if a trial step was made
            outcome.records = -(-outcome.done // every) if outcome.status == "unstable" else outcome.done // every + 1
        self.seconds["march"] = time.perf_counter() - settled - (compile_seconds() - compiled)
        return outcome

    def _displacement(self, step: int) -> Floats:
        """Return the displacement before a step, of nodes that are ahead of it too, (nodes * dim,)."""
        displacement = self.u.copy()
        if self.model.own_steps:
            ahead = np.repeat(-step % self.own_step, [body.mass.size for body in self.model.bodies.values()])
            ahead[self.boundary_nodes] = 0  # they are advanced by one step at a time
            displacement -= np.repeat(ahead, self.dim) * self.model.dt * self.v
        return displacement

    def _start_stepper(self) -> None:
        """Prepare the first step; report the error of a kernel with its law, file and line."""
        try:
            self.stepper.start(self.kernels)
        except (PercussError, MemoryError):
            raise
        except Exception as error:
            raise diagnosis.kernel_failure(self, self.stepper.amplitudes(0, 1), 0, error) from error

    def refuse(self, stop: Stop) -> Outcome:
        """Return the outcome of a run that is refused before its first step."""
        outcome = self._empty_outcome()
        outcome.status, outcome.stop, outcome.reactions = "unstable", stop, self.reactions
        outcome.final_velocity, outcome.final_displacement = self.v, self.u
        self.seconds |= {"compile": 0.0, "march": 0.0}
        return outcome

    def _empty_outcome(self) -> Outcome:
        return Outcome(
            records=0,
            time=self.time,
            record=self.record,
            points=self.boundary.points,
            starting_velocity=self.v.copy(),
            kinetic_before=0.0,
            totals=self.totals,
            load_impulse=np.zeros(self.dim),
            kernels=self.kernels,
            seconds=self.seconds,
        )

    def _march(
        self, outcome: Outcome, progress: Progress | None, interrupted: threading.Event, interrupt_after: int | None
    ) -> None:
        model = self.model
        for first, last in model.segments():
            if first > 0:
                self.switch((first + 0.5) * model.dt)
            for start, count in self._chunks(first, min(last, model.steps)):
                amplitudes = self.stepper.amplitudes(start, count)
                saved = self._saved_state()
                if self._advance_or_report(amplitudes, saved, start, count) < count or not self._is_sound():
                    outcome.status = "unstable"
                    outcome.done, outcome.stop = self._locate_failure(amplitudes, saved, start, count)
                    return
                outcome.done += count
                outcome.load_impulse = self.stepper.load_impulse(amplitudes)
                beat()
                if progress is not None:
                    progress(outcome.done, model.steps)
                if interrupt_after is not None and outcome.done >= interrupt_after:
                    interrupted.set()
                if interrupted.is_set() and outcome.done < model.steps:
                    outcome.status = "interrupted"
                    return

    def _trial_step(self, step: int) -> None:
        """Make one step beyond the last, which completes the last record."""
        for first, last in self.model.segments():
            if first == step > 0:
                self.switch((first + 0.5) * self.model.dt)
            if first <= step < last:
                self._advance_or_report(self.stepper.amplitudes(step, 1), self._saved_state(), step, 1)

    def _advance_or_report(self, amplitudes: Any, saved: list[bytes], first: int, count: int) -> int:
        """Advance as `advance` does; report the error of a kernel with its law, file, line, step and time.

        Raises
        ------
        PluginError
            If a kernel raises an error.
        """
        try:
            return self.advance(amplitudes, first, count)
        except (PercussError, MemoryError):
            raise
        except Exception as raised:
            self._restore_state(saved)
            for s in range(count):
                step_amplitudes = type(amplitudes)(*(part[s : s + 1] for part in amplitudes))
                before = self._saved_state()
                try:
                    self.advance(step_amplitudes, first + s, 1)
                except Exception as error:  # noqa: BLE001  a kernel may raise anything
                    self._restore_state(before)
                    raise diagnosis.kernel_failure(self, step_amplitudes, first + s, error) from raised
            raise

    def advance(self, amplitudes: Any, first: int, count: int) -> int:
        """Make `count` steps; return `count`, or the number of steps before the first one that failed a check.

        Parameters
        ----------
        amplitudes
            Amplitudes of the loads in these steps.
        first
            Number of the first step.
        count
            Number of steps.
        """
        return self.stepper.advance(self.kernels, amplitudes, self.record, first, count)

    def _nested_groups(self) -> Any:
        """Return the groups of bodies nested as (group, (group, ...)), the form that the loop reads."""
        nested: Any = self.groups[-1]
        for group in reversed(self.groups[:-1]):
            nested = (group, nested)
        return nested

    def compile(self) -> None:
        """Compile the loop by a call of no steps; run it as plain Python where a kernel cannot be compiled."""
        if self._is_compiled:
            return
        self._is_compiled = True
        error = self._compile_failure()
        if error is None:
            return
        diagnosis.refuse_array_writing(error)
        self.kernels = bind(self.parts, counting=True)
        error = self._compile_failure()
        if error is not None:
            plain = bind_plain(error, self.parts, self.u.copy(), self.v.copy(), self.model.dt)
            # Plain Python reads the same kernels, but not which of them numba replaces.
            self.kernels = plain._replace(readings=self.kernels.readings)
        keep(self.parts, self.kernels)

    def _compile_failure(self) -> Exception | None:
        """Compile the loop by a call of no steps; return the compiler's error, or None."""
        if self.kernels.compiled:
            try:
                self.advance(self.stepper.amplitudes(0, 0), 0, 0)
            except compile_error() as error:
                return error
        return None

    def _chunks(self, first: int, last: int) -> Iterator[tuple[int, int]]:
        seconds = 1.2e-9  # of a step, for each degree of freedom
        if not self.kernels.compiled:
            seconds = 2e-6
        elif self.uniform.size > 0:
            seconds = 0.4e-9 + 0.8e-9 / self.record.every  # a record sums up the energies
        cost = seconds * (self.u.size + 150)
        width = len(self.model.case.loads) + len(self.model.bodies) * self.dim + 1
        size = int(max(1, min(CHUNK_STEPS, CHUNK_SECONDS / cost, 4_000_000 / width)))
        start = first
        while start < last:
            count = min(size, last - start)
            yield start, count
            start += count

    @cached_property
    def initial_energy(self) -> float:
        """The kinetic energy at t = 0."""
        return self._kinetic(initial_velocity(self.model).ravel())

    def _kinetic(self, v: Floats) -> float:
        if self.bulk.factor.size:
            return coupled_kinetic(self.bulk, v, np.empty_like(v))
        # Not `@`: from about ten thousand entries on, BLAS wakes threads, which costs more than the sum.
        return 0.5 * float(np.einsum("i,i,i", self.bulk.mass, v, v))

    @cached_property
    def noise(self) -> float:
        """The energy below which everything is round-off: that of the strain `SILENT_STRAIN` in all elements."""
        stiff = sum(float((body.stiffness * body.mesh.lengths**2).sum()) for body in self.model.bodies.values())
        return 0.5 * stiff * SILENT_STRAIN**2

    @property
    def totals(self) -> SimpleNamespace:
        """The sums over all steps so far, `percuss.step.loop.TOTAL`, as numbers by name."""
        names = self.boundary.totals.dtype.names
        return SimpleNamespace(**dict(zip(names, self.boundary.totals.item(), strict=True)))

    # -- checks ------------------------------------------------------------------------------------------

    def _is_sound(self) -> bool:
        """Return whether state and energies are finite, and the kinetic energy plausible for the energy put in."""
        total = self.totals
        energy_put_in = total.began_with + total.largest_work + max(total.contact_work, 0.0)
        kinetic = self._kinetic(self.v)
        allowed = KINETIC_GROWTH * energy_put_in + total.floor + leapfrog_loop.NOISE * total.step_energy
        finite = kinetic + energy_put_in + total.step_energy < LARGEST_ENERGY
        return bool(finite and (self._marginal or kinetic <= allowed))

    def changing_arrays(self) -> list[Any]:
        """Return the arrays that a step changes, always in the same order."""
        boundary = self.boundary
        return [
            *self.stepper.changing_arrays(),
            boundary.points,
            boundary.end_forces,
            boundary.constraints,
            boundary.followers,
            boundary.totals,
            boundary.before,
            boundary.state_before,
            boundary.internal_work,
            boundary.shifts,
        ]

    def _saved_state(self) -> list[bytes]:
        """Return the contents of the arrays that a step changes, as bytes: NumPy copies records field by field."""
        return [array.tobytes() for array in self.changing_arrays()]

    def _restore_state(self, saved: list[bytes]) -> None:
        for array, content in zip(self.changing_arrays(), saved, strict=True):
            np.frombuffer(array, np.uint8)[:] = np.frombuffer(content, np.uint8)

    def _locate_failure(self, amplitudes: Any, saved: list[bytes], first: int, count: int) -> tuple[int, Stop]:
        """Repeat the chunk step by step up to the first step that fails a check; return its number and the stop."""
        self._restore_state(saved)
        for s in range(count):
            step_amplitudes = type(amplitudes)(*(part[s : s + 1] for part in amplitudes))
            before = self._saved_state() if self.kernel_laws else []
            solved = self.advance(step_amplitudes, first + s, 1) == 1
            if not solved or not self._is_sound():
                break
        if self.kernel_laws and not np.isfinite(self.boundary.points.multiplier).all():
            stop = self._stop_without_multiplier(step_amplitudes, before, first + s)
            if stop is not None:
                return first + s, stop
        return first + s, self._stop_after(first + s, solved=solved)

    def _stop_after(self, step: int, *, solved: bool) -> Stop:
        """Return the reason for which the run stopped after a step, and the node at which it shows most."""
        total = self.totals
        allowed = total.growth * (total.began_with + total.largest_work) + total.floor
        contact_work_exceeded = not total.contact_work <= allowed + leapfrog_loop.NOISE * total.step_energy
        points = self.boundary.points
        active = (
            np.flatnonzero(points.multiplier != 0.0)
            if contact_work_exceeded or not solved
            else np.zeros(0, dtype=np.int64)
        )
        node = int(np.argmax(np.abs(self.v))) // self.dim
        if active.size:
            worst = int(active[np.argmax(np.abs(points.multiplier[active]))])
            node = int(self.boundary.boundary_dofs[self.boundary.entries[points[worst].start].place].dof) // self.dim
        finite = np.isfinite(self.u) & np.isfinite(self.v)
        kind: Kind
        if contact_work_exceeded:
            kind, description = "contact work", "the work of the contacts exceeds all energy put in many times"
        elif not solved:
            kind = "not solved"
            description = f"the equation of contacts that share an end was not solved in {SWEEPS} sweeps"
        else:
            kind, description = "energy", "the kinetic energy exceeds all energy put in many times"
            if not self._kinetic(self.v) + total.began_with + total.largest_work + total.step_energy < LARGEST_ENERGY:
                description = f"the energy exceeds {LARGEST_ENERGY:g}, beyond which numbers overflow"
        if not finite.all():
            node, description = int(np.argmin(finite)) // self.dim, "a value is no longer finite"
        return Stop(step, node, kind, description)

    def _stop_without_multiplier(self, amplitudes: Any, before: list[bytes], step: int) -> Stop | None:
        """Return the stop caused by a kernel that left a contact without a multiplier in this step, or None."""
        after = self._saved_state()
        self._restore_state(before)
        failure = diagnosis.missing_multiplier(self, amplitudes, step)
        self._restore_state(after)
        if failure is None:
            return None
        (contact_pair,) = (
            contact_pair for contact_pair in self.model.contact_pairs if contact_pair.name == failure.contact
        )
        return Stop(step, contact_pair.nodes[0], "kernel", failure.description, failure.cause)


def _read_only(array: Any) -> Any:
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array
