"""Ends in contact that a mass method leaves without mass: which ends it is told of, and where they are refused."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.errors import InputError, RefusedPair
from percuss.methods.interfaces import Mass
from percuss.methods.plugin_calls import answer
from percuss.solver.cells import lumping_of
from percuss.solver.size_limits import within_limits

if TYPE_CHECKING:
    from collections.abc import Collection

    from percuss.case.case import Case
    from percuss.case.specs import BodySpec
    from percuss.methods.interfaces import Floats, Mesh
    from percuss.solver.bound_law import BoundLaw
    from percuss.solver.model_arrays import ModelArrays

BALANCE = "an end without mass is in static balance with its contact at t_n"


def ends_at_contacts(case: Case) -> dict[str, set[str]]:
    """Return the ends in contact of each body on which nothing else acts: no support, no drive and no load."""
    ends: dict[str, set[str]] = {}
    for contact in case.contacts.values():
        for side in contact.sides:
            ends.setdefault(side.body, set()).add(side.region)
    for name, spec in case.bodies.items():
        ends.get(name, set()).difference_update(spec.fixed)
    for load in case.loads.values():
        for address in load.on or ():
            ends.get(address.body, set()).discard(address.region)
    return ends


def nodal_masses(case: Case, spec: BodySpec, mesh: Mesh, ends: Collection[str]) -> tuple[Floats, Any]:
    """Return the nodal masses of a body, and which of its nodes may have none, (n + 1,) each.

    Parameters
    ----------
    case, spec, mesh
        The case, the body and its mesh.
    ends
        Ends of the body that are in contact, and on which nothing else acts.

    Raises
    ------
    InputError
        If the mass treats ends in contact in a way of its own, and the elements have more than two nodes.
    """
    method, lumping = case.method.mass, lumping_of(spec.element, mesh)
    element_mass = spec.material.rho * spec.area * mesh.lengths
    may_lack_mass = np.zeros(mesh.nodes.shape[0], dtype=bool)
    if not within_limits(element_mass).all():  # which is refused by its bounds
        return lumping.at_nodes(element_mass), may_lack_mass
    for region in ends:
        may_lack_mass[list(mesh.regions[region].nodes)] = True
    if type(method).nodal_in_contact is Mass.nodal_in_contact or not may_lack_mass.any():
        return np.asarray(answer(method, "nodal", element_mass, lumping), dtype=float), np.zeros_like(may_lack_mass)
    if mesh.cells:
        kinds = ", ".join(mesh.cells)
        message = f"expected elements of two nodes at ends in contact with the mass {method.name}, found cells {kinds}"
        advice = f"{BALANCE[0].upper()}{BALANCE[1:]}, which is solved for two-node elements alone: take another mass."
        raise InputError([case.problem(("bodies", spec.name), message, advice)])
    first, last = bool(may_lack_mass[0]), bool(may_lack_mass[-1])
    nodal = answer(method, "nodal_in_contact", element_mass, lumping, first, last)
    return np.asarray(nodal, dtype=float), may_lack_mass


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
