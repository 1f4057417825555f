"""The three-node bar element."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from percuss import BodyMesh, CellElement
from percuss_methods.elements._straight_cell import StraightRule, axial_forces, straight_rule

if TYPE_CHECKING:
    from percuss import Floats

GAUSS = 0.5 / np.sqrt(3.0)  # distance of both points of Gauss' rule from the middle of a cell of length 1


@dataclass(frozen=True)
class QuadraticBarElement(CellElement):
    """Three-node bar: quadratic displacement along a straight axis, small displacements.

    Formula: nodes at 0, h and h/2; ``strain = sum of N_a' . u_a`` at the two points of Gauss' rule,
    ``force_a = -sum over points of A h/2 stress(strain) N_a'``; the lumped mass is the row sums of the consistent one,
    which are Simpson's rule: ``m/6`` at the ends, ``4 m/6`` in the middle.

    Harmonics of wave number k in a uniform bar, with ``W = (omega h / c)^2`` and ``s = sin^2(k h / 2)``, obey
    ``W^2 - (24 - 4 s) W + 96 s = 0``: an acoustic and an optical branch, the first with an error of its frequency of
    order ``(k h)^4``. The highest frequency is ``sqrt(24) c / h``, that of a single element, so that central difference
    is stable up to ``c dt / h = 1 / sqrt(6)``, a Courant number of 1 by that frequency.
    """

    name = "quadratic-bar"
    summary = "Three-node bar, quadratic displacement"
    linear = True
    force = staticmethod(axial_forces)
    cell = "line3"
    references = (
        "Cohen: Higher-Order Numerical Methods for Transient Wave Equations, Springer 2002, "
        "doi 10.1007/978-3-662-04823-8",
        "Hughes: The Finite Element Method, Dover 2000, ch. 3 and 7",
    )

    def rule(self) -> StraightRule:
        """Return the slopes of the shape functions at the points of Gauss' rule."""
        return straight_rule(self.reference_nodes(), np.array([0.5 - GAUSS, 0.5 + GAUSS]), np.full(2, 0.5))

    def reference_nodes(self) -> Floats:
        """Return the ends and the middle."""
        return np.array([0.0, 1.0, 0.5])

    def mass_shares(self, body: BodyMesh) -> Floats:  # noqa: ARG002
        """Return the row sums of the consistent mass."""
        return np.array([1.0, 1.0, 4.0]) / 6.0

    def volumes(self, body: BodyMesh) -> Floats:
        """Return half of the volume for each of the two points."""
        return np.outer(body.section * body.mesh.lengths, [0.5, 0.5])

    def highest_frequency(self, body: BodyMesh, wave_speed: float) -> Floats:
        """Return sqrt(24) c / h."""
        return np.sqrt(24.0) * wave_speed / body.mesh.lengths
