"""The highest frequency of large sparse bodies by Lanczos iterations, which find it from below."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np

RITZ_TOLERANCE = 1e-9  # of the largest residual over the Ritz value, whose own error is of second order


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
    search: Any = {"k": 1, "which": "LA", "tol": RITZ_TOLERANCE, "return_eigenvectors": False}
    search |= {"v0": np.random.default_rng(0).standard_normal(size), **without_chance(eigsh)}
    if mass.nnz > size:
        return float(eigsh(stiffness, M=mass, **search)[0])
    root = diags_array(1.0 / np.sqrt(mass.diagonal()))
    return float(eigsh(root @ stiffness @ root, **search)[0])


def without_chance(solver: Any) -> dict[str, int]:
    """Return the argument with which an iteration of SciPy draws the same numbers in each call.

    Versions before 1.17 do not have it, and draw the same numbers anyway.
    """
    return {"rng": 0} if "rng" in inspect.signature(solver).parameters else {}
