"""Contact points at nodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from percuss import PairedPoints, Pairing, Places
from percuss_methods.pairings._closest import areas_of_nodes, paired

if TYPE_CHECKING:
    from percuss import Surface, Wall


@dataclass(frozen=True)
class NodeToSegment(Pairing):
    """The nodes of the first surface against the nearest facet of the second one.

    Formula: ``g = n . (x - y)`` with x the node, y the nearest point of the second surface and n its normal out of
    the facet on which y lies, at a corner or an edge between facets the direction of x - y; w is half of the area of
    each facet of the first surface at the node. At the rim of the second surface only those facets count that lie
    over it.

    A uniform pressure between meshes that do not match is not transmitted: its error stays however fine they are.
    """

    name = "node-to-segment"
    summary = "Nodes of the first surface against the nearest facets of the second"
    references = (
        "Hallquist, Goudreau, Benson: Sliding interfaces with contact-impact in large-scale Lagrangian computations, "
        "Comput. Methods Appl. Mech. Engrg. 51 (1985), doi 10.1016/0045-7825(85)90030-1",
    )

    def points(self, first: Surface, second: Surface | Wall) -> PairedPoints:
        """Return the nodes that have a partner."""
        return paired(first, second, *self.places(first, second))

    def places(self, first: Surface, second: Surface | Wall) -> Places:
        """Return the nodes."""
        width = first.facets.shape[1]
        facets, places = np.zeros((2, len(first.nodes)), dtype=np.int64)
        for place in range(width):  # any facet at a node serves
            facets[first.facets[:, place]], places[first.facets[:, place]] = np.arange(len(first.facets)), place
        return Places(facets, np.eye(width)[places], areas_of_nodes(first, second))
