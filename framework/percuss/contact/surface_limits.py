"""The largest contact stiffness for which central difference is stable, of bodies that are no bars."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from percuss.contact.contact_point import gap_rows
from percuss.contact.stiffness_limits import LARGEST_COURANT
from percuss.mesh.eigenvalues import highest_ritz_value

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence

    from percuss.contact.contact_point import ContactPoint
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats


class SurfaceLimits:
    """The `ContactPoints.stiffness_limit` of all contact points of bodies that are no bars, for any time step.

    With B = (4/dt^2) M - K of all bodies without supports, closed contacts of the stiffness D are stable where
    ``B - N D N^T`` is positive semi-definite: where the largest eigenvalue of ``D^1/2 N^T B^-1 N D^1/2`` is at most 1.
    The limits are in proportion to the stiffness of the points, ``M w/h``, so that they hold for all sets of points.

    Parameters
    ----------
    bodies, points
        Bodies and contact points of a model.
    moved
        Nodes of each contact point that its force moves at some time of the run; the others are fixed or driven.
    """

    def __init__(
        self, bodies: Iterable[Body], points: Sequence[ContactPoint], moved: Sequence[Collection[int]]
    ) -> None:
        from scipy.sparse import block_diag, csc_array, diags_array

        bodies = list(bodies)
        dim = bodies[0].mesh.nodes.shape[1]
        self._stiffness = csc_array(block_diag([body.stiffness_matrix() for body in bodies]))
        self._mass = diags_array(np.repeat(np.concatenate([body.mass for body in bodies]), dim))
        highest = highest_ritz_value(self._stiffness, self._mass)
        self._longest_step = LARGEST_COURANT * 2.0 / np.sqrt(highest)
        moves = np.isin(np.arange(self._stiffness.shape[0]) // dim, [node for nodes in moved for node in nodes])
        self._rows = diags_array(moves.astype(float)) @ gap_rows(points, self._stiffness.shape[0], dim)
        self._scale = np.array([point.stiffness for point in points])

    def at(self, dt: float) -> Floats:
        """Return the limits for a time step `dt`, (P,) [force/length]."""
        from scipy.linalg import eigh
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        step = min(dt, self._longest_step)
        matrix = csc_array(4.0 / step**2 * self._mass - self._stiffness)
        compliance = self._rows.T @ splu(matrix).solve(self._rows.toarray())
        weighted = np.sqrt(self._scale)[:, None] * compliance * np.sqrt(self._scale)
        last = len(self._scale) - 1
        largest = float(eigh(0.5 * (weighted + weighted.T), eigvals_only=True, subset_by_index=(last, last))[0])
        limits: Floats = self._scale / largest
        return limits
