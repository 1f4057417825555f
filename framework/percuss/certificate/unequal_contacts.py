"""Amplification matrix of the closed step from the linear laws, for contacts that share an end with unequal w.

With laws evaluated at the gap of the predictor ``u* = 2 u_n - u_{n-1} - dt^2 M^-1 K u_n``, or at the end of the step,
the closed step is ``u_{n+1} = Q u*``, ``Q = I - dt^2 M^-1 N (diag(sigma) + diag(w) S)^-1 N^T``. Here w is eps_m / eps_s
for the predicted gap and dt^2 for the end of the step. Where contacts that share an end have different w, Q is not
symmetric with respect to the mass matrix and theta does not decide whether the step grows; the eigenvalues of the
amplification matrix of (u_n, u_{n-1}) do.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from percuss.certificate.pencil import MARGINAL_DISTANCE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from percuss.certificate.closed_contacts import ClosedContacts
    from percuss.certificate.pencil import Pencil

# Growth in a step below which it cannot be told from rounding with certainty.
GROWTH_RESOLUTION = 1e-7
# Largest `work` for which a step is examined, to bound the time.
MOST_WORK = 1e8


class ClosedMatrix:
    """Closed step of bars along their axes, with dense matrices.

    Parameters
    ----------
    pencil
        Masses and stiffness of a stretch of the run.
    """

    def __init__(self, pencil: Pencil) -> None:
        from scipy.linalg import block_diag

        bodies = pencil.bodies
        sizes = [body.mass.size for body in bodies]
        self.size = sum(sizes)
        root = block_diag(*(body.mass_root() for body in bodies))  # L of M^-1 = L L^T takes the place of M^-1/2
        self.scaled = root.T @ block_diag(*(body.full() for body in bodies)) @ root
        self.normal = root.T @ np.concatenate([pencil.normals(body.first, body.mass.size) for body in bodies])
        # A body with all its nodes free moves rigidly.
        free = [size == pencil.model.body_of(body.first).mass.size for body, size in zip(bodies, sizes, strict=True)]
        motions = np.linalg.solve(root, block_diag(*(np.ones((size, 1)) for size in sizes))[:, free])
        self.rigid = motions / np.linalg.norm(motions, axis=0)

    def radius(self, dt: float, laws: ClosedContacts, closed: Sequence[int]) -> float:
        """Return the largest modulus of the eigenvalues of the step, leaving out motions without strain.

        Parameters
        ----------
        dt
            Time step.
        laws
            The closed contacts at this step, as their linear laws describe them.
        closed
            Numbers of the closed contacts.
        """
        indices = list(closed)
        normal = self.normal[:, indices]
        weight = laws.surplus[indices] + dt * dt
        left = np.diag(laws.compliance[indices]) + weight[:, None] * (normal.T @ normal)
        back = np.eye(self.size) - dt * dt * normal @ np.linalg.lstsq(left, normal.T, rcond=None)[0]
        n = self.size
        matrix = np.zeros((2 * n, 2 * n))
        matrix[:n, :n] = back @ (2.0 * np.eye(n) - dt * dt * self.scaled)
        matrix[:n, n:] = -back
        matrix[n:, :n] = np.eye(n)
        felt = normal.T @ self.rigid
        idle = self.rigid
        if felt.size:
            _, size, right = np.linalg.svd(felt)
            idle = self.rigid @ right[int((size > 1e-9 * size.max(initial=0.0)).sum()) :].T
        keep = np.kron(np.eye(2), idle)
        matrix -= keep @ (keep.T @ matrix)
        matrix -= (matrix @ keep) @ keep.T
        return float(np.abs(np.linalg.eigvals(matrix)).max(initial=0.0))

    def worst(self, dt: float, laws: ClosedContacts, sets: Sequence[Sequence[int]]) -> tuple[bool | None, list[int]]:
        """Return whether the step is stable for all given sets of closed contacts, and the first set where it is not.

        None in place of a truth value means that growth is so slow there that it may be rounding.
        """
        doubtful: list[int] | None = None
        for closed in sets:
            radius = self.radius(dt, laws, closed)
            if radius > 1.0 + GROWTH_RESOLUTION:
                return False, list(closed)
            if radius > 1.0 + MARGINAL_DISTANCE and doubtful is None:
                doubtful = list(closed)
        return (True, []) if doubtful is None else (None, doubtful)


def work(pencil: Pencil, count: int) -> float:
    """Return the work of examining a step: `count` sets of closed contacts times the cube of the matrix size."""
    return float(count) * (2.0 * sum(body.mass.size for body in pencil.bodies)) ** 3


def unequal_sets(
    groups: Sequence[Sequence[int]], laws: ClosedContacts, tied: Sequence[int]
) -> Iterator[tuple[int, ...]]:
    """Yield the sets of closed contacts in which two contacts of one group differ in `surplus`, smallest sets first.

    Tied contacts are closed in each set.
    """
    candidates = [p for p in range(laws.surplus.size) if not np.isnan(laws.surplus[p])]
    free = [p for p in candidates if p not in tied]
    for count in range(len(free) + 1):
        for chosen in itertools.combinations(free, count):
            closed = sorted({*chosen, *tied})
            if any(np.ptp(laws.surplus[[p for p in group if p in closed] or [group[0]]]) > 0.0 for group in groups):
                yield tuple(closed)
