"""Stability of the closed linear step from the rows of the laws: matrices of the bars, never a dense one.

Bars stretch along their axes only, so their stiffness is one symmetric tridiagonal matrix a body, in the axial
displacements of its nodes. Central difference is stable at a step dt where ``(4/dt^2)(M + M_p) - (K + K_p)`` is
positive definite, by Sylvester's law of inertia for the worst combination of closed contacts: exactly those whose
``4 eps_m / dt^2 - eps_s`` is negative. Bodies are factorised by themselves, and the contacts enter by the small matrix
``N^T ((4/dt^2) M - K)^-1 N``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats
    from percuss.solver.model import Model

EDGE = 1e-9  # margins this close to the limit are marginal
STEPS_OF_SEARCH = 60
FEW = 24  # contacts, of which each is tried whether it can be left out


class Pencil:
    """Mass and stiffness of the bodies of a model along their axes, and how contacts join them.

    Parameters
    ----------
    model
        A stretch of a run (`percuss.solver.model.Model.stretches`); of a whole run, a drive that is off at any time
        counts as absent.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        end = model.steps * model.dt
        self.constraints = [
            h for h in model.constraints if h.load is None or (h.load.start <= 0 and h.load.stop >= end)
        ]
        held: dict[int, list[Floats]] = {}
        for hold in self.constraints:
            held.setdefault(hold.node, []).append(hold.direction)
        self.held = held
        self.bodies: list[tuple[int, Floats, Floats, Floats]] = []  # first free node, masses, diagonal, off-diagonal
        for body in model.bodies.values():
            diagonal = np.zeros(body.mass.size)
            diagonal[:-1] += body.stiffness
            diagonal[1:] += body.stiffness
            axis = body.mesh.direction
            free = [self._free(held.get(node, []), axis) for node in (body.start, body.stop - 1)]
            lo, hi = int(not free[0]), body.mass.size - int(not free[1])
            if hi > lo:
                self.bodies.append((body.start + lo, body.mass[lo:hi], diagonal[lo:hi], -body.stiffness[lo : hi - 1]))

    @staticmethod
    def _free(directions: list[Floats], axis: Floats) -> bool:
        return all(abs(float(direction @ axis)) < 1e-9 for direction in directions)

    def factors(self, dt: float) -> list[Any] | None:
        """Return banded Cholesky factors of ``(4/dt^2) M - K`` of each body, or None where one is not definite."""
        from scipy.linalg import LinAlgError, cholesky_banded

        out = []
        for _, mass, diagonal, off in self.bodies:
            banded = np.zeros((2, mass.size))
            banded[0, 1:] = -off
            banded[1] = 4.0 / dt**2 * mass - diagonal
            try:
                out.append(cholesky_banded(banded, check_finite=False))
            except LinAlgError:
                return None
        return out

    def normals(self, first: int, count: int) -> Floats:
        """Return N of all contacts along the axis of a body, at `count` of its nodes from `first` on, (count, P)."""
        columns = np.zeros((count, len(self.model.contact_pairs)))
        for p, contact_pair in enumerate(self.model.contact_pairs):
            for node, normal in contact_pair.rows():
                if first <= node < first + count:
                    columns[node - first, p] += float(normal @ self.model.body_of(node).mesh.direction)
        return columns

    def compliance(self, factors: list[Any]) -> Floats:
        """Return ``N^T ((4/dt^2) M - K)^-1 N``, (P, P)."""
        from scipy.linalg import cho_solve_banded

        contact_pairs = self.model.contact_pairs
        out = np.zeros((len(contact_pairs), len(contact_pairs)))
        for (first, mass, _, _), factor in zip(self.bodies, factors, strict=True):
            columns = self.normals(first, mass.size)
            touched = np.flatnonzero(columns.any(axis=0))
            if touched.size:
                solved = cho_solve_banded((factor, False), columns[:, touched], check_finite=False)
                out[np.ix_(touched, touched)] += columns[:, touched].T @ solved
        return out

    def definite(
        self, dt: float, stiffness: Floats, inertia: Floats, tied: Sequence[int] = ()
    ) -> tuple[bool, list[int]]:
        """Return whether ``(4/dt^2)(M + M_p) - (K + K_p)`` is definite in every combination of closed contacts.

        The worst combination closes exactly the contacts with ``eps_s > 4 eps_m / dt^2``.

        Parameters
        ----------
        dt
            Time step.
        stiffness, inertia : (P,) arrays
            eps_s and eps_m of the contacts judged at the current state, 0 for the others.
        tied
            Contacts whose gap never changes: only motions that leave it are looked at.

        Returns
        -------
        definite
            Whether it is.
        limiting
            Contacts that suffice to make it indefinite while they are closed, none of which can be left out if they
            are few; empty where it is definite, or indefinite without contact.
        """
        factors = self.factors(dt)
        if factors is None:
            return False, []
        excess = stiffness - 4.0 * inertia / dt**2
        harmful = np.flatnonzero(excess > 0)
        if harmful.size == 0:
            return True, []
        root = np.sqrt(excess[harmful])
        compliance = self.compliance(factors)
        if len(tied):
            tie = list(tied)
            held = np.linalg.pinv(compliance[np.ix_(tie, tie)], rcond=1e-12, hermitian=True)
            compliance = compliance - compliance[:, tie] @ held @ compliance[tie]
        small = root[:, None] * compliance[np.ix_(harmful, harmful)] * root
        if np.linalg.eigvalsh(small)[-1] < 1.0:
            return True, []
        return False, [int(p) for p in harmful[_limiting(small)]]


def _limiting(matrix: Floats) -> list[int]:
    """Return rows of a symmetric matrix whose own submatrix has an eigenvalue of 1 or more, as few as are found."""

    def unstable(rows: list[int]) -> bool:
        return bool(rows) and bool(np.linalg.eigvalsh(matrix[np.ix_(rows, rows)])[-1] >= 1.0)

    part = np.abs(np.linalg.eigh(matrix)[1][:, -1])
    order = [int(row) for row in np.argsort(-part, kind="stable")]
    lo, hi = 0, len(order)  # the first hi rows are unstable, the first lo are not
    while hi - lo > 1:
        middle = (lo + hi) // 2
        lo, hi = (lo, middle) if unstable(order[:middle]) else (middle, hi)
    kept = order[:hi]
    for row in kept[::-1] if hi <= FEW else ():
        rest = [other for other in kept if other != row]
        if unstable(rest):
            kept = rest
    return sorted(kept)


def critical_step(stable: Callable[[float], bool], free: float) -> float:
    """Return the largest step up to which `stable` is true; that is `free` where contact does not lower it."""
    return free if stable(free * (1.0 - 0.1 * EDGE)) else largest(stable, free)


def largest(holds: Callable[[float], bool], start: float, tolerance: float = 1e-11) -> float:
    """Return the largest step, within a relative `tolerance`, up to which `holds` is true, searching from `start`."""
    lo = hi = start
    while not holds(lo):
        hi, lo = lo, 0.5 * lo
        if lo < 1e-12 * start:
            return 0.0
    while hi == lo or holds(hi):
        lo, hi = hi, 2.0 * hi
        if hi > 1e3 * start:
            return np.inf
        if lo == start and not holds(hi):
            break
    for _ in range(STEPS_OF_SEARCH):
        middle = 0.5 * (lo + hi)
        if middle in (lo, hi) or hi - lo < tolerance * hi:
            break
        if holds(middle):
            lo = middle
        else:
            hi = middle
    return lo
