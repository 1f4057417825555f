"""The time loop: binds the parts into one compiled loop and drives it in chunks, watching what comes out."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.compiling import compile_seconds
from percuss.errors import PercussError
from percuss.interrupt import interruptible
from percuss.methods.interfaces import LinearLaw
from percuss.solver import diagnosis, recording
from percuss.solver.build import Kernels, LoopParts, bind, bind_plain
from percuss.solver.compiled import bulk, custom_laws, leapfrog_loop
from percuss.solver.compiled.contact_equation import NEVER, SWEEPS
from percuss.solver.compiler.specialise import compile_error
from percuss.solver.contact_rows import carry_over, point_records
from percuss.solver.leapfrog import LeapFrogStepper
from percuss.solver.multistage import MultistageStepper
from percuss.solver.stepper import Loop, Stepper
from percuss.solver.stop import Kind, Stop

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats
    from percuss.solver.model import Model

CHUNK_SECONDS = 0.5
CHUNK_STEPS = 65536
GROWTH = 9.0  # contact may not add more than this times all energy put in: then the run has run away
KINETIC_GROWTH = 100.0
HUGE = 1e300  # energies beyond are no longer finite a step later, or already, summed in another order
SILENT_STRAIN = 1e-10  # energies below that of this strain everywhere are noise

Progress = Callable[[int, int], None]


@dataclass
class Outcome:
    """What a march leaves behind; points in the order of the loop."""

    records: int  # complete rows of `record`
    time: Floats
    record: leapfrog_loop.Record
    points: Any  # percuss.solver.compiled.contact_equation.POINT, summed over the steps before t_N
    starting_velocity: Floats  # at -dt/2
    energy_before: float  # kinetic and elastic energy at -dt/2
    totals: Any  # percuss.solver.compiled.leapfrog_loop.TOTAL, one, as they stood before the trial step
    load_impulse: Floats
    kernels: Kernels
    seconds: dict[str, float]
    status: str = "done"  # or "interrupted" or "unstable"
    done: int = 0  # steps marched, without the trial step
    reactions: Any = None  # sums over the steps, one a hold of the model
    final_velocity: Any = None  # at t_N - dt/2
    final_displacement: Any = None  # at t_N
    stop: Stop | None = None


class March:
    """One run of a model.

    Parameters
    ----------
    model
        The model to march.
    compiled
        Whether to compile the loop where it can be compiled.
    kernels
        The bound loop of another march of this model; by default it is bound anew.
    """

    def __init__(self, model: Model, *, compiled: bool = True, kernels: Kernels | None = None) -> None:
        started = time.perf_counter()
        self.model = model
        self.dim = model.dim
        self.order, self.law_records = model.law_records(model.delassus(0.5 * model.dt))
        self._arrays()
        self.kernels = kernels or bind(self.parts, compiled=compiled)
        self.seconds = {"build": time.perf_counter() - started}

    def _arrays(self) -> None:
        model, dim = self.model, self.dim
        self.probes = self._probe_nodes()
        contact_pair = [node for m in model.contact_pairs for node in m.nodes]
        acted = [hold.node for hold in model.constraints] + [push.node for push in model.nodal_forces]
        self.reactions = np.zeros(len(model.constraints))
        self.boundary_nodes = list(dict.fromkeys([*contact_pair, *acted, *self.probes]))
        self.place = {node: k * dim for k, node in enumerate(self.boundary_nodes)}
        self.stepper: Stepper = (
            LeapFrogStepper(model) if model.stages is None else MultistageStepper(model, model.stages)
        )
        self.u, self.v = self.stepper.u, self.stepper.v
        mass = np.repeat(model.mass, dim)
        self.bulk = bulk.Bulk(mass, 1.0 / mass, np.zeros((bulk.BLOCK + 2) * dim))
        self.groups, kinds = self._groups()
        count = len(model.contact_pairs)
        self.own_laws = [entry for entry in model.laws if not isinstance(entry["bound"], LinearLaw)]
        self.parts = LoopParts(
            kinds,
            self.groups,
            self.own_laws,
            None if model.stages is None else model.case.method.integrator,
            dim,
            constrained=bool(model.constraints),
            loaded=bool(model.nodal_forces or model.body_forces),
        )
        self.record, self.time = recording.prepared(model, self.probes, self.place, count)
        self._kept: list[Any] = []
        number = {n: model.body_of(n).number for n in self.boundary_nodes}
        dofs = [
            (n * dim + d, model.mass[n], number[n] * dim + d, 0, 0, 0, 0)
            for n in self.boundary_nodes
            for d in range(dim)
        ]
        self.boundary = self._acting(0.5 * model.dt, records(dofs, leapfrog_loop.BOUNDARY_DOF))
        self._renew(0.5 * model.dt)

    def _probe_nodes(self) -> list[int]:
        probes = self.model.case.record.probes
        if probes is None:
            return list(dict.fromkeys(node for m in self.model.contact_pairs for node in m.nodes))
        return [self.model.node(address) for address in probes]

    def _momenta(self) -> Floats:
        mass = self.model.mass[:, None]
        v = self.v.reshape(-1, self.dim)
        return np.concatenate(
            [(mass[b.start : b.stop] * v[b.start : b.stop]).sum(axis=0) for b in self.model.bodies.values()]
        )

    def _groups(self) -> tuple[list[bulk.Group], list[tuple[Any, Any]]]:
        """Gather the bodies that share element and material classes, and bind their elements."""
        from percuss.methods.interfaces import BodyMesh

        kinds: dict[tuple[type, type], list[Any]] = {}
        for body in self.model.bodies.values():
            kinds.setdefault((type(body.spec.element), type(body.spec.material)), []).append(body)
        groups = []
        for bodies in kinds.values():
            bound = [b.spec.element.bind(BodyMesh(b.mesh, b.spec.area)) for b in bodies]
            arrays = type(bound[0])(*(_frozen(np.concatenate(columns)) for columns in zip(*bound, strict=True)))
            counts = [b.stiffness.size for b in bodies]
            groups.append(
                bulk.Group(
                    arrays,
                    _frozen(np.array([b.spec.material.parameters() for b in bodies], dtype=float)),
                    np.array([b.number for b in bodies], dtype=np.int64),
                    np.array([b.start for b in bodies], dtype=np.int64),
                    np.array([b.stop for b in bodies], dtype=np.int64),
                    np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64),
                )
            )
        return groups, list(kinds)

    def _acting(self, midpoint: float, boundary_dofs: Any) -> leapfrog_loop.Boundary:
        """Return the boundary for a run of steps with the same drives; its sums start at zero."""
        model, dim = self.model, self.dim
        active = [
            (row, h) for row, h in enumerate(model.constraints) if self.stepper.keeps_constraints or h.active(midpoint)
        ]
        self.held = [row for row, _ in active]
        sides = model.sides(midpoint)
        sides = [sides[p] for p in self.order]
        law_records = self.law_records.copy()
        law_records["always"][np.isin(self.order, model.resting(midpoint))] = NEVER
        points, entries, others = point_records(
            law_records, [model.contact_pairs[p].gap for p in self.order], sides, self.place
        )
        self.bound = custom_laws.nest(self.own_laws, points, others)
        constraints = [
            (self.place[h.node], i * dim, model.mass[h.node], h.column, 0.0) for i, (_, h) in enumerate(active)
        ]
        shares = [
            (i, p, float(h.direction @ side.normal))
            for i, (_, h) in enumerate(active)
            for p, row in enumerate(sides)
            for side in row
            if side.node == h.node and h.active(midpoint)
        ]
        nodal_forces = [
            (self.place[f.node], i * dim, 1.0 / model.mass[f.node], f.column)
            for i, f in enumerate(model.nodal_forces, start=len(active))
        ]
        axes = [h.direction for _, h in active] + [f.force for f in model.nodal_forces]
        return leapfrog_loop.Boundary(
            boundary_dofs,
            points,
            entries,
            others,
            records(constraints, leapfrog_loop.CONSTRAINT),
            records(shares, leapfrog_loop.SHARE),
            records(nodal_forces, leapfrog_loop.NODAL_FORCE),
            np.array(axes, dtype=float).ravel(),
            np.zeros(1, dtype=leapfrog_loop.TOTAL).view(np.recarray),
            np.zeros(len(model.bodies) * dim if model.body_forces else 0),
            self._momenta() if model.body_forces else np.zeros(0),
        )

    def switch(self, midpoint: float) -> None:
        """Change over to the drives that hold and the laws that act at `midpoint`, with all sums going on."""
        before = self.boundary
        self._bank()
        fresh = self._acting(midpoint, before.boundary_dofs)
        carry_over(before.points, fresh.points)
        self.boundary = fresh._replace(totals=before.totals)
        self._renew(midpoint)

    def _renew(self, midpoint: float) -> None:
        self.stepper.renew(Loop(self._nested(), self.bulk, self.boundary, self.bound, midpoint))

    def _bank(self) -> None:
        """Add the reactions summed so far to those of the constraints of the model."""
        for row, one in zip(self.held, self.boundary.constraints, strict=True):
            self.reactions[row] += one.reaction
        self.boundary.constraints["reaction"] = 0.0

    # -- the march ---------------------------------------------------------------------------------------

    def run(self, progress: Progress | None = None, *, marginal: bool = False) -> Outcome:
        """March to the end, or to the stop.

        Parameters
        ----------
        progress
            Called with (steps done, steps in all) between chunks.
        marginal
            Whether the step is the critical one, at which the highest frequency of a bar may grow with time.
        """
        started = time.perf_counter()
        self.compile()
        self._begin()
        settled, compiled = time.perf_counter(), compile_seconds()
        self.seconds["compile"] = settled - started
        out = self._nothing_yet()
        self._marginal = marginal
        total = self.boundary.totals[0]
        total.energy_before = self._kinetic(self.v)
        total.began_with = max(self.initial_energy(), total.energy_before)
        total.growth, total.floor = GROWTH, self.noise() if self.model.case.time.on_unstable == "stop" else np.inf
        # plain Python warns of what compiled code passes over, and the watch sees to
        with interruptible() as interrupted, np.errstate(all="ignore"):
            self._march(out, progress, interrupted)
            self._bank()
            out.reactions, out.final_velocity = self.reactions.copy(), self.v.copy()
            out.final_displacement = self.u.copy()
            out.points = self.boundary.points.copy()
            out.totals = self.boundary.totals.copy()
            out.energy_before = float(out.totals[0].energy_before)
            if out.status != "unstable":
                self._trial(out.done)
        every = self.record.every
        if out.status == "done":
            out.records = self.time.size
        else:  # the record of the last step done is complete only where a trial step followed
            out.records = -(-out.done // every) if out.status == "unstable" else out.done // every + 1
        self.seconds["march"] = time.perf_counter() - settled - (compile_seconds() - compiled)
        return out

    def _begin(self) -> None:
        """Prepare the first step; an error of a kernel is told with its place."""
        try:
            self.stepper.start(self.kernels)
        except (PercussError, MemoryError):
            raise
        except Exception as raised:
            raise diagnosis.told(self, self.stepper.amplitudes(0, 1), 0, raised) from raised

    def refuse(self, stop: Stop) -> Outcome:
        """Return what a march leaves that is not made."""
        out = self._nothing_yet()
        out.status, out.stop, out.reactions = "unstable", stop, self.reactions
        out.final_velocity, out.final_displacement = self.v, self.u
        self.seconds |= {"compile": 0.0, "march": 0.0}
        return out

    def _nothing_yet(self) -> Outcome:
        return Outcome(
            records=0,
            time=self.time,
            record=self.record,
            points=self.boundary.points,
            starting_velocity=self.v.copy(),
            energy_before=0.0,
            totals=self.boundary.totals,
            load_impulse=np.zeros(self.dim),
            kernels=self.kernels,
            seconds=self.seconds,
        )

    def _march(self, out: Outcome, progress: Progress | None, interrupted: threading.Event) -> None:
        model = self.model
        for first, last in model.segments():
            if first > 0:
                self.switch((first + 0.5) * model.dt)
            for at, count in self._chunks(first, min(last, model.steps)):
                drive = self.stepper.amplitudes(at, count)
                kept = self._copy()
                if self._advanced(drive, kept, at, count) < count or not self._sound():
                    out.status, (out.done, out.stop) = "unstable", self._locate(drive, kept, at, count)
                    return
                out.done += count
                out.load_impulse = self.stepper.load_impulse(drive)
                if progress is not None:
                    progress(out.done, model.steps)
                if interrupted.is_set() and out.done < model.steps:
                    out.status = "interrupted"
                    return

    def _trial(self, step: int) -> None:
        """Evaluate one step beyond the last: it completes the last record."""
        for first, last in self.model.segments():
            if first == step > 0:
                self.switch((first + 0.5) * self.model.dt)
            if first <= step < last:
                self._advanced(self.stepper.amplitudes(step, 1), self._copy(), step, 1)

    def _advanced(self, drive: Any, kept: list[Any], first: int, count: int) -> int:
        """March as `advance` does; an error that a kernel raises is told with its place, step and time.

        Raises
        ------
        PluginError
            If a kernel raises an error.
        """
        try:
            return self.advance(drive, first, count)
        except (PercussError, MemoryError):
            raise
        except Exception as raised:
            self._restore(kept)
            for s in range(count):
                row = type(drive)(*(part[s : s + 1] for part in drive))
                before = [array.copy() for array in self.changing()]
                try:
                    self.advance(row, first + s, 1)
                except Exception as error:  # noqa: BLE001  a kernel may raise anything
                    self._restore(before)
                    raise diagnosis.told(self, row, first + s, error) from raised
            raise

    def advance(self, drive: Any, first: int, count: int) -> int:
        """March `count` steps; return how many were done when one was not sound, else `count`.

        Parameters
        ----------
        drive
            Amplitudes of the loads in these steps.
        first
            Number of the first step.
        count
            How many.
        """
        return self.stepper.advance(self.kernels, drive, self.record, first, count)

    def _nested(self) -> Any:
        """The groups as the loop reads them: (group, (group, ...))."""
        nested: Any = self.groups[-1]
        for group in reversed(self.groups[:-1]):
            nested = (group, nested)
        return nested

    def compile(self) -> None:
        """Compile by marching no steps; where a kernel cannot be compiled, the loop runs as plain Python."""
        error = self._failure()
        if error is not None:
            diagnosis.refuse_writing(error)
            self.kernels = bind(self.parts, counting=True)
            error = self._failure()
        if error is not None:
            self.kernels = bind_plain(error, self.parts, self.u.copy(), self.v.copy(), self.model.dt)

    def _failure(self) -> Exception | None:
        """Compile by marching no steps; return why that is not possible, or None."""
        if self.kernels.compiled:
            try:
                self.advance(self.stepper.amplitudes(0, 0), 0, 0)
            except compile_error() as error:
                return error
        return None

    def _chunks(self, first: int, last: int) -> Iterator[tuple[int, int]]:
        cost = (1.2e-9 if self.kernels.compiled else 2e-6) * (self.u.size + 150)
        width = len(self.model.case.loads) + len(self.model.bodies) * self.dim + 1
        size = int(max(1, min(CHUNK_STEPS, CHUNK_SECONDS / cost, 4_000_000 / width)))
        at = first
        while at < last:
            count = min(size, last - at)
            yield at, count
            at += count

    def initial_energy(self) -> float:
        """Return the kinetic energy at t = 0."""
        return self._kinetic(self.model.initial_velocity.ravel())

    def _kinetic(self, v: Floats) -> float:
        # not `@`: from some ten thousand entries on BLAS wakes threads, which costs more than the sum
        return 0.5 * float(np.einsum("i,i,i", self.bulk.mass, v, v))

    def noise(self) -> float:
        """Return an energy that is nothing: that of a strain of `SILENT_STRAIN` everywhere."""
        stiff = sum(float((b.stiffness * b.mesh.lengths**2).sum()) for b in self.model.bodies.values())
        return 0.5 * stiff * SILENT_STRAIN**2

    # -- watching ----------------------------------------------------------------------------------------

    def _sound(self) -> bool:
        """Return whether the state is finite and no more energetic than what was put in allows."""
        total = self.boundary.totals[0]
        put_in = total.began_with + total.largest_work + max(total.contact_work, 0.0)
        kinetic = self._kinetic(self.v)
        allowed = KINETIC_GROWTH * put_in + total.floor + leapfrog_loop.NOISE * total.step_energy
        return bool(kinetic < HUGE and (self._marginal or kinetic <= allowed))

    def changing(self) -> list[Any]:
        """Return the arrays that a step changes, in an order of its own."""
        boundary = self.boundary
        return [*self.stepper.changing(), boundary.points, boundary.constraints, boundary.totals, boundary.before]

    def _copy(self) -> list[Any]:
        """Return what a step changes, as it is now; written over by the next call."""
        now = self.changing()
        if not self._kept:
            self._kept = [array.copy() for array in now]
        for k, array in enumerate(now):
            if self._kept[k].shape == array.shape:
                np.copyto(self._kept[k], array)
            else:  # other drives hold now
                self._kept[k] = array.copy()
        return self._kept

    def _locate(self, drive: Any, kept: list[Any], first: int, count: int) -> tuple[int, Stop]:
        """March the chunk again, a step at a time, up to the first step that is not sound."""
        self._restore(kept)
        for s in range(count):
            row = type(drive)(*(part[s : s + 1] for part in drive))
            before = [array.copy() for array in self.changing()] if self.own_laws else []
            solved = self.advance(row, first + s, 1) == 1
            if not solved or not self._sound():
                break
        if self.own_laws and not np.isfinite(self.boundary.points.multiplier).all():
            unset = self._unset(row, before, first + s)
            if unset is not None:
                return first + s, unset
        return first + s, self._stop(first + s, solved=solved)

    def _stop(self, step: int, *, solved: bool) -> Stop:
        """Return what is wrong after a step, and where it shows most."""
        total = self.boundary.totals[0]
        allowed = total.growth * (total.began_with + total.largest_work) + total.floor
        by_contact = not total.contact_work <= allowed + leapfrog_loop.NOISE * total.step_energy
        points = self.boundary.points
        pressing = np.flatnonzero(points.multiplier != 0.0) if by_contact or not solved else np.zeros(0, dtype=np.int64)
        node = int(np.argmax(np.abs(self.v))) // self.dim
        if pressing.size:
            worst = int(pressing[np.argmax(np.abs(points.multiplier[pressing]))])
            node = int(self.boundary.boundary_dofs[self.boundary.entries[points[worst].start].place].dof) // self.dim
        finite = np.isfinite(self.u) & np.isfinite(self.v)
        kind: Kind
        if by_contact:
            kind, what = "contact work", "the work of the contacts exceeds all energy put in many times"
        elif not solved:
            kind, what = "not solved", f"the equation of contacts that share an end was not solved in {SWEEPS} sweeps"
        else:
            kind, what = "energy", "the kinetic energy exceeds all energy put in many times"
        if not finite.all():
            node, what = int(np.argmin(finite)) // self.dim, "a value is no longer finite"
        return Stop(step, node, kind, what)

    def _unset(self, drive: Any, before: list[Any], step: int) -> Stop | None:
        """Return how a run stopped, where the kernel of a law left a contact without a multiplier, else None."""
        after = [array.copy() for array in self.changing()]
        self._restore(before)
        fault = diagnosis.without_multiplier(self, drive, step)
        self._restore(after)
        if fault is None:
            return None
        (contact_pair,) = (one for one in self.model.contact_pairs if one.name == fault.contact)
        return Stop(step, contact_pair.nodes[0], "kernel", fault.what, fault.cause)

    def _restore(self, values: list[Any]) -> None:
        for array, value in zip(self.changing(), values, strict=True):
            array[:] = value


def records(rows: list[tuple[Any, ...]], kind: Any) -> Any:
    """Return a record array of `kind`."""
    return np.array(rows, dtype=kind).view(np.recarray)


def _frozen(array: Any) -> Any:
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array
