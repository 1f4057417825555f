"""A checked case as arrays: nodes, masses, elements, contact points, supports, loads, time step."""

from __future__ import annotations

import copy
import dataclasses
import itertools
import math
from collections import Counter
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.errors import InputError, Problem, RefusedPair
from percuss.methods.interfaces import BodyMesh, ContactLaw, ContactPoints, Floats, LeapFrog, LinearLaw
from percuss.methods.kernel_trial import bound_of
from percuss.solver import size_limits
from percuss.solver.compiled.contact_equation import NOTHING
from percuss.solver.contact_rows import Side, broadcast, delassus_rows, intervals, law_records, own_multipliers
from percuss.solver.entities import Body, BodyForce, Constraint, ContactPair, NodalForce, end_reserves
from percuss.solver.integrator_check import refuse_end, refuse_unseen, scheme

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from percuss.case.case import Address, Case, ContactSpec, LoadSpec

LARGEST_COURANT = 0.99  # of a body: above it no penalty without mass is worth having with central difference
TOUCHING = 1e-9  # of an element length: a smaller initial gap or overlap is none


class Stretch(NamedTuple):
    """A part of a run in which the same supports and drives hold and the same laws act."""

    start: float
    stop: float
    model: Model  # without loads, supports and drives at rest


class Model:
    """A case as arrays.

    Parameters
    ----------
    case
        A checked case.
    dt
        Time step; by default that of the case, the one of Courant number 1 where the case leaves it open.

    Raises
    ------
    InputError
        If the geometry, the contacts or the loads do not fit together.
    RefusedPair
        If the integrator and a contact law refuse one another.
    """

    def __init__(self, case: Case, dt: float | None = None) -> None:
        self.case = case
        self.dim = case.dimension
        self.whole = self  # of a stretch of a run, the model of the whole run
        self._problems: list[Problem] = []
        self.bodies = size_limits.checked(case, self._bodies)
        self.n_nodes = sum(body.mass.size for body in self.bodies.values())
        self.mass = np.concatenate([body.mass for body in self.bodies.values()])
        self.nodes = np.concatenate([body.mesh.nodes for body in self.bodies.values()])
        self.omega = max(float(body.frequency.max()) for body in self.bodies.values())
        self.dt, self.steps = self._time(dt)
        self.contact_pairs = [
            contact_pair for spec in case.contacts.values() if (contact_pair := self._contact_pair(spec)) is not None
        ]
        self.constraints, self.nodal_forces, self.body_forces = self._loads()
        self._raise()
        self._refuse()
        # laws that are rows first: the others fill their part of the multipliers by kernels of their own
        self.stages, self.tables = scheme(case.method.integrator, self.dt)
        self._resting: tuple[int, ...] = ()
        self._check_movable()
        self.laws = self._laws()
        self._raise()
        refuse_end(case.method.integrator, self.stages, self.laws)
        refuse_unseen(case.method.integrator, self.tables, self.laws)

    # -- bodies ------------------------------------------------------------------------------------------

    def _bodies(self) -> dict[str, Body]:
        bodies: dict[str, Body] = {}
        start = 0
        for number, (name, spec) in enumerate(self.case.bodies.items()):
            mesh = size_limits.meshed(self.case, spec)
            view = BodyMesh(mesh, spec.area)
            velocity = np.asarray(spec.velocity, dtype=float)
            bodies[name] = Body(
                name=name,
                number=number,
                spec=spec,
                mesh=mesh,
                start=start,
                mass=self.case.method.mass.nodal(spec.material.rho * spec.area * mesh.lengths),
                stiffness=spec.element.axial_stiffness(view, spec.material.modulus),
                frequency=spec.element.highest_frequency(view, math.sqrt(spec.material.modulus / spec.material.rho)),
                velocity=velocity * mesh.direction if velocity.ndim == 0 else velocity,
            )
            start = bodies[name].stop
        return bodies

    def _time(self, dt: float | None) -> tuple[float, int]:
        time = self.case.time
        if dt is None:
            courant = 1.0 if time.courant is None or time.courant == "auto" else time.courant
            dt = time.step if time.step is not None else courant * 2.0 / self.omega
        size_limits.check_step(self.case, dt)
        return dt, time.steps if time.steps is not None else size_limits.steps(self.case, dt)

    def stretches(self) -> list[Stretch]:
        """Return the stretches of the run that differ in their supports and drives, or in the laws that act.

        A stretch whose supports, drives and laws are those of an earlier one is not listed again.
        """
        listed: dict[Any, Stretch] = {}
        for first, last in self.segments():
            middle = (first + 0.5) * self.dt
            constraints = tuple(row for row, hold in enumerate(self.constraints) if hold.active(middle))
            resting = self.resting(middle)
            if (constraints, resting) not in listed:
                at_rest = [dataclasses.replace(self.constraints[row], load=None, column=0) for row in constraints]
                model = self.still(self.dt, at_rest, resting)
                start, stop = first * self.dt, min(last, self.steps) * self.dt
                listed[constraints, resting] = Stretch(start, max(stop, start), model)
        return list(listed.values())

    def resting(self, midpoint: float) -> tuple[int, ...]:
        """Return the points whose law does not act in the step around `midpoint`."""
        out = list(self._resting)
        for entry in self.laws:
            during = entry["during"]
            if during is not None and not ((during[:, 0] < midpoint) & (midpoint < during[:, 1])).any():
                out += entry["where"]
        return tuple(sorted(set(out)))

    def still(self, dt: float, constraints: Sequence[Constraint], resting: Sequence[int] = ()) -> Model:
        """Return a stretch of the run by itself: no loads, `constraints` at rest, laws bound anew for a step `dt`.

        Parameters
        ----------
        dt
            Time step.
        constraints
            The supports and drives of the stretch.
        resting
            Points whose law does not act in it; the others act throughout.
        """
        other = copy.copy(self)
        other.__dict__.pop("initial_velocity", None)
        other.dt, other.steps, other.nodal_forces, other.body_forces = dt, 1, [], []
        other.constraints = list(constraints)
        other._resting = tuple(resting)
        other.stages, other.tables = scheme(self.case.method.integrator, dt)
        other.laws = [{**entry, "during": None} for entry in other._laws()]
        other._raise()
        return other

    @property
    def multistage(self) -> bool:
        """Whether the integrator is a multi-stage scheme, and not a leap-frog."""
        return self.stages is not None

    @property
    def why_not_linear(self) -> str:
        """Why forces in the bodies are not proportional to their displacements; empty where all bodies are linear."""
        return "; ".join(filter(None, (body.why_not_linear for body in self.bodies.values())))

    @property
    def courant(self) -> float:
        """Courant number of the element with the smallest h/c."""
        return 0.5 * self.dt * self.omega

    def node(self, address: Address) -> int:
        """Return the node of an end."""
        body = self.bodies[address.body]
        return body.start + body.mesh.regions[address.region].nodes[0]

    def body_of(self, node: int) -> Body:
        """Return the body a node belongs to."""
        return next(body for body in self.bodies.values() if body.start <= node < body.stop)

    # -- contacts ----------------------------------------------------------------------------------------

    def _contact_pair(self, spec: ContactSpec) -> ContactPair | None:
        path = ("contacts", spec.name)
        first = self.bodies[spec.sides[0].body]
        normal = first.mesh.regions[spec.sides[0].region].outward
        nodes = tuple(self.node(side) for side in spec.sides)
        here = self.nodes[nodes[0]]
        if len(nodes) == 1:
            gap = self._wall_gap(spec, here, normal, first.mesh.direction)
        else:
            second = self.bodies[spec.sides[1].body].mesh.regions[spec.sides[1].region].outward
            if float(normal @ second) > -1.0 + 1e-9:
                turned = math.degrees(math.acos(max(-1.0, min(1.0, -float(normal @ second)))))
                self._problem(
                    (*path, "between"),
                    f"expected two ends that face each other, found {spec.sides[0]} and {spec.sides[1]} "
                    f"turned by {turned:.6g} degrees",
                    "Contact is between bars along one line: a right end meets a left end.",
                )
                return None
            gap = float(normal @ (self.nodes[nodes[1]] - here))
            aside = float(np.linalg.norm(self.nodes[nodes[1]] - here - gap * normal))
            if aside > 1e-6 * min(float(self.bodies[side.body].mesh.lengths.sum()) for side in spec.sides):
                self._problem(
                    (*path, "between"),
                    f"expected two ends on one line, found {spec.sides[1]} {aside:.6g} beside {spec.sides[0].body}",
                    "Move one of the bodies (`at`) or turn it (`direction`).",
                )
                return None
        elements = [self.body_of(node).end_element(node) for node in nodes]
        bodies = [self.body_of(node) for node in nodes]
        size = min(float(b.mesh.lengths[e]) for b, e in zip(bodies, elements, strict=True))
        if gap < -TOUCHING * size:
            self._problem(
                path,
                f"expected bodies apart or touching, found an overlap of {-gap:.6g}",
                f"Move them apart by {-gap:.17g}, or drop the contact.",
            )
            return None
        stiffness = [float(b.stiffness[e]) for b, e in zip(bodies, elements, strict=True)]
        frequency = [float(b.frequency[e]) for b, e in zip(bodies, elements, strict=True)]
        softer = int(np.argmin(stiffness))
        return ContactPair(
            name=spec.name,
            nodes=nodes,
            normal=normal,
            gap=0.0 if gap <= TOUCHING * size else gap,
            law=spec.law,
            stiffness=stiffness[softer],
            frequency=min(frequency),
            # rho A h / 2 = 2 (EA/h) / omega^2
            mass=2.0 * stiffness[softer] / frequency[softer] ** 2,
            equal_sides=bool(
                np.ptp(stiffness) <= 1e-12 * max(stiffness) and np.ptp(frequency) <= 1e-12 * max(frequency)
            ),
        )

    def _wall_gap(self, spec: ContactSpec, here: Floats, normal: Floats, direction: Floats) -> float:
        wall = np.asarray(spec.wall, dtype=float)
        if wall.ndim == 1:
            return float(normal @ (wall - here))
        # a number is a coordinate along the bar; along x itself for a bar on the x axis, whichever way it points
        axis = np.abs(direction) if abs(direction[0]) == 1.0 else direction
        return float((wall - here @ axis) * (axis @ normal))

    def points(self, where: Sequence[int], dt: float) -> ContactPoints:
        """Return what a law may know of the contact points `where` for a step `dt`."""

        def column(values: Any, kind: type = float) -> Any:
            array: Any = np.array(values, dtype=kind)
            array.flags.writeable = False
            return array

        contact_pairs = [self.contact_pairs[p] for p in where]
        delassus, coupling = self.whole._largest_delassus
        return ContactPoints(
            names=tuple(m.name for m in contact_pairs),
            stiffness=column([m.stiffness for m in contact_pairs]),
            frequency=column([m.frequency for m in contact_pairs]),
            mass=column([m.mass for m in contact_pairs]),
            equal_sides=column([m.equal_sides for m in contact_pairs], bool),
            delassus=column(delassus[where]),
            coupling=column(coupling[where]),
            weight=column([1.0] * len(contact_pairs)),
            limits=lambda: column(self.whole._stiffness_limits(dt)[where]),
        )

    @cached_property
    def _largest_delassus(self) -> tuple[Floats, Floats]:
        """The largest s of each point in the run, and the largest sum of its row of S over that, (P,) each."""
        largest, sums = np.zeros(len(self.contact_pairs)), np.zeros(len(self.contact_pairs))
        for start, _ in self.segments(laws=False):
            diagonal, others = delassus_rows(self.sides((start + 0.5) * self.dt))
            largest = np.maximum(largest, diagonal)
            sums = np.maximum(sums, diagonal + np.array([sum(map(abs, row.values())) for row in others]))
        return largest, sums / largest

    def _stiffness_limits(self, dt: float) -> Floats:
        """Return `ContactPoints.stiffness_limit` of all points, (P,).

        With B = (4/dt^2) M - K of a body, the displacements of its ends a and b alone are worth at least
        ``r_a u_a^2 + r_b u_b^2``, where the inverse of B between its ends gives both r. Closed contacts of stiffness
        eps_s take ``eps_s (u_a - u_b)^2``, which is no more than that where ``eps_s (1/r_a + 1/r_b) <= 1``.
        """
        uses = Counter(node for contact_pair in self.contact_pairs for node in contact_pair.nodes)
        always_held = {hold.node for hold in self.constraints if hold.load is None}
        reserve: dict[int, float] = {}
        for body in self.bodies.values():
            ends = [node for node in (body.start, body.stop - 1) if node in uses]
            if ends:
                step = min(dt, LARGEST_COURANT * 2.0 / float(body.frequency.max()))
                reserve.update(end_reserves(body, step, ends))
        with np.errstate(divide="ignore"):
            softness = [
                sum(uses[node] / np.float64(reserve[node]) for node in contact_pair.nodes if node not in always_held)
                for contact_pair in self.contact_pairs
            ]
            return 1.0 / np.array(softness, dtype=float)

    def sides(self, midpoint: float) -> list[list[Side]]:
        """Return the sides of every contact point, with the supports and drives that hold at `midpoint`."""
        held: dict[int, list[Floats]] = {}
        for hold in self.constraints:
            if hold.active(midpoint):
                held.setdefault(hold.node, []).append(hold.direction)
        rows = []
        for contact_pair in self.contact_pairs:
            row = []
            for node, normal in contact_pair.rows():
                free = normal.copy()
                for direction in held.get(node, ()):
                    free -= (direction @ free) * direction
                row.append(Side(node, normal, free / self.mass[node]))
            rows.append(row)
        return rows

    def _check_movable(self) -> None:
        for start, _ in self.segments(laws=False):
            delassus = delassus_rows(self.sides((start + 0.5) * self.dt))[0]
            for contact_pair, s in zip(self.contact_pairs, delassus, strict=True):
                if s * min(self.mass[node] for node in contact_pair.nodes) < 1e-12:
                    self._problem(
                        ("contacts", contact_pair.name),
                        "expected a contact that can move, found every side fixed or driven",
                        "Free one of the ends, or drop the contact.",
                    )
            if self._problems:
                break
        self._raise()

    def _refuse(self) -> None:
        integrator = self.case.method.integrator
        for contact_pair in self.contact_pairs:
            for reason, by in (
                (integrator.refuses(contact_pair.law), integrator.name),
                (contact_pair.law.refuses(integrator), contact_pair.law.name),
            ):
                if reason:
                    raise RefusedPair(integrator.name, contact_pair.law.name, reason, by)

    def _laws(self) -> list[dict[str, Any]]:
        """Bind each law at its points; one entry a law, laws that are rows before the others."""
        groups: dict[ContactLaw, list[int]] = {}
        for p, contact_pair in enumerate(self.contact_pairs):
            groups.setdefault(contact_pair.law, []).append(p)
        laws = []
        for law, where in groups.items():
            points = self.points(where, self.dt)
            try:
                bound = bound_of(law, points, self.dt)
                resolved = law.resolved(points, self.dt)
            except ValueError as error:
                self._problem(("method", "contact"), str(error))
                continue
            during = intervals(bound, law.name) if isinstance(bound, LinearLaw) else None
            laws.append(
                {"law": law, "where": where, "bound": bound, "resolved": resolved, "points": points, "during": during}
            )
        return sorted(laws, key=lambda entry: not isinstance(entry["bound"], LinearLaw))

    def delassus(self, midpoint: float) -> Floats:
        """Return the diagonal of S, (P,) [1/mass]."""
        return delassus_rows(self.sides(midpoint))[0]

    def law_records(self, delassus: Floats, table: LeapFrog | None = None) -> tuple[list[int], Any]:
        """Return the order of the points in the loop, and what their laws say there, (P,) `LAW`."""
        table = table or self.tables[-1]
        order: list[int] = []
        parts = [own_multipliers(0)]
        for entry in self.laws:
            law, where = entry["law"], entry["where"]
            order += where
            if isinstance(entry["bound"], LinearLaw):
                rows = broadcast(entry["bound"], entry["points"], law.name)
                parts.append(law_records(rows, table, delassus[where], law.name))
            else:
                parts.append(own_multipliers(len(where)))
        out = np.concatenate(parts)
        if self.stages is not None:
            out["stores"] = NOTHING
        return order, out

    def ignored_couplings(self) -> list[str]:
        """Return, in sentences, which laws with a kernel take no account of other contacts at the ends of theirs."""
        at_node: dict[int, list[int]] = {}
        for p, contact_pair in enumerate(self.contact_pairs):
            for node in contact_pair.nodes:
                at_node.setdefault(node, []).append(p)
        sentences = []
        for entry in self.laws:
            law: ContactLaw = entry["law"]
            if isinstance(entry["bound"], LinearLaw) or law.uses_coupling:
                continue
            shared = [row for row in at_node.values() if len(row) > 1 and set(row) & set(entry["where"])]
            for row in shared:
                names = ", ".join(f"'{self.contact_pairs[p].name}'" for p in row)
                sentences.append(
                    f"contacts {names} share an end, and the kernel of law {law.name} sees each of its contacts by "
                    "itself: it ignores what the others at that end press in the same step (it does not declare "
                    "`uses_coupling`)"
                )
        return sentences

    def parameters(self) -> dict[str, dict[str, float]]:
        """Return, for each contact, its law's parameters as they came out."""
        out: dict[str, dict[str, Any]] = {
            contact_pair.name: {"law": contact_pair.law.name} for contact_pair in self.contact_pairs
        }
        for entry in self.laws:
            for name, value in entry["resolved"].items():
                for where, one in zip(entry["where"], np.broadcast_to(value, (len(entry["where"]),)), strict=True):
                    out[self.contact_pairs[where].name][name] = float(one)
        return out

    # -- supports and loads ------------------------------------------------------------------------------

    def _loads(self) -> tuple[list[Constraint], list[NodalForce], list[BodyForce]]:
        constraints: list[Constraint] = []
        nodal_forces: list[NodalForce] = []
        body_forces: list[BodyForce] = []
        for body in self.bodies.values():
            for region in body.spec.fixed:
                node = body.start + body.mesh.regions[region].nodes[0]
                constraints += [Constraint(node, axis, None, 0) for axis in np.eye(self.dim)]
        for column, spec in enumerate(self.case.loads.values(), start=1):
            for body, region in self._targets(spec):
                direction = self._direction(spec, body)
                if spec.acts_as == "velocity":
                    self._drive(
                        constraints,
                        Constraint(body.start + body.mesh.regions[region].nodes[0], direction, spec, column),
                    )
                elif region:
                    node = body.start + body.mesh.regions[region].nodes[0]
                    share = self.mass[node] if spec.acts_as == "acceleration" else 1.0
                    nodal_forces.append(NodalForce(node, share * direction, spec, column))
                else:
                    share = 1.0 if spec.acts_as == "acceleration" else 1.0 / float(body.mass.sum())
                    body_forces.append(BodyForce(body.number, share * direction, spec))
        return constraints, nodal_forces, body_forces

    def _targets(self, spec: LoadSpec) -> list[tuple[Body, str]]:
        if not spec.on:
            return [(body, "") for body in self.bodies.values()]
        return [(self.bodies[address.body], address.region) for address in spec.on]

    def _direction(self, spec: LoadSpec, body: Body) -> Floats:
        given = spec.direction if spec.direction is not None else spec.load.vector()
        if given is None:
            return body.mesh.direction
        direction = np.zeros(self.dim)
        direction[: len(given)] = given
        return direction / np.linalg.norm(direction)

    def _drive(self, constraints: list[Constraint], new: Constraint) -> None:
        """Add a drive unless the node is held along it already."""
        for old in constraints:
            if old.node != new.node or new.load is None:
                continue
            other = "a fixed end" if old.load is None else f"the load '{old.load.name}'"
            apart = old.load is not None and (old.load.stop <= new.load.start or new.load.stop <= old.load.start)
            if apart or abs(float(old.direction @ new.direction)) < 1e-12:
                continue
            self._problem(
                ("loads", new.load.name),
                f"expected an end free along the direction of the drive, found {other} there",
                "An end is fixed or driven, once at a time and along perpendicular directions.",
            )
            return
        constraints.append(new)

    def segments(self, *, laws: bool = True) -> list[tuple[int, int]]:
        """Return runs of steps (first, one past last) within which nothing switches; the trial step included.

        Supports and drives switch, and `laws` that act in intervals of time only.
        """
        total = self.steps + 1
        instants = [t for hold in self.constraints if hold.load is not None for t in (hold.load.start, hold.load.stop)]
        if laws:
            instants += [t for entry in self.laws if entry["during"] is not None for t in entry["during"].ravel()]
        cuts = {0, total}
        for instant in instants:
            if math.isfinite(instant):
                # the first step whose midpoint lies behind the instant
                step = math.floor(instant / self.dt - 0.5) + 1
                cuts.add(min(max(step, 0), total))
        edges = sorted(cuts)
        return list(itertools.pairwise(edges))

    def amplitude(self, spec: LoadSpec, time: Floats, *, average: bool) -> Floats:
        """Return a load's amplitude at the times of consecutive steps.

        With `average` it counts by the share of the step around each time in which the load is on, so that a load
        switched on or off between two times, or within round-off of one, brings its true impulse.
        """
        start = -math.inf if average and spec.start <= 0 else spec.start
        clock = np.clip(time, spec.start, spec.stop) - (spec.start if math.isfinite(spec.start) else 0.0)
        values = np.asarray(spec.load.amplitude(clock), dtype=float)
        if values.shape != time.shape:
            message = f"load {spec.load.name} returned amplitudes of shape {values.shape}, expected {time.shape}"
            raise ValueError(message)
        if not average:
            return values
        half = 0.5 * self.dt
        share = np.minimum(time + half, spec.stop) - np.maximum(time - half, start)
        return values * np.clip(share / self.dt, 0.0, 1.0)

    # -- problems ----------------------------------------------------------------------------------------

    def _problem(self, path: tuple[str | int, ...], message: str, advice: str = "") -> None:
        self._problems.append(self.case.problem(path, message, advice))

    def _raise(self) -> None:
        if self._problems:
            raise InputError(self._problems)

    # -- initial state -----------------------------------------------------------------------------------

    @cached_property
    def initial_velocity(self) -> Floats:
        """Velocity at t = 0, (nodes, dim): that of the bodies, with supports and drives in force."""
        velocity = np.concatenate([np.tile(body.velocity, (body.mass.size, 1)) for body in self.bodies.values()])
        self._prescribe(velocity, 0.0)
        return velocity

    def _prescribe(self, velocity: Floats, time: float) -> None:
        """Set the velocities of supports and drives that hold in the first step; a drive is extended before t = 0."""
        for hold in self.constraints:
            if hold.active(0.5 * self.dt):
                wanted = 0.0
                if hold.load is not None:
                    now, next_ = self.amplitude(hold.load, np.array([0.0, 0.5 * self.dt]), average=False)
                    wanted = now + (next_ - now) * time / (0.5 * self.dt)
                velocity[hold.node] += (wanted - velocity[hold.node] @ hold.direction) * hold.direction

    def starting_velocity(self) -> Floats:
        """Return v_{-1/2} = v_0 - dt/2 M^-1 f_ext(0), (nodes, dim): a second-order start, without contact forces."""
        start = self.initial_velocity.copy()
        for push in self.nodal_forces:
            start[push.node] -= self._before_start(push.load) * push.force / self.mass[push.node]
        bodies = list(self.bodies.values())
        for pull in self.body_forces:
            body = bodies[pull.body]
            start[body.start : body.stop] -= self._before_start(pull.load) * pull.acceleration
        self._prescribe(start, -0.5 * self.dt)
        return start

    def _before_start(self, spec: LoadSpec) -> float:
        """Return the amplitude of a load times how long it acts in [-dt/2, 0], which the first step counts too."""
        if spec.start > 0:
            return 0.0
        amplitude = float(self.amplitude(spec, np.zeros(1), average=False)[0])
        return amplitude * min(max(0.5 * self.dt + min(spec.stop, 0.0), 0.0), 0.5 * self.dt)


def resolved_methods(model: Model) -> Mapping[str, Any]:
    """Return the method of a model as it came out, for the provenance."""
    method = model.case.method
    return {
        "integrator": method.integrator.name,
        "contact": method.contact.name,
        "mass": method.mass.name,
        "contacts": model.parameters(),
        "headline": {pair.name: list(pair.law.headline) for pair in model.contact_pairs},
        "dt": model.dt,
        "steps": model.steps,
        "courant": model.courant,
    }
