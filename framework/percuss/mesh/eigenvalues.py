"""The highest frequencies of bodies: of matrices with few diagonals exactly, of others by Lanczos iterations.

A symmetric banded matrix is an array (k + 1, n), as LAPACK has it: its diagonal, then its k diagonals below that, the
entry of column j in place j, with zeros where a row has ended.
"""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from percuss.methods.interfaces import Floats

BRACKET = 2.0  # factor between two trials for a bracket of the highest eigenvalue
FEW = 20  # rows up to which a matrix is made by products
RITZ_TOLERANCE = 1e-9  # of the largest residual over the Ritz value, whose own error is of second order


def as_bands(matrix: Any) -> Floats:
    """Return the bands of a symmetric compressed sparse matrix, (k + 1, n)."""
    size = matrix.shape[0]
    row = np.repeat(np.arange(size), np.diff(matrix.indptr))
    out = np.zeros((int((row - matrix.indices).max(initial=0)) + 1, size))
    for k, band in enumerate(out):
        band[: size - k] = matrix.diagonal(-k)
    return out


def highest_of_bands(stiffness: Floats, mass: Floats) -> float:
    """Return the largest eigenvalue of ``M^-1 K``, both of them banded [1/time^2].

    With more than one diagonal beside the main one it is the smallest number s for which ``s M - K`` is found to be
    positive definite.
    """
    from scipy.linalg import cholesky_banded, eigvalsh_tridiagonal

    if len(stiffness) == 1 and len(mass) == 1:
        return float((stiffness[0] / mass[0]).max())
    if len(stiffness) == 2 and len(mass) == 1:
        root = 1.0 / np.sqrt(mass[0])
        squared = stiffness[0] * root**2
        scale = float(squared.max()) or 1.0  # LAPACK does not scale, and units may be of any size
        beside = stiffness[1, :-1] * root[:-1] * root[1:] / scale
        last = (squared.size - 1, squared.size - 1)
        values = eigvalsh_tridiagonal(squared / scale, beside, select="i", select_range=last, check_finite=False)
        return scale * float(values[0])
    count = max(len(stiffness), len(mass))
    k, m = (np.pad(band, ((0, count - len(band)), (0, 0))) for band in (stiffness, mass))

    def definite(square: float) -> bool:
        try:
            cholesky_banded(square * m - k, lower=True, check_finite=False)
        except np.linalg.LinAlgError:
            return False
        return True

    # The quotient of stiffness and mass of a single direction is no larger than the eigenvalue.
    low = high = float((stiffness[0] / mass[0]).max())
    if low == 0.0:
        return 0.0
    while not definite(high):
        low, high = high, BRACKET * high
    while True:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            return high
        low, high = (low, middle) if definite(middle) else (middle, high)


def highest_value(product: Callable[[Floats], Floats], size: int, tolerance: float = RITZ_TOLERANCE) -> float:
    """Return the largest eigenvalue of a symmetric matrix of which only products are known.

    The `tolerance` is that of the residual over the Ritz value, whose own error is smaller.
    """
    from scipy.sparse.linalg import LinearOperator, eigsh

    if size <= FEW:
        matrix = np.column_stack([product(unit) for unit in np.eye(size)])
        return float(np.linalg.eigvalsh(0.5 * (matrix + matrix.T))[-1])
    return float(eigsh(LinearOperator((size, size), product, dtype=float), **_search(size, tolerance))[0])


def _search(size: int, tolerance: float) -> Any:
    """Return the arguments by which SciPy's Lanczos iteration finds the largest eigenvalue, from the same start."""
    from scipy.sparse.linalg import eigsh

    start = np.random.default_rng(0).standard_normal(size)
    return {"k": 1, "which": "LA", "tol": tolerance, "return_eigenvectors": False, "v0": start, **without_chance(eigsh)}


def highest_ritz_value(stiffness: Any, mass: Any) -> float:
    """Return the largest Ritz value of ``M^-1 K``, which is at most its largest eigenvalue [1/time^2].

    Bodies with equal directions have several equal eigenvalues, at which an iteration for all digits does not end.

    Parameters
    ----------
    stiffness, mass : (n, n) sparse arrays
        K and M.
    """
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import eigsh

    size = mass.shape[0]
    search = _search(size, RITZ_TOLERANCE)
    if mass.nnz > size:
        return float(eigsh(stiffness, M=mass, **search)[0])
    root = diags_array(1.0 / np.sqrt(mass.diagonal()))
    return float(eigsh(root @ stiffness @ root, **search)[0])


def without_chance(solver: Any) -> dict[str, int]:
    """Return the argument with which an iteration of SciPy draws the same numbers in each call.

    Versions before 1.17 do not have it, and draw the same numbers anyway.
    """
    return {"rng": 0} if "rng" in inspect.signature(solver).parameters else {}
