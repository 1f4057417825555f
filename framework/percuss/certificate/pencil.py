"""Stability of the closed linear step from the linear laws, with banded matrices of the bars and no dense ones.

Bars stretch along their axes only, so the stiffness of each body is one symmetric tridiagonal matrix in the axial
displacements of its nodes. By Sylvester's law of inertia, central difference is stable at a step dt where
``(4/dt^2)(M + M_p) - (K + K_p)`` is positive definite for the worst combination of closed contacts, which closes
exactly the contacts with a negative ``4 eps_m / dt^2 - eps_s``. Each body is factorised by itself, and the contacts
enter through the small matrix ``N^T ((4/dt^2) M - K)^-1 N``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats
    from percuss.solver.model import Model

# Relative distance from the limit within which a step is marginal.
MARGINAL_DISTANCE = 1e-9
MOST_TRIALS = 200  # steps tried in the search for the critical one
SMALLEST_RELATIVE_TOLERANCE = 4.0 * float(np.finfo(float).eps)  # the least that SciPy accepts
# Largest number of contacts of which each is tried whether it can be left out, to bound the time.
MOST_TRIED_CONTACTS = 24


class Pencil:
    """Mass and stiffness of the bodies of a model along their axes, and the contacts that join them.

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
            constraint
            for constraint in model.constraints
            if constraint.load is None or (constraint.load.start <= 0 and constraint.load.stop >= end)
        ]
        held: dict[int, list[Floats]] = {}
        for constraint in self.constraints:
            held.setdefault(constraint.node, []).append(constraint.direction)
        self.held = held
        self.bodies: list[tuple[int, Floats, Floats, Floats]] = []  # first free node, masses, diagonal, off-diagonal
        for body in model.bodies.values():
            diagonal = np.zeros(body.mass.size)
            diagonal[:-1] += body.stiffness
            diagonal[1:] += body.stiffness
            axis = body.mesh.direction
            free = [self._free_along(held.get(node, []), axis) for node in (body.start, body.stop - 1)]
            lo, hi = int(not free[0]), body.mass.size - int(not free[1])
            if hi > lo:
                self.bodies.append((body.start + lo, body.mass[lo:hi], diagonal[lo:hi], -body.stiffness[lo : hi - 1]))

    @staticmethod
    def _free_along(directions: list[Floats], axis: Floats) -> bool:
        return all(abs(float(direction @ axis)) < 1e-9 for direction in directions)

    def factors(self, dt: float) -> list[Any] | None:
        """Return banded Cholesky factors of ``(4/dt^2) M - K`` of each body; None unless all are positive definite."""
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
        """Return N of all contacts along the axis of a body, for `count` of its nodes from `first` on, (count, P)."""
        columns = np.zeros((count, len(self.model.contact_pairs)))
        for p, contact_pair in enumerate(self.model.contact_pairs):
            for node, normal in contact_pair.gap_gradient():
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
        """Return whether ``(4/dt^2)(M + M_p) - (K + K_p)`` is positive definite for every set of closed contacts.

        The worst combination closes exactly the contacts with ``eps_s > 4 eps_m / dt^2``.

        Parameters
        ----------
        dt
            Time step.
        stiffness, inertia : (P,) arrays
            eps_s and eps_m of the contacts evaluated at the current state, 0 for the others.
        tied
            Contacts whose gap never changes; only motions that leave these gaps unchanged count.

        Returns
        -------
        definite
            Whether the matrix is positive definite.
        limiting
            Contacts that suffice to make it indefinite while they are closed; if they are at most
            `MOST_TRIED_CONTACTS`, none can be left out. Empty where the matrix is definite, or indefinite without
            contact.
        """
        harmful, softening = self._softening(dt, stiffness, inertia, tied)
        if softening is None:
            return False, []
        if not harmful.size or np.linalg.eigvalsh(softening)[-1] < 1.0:
            return True, []
        return False, [int(p) for p in harmful[_limiting_rows(softening)]]

    def largest_softening(self, dt: float, stiffness: Floats, inertia: Floats, tied: Sequence[int] = ()) -> float:
        """Return the number that is below 1 where `definite` is true; inf where no contact is needed to make it false.

        It is the largest share of the dynamic stiffness ``(4/dt^2) M - K`` that closed contacts take away, and varies
        continuously with dt.
        """
        harmful, softening = self._softening(dt, stiffness, inertia, tied)
        if softening is None:
            return np.inf
        return float(np.linalg.eigvalsh(softening)[-1]) if harmful.size else 0.0

    def _softening(
        self, dt: float, stiffness: Floats, inertia: Floats, tied: Sequence[int]
    ) -> tuple[Any, Floats | None]:
        """Return the contacts that soften the step, and their softening; None where it is unstable without contact."""
        factors = self.factors(dt)
        if factors is None:
            return np.zeros(0, dtype=np.int64), None
        excess = stiffness - 4.0 * inertia / dt**2
        harmful = np.flatnonzero(excess > 0)
        if harmful.size == 0:
            return harmful, np.zeros((0, 0))
        root = np.sqrt(excess[harmful])
        compliance = self.compliance(factors)
        if len(tied):
            tie = list(tied)
            held = np.linalg.pinv(compliance[np.ix_(tie, tie)], rcond=1e-12, hermitian=True)
            compliance = compliance - compliance[:, tie] @ held @ compliance[tie]
        return harmful, root[:, None] * compliance[np.ix_(harmful, harmful)] * root

    def free_step(self) -> float:
        """Return the largest step that is stable without contact, 2 over the highest frequency of the bodies."""
        from scipy.linalg import eigvalsh_tridiagonal

        highest = 0.0
        for _, mass, diagonal, off in self.bodies:
            root = 1.0 / np.sqrt(mass)
            last = mass.size - 1
            values = eigvalsh_tridiagonal(
                diagonal * root**2, off * root[:-1] * root[1:], select="i", select_range=(last, last)
            )
            highest = max(highest, float(values[0]))
        return 2.0 / math.sqrt(highest) if highest > 0.0 else math.inf


