"""Masses that couple neighbouring nodes: banded inverse mass matrices, as a mass method returns them.

A symmetric banded matrix is an array (k + 1, nodes): its diagonal, then its k off-diagonals, the entry of column j in
place j, with zeros where a row has ended. With C = M^-1 the pencil of stiffness and mass is that of ``C K C`` and C:
``s M - K`` is positive definite where ``s C - C K C`` is, and its inverse is ``C (s C - C K C)^-1 C``. Both matrices
are banded, though M is full.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.errors import InputError
from percuss.lapack import lapack
from percuss.methods.blame import breach
from percuss.methods.interfaces import Mass
from percuss.methods.plugin_calls import answer
from percuss.solver.cells import lumping_of

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable

    from percuss.case.case import Case
    from percuss.case.specs import BodySpec
    from percuss.methods.interfaces import Floats, Mesh
    from percuss.solver.entities import Body

BRACKET = 2.0  # factor between two trials for a bracket of the highest eigenvalue
SAME_TRANSLATION = 1e-9  # largest deviation of C m from 1 that counts as round-off


def inverse_mass(case: Case, spec: BodySpec, mesh: Mesh, mass: Floats) -> Floats:
    """Return the bands of M^-1 of a body, (k + 1, nodes); (0, nodes) if its mass matrix is diagonal.

    Parameters
    ----------
    case, spec, mesh
        The case, the body and its mesh.
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
    if type(method).inverse is Mass.inverse:
        return diagonal
    if mesh.cells:
        message = f"expected elements of two nodes with the mass {method.name}, found cells {', '.join(mesh.cells)}"
        advice = "It couples the nodes of lines of two-node elements alone: take another mass."
        raise InputError([case.problem(("bodies", spec.name), message, advice)])
    band = answer(method, "inverse", spec.material.rho * spec.area * mesh.lengths, lumping_of(spec.element, mesh))
    if band is None:
        return diagonal
    if type(method).nodal_in_contact is not Mass.nodal_in_contact:
        raise breach(method, "inverse", "has both `inverse` and `nodal_in_contact`: an end without mass has no inverse")
    band = np.ascontiguousarray(band, dtype=float)
    last = int(np.flatnonzero(band.any(axis=1)).max(initial=0))
    band = band[: last + 1]
    if lapack().dpbtrf(band, lower=1)[1]:
        raise breach(method, "inverse", f"the matrix of body '{spec.name}' is not positive definite")
    off = np.abs(times(band, mass[:, None])[:, 0] - 1.0)
    if not off.max() <= SAME_TRANSLATION:
        node = int(np.argmax(off))
        message = f"M^-1 m is {1.0 + off[node]:.9g} or {1.0 - off[node]:.9g} at node {node} of body '{spec.name}'"
        raise breach(method, "inverse", f"{message}, expected 1 for the masses m of `nodal`: translation has that mass")
    if last == 0:  # 1/m to round-off
        return diagonal
    band.flags.writeable = False
    return band


def refuse_coupled_ends(case: Case, bodies: Iterable[Body], acted: Collection[int]) -> None:
    """Refuse supports, drives and loads on an end whose motion the mass couples to the other end of its body.

    Parameters
    ----------
    case, bodies
        The case and its bodies.
    acted
        Nodes on which a support, a drive or a load acts.

    Raises
    ------
    InputError
        With one problem for each such body.
    """
    problems = []
    for body in bodies:
        reach, count = body.inverse.shape[0] - 1, body.stiffness.size
        if count <= reach and not {body.start, body.stop - 1}.isdisjoint(acted):
            name = case.method.mass.name
            message = f"expected more than {reach} elements in body '{body.name}', found {count}"
            advice = (
                f"The mass {name} couples both of its ends, and a support, a drive or a load acts on one: take more."
            )
            problems.append(case.problem(("bodies", body.name), message, advice))
    if problems:
        raise InputError(problems)


def times(band: Floats, columns: Floats) -> Floats:
    """Return a banded matrix times (nodes, m) columns."""
    out: Floats = band[0][:, None] * columns
    for k, off in enumerate(band[1:], start=1):
        beside = off[:-k, None]
        out[k:] += beside * columns[:-k]
        out[:-k] += beside * columns[k:]
    return out


def column(band: Floats, node: int) -> dict[int, float]:
    """Return the entries of a column of a banded matrix by their rows, beginning with that on the diagonal."""
    entries = {node: float(band[0, node])}
    for k, off in enumerate(band[1:], start=1):
        if node + k < off.size:
            entries[node + k] = float(off[node])
        if node - k >= 0:
            entries[node - k] = float(off[node - k])
    return entries


