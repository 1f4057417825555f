"""Masses that couple neighbouring nodes: their banded inverses, as a mass method returns them, checked and prepared.

`percuss.mesh.banded_matrices` says how a banded matrix is stored.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from percuss.errors import InputError
from percuss.lapack import lapack
from percuss.mesh.banded_matrices import bands, times
from percuss.mesh.cells import element_masses, has_cells, lumping_of
from percuss.mesh.size_limits import within_limits
from percuss.methods.blame import breach
from percuss.methods.interfaces import Mass
from percuss.methods.plugin_calls import answer

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.case.specs import BodySpec
    from percuss.methods.interfaces import BodyMesh, Floats

SAME_TRANSLATION = 1e-9  # largest deviation of C m from 1 that counts as round-off


def inverse_mass(case: Case, spec: BodySpec, body: BodyMesh, mass: Floats) -> Floats:
    """Return the bands of M^-1 of a body, (k + 1, nodes); (0, nodes) if its mass matrix is diagonal.

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
    method = case.method.mass
    diagonal = np.zeros((0, mass.size))
    if type(method).inverse is Mass.inverse or not within_limits(mass).all():  # the latter are refused by their bounds
        return diagonal
    if has_cells(spec.element):
        message = (
            f"expected elements of two nodes with the mass {method.name}, found cells {', '.join(body.mesh.cells)}"
        )
        advice = "It couples the nodes of lines of two-node elements alone: take another mass."
        raise InputError([case.problem(("bodies", spec.name), message, advice)])
    masses, lumping = element_masses(spec.element, body, spec.material.rho), lumping_of(spec.element, body)
    matrix = answer(method, "inverse", masses, lumping)
    if matrix is None:
        return diagonal
    if type(method).nodal_in_contact is not Mass.nodal_in_contact:
        raise breach(method, "inverse", "has both `inverse` and `nodal_in_contact`: an end without mass has no inverse")
    band = bands(matrix)
    last = int(np.flatnonzero(band.any(axis=1)).max(initial=0))
    band = band[: last + 1]
    if lapack().dpbtrf(band, lower=1)[1]:
        raise breach(method, "inverse", f"the matrix of body '{spec.name}' is not positive definite")
    moved = times(band, mass[:, None])[:, 0]
    node = int(np.argmax(np.abs(moved - 1.0)))
    if not abs(moved[node] - 1.0) <= SAME_TRANSLATION:
        message = (
            f"M^-1 m is {moved[node]:.9g} at node {node} of body '{spec.name}', expected 1 for the masses m of `nodal`"
        )
        raise breach(method, "inverse", f"{message}, which a body has that moves as a whole")
    if last == 0:  # 1/m to round-off
        return diagonal
    band.flags.writeable = False
    return band
