"""Static balance of ends without mass with their contacts.

An end without mass moves as its end element and its contact let it. With the bodies at u_{n+1} it would lie where its
element is free of stress, as the node beside it; a multiplier compresses the element by ``N lambda / k`` with its
stiffness k. The contact equation is therefore that of the gap at the end of the step, with ``1 / (k dt^2)`` in place of
``1 / m``: it gives the force of the next step, lambda_{n+1}, which the element transmits to the node beside the end.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from percuss.contact.features import ELASTIC, EVERY_STEP, Feature
from percuss.contact.points import BY_CURRENT, BY_END, FROM_PART, NOTHING, Points, law_records
from percuss.errors import Problem, RefusedPair
from percuss.mesh.masses import BALANCE
from percuss.methods.interfaces import ContactState, LeapFrog
from percuss.record_arrays import Records, record_array
from percuss.step.account import rate_and_reach, takes_part
from percuss.step.actions import AFTER_STEP, BEFORE_ACCOUNT, BEFORE_CONTACT, Action
from percuss.step.equation import see, solve
from percuss.step.part import Part, Setting

if TYPE_CHECKING:
    from percuss.contact.bound_law import BoundLaw
    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats

# A side without mass of a contact point, one record for each direction.
END_WITHOUT_MASS = np.dtype(
    [
        ("point", "i8"),  # index of the contact point
        ("place", "i8"),  # index of the boundary degree of freedom of the end
        ("beside", "i8"),  # index of the node beside it in the global arrays
        ("response", "f8"),  # N / (k dt^2)
    ]
)


class Balance(NamedTuple):
    """All ends without mass, and the multipliers that they know already."""

    ends: Records  # END_WITHOUT_MASS
    coming: Floats  # (P,) multiplier of the next step of each point
    points: Points
    boundary: Records  # percuss.step.records.BOUNDARY_DOF
    totals: Records  # percuss.step.records.TOTAL
    now: Records  # percuss.step.records.NOW


class EndsWithoutMass(Part[Balance]):
    """The part of a step with ends without mass."""

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None where all ends in contact have mass."""
        step, rows, point = setting.step, setting.rows, setting.rows.point
        ends = [
            (point[k], setting.place[int(rows.node[k])] + d, rows.beside[k] * setting.model.dim + d, response)
            for k in np.flatnonzero(rows.beside >= 0)
            for d, response in enumerate(rows.response[k])
        ]
        if not ends:
            return None
        coming = np.zeros(len(setting.order)) if before is None else before.data.coming
        return cls(
            Balance(record_array(ends, END_WITHOUT_MASS), coming, step.points, step.boundary, step.totals, step.now)
        )

    def actions(self) -> Iterator[Action]:
        """Yield the actions of a step."""
        yield Action(BEFORE_CONTACT, push_ends_with_mass, self.data)
        yield Action(AFTER_STEP, balance_ends, self.data)
        yield Action(BEFORE_ACCOUNT, add_round_off, self.data)

    def changing_arrays(self) -> list[Any]:
        """Return the multipliers of the next step."""
        return [self.data.coming]

    def balance_at_rest(self, u: Floats, v: Floats) -> None:
        """Put the ends into static balance with what a law presses or pulls before the first step."""
        boundary, speed = self.data.boundary, v.copy()
        boundary["old_u"], boundary["old_v"] = u[boundary["dof"]], v[boundary["dof"]]
        boundary["new_v"] = 0.0
        balance_ends(self.data, 0, u, v, v)
        v[:] = speed


