"""The time loop of a run: builds its arrays, runs the compiled loop in chunks and checks the state after each chunk."""

from __future__ import annotations

import copy
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from percuss.errors import PercussError
from percuss.jit import compile_error, compile_seconds
from percuss.march import diagnosis
from percuss.march.arrays import Arrays
from percuss.march.estimate import seconds_in_solids
from percuss.march.leapfrog import LeapFrogStepper
from percuss.march.multistage import MultistageStepper
from percuss.march.starting_state import initial_velocity
from percuss.march.stepper import Stepper
from percuss.march.stop import Kind, Stop
from percuss.record_arrays import Records, copied_records
from percuss.step.account import NOISE
from percuss.step.build import Kernels, compile_actions, kernels, why_not_compiled
from percuss.step.equation import SWEEPS
from percuss.step.record import OF_CONTACTS, OF_PROBES, Record
from percuss.threads import made_faster

if TYPE_CHECKING:
    from percuss.contact.model import Model
    from percuss.methods.interfaces import Array, Floats
    from percuss.step.actions import Action

CHUNK_SECONDS = 0.5
CHUNK_STEPS = 65536
CONTACT_WORK_GROWTH = 9.0  # contact work beyond this factor times the energy put in stops the run as unstable
KINETIC_GROWTH = 100.0  # kinetic energy beyond this factor times the energy put in stops the run as unstable
LARGEST_ENERGY = 1e200  # with stiffnesses and masses of at least 1e-100 the squares of motions stay below 1e300
SILENT_STRAIN = 1e-10  # the elastic energy of this strain in all elements counts as round-off

Progress = Callable[[int, int], None]


class Keeper(Protocol):
    """What keeps the state of a run, so that another march can go on from it.

    Attributes
    ----------
    done
        Steps that an earlier march has made, from whose state this one goes on; 0 for none.
    seconds
        Time that they took.
    """

    done: int
    seconds: float

    def offer(self, done: int, seconds: float, arrays: Sequence[Array], *, at_once: bool) -> None:
        """Keep the arrays as they are after `done` steps, if it is time or `at_once`."""

    def restore(self, arrays: Sequence[Array]) -> None:
        """Fill the arrays with what was kept of them."""


@dataclass
class Outcome:
    """The result of the time integration; contact points stand in the order of the case."""

    records: int  # number of complete rows of `record`
    time: Floats
    record: Record
    histories: dict[str, Floats]  # what the parts of the step have recorded
    law: Records  # percuss.contact.points.LAW
    row: Records  # percuss.contact.points.ROW
    sums: Records  # percuss.contact.points.SUMS, over the steps before t_N, and the largest overlap at t_N too
    contacts: Records  # percuss.contact.points.CONTACT, over the steps before t_N
    starting_velocity: Floats  # at -dt/2
    kinetic_before: float  # kinetic energy at -dt/2
    totals: SimpleNamespace  # `March.totals`, before the trial step
    load_impulse: Floats  # with its moment
    kernels: Kernels
    seconds: dict[str, float]
    status: str = "done"  # or "interrupted" or "unstable"
    done: int = 0  # number of completed steps, without the trial step
    reactions: Any = None  # sum of the reactions over the steps, one value for each constraint of the model
    final_velocity: Any = None  # at t_N - dt/2
    final_displacement: Any = None  # at t_N
    multipliers: Any = None  # of the contact points at t_N
    stop: Stop | None = None


def rows_of(amplitudes: Any, start: int, stop: int) -> Any:
    """Return the amplitudes of loads in some of the steps; those of stages are several arrays."""
    if isinstance(amplitudes, tuple):
        return type(amplitudes)(*(array[start:stop] for array in amplitudes))
    return amplitudes[start:stop]


