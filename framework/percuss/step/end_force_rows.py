"""Contact points whose law sees or pushes more than the gap: the rows of their end forces, and where they are refused.

The end force ``F = Sigma^T u`` of a contact point is the mean normal force of the end elements of its sides, tension
positive. Each side has a weight proportional to 1/m of its end node: ``F = N^T M^-1 f / s`` with the forces f of these
elements on the end nodes, negative where they press the ends together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.compiler.record_arrays import record_array
from percuss.contact.bound_law import OF_END_FORCE
from percuss.contact.contact_rows import Side
from percuss.contact.equation import NOTHING
from percuss.errors import RefusedPair
from percuss.methods.blame import breach
from percuss.step.parts.end_forces import END_FORCE, END_FORCE_ENTRY

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from percuss.contact.bound_law import BoundLaw
    from percuss.contact.model_arrays import ModelArrays
    from percuss.methods.interfaces import Floats


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


def sees_end_force(bound_law: BoundLaw) -> bool:
    """Return whether a law sees or pushes more than the gap."""
    linear = bound_law.linear
    return linear is not None and any(np.any(getattr(linear, name)) for name in OF_END_FORCE)


def end_forces(model: ModelArrays, midpoint: float) -> dict[int, EndForce]:
    """Return what laws see and push at the contact points where that is more than the gap, for the supports at a time.

    Raises
    ------
    PluginError
        If no force follows from a law, as sigma and the response of what it sees to what it pushes are not positive.
    """
    found: dict[int, EndForce] = {}
    sides = None
    for bound_law in filter(sees_end_force, model.laws):
        sides = sides or model.contact_rows(midpoint).sides
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


def _weights(sides: Sequence[Side]) -> list[float]:
    """Return the weight of each side in the end force, proportional to 1/m of its end node; they sum to 1."""
    mobility = [float(side.normal @ side.response) for side in sides]
    return [value / sum(mobility) for value in mobility]


def _end_force_rows(model: ModelArrays, sides: Sequence[Side]) -> dict[int, Floats]:
    """Return the rows of Sigma by node: end force by displacement."""
    rows: dict[int, Floats] = {}
    for weight, side in zip(_weights(sides), sides, strict=True):
        body = model.body_of(side.node)
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
    for constraint in model.constraints:
        if constraint.node == node and constraint.active(midpoint):
            free = free - (constraint.direction @ free) * constraint.direction
    return Side(node, normal, free / model.mass[node], seen=seen, pushed=pushed)


def trace_stiffness(model: ModelArrays, midpoint: float) -> Floats:
    """Return `percuss.ContactPoints.trace_stiffness` of all contact points, for the supports active at a time, (P,)."""
    return np.array(
        [
            sum(
                weight**2 * model.body_of(side.node).end_stiffness(side.node)
                for weight, side in zip(_weights(sides), sides, strict=True)
            )
            for sides in model.contact_rows(midpoint).sides
        ]
    )


def end_force_records(
    found: Mapping[int, EndForce], order: Sequence[int], laws: Any, place: Mapping[int, int], mass: Floats
) -> tuple[Any, Any]:
    """Return the records `END_FORCE` and `END_FORCE_ENTRY` of the loop.

    Parameters
    ----------
    found
        What `end_forces` has found.
    order
        Numbers of the contact points in the order of the loop.
    laws : (P,) LAW
        Records of the laws in that order.
    place
        Map from each boundary node to the index of its first boundary degree of freedom.
    mass : (nodes,)
        Nodal masses.
    """
    records: list[tuple[Any, ...]] = []
    entries: list[tuple[Any, ...]] = []
    for number, point in enumerate(order):
        if point not in found:
            continue
        end_force = found[point]
        start = len(entries)
        entries += [
            (place[node] + d, value, value / mass[node])
            for node, row in end_force.rows.items()
            for d, value in enumerate(row)
        ]
        multiples = end_force.sees, end_force.pushes, end_force.softens
        # Work and stored energy belong together where the law pushes what it sees.
        stores = laws["stores"][number] if end_force.sees == end_force.pushes else NOTHING
        records.append((number, start, len(entries), *multiples, stores, *([0.0] * 8), 0))
    return record_array(records, END_FORCE), record_array(entries, END_FORCE_ENTRY)


def refuse_end_forces(model: ModelArrays) -> None:
    """Refuse laws that see or push end forces where these are not those of linear two-node elements at ends with mass.

    Raises
    ------
    RefusedPair
        For the first such law.
    """
    integrator = model.case.method.integrator.name
    for bound_law in filter(sees_end_force, model.laws):
        law, reason, refusing = bound_law.law.name, "", bound_law.law.name
        what = f"{law} sees or pushes the force of end elements"
        bodies = {model.body_of(node).name: node for p in bound_law.where for node in model.contact_pairs[p].nodes}
        if model.multistage:
            reason = f"{what}, which is evaluated in leap-frog schemes alone"
        elif model.viscosity:
            reason = f"{what}, and that of {integrator} has a viscous part, which is not known when it is evaluated"
        elif model.implicit or model.own_steps:
            reason = f"{what}, and under {integrator} the internal forces of a step are not those at its begin"
        elif model.couples_nodes:
            reason = f"{what}, which moves other nodes than its own where the mass couples nodes"
        elif model.points_without_mass[list(bound_law.where)].any():
            reason = f"{what}, and an end without mass is in static balance with it"
        for node in bodies.values():
            body = model.body_of(node)
            if body.mesh.cells:
                reason = f"{what}, which is known of two-node elements alone: body '{body.name}' has {_kinds(body)}"
            elif body.why_not_linear:
                reason = f"{what} by their stiffness, and {body.why_not_linear}"
        if reason:
            raise RefusedPair(integrator, law, reason, refusing)


def _kinds(body: Any) -> str:
    return f"cells {', '.join(body.mesh.cells)}"
