"""Supports, drives and loads of a model, and the amplitudes of its loads at the times of its steps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.methods.interfaces import FollowingLoad
from percuss.methods.plugin_calls import answer

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from percuss.case.case import Case
    from percuss.case.specs import LoadSpec
    from percuss.errors import Problem
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats, Integers


# Relative difference of two numbers that are equal but for round-off. A number changes its last digits with the units:
# the factor is rounded, and so is each of the operations that made the number, some 2e-16 each.
ROUND_OFF = 1e-12
DIRECTION_TOLERANCE = 1e-9  # part of a unit vector beyond the directions of constraints that is round-off
FREE_TO_FOLLOW = "An end that follows is free along the load, and has one such load; add their forces in one."


def latest(instant: Any) -> Any:
    """Return the last number that is the same instant but for round-off, of one instant or an array of them."""
    return instant * (1.0 + ROUND_OFF)


def acts_at(midpoint: Any, start: Any, stop: Any) -> Any:
    """Return whether what acts from `start` to `stop` acts in the step around `midpoint`.

    What starts or stops at the midpoint of a step, but for round-off, does so after that step.
    """
    return (latest(start) < midpoint) & (midpoint <= latest(stop))


@dataclass(frozen=True)
class Constraint:
    """A direction in which the velocity of a node is prescribed, always (support) or during an interval (drive).

    `support` is the name of the support or drive that it is part of: ``body.region``, or the name of the load.
    """

    node: int
    direction: Floats
    load: LoadSpec | None
    column: int
    support: str

    def active(self, midpoint: float) -> bool:
        """Return whether the constraint is active in the step around `midpoint`."""
        return self.load is None or bool(acts_at(midpoint, self.load.start, self.load.stop))


def directions_at_nodes(constraints: Iterable[Constraint]) -> dict[int, list[Floats]]:
    """Return the directions in which constraints hold nodes, by node."""
    directions: dict[int, list[Floats]] = {}
    for constraint in constraints:
        directions.setdefault(constraint.node, []).append(constraint.direction)
    return directions


class Held:
    """The directions in which supports, and drives that never start or end, hold nodes throughout a run."""

    def __init__(self, constraints: Iterable[Constraint]) -> None:
        always = (
            one for one in constraints if one.load is None or (one.load.start <= 0.0 and one.load.stop == math.inf)
        )
        self._directions = directions_at_nodes(always)

    def along(self, nodes: Integers, directions: Floats) -> Any:
        """Return whether all nodes of a row are held along its direction, so that no force along it moves them, (n,).

        Parameters
        ----------
        nodes : (n, k) array
        directions : (n, dim) array
        """
        most = max(map(len, self._directions.values()), default=0)
        some, place = np.unique(nodes, return_inverse=True)
        held = np.zeros((some.size, most, directions.shape[1]))
        for own, node in zip(held, some.tolist(), strict=True):
            for k, direction in enumerate(self._directions.get(node, ())):
                own[k] = direction
        free = np.eye(directions.shape[1]) - np.linalg.pinv(held) @ held
        rest = np.einsum("nkij,nj->nki", free[place.reshape(nodes.shape)], directions)
        return (np.linalg.norm(rest, axis=2) < DIRECTION_TOLERANCE).all(axis=1)


@dataclass(frozen=True)
class NodalForce:
    """A force on one node: its vector at amplitude 1, and the load whose amplitude it follows."""

    node: int
    force: Floats
    load: LoadSpec
    column: int

    def impulse_at_start(self, duration: float, velocity: Floats) -> Floats:  # noqa: ARG002
        """Return the impulse of the force within a duration that is weighted with the amplitude, (dim,)."""
        return duration * self.force


@dataclass(frozen=True)
class Follower(NodalForce):
    """A force on one node that follows its motion: a unit vector, its load, its kernel and what this reads."""

    kernel: Callable[..., float]
    numbers: tuple[float, ...]

    @property
    def switched_on(self) -> float:
        """The time from which the load counts its own."""
        return self.load.start if math.isfinite(self.load.start) else 0.0

    def impulse_at_start(self, duration: float, velocity: Floats) -> Floats:
        """Return the impulse of the force at the velocity of its node, (dim,)."""
        motion = max(-self.switched_on, 0.0), 0.0, float(velocity @ self.force)
        force: float = answer(self.load.load, "follow", self.numbers, *motion)
        return duration * force * self.force


@dataclass(frozen=True)
class BodyForce:
    """An acceleration of a whole body: its vector at amplitude 1, and the load whose amplitude it follows."""

    body: int
    acceleration: Floats
    load: LoadSpec


class SupportsAndLoads(NamedTuple):
    """The supports and loads of a case as they act on nodes and bodies."""

    constraints: tuple[Constraint, ...]
    nodal_forces: tuple[NodalForce, ...]
    followers: tuple[Follower, ...]
    body_forces: tuple[BodyForce, ...]

    @property
    def on_nodes(self) -> tuple[NodalForce, ...]:
        """The forces on nodes, those that are given in time before those that follow the motion of their node."""
        return (*self.nodal_forces, *self.followers)

    @property
    def supports(self) -> list[str]:
        """Names of the supports and drives."""
        return list(dict.fromkeys(constraint.support for constraint in self.constraints))

    @property
    def acted_nodes(self) -> list[int]:
        """Nodes on which a support, a drive or a load acts, each as often as that is so."""
        return [*(constraint.node for constraint in self.constraints), *(force.node for force in self.on_nodes)]


def supports_and_loads(case: Case, bodies: Mapping[str, Body], problems: list[Problem]) -> SupportsAndLoads:
    """Return the supports and loads of a case; those that do not fit together are added to `problems`."""
    constraints = list(_supports(case, bodies))
    nodal_forces: list[NodalForce] = []
    followers: list[Follower] = []
    body_forces: list[BodyForce] = []
    # An end that follows must be free of all drives: such loads come last.
    numbered = enumerate(case.loads.values(), start=1)
    for column, spec in sorted(numbered, key=lambda one: isinstance(one[1].load, FollowingLoad)):
        targets = _targets(spec, bodies)
        if isinstance(spec.load, FollowingLoad) and (wrong := _why_not_following(spec, targets)):
            problems.append(case.problem(("loads", spec.name), *wrong))
            continue
        for body, region in targets:
            direction = _direction(spec, body)
            if direction is None:
                message = f"missing (body '{body.name}' has no direction of its own)"
                problems.append(case.problem(("loads", spec.name, "direction"), message, "Give a vector."))
            elif spec.acts_as == "velocity":
                nodes = [node for node, _ in body.places(region)]
                obstacles = (_obstacle_to(spec, node, direction, constraints) for node in nodes)
                if obstacle := next(filter(None, obstacles), ""):
                    message = f"expected an end free along the direction of the drive, found {obstacle} there"
                    advice = "An end is fixed or driven, once at a time and along perpendicular directions."
                    problems.append(case.problem(("loads", spec.name), message, advice))
                else:
                    constraints += [Constraint(node, direction, spec, column, spec.name) for node in nodes]
            elif isinstance(spec.load, FollowingLoad):
                node = body.node(region)
                others = (f"the load '{one.load.name}'" for one in followers if one.node == node)
                if obstacle := _obstacle_to(spec, node, direction, constraints) or next(others, ""):
                    message = f"expected an end that can follow, found {obstacle} there"
                    problems.append(case.problem(("loads", spec.name), message, FREE_TO_FOLLOW))
                numbers = map(float, answer(spec.load, "numbers", body.loaded_end(node)))
                followers.append(Follower(node, direction, spec, column, type(spec.load).follow, tuple(numbers)))
            elif spec.acts_as in {"pressure", "traction"} and region and not body.area_of(region):
                message = f"expected a region with an area, found '{body.name}.{region}' on the axis of revolution"
                problems.append(case.problem(("loads", spec.name), message, "Give a force."))
            elif region:
                nodal_forces += [
                    NodalForce(node, vector, spec, column) for node, vector in _on_region(spec, body, region, direction)
                ]
            else:
                share = 1.0 if spec.acts_as == "acceleration" else 1.0 / float(body.mass.sum())
                body_forces.append(BodyForce(body.number, share * direction, spec))
    return SupportsAndLoads(tuple(constraints), tuple(nodal_forces), tuple(followers), tuple(body_forces))


def _supports(case: Case, bodies: Mapping[str, Body]) -> Iterator[Constraint]:
    """Yield the supports: of each node every direction once, as part of the first support that holds it."""
    for body in bodies.values():
        held: dict[tuple[int, int], str] = {}
        for region, along in body.spec.supports:
            for node, _ in body.places(region):
                for axis in range(case.dimension) if along is None else (along,):
                    held.setdefault((node, axis), f"{body.name}.{region}")
        for (node, axis), support in held.items():
            yield Constraint(node, np.eye(case.dimension)[axis], None, 0, support)


def _on_region(spec: LoadSpec, body: Body, region: str, direction: Floats) -> Iterator[tuple[int, Floats]]:
    """Yield the nodes of a region of the boundary, each with its part of a load there at amplitude 1."""
    if spec.acts_as == "pressure":
        for node, outward in body.outward(region):
            yield node, -outward
        return
    area = body.area_of(region) if spec.acts_as == "traction" else 1.0
    for node, share in body.places(region):
        yield node, (body.mass[node - body.start] if spec.acts_as == "acceleration" else share * area) * direction


def _why_not_following(spec: LoadSpec, targets: Sequence[tuple[Body, str]]) -> tuple[str, str] | None:
    """Return why a load cannot follow the motion of what it acts on, and what to do; None if it can."""
    name = spec.load.name
    if spec.acts_as != "force":
        return f"expected a force, as {name} follows the motion of an end, found as: {spec.acts_as}", "Leave out `as`."
    for body, _ in targets:
        if not body.is_bar:
            advice = "It follows the motion of the end of a bar, which other bodies do not have."
            return f"expected bodies along a line with {name}, found '{body.name}'", advice
    if len(targets) == 1 and targets[0][1]:
        return None
    found = "none" if not spec.on else ", ".join(map(str, spec.on))
    advice = f"Give one end, as `on: {targets[0][0].name}.left`, and each further end a load of its own."
    return f"expected one end to act on, as {name} follows its motion, found {found}", advice


def _targets(spec: LoadSpec, bodies: Mapping[str, Body]) -> list[tuple[Body, str]]:
    """Return the bodies on which a load acts, each with the end at which it acts, empty for the whole body."""
    if not spec.on:  # a velocity without a place is that of walls
        return [(body, "") for body in bodies.values()] if spec.acts_as != "velocity" else []
    return [(bodies[address.body], address.region) for address in spec.on]


def _direction(spec: LoadSpec, body: Body) -> Floats | None:
    """Return the unit vector along which a load acts on a body; None if neither says it.

    That of a pressure differs from place to place, and is no vector here.
    """
    if spec.acts_as == "pressure":
        return np.zeros(body.mesh.nodes.shape[1])
    vector = spec.direction if spec.direction is not None else spec.load.vector()
    if vector is None:
        return body.mesh.direction if body.mesh.line is not None else None
    direction = np.zeros(body.mesh.nodes.shape[1])
    direction[: len(vector)] = vector
    return direction / np.linalg.norm(direction)


def _obstacle_to(spec: LoadSpec, node: int, direction: Floats, constraints: Sequence[Constraint]) -> str:
    """Return the support or drive that already prescribes the motion of a node, in words; empty if there is none."""
    for one in constraints:
        apart = one.load is not None and (one.load.stop <= spec.start or spec.stop <= one.load.start)
        if one.node == node and not apart and abs(float(one.direction @ direction)) >= 1e-12:
            return "a fixed end" if one.load is None else f"the load '{one.load.name}'"
    return ""


def amplitude(spec: LoadSpec, time: Floats, dt: float, *, average: bool) -> Floats:
    """Return a load's amplitude at the times of consecutive steps of length `dt`.

    With `average`, the amplitude is multiplied by the fraction of the step around each time during which the load
    is on, so that a load that is switched on or off between two times, or within round-off of one, has its exact
    impulse.
    """
    start = -math.inf if average and spec.start <= 0 else spec.start
    clock = np.clip(time, spec.start, spec.stop) - (spec.start if math.isfinite(spec.start) else 0.0)
    values = np.asarray(answer(spec.load, "amplitude", clock), dtype=float)
    if not average:
        return values
    half = 0.5 * dt
    share = np.minimum(time + half, spec.stop) - np.maximum(time - half, start)
    return values * np.clip(share / dt, 0.0, 1.0)
