"""The masses of a body as its mass method returns them.

Ends in contact may be left without mass. A mass that couples neighbouring nodes is given by its sparse inverse.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from percuss.errors import InputError
from percuss.mesh.cells import element_masses, has_cells, lumping_of
from percuss.mesh.size_limits import within_limits
from percuss.methods.blame import breach
from percuss.methods.interfaces import Mass
from percuss.methods.plugin_calls import answer

if TYPE_CHECKING:
    from collections.abc import Iterable

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
        ends.get(name, set()).difference_update(region for region, _ in spec.supports)
    for load in case.loads.values():
        for address in load.on or ():
            ends.get(address.body, set()).discard(address.region)
    return ends


class Masses(NamedTuple):
    """The masses of a body.

    Attributes
    ----------
    nodal : (nodes,) array
        Masses of its nodes.
    may_be_zero : (nodes,) bool array
        Whether the mass method may leave a node without mass.
    inverse : (nodes, nodes) sparse array
        M^-1 where the mass couples nodes; None where it is diagonal.
    """

    nodal: Floats
    may_be_zero: NDArray[np.bool]
    inverse: Any


def masses_of(case: Case, spec: BodySpec, body: BodyMesh, ends: Iterable[str]) -> Masses:
    """Return the masses of a body.

    Parameters
    ----------
    case, spec, body
        The case, and the body in it.
    ends
        Ends of the body that are in contact, and on which nothing else acts.

    Raises
    ------
    InputError
        If the mass leaves nodes without mass or couples them, and the elements have more than two nodes.
    PluginError
        If it does both.
    """
    from scipy.sparse import csr_array

    method, lumping, mesh = case.method.mass, lumping_of(spec.element, body), body.mesh
    element_mass, may_be_zero = element_masses(spec.element, body, spec.material.rho), np.zeros(len(mesh.nodes), bool)
    if not within_limits(element_mass).all():  # which is refused by its bounds
        return Masses(lumping.at_nodes(element_mass), may_be_zero, None)
    if type(method).nodal_in_contact is not Mass.nodal_in_contact:
        for region in ends:
            may_be_zero[list(mesh.regions[region].nodes)] = True
    if has_cells(spec.element) and (may_be_zero.any() or type(method).inverse is not Mass.inverse):
        where, kinds = " at ends in contact" if may_be_zero.any() else "", ", ".join(mesh.cells)
        message = f"expected elements of two nodes{where} with the mass {method.name}, found cells {kinds}"
        balance = f"{BALANCE[0].upper()}{BALANCE[1:]}, which is solved for two-node elements only"
        why = balance if where else "It couples the nodes of two-node elements along lines only"
        raise InputError([case.problem(("bodies", spec.name), message, f"{why}: take another mass.")])
    if may_be_zero.any():
        nodal = answer(method, "nodal_in_contact", element_mass, lumping, may_be_zero)
    else:
        nodal = answer(method, "nodal", element_mass, lumping)
    inverse = answer(method, "inverse", element_mass, lumping)
    if inverse is not None:
        if may_be_zero.any():
            raise breach(method, "inverse", "has both `inverse` and `nodal_in_contact`: an end without mass has none")
        inverse = csr_array(inverse)
        inverse.eliminate_zeros()
        inverse = inverse if inverse.nnz > len(mesh.nodes) else None  # 1/m to round-off
    return Masses(np.asarray(nodal, dtype=float), may_be_zero, inverse)
