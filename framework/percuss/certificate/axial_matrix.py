"""Mass and stiffness of one body along its axis, as banded matrices.

Two-node elements make tridiagonal matrices, for which LAPACK has routines of their own; elements of more nodes make
matrices of more diagonals.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.lapack import lapack
from percuss.mesh.banded_matrices import highest_eigenvalue, times

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats


class AxialMatrix(NamedTuple):
    """Mass and stiffness of the free nodes of a body.

    Attributes
    ----------
    first
        Its first free node in the model.
    mass : (n,) array
        Masses.
    diagonal : (n,) array
        Diagonal of the stiffness.
    off : (n - 1,) array or (k, n) array
        What stands beside it, as `percuss.mesh.body.Body.axial_band` has it.
    coupled : (2, b, n) array
        Bands of M^-1 and of ``M^-1 K M^-1`` where the mass couples nodes (`percuss.mesh.banded_matrices`), in the
        place of `mass`; (2, 0, n) where it is diagonal.
    """

    first: int
    mass: Floats
    diagonal: Floats
    off: Floats
    coupled: Floats

    @property
    def tridiagonal(self) -> bool:
        """Whether the matrices are one with one diagonal beside the main one, and a diagonal one."""
        return self.off.ndim == 1 and not self.coupled.size

    def full(self) -> Floats:
        """Return the stiffness, (n, n)."""
        size = self.mass.size
        stiffness = np.diag(self.diagonal)
        for k, off in enumerate([self.off] if self.off.ndim == 1 else self.off, start=1):
            rows = np.arange(size - k)
            stiffness[rows, rows + k] = stiffness[rows + k, rows] = off[: size - k]
        return stiffness

    def mass_root(self) -> Floats:
        """Return a matrix L with ``M^-1 = L L^T``, (n, n)."""
        if not self.coupled.size:
            return np.diag(1.0 / np.sqrt(self.mass))
        root = np.linalg.cholesky(times(self.coupled[0], np.eye(self.mass.size)))
        return np.asarray(root, dtype=np.float64)

    def factor(self, scale: float) -> Any:
        """Return a factor of ``scale M - K``, None unless that is positive definite.

        Where the mass couples nodes it is that of ``M^-1 (scale M - K) M^-1``, of which the same holds.
        """
        if self.coupled.size:
            inverse, stiffness = self.coupled
            factor, failed = lapack().dpbtrf(scale * inverse - stiffness, lower=1)
            return None if failed else factor
        if self.tridiagonal:
            *factor, failed = lapack().dpttrf(
                scale * self.mass - self.diagonal, -self.off if self.off.size else np.zeros(1)
            )
            return None if failed else tuple(factor)
        band = np.concatenate([(scale * self.mass - self.diagonal)[None], -self.off])
        factor, failed = lapack().dpbtrf(band, lower=1)
        return None if failed else factor

    def solve(self, factor: Any, columns: Floats) -> Floats:
        """Return ``(scale M - K)^-1`` times (n, m) columns, from the `factor`."""
        if self.coupled.size:
            inverse = self.coupled[0]
            return times(inverse, lapack().dpbtrs(factor, times(inverse, columns), lower=1)[0])
        if self.tridiagonal:
            return lapack().dpttrs(*factor, columns)[0]  # type: ignore[no-any-return]
        return lapack().dpbtrs(factor, columns, lower=1)[0]  # type: ignore[no-any-return]

    def highest_eigenvalue(self) -> float:
        """Return the largest eigenvalue of ``M^-1 K`` [1/time^2]."""
        if not self.tridiagonal:
            return self._by_bisection()
        root = 1.0 / np.sqrt(self.mass)
        size = self.mass.size
        squared = self.diagonal * root**2
        scale = float(squared.max()) or 1.0  # LAPACK does not scale, and units may be of any size
        if size == 1:
            values = squared / scale
        else:
            beside = self.off * root[:-1] * root[1:] / scale
            count, values, *_, failed = lapack().dstebz(
                squared / scale, beside, 2, 0.0, 1.0, size, size, 0.0, "E"
            )  # 2: eigenvalues by their numbers
            if failed or count != 1:
                raise np.linalg.LinAlgError(f"LAPACK's dstebz failed with {failed} on {size} rows")
        return scale * float(values[0])

    def _by_bisection(self) -> float:
        """Return the smallest number s for which ``s M - K`` is positive definite."""
        diagonal = self.diagonal / self.mass
        if self.coupled.size:
            inverse, stiffness = self.coupled
            diagonal = stiffness[0] / inverse[0]
        # The quotient of stiffness and mass of a single direction is no larger than the eigenvalue.
        return highest_eigenvalue(float(diagonal.max()), lambda scale: self.factor(scale) is not None)

    def highest_mode(self) -> tuple[float, Floats]:
        """Return the largest eigenvalue of ``M^-1 K`` [1/time^2] and its mode, scaled to the masses."""
        from scipy.linalg import eig_banded, eigh_tridiagonal

        top, root = self.mass.size - 1, np.sqrt(self.mass)
        if self.tridiagonal:
            value, vector = eigh_tridiagonal(
                self.diagonal / self.mass, self.off / (root[:-1] * root[1:]), select="i", select_range=(top, top)
            )
            return float(value[0]), vector
        band = np.zeros((self.off.shape[0] + 1, self.mass.size))
        band[0] = self.diagonal / self.mass
        for k, off in enumerate(self.off, start=1):
            band[k, : self.mass.size - k] = off[: self.mass.size - k] / (root[:-k] * root[k:])
        value, vector = eig_banded(band, lower=True, select="i", select_range=(top, top))
        return float(value[0]), vector
