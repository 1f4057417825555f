"""Static balance of ends without mass with their contacts.

An end without mass moves as its end element and its contact let it. With the bodies at u_{n+1} it would lie where its
element is free of stress, as the node beside it; a multiplier compresses the element by ``N lambda / k`` with its
stiffness k. The contact equation is therefore that of the gap at the end of the step, with ``1 / (k dt^2)`` in place of
``1 / m``: it gives the force of the next step, lambda_{n+1}, which the element transmits to the node beside the end.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.solver.compiled.contact_equation import WITHOUT_MASS, solve

if TYPE_CHECKING:
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
