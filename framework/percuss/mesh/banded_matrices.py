"""Symmetric banded matrices: the inverse masses of bodies whose mass couples nodes, and their pencils.

A symmetric banded matrix is an array (k + 1, nodes): its diagonal, then its k off-diagonals, the entry of column j in
place j, with zeros where a row has ended. With C = M^-1 the pencil of stiffness and mass is that of ``C K C`` and C:
``s M - K`` is positive definite where ``s C - C K C`` is, and its inverse is ``C (s C - C K C)^-1 C``. Both matrices
are banded, though M is full.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from percuss.methods.interfaces import Floats

BRACKET = 2.0  # factor between two trials for a bracket of the highest eigenvalue


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


def sparse(band: Floats) -> Any:
    """Return a banded matrix as a sparse one."""
    from scipy.sparse import csr_array, diags_array

    size = band.shape[1]
    offsets = range(1, min(band.shape[0], size))
    beside = [band[k, : size - k] for k in offsets]
    return csr_array(diags_array([band[0], *beside, *beside], offsets=[0, *offsets, *(-k for k in offsets)]))


def bands(matrix: Any, count: int = 0) -> Floats:
    """Return the bands of a symmetric sparse matrix, `count` of them at least."""
    entries = matrix.tocoo()
    below = entries.row - entries.col
    out = np.zeros((max(int(below.max(initial=0)) + 1, count), matrix.shape[0]))
    kept = below >= 0
    out[below[kept], entries.col[kept]] = entries.data[kept]
    return out


def pencil_bands(band: Floats, stiffness: Floats) -> tuple[Floats, Floats]:
    """Return the bands of C and those of ``C K C``, as many of both, from C and K."""
    c = sparse(band)
    product = bands(c @ sparse(stiffness) @ c, band.shape[0])
    inverse = np.zeros_like(product)
    inverse[: band.shape[0]] = band
    return inverse, product


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
