"""Exact solution of rows of uniform elastic bars."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from percuss import Doc, Exact, ExactContact, Ge, Solution, Unit
from percuss_methods.solutions._polynomials import PiecewisePolynomial, product

if TYPE_CHECKING:
    from collections.abc import Iterator

    from percuss import Floats
    from percuss_methods.solutions._row import RowOfBars


@dataclass(frozen=True)
class BarsInARow(Solution):
    """Exact solution by characteristics, as a finite list of events; no mesh and no time step.

    Formula: ``v = p + q``, ``force = Z (p - q)``, ``Z = A sqrt(E rho)``. A closed contact of ends a and b moves at the
    common velocity ``v = 2 (Z_a p + Z_b q) / (Z_a + Z_b)`` and presses with ``Z_a (2 p - v)``; it closes when the gap
    is used up and opens when the force would pull. Piecewise-constant and piecewise-linear data stay so and are exact;
    smooth loads are followed by polynomials to 1e-12 of their size.

    Covers uniform linear-elastic bars along one line: free, fixed and driven ends, walls, gaps or touching, initial
    velocities, loads on ends, steady acceleration.
    """

    name = "bars-in-a-row"
    summary = "Characteristics of any row of uniform elastic bars, event by event"
    references = (
        "Graff: Wave Motion in Elastic Solids, Dover 1991, ch. 2",
        "Doyen, Ern, Piperno: Time-integration schemes for the finite element dynamic Signorini problem, SIAM J. Sci. "
        "Comput. 33 (2011), doi 10.1137/100791440",
    )

    most_fronts: Annotated[int, Ge(1), Unit("1"), Doc("fronts after which it stops and states the time reached")] = (
        2_000_000
    )

    def covers(self, model: Any) -> str | None:
        """Return why a case is not covered, or None."""
        reasons = [*_of_bodies(model), *_of_loads(model)]
        nodes = [node for contact_pair in model.contact_pairs for node in contact_pair.nodes]
        if len(nodes) != len(set(nodes)):
            reasons.append("an end takes part in several contacts")
        return reasons[0] if reasons else None

    def solve(self, model: Any, end: float) -> Exact:
        """Return the exact solution of a covered case up to `end`, or up to the time that `most_fronts` allows."""
        from percuss_methods.solutions._row import RowOfBars  # numba is imported with it

        row = RowOfBars(model)
        row.march(end, self.most_fronts)
        return RowSolution(row, end)


def _of_bodies(model: Any) -> Iterator[str]:
    """Yield what about the bodies is not covered."""
    line = next(iter(model.bodies.values())).mesh.direction
    for name, body in model.bodies.items():
        if _aside(body.mesh.direction, line):
            yield f"body '{name}' lies across the first one"
        if body.spec.shape.name != "bar":
            yield f"body '{name}' is a {body.spec.shape.name}, not a bar"
        if body.velocity.any() and _aside(body.velocity, body.mesh.direction):
            yield f"body '{name}' moves across its axis"


def _of_loads(model: Any) -> Iterator[str]:
    """Yield what about the loads is not covered."""
    bodies = list(model.bodies.values())
    for push in model.nodal_forces:
        if push.load.acts_as == "acceleration":
            yield f"load '{push.load.name}' accelerates an end, which has no mass but that of its mesh"
    drives = [hold for hold in model.constraints if hold.load is not None]
    acting = [(push.load, push.force, model.body_of(push.node)) for push in model.nodal_forces]
    acting += [(hold.load, hold.direction, model.body_of(hold.node)) for hold in drives]
    acting += [(pull.load, pull.acceleration, bodies[pull.body]) for pull in model.body_forces]
    for spec, vector, body in acting:
        if _aside(vector, body.mesh.direction):
            yield f"load '{spec.name}' acts across body '{body.name}'"
        if spec.load.kinks() is None:
            yield f"load '{spec.name}' ({spec.load.name}) does not say where it is smooth"
    for hold in drives:
        if hold.load.start > 0 or hold.load.stop < np.inf:
            yield f"the drive '{hold.load.name}' is switched on or off in time"
    for pull in model.body_forces:
        if pull.load.start > 0 or pull.load.stop < np.inf or pull.load.load.name not in {"gravity", "constant"}:
            yield f"the load '{pull.load.name}' on a whole body changes in time"


def _aside(vector: Floats, axis: Floats) -> bool:
    size = float(np.linalg.norm(vector))
    return bool(size > 0 and np.linalg.norm(vector - (vector @ axis) * axis) > 1e-9 * size)


class RowContact(ExactContact):
    """The exact history of one contact."""

    def __init__(self, row: RowOfBars, junction: int, displacement: Any) -> None:
        self._force = row.force(junction)
        self._displacement = displacement
        known = np.searchsorted(self._force.times, row.reached)  # of an end that was worked out further, no more
        times, pieces = self._force.times[:known], self._force.pieces[:known]
        ends = np.append(times, row.reached)
        size = (np.abs(pieces) * np.diff(ends)[:, None] ** np.arange(pieces.shape[1])).max(axis=1)
        pushing = (row.forces.closed[junction, : times.size] == 1) & (size > row.slight[junction])
        edges = np.flatnonzero(np.diff(np.concatenate([[0], pushing.astype(int), [0]])))
        self._intervals = tuple((float(ends[a]), float(ends[b])) for a, b in zip(edges[::2], edges[1::2], strict=True))

    def force(self, time: Floats) -> Floats:
        """Contact force."""
        return self._force(np.asarray(time, dtype=float))

    def impulse(self, time: Floats) -> Floats:
        """Cumulative impulse."""
        return self._force.integral(np.maximum(np.asarray(time, dtype=float), 0.0))

    def gap(self, time: Floats) -> Floats:
        """Gap."""
        return self._displacement(np.asarray(time, dtype=float))

    def largest_force(self, start: float, stop: float) -> float:
        """Least upper bound of the force between two times."""
        return self._force.supremum(start, stop)

    @property
    def closed(self) -> tuple[tuple[float, float], ...]:
        """Intervals with a force."""
        return self._intervals


class RowSolution(Exact):
    """The exact solution of a row, evaluated."""

    def __init__(self, row: RowOfBars, end: float) -> None:
        self.row, self.reached, self.fronts, self.stopped = row, row.reached, row.fronts, row.stopped
        self.end = end
        w = row.waves
        self._waves = [PiecewisePolynomial(w.times[h, :n], w.pieces[h, :n]) for h, n in enumerate(w.count)]
        self._names = [body.name for body in row.bodies]
        self.contacts = {}
        for j, name in enumerate(row.contact_names):
            self.contacts[name] = RowContact(row, j, self._gap(j))

    def _gap(self, j: int) -> Any:
        row = self.row

        def gap(time: Any) -> Any:
            out = np.full(time.shape, row.gaps[j])
            for k, sign in ((0, -1.0), (1, 1.0)):
                b = row.bar[j, k]
                if b >= 0:
                    x = row.length[b] if k == 0 else 0.0
                    out = out + sign * self._line_displacement(b, np.full(time.shape, x), time)
            return out

        return gap

    # -- on the common line: x from a bar's left end ------------------------------------------------------

    def _line_waves(self, b: int, x: Any, t: Any) -> tuple[Any, Any]:
        row = self.row
        late, early = x / row.speed[b], (row.length[b] - x) / row.speed[b]
        p = self._waves[2 * b](t - late) + 0.5 * row.gravity[b] * late
        q = self._waves[2 * b + 1](t - early) + 0.5 * row.gravity[b] * early
        return p, q

    def _line_displacement(self, b: int, x: Any, t: Any) -> Any:
        row = self.row
        total = 0.5 * row.gravity[b] * row.transit[b] * t
        for h, late in ((2 * b, x / row.speed[b]), (2 * b + 1, (row.length[b] - x) / row.speed[b])):
            total = total + self._waves[h].integral(t - late) - self._waves[h].integral(-late)
        return total

    def _line(self, body: str, x: Any) -> tuple[int, Any, float]:
        """Return the bar, the place from its left end on the common line, and the sign of its own axis."""
        b = self._names.index(body)
        x = np.asarray(x, dtype=float)
        return b, x if self.row.flip[b] > 0 else self.row.length[b] - x, float(self.row.flip[b])

    def displacement(self, body: str, x: Floats, time: Floats) -> Floats:
        """Displacement along the body's own direction."""
        b, place, sign = self._line(body, x)
        place, time = np.broadcast_arrays(place, np.asarray(time, dtype=float))
        return sign * self._line_displacement(b, place, time)

    def velocity(self, body: str, x: Floats, time: Floats) -> Floats:
        """Velocity along the body's own direction."""
        b, place, sign = self._line(body, x)
        p, q = self._line_waves(b, *np.broadcast_arrays(place, np.asarray(time, dtype=float)))
        return sign * (p + q)

    def stress(self, body: str, x: Floats, time: Floats) -> Floats:
        """Stress, tension positive."""
        b, place, _ = self._line(body, x)
        p, q = self._line_waves(b, *np.broadcast_arrays(place, np.asarray(time, dtype=float)))
        return -self.row.impedance[b] * (p - q) / self.row.bodies[b].spec.area

    # -- sums ---------------------------------------------------------------------------------------------

    def energy(self, time: float) -> tuple[float, float]:
        """Kinetic and elastic energy."""
        kinetic = elastic = 0.0
        for b in range(len(self._names)):
            for x, w in self._quadrature(b, time):
                p, q = self._line_waves(b, x, np.full(x.shape, time))
                rho_a = self.row.impedance[b] / self.row.speed[b]
                kinetic += 0.5 * rho_a * float(w @ (p + q) ** 2)
                elastic += 0.5 * rho_a * float(w @ (p - q) ** 2)
        return kinetic, elastic

    def momentum(self, time: float) -> float:
        """Momentum along the line of the first body."""
        total = 0.0
        for b in range(len(self._names)):
            for x, w in self._quadrature(b, time):
                p, q = self._line_waves(b, x, np.full(x.shape, time))
                total += self.row.impedance[b] / self.row.speed[b] * float(w @ (p + q))
        return total

    def _quadrature(self, b: int, time: float) -> list[tuple[Any, Any]]:
        """Return points and weights that integrate the squares of the waves in a bar exactly."""
        row = self.row
        breaks = [0.0, float(row.length[b])]
        for h, sign in ((2 * b, 1.0), (2 * b + 1, -1.0)):
            times = self._waves[h].times
            inside = times[(times > time - row.transit[b]) & (times < time)]
            place = (time - inside) * row.speed[b]
            breaks += (place if sign > 0 else row.length[b] - place).tolist()
        edges = np.unique(np.clip(breaks, 0.0, row.length[b]))
        nodes, weights = np.polynomial.legendre.leggauss(row.waves.pieces.shape[2])
        half = 0.5 * np.diff(edges)
        x = edges[:-1, None] + half[:, None] * (1.0 + nodes)
        return [(x.ravel(), (half[:, None] * weights).ravel())]

    def work(self, time: float) -> float:
        """Work of loads, drives and steady acceleration up to `time`."""
        return float(self._accounts[0].integral(np.asarray(time, dtype=float)))

    def impulse(self, time: float) -> float:
        """Impulse of loads, supports, drives, walls and steady acceleration along the line, up to `time`."""
        return float(self._accounts[1].integral(np.asarray(time, dtype=float)))

    def largest_energy(self) -> float:
        """Least upper bound of the energy: nothing but the work from outside changes it."""
        return sum(self.energy(0.0)) + self._accounts[0].antiderivative().supremum(0.0, self.reached)

    @cached_property
    def _accounts(self) -> tuple[PiecewisePolynomial, PiecewisePolynomial]:
        """Power and force of all that acts from outside, over the whole time; between two fronts they are polynomials.

        The pieces begin wherever a wave leaves or arrives at any end, and wherever a load changes.
        """
        row = self.row
        marks = [row.forces.times[j, : row.forces.count[j]] for j in range(row.side.shape[0])]
        marks += [row.loads.times[k, : row.loads.count[k]] for k in range(row.loads.count.size) if row.functions]
        for b in range(len(self._names)):
            for wave in self._waves[2 * b : 2 * b + 2]:
                marks += [wave.times, wave.times + row.transit[b]]
        times = np.concatenate([[0.0], *marks])
        times = np.unique(times[(times >= 0.0) & (times < self.reached)])
        terms = row.waves.pieces.shape[2]
        force, power = np.zeros((times.size, terms)), np.zeros((times.size, 2 * terms - 1))
        for b in range(len(self._names)):
            if row.gravity[b] != 0.0:
                weight, velocity = self._weight(b, times)
                force[:, 0] += weight
                power[:, : terms + 1] += weight * velocity
        for j in range(row.side.shape[0]):
            for k, sign in ((0, 1.0), (1, -1.0)):  # +1 at the right end of a bar
                b, load = row.bar[j, k], row.side[j, k, 2]
                if b < 0:
                    if row.is_wall[j, k]:
                        force += sign * row.force(j).pieces_from(times)
                    continue
                if row.is_free[j, k] and load < 0:
                    continue
                velocity, pressed = self._end(b, k == 0, times)
                if row.is_free[j, k]:
                    acting = row.load(load).pieces_from(times)
                else:
                    acting = sign * (row.force(j).pieces_from(times) - pressed)
                force += acting
                power += product(acting, velocity)
        return PiecewisePolynomial(times, power), PiecewisePolynomial(times, force)

    def _end(self, b: int, right: bool, times: Any) -> tuple[Any, Any]:
        """Return velocity and compressive force at an end of a bar, in pieces that begin at `times`."""
        row = self.row
        leaving, arriving = self._waves[2 * b + 1 if right else 2 * b], self._waves[2 * b if right else 2 * b + 1]
        out, back = leaving.pieces_from(times), arriving.pieces_from(times, row.transit[b])
        back[:, 0] += 0.5 * row.gravity[b] * row.transit[b]
        return out + back, row.impedance[b] * ((back - out) if right else (out - back))

    def _weight(self, b: int, times: Any) -> tuple[float, Any]:
        """Return the weight of a bar, and its mean velocity in pieces: what its ends and its weight make of it."""
        row = self.row
        mass = row.impedance[b] * row.transit[b]
        resultant = self._end(b, False, times)[1] - self._end(b, True, times)[1]
        resultant[:, 0] += mass * row.gravity[b]
        momentum = PiecewisePolynomial(times, resultant).antiderivative().pieces
        momentum[:, 0] += mass * row.velocity[b]
        return mass * row.gravity[b], momentum / mass
