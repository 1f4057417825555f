"""The masses of a body as its mass method returns them, checked.

Ends in contact may be left without mass. A mass that couples neighbouring nodes is given by its sparse inverse.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from percuss.errors import InputError
from percuss.mesh.cells import element_masses, has_cells, lumping_of
from percuss.mesh.eigenvalues import as_bands
from percuss.mesh.size_limits import within_limits
from percuss.methods.blame import breach
from percuss.methods.interfaces import Mass
from percuss.methods.plugin_calls import answer

if TYPE_CHECKING:
    from collections.abc import Collection

    from percuss.case.case import Case
    from percuss.case.specs import BodySpec
    from percuss.methods.interfaces import BodyMesh, Floats

BALANCE = "an end without mass is in static balance with its contact at t_n"
SAME_TRANSLATION = 1e-9  # largest deviation of C m from 1 that counts as round-off


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
        advice = f"{BALANCE[0].upper()}{BALANCE[1:]}, which is solved for two-node elements only: take another mass."
        raise InputError([case.problem(("bodies", spec.name), message, advice)])
    nodal = answer(method, "nodal_in_contact", element_mass, lumping, may_lack_mass)
    return np.asarray(nodal, dtype=float), may_lack_mass


def inverse_mass(case: Case, spec: BodySpec, body: BodyMesh, mass: Floats) -> Any:
    """Return M^-1 of a body as a sparse array, (nodes, nodes); None if its mass matrix is diagonal.

    Parameters
    ----------
    case, spec, body
        The case, and the body in it.
    mass : (nodes,) array
        Its nodal masses.

    Raises
    ------
    InputError
        If the elements of the body have more than two nodes.
    PluginError
        If the matrix is not positive definite, or gives a body that moves as a whole another mass than its nodes have.
    """
    from scipy.linalg import cholesky_banded
    from scipy.sparse import csr_array

    method = case.method.mass
    if type(method).inverse is Mass.inverse or not within_limits(mass).all():  # the latter are refused by their bounds
        return None
    if has_cells(spec.element):
        message = (
            f"expected elements of two nodes with the mass {method.name}, found cells {', '.join(body.mesh.cells)}"
        )
        advice = "It couples the nodes of two-node elements along lines only: take another mass."
        raise InputError([case.problem(("bodies", spec.name), message, advice)])
    masses, lumping = element_masses(spec.element, body, spec.material.rho), lumping_of(spec.element, body)
    matrix = answer(method, "inverse", masses, lumping)
    if matrix is None:
        return None
    if type(method).nodal_in_contact is not Mass.nodal_in_contact:
        raise breach(method, "inverse", "has both `inverse` and `nodal_in_contact`: an end without mass has no inverse")
    matrix = csr_array(matrix)
    matrix.eliminate_zeros()
    try:
        cholesky_banded(as_bands(matrix), lower=True)
    except np.linalg.LinAlgError:
        raise breach(method, "inverse", f"the matrix of body '{spec.name}' is not positive definite") from None
    moved = matrix @ mass
    node = int(np.argmax(np.abs(moved - 1.0)))
    if not abs(moved[node] - 1.0) <= SAME_TRANSLATION:
        message = (
            f"M^-1 m is {moved[node]:.9g} at node {node} of body '{spec.name}', expected 1 for the masses m of `nodal`"
        )
        raise breach(method, "inverse", f"{message}, which a body has that moves as a whole")
    return matrix if matrix.nnz > mass.size else None  # 1/m to round-off
