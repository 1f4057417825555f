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
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded, eigh, eigvals_banded
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.csgraph import connected_components, reverse_cuthill_mckee
from scipy.sparse.linalg import ArpackNoConvergence, eigsh, splu

from percuss.mesh.eigenvalues import as_bands, highest_of_bands, highest_ritz_value, without_chance

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.methods.interfaces import Floats, Integers

MOST_BANDS = 8  # beside the diagonal of a matrix that is taken as banded
SMALL_MATRIX = 32  # rows up to which a matrix is taken as full
FULL_EIGENVECTORS = 200  # rows up to which all eigenvectors of a matrix are found to have the last one
COLUMNS_AT_ONCE = 256  # right-hand sides that are solved for together
FEWER_COLUMNS = 4  # times fewer columns of blocks than of contacts from which on blocks are solved for together
# Largest number of contacts of which each is tried whether it can be left out, to bound the time.
MOST_TRIED_CONTACTS = 24
WELL_BELOW = 1e-6  # relative distance from a proved frequency beyond which no factor is asked again
ABOVE_RITZ_VALUE = 1e-11  # relative distance from the largest Ritz value at which the first factor is tried
SAME_FREQUENCY = 4e-9  # relative difference of two squares of a frequency that count as equal
ABOVE_HIGHEST = 1e-12  # relative distance from the highest eigenvalue at which a matrix is factorised for its modes
INVERSE_ITERATIONS = 8


# What a factor of a positive definite matrix gives: the inverse of the matrix times (n, k) columns.
Solve = Callable[[Any], Any]


