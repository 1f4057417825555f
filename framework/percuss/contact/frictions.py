"""The frictions of a model bound to its contact points: tangents, stiffness of stick, and what they refuse."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contact.laws import bind_laws, laws_at
from percuss.contact.model import rows_over_the_run
from percuss.contact.points import FROM_KERNEL, PointArrays, joined
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


def frictions_of(model: Model) -> list[BoundFriction]:
    """Return the frictions of a model that act, each bound to its points; none where the model sticks by lines."""
    groups: dict[Friction, list[int]] = {}
    for p, (name, law) in enumerate(zip(model.contact_points.names, model.contact_points.laws, strict=True)):
        if isinstance(law, Stick):
            return []
        if (friction := model.case.contacts[name].friction) is not None and friction.acts:
            groups.setdefault(friction, []).append(p)
    if not groups:
        return []
    law_of = _law_of(model.laws)
    order, laws = model.law_records()
    records = laws[np.argsort(order)]
    points, found = model.contact_points, []
    for friction, group in groups.items():
        where = np.array(group, dtype=np.int64)
        of_kernel = records["source"][where] == FROM_KERNEL
        given = FrictionPoints(tuple(points.names[p] for p in group), read_only(points.weight[where]))
        stiffness = np.array([_stiffness(model, p, *law_of[p]) for p in group])
        found.append(
            BoundFriction(
                friction=friction,
                where=where,
                data=read_only(answer(friction, "bind", given, model.dt)),
                compliance=1.0 / stiffness,
                response=np.array([_response(model, *law_of[p]) for p in group]),
                predicted=of_kernel | (records["sees_predicted_gap"][where] == 1),
            )
        )
    return found


def _response(model: Model, bound_law: BoundLaw, k: int) -> float:
    """Return w_t of a point: the response of its slip where its law is evaluated, and of the inertia that this has."""
    linear, table = bound_law.linear, model.tables[-1]
    if linear is None or linear.at == "end":
        return float(table.end.response[0])
    of_slip, _, of_inertia = table.explicit.response
    return float(of_slip + np.ravel(linear.acceleration)[k] * of_inertia)


def _stiffness(model: Model, point: int, bound_law: BoundLaw, k: int) -> float:
    """Return the stiffness of stick of a point, infinite where it sticks exactly, nan where there is none."""
    points, linear = model.contact_points, bound_law.linear
    compliance = float(np.ravel(linear.sigma)[k]) if linear is not None else 0.0
    friction = model.case.contacts[points.names[point]].friction
    given = friction.stiffness if friction is not None else None
    if given is None:
        given = "auto" if compliance > 0.0 else "exact"
    if isinstance(given, str) and (given == "exact" or (compliance == 0.0 and _at_end(bound_law))):
        return math.inf if _at_end(bound_law) else math.nan
    if isinstance(given, str):
        poisson = _poisson(model, points.names[point])
        return 2.0 * (1.0 - poisson) / (2.0 - poisson) / compliance if compliance > 0.0 else math.nan
    return float(given * points.weight[point])


def _at_end(bound_law: BoundLaw) -> bool:
    """Return whether a law is judged at the end of the step, as are those with a kernel."""
    return bound_law.linear is None or bound_law.linear.at == "end"


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
    where: Integers
    at: Any

    def bind(self, points: ContactPoints, dt: float) -> LinearLaw:  # noqa: ARG002
        """Return the line of stick, which is evaluated at the same state as the normal one and has its inertia."""
        laws = _law_of(laws_at(self.model, dt))
        stiffness = [_stiffness(self.model, p, *laws[p]) for p in self.where.tolist()]
        weights = [line.acceleration[k] for line, k in _lines(laws, self.where) if self.at == "explicit"]
        return LinearLaw(self.at, 1.0 / np.array(stiffness), acceleration=np.array(weights or 0.0), active="all")


def with_stick(model: Model) -> Model:
    """Return a model whose points with friction have further points along the surfaces, which all stick."""
    points, laws = model.contact_points, _law_of(model.laws)
    where = np.concatenate([bound.where for bound in frictions_of(model)])
    explicit = np.array([line is not None and line.at == "explicit" for line, _ in _lines(laws, where)])
    parts, along = [points], tangents_of(points.normal)
    for axis in range(model.dim - 1):
        rows = dataclasses.replace(points, value=points.share[:, None] * along[points.point, axis])
        for at, chosen in (("end", where[~explicit]), ("explicit", where[explicit])):
            if chosen.size:
                parts.append(_some(rows, chosen, Stick(model, chosen, at)))
    features = tuple(one for one in model.features if one.held is None)
    found = dataclasses.replace(model, contact_points=joined(parts), features=features, run=None)
    found = dataclasses.replace(found, rows=rows_over_the_run(found))
    return dataclasses.replace(found, laws=bind_laws(found, found.dt))


def _law_of(laws: Iterable[BoundLaw]) -> dict[int, tuple[BoundLaw, int]]:
    """Return the law of each point, and the number of the point among those of the law."""
    return {p: (bound_law, k) for bound_law in laws for k, p in enumerate(bound_law.where)}


def _lines(laws: Mapping[int, tuple[BoundLaw, int]], where: Integers) -> Iterator[tuple[Any, int]]:
    """Yield the linear law of each point, None of a kernel, and the number of the point among those of the law."""
    return ((laws[p][0].linear, laws[p][1]) for p in where.tolist())


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


def stick_in_words(model: Model) -> dict[str, str]:
    """Return for each contact with friction how its points stick, in words: those of its first point."""
    points = model.contact_points
    found: dict[str, str] = {}
    for bound in frictions_of(model):
        for p, compliance in zip(bound.where.tolist(), bound.compliance.tolist(), strict=True):
            per_area = f"{1.0 / (compliance * points.weight[p]):.6g}" if compliance else ""
            words = f"sticks with a stiffness of {per_area} per area" if compliance else "sticks exactly"
            given = bound.friction.stiffness
            if compliance and (given is None or isinstance(given, str)):
                words += ", auto: 2 (1 - nu) / (2 - nu) of that of the law"
            found.setdefault(points.names[p], words)
    return found


def refusals(model: Model) -> Iterator[Problem]:
    """Yield what does not go with friction: bars, bonds, schemes of stages, laws that leave stick without a line."""
    case, found = model.case, False
    for name, spec in case.contacts.items():
        if spec.friction is not None and spec.friction.acts and (why := _why_frictionless(model, name)):
            found = True
            yield case.problem(_path(model, name), why[0].format(spec.friction.name), why[1])
    for bound in [] if found else frictions_of(model):
        exact = (bound.compliance == 0.0) & (bound.response <= 0.0)
        without = np.isnan(bound.compliance) | exact
        for name in dict.fromkeys(model.contact_points.names[p] for p in bound.where[without]):
            message = f"expected a stiffness of stick under {case.contacts[name].law.name}, found none"
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
