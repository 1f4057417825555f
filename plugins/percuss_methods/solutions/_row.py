"""A chain of bars as the arrays of the event loop."""

from __future__ import annotations

import functools
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss import BodyEnd, compiled_function
from percuss_methods.solutions import _fronts as fronts
from percuss_methods.solutions._bounds import GIGABYTE, Meter, memory_of, memory_of_load, too_large, two_digits
from percuss_methods.solutions._fronts import ABSENT, DRIVEN, FREE, WALL
from percuss_methods.solutions._polynomials import FIT, PiecewisePolynomial, load_history, padded, summed

if TYPE_CHECKING:
    from percuss import ContactProblem, ProblemLoad


# Rows of at most so many junctions begin with histories of so many pieces, which plain Python fills.
FEW_JUNCTIONS, SMALL_CAPACITY = 16, 64
LARGE_CAPACITY = 256  # pieces of the histories of all other rows
LEAST_CAPACITY = 24  # where these would take much of the memory; twice and four times as many are not `SMALL_CAPACITY`
EVENTS = 65536  # between two times at which the progress is told
MOST_PLAIN_SECONDS = 2.0  # seconds that a process spends in plain Python before it compiles the event loop


class BarChain:
    """The arrays of a chain of bars: junctions, histories of waves and forces, and loads.

    Waves to the right arrive at the first side of a junction. All quantities are along the direction of the first body,
    the common line; `flip` is -1 for a bar that points against it.
    """

    def __init__(self, problem: ContactProblem, most_memory: float, meter: Meter) -> None:
        self.problem, self.meter = problem, meter
        self.most_bytes = most_memory * GIGABYTE
        self.bodies = list(problem.bodies.values())
        self._number = {name: b for b, name in enumerate(problem.bodies)}
        line = self.bodies[0].direction
        self.flip = np.array([1.0 if body.direction @ line > 0 else -1.0 for body in self.bodies])
        moduli = np.array([body.wave_modulus for body in self.bodies])
        densities = np.array([body.material.rho for body in self.bodies])
        self.length = np.array([body.length for body in self.bodies])
        self.speed = np.sqrt(moduli / densities)
        self.transit = self.length / self.speed
        self.impedance = np.array([body.area for body in self.bodies]) * np.sqrt(moduli * densities)
        self.gravity = np.zeros(len(self.bodies))
        for load in problem.loads:
            if load.end is None:
                b = self._number[load.body]
                amplitude = float(load.load.amplitude(np.zeros(1))[0])  # a covered load on a whole body is steady
                self.gravity[b] += amplitude * float(load.vector @ self._axis(b))
        self.velocity = np.array(
            [float(b.velocity @ b.direction) * f for b, f in zip(self.bodies, self.flip, strict=True)]
        )
        self._set_junctions()

    def _axis(self, b: int) -> Any:
        """Return the unit vector of a bar that points along the common line."""
        return self.bodies[b].direction * self.flip[b]

    def _place_of(self, end: BodyEnd) -> tuple[int, int]:
        """Return an end of a body as (bar, side), with side 1 for the right and 0 for the left end on the line."""
        b = self._number[end.body]
        return b, int(end.at_start == (self.flip[b] < 0))

    def _ends(self) -> dict[tuple[int, int], tuple[int, int]]:
        """Return the kind of each end of each bar, and the number of its load or velocity history, -1 for none."""
        self.functions: list[list[Any]] = []  # for each history, the pairs (factor, load) whose sum it is
        loads: dict[tuple[int, int], list[ProblemLoad]] = {}
        for load in self.problem.loads:
            if load.end is not None:
                loads.setdefault(self._place_of(load.end), []).append(load)
        fixed = {self._place_of(end) for end in self.problem.fixed}
        kinds = {}
        for b, body in enumerate(self.bodies):
            for at_start in (True, False):
                place = self._place_of(BodyEnd(body.name, at_start))
                acting = loads.get(place, [])
                drives = [load for load in acting if load.acts_as == "velocity"]
                held = bool(drives) or place in fixed  # forces on such an end do not move it
                terms = [(float(load.vector @ self._axis(b)), load) for load in (drives if held else acting)]
                self.functions += [terms] if terms else []
                history = len(self.functions) - 1 if terms else -1
                kinds[place] = (DRIVEN if held else FREE, history)
        return kinds

    def _set_junctions(self) -> None:
        """Set the arrays of the junctions: first all contacts in the order of the case, then all other ends."""
        kinds = self._ends()
        sides: list[list[list[int]]] = []
        is_contact, gaps, self.contact_names = [], [], []
        done: set[tuple[int, int]] = set()

        def side(end: tuple[int, int]) -> list[int]:
            b, right = end
            kind, history = kinds[end]
            # history 2b leaves the left end and arrives at the right end, history 2b + 1 the other way round
            return [2 * b + (0 if right else 1), 2 * b + (1 if right else 0), history, kind, -1, b]

        absent = [-1, -1, -1, ABSENT, -1, -1]
        for contact in self.problem.contacts:
            ends = [self._place_of(end) for end in contact.ends]
            done |= set(ends)
            pair = [absent[:], absent[:]]
            for end in ends:
                pair[0 if end[1] else 1] = side(end)
            if len(ends) == 1:
                pair[1 if ends[0][1] else 0][3] = WALL
            sides.append(pair)
            is_contact.append(1)
            gaps.append(contact.gap)
            self.contact_names.append(contact.name)
        for end in sorted(kinds):
            if end not in done:
                pair = [absent[:], absent[:]]
                pair[0 if end[1] else 1] = side(end)
                sides.append(pair)
                is_contact.append(0)
                gaps.append(0.0)
        junction_of = {(s[5], k): j for j, pair in enumerate(sides) for k, s in enumerate(pair) if s[5] >= 0}
        for pair in sides:
            for k, s in enumerate(pair):
                if s[5] >= 0:
                    s[4] = junction_of[s[5], 1 - k]
        columns = np.array(sides, dtype=np.int64).reshape(-1, 2, 6)
        self.side, self.bar = np.ascontiguousarray(columns[:, :, :5]), columns[:, :, 5]
        self.is_contact = np.array(is_contact, dtype=np.int64)
        self.is_free, self.is_wall = (self.side[:, :, fronts.KIND] == kind for kind in (FREE, WALL))
        self.gaps = np.array(gaps)

    def _sizes(self, end: float) -> Any:
        """Return the size of the velocities at both sides of each junction, from initial data and loads of the side."""
        sizes = np.zeros(self.side.shape[:2])
        for j, pair in enumerate(self.side):
            for k, (_, _, load, kind, _) in enumerate(pair):
                b = self.bar[j, k]
                if b < 0:
                    continue
                sizes[j, k] = max(abs(self.velocity[b]), abs(self.gravity[b]) * self.transit[b])
                if load >= 0:
                    n = self.loads.count[load]
                    spans = np.diff(np.append(self.loads.times[load, :n], end))
                    reaches = spans[:, None] ** np.arange(self.loads.pieces.shape[2])
                    peak = float((np.abs(self.loads.pieces[load, :n]) * reaches).sum(axis=1).max())
                    sizes[j, k] = max(sizes[j, k], peak if kind == DRIVEN else peak / self.impedance[b])
        return sizes

    def _load_histories(self, end: float, quantum: float, most_fronts: int) -> tuple[float, str]:
        """Compute the loads and velocities at the ends; return the time that they reach, and why they end early."""
        within = int(self.most_bytes / memory_of_load(1.0, len(self.bodies)))
        most, option = min((most_fronts, "most_fronts"), (max(within, 1), "most_memory"))
        parts = [
            [load_history(factor, spec, end, quantum, most, option, self.meter.tell) for factor, spec in terms]
            for terms in self.functions
        ]
        shortest = min((part for terms in parts for part in terms), key=lambda part: part.reached, default=None)
        histories = [summed([(part.times, part.pieces) for part in terms]) for terms in parts]
        width = max([len(times) for times, _ in histories], default=1)
        terms = max([2, *(pieces.shape[1] for _, pieces in histories)])
        times = np.full((max(len(histories), 1), width), np.inf)
        pieces = np.zeros((max(len(histories), 1), width, terms))
        count = np.zeros(max(len(histories), 1), dtype=np.int64)
        for k, (t, c) in enumerate(histories):
            times[k, : len(t)], pieces[k, : len(t)], count[k] = t, padded(c, terms), len(t)
        self.loads = fronts.Histories(times, pieces, count)
        return (end, "") if shortest is None else (min(shortest.reached, end), shortest.reason)

    def march(self, end: float, most_fronts: int) -> None:
        """Compute all events up to `end`, or as far as the loads reach or `most_fronts` fronts suffice."""
        quantum = 2.0 ** (np.ceil(np.log2(end)) - 52)
        end, self.stopped = self._load_histories(end, quantum, most_fronts)
        self.transit = np.maximum(np.rint(self.transit / quantum), 1.0) * quantum
        self.speed = self.length / self.transit
        safe = np.maximum(self.bar, 0)
        self.number = np.stack([self.transit[safe], self.impedance[safe], self.gravity[safe]], axis=2)

        junction_count, bars, terms = self.side.shape[0], len(self.bodies), self.loads.pieces.shape[2]
        capacity = SMALL_CAPACITY if junction_count <= FEW_JUNCTIONS else LARGE_CAPACITY
        if memory_of(bars, junction_count, 4 * capacity, terms, 0) > self.most_bytes:
            capacity = LEAST_CAPACITY
        waves = fronts.Histories(
            np.full((2 * bars, capacity), np.inf),
            np.zeros((2 * bars, capacity, terms)),
            np.ones(2 * bars, dtype=np.int64),
        )
        for b in range(bars):
            for h in (2 * b, 2 * b + 1):
                waves.times[h, 0] = -self.transit[b]
                waves.pieces[h, 0, :2] = (
                    0.5 * (self.velocity[b] - self.gravity[b] * self.transit[b]),
                    0.5 * self.gravity[b],
                )
        forces = fronts.Forces(
            np.full((junction_count, capacity), np.inf),
            np.zeros((junction_count, capacity, terms)),
            np.zeros((junction_count, capacity), dtype=np.int64),
            np.zeros(junction_count, dtype=np.int64),
        )
        junctions = fronts.Junctions(
            self.side,
            self.number,
            self.is_contact,
            ((self.is_contact == 1) & (self.gaps == 0.0)).astype(np.int64),
            self.gaps.copy(),
            np.zeros(junction_count),
            np.zeros((junction_count, 4), dtype=np.int64),
            self._sizes(end),
        )
        # curved loads are approximated with an error of FIT, all others are exact up to round-off
        curved = bool(self.loads.pieces[:, :, 2:].any())
        limits = fronts.Limits(end, 10.0 * FIT if curved else 1e-13, quantum)
        status, over = fronts.FULL, ""
        fresh = 1
        while status in (fronts.FULL, fronts.PAUSED) and not over:
            status = self._advance(junctions, waves, self.loads, forces, limits, fresh)
            fresh = int(status == fronts.FULL)
            share = float(junctions.clock.min()) / end
            self.meter.tell(share)
            over = self._excess(waves, forces, status, share, most_fronts)
            if status == fronts.FULL and not over:
                waves = fronts.Histories(_grown(waves.times, np.inf), _grown(waves.pieces), waves.count)
                forces = fronts.Forces(
                    _grown(forces.times, np.inf), _grown(forces.pieces), _grown(forces.closed), forces.count
                )
        admittance = np.where(self.side[:, :, fronts.KIND] == FREE, 1.0 / self.impedance[safe], 0.0).sum(axis=1)
        # a smaller contact force counts as zero
        self.negligible_force = (
            limits.tolerance * junctions.size.max(axis=1) / np.where(admittance > 0.0, admittance, np.inf)
        )
        self.waves, self.forces = waves, forces
        self.reached = min(float(junctions.clock.min()), end)
        self.fronts = int(waves.count.sum())
        if over:
            self.stopped = over
        elif status == fronts.STUCK:
            j = int(junctions.clock.argmin())
            location = f"contact '{self.contact_names[j]}'" if j < len(self.contact_names) else "an end of a bar"
            self.stopped = f"{fronts.MOST_AT_ONCE} events follow each other in no time at {location}"

    def _advance(self, *arrays: Any) -> int:
        """Compute events until the histories are full, the end is reached, or it is time to tell; return the status.

        Most rows of bars have so few fronts that plain Python takes some milliseconds, and compiling some seconds. Both
        give the same bits.
        """
        small = arrays[1].times.shape[1] == SMALL_CAPACITY
        if not small or _PlainTime.seconds > MOST_PLAIN_SECONDS:
            with self.meter.stopped():
                _compiled_march()(*arrays, 0)  # no event: this compiles
            return int(_compiled_march()(*arrays, EVENTS))
        began = time.perf_counter()
        with np.errstate(all="ignore"):
            status = fronts.march(*arrays, EVENTS)
        _PlainTime.seconds += time.perf_counter() - began
        return status

    def _excess(self, waves: Any, forces: Any, status: int, share: float, most_fronts: int) -> str:
        """Return in words which bound the histories exceed, or would exceed with more room; empty for none."""
        if status == fronts.FULL and waves.count.sum() > most_fronts:
            return f"it takes more than {most_fronts} fronts (most_fronts)"
        # While they grow, full histories stand beside those of twice the room.
        room = waves.times.shape[1] * (3 if status == fronts.FULL else 1)
        marks = forces.count.sum() + waves.count.sum() + self.loads.count.sum()
        size = memory_of(len(self.bodies), self.side.shape[0], room, waves.pieces.shape[2], marks)
        if size <= self.most_bytes:
            return ""
        needed = size / share if share > 0.0 else size
        return too_large(self.most_bytes, f"{two_digits(needed / GIGABYTE)} GB or more to the end")

    def load(self, k: int) -> PiecewisePolynomial:
        """Return the history k of a load or velocity at an end."""
        n = self.loads.count[k]
        return PiecewisePolynomial(self.loads.times[k, :n], self.loads.pieces[k, :n])

    def force(self, j: int) -> PiecewisePolynomial:
        """Return the contact force of a junction."""
        n = self.forces.count[j]
        return PiecewisePolynomial(self.forces.times[j, :n], self.forces.pieces[j, :n])


class _PlainTime:
    """Seconds that this process has spent in the event loop as plain Python."""

    seconds = 0.0


@functools.cache
def _compiled_march() -> Any:
    return compiled_function(fronts.march)


def _grown(array: Any, fill: float = 0.0) -> Any:
    """Return a copy of an array with twice the capacity, its second dimension, filled with `fill`."""
    wider = np.full((array.shape[0], 2 * array.shape[1], *array.shape[2:]), fill, dtype=array.dtype)
    wider[:, : array.shape[1]] = array
    return wider
