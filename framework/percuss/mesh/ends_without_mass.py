"""Ends in contact that a mass method leaves without mass: which ends it is told of, and where they are refused."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from percuss.errors import InputError
from percuss.mesh.cells import element_masses, has_cells, lumping_of
from percuss.mesh.size_limits import within_limits
from percuss.methods.interfaces import Mass
from percuss.methods.plugin_calls import answer

if TYPE_CHECKING:
    from collections.abc import Collection

    from percuss.case.case import Case
    from percuss.case.specs import BodySpec
    from percuss.methods.interfaces import BodyMesh, Floats

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


def nodal_masses(case: Case, spec: BodySpec, body: BodyMesh, ends: Collection[str]) -> tuple[Floats, NDArray[np.bool]]:
    """Return the nodal masses of a body, and which of its nodes may have none, (nodes,) each.

    Parameters
    ----------
    case, spec, body
        The case, and the body in it.
    ends
        Ends of the body that are in contact, and on which nothing else acts.

    Raises
    ------
    InputError
        If the mass treats ends in contact in a way of its own, and the elements have more than two nodes.
    """
    method, lumping, mesh = case.method.mass, lumping_of(spec.element, body), body.mesh
    element_mass = element_masses(spec.element, body, spec.material.rho)
    may_lack_mass = np.zeros(mesh.nodes.shape[0], dtype=bool)
    if not within_limits(element_mass).all():  # which is refused by its bounds
        return lumping.at_nodes(element_mass), may_lack_mass
    for region in ends:
        may_lack_mass[list(mesh.regions[region].nodes)] = True
    if type(method).nodal_in_contact is Mass.nodal_in_contact or not may_lack_mass.any():
        return np.asarray(answer(method, "nodal", element_mass, lumping), dtype=float), np.zeros_like(may_lack_mass)
    if has_cells(spec.element):
        kinds = ", ".join(mesh.cells)
        message = f"expected elements of two nodes at ends in contact with the mass {method.name}, found cells {kinds}"
        advice = f"{BALANCE[0].upper()}{BALANCE[1:]}, which is solved for two-node elements alone: take another mass."
        raise InputError([case.problem(("bodies", spec.name), message, advice)])
    nodal = answer(method, "nodal_in_contact", element_mass, lumping, may_lack_mass)
    return np.asarray(nodal, dtype=float), may_lack_mass
