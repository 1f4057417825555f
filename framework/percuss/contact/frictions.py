"""The frictions of a model bound to its contact points: tangents, stiffness of stick, and what they refuse."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.case.type_words import found
from percuss.contact.laws import bind_laws, laws_at
from percuss.contact.model import rows_over_the_run
from percuss.contact.moving_rows import with_rows_that_stay
from percuss.contact.points import PointArrays, joined
from percuss.contact.prisms import stress_along
from percuss.errors import Problem
from percuss.mesh.stiffness_rows import in_order
from percuss.methods.interfaces import ContactLaw, ContactPoints, FrictionPoints, LinearLaw
from percuss.methods.plugin_calls import answer, read_only

if TYPE_CHECKING:
    from percuss.contact.bound_law import BoundLaw
    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats, Friction, Integers

ALONG_NORMAL = 1e-9  # of the largest entry of a row of N; what is off the normal by more is no share of it


@dataclass(frozen=True, eq=False)
class BoundFriction:
    """A friction bound to its contact points for one time step.

    Attributes
    ----------
    friction
        The friction with its options.
    where : (P,) array
        Numbers of its contact points, in the order of the case.
    data
        What its `bind` has returned.
    compliance : (P,) array
        sigma_t: compliance of stick, 0 where a point sticks exactly [length/force].
    response : (P,) array
        w_t, the factor of S in the row of a tangent [time^2].
    predicted : (P,) bool array
        Whether slip is taken after the bulk update, not at t_n.
    """

    friction: Friction
    where: Integers
    data: Any
    compliance: Floats
    response: Floats
    predicted: Any


class Line(NamedTuple):
    """The line by which the points of one contact stick, as their law is evaluated; (P,) arrays."""

    where: Integers  # their numbers in the order of the case
    linear: LinearLaw | None  # the law of the normal; None of a kernel
    compliance: Floats  # as of `BoundFriction`
    inertia: Floats  # weight of the acceleration, the eps_m / eps_s of the normal; 0 at the end of the step


def frictional(model: Model) -> dict[str, Friction]:
    """Return the friction of each contact that has one; none where the model sticks by lines."""
    if any(isinstance(law, Stick) for law in model.contact_points.laws):
        return {}
    found = {name: spec.friction for name, spec in model.case.contacts.items() if spec.friction is not None}
    return {name: friction for name, friction in found.items() if friction.acts}


def frictions_of(model: Model) -> list[BoundFriction]:
    """Return the frictions of a model, each bound to its points."""
    groups: dict[Friction, list[Line]] = {}
    for name, friction in frictional(model).items():
        groups.setdefault(friction, []).append(_line(model, name, model.laws))
    return [_bound(model, friction, lines) for friction, lines in groups.items()]


def _bound(model: Model, friction: Friction, lines: Sequence[Line]) -> BoundFriction:
    """Return a friction bound to the points of its contacts."""
    points, table = model.contact_points, model.tables[-1]
    where = np.concatenate([line.where for line in lines])
    names = tuple(points.names[p] for p in where.tolist())
    response, predicted = [], []
    for line in lines:
        at = table.end if line.linear is None or line.linear.at == "end" else table.explicit
        response.append(at.response[0] + line.inertia * at.response[2])
        predicted.append(np.full(line.where.size, at.gap == "predicted"))
    return BoundFriction(
        friction=friction,
        where=where,
        data=read_only(answer(friction, "bind", FrictionPoints(names, read_only(points.weight[where])), model.dt)),
        compliance=np.concatenate([line.compliance for line in lines]),
        response=np.concatenate(response),
        predicted=np.concatenate(predicted),
    )


def _line(model: Model, contact: str, laws: Iterable[BoundLaw]) -> Line:
    """Return the line by which the points of a contact stick, under its law among bound ones.

    The compliance is 0 where they stick exactly, and nan where no line follows.
    """
    points, friction = model.contact_points, model.case.contacts[contact].friction
    where = np.flatnonzero(points.of_contact(contact))
    bound_law = next(one for one in laws if where[0] in one.where)
    linear: Any = bound_law.linear  # whose arrays are broadcast to its points
    own = np.searchsorted(bound_law.where, where)
    at_end = linear is None or linear.at == "end"
    sigma = linear.sigma[own] if linear is not None else np.zeros(where.size)
    inertia = np.zeros(where.size) if at_end else linear.acceleration[own]
    given = friction.stiffness if friction is not None else None
    if given is not None and not isinstance(given, str):
        return Line(where, linear, 1.0 / (given * points.weight[where]), inertia)
    if given == "exact" or not sigma.any():
        return Line(where, linear, np.full(where.size, 0.0 if at_end else np.nan), inertia)
    poisson = _poisson(model, contact)
    return Line(where, linear, sigma * (2.0 - poisson) / (2.0 * (1.0 - poisson)), inertia)


def _poisson(model: Model, contact: str) -> float:
    """Return Poisson's ratio of the softer body of a contact, from the stress across a small strain."""
    bodies = [model.bodies[side.body] for side in model.case.contacts[contact].sides]
    softer = min(bodies, key=lambda body: body.modulus)
    stress, _ = stress_along(softer, np.eye(model.dim)[0])
    ratio = float(stress[1, 1] / stress[0, 0])
    return ratio if softer.view.plane == "stress" else ratio / (1.0 + ratio)


