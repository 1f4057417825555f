"""A row of bars as the arrays of the event loop."""

from __future__ import annotations

from typing import Any

import numpy as np

from percuss_methods.solutions import _fronts as fronts
from percuss_methods.solutions._fronts import ABSENT, DRIVEN, FREE, WALL
from percuss_methods.solutions._polynomials import FIT, PiecewisePolynomial, load_history, total, widened


class RowOfBars:
    """The arrays of a row of bars: junctions, histories, loads; along each bar's own axis from left to right.

    A junction's first side is where a wave to the right arrives. A bar may point either way along the line, so its
    coordinate is turned to that of the first bar it meets: `flip` is -1 where it points against the line.
    """

    def __init__(self, model: Any) -> None:
        self.model = model
        self.bodies = list(model.bodies.values())
        line = self.bodies[0].mesh.direction
        self.flip = np.array([1.0 if body.mesh.direction @ line > 0 else -1.0 for body in self.bodies])
        materials = [body.spec.material for body in self.bodies]
        self.length = np.array([float(body.mesh.lengths.sum()) for body in self.bodies])
        self.speed = np.array([np.sqrt(m.modulus / m.rho) for m in materials])
        self.transit = self.length / self.speed
        self.impedance = np.array(
            [b.spec.area * np.sqrt(m.modulus * m.rho) for b, m in zip(self.bodies, materials, strict=True)]
        )
        self.gravity = np.zeros(len(self.bodies))
        for pull in model.body_forces:
            amplitude = float(model.amplitude(pull.load, np.zeros(1), average=False)[0])
            axis = self.bodies[pull.body].mesh.direction * self.flip[pull.body]
            self.gravity[pull.body] += amplitude * float(pull.acceleration @ axis)
        self.velocity = np.array(
            [float(b.velocity @ b.mesh.direction) * f for b, f in zip(self.bodies, self.flip, strict=True)]
        )
        self._junctions()

    def end_of(self, node: int) -> tuple[int, int]:
        """Return (bar, which end): 1 for its end to the right, 0 for that to the left, on the common line."""
        for b, body in enumerate(self.bodies):
            if body.start <= node < body.stop:
                right = (node != body.start) == (self.flip[b] > 0)
                return b, int(right)
        raise AssertionError(node)

    def _ends(self) -> dict[tuple[int, int], tuple[int, int]]:
        """Return of each end of each bar its kind, and the history of what acts on it (-1 for none)."""
        self.functions: list[list[Any]] = []  # (factor, load) that add up to one history
        held = {hold.node: hold for hold in self.model.constraints}
        pushed: dict[int, list[Any]] = {}
        for push in self.model.nodal_forces:
            pushed.setdefault(push.node, []).append(push)
        kinds = {}
        for b, body in enumerate(self.bodies):
            axis = body.mesh.direction * self.flip[b]
            for node in (body.start, body.stop - 1):
                if node in held:
                    hold = held[node]
                    terms = [(float(hold.direction @ axis), hold.load)] if hold.load is not None else []
                else:
                    terms = [(float(push.force @ axis), push.load) for push in pushed.get(node, [])]
                self.functions += [terms] if terms else []
                place = len(self.functions) - 1 if terms else -1
                kinds[self.end_of(node)] = (DRIVEN if node in held else FREE, place)
        return kinds

    def _junctions(self) -> None:
        kinds = self._ends()
        sides: list[list[list[int]]] = []
        contact, gaps, self.contact_names = [], [], []
        done: set[tuple[int, int]] = set()

        def side(at: tuple[int, int]) -> list[int]:
            b, right = at
            kind, place = kinds[at]
            # to the right end arrives what left the left one (history 2b), and 2b + 1 leaves
            return [2 * b + (0 if right else 1), 2 * b + (1 if right else 0), place, kind, -1, b]

        absent = [-1, -1, -1, ABSENT, -1, -1]
        for contact_pair in self.model.contact_pairs:
            ends = [self.end_of(node) for node in contact_pair.nodes]
            done |= set(ends)
            pair = [absent[:], absent[:]]
            for at in ends:
                pair[0 if at[1] else 1] = side(at)
            if len(ends) == 1:
                pair[1 if ends[0][1] else 0][3] = WALL
            sides.append(pair)
            contact.append(1)
            gaps.append(contact_pair.gap)
            self.contact_names.append(contact_pair.name)
        for at in sorted(kinds):
            if at not in done:
                pair = [absent[:], absent[:]]
                pair[0 if at[1] else 1] = side(at)
                sides.append(pair)
                contact.append(0)
                gaps.append(0.0)
        home = {(s[5], k): j for j, pair in enumerate(sides) for k, s in enumerate(pair) if s[5] >= 0}
        for pair in sides:
            for k, s in enumerate(pair):
                if s[5] >= 0:
                    s[4] = home[s[5], 1 - k]
        whole = np.array(sides, dtype=np.int64).reshape(-1, 2, 6)
        self.side, self.bar = np.ascontiguousarray(whole[:, :, :5]), whole[:, :, 5]
        self.is_contact = np.array(contact, dtype=np.int64)
        self.is_free, self.is_wall = (self.side[:, :, fronts.KIND] == kind for kind in (FREE, WALL))
        self.gaps = np.array(gaps)

    def _sizes(self, end: float) -> Any:
        """Return the size of the velocities at either side of each junction, by what starts or acts there itself."""
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

    def _load_histories(self, end: float, quantum: float, most: int) -> tuple[float, str]:
        """Work out what acts on the ends; return up to when it is known, and why not farther."""
        parts = [[load_history(factor, spec, end, quantum, most) for factor, spec in terms] for terms in self.functions]
        shortest = min((part for terms in parts for part in terms), key=lambda part: part.known, default=None)
        made = [total([(part.times, part.pieces) for part in terms]) for terms in parts]
        width = max([len(times) for times, _ in made], default=1)
        terms = max([2, *(pieces.shape[1] for _, pieces in made)])
        times = np.full((max(len(made), 1), width), np.inf)
        pieces = np.zeros((max(len(made), 1), width, terms))
        count = np.zeros(max(len(made), 1), dtype=np.int64)
        for k, (t, c) in enumerate(made):
            times[k, : len(t)], pieces[k, : len(t)], count[k] = t, widened(c, terms), len(t)
        self.loads = fronts.Histories(times, pieces, count)
        return (end, "") if shortest is None else (min(shortest.known, end), shortest.reason)

    def march(self, end: float, most: int) -> None:
        """Work the events off, up to `end`, or as far as the loads are known or `most` fronts suffice."""
        quantum = 2.0 ** (np.ceil(np.log2(end)) - 52)
        end, self.stopped = self._load_histories(end, quantum, most)
        self.transit = np.maximum(np.rint(self.transit / quantum), 1.0) * quantum
        self.speed = self.length / self.transit
        safe = np.maximum(self.bar, 0)
        self.number = np.stack([self.transit[safe], self.impedance[safe], self.gravity[safe]], axis=2)

        junctions, bars, terms = self.side.shape[0], len(self.bodies), self.loads.pieces.shape[2]
        capacity = 256
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
            np.full((junctions, capacity), np.inf),
            np.zeros((junctions, capacity, terms)),
            np.zeros((junctions, capacity), dtype=np.int64),
            np.zeros(junctions, dtype=np.int64),
        )
        row = fronts.Row(
            self.side,
            self.number,
            self.is_contact,
            ((self.is_contact == 1) & (self.gaps == 0.0)).astype(np.int64),
            self.gaps.copy(),
            np.zeros(junctions),
            np.zeros((junctions, 4), dtype=np.int64),
            self._sizes(end),
        )
        curved = bool(self.loads.pieces[:, :, 2:].any())  # then the loads are followed to FIT only
        limits = fronts.Limits(end, 10.0 * FIT if curved else 1e-13, quantum)
        status = fronts.march(row, waves, self.loads, forces, limits)
        while status == fronts.FULL and waves.count.sum() <= most:
            waves = fronts.Histories(_grown(waves.times, np.inf), _grown(waves.pieces), waves.count)
            forces = fronts.Forces(
                _grown(forces.times, np.inf), _grown(forces.pieces), _grown(forces.closed), forces.count
            )
            status = fronts.march(row, waves, self.loads, forces, limits)
        give = np.where(self.side[:, :, fronts.KIND] == FREE, 1.0 / self.impedance[safe], 0.0).sum(axis=1)
        # a smaller force is none
        self.slight = limits.tolerance * row.size.max(axis=1) / np.where(give > 0.0, give, np.inf)
        self.waves, self.forces = waves, forces
        self.reached = min(float(row.clock.min()), end)
        self.fronts = int(waves.count.sum())
        if status == fronts.FULL:
            self.stopped = f"it takes more than {most} fronts (most_fronts)"
        elif status == fronts.STUCK:
            j = int(row.clock.argmin())
            where = f"contact '{self.contact_names[j]}'" if j < len(self.contact_names) else "an end of a bar"
            self.stopped = f"{fronts.MOST_AT_ONCE} events follow each other in no time at {where}"

    def load(self, place: int) -> PiecewisePolynomial:
        """Return what acts on an end."""
        n = self.loads.count[place]
        return PiecewisePolynomial(self.loads.times[place, :n], self.loads.pieces[place, :n])

    def force(self, j: int) -> PiecewisePolynomial:
        """Return the contact force of a junction."""
        n = self.forces.count[j]
        return PiecewisePolynomial(self.forces.times[j, :n], self.forces.pieces[j, :n])


def _grown(array: Any, fill: float = 0.0) -> Any:
    wider = np.full((array.shape[0], 2 * array.shape[1], *array.shape[2:]), fill, dtype=array.dtype)
    wider[:, : array.shape[1]] = array
    return wider
