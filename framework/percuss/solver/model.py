"""The arrays that describe a checked case: nodes, masses, elements, contact points, supports, loads, time step."""

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
from percuss.solver.contact_rows import Side, broadcast, delassus_rows, intervals, kernel_law_records, law_records
from percuss.solver.entities import Body, BodyForce, Constraint, ContactPair, NodalForce, end_reserves
from percuss.solver.integrator_check import refuse_end, refuse_unseen, scheme

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from percuss.case.case import Address, Case, ContactSpec, LoadSpec

# Contact stiffness limits are computed for at most this Courant number of a body: above it central difference leaves
# almost no stiffness for a penalty without mass.
LARGEST_COURANT = 0.99
TOUCHING = 1e-9  # fraction of an element length; a smaller initial gap or overlap is set to zero


class Stretch(NamedTuple):
    """A part of a run during which the set of active supports and drives and the set of active laws do not change."""

    start: float
    stop: float
    model: Model  # the same model without loads, its supports and drives at rest


class Model:
    """The arrays of a case.

    Parameters
    ----------
    case
        A checked case.
    dt
        Time step; by default that of the case, or that of Courant number 1 where the case gives none.

    Raises
    ------
    InputError
        If the geometry, the contacts or the loads do not fit together.
    RefusedPair
        If the integrator and a contact law do not work together.
    """

    def __init__(self, case: Case, dt: float | None = None) -> None:
        self.case = case
        self.dim = case.dimension
        self.whole = self  # the model of the whole run, also in the model of a stretch
        self._problems: list[Problem] = []
        self.bodies = size_limits.checked_bodies(case, self._make_bodies)
        self.n_nodes = sum(body.mass.size for body in self.bodies.values())
        self.mass = np.concatenate([body.mass for body in self.bodies.values()])
        self.nodes = np.concatenate([body.mesh.nodes for body in self.bodies.values()])
        self.omega = max(float(body.frequency.max()) for body in self.bodies.values())
        self.dt, self.steps = self._time_step(dt)
        self.contact_pairs = [
            contact_pair for spec in case.contacts.values() if (contact_pair := self._contact_pair(spec)) is not None
        ]
        self.constraints, self.nodal_forces, self.body_forces = self._loads()
        self._raise_problems()
        self._refuse_pairs()
        self.stages, self.tables = scheme(case.method.integrator, self.dt)
        self._inactive: tuple[int, ...] = ()
        self._check_movable()
        self.laws = self._laws()
        self._raise_problems()
        refuse_end(case.method.integrator, self.stages, self.laws)
        refuse_unseen(case.method.integrator, self.tables, self.laws)

    # -- bodies ------------------------------------------------------------------------------------------

    def _make_bodies(self) -> dict[str, Body]:
        bodies: dict[str, Body] = {}
        start = 0
        for number, (name, spec) in enumerate(self.case.bodies.items()):
            mesh = size_limits.mesh_of_body(self.case, spec)
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

    def _time_step(self, dt: float | None) -> tuple[float, int]:
        time = self.case.time
        if dt is None:
            courant = 1.0 if time.courant is None or time.courant == "auto" else time.courant
            dt = time.step if time.step is not None else courant * 2.0 / self.omega
        size_limits.check_step(self.case, dt)
        return dt, time.steps if time.steps is not None else size_limits.step_count(self.case, dt)

    def stretches(self) -> list[Stretch]:
        """Return the stretches of the run that differ in their active supports and drives, or in their active laws.

        A stretch with the same constraints and laws as an earlier one is not listed again.
        """
        listed: dict[Any, Stretch] = {}
        for first, last in self.segments():
            midpoint = (first + 0.5) * self.dt
            constraints = tuple(
                index for index, constraint in enumerate(self.constraints) if constraint.active(midpoint)
            )
            inactive = self.inactive_points(midpoint)
            if (constraints, inactive) not in listed:
                at_rest = [dataclasses.replace(self.constraints[index], load=None, column=0) for index in constraints]
                model = self.without_loads(self.dt, at_rest, inactive)
                start, stop = first * self.dt, min(last, self.steps) * self.dt
                listed[constraints, inactive] = Stretch(start, max(stop, start), model)
        return list(listed.values())

    def inactive_points(self, midpoint: float) -> tuple[int, ...]:
        """Return the contact points whose law is not active in the step around `midpoint`."""
        inactive = list(self._inactive)
        for entry in self.laws:
            during = entry["during"]
            if during is not None and not ((during[:, 0] < midpoint) & (midpoint < during[:, 1])).any():
                inactive += entry["where"]
        return tuple(sorted(set(inactive)))

    def without_loads(self, dt: float, constraints: Sequence[Constraint], inactive: Sequence[int] = ()) -> Model:
        """Return the model of one stretch: no loads, `constraints` as given, laws bound again for the time step `dt`.

        Parameters
        ----------
        dt
            Time step.
        constraints
            The supports and drives of the stretch.
        inactive
            Contact points whose law is never active; all other laws are always active.
        """
        model = copy.copy(self)
        model.__dict__.pop("initial_velocity", None)
        model.dt, model.steps, model.nodal_forces, model.body_forces = dt, 1, [], []
        model.constraints = list(constraints)
        model._inactive = tuple(inactive)
        model.stages, model.tables = scheme(self.case.method.integrator, dt)
        model.laws = [{**entry, "during": None} for entry in model._laws()]
        model._raise_problems()
        return model

    @property
    def multistage(self) -> bool:
        """Whether the integrator is a multi-stage scheme; if not, it is a leap-frog scheme."""
        return self.stages is not None

    @property
    def why_not_linear(self) -> str:
        """The reason why internal forces are not proportional to displacements; empty where all bodies are linear."""
        return "; ".join(filter(None, (body.why_not_linear for body in self.bodies.values())))

    @property
    def courant(self) -> float:
        """Courant number of the element with the smallest h/c."""
        return 0.5 * self.dt * self.omega

    def node(self, address: Address) -> int:
        """Return the node at an end of a body."""
        body = self.bodies[address.body]
        return body.start + body.mesh.regions[address.region].nodes[0]

    def body_of(self, node: int) -> Body:
        """Return the body that contains a node."""
        return next(body for body in self.bodies.values() if body.start <= node < body.stop)

    # -- contacts ----------------------------------------------------------------------------------------

    def _contact_pair(self, spec: ContactSpec) -> ContactPair | None:
        path = ("contacts", spec.name)
        first = self.bodies[spec.sides[0].body]
        normal = first.mesh.regions[spec.sides[0].region].outward
        nodes = tuple(self.node(side) for side in spec.sides)
        position = self.nodes[nodes[0]]
        if len(nodes) == 1:
            gap = self._wall_gap(spec, position, normal, first.mesh.direction)
        else:
            opposite = self.bodies[spec.sides[1].body].mesh.regions[spec.sides[1].region].outward
            if float(normal @ opposite) > -1.0 + 1e-9:
                angle = math.degrees(math.acos(max(-1.0, min(1.0, -float(normal @ opposite)))))
                self._add_problem(
                    (*path, "between"),
                    f"expected two ends that face each other, found {spec.sides[0]} and {spec.sides[1]} "
                    f"turned by {angle:.6g} degrees",
                    "Contact is between bars along one line: a right end meets a left end.",
                )
                return None
            gap = float(normal @ (self.nodes[nodes[1]] - position))
            offset = float(np.linalg.norm(self.nodes[nodes[1]] - position - gap * normal))
            if offset > 1e-6 * min(float(self.bodies[side.body].mesh.lengths.sum()) for side in spec.sides):
                self._add_problem(
                    (*path, "between"),
                    f"expected two ends on one line, found {spec.sides[1]} {offset:.6g} beside {spec.sides[0].body}",
                    "Move one of the bodies (`at`) or turn it (`direction`).",
                )
                return None
        elements = [self.body_of(node).end_element(node) for node in nodes]
        bodies = [self.body_of(node) for node in nodes]
        size = min(float(body.mesh.lengths[element]) for body, element in zip(bodies, elements, strict=True))
        if gap < -TOUCHING * size:
            self._add_problem(
                path,
                f"expected bodies apart or touching, found an overlap of {-gap:.6g}",
                f"Move them apart by {-gap:.17g}, or drop the contact.",
            )
            return None
        stiffness = [float(body.stiffness[element]) for body, element in zip(bodies, elements, strict=True)]
        frequency = [float(body.frequency[element]) for body, element in zip(bodies, elements, strict=True)]
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

    def _wall_gap(self, spec: ContactSpec, position: Floats, normal: Floats, direction: Floats) -> float:
        wall = np.asarray(spec.wall, dtype=float)
        if wall.ndim == 1:
            return float(normal @ (wall - position))
        # A wall given as a number is a coordinate along the bar; for a bar on the x axis it is x, whichever way the bar
        # points.
        axis = np.abs(direction) if abs(direction[0]) == 1.0 else direction
        return float((wall - position @ axis) * (axis @ normal))

    def points(self, where: Sequence[int], dt: float) -> ContactPoints:
        """Return the properties of the contact points `where` that a law receives for a time step `dt`."""

        def column(values: Any, dtype: type = float) -> Any:
            array: Any = np.array(values, dtype=dtype)
            array.flags.writeable = False
            return array

        contact_pairs = [self.contact_pairs[p] for p in where]
        delassus, coupling = self.whole._largest_delassus
        return ContactPoints(
            names=tuple(contact_pair.name for contact_pair in contact_pairs),
            stiffness=column([contact_pair.stiffness for contact_pair in contact_pairs]),
            frequency=column([contact_pair.frequency for contact_pair in contact_pairs]),
            mass=column([contact_pair.mass for contact_pair in contact_pairs]),
            equal_sides=column([contact_pair.equal_sides for contact_pair in contact_pairs], bool),
            delassus=column(delassus[where]),
            coupling=column(coupling[where]),
            weight=column([1.0] * len(contact_pairs)),
            limits=lambda: column(self.whole._stiffness_limits(dt)[where]),
        )

    @cached_property
    def _largest_delassus(self) -> tuple[Floats, Floats]:
        """The largest diagonal entry s of S over the run, and the largest absolute row sum of S over s, (P,) each."""
        largest, sums = np.zeros(len(self.contact_pairs)), np.zeros(len(self.contact_pairs))
        for start, _ in self.segments(laws=False):
            diagonal, others = delassus_rows(self.sides((start + 0.5) * self.dt))
            largest = np.maximum(largest, diagonal)
            sums = np.maximum(sums, diagonal + np.array([sum(map(abs, row.values())) for row in others]))
        return largest, sums / largest

    def _stiffness_limits(self, dt: float) -> Floats:
        """Return `ContactPoints.stiffness_limit` of all points for a time step `dt`, (P,) [force/length].

        With B = (4/dt^2) M - K of a body and its end displacements u_a and u_b, ``u^T B u`` is at least
        ``r_a u_a^2 + r_b u_b^2``; both r follow from the inverse of B at the end nodes (`end_reserves`). A closed
        contact of stiffness eps_s subtracts ``eps_s (u_a - u_b)^2``, which is not larger than that if
        ``eps_s (1/r_a + 1/r_b) <= 1``. Contacts that share an end share its r equally.
        """
        uses = Counter(node for contact_pair in self.contact_pairs for node in contact_pair.nodes)
        supported = {constraint.node for constraint in self.constraints if constraint.load is None}
        reserve: dict[int, float] = {}
        for body in self.bodies.values():
            ends = [node for node in (body.start, body.stop - 1) if node in uses]
            if ends:
                step = min(dt, LARGEST_COURANT * 2.0 / float(body.frequency.max()))
                reserve.update(end_reserves(body, step, ends))
        with np.errstate(divide="ignore"):
            softness = [
                sum(uses[node] / np.float64(reserve[node]) for node in contact_pair.nodes if node not in supported)
                for contact_pair in self.contact_pairs
            ]
            return 1.0 / np.array(softness, dtype=float)

    def sides(self, midpoint: float) -> list[list[Side]]:
        """Return the sides of every contact point, one at a wall, for the supports and drives active at `midpoint`."""
        directions: dict[int, list[Floats]] = {}
        for constraint in self.constraints:
            if constraint.active(midpoint):
                directions.setdefault(constraint.node, []).append(constraint.direction)
        sides = []
        for contact_pair in self.contact_pairs:
            pair_sides = []
            for node, normal in contact_pair.rows():
                free = normal.copy()
                for direction in directions.get(node, ()):
                    free -= (direction @ free) * direction
                pair_sides.append(Side(node, normal, free / self.mass[node]))
            sides.append(pair_sides)
        return sides

    def _check_movable(self) -> None:
        for start, _ in self.segments(laws=False):
            diagonal = delassus_rows(self.sides((start + 0.5) * self.dt))[0]
            for contact_pair, delassus in zip(self.contact_pairs, diagonal, strict=True):
                if delassus * min(self.mass[node] for node in contact_pair.nodes) < 1e-12:
                    self._add_problem(
                        ("contacts", contact_pair.name),
                        "expected a contact that can move, found every side fixed or driven",
                        "Free one of the ends, or drop the contact.",
                    )
            if self._problems:
                break
        self._raise_problems()

    def _refuse_pairs(self) -> None:
        integrator = self.case.method.integrator
        for contact_pair in self.contact_pairs:
            for reason, refusing in (
                (integrator.refuses(contact_pair.law), integrator.name),
                (contact_pair.law.refuses(integrator), contact_pair.law.name),
            ):
                if reason:
                    raise RefusedPair(integrator.name, contact_pair.law.name, reason, refusing)

    def _laws(self) -> list[dict[str, Any]]:
        """Return the bound laws, one entry for each law, linear laws before laws with a kernel.

        The loop solves linear laws with the contact equation; the other laws fill their part of the multipliers last
        in this order, by kernels of their own.
        """
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
                self._add_problem(("method", "contact"), str(error))
                continue
            during = intervals(bound, law.name) if isinstance(bound, LinearLaw) else None
            laws.append(
                {"law": law, "where": where, "bound": bound, "resolved": resolved, "points": points, "during": during}
            )
        return sorted(laws, key=lambda entry: not isinstance(entry["bound"], LinearLaw))

    def delassus(self, midpoint: float) -> Floats:
        """Return the diagonal of S = N^T M^-1 N at a time, (P,) [1/mass]."""
        return delassus_rows(self.sides(midpoint))[0]

    def law_records(self, delassus: Floats, table: LeapFrog | None = None) -> tuple[list[int], Any]:
        """Return the order of the contact points in the loop, and their law records in that order, (P,) `LAW`."""
        table = table or self.tables[-1]
        order: list[int] = []
        parts = [kernel_law_records(0)]
        for entry in self.laws:
            law, where = entry["law"], entry["where"]
            order += where
            if isinstance(entry["bound"], LinearLaw):
                coefficients = broadcast(entry["bound"], entry["points"], law.name)
                parts.append(law_records(coefficients, table, delassus[where], law.name))
            else:
                parts.append(kernel_law_records(len(where)))
        records = np.concatenate(parts)
        if self.stages is not None:
            records["stores"] = NOTHING
        return order, records

    def ignored_couplings(self) -> list[str]:
        """Return one sentence for each end shared by contacts of which a law with a kernel ignores the coupling."""
        at_node: dict[int, list[int]] = {}
        for p, contact_pair in enumerate(self.contact_pairs):
            for node in contact_pair.nodes:
                at_node.setdefault(node, []).append(p)
        sentences = []
        for entry in self.laws:
            law: ContactLaw = entry["law"]
            if isinstance(entry["bound"], LinearLaw) or law.uses_coupling:
                continue
            shared_ends = [
                contacts for contacts in at_node.values() if len(contacts) > 1 and set(contacts) & set(entry["where"])
            ]
            for contacts in shared_ends:
                names = ", ".join(f"'{self.contact_pairs[p].name}'" for p in contacts)
                sentences.append(
                    f"contacts {names} share an end, and the kernel of law {law.name} sees each of its contacts by "
                    "itself: it ignores what the others at that end press in the same step (it does not declare "
                    "`uses_coupling`)"
                )
        return sentences

    def parameters(self) -> dict[str, dict[str, float]]:
        """Return, for each contact, the name of its law and its resolved parameters."""
        parameters: dict[str, dict[str, Any]] = {
            contact_pair.name: {"law": contact_pair.law.name} for contact_pair in self.contact_pairs
        }
        for entry in self.laws:
            for name, value in entry["resolved"].items():
                for point, number in zip(entry["where"], np.broadcast_to(value, (len(entry["where"]),)), strict=True):
                    parameters[self.contact_pairs[point].name][name] = float(number)
        return parameters

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
                    self._add_drive(
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
        vector = spec.direction if spec.direction is not None else spec.load.vector()
        if vector is None:
            return body.mesh.direction
        direction = np.zeros(self.dim)
        direction[: len(vector)] = vector
        return direction / np.linalg.norm(direction)

    def _add_drive(self, constraints: list[Constraint], drive: Constraint) -> None:
        """Add a drive, or report a problem where the node is already fixed or driven along its direction."""
        for existing in constraints:
            if existing.node != drive.node or drive.load is None:
                continue
            obstacle = "a fixed end" if existing.load is None else f"the load '{existing.load.name}'"
            apart = existing.load is not None and (
                existing.load.stop <= drive.load.start or drive.load.stop <= existing.load.start
            )
            if apart or abs(float(existing.direction @ drive.direction)) < 1e-12:
                continue
            self._add_problem(
                ("loads", drive.load.name),
                f"expected an end free along the direction of the drive, found {obstacle} there",
                "An end is fixed or driven, once at a time and along perpendicular directions.",
            )
            return
        constraints.append(drive)

    def segments(self, *, laws: bool = True) -> list[tuple[int, int]]:
        """Return intervals of steps (first, one past last) within which no support, drive or law starts or ends.

        The trial step after the last step is included. Without `laws`, the intervals of time in which laws are active
        do not split the run.
        """
        total = self.steps + 1
        instants = [
            instant
            for constraint in self.constraints
            if constraint.load is not None
            for instant in (constraint.load.start, constraint.load.stop)
        ]
        if laws:
            instants += [
                instant for entry in self.laws if entry["during"] is not None for instant in entry["during"].ravel()
            ]
        cuts = {0, total}
        for instant in instants:
            if math.isfinite(instant):
                # The change takes effect in the first step whose midpoint lies after the instant.
                step = math.floor(instant / self.dt - 0.5) + 1
                cuts.add(min(max(step, 0), total))
        edges = sorted(cuts)
        return list(itertools.pairwise(edges))

    def amplitude(self, spec: LoadSpec, time: Floats, *, average: bool) -> Floats:
        """Return a load's amplitude at the times of consecutive steps.

        With `average`, the amplitude is multiplied by the fraction of the step around each time during which the load
        is on, so that a load that is switched on or off between two times, or within round-off of one, has its exact
        impulse.
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

    def _add_problem(self, path: tuple[str | int, ...], message: str, advice: str = "") -> None:
        self._problems.append(self.case.problem(path, message, advice))

    def _raise_problems(self) -> None:
        if self._problems:
            raise InputError(self._problems)

    # -- initial state -----------------------------------------------------------------------------------

    @cached_property
    def initial_velocity(self) -> Floats:
        """Velocity at t = 0, (nodes, dim): that of the bodies, subject to the active supports and drives."""
        velocity = np.concatenate([np.tile(body.velocity, (body.mass.size, 1)) for body in self.bodies.values()])
        self._impose_velocities(velocity, 0.0)
        return velocity

    def _impose_velocities(self, velocity: Floats, time: float) -> None:
        """Set the velocities of the supports and drives that are active in the first step.

        A prescribed velocity is extrapolated linearly to a `time` before t = 0.
        """
        for constraint in self.constraints:
            if constraint.active(0.5 * self.dt):
                prescribed = 0.0
                if constraint.load is not None:
                    at_start, at_midpoint = self.amplitude(
                        constraint.load, np.array([0.0, 0.5 * self.dt]), average=False
                    )
                    prescribed = at_start + (at_midpoint - at_start) * time / (0.5 * self.dt)
                velocity[constraint.node] += (
                    prescribed - velocity[constraint.node] @ constraint.direction
                ) * constraint.direction

    def starting_velocity(self) -> Floats:
        """Return v_{-1/2} = v_0 - dt/2 M^-1 f_ext(0), (nodes, dim), without contact forces.

        With this starting velocity the scheme is of second order.
        """
        velocity = self.initial_velocity.copy()
        for nodal_force in self.nodal_forces:
            velocity[nodal_force.node] -= (
                self._impulse_before_start(nodal_force.load) * nodal_force.force / self.mass[nodal_force.node]
            )
        bodies = list(self.bodies.values())
        for body_force in self.body_forces:
            body = bodies[body_force.body]
            velocity[body.start : body.stop] -= self._impulse_before_start(body_force.load) * body_force.acceleration
        self._impose_velocities(velocity, -0.5 * self.dt)
        return velocity

    def _impulse_before_start(self, spec: LoadSpec) -> float:
        """Return the amplitude of a load at t = 0 times its duration within [-dt/2, 0].

        The force of the first step acts over that half step too, so that the starting velocity has to compensate it.
        """
        if spec.start > 0:
            return 0.0
        amplitude = float(self.amplitude(spec, np.zeros(1), average=False)[0])
        return amplitude * min(max(0.5 * self.dt + min(spec.stop, 0.0), 0.0), 0.5 * self.dt)


def resolved_methods(model: Model) -> Mapping[str, Any]:
    """Return the methods of a model with their resolved parameters and the time step, for the provenance."""
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
