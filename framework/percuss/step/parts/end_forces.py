"""Laws that see or push more than the gap: the end force ``F = Sigma^T u`` of their contact points.

The end force of a contact point is the mean normal force of the end elements of its sides, tension positive. Each side
has a weight proportional to 1/m of its end node: ``F = N^T M^-1 f / s`` with the forces f of these elements on the end
nodes, negative where they press the ends together.

Such a law is evaluated at ``G^T u + g_0``, ``G = N + sees Sigma``, and pushes ``P = N + pushes Sigma``. The entries of
a contact point contain ``M^-1 P``, also at the nodes beside its ends, so that multipliers act as those of any law. What
the law sees replaces the gap while the contact equation is solved; the gap comes back after that. In the
functions of the loop `e` is the record of such a point.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from percuss.compiler.record_arrays import Records, Row, record_array
from percuss.contact.bound_law import OF_END_FORCE
from percuss.contact.contact_rows import Side
from percuss.contact.features import Feature
from percuss.contact.points import BY_CURRENT, BY_PART, NEVER, NOTHING, Points
from percuss.contact.trace_stiffness import weights_of
from percuss.errors import RefusedPair
from percuss.methods.blame import breach
from percuss.step.account import ROUNDING, stored_energy
from percuss.step.actions import AFTER_CONTACT, BEFORE_ACCOUNT, BEFORE_SOLUTION, BEFORE_SUPPORTS, Action
from percuss.step.part import Part, Setting

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from percuss.contact.model_arrays import ModelArrays
    from percuss.methods.interfaces import Floats

END_FORCE = np.dtype(
    [
        ("point", "i8"),  # index of the contact point
        ("start", "i8"),  # its entries of Sigma are those from start to stop
        ("stop", "i8"),
        ("sees", "f8"),
        ("pushes", "f8"),
        ("softens", "f8"),
        ("stores", "i8"),  # how the point stores energy in terms of what it sees, as `LAW.stores`
        ("force", "f8"),  # F at t_n
        ("gap", "f8"),  # the gaps and gap rates themselves, while the point shows what its law sees
        ("predicted_gap", "f8"),
        ("rate", "f8"),
        ("predicted_rate", "f8"),
        ("seen_gap", "f8"),  # what the law sees at t_n
        ("seen_rate", "f8"),  # and at n - 1/2
        ("stored", "f8"),  # stored energy at n - 1/2, after the step that at n + 1/2
        ("active", "i8"),  # 1 if the contact had a force or stored energy in the step before
    ]
)
END_FORCE_ENTRY = np.dtype(
    [("place", "i8"), ("row", "f8"), ("response", "f8")]
)  # in `boundary_dofs`, Sigma, M^-1 Sigma


class EndForces(NamedTuple):
    """All contact points whose law sees or pushes more than the gap."""

    of_points: Records  # END_FORCE
    rows: Records  # END_FORCE_ENTRY
    points: Points
    boundary: Records  # percuss.step.records.BOUNDARY_DOF
    totals: Records  # percuss.step.records.TOTAL
    dt: float


class EndForcesOfLaws(Part[EndForces]):
    """The part of a step with laws that see or push more than the gap."""

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None where all laws see and push the gap alone."""
        found = end_forces(setting.model, setting.midpoint)
        if not found:
            return None
        step, law = setting.step, setting.step.points.law
        records: list[tuple[object, ...]] = []
        entries: list[tuple[object, ...]] = []
        for number, point in enumerate(setting.order):
            if point not in found:
                continue
            end_force = found[point]
            start = len(entries)
            entries += [
                (setting.place[node] + d, value, value / setting.model.bodies.mass[node])
                for node, row in end_force.rows.items()
                for d, value in enumerate(row)
            ]
            multiples = end_force.sees, end_force.pushes, end_force.softens
            # Work and stored energy belong together where the law pushes what it sees.
            stores = law["stores"][number] if end_force.sees == end_force.pushes else NOTHING
            records.append((number, start, len(entries), *multiples, stores, *([0.0] * 8), 0))
            law["stores"][number], law["end_stiffness"][number] = BY_PART, np.nan
        made = record_array(records, END_FORCE)
        if before is not None:
            for name in ("stored", "active"):
                made[name] = before.data.of_points[name]
        rows = record_array(entries, END_FORCE_ENTRY)
        return cls(EndForces(made, rows, step.points, step.boundary, step.totals, setting.model.dt))

    def actions(self) -> Iterator[Action]:
        """Yield the actions of a step."""
        yield Action(BEFORE_SUPPORTS, soften_end_elements, self.data)
        yield Action(BEFORE_SOLUTION, show_end_forces, self.data)
        yield Action(AFTER_CONTACT, show_gaps, self.data)
        yield Action(BEFORE_ACCOUNT, add_work_and_energy, self.data)

    def changing_arrays(self) -> list[Any]:
        """Return the records of the points."""
        return [self.data.of_points]


