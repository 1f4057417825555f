"""A row of bars as the arrays of the event loop."""

from __future__ import annotations

from typing import Any

import numpy as np

from percuss_methods.solutions import _fronts as fronts
from percuss_methods.solutions._cubics import FIT, Cubics, load_pieces, sum_of_pieces
from percuss_methods.solutions._fronts import ABSENT, DRIVEN, FREE, WALL


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
        for pull in model.pulls:
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
        held = {hold.node: hold for hold in self.model.holds}
        pushed: dict[int, list[Any]] = {}
        for push in self.model.pushes:
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
        for meeting in self.model.meetings:
            ends = [self.end_of(node) for node in meeting.nodes]
            done |= set(ends)
            pair = [absent[:], absent[:]]
            for at in ends:
                pair[0 if at[1] else 1] = side(at)
            if len(ends) == 1:
                pair[1 if ends[0][1] else 0][3] = WALL
            sides.append(pair)
            contact.append(1)
            gaps.append(meeting.gap)
            self.contact_names.append(meeting.name)
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
        self.gaps = np.array(gaps)

    def _scale(self, end: float) -> float:
        """Return the size of a velocity."""
        sizes = [float(np.abs(self.velocity).max(initial=0.0))]
        softest = float(self.impedance.min())
        for k, terms in enumerate(self.functions):
            n = self.loads.count[k]
            spans = np.diff(np.append(self.loads.times[k, :n], end))
            peak = float((np.abs(self.loads.pieces[k, :n]) * spans[:, None] ** np.arange(4)).sum(axis=1).max())
            sizes.append(peak if terms[0][1].acts_as == "velocity" else peak / softest)
        sizes.append(float(np.abs(self.gravity).max(initial=0.0)) * float(self.transit.max()))
        return max(sizes) or 1.0

    def _load_histories(self, end: float) -> tuple[Any, Any, Any, float]:
        """Return times, cubic pieces and counts of what acts on the ends, and up to when they hold."""
        parts = [[load_pieces(factor, spec, end) for factor, spec in terms] for terms in self.functions]
        known = min([one[2] for part in parts for one in part], default=end)
        made = [sum_of_pieces([one[:2] for one in part]) for part in parts]
        width = max([len(times) for times, _ in made], default=1)
        times = np.full((max(len(made), 1), width), np.inf)
        pieces = np.zeros((max(len(made), 1), width, 4))
        count = np.zeros(max(len(made), 1), dtype=np.int64)
        for k, (t, c) in enumerate(made):
            times[k, : len(t)], pieces[k, : len(t)], count[k] = t, c, len(t)
        return times, pieces, count, known

    def march(self, end: float, most: int) -> None:
        """Work the events off."""
        times, pieces, count, end = self._load_histories(end)
        quantum = 2.0 ** (np.ceil(np.log2(end)) - 52)
        self.transit = np.maximum(np.rint(self.transit / quantum), 1.0) * quantum
        self.speed = self.length / self.transit
        safe = np.maximum(self.bar, 0)
        self.number = np.stack([self.transit[safe], self.impedance[safe], self.gravity[safe]], axis=2)

        junctions, bars = self.side.shape[0], len(self.bodies)
        capacity = 256
        waves = fronts.Histories(
            np.full((2 * bars, capacity), np.inf), np.zeros((2 * bars, capacity, 4)), np.ones(2 * bars, dtype=np.int64)
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
            np.zeros((junctions, capacity, 4)),
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
        )
        times = np.where(np.isfinite(times), np.rint(times / quantum) * quantum, np.inf)
        self.loads = fronts.Histories(times, pieces, count)
        scale = self._scale(end)
        curved = bool(self.loads.pieces[:, :, 2:].any())  # then the loads are followed to FIT only
        limits = fronts.Limits(end, scale, (10.0 * FIT if curved else 1e-13) * scale, quantum)
        give = np.where(self.side[:, :, fronts.KIND] == FREE, 1.0 / self.impedance[safe], 0.0).sum(axis=1)
        self.slight = limits.tolerance / np.where(give > 0.0, give, np.inf)  # a smaller force is none
        while fronts.march(row, waves, self.loads, forces, limits) == fronts.FULL and waves.count.sum() <= most:
            waves = fronts.Histories(_grown(waves.times, np.inf), _grown(waves.pieces), waves.count)
            forces = fronts.Forces(
                _grown(forces.times, np.inf), _grown(forces.pieces), _grown(forces.closed), forces.count
            )
        self.waves, self.forces = waves, forces
        self.reached = min(float(row.clock.min()), end)
        self.fronts = int(waves.count.sum())

    def force(self, j: int) -> Cubics:
        """Return the contact force of a junction."""
        n = self.forces.count[j]
        return Cubics(self.forces.times[j, :n], self.forces.pieces[j, :n])


def _grown(array: Any, fill: float = 0.0) -> Any:
    wider = np.full((array.shape[0], 2 * array.shape[1], *array.shape[2:]), fill, dtype=array.dtype)
    wider[:, : array.shape[1]] = array
    return wider
