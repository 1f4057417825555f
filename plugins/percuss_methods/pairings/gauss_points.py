"""Contact points by Gauss' rule."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import Doc, Ge, Le, PairedPoints, Pairing, Unit
from percuss_methods.pairings._closest import paired

if TYPE_CHECKING:
    from percuss import Surface, Wall


@dataclass(frozen=True)
class GaussPoints(Pairing):
    """Gauss points on each facet of the first surface, against the nearest facet of the second one.

    Formula: ``g = n . (x - y)`` with x the point, y the nearest point of the second surface and n its normal out of the
    facet on which y lies; ``w = area of the facet times the weight of the rule``.

    A uniform pressure between meshes that do not match is transmitted with an error that falls with the number of
    points. There are more points than nodes: a law without compliance gives the right motion and single forces without
    meaning, so percuss refuses it.
    """

    name = "gauss-points"
    summary = "Gauss points of the first surface against the nearest facets of the second"
    references = ("Fischer, Wriggers: Frictionless 2D contact formulations for finite deformations based on the mortar "
                  "method, Comput. Mech. 36 (2005), doi 10.1007/s00466-005-0660-y",)  # fmt: skip
    examples = ({}, {"points_on_facet": 4})
    shorthand = "points_on_facet"
    more_points_than_nodes = True

    points_on_facet: Annotated[int, Ge(1), Le(10), Unit("1"), Doc("points along each facet")] = 2

    def points(self, first: Surface, second: Surface | Wall) -> PairedPoints:
        """Return the Gauss points that have a partner."""
        place, weight = np.polynomial.legendre.leggauss(self.points_on_facet)
        edges, count = len(first.facets), self.points_on_facet
        shares = np.tile(0.5 * np.stack([1.0 - place, 1.0 + place], axis=1), (edges, 1))
        facets = np.repeat(np.arange(edges), count)
        return paired(first, second, facets, shares, first.spread(facets, shares) * np.tile(0.5 * weight, edges))