# ------------------------------------------------------------------------------------------------------- in the loop


def soften_end_elements(data: EndForces, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Find the end forces at t_n, and add the velocity change by what acts whether contacts are closed or open."""
    end_forces, rows, boundary = data.of_points, data.rows, data.boundary
    for i in range(end_forces.size):
        e = end_forces[i]
        e.force = 0.0
        for k in range(e.start, e.stop):
            e.force += rows[k].row * boundary[rows[k].place].old_u
    for i in range(end_forces.size):
        e = end_forces[i]
        force = softening(data.points.law[e.point], e) * e.force
        if force != 0.0:
            for k in range(e.start, e.stop):
                boundary[rows[k].place].new_v += data.dt * rows[k].response * force


def softening(law: Row, e: Row) -> float:
    """Return the factor of Sigma Sigma^T that a point takes from the stiffness; 0 while its law does not act."""
    return 0.0 if law.always == NEVER else e.softens


def show_end_forces(data: EndForces, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Put what the laws see instead of gaps and gap rates, which are kept."""
    rows = data.rows
    for i in range(data.of_points.size):
        e = data.of_points[i]
        state = data.points.state[e.point]
        rate = 0.0
        predicted_force = 0.0
        predicted_rate = 0.0
        for k in range(e.start, e.stop):
            q = data.boundary[rows[k].place]
            rate += rows[k].row * q.old_v
            predicted_force += rows[k].row * (q.old_u + data.dt * q.new_v)
            predicted_rate += rows[k].row * q.new_v
        e.gap = state.gap
        e.predicted_gap = state.predicted_gap
        e.rate = state.rate
        e.predicted_rate = state.predicted_rate
        state.gap += e.sees * e.force
        state.predicted_gap += e.sees * predicted_force
        state.rate += e.sees * rate
        state.predicted_rate += e.sees * predicted_rate
        e.seen_gap = state.gap
        e.seen_rate = state.rate


def show_gaps(data: EndForces, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Put gaps and gap rates back."""
    for i in range(data.of_points.size):
        e = data.of_points[i]
        state = data.points.state[e.point]
        state.gap = e.gap
        state.predicted_gap = e.predicted_gap
        state.rate = e.rate
        state.predicted_rate = e.predicted_rate


def add_work_and_energy(data: EndForces, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the work of what is pushed beyond the gap, the stored energy, and its steady change, after a step.

    The force ``c Sigma F_n`` does the work ``c F_n (F_{n+1} - F_{n-1}) / 2`` and stores ``-c F_n F_{n+1} / 2``, both
    without loss. A law that pushes what it sees stores the energy of any law, of what it sees. The steady change is
    that of work and stored energy at points with BY_CURRENT that neither open nor close.
    """
    total, rows, boundary, dt = data.totals[0], data.rows, data.boundary, data.dt
    total.any_contact = 1
    for i in range(data.of_points.size):
        e = data.of_points[i]
        law, state = data.points.law[e.point], data.points.state[e.point]
        before = 0.0
        after = 0.0
        size = 0.0
        reach = 0.0
        for k in range(e.start, e.stop):
            q = boundary[rows[k].place]
            before += rows[k].row * q.old_v
            after += rows[k].row * q.new_v
            size += abs(rows[k].row)
            reach = max(reach, abs(q.old_u) + dt * abs(q.new_v))
        seen_rate = e.sees * after
        for k in range(law.start, law.stop):
            seen_rate += data.points.entries[k].normal * boundary[data.points.entries[k].place].new_v
        softens = softening(law, e)
        point_work = 0.5 * dt * (e.pushes * state.multiplier + softens * e.force) * (before + after)
        energy = -0.5 * softens * e.force * (e.force + dt * after)
        law_energy = stored_energy(law, state, e.stores, e.seen_gap, seen_rate, dt)
        active = 1 if state.multiplier != 0.0 or law_energy != 0.0 else 0
        energy += law_energy
        noise = size * (abs(e.pushes * state.multiplier) + abs(softens * e.force))
        if e.stores == BY_CURRENT:
            if e.active == active:
                by_gap = 0.5 * dt * state.multiplier * (state.rate + seen_rate - e.sees * after)
                total.steady_change += by_gap + point_work + energy - e.stored
            noise += (1.0 + abs(e.sees) * size) * (
                law.weight_gap * dt / law.sigma * (abs(e.seen_rate) + abs(seen_rate)) + ROUNDING * reach * law.kappa
            )
        total.round_off += reach * noise
        total.work_of_contacts += point_work
        total.stored_by_points += energy
        e.stored = energy
        e.active = active


# ------------------------------------------------------------------------------------------- rows, and what is refused


@dataclass(frozen=True)
class EndForce:
    """What the law of a contact point sees and pushes: multiples of Sigma, its rows, and the sides of the point."""

    sees: float
    pushes: float
    softens: float
    rows: Mapping[int, Floats]  # of Sigma, (dim,) for each node
    sides: list[Side]

    @property
    def nodes(self) -> list[int]:
        """The end nodes and the nodes beside them."""
        return list(self.rows)


def feature(model: ModelArrays) -> Feature:
    """Return what is to know of laws that see or push the force of end elements."""
    return Feature(name="end forces", sides=lambda at: {p: found.sides for p, found in end_forces(model, at).items()})


def end_forces(model: ModelArrays, midpoint: float) -> dict[int, EndForce]:
    """Return what laws see and push at the contact points where that is more than the gap, for the supports at a time.

    Raises
    ------
    PluginError
        If no force follows from a law, as sigma and the response of what it sees to what it pushes are not positive.
    """
    found: dict[int, EndForce] = {}
    sides = None
    for bound_law in (law for law in model.laws if law.sees_more_than_gap):
        sides = sides or model.rows.at(midpoint).sides
        linear: Any = bound_law.linear
        for place, point in enumerate(bound_law.where):
            sees, pushes, softens = (float(getattr(linear, name)[place]) for name in OF_END_FORCE)
            rows = _end_force_rows(model, sides[point])
            opened = [_opened(model, midpoint, node, row, sides[point], (sees, pushes)) for node, row in rows.items()]
            found[point] = EndForce(sees, pushes, softens, rows, opened)
            state = getattr(model.tables[-1], linear.at)
            weights = linear.gap[place], linear.rate[place], linear.acceleration[place]
            response = sum(weight * unit for weight, unit in zip(weights, state.response, strict=True))
            if linear.sigma[place] + response * sum(float(side.sees @ side.response) for side in opened) <= 0.0:
                message = "sigma plus the response of what the law sees to what it pushes is not positive"
                raise breach(bound_law.law, "bind", f"{message}, so no force follows")
    return found


def _end_force_rows(model: ModelArrays, sides: Sequence[Side]) -> dict[int, Floats]:
    """Return the rows of Sigma by node: end force by displacement."""
    rows: dict[int, Floats] = {}
    for weight, side in zip(weights_of(sides), sides, strict=True):
        body = model.bodies.bar_at(side.node)
        row = weight * float(body.stiffness[body.end_element(side.node)]) * side.normal
        beside = side.node + 1 if side.node == body.start else side.node - 1
        for node, sign in ((side.node, -1.0), (beside, 1.0)):
            rows[node] = rows.get(node, np.zeros(model.dim)) + sign * row
    return rows


def _opened(
    model: ModelArrays, midpoint: float, node: int, row: Floats, sides: Sequence[Side], multiples: tuple[float, float]
) -> Side:
    """Return the side of a contact point at an end or the node beside it, with what the law sees and pushes there."""
    normal = next((side.normal for side in sides if side.node == node), np.zeros(model.dim))
    seen, pushed = (normal + multiple * row for multiple in multiples)
    free = pushed
    for constraint in model.loads.constraints:
        if constraint.node == node and constraint.active(midpoint):
            free = free - (constraint.direction @ free) * constraint.direction
    return Side(node, normal, free / model.bodies.mass[node], seen=seen, pushed=pushed)


def refusals(model: ModelArrays) -> Iterator[RefusedPair]:
    """Yield laws of end forces where these are not those of linear two-node elements at ends with mass."""
    integrator = model.case.method.integrator.name
    for bound_law in (law for law in model.laws if law.sees_more_than_gap):
        law, reason, refusing = bound_law.law.name, "", bound_law.law.name
        what = f"{law} sees or pushes the force of end elements"
        bodies = {model.bodies.at(node).name: node for p in bound_law.where for node in model.contact_points[p].nodes}
        if model.multistage:
            reason = f"{what}, which only leap-frog schemes evaluate"
        elif why := model.why_without("end forces", bound_law.where):
            reason = f"{what}, {why}"
        for node in bodies.values():
            body = model.bodies.at(node)
            if body.of_cells:
                reason = f"{what}, which only two-node elements have: body '{body.name}' has {_kinds(body)}"
            elif body.why_not_linear:
                reason = f"{what} by their stiffness, and {body.why_not_linear}"
        if reason:
            yield RefusedPair(integrator, law, reason, refusing)


def _kinds(body: Any) -> str:
    return f"cells {', '.join(body.mesh.cells)}"