def _limiting_rows(matrix: Floats) -> list[int]:
    """Return a small set of rows of a symmetric matrix whose submatrix has an eigenvalue of 1 or more.

    The rows with the largest components in the last eigenvector come first, the fewest of them that suffice; of up to
    `MOST_TRIED_CONTACTS` rows, each that can be left out is then left out.
    """

    def unstable(rows: list[int]) -> bool:
        return bool(rows) and bool(np.linalg.eigvalsh(matrix[np.ix_(rows, rows)])[-1] >= 1.0)

    component = np.abs(np.linalg.eigh(matrix)[1][:, -1])
    order = [int(row) for row in np.argsort(-component, kind="stable")]
    lo, hi = 0, len(order)  # The first `hi` rows are unstable, the first `lo` rows are not.
    while hi - lo > 1:
        middle = (lo + hi) // 2
        lo, hi = (lo, middle) if unstable(order[:middle]) else (middle, hi)
    kept = order[:hi]
    for row in kept[::-1] if hi <= MOST_TRIED_CONTACTS else ():
        rest = [other for other in kept if other != row]
        if unstable(rest):
            kept = rest
    return sorted(kept)


def largest_step_below(excess: Callable[[float], float], free: float) -> float:
    """Return the largest stable step, `free` where contact does not lower it; `excess` is that of `largest_step`."""
    return free if excess(free * (1.0 - 0.1 * MARGINAL_DISTANCE)) <= 0.0 else largest_step(excess, free)


def largest_step(excess: Callable[[float], float], start: float, tolerance: float = 1e-11) -> float:
    """Return the largest step, within a relative `tolerance`, up to which steps are stable, searching from `start`.

    Parameters
    ----------
    excess
        A number at most 0 where a step is stable, and above 0 where it is not, between -1 and 1. Where it varies
        continuously with the step a few trials suffice; where it is only -1 or 1 each trial halves the bracket.
    start
        Step at which the search begins.
    tolerance
        Relative distance from the limit within which the returned step lies. It is stable itself.
    """
    from scipy.optimize import brentq

    trials: dict[float, float] = {}

    def tried(dt: float) -> float:
        if dt not in trials:
            trials[dt] = excess(dt)
        return trials[dt]

    lo = hi = start
    while tried(lo) > 0.0:
        hi, lo = lo, 0.5 * lo
        if lo < 1e-12 * start:
            return 0.0
    while tried(hi) <= 0.0:
        lo, hi = hi, 2.0 * hi
        if hi > 1e3 * start:
            return math.inf
    distance = 0.25 * tolerance * lo
    root = float(brentq(tried, lo, hi, xtol=distance, rtol=SMALLEST_RELATIVE_TOLERANCE, maxiter=MOST_TRIALS))
    unstable = min(dt for dt, value in trials.items() if value > 0.0)
    stable = max(dt for dt, value in trials.items() if value <= 0.0 and dt < unstable)
    below = root - 2.0 * distance
    # The limit may have been approached from above alone.
    return below if stable < below and tried(below) <= 0.0 else stable
