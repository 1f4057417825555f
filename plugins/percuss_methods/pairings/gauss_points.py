"""Contact points by Gauss' rule."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import REFERENCE_CELLS, Doc, Ge, Le, PairedPoints, Pairing, Places, Unit
from percuss_methods.pairings._closest import paired

if TYPE_CHECKING:
    from percuss import Floats, Surface, Wall


@dataclass(frozen=True)
class GaussPoints(Pairing):
    """Gauss points on each facet of the first surface, against the nearest facet of the second one.

    Formula: ``g = n . (x - y)`` with x the point, y the nearest point of the second surface and n its normal out of
    the facet on which y lies, at a corner or an edge between facets the direction of x - y; ``w = area of the facet
    times the weight of the rule``. A quadrilateral has the products of two rules of Gauss; a triangle three points
    for 2, and conical products for any other number.

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

    points_on_facet: Annotated[int, Ge(1), Le(10), Unit("1"), Doc("points along each facet, in each direction")] = 2

    def points(self, first: Surface, second: Surface | Wall) -> PairedPoints:
        """Return the Gauss points that have a partner."""
        return paired(first, second, *self.places(first, second))

    def places(self, first: Surface, second: Surface | Wall) -> Places:  # noqa: ARG002
        """Return the Gauss points."""
        of_facet, weight = rule(first.facets.shape[1], self.points_on_facet)
        count = len(first.facets)
        shares, facets = np.tile(of_facet, (count, 1)), np.repeat(np.arange(count), weight.size)
        return Places(facets, shares, first.spread(facets, shares) * np.tile(weight, count))


def rule(corners: int, along: int) -> tuple[Floats, Floats]:
    """Return the shape functions at the points of a facet, (points, corners), and the share of each in its area."""
    place, weight = np.polynomial.legendre.leggauss(along)
    on_edge, weight = 0.5 * np.stack([1.0 - place, 1.0 + place], axis=1), 0.5 * weight
    if corners == 2:
        return on_edge, weight
    if corners == 4:  # the product of two rules
        places = np.stack([np.repeat(place, along), np.tile(place, along)], axis=1)
        shares, _ = REFERENCE_CELLS["quad"].shape_functions(places)
        return shares, np.outer(weight, weight).ravel()
    if along == 2:
        return np.full((3, 3), 1.0 / 6.0) + 0.5 * np.eye(3), np.full(3, 1.0 / 3.0)
    from scipy.special import roots_jacobi

    # A square with a side drawn together to a corner, where Jacobi's rule takes its area into account.
    radial, share = roots_jacobi(along, 1.0, 0.0)
    far = np.repeat(0.5 * (1.0 + radial), along)
    shares = np.concatenate([far[:, None], (1.0 - far)[:, None] * np.tile(on_edge, (along, 1))], axis=1)
    return shares, np.outer(0.5 * share, weight).ravel()
