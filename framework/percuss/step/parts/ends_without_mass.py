"""Static balance of ends without mass with their contacts.

An end without mass moves as its end element and its contact let it. With the bodies at u_{n+1} it would lie where its
element is free of stress, as the node beside it; a multiplier compresses the element by ``N lambda / k`` with its
stiffness k. The contact equation is therefore that of the gap at the end of the step, with ``1 / (k dt^2)`` in place of
``1 / m``: it gives the force of the next step, lambda_{n+1}, which the element transmits to the node beside the end.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.compiler.record_arrays import record_array
from percuss.contact.equation import WITHOUT_MASS, solve
from percuss.errors import InputError, RefusedPair
from percuss.mesh.ends_without_mass import BALANCE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.contact.bound_law import BoundLaw
    from percuss.contact.contact_rows import Side
    from percuss.contact.model_arrays import ModelArrays
    from percuss.methods.interfaces import Floats

# A side without mass of a contact point, one record for each direction.
END_WITHOUT_MASS = np.dtype(
    [
        ("point", "i8"),  # index of the contact point
        ("place", "i8"),  # index of the end in `boundary_dofs`
        ("beside", "i8"),  # index of the node beside it in the global arrays
        ("response", "f8"),  # N / (k dt^2)
    ]
)


def recall_multipliers(points: Any) -> None:
    """Set the multipliers of ends without mass to those that the step before has found for this step."""
    for i in range(points.size):
        p = points[i]
        if p.source == WITHOUT_MASS:
            p.multiplier = p.coming


def push_ends_with_mass(points: Any, entries: Any, boundary_dofs: Any, dt: float) -> None:
    """Add the velocity change ``dt M^-1 N lambda`` of ends with mass by the ends without mass that meet them."""
    for i in range(points.size):
        p = points[i]
        if p.source == WITHOUT_MASS and p.multiplier != 0.0:
            for k in range(p.start, p.stop):
                boundary_dofs[entries[k].place].new_v += dt * entries[k].response * p.multiplier


def follow_bodies(ends: Any, boundary_dofs: Any, u: Floats, dt: float) -> None:
    """Move the ends to where their elements are free of stress, as if nothing touched them."""
    for i in range(ends.size):
        q = boundary_dofs[ends[i].place]
        q.new_v = (u[ends[i].beside] - q.old_u) / dt


def find_coming_multipliers(points: Any, others: Any, dt: float) -> bool:
    """Find the multipliers of the next step; return whether the solution converged. Those of this step stay."""
    sound = solve(points, others, dt, WITHOUT_MASS)
    for i in range(points.size):
        p = points[i]
        if p.source == WITHOUT_MASS:
            multiplier = p.multiplier
            p.multiplier = p.coming
            p.coming = multiplier
    return sound


def compress_elements(points: Any, ends: Any, boundary_dofs: Any, u: Floats, v: Floats, dt: float) -> None:
    """Move the ends by the compression of their elements under the coming multipliers; write their state back."""
    for i in range(ends.size):
        u[boundary_dofs[ends[i].place].dof] = u[ends[i].beside]
    for i in range(ends.size):
        end = ends[i]
        u[boundary_dofs[end.place].dof] += dt * dt * end.response * points[end.point].coming
    for i in range(ends.size):
        q = boundary_dofs[ends[i].place]
        q.new_v = (u[q.dof] - q.old_u) / dt
        v[q.dof] = q.new_v


def end_records(sides: Sequence[Sequence[Side]], place: dict[int, int]) -> Any:
    """Return the records of the sides without mass, `END_WITHOUT_MASS`; parameters are those of `point_records`."""
    rows = [
        (point, place[side.node] + d, side.beside * side.normal.size + d, response)
        for point, point_sides in enumerate(sides)
        for side in point_sides
        if side.beside is not None
        for d, response in enumerate(side.response)
    ]
    return record_array(rows, END_WITHOUT_MASS)


def refuse_without_mass(model: ModelArrays) -> None:
    """Refuse ends without mass where their static balance with the contact is not that of a linear end element.

    Raises
    ------
    InputError
        If a body is not linear, or has no node with mass beside an end without mass.
    RefusedPair
        If the integrator is a multi-stage scheme or one of such forces, or a law gives no force in static balance.
    """
    massless, case = model.points_without_mass, model.case
    if not massless.any():
        return
    name, integrator = case.method.mass.name, case.method.integrator.name
    for body in model.bodies.values():
        if not all(body.mass[beside - body.start] > 0.0 for beside in body.ends_without_mass.values()):
            message = f"expected a node with mass beside each end without mass of body '{body.name}', found none"
            raise InputError([case.problem(("method", "mass"), message, "Give the body more elements.")])
        if body.why_not_linear:
            message = f"expected linear bodies, as {name} leaves ends without mass, found that {body.why_not_linear}"
            advice = f"{BALANCE[0].upper()}{BALANCE[1:]}, which is solved for linear bodies alone: take another mass."
            raise InputError([case.problem(("method", "mass"), message, advice)])
    for bound_law in model.laws:
        law, reason = bound_law.law, ""
        if law.shifts:
            reason = f"{BALANCE}, and {law.name} shifts displacements after that"
        elif massless[list(bound_law.where)].any():
            reason = _why_no_balance(bound_law)
            if model.multistage:
                reason = f"{BALANCE}, and {integrator} evaluates contact in the stages of its step"
            elif model.viscosity:
                reason = f"{BALANCE}, and the viscous force of {integrator} in its end element is not part of that"
            elif model.own_steps:
                reason = f"{BALANCE}, and with {integrator} its end element does not act in every step"
        if reason:
            raise RefusedPair(integrator, law.name, reason, name)


def _why_no_balance(bound_law: BoundLaw) -> str:
    """Return why a law gives no force in static balance with an end without mass; empty if it does."""
    name, linear = bound_law.law.name, bound_law.linear
    if linear is None:
        return f"{BALANCE}, and {name} is no line: its kernel takes the gap as given, which its force changes"
    if np.any(linear.acceleration):
        return f"{BALANCE}, and {name} weighs the gap acceleration, to which an end without mass adds no inertia"
    return ""