@dataclass(frozen=True)
class Operator:
    """Mass, stiffness and contact rows of bodies of any dimension, and what follows from a factor of ``scale M - K``.

    Matrices with few diagonals, as those of bars, are factorised as such, others as sparse ones. `banded` puts the
    motions into an order that leaves few.

    Attributes
    ----------
    stiffness, mass : (n, n) sparse arrays
        K and M, or ``C K C`` and C where the mass couples nodes.
    rows : (n, P) sparse array
        N, or C N; a contact point may have rows at any number of nodes.
    motions : (nodes * dim, n) sparse array
        The displacements of each motion.
    """

    stiffness: Any
    mass: Any
    rows: Any
    motions: Any = None

    @property
    def size(self) -> int:
        """Number of motions."""
        return int(self.stiffness.shape[1])

    @property
    def _pattern(self) -> Any:
        """Which motions K or M couple; a matrix of as many entries, which is not kept."""
        return self.stiffness.astype(bool) + self.mass.astype(bool)

    @cached_property
    def _bands(self) -> tuple[Floats, Floats] | None:
        """K and M as bands, None where they have more than `MOST_BANDS` beside the diagonal."""
        few = _reach(self.stiffness, self.mass) <= MOST_BANDS
        return (as_bands(self.stiffness), as_bands(self.mass)) if few else None

    def banded(self) -> Operator:
        """Return the operator with its motions in an order that leaves few diagonals, itself where there is none."""
        if _reach(self.stiffness, self.mass) <= MOST_BANDS:
            return self
        pattern = self._pattern
        if pattern.nnz > (2 * MOST_BANDS + 1) * self.size:
            return self
        order = reverse_cuthill_mckee(pattern, symmetric_mode=True)
        parts = submatrix(self.stiffness, order), submatrix(self.mass, order), self.rows[order]
        return Operator(*parts, None if self.motions is None else self.motions[:, order])

    def factor(self, scale: float) -> Solve | None:
        """Return the inverse of ``scale M - K`` by a factor of it, None unless that is positive definite."""
        if self._bands is not None:
            stiffness, mass = self._bands
            band = np.zeros((max(len(stiffness), len(mass)), self.size))
            band[: len(mass)] += scale * mass
            band[: len(stiffness)] -= stiffness
            try:
                factor = cholesky_banded(band, lower=True, check_finite=False)
            except np.linalg.LinAlgError:
                return None
            return partial(cho_solve_banded, (factor, True), check_finite=False)
        matrix = csc_array(scale * self.mass - self.stiffness)
        # Without pivoting, the matrix is positive definite where all pivots are positive.
        try:
            factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        except RuntimeError:  # a pivot is 0
            return None
        kept = bool(np.all(factor.perm_r == factor.perm_c))
        return factor.solve if kept and bool(np.all(factor.U.diagonal() > 0.0)) else None

    def compliance(self, solve: Solve, contacts: Integers) -> Any:
        """Return ``N^T (scale M - K)^-1 N`` of some contacts as a sparse array, from the inverse in the middle."""
        label, touched, column = self._blocks
        rows = self.rows[:, contacts]
        if FEWER_COLUMNS * (int(column.max(initial=-1)) + 1) > contacts.size:
            groups = (rows[:, first : first + COLUMNS_AT_ONCE] for first in range(0, contacts.size, COLUMNS_AT_ONCE))
            return csr_array(np.concatenate([rows.T @ solve(group.toarray()) for group in groups], axis=1))
        # Bodies that nothing joins are solved for together: one column serves a motion of each of them.
        units = np.zeros((self.size, int(column.max()) + 1))
        units[touched, column] = 1.0
        member = csr_array((np.ones(label.size), (np.arange(label.size), label)))
        inverse = (member @ member.T).tocoo()
        inverse.data = solve(units)[touched[inverse.row], column[inverse.col]]
        return rows[touched].T @ inverse.tocsr() @ rows[touched]

    @cached_property
    def _blocks(self) -> tuple[Integers, Integers, Integers]:
        """The block of each motion that contacts touch, that motion, and its number within its block."""
        touched = np.unique(self.rows.tocoo().row)
        label = connected_components(self._pattern, directed=False)[1][touched]
        order = np.argsort(label, kind="stable")
        touched, label = touched[order], label[order]
        return label, touched, np.arange(label.size) - np.searchsorted(label, label)

    @cached_property
    def highest_eigenvalue(self) -> float:
        """The largest eigenvalue of ``M^-1 K`` [1/time^2].

        Of matrices with many diagonals it is the smallest number found for which a factor proves ``scale M - K`` to be
        positive definite. The Ritz value of a Lanczos iteration is at most the eigenvalue.
        """
        if not self.size:
            return 0.0
        if self._bands is not None:
            return highest_of_bands(*self._bands)
        low = highest_ritz_value(self.stiffness, self.mass)
        if low <= 0.0:
            return 0.0
        distance = ABOVE_RITZ_VALUE
        while self.factor(low * (1.0 + distance)) is None:
            low, distance = low * (1.0 + distance), 2.0 * distance
        return low * (1.0 + distance)

    def modes_at(self, square: float) -> Floats:
        """Return the highest mode of each body whose eigenvalue is the largest of all, ``u^T M u = 1``, (n, k).

        There is none unless that is `square`. Bodies that nothing joins are looked at in one iteration.
        """
        highest = self.highest_eigenvalue
        if not abs(highest - square) < SAME_FREQUENCY * square:
            return np.zeros((self.size, 0))
        solve = self.factor(highest * (1.0 + ABOVE_HIGHEST)) or self.factor(highest * (1.0 + 1e3 * ABOVE_HIGHEST))
        if solve is None:
            raise np.linalg.LinAlgError(f"no factor just above the highest eigenvalue {highest:.6g}")
        count, label = connected_components(self._pattern, directed=False)
        mode: Floats = np.random.default_rng(0).standard_normal(self.size)
        for _ in range(INVERSE_ITERATIONS):
            mode = solve((self.mass @ mode)[:, None])[:, 0]
            mode = mode / np.sqrt(np.bincount(label, mode * (self.mass @ mode)))[label]
        squares = np.bincount(label, mode * (self.stiffness @ mode), minlength=count)
        alike = np.flatnonzero(np.abs(squares - square) < SAME_FREQUENCY * square)
        return np.where(label[:, None] == alike, mode[:, None], 0.0)

    def free_step(self) -> float:
        """Return the largest step that is stable with no contact closed but ties, 2 over the highest frequency."""
        highest = self.highest_eigenvalue
        return 2.0 / math.sqrt(highest) if highest > 0.0 else math.inf

    def softening(self, dt: float, stiffness: Floats, inertia: Floats) -> tuple[Integers, Any] | None:
        """Return the contacts that soften a step, and the matrix of their softening.

        ``(4/dt^2)(M + M_p) - (K + K_p)`` is positive definite for every set of closed contacts where the largest
        eigenvalue of the matrix is below 1. None where the step is unstable without contact.

        Parameters
        ----------
        dt
            Time step.
        stiffness, inertia : (P,) arrays
            eps_s and eps_m of the contacts evaluated at the current state, 0 for the others.
        """
        excess = stiffness - 4.0 * inertia / dt**2
        harmful = np.flatnonzero(excess > 0)
        proved = vars(self).get("highest_eigenvalue", math.inf) * (1.0 + WELL_BELOW)
        if harmful.size == 0 and 4.0 / dt**2 > proved:
            return harmful, np.zeros((0, 0))  # a factor has proved a longer step
        solve = self.factor(4.0 / dt**2)
        if solve is None:
            return None
        if harmful.size == 0:
            return harmful, np.zeros((0, 0))
        root = diags_array(np.sqrt(excess[harmful]))
        return harmful, root @ self.compliance(solve, harmful) @ root