class March:
    """The time integration of one run of a model.

    Parameters
    ----------
    model
        The model to integrate in time.
    compiled
        Whether to compile the kernels where possible.
    threads
        How many threads may share out the loops over large bodies.
    """

    def __init__(self, model: Model, *, compiled: bool = True, threads: int = 1) -> None:
        started = time.perf_counter()
        self.model = model
        self.dim = model.dim
        self._beginning: list[bytes] = []
        self.kernels = kernels(compiled=compiled)
        self.threads = threads if self.kernels.compiled else 1
        self.arrays = Arrays(model, self.threads)
        self._is_compiled = False
        self._begin()
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
        march.reactions = np.zeros(len(self.model.loads.constraints))
        march._restore_state(self._beginning)
        return march

    def _begin(self) -> None:
        """Make the state before the first step."""
        model = self.model
        self.reactions = np.zeros(len(model.loads.constraints))
        self.stepper: Stepper
        self.stepper = LeapFrogStepper(model) if model.stages is None else MultistageStepper(model, model.stages)
        self.u, self.v = self.stepper.u, self.stepper.v
        self.arrays.begin(self._momenta() if model.loads.body_forces else np.zeros(0))
        for part in self.arrays.parts:
            part.balance_at_rest(self.u, self.v)
        self._link(0.5 * model.dt)

    def _link(self, midpoint: float) -> None:
        """Link the kernels to the arrays of the stretch around a time; compile them before, once in a run."""
        self._midpoint = midpoint
        if self._is_compiled or not self.kernels.compiled:
            self.use(self.kernels, self.arrays.actions)

    def use(self, how: Kernels, actions: Sequence[Action]) -> None:
        """Let the steps of this stretch perform some actions."""
        # A march that was copied from this one may still read the memory of its own links.
        arrays, self.kernels = self.arrays, Kernels(how.compiled, how.reasons)
        step = arrays.step._replace(actions=self.kernels.linked(actions))
        self.stepper.set_step(step, arrays.parts, self.kernels, self._midpoint)

    def _momenta(self) -> Floats:
        mass = self.model.bodies.mass[:, None]
        velocity = self.v.reshape(-1, self.dim)
        return np.concatenate(
            [
                (mass[body.start : body.stop] * velocity[body.start : body.stop]).sum(axis=0)
                for body in self.model.bodies.values()
            ]
        )

    def switch(self, midpoint: float) -> None:
        """Change to the drives and laws that are active at `midpoint`, and continue all sums over the steps."""
        self._add_reactions()
        self.arrays.switch(midpoint)
        self._link(midpoint)

    def _add_reactions(self) -> None:
        """Add the reactions summed by the loop to those of the constraints of the model, and reset the former."""
        summed = self.arrays.step.loads.constraints["reaction"]
        self.reactions[self.arrays.active_constraints] += summed
        summed[:] = 0.0

    # -- time integration --------------------------------------------------------------------------------

    def run(
        self,
        progress: Progress | None = None,
        *,
        marginal: bool = False,
        interrupted: threading.Event | None = None,
        keeper: Keeper | None = None,
    ) -> Outcome:
        """Integrate to the end of the run, or until it is stopped.

        Parameters
        ----------
        progress
            Called with (completed steps, number of steps) between chunks, both without those of an earlier march.
        marginal
            Whether the time step is the critical one, at which the motion of highest frequency of a bar may grow
            linearly with time.
        interrupted
            Event that ends the run after the next chunk of steps when it is set (`percuss.interrupt.interruptible`).
        keeper
            Where the state of the run is kept, and that of an earlier march comes from; None for nowhere.
        """
        started = time.perf_counter()
        self.compile()
        self._start_stepper()
        settled, compiled = time.perf_counter(), compile_seconds()
        self.seconds["compile"] = settled - started
        outcome = self._empty_outcome()
        self._marginal = marginal
        totals, energy_before = self.arrays.step.totals, self._kinetic(self.v)
        totals["energy_before"], totals["began_with"] = energy_before, max(self.initial_energy, energy_before)
        totals["growth"] = CONTACT_WORK_GROWTH
        totals["floor"] = self.noise if self.model.case.time.on_unstable == "stop" else np.inf
        outcome.kinetic_before = energy_before
        # Plain Python would warn of overflow and invalid values; the checks after each chunk report them.
        with np.errstate(all="ignore"):
            self._march(outcome, progress, interrupted or threading.Event(), keeper)
            self._add_reactions()
            outcome.reactions, outcome.final_velocity = self.reactions.copy(), self.v.copy()
            outcome.final_displacement = self._displacement(outcome.done)
            outcome.sums = copied_records(self.arrays.step.points.sums)[self._case_order]
            outcome.contacts = copied_records(self.arrays.step.points.contacts)
            outcome.totals = self.totals
            outcome.histories |= self.arrays.sums()
            if outcome.status != "unstable":
                self._trial_step(outcome.done)  # its gaps and multipliers are those at t_N
                state = self.arrays.step.points.state[self._case_order]
                outcome.multipliers = np.array(state["multiplier"])
                outcome.sums["deepest"] = np.fmax(outcome.sums["deepest"], -state["gap"])
            outcome.histories |= self.arrays.sums_of_records()
        every = self.arrays.record.every
        if outcome.status == "done":
            outcome.records = self.arrays.time.size
        else:  # a record needs the step after it: the last record is complete only if a trial step was made
            outcome.records = -(-outcome.done // every) if outcome.status == "unstable" else outcome.done // every + 1
        earlier = keeper.seconds if keeper else 0.0
        self.seconds["march"] = earlier + time.perf_counter() - settled - (compile_seconds() - compiled)
        return outcome

    @cached_property
    def _case_order(self) -> Any:
        """The place in the loop of each contact point of the case."""
        return np.argsort(np.array(self.arrays.order, dtype=np.int64))

    def _displacement(self, step: int) -> Floats:
        """Return the displacement before a step, of nodes that are ahead of it too, (nodes * dim,)."""
        found = (part.displacement(step, self.u, self.v) for part in self.arrays.parts)
        return next((displacement for displacement in found if displacement is not None), self.u.copy())

    def _start_stepper(self) -> None:
        """Prepare the first step; report the error of a kernel with its law, file and line."""
        try:
            self.stepper.start()
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
            time=self.arrays.time,
            record=self.arrays.record,
            histories=self.arrays.histories(),
            law=self.arrays.step.points.law[self._case_order],
            row=self.arrays.step.points.row[self._case_order],
            sums=self.arrays.step.points.sums[self._case_order],
            contacts=self.arrays.step.points.contacts,
            starting_velocity=self.v.copy(),
            kinetic_before=0.0,
            totals=self.totals,
            load_impulse=self.model.bodies.no_impulse(),
            kernels=self.kernels,
            seconds=self.seconds,
        )

    def _march(
        self,
        outcome: Outcome,
        progress: Progress | None,
        interrupted: threading.Event,
        keeper: Keeper | None,
    ) -> None:
        model, resumed, began = self.model, keeper.done if keeper else 0, time.perf_counter()
        for first, last in model.segments():
            if first > 0:
                self.switch((first + 0.5) * model.dt)
            for start, count in self._chunks(first, min(last, model.steps)):
                if start < resumed:
                    if keeper is not None and start + count == resumed:
                        keeper.restore(self._state_and_histories(outcome, resumed))
                        outcome.done = resumed
                    continue
                amplitudes = self.stepper.amplitudes(start, count)
                saved = self._saved_state()
                if self._advance_or_report(amplitudes, saved, start, count) < count or not self._is_sound():
                    outcome.status = "unstable"
                    outcome.done, outcome.stop = self._locate_failure(saved, start, count)
                    return
                outcome.done += count
                outcome.load_impulse = self.stepper.load_impulse(amplitudes)
                if progress is not None:
                    progress(outcome.done - resumed, model.steps - resumed)
                if keeper is not None and outcome.done < model.steps:
                    seconds = keeper.seconds + time.perf_counter() - began
                    arrays = self._state_and_histories(outcome, outcome.done)
                    keeper.offer(outcome.done, seconds, arrays, at_once=interrupted.is_set())
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
            _, step = self._before_the_failure(saved, first, count, self._raises)
            raise diagnosis.kernel_failure(self, self.stepper.amplitudes(step, 1), step, raised) from raised

    def _raises(self, first: int, count: int) -> bool:
        """Make `count` steps; return whether a kernel raises an error in one of them."""
        try:
            self.advance(self.stepper.amplitudes(first, count), first, count)
        except Exception:  # noqa: BLE001  a kernel may raise anything
            return True
        return False

    def _fails(self, first: int, count: int) -> bool:
        """Make `count` steps; return whether one of them, or the state after them, fails a check."""
        return self.advance(self.stepper.amplitudes(first, count), first, count) < count or not self._is_sound()

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
        stepper, record, threads = self.stepper, self.arrays.record, self.arrays.threads
        if threads == 1:
            return stepper.advance(amplitudes, record, first, count)

        def part(start: int, stop: int) -> int:
            return stepper.advance(rows_of(amplitudes, start, stop), record, first + start, stop - start)

        return made_faster(count, threads, part)

    def compile(self) -> None:
        """Compile the kernels; run all of them as plain Python where one cannot be compiled."""
        if self._is_compiled:
            return
        self._is_compiled = True
        if not self.kernels.compiled:
            return
        reasons = compile_actions(self.arrays.actions, diagnosis.refuse_array_writing)
        if not reasons:
            try:
                self.use(self.kernels, self.arrays.actions)
                self.advance(self.stepper.amplitudes(0, 0), 0, 0)
            except compile_error() as error:
                if not self.model.multistage:
                    raise
                diagnosis.refuse_array_writing(error)
                reasons = (why_not_compiled(f"integrator {self.model.case.method.integrator.name}", error),)
        if reasons:
            self.use(Kernels(False, reasons), self.arrays.actions)

    def _chunks(self, first: int, last: int) -> Iterator[tuple[int, int]]:
        seconds = 1.2e-9  # of a step, for each degree of freedom
        if not self.kernels.compiled:
            seconds = 2e-6
        elif self.arrays.uniform:
            seconds = 0.4e-9 + 0.8e-9 / self.arrays.record.every  # a record sums up the energies
        cost = seconds * (self.u.size + 150) + seconds_in_solids(self.model)
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
        found = (part.kinetic_energy(v) for part in self.arrays.parts)
        if (energy := next((energy for energy in found if energy is not None), None)) is not None:
            return energy
        # Not `@`: from about ten thousand entries on, BLAS wakes threads, which costs more than the sum.
        return 0.5 * float(np.einsum("i,i,i", self.model.bodies.mass_of_dofs, v, v))

    @cached_property
    def noise(self) -> float:
        """The energy below which everything is round-off: that of the strain `SILENT_STRAIN` in all elements."""
        stiff = sum(body.modulus * float(body.volumes.sum()) for body in self.model.bodies.values())
        return 0.5 * stiff * SILENT_STRAIN**2

    @property
    def totals(self) -> SimpleNamespace:
        """The sums over all steps so far, `percuss.step.records.TOTAL`, as numbers by name."""
        totals = self.arrays.step.totals
        return SimpleNamespace(**dict(zip(totals.dtype.names or (), totals.item(), strict=True)))

    # -- checks ------------------------------------------------------------------------------------------

    def _is_sound(self) -> bool:
        """Return whether state and energies are finite, and the kinetic energy plausible for the energy put in."""
        total = self.totals
        energy_put_in = total.began_with + total.largest_work + max(total.contact_work, 0.0)
        kinetic = self._kinetic(self.v)
        allowed = KINETIC_GROWTH * energy_put_in + total.floor + NOISE * total.step_energy
        finite = kinetic + energy_put_in + total.step_energy < LARGEST_ENERGY
        return bool(finite and (self._marginal or kinetic <= allowed))

    def changing_arrays(self) -> list[Array]:
        """Return the arrays that a step changes, always in the same order."""
        return [*self.stepper.changing_arrays(), *self.arrays.changing_arrays()]

    def _state_and_histories(self, outcome: Outcome, done: int) -> list[Array]:
        """Return all arrays that `done` steps have changed, of histories the rows that they have reached."""
        record = outcome.record
        histories = [getattr(record, name) for name in (*OF_CONTACTS, *OF_PROBES, "energy", "field")]
        histories += outcome.histories.values()
        rows = (array[: len(array) * done // self.model.steps + 2] for array in histories)
        return [*self.changing_arrays(), self.reactions, *rows]

    def _saved_state(self) -> list[bytes]:
        """Return the contents of the arrays that a step changes, as bytes: NumPy copies records field by field."""
        return [array.tobytes() for array in self.changing_arrays()]

    def _restore_state(self, saved: list[bytes]) -> None:
        for array, content in zip(self.changing_arrays(), saved, strict=True):
            np.frombuffer(array, np.uint8)[:] = np.frombuffer(content, np.uint8)

    def _before_the_failure(
        self, saved: list[bytes], first: int, count: int, fails: Callable[[int, int], bool]
    ) -> tuple[list[bytes], int]:
        """Return the state before the step that fails, found by bisection, and its number; the run is in that state.

        Parameters
        ----------
        saved
            The state before step `first`, from which one of `count` steps fails.
        first, count
            The first of these steps, and their number.
        fails
            Makes some steps, from the first of them on, and returns whether one fails.
        """
        while count > 1:
            half = count // 2
            self._restore_state(saved)
            if fails(first, half):
                count = half
            else:
                saved, first, count = self._saved_state(), first + half, count - half
        self._restore_state(saved)
        return saved, first

    def _locate_failure(self, saved: list[bytes], first: int, count: int) -> tuple[int, Stop]:
        """Repeat a chunk up to the step that fails a check; return its number and the stop."""
        before, step = self._before_the_failure(saved, first, count, self._fails)
        amplitudes = self.stepper.amplitudes(step, 1)
        solved = self.advance(amplitudes, step, 1) == 1
        if self.arrays.kernel_laws and not np.isfinite(self.arrays.step.points.state.multiplier).all():
            stop = self._stop_without_multiplier(amplitudes, before, step)
            if stop is not None:
                return step, stop
        stops = (part.stop(self.model) for part in self.arrays.parts)
        if (found := next(filter(None, stops), None)) is not None:
            node, what, cause = found
            return step, Stop(step, node, "unstable step", what, cause)
        return step, self._stop_by_a_body(before, step) or self._stop_after(step, solved=solved)

    def _stop_after(self, step: int, *, solved: bool) -> Stop:
        """Return the reason for which the run stopped after a step, and the node at which it shows most."""
        total = self.totals
        allowed = total.growth * (total.began_with + total.largest_work) + total.floor
        contact_work_exceeded = not total.contact_work <= allowed + NOISE * total.step_energy
        points, boundary = self.arrays.step.points, self.arrays.step.boundary
        multiplier = points.state.multiplier
        active = (
            np.flatnonzero(multiplier != 0.0) if contact_work_exceeded or not solved else np.zeros(0, dtype=np.int64)
        )
        node = int(np.argmax(np.abs(self.v))) // self.dim
        if active.size:
            worst = int(active[np.argmax(np.abs(multiplier[active]))])
            node = int(boundary[points.entries[points.row[worst].start].place].dof) // self.dim
        finite = np.isfinite(self.u) & np.isfinite(self.v)
        kind: Kind
        if contact_work_exceeded:
            kind, description = "contact work", "the work of the contacts is many times all energy put in"
        elif not solved:
            kind = "not solved"
            description = f"the equation of contacts that share an end was not solved in {SWEEPS} sweeps"
        else:
            kind, description = "energy", "the kinetic energy is many times all energy put in"
            if not self._kinetic(self.v) + total.began_with + total.largest_work + total.step_energy < LARGEST_ENERGY:
                description = f"the energy exceeds {LARGEST_ENERGY:g}, beyond which numbers overflow"
        if not finite.all():
            node, description = int(np.argmin(finite)) // self.dim, "a value is no longer finite"
        return Stop(step, node, kind, description)

    @contextmanager
    def _as_it_was(self, before: list[bytes]) -> Iterator[None]:
        """Put the state of the run back to an earlier one for a while."""
        after = self._saved_state()
        self._restore_state(before)
        yield
        self._restore_state(after)

    def _stop_by_a_body(self, before: list[bytes], step: int) -> Stop | None:
        """Return the stop by a kernel of an element or a material that gave no finite number in this step, or None."""
        failed = ~np.isfinite(self.v).reshape(-1, self.dim).all(axis=1)
        if not failed.any():
            return None
        with self._as_it_was(before):
            u, v = self.u.reshape(-1, self.dim), self.v.reshape(-1, self.dim)
            inverted = diagnosis.stop_by_inversion(self.model, u, v, failed, step)
            return inverted or diagnosis.stop_by_a_body(self.model, u, failed, step)

    def _stop_without_multiplier(self, amplitudes: Any, before: list[bytes], step: int) -> Stop | None:
        """Return the stop caused by a kernel that left a contact without a multiplier in this step, or None."""
        with self._as_it_was(before):
            failure = diagnosis.missing_multiplier(self, amplitudes, step)
        if failure is None:
            return None
        points = self.model.contact_points
        node = points.nodes_of(points.names.index(failure.contact))[0]
        return Stop(step, node, "kernel", failure.description, failure.cause)
