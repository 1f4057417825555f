"""The largest contact stiffness for which central difference is stable, of bodies that are no bars."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from percuss.contact.contact_point import gap_rows
from percuss.contact.stiffness_limits import LARGEST_COURANT

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from percuss.contact.contact_point import ContactPoint
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats


def surface_limits(bodies: Iterable[Body], points: Sequence[ContactPoint], dt: float) -> Floats:
    """Return `ContactPoints.stiffness_limit` of all contact points for a time step `dt`, (P,) [force/length].

    With B = (4/dt^2) M - K of all bodies without supports, closed contacts of the stiffness D are stable where
    ``B - N D N^T`` is positive semi-definite: where the largest eigenvalue of ``D^1/2 N^T B^-1 N D^1/2`` is at most 1.
    The limits are in proportion to the stiffness of the points, ``M w/h``, so that they hold for all sets of points.
    """
    from scipy.linalg import eigh
    from scipy.sparse import block_diag, csc_array, diags_array
    from scipy.sparse.linalg import eigsh, splu

    bodies = list(bodies)
    dim = bodies[0].mesh.nodes.shape[1]
    stiffness = csc_array(block_diag([body.stiffness_matrix() for body in bodies]))
    mass = diags_array(np.repeat(np.concatenate([body.mass for body in bodies]), dim))
    root = diags_array(1.0 / np.sqrt(mass.diagonal()))
    start = np.random.default_rng(0).standard_normal(stiffness.shape[0])
    highest = float(eigsh(root @ stiffness @ root, 1, which="LA", v0=start, return_eigenvectors=False)[0])
    step = min(dt, LARGEST_COURANT * 2.0 / np.sqrt(highest))
    rows = gap_rows(points, stiffness.shape[0], dim)
    compliance = rows.T @ splu(csc_array(4.0 / step**2 * mass - stiffness)).solve(rows.toarray())
    scale = np.array([point.stiffness for point in points])
    weighted = np.sqrt(scale)[:, None] * compliance * np.sqrt(scale)
    last = len(points) - 1
    largest = float(eigh(0.5 * (weighted + weighted.T), eigvals_only=True, subset_by_index=(last, last))[0])
    limits: Floats = scale / largest
    return limits