def _reach(*matrices: Any) -> int:
    """Return how far from the diagonal compressed sparse matrices have entries."""
    rows = [np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr)) for matrix in matrices]
    return max(int(np.abs(row - each.indices).max(initial=0)) for row, each in zip(rows, matrices, strict=True))


def largest_eigenvalue(matrix: Any) -> float:
    """Return the largest eigenvalue of a symmetric matrix, 0 of an empty one.

    A contact is coupled to those on the same bodies only, so that a suitable order of the contacts gives a large matrix
    few diagonals.
    """
    size = matrix.shape[0]
    if not size:
        return 0.0
    matrix = csr_array(matrix)
    if size <= SMALL_MATRIX:
        return float(np.linalg.eigvalsh(matrix.toarray())[-1])
    last = (size - 1, size - 1)
    ordered = submatrix(matrix, reverse_cuthill_mckee(matrix, symmetric_mode=True))
    if _reach(ordered) > size // 8:
        return float(eigh(matrix.toarray(), eigvals_only=True, subset_by_index=last)[0])
    return float(eigvals_banded(as_bands(ordered), lower=True, select="i", select_range=last)[0])


def submatrix(matrix: Any, rows: Any) -> Any:
    """Return the rows and columns `rows` of a sparse matrix."""
    return matrix[rows][:, rows]


def _last_eigenvector(matrix: Any) -> Floats:
    """Return an eigenvector of the largest eigenvalue of a symmetric matrix; of a large one, approximately."""
    size = matrix.shape[0]
    if size <= FULL_EIGENVECTORS:
        return np.linalg.eigh(matrix.toarray())[1][:, -1]
    diagonal = matrix.diagonal()
    try:
        start = np.sqrt(np.abs(diagonal))
        return eigsh(matrix, k=1, which="LA", v0=start, tol=1e-6, **without_chance(eigsh))[1][:, 0]  # type: ignore[no-any-return]
    except ArpackNoConvergence:
        return diagonal  # type: ignore[no-any-return]


def limiting_rows(matrix: Any) -> list[int]:
    """Return a small set of rows of a symmetric matrix whose submatrix has an eigenvalue of 1 or more.

    The rows with the largest components in the last eigenvector come first, the fewest of them that suffice; of up to
    `MOST_TRIED_CONTACTS` rows, each that can be left out is then left out.
    """
    matrix = csr_array(matrix)

    def unstable(rows: Sequence[int]) -> bool:
        return largest_eigenvalue(submatrix(matrix, rows)) >= 1.0

    component = np.abs(_last_eigenvector(matrix))
    order = [int(row) for row in np.argsort(-component, kind="stable")]
    lo, hi = 0, len(order)  # The first `hi` rows are unstable, the first `lo` rows are not.
    while hi - lo > 1:
        middle = (lo + hi) // 2
        lo, hi = (lo, middle) if unstable(order[:middle]) else (middle, hi)
    kept = order[:hi]
    for row in order[:hi][::-1] if hi <= MOST_TRIED_CONTACTS else ():
        rest = [other for other in kept if other != row]
        kept = rest if unstable(rest) else kept
    return sorted(kept)