def tangents_of(normal: Floats) -> Floats:
    """Return the unit tangents at points with these normals, (P, dim - 1, dim)."""
    if normal.shape[1] == 2:
        return np.stack([-normal[:, 1], normal[:, 0]], axis=1)[:, None]
    axis = np.zeros_like(normal)
    axis[np.arange(len(normal)), np.abs(normal).argmin(axis=1)] = 1.0
    first = np.cross(normal, axis)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([first, np.cross(normal, first)], axis=1)


@dataclass(frozen=True, eq=False)
class Stick(ContactLaw):
    """What holds points along the surfaces while they stick, as a certificate examines it: a line at any gap."""

    name = "stick"
    summary = "Stick as a line"

    model: Model
    contact: str

    def bind(self, points: ContactPoints, dt: float) -> LinearLaw:  # noqa: ARG002
        """Return the line of stick, which is evaluated at the same state as the normal one and has its inertia."""
        line = _line(self.model, self.contact, laws_at(self.model, dt))
        at = line.linear.at if line.linear is not None else "end"
        axes = self.model.dim - 1
        compliance, inertia = np.tile(line.compliance, axes), np.tile(line.inertia, axes)
        return LinearLaw(at, compliance, acceleration=inertia, active="all")


def with_stick(model: Model) -> Model:
    """Return a model whose points with friction have further points along the surfaces, which all stick."""
    points = with_rows_that_stay(model).contact_points
    parts, along = [points], tangents_of(points.normal)
    for name in frictional(model):
        law, where = Stick(model, name), np.flatnonzero(points.of_contact(name))
        for axis in range(model.dim - 1):
            rows = dataclasses.replace(points, value=points.share[:, None] * along[points.point, axis])
            parts.append(_some(rows, where, law))
    features = tuple(one for one in model.features if one.held is None)
    found = dataclasses.replace(model, contact_points=joined(parts), features=features, run=None)
    found = dataclasses.replace(found, rows=rows_over_the_run(found))
    return dataclasses.replace(found, laws=bind_laws(found, found.dt))


def _some(points: PointArrays, where: Integers, law: ContactLaw) -> PointArrays:
    """Return some contact points, touching, with another law."""
    _, entry = in_order(points.start, where)
    of_points = {
        field.name: getattr(points, field.name)[where]
        for field in dataclasses.fields(points)
        if field.name not in {"names", "laws", "node", "value", "gap"}
    }
    return PointArrays(
        names=tuple(points.names[p] for p in where.tolist()),
        laws=(law,) * where.size,
        node=points.node[entry],
        value=points.value[entry],
        gap=np.zeros(where.size),
        **of_points,
    )


def stick_in_words(model: Model, contact: str) -> str:
    """Return how the points of a contact with friction stick, in words: those of its first point."""
    line, friction = _line(model, contact, model.laws), frictional(model)[contact]
    if not line.compliance[0]:
        return "sticks exactly"
    per_area = 1.0 / (line.compliance[0] * model.contact_points.weight[line.where[0]])
    auto = ", auto: 2 (1 - nu) / (2 - nu) of that of the law" if friction.stiffness in {None, "auto"} else ""
    return f"sticks with a stiffness of {per_area:.6g} per area{auto}"


def refusals(model: Model) -> Iterator[Problem]:
    """Yield what does not go with friction: bars, bonds, schemes of stages, laws that leave stick without a line."""
    case, acting = model.case, frictional(model)
    reasons = {name: why for name in acting if (why := _why_frictionless(model, name))}
    for name, (message, advice) in reasons.items():
        yield case.problem(_path(model, name), message.format(acting[name].name), advice)
    for bound in [] if reasons else frictions_of(model):
        exact = (bound.compliance == 0.0) & (bound.response <= 0.0)
        without = np.isnan(bound.compliance) | exact
        for name in dict.fromkeys(model.contact_points.names[p] for p in bound.where[without]):
            friction: Any = case.contacts[name].friction
            given = found(friction.stiffness) if friction.stiffness else "none"
            message = f"expected a stiffness of stick under {case.contacts[name].law.name}, found {given}"
            advice = "Of a law that is not judged at the end of the step no exact stick follows: give a number."
            yield case.problem((*_path(model, name), "stiffness"), message, advice)


def _path(model: Model, contact: str) -> tuple[str, ...]:
    """Return where the case names the friction of a contact."""
    own = ("contacts", contact, "friction")
    return own if model.case.origin.get(own) is not None else ("method", "friction")


def _why_frictionless(model: Model, contact: str) -> tuple[str, str] | None:
    """Return why a contact cannot have a friction, and what to do; None if it can."""
    spec, points = model.case.contacts[contact], model.contact_points
    where = {p for p, name in enumerate(points.names) if name == contact}
    laws = [one for one in model.laws if not where.isdisjoint(one.where)]
    if any(model.bodies[side.body].is_bar for side in spec.sides):
        return "expected no friction on bars, which meet along one line, found {}", "Drop it, or take solids."
    if model.multistage:
        scheme = model.case.method.integrator.name
        return f"expected a leap-frog scheme with friction, found {{}} with {scheme}", "Take central-difference."
    if any(one.bonds for one in laws):
        advice = "A bond holds its bodies along the surfaces too: drop the friction."
        return f"expected a law that lets bodies part, found {{}} with {spec.law.name}", advice
    entries = np.isin(points.point, list(where))
    off = points.value - points.share[:, None] * points.normal[points.point]
    if np.abs(off[entries]).max(initial=0.0) > ALONG_NORMAL * np.abs(points.value[entries]).max(initial=0.0):
        pairing = spec.pairing.name if spec.pairing is not None else ""
        advice = "Take node-to-segment, gauss-points or mortar."
        return f"expected a pairing whose rows are shares of the normal, found {{}} with {pairing}", advice
    return None
