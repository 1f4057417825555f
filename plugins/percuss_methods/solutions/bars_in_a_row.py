"""Exact solution of the longitudinal impact of uniform elastic bars along one line."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from percuss import Doc, Exact, ExactContact, Ge, Gt, Solution, Unit
from percuss_methods.solutions._bounds import (
    GIGABYTE,
    Meter,
    OutOfTimeError,
    least_memory,
    memory_of_load,
    too_large,
    two_digits,
)
from percuss_methods.solutions._polynomials import (
    SHORTEST,
    PiecewisePolynomial,
    pieces_needed,
    product,
    smooth_between,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from percuss import ContactProblem, Floats
    from percuss_methods.solutions._row import BarChain


@dataclass(frozen=True)
class BarsInARow(Solution):
    """Exact solution by the method of characteristics as a finite list of events, without mesh and time step.

    Formula: ``v = p + q``, ``force = Z (p - q)``, ``Z = A sqrt(E rho)``. A closed contact of ends a and b moves at the
    common velocity ``v = 2 (Z_a p + Z_b q) / (Z_a + Z_b)`` and presses with ``Z_a (2 p - v)``; it closes when the gap
    is zero and opens when the force would pull. The solution of piecewise-constant and piecewise-linear data is exact;
    smooth loads are approximated by polynomials with an error of at most 1e-12 of their largest value.

    Covers uniform linear-elastic bars on one line, and prisms that move along their axis alone: free, fixed and driven
    ends, walls, gaps or touching, initial velocities, loads on ends, steady acceleration.

    A solution with too many fronts, or one that would need too much memory, ends early, or does not begin if this is
    known beforehand; both follow from the case alone. If it takes too much processor time, there is no solution at all:
    the speed of the machine decides whether there is one, but never changes a digit of it.
    """

    name = "bars-in-a-row"
    summary = "Characteristics of any row of uniform elastic bars, event by event"
    references = (
        "Graff: Wave Motion in Elastic Solids, Dover 1991, ch. 2",
        "Doyen, Ern, Piperno: Time-integration schemes for the finite element dynamic Signorini problem, SIAM J. Sci. "
        "Comput. 33 (2011), doi 10.1137/100791440",
    )

    of_prisms = True

    most_fronts: Annotated[int, Ge(1), Unit("1"), Doc("fronts after which it stops and states the time reached")] = (
        2_000_000
    )
    most_memory: Annotated[float, Gt(0), Unit("1"), Doc("memory [GB] beyond which it stops or does not begin")] = 1.0
    most_seconds: Annotated[float, Gt(0), Unit("1"), Doc("processor time [s] after which there is no solution")] = 10.0

    def covers(self, problem: ContactProblem) -> str | None:
        """Return the reason why a problem is not covered, or None if it is."""
        reasons = [*_reasons_of_bodies(problem), *_reasons_of_loads(problem)]
        ends = [end for contact in problem.contacts for end in contact.ends]
        if len(ends) != len(set(ends)):
            reasons.append("an end takes part in several contacts")
        return reasons[0] if reasons else None

    def too_costly(self, problem: ContactProblem, end: float) -> str | None:
        """Return why a covered problem takes more memory than allowed, where shortest bar and loads tell beforehand."""
        most = self.most_memory * GIGABYTE
        if (least := least_memory(problem, end)) > most:
            return too_large(most, f"at least {two_digits(least / GIGABYTE)} GB for the shortest bar")
        for load in problem.loads:
            edges, _ = smooth_between(load, end)
            if load.end is None or edges.size < 2:
                continue
            pieces = pieces_needed(load.load.amplitude, edges)
            if np.isinf(pieces):
                name = f"'{load.name}' ({load.load.name})"
                return (
                    f"load {name} changes too fast for polynomials, within {SHORTEST:g} of the time for which it acts"
                )
            needed = memory_of_load(pieces, len(problem.bodies))
            if needed > 2.0 * most:
                return too_large(
                    most, f"about {two_digits(needed / GIGABYTE)} GB for load '{load.name}' ({load.load.name})"
                )
        return None

    def solve(self, problem: ContactProblem, end: float) -> Exact | str:
        """Return the exact solution of a covered problem up to `end`, or up to the time that its bounds allow."""
        from percuss_methods.solutions._row import BarChain  # imported here because it imports numba, which takes long

        try:
            chain = BarChain(problem, self.most_memory, Meter(self.most_seconds))
            chain.march(end, self.most_fronts)
        except OutOfTimeError as error:
            return str(error)
        return ChainSolution(chain, end)


def _reasons_of_bodies(problem: ContactProblem) -> Iterator[str]:
    """Yield the reasons why the bodies of a problem are not covered."""
    line = next(iter(problem.bodies.values())).direction
    for name, body in problem.bodies.items():
        if _has_transverse_part(body.direction, line):
            yield f"body '{name}' lies across the first one"
        if body.shape.name != "bar" and body.modulus is None:
            yield f"body '{name}' is a {body.shape.name}, not a bar"
        if body.velocity.any() and _has_transverse_part(body.velocity, body.direction):
            yield f"body '{name}' moves across its axis"


def _reasons_of_loads(problem: ContactProblem) -> Iterator[str]:
    """Yield the reasons why the loads of a problem are not covered."""
    drives = [load for load in problem.loads if load.acts_as == "velocity"]
    on_ends = [load for load in problem.loads if load.end is not None and load.acts_as != "velocity"]
    on_bodies = [load for load in problem.loads if load.end is None]
    for load in on_ends:
        if load.acts_as == "acceleration":
            yield f"load '{load.name}' accelerates an end, which has no mass but that of its mesh"
    for load in (*on_ends, *drives, *on_bodies):
        if _has_transverse_part(load.vector, problem.bodies[load.body].direction):
            yield f"load '{load.name}' acts across body '{load.body}'"
        if load.load.kinks() is None:
            yield f"load '{load.name}' ({load.load.name}) does not say where it is smooth"
    for load in drives:
        if load.start > 0 or load.stop < np.inf:
            yield f"the drive '{load.name}' is switched on or off in time"
    for load in on_bodies:
        if load.start > 0 or load.stop < np.inf or load.load.name not in {"gravity", "constant"}:
            yield f"the load '{load.name}' on a whole body changes in time"


def _has_transverse_part(vector: Floats, axis: Floats) -> bool:
    """Return whether a vector has a part across the unit vector of an axis, beyond round-off."""
    size = float(np.linalg.norm(vector))
    return bool(size > 0 and np.linalg.norm(vector - (vector @ axis) * axis) > 1e-9 * size)


@cache
def _gauss_legendre(count: int) -> tuple[Floats, Floats]:
    """Return points and weights of the Gauss-Legendre quadrature between -1 and 1."""
    return np.polynomial.legendre.leggauss(count)


class ChainContact(ExactContact):
    """The exact history of one contact of a chain of bars."""

    def __init__(self, chain: BarChain, junction: int, displacement: Any) -> None:
        self._force = chain.force(junction)
        self._displacement = displacement
        # a junction may be computed beyond the time that the solution as a whole has reached
        count = np.searchsorted(self._force.times, chain.reached)
        times, pieces = self._force.times[:count], self._force.pieces[:count]
        ends = np.append(times, chain.reached)
        size = (np.abs(pieces) * np.diff(ends)[:, None] ** np.arange(pieces.shape[1])).max(axis=1)
        pushing = (chain.forces.closed[junction, : times.size] == 1) & (size > chain.negligible_force[junction])
        edges = np.flatnonzero(np.diff(np.concatenate([[0], pushing.astype(int), [0]])))
        self._intervals = tuple((float(ends[a]), float(ends[b])) for a, b in zip(edges[::2], edges[1::2], strict=True))

    def force(self, time: Floats) -> Floats:
        """Return the contact force, compression positive."""
        return self._force(np.asarray(time, dtype=float))

    def impulse(self, time: Floats) -> Floats:
        """Return the impulse of the contact force from 0 to `time`."""
        return self._force.integral(np.maximum(np.asarray(time, dtype=float), 0.0))

    def gap(self, time: Floats) -> Floats:
        """Return the gap, open positive."""
        return self._displacement(np.asarray(time, dtype=float))

    def largest_force(self, start: float, stop: float) -> float:
        """Return the least upper bound of the force between two times."""
        return self._force.supremum(start, stop)

    @property
    def closed(self) -> tuple[tuple[float, float], ...]:
        """Intervals (start, stop) in which the contact presses."""
        return self._intervals


class ChainSolution(Exact):
    """The exact solution of a chain of bars, evaluated from the histories of its waves and contact forces."""

    def __init__(self, chain: BarChain, end: float) -> None:
        self.chain, self.reached, self.fronts, self.stopped = chain, chain.reached, chain.fronts, chain.stopped
        self.end = end
        waves = chain.waves
        self._waves = [PiecewisePolynomial(waves.times[h, :n], waves.pieces[h, :n]) for h, n in enumerate(waves.count)]
        self._numbers = {body.name: b for b, body in enumerate(chain.bodies)}
        self.contacts = {}
        for j, name in enumerate(chain.contact_names):
            self.contacts[name] = ChainContact(chain, j, partial(self._gap, j))

    def _gap(self, j: int, time: Any) -> Any:
        """Return the gap of a junction."""
        chain = self.chain
        out = np.full(time.shape, chain.gaps[j])
        for k, sign in ((0, -1.0), (1, 1.0)):
            b = chain.bar[j, k]
            if b >= 0:
                out = out + sign * self._line_displacement(b, chain.length[b] if k == 0 else 0.0, time)
        return out

    # -- on the common line, with x measured from the left end of a bar -----------------------------------

    def _line_waves(self, b: int, x: Any, t: Any) -> tuple[Any, Any]:
        """Return the waves p and q in a bar."""
        chain = self.chain
        from_left, from_right = x / chain.speed[b], (chain.length[b] - x) / chain.speed[b]
        p = self._waves[2 * b](t - from_left) + 0.5 * chain.gravity[b] * from_left
        q = self._waves[2 * b + 1](t - from_right) + 0.5 * chain.gravity[b] * from_right
        return p, q

    def _line_displacement(self, b: int, x: Any, t: Any) -> Any:
        """Return the displacement of a bar along the common line."""
        chain = self.chain
        total = 0.5 * chain.gravity[b] * chain.transit[b] * t
        for h, delay in ((2 * b, x / chain.speed[b]), (2 * b + 1, (chain.length[b] - x) / chain.speed[b])):
            total = total + self._waves[h].integral(t - delay) - self._waves[h].integral(-delay)
        return total

    def _line(self, body: str, x: Any) -> tuple[int, Any, float]:
        """Return the number of a bar, the distance from its left end on the common line, and the sign of its axis."""
        b = self._numbers[body]
        x = np.asarray(x, dtype=float)
        return b, x if self.chain.flip[b] > 0 else self.chain.length[b] - x, float(self.chain.flip[b])

    def displacement(self, body: str, x: Floats, time: Floats) -> Floats:
        """Return the displacement along the body's own direction."""
        b, distance, sign = self._line(body, x)
        distance, time = np.broadcast_arrays(distance, np.asarray(time, dtype=float))
        return sign * self._line_displacement(b, distance, time)

    def velocity(self, body: str, x: Floats, time: Floats) -> Floats:
        """Return the velocity along the body's own direction."""
        b, distance, sign = self._line(body, x)
        p, q = self._line_waves(b, *np.broadcast_arrays(distance, np.asarray(time, dtype=float)))
        return sign * (p + q)

    def stress(self, body: str, x: Floats, time: Floats) -> Floats:
        """Return the stress, tension positive."""
        b, distance, _ = self._line(body, x)
        p, q = self._line_waves(b, *np.broadcast_arrays(distance, np.asarray(time, dtype=float)))
        return -self.chain.impedance[b] * (p - q) / self.chain.bodies[b].area

    # -- sums over all bars -------------------------------------------------------------------------------

    def energy(self, time: float) -> tuple[float, float]:
        """Return kinetic and elastic energy."""
        kinetic = elastic = 0.0
        for b in range(len(self._numbers)):
            for x, w in self._quadrature(b, time):
                p, q = self._line_waves(b, x, np.full(x.shape, time))
                rho_a = self.chain.impedance[b] / self.chain.speed[b]
                kinetic += 0.5 * rho_a * float(w @ (p + q) ** 2)
                elastic += 0.5 * rho_a * float(w @ (p - q) ** 2)
        return kinetic, elastic

    def momentum(self, time: float) -> float:
        """Return the momentum along the line of the first body."""
        total = 0.0
        for b in range(len(self._numbers)):
            for x, w in self._quadrature(b, time):
                p, q = self._line_waves(b, x, np.full(x.shape, time))
                total += self.chain.impedance[b] / self.chain.speed[b] * float(w @ (p + q))
        return total

    def _quadrature(self, b: int, time: float) -> list[tuple[Any, Any]]:
        """Return points and weights that integrate the squares of the waves in a bar exactly."""
        chain = self.chain
        breaks = [0.0, float(chain.length[b])]
        for h, sign in ((2 * b, 1.0), (2 * b + 1, -1.0)):
            times = self._waves[h].times
            first, last = np.searchsorted(times, time - chain.transit[b], "right"), np.searchsorted(times, time)
            inside = times[first:last]
            distance = (time - inside) * chain.speed[b]
            breaks += (distance if sign > 0 else chain.length[b] - distance).tolist()
        edges = np.unique(np.minimum(np.maximum(breaks, 0.0), chain.length[b]))
        nodes, weights = _gauss_legendre(chain.waves.pieces.shape[2])
        half = 0.5 * np.diff(edges)
        x = edges[:-1, None] + half[:, None] * (1.0 + nodes)
        return [(x.ravel(), (half[:, None] * weights).ravel())]

    def work(self, time: float) -> float:
        """Return the work of loads, drives and steady acceleration up to `time`."""
        return float(self._accounts[0].integral(np.asarray(time, dtype=float)))

    def impulse(self, time: float) -> float:
        """Return the impulse of loads, supports, drives, walls and steady acceleration along the line, up to `time`."""
        return float(self._accounts[1].integral(np.asarray(time, dtype=float)))

    def largest_energy(self) -> float:
        """Return the least upper bound of the energy, which external work alone changes."""
        return sum(self.energy(0.0)) + self._accounts[0].antiderivative().supremum(0.0, self.reached)

    @cached_property
    def _accounts(self) -> tuple[PiecewisePolynomial, PiecewisePolynomial]:
        """Power and force of all external actions over time, which are polynomials between two fronts.

        The pieces begin at the times at which a wave leaves or arrives at any end, or a load changes.
        """
        chain = self.chain
        marks = [chain.forces.times[j, : chain.forces.count[j]] for j in range(chain.side.shape[0])]
        marks += [
            chain.loads.times[k, : chain.loads.count[k]] for k in range(chain.loads.count.size) if chain.functions
        ]
        for b in range(len(self._numbers)):
            for wave in self._waves[2 * b : 2 * b + 2]:
                marks += [wave.times, wave.times + chain.transit[b]]
        times = np.concatenate([[0.0], *marks])
        times = np.unique(times[(times >= 0.0) & (times < self.reached)])
        terms = chain.waves.pieces.shape[2]
        force, power = np.zeros((times.size, terms)), np.zeros((times.size, 2 * terms - 1))
        for b in range(len(self._numbers)):
            if chain.gravity[b] != 0.0:
                weight, velocity = self._weight(b, times)
                force[:, 0] += weight
                power[:, : terms + 1] += weight * velocity
        for j in range(chain.side.shape[0]):
            for k, sign in ((0, 1.0), (1, -1.0)):  # first side: the right end of a bar
                b, load = chain.bar[j, k], chain.side[j, k, 2]
                if b < 0:
                    if chain.is_wall[j, k]:
                        force += sign * chain.force(j).pieces_from(times)
                    continue
                if chain.is_free[j, k] and load < 0:
                    continue
                velocity, compression = self._end(b, k == 0, times)
                if chain.is_free[j, k]:
                    external = chain.load(load).pieces_from(times)
                else:
                    external = sign * (chain.force(j).pieces_from(times) - compression)
                force += external
                power += product(external, velocity)
        return PiecewisePolynomial(times, power), PiecewisePolynomial(times, force)

    def _end(self, b: int, right: bool, times: Any) -> tuple[Any, Any]:
        """Return velocity and compressive force at an end of a bar, in pieces that begin at `times`."""
        chain = self.chain
        leaving, arriving = self._waves[2 * b + 1 if right else 2 * b], self._waves[2 * b if right else 2 * b + 1]
        outgoing, incoming = leaving.pieces_from(times), arriving.pieces_from(times, chain.transit[b])
        incoming[:, 0] += 0.5 * chain.gravity[b] * chain.transit[b]
        return outgoing + incoming, chain.impedance[b] * ((incoming - outgoing) if right else (outgoing - incoming))

    def _weight(self, b: int, times: Any) -> tuple[float, Any]:
        """Return the weight of a bar, and its mean velocity in pieces, from the forces at its ends and its weight."""
        chain = self.chain
        mass = chain.impedance[b] * chain.transit[b]
        resultant = self._end(b, False, times)[1] - self._end(b, True, times)[1]
        resultant[:, 0] += mass * chain.gravity[b]
        momentum = PiecewisePolynomial(times, resultant).antiderivative().pieces
        momentum[:, 0] += mass * chain.velocity[b]
        return mass * chain.gravity[b], momentum / mass