def push_ends_with_mass(data: Balance, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set the multipliers that the step before has found, and push the ends with mass that they meet.

    What they move of these comes before the gaps of other contacts are predicted.
    """
    points, dt = data.points, data.now[0].dt
    for i in range(points.law.size):
        if points.law[i].source == FROM_PART:
            points.state[i].multiplier = data.coming[i]
    for i in range(points.law.size):
        row, multiplier = points.row[i], points.state[i].multiplier
        if points.law[i].source == FROM_PART and multiplier != 0.0:
            for k in range(row.start, row.stop):
                data.boundary[points.entries[k].place].new_v += dt * points.entries[k].response * multiplier


def balance_ends(data: Balance, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Move the ends to their static balance after the step."""
    now = data.now[0]
    follow_bodies(data, u, now.dt)
    see(data.points, data.boundary, now.dt)
    if not find_coming_multipliers(data, now.dt):
        now.solved = 0
    compress_elements(data, u, v, now.dt)


def follow_bodies(data: Balance, u: Floats, dt: float) -> None:
    """Move the ends to where their elements are free of stress, as if nothing touched them."""
    for i in range(data.ends.size):
        end = data.ends[i]
        q = data.boundary[end.place]
        q.new_v = (u[end.beside] - q.old_u) / dt


def find_coming_multipliers(data: Balance, dt: float) -> bool:
    """Find the multipliers of the next step; return whether the solution converged. Those of this step stay."""
    sound = solve(data.points, dt, FROM_PART)
    for i in range(data.points.law.size):
        if data.points.law[i].source == FROM_PART:
            state = data.points.state[i]
            multiplier = state.multiplier
            state.multiplier = data.coming[i]
            data.coming[i] = multiplier
    return sound


def compress_elements(data: Balance, u: Floats, v: Floats, dt: float) -> None:
    """Move the ends by the compression of their elements under the coming multipliers; write their state back."""
    ends, boundary = data.ends, data.boundary
    for i in range(ends.size):
        u[boundary[ends[i].place].dof] = u[ends[i].beside]
    for i in range(ends.size):
        end = ends[i]
        u[boundary[end.place].dof] += dt * dt * end.response * data.coming[end.point]
    for i in range(ends.size):
        q = boundary[ends[i].place]
        q.new_v = (u[q.dof] - q.old_u) / dt
        v[q.dof] = q.new_v


def add_round_off(data: Balance, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the round-off of the end elements, which turn the error of a displacement into one of a force."""
    points, dt = data.points, data.now[0].dt
    for i in range(points.law.size):
        law, row, state = points.law[i], points.row[i], points.state[i]
        if law.source == FROM_PART and takes_part(law, row, state, points.sums[i]):
            rate, reach = rate_and_reach(points, row, data.boundary, dt)
            data.totals[0].round_off += reach * (abs(state.rate) + abs(rate)) / (dt * row.delassus)


def feature(model: Model) -> Feature | None:
    """Return what is to know of ends without mass; None where all ends in contact have mass."""
    points = model.contact_points
    massless = frozenset(points.point[model.bodies.mass[points.node] == 0.0].tolist())
    if not massless:
        return None
    mass = model.case.method.mass.name
    return Feature(
        name=mass,
        balanced=massless,
        records=partial(_lines_in_balance, massless, model.dt),
        no_row_kernel=True,
        reasons={
            "delassus": "1/(k dt^2) of each end without mass",
            "waves": f"waves are measured of ends with mass; the mass {mass} leaves ends in contact without",
            "black box": "ends without mass are examined only with linear laws in gap or gap rate",
        },
    )


def _lines_in_balance(massless: Collection[int], dt: float, bound_law: BoundLaw, records: Any, delassus: Floats) -> Any:
    """Return the records of a law with the force of static balance at its points without mass, (P,) `LAW`.

    There it has the force at the end of the step, whatever the integrator.

    Parameters
    ----------
    massless
        Points with a side without mass.
    dt
        Time step.
    bound_law
        The law.
    records : (P,) LAW
        Its records at ends with mass.
    delassus : (P,) array
        Diagonal of S at its points [1/mass].
    """
    without_mass = np.array([point in massless for point in bound_law.where])
    if not without_mass.any():
        return records
    state = ContactState("predicted", "predicted", "none", (dt * dt, dt, 0.0))
    balanced = law_records(bound_law, LeapFrog(state, state), delassus)
    balanced["source"] = FROM_PART
    balanced["stores"] = np.where(balanced["stores"] == BY_END, BY_CURRENT, NOTHING)
    # The gap that decides is that of the balance, which other contacts of the end change: a spring that acts while its
    # gap is negative is one that never pulls.
    springs = (balanced["always"] == 0) & (balanced["weight_rate"] == 0.0)
    balanced["always"][springs] = balanced["never_pulls"][springs] = 1
    return np.where(without_mass, balanced, records)


def refusals(model: Model) -> Iterator[Problem | RefusedPair]:
    """Yield where the static balance of an end with its contact is not that of a linear end element.

    That is so if a body is not linear, or has no node with mass beside such an end, and if the integrator is a
    multi-stage scheme or one of other forces, or a law gives no force in static balance.
    """
    massless, case = model.balanced, model.case
    if not massless.any():
        return
    name, integrator = case.method.mass.name, case.method.integrator.name
    for body in model.bodies.values():
        if not all(body.mass[beside - body.start] > 0.0 for beside in body.ends_without_mass.values()):
            message = f"expected a node with mass beside each end without mass of body '{body.name}', found none"
            yield case.problem(("method", "mass"), message, "Give the body more elements.")
        if body.why_not_linear:
            message = f"expected linear bodies, as {name} leaves ends without mass, found that {body.why_not_linear}"
            advice = f"{BALANCE[0].upper()}{BALANCE[1:]}, which is solved for linear bodies only: take another mass."
            yield case.problem(("method", "mass"), message, advice)
    for bound_law in model.laws:
        law, reason = bound_law.law, ""
        if massless[list(bound_law.where)].any():
            reason = _why_no_balance(bound_law)
            if model.multistage:
                reason = f"{BALANCE}, and {integrator} evaluates contact in the stages of its step"
            elif why := model.why_altered(EVERY_STEP, ELASTIC):
                reason = f"{BALANCE}, and {why}"
        if reason:
            yield RefusedPair(integrator, law.name, reason, name)


def _why_no_balance(bound_law: BoundLaw) -> str:
    """Return why a law gives no force in static balance with an end without mass; empty if it does."""
    name, linear = bound_law.law.name, bound_law.linear
    if linear is None:
        return f"{BALANCE}, and {name} is not linear: its kernel takes the gap as given, which its force changes"
    if np.any(linear.acceleration):
        return f"{BALANCE}, and {name} weighs the gap acceleration, to which an end without mass adds no inertia"
    return ""