def with_ends_held(band: Floats, *, first: bool, last: bool) -> Floats:
    """Return M^-1 of the nodes that remain if the first or the last node is held, and left out.

    It is the inverse of the remaining rows and columns of M, ``C - C e (e^T C e)^-1 e^T C`` with e the held node.
    """
    band = _without_first(band) if first else band
    return reversed_band(_without_first(reversed_band(band))) if last else band


def _without_first(band: Floats) -> Floats:
    beside = band[1:, 0]
    out = band[:, 1:].copy()
    for i in range(beside.size):
        for j in range(i + 1):
            out[i - j, j] -= beside[i] * beside[j] / band[0, 0]
    return out


def reversed_band(band: Floats) -> Floats:
    """Return the banded matrix of the nodes in reversed order."""
    out = np.zeros_like(band)
    for k, off in enumerate(band):
        out[k, : off.size - k] = off[: off.size - k][::-1]
    return out


def pencil_bands(band: Floats, diagonal: Floats, off: Floats) -> tuple[Floats, Floats]:
    """Return the bands of C and those of ``C K C``, as many of both.

    Parameters
    ----------
    band : (k + 1, n) array
        C.
    diagonal, off : (n,) and (n - 1,) arrays
        The stiffness K of two-node elements.
    """
    from scipy.sparse import csr_array, diags_array

    size = diagonal.size
    beside = [band[k, : size - k] for k in range(1, min(band.shape[0], size))]
    c: Any = csr_array(
        diags_array(
            [band[0], *beside, *beside], offsets=[0, *range(1, len(beside) + 1), *range(-1, -len(beside) - 1, -1)]
        )
    )
    k: Any = csr_array(diags_array([diagonal, off, off], offsets=[0, 1, -1])) if size > 1 else csr_array([diagonal])
    product = c @ k @ c
    rows = min(2 * band.shape[0], size)
    inverse, stiffness = np.zeros((rows, size)), np.zeros((rows, size))
    inverse[: min(band.shape[0], rows)] = band[:rows]
    for d in range(rows):
        stiffness[d, : size - d] = product.diagonal(-d)
    return inverse, stiffness


def highest_eigenvalue(low: float, definite: Callable[[float], bool]) -> float:
    """Return the smallest number s for which ``s M - K`` is positive definite, the square of a frequency.

    Parameters
    ----------
    low
        A number that is not larger.
    definite
        Whether the matrix is positive definite for a number.
    """
    if low == 0.0:
        return 0.0
    high = low
    while not definite(high):
        low, high = high, BRACKET * high
    while True:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            return high
        low, high = (low, middle) if definite(middle) else (middle, high)


def highest_frequency(body: Body) -> float:
    """Return the highest angular frequency of a body whose mass couples nodes, without supports [1/time]."""
    inverse, stiffness = pencil_bands(body.inverse, *body.axial_band)

    def definite(square: float) -> bool:
        return lapack().dpbtrf(square * inverse - stiffness, lower=1)[1] == 0  # type: ignore[no-any-return]

    # The quotient of stiffness and mass of a single direction is no larger than the eigenvalue.
    return math.sqrt(highest_eigenvalue(float((stiffness[0] / inverse[0]).max()), definite))


def rows_for_the_loop(bodies: Iterable[Body]) -> tuple[Floats, Floats]:
    """Return ``M^-1 diag(m)`` of all bodies as rows, and the Cholesky factors of M^-1, which the loop reads.

    The former is (nodes, 2 k + 1), the entry of node i and node i + d in place k + d; the latter (k + 1, nodes), lower
    bands. Both are empty, (0, 0), if all mass matrices are diagonal. A diagonal one among others is a band of its own.
    """
    bodies = list(bodies)
    width = max(body.inverse.shape[0] for body in bodies) - 1
    if width < 0:
        return np.zeros((0, 0)), np.zeros((0, 0))
    rows, factors = [], []
    for body in bodies:
        size = body.mass.size
        band = np.zeros((width + 1, size))
        bands = body.inverse if body.inverse.size else 1.0 / body.mass[None]
        band[: bands.shape[0]] = bands
        row = np.zeros((size, 2 * width + 1))
        for d in range(width + 1):
            row[: size - d, width + d] = band[d, : size - d] * body.mass[d:]
            row[d:, width - d] = band[d, : size - d] * body.mass[: size - d]
        rows.append(row)
        factors.append(lapack().dpbtrf(band, lower=1)[0])
    return np.ascontiguousarray(np.concatenate(rows)), np.ascontiguousarray(np.concatenate(factors, axis=1))
