"""The step with contacts closed as sparse matrices: mass, stiffness and contact rows of bodies of any dimension.

With M and K the mass and stiffness of all motions that supports and ties leave free, and N the gradients of the gaps,
central difference is stable at a step dt where ``(4/dt^2)(M + M_p) - (K + K_p)`` is positive definite for the worst
combination of closed contacts, by Sylvester's law of inertia. That combination closes exactly the contacts with a
positive ``excess = eps_s - 4 eps_m / dt^2``. If ``A = (4/dt^2) M - K`` is positive definite, which its factor proves,
the matrix is so where the largest eigenvalue of the small matrix ``N^T A^-1 N``, scaled by the roots of the excess, is
below 1. It is the softening: the largest share of the dynamic stiffness that contacts take away.

Where the mass couples nodes, M^-1 is sparse and M is full. Then ``C A C`` is examined with C = M^-1, which is positive
definite where A is: ``(4/dt^2) C - C K C``, with the rows C N in place of N.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from percuss.blas import one_blas_thread
from percuss.mesh.banded_matrices import bands
from percuss.mesh.ritz_values import highest_ritz_value, without_chance

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from percuss.methods.interfaces import Floats, Integers

SMALL_MATRIX = 32  # rows up to which a matrix is taken as full
FULL_EIGENVECTORS = 200  # rows up to which all eigenvectors of a matrix are found to have the last one
COLUMNS_AT_ONCE = 256  # right-hand sides that are solved for together
# Largest number of contacts of which each is tried whether it can be left out, to bound the time.
MOST_TRIED_CONTACTS = 24
UNFELT = 1e-9  # relative size below which what rows see of a motion is round-off
WELL_BELOW = 1e-6  # relative distance from a proved frequency beyond which no factor is asked again
ABOVE_RITZ_VALUE = 1e-11  # relative distance from the largest Ritz value at which the first factor is tried


class Factor(Protocol):
    """A factor of a positive definite matrix."""

    def solve(self, columns: Floats) -> Floats:
        """Return the inverse of the matrix times (n, k) columns."""


@dataclass(frozen=True)
class Operator:
    """Mass, stiffness and contact rows of bodies of any dimension, and what follows from a factor of ``scale M - K``.

    Attributes
    ----------
    stiffness, mass : (n, n) sparse arrays
        K and M, or ``C K C`` and C where the mass couples nodes.
    rows : (n, P) sparse array
        N, or C N; a contact point may have rows at any number of nodes.
    """

    stiffness: Any
    mass: Any
    rows: Any

    @property
    def size(self) -> int:
        """Number of motions."""
        return int(self.stiffness.shape[1])

    def factor(self, scale: float) -> Factor | None:
        """Return a factor without pivoting: the matrix is positive definite where all its pivots are positive."""
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        matrix = csc_array(scale * self.mass - self.stiffness)
        try:
            factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        except RuntimeError:  # a pivot is 0
            return None
        kept = bool(np.all(factor.perm_r == factor.perm_c))
        return factor if kept and bool(np.all(factor.U.diagonal() > 0.0)) else None

    def compliance(self, factor: Factor, contacts: Integers) -> Floats:
        """Return ``N^T (scale M - K)^-1 N`` of some contacts."""
        rows = self.rows[:, contacts]
        parts = [
            rows.T @ factor.solve(rows[:, first : first + COLUMNS_AT_ONCE].toarray())
            for first in range(0, contacts.size, COLUMNS_AT_ONCE)
        ]
        return np.concatenate(parts, axis=1)

    @cached_property
    def highest_eigenvalue(self) -> float:
        """The smallest number found for which a factor proves ``scale M - K`` to be positive definite.

        The Ritz value of a Lanczos iteration is at most the eigenvalue.
        """
        low = highest_ritz_value(self.stiffness, self.mass)
        if low <= 0.0:
            return 0.0
        distance = ABOVE_RITZ_VALUE
        while self.factor(low * (1.0 + distance)) is None:
            low, distance = low * (1.0 + distance), 2.0 * distance
        return low * (1.0 + distance)

    def rigid(self) -> Floats:
        """Return motions without strain, one a column; where the mass couples nodes, those of M u in place of u."""
        from scipy.linalg import null_space

        motions: Floats = null_space(self.stiffness.toarray())
        return motions

    def dense(self) -> tuple[Floats, Floats, Floats]:
        """Return stiffness, mass and contact rows as full matrices."""
        return self.stiffness.toarray(), self.mass.toarray(), self.rows.toarray()

    def free_step(self) -> float:
        """Return the largest step that is stable with no contact closed but ties, 2 over the highest frequency."""
        highest = self.highest_eigenvalue
        return 2.0 / math.sqrt(highest) if highest > 0.0 else math.inf

    def definite(self, dt: float, stiffness: Floats, inertia: Floats) -> tuple[bool, list[int]]:
        """Return whether ``(4/dt^2)(M + M_p) - (K + K_p)`` is positive definite for every set of closed contacts.

        Parameters
        ----------
        dt
            Time step.
        stiffness, inertia : (P,) arrays
            eps_s and eps_m of the contacts evaluated at the current state, 0 for the others.

        Returns
        -------
        definite
            Whether the matrix is positive definite.
        limiting
            Contacts that suffice to make it indefinite while they are closed; if they are at most
            `MOST_TRIED_CONTACTS`, none can be left out. Empty where the matrix is definite, or indefinite without
            contact.
        """
        harmful, softening = self._softening(dt, stiffness, inertia)
        if softening is None:
            return False, []
        if not harmful.size or largest_eigenvalue(softening) < 1.0:
            return True, []
        return False, [int(p) for p in harmful[_limiting_rows(softening)]]

    def largest_softening(self, dt: float, stiffness: Floats, inertia: Floats) -> float:
        """Return the number that is below 1 where `definite` is true; inf where no contact is needed to make it false.

        It varies continuously with dt.
        """
        harmful, softening = self._softening(dt, stiffness, inertia)
        if softening is None:
            return np.inf
        return largest_eigenvalue(softening) if harmful.size else 0.0

    def _softening(self, dt: float, stiffness: Floats, inertia: Floats) -> tuple[Integers, Any]:
        """Return the contacts that soften the step, and their softening; None where it is unstable without contact."""
        excess = stiffness - 4.0 * inertia / dt**2
        harmful = np.flatnonzero(excess > 0)
        proved = vars(self).get("highest_eigenvalue", math.inf) * (1.0 + WELL_BELOW)
        if harmful.size == 0 and 4.0 / dt**2 > proved:
            return harmful, np.zeros((0, 0))  # a factor has proved a longer step
        factor = self.factor(4.0 / dt**2)
        if factor is None or harmful.size == 0:
            return harmful, None if factor is None else np.zeros((0, 0))
        root = np.sqrt(excess[harmful])
        compliance = self.compliance(factor, harmful)
        if isinstance(compliance, np.ndarray):
            return harmful, root[:, None] * compliance * root
        from scipy.sparse import diags_array

        return harmful, (diags_array(root) @ compliance @ diags_array(root)).tocsr()


def largest_eigenvalue(matrix: Any) -> float:
    """Return the largest eigenvalue of a symmetric matrix; a large one, full or sparse, has zeros in most places.

    A contact is coupled to those on the same bodies only, so that a suitable order of the contacts gives a matrix with
    few diagonals.
    """
    size = matrix.shape[0]
    if size <= SMALL_MATRIX:
        return float(np.linalg.eigvalsh(_full(matrix))[-1])
    from scipy.linalg import eigh, eigvals_banded
    from scipy.sparse import coo_array, csr_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    last = (size - 1, size - 1)
    order = reverse_cuthill_mckee(csr_array(matrix), symmetric_mode=True)
    ordered = coo_array(submatrix(csr_array(matrix), order))
    if int(np.abs(ordered.row - ordered.col).max(initial=0)) > size // 8:
        with one_blas_thread():  # once more, of the library that this import may have brought
            return float(eigh(_full(matrix), eigvals_only=True, subset_by_index=last)[0])
    return float(eigvals_banded(bands(ordered), lower=True, select="i", select_range=last)[0])


def none_to_spare(members: Sequence[int], unstable: Callable[[list[int]], bool]) -> list[int]:
    """Return what is left of an unstable set once each member is left out, in turn, that it can spare."""
    kept = list(members)
    for member in members:
        rest = [other for other in kept if other != member]
        kept = rest if unstable(rest) else kept
    return kept


def deflated(matrix: Floats, motions: Floats) -> Floats:
    """Return a matrix with zero in place of some motions, orthonormal columns, and of what it makes of these."""
    matrix = matrix - motions @ (motions.T @ matrix)
    return matrix - (matrix @ motions) @ motions.T


def unfelt(motions: Floats, rows: Floats) -> Floats:
    """Return the combinations of motions, one a column, that leave rows at zero."""
    if not (motions.size and rows.size):
        return motions
    _, size, right = np.linalg.svd(rows @ motions)
    kept: Floats = motions @ right[int((size > UNFELT * np.linalg.norm(rows)).sum()) :].T
    return kept


def submatrix(matrix: Any, rows: Any) -> Any:
    """Return the rows and columns `rows` of a matrix, full or sparse."""
    return matrix[np.ix_(rows, rows)] if isinstance(matrix, np.ndarray) else matrix[rows][:, rows]


def _full(matrix: Any) -> Floats:
    return matrix if isinstance(matrix, np.ndarray) else matrix.toarray()


def _last_eigenvector(matrix: Any) -> Floats:
    """Return an eigenvector of the largest eigenvalue of a symmetric matrix; of a large one, approximately."""
    size = matrix.shape[0]
    if size <= FULL_EIGENVECTORS:
        return np.linalg.eigh(_full(matrix))[1][:, -1]
    from scipy.sparse.linalg import ArpackNoConvergence, eigsh

    diagonal = matrix.diagonal()
    try:
        start = np.sqrt(np.abs(diagonal))
        return eigsh(matrix, k=1, which="LA", v0=start, tol=1e-6, **without_chance(eigsh))[1][:, 0]  # type: ignore[no-any-return]
    except ArpackNoConvergence:
        return diagonal  # type: ignore[no-any-return]


def _limiting_rows(matrix: object) -> list[int]:
    """Return a small set of rows of a symmetric matrix whose submatrix has an eigenvalue of 1 or more.

    The rows with the largest components in the last eigenvector come first, the fewest of them that suffice; of up to
    `MOST_TRIED_CONTACTS` rows, each that can be left out is then left out.
    """

    def unstable(rows: list[int]) -> bool:
        return bool(rows) and largest_eigenvalue(submatrix(matrix, rows)) >= 1.0

    component = np.abs(_last_eigenvector(matrix))
    order = [int(row) for row in np.argsort(-component, kind="stable")]
    lo, hi = 0, len(order)  # The first `hi` rows are unstable, the first `lo` rows are not.
    while hi - lo > 1:
        middle = (lo + hi) // 2
        lo, hi = (lo, middle) if unstable(order[:middle]) else (middle, hi)
    return sorted(order[:hi] if hi > MOST_TRIED_CONTACTS else none_to_spare(order[:hi][::-1], unstable))
