"""Places where the mesh of a solid is not joined: pieces, facets that lie on each other, and hanging nodes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from percuss.mesh.cells import cells_of, pieces_of
from percuss.methods.interfaces.nearest import places_on

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integers, Mesh

NOWHERE = np.zeros(0, dtype=np.int64)
ON_FACET = 1e-6  # distance from a facet over its size, below which a node lies on it


def seams(mesh: Mesh) -> Iterator[str]:
    """Yield in words where a mesh is not joined, though its cells touch or belong to one body."""
    cells, piece = cells_of(mesh), pieces_of(mesh)
    counts = np.bincount(piece)
    if counts.size > 1:
        least = int(counts.argmin())
        middle = mesh.nodes[cells[piece == least]].mean(axis=(0, 1))
        yield (
            f"is in {counts.size} pieces without a common node, which move each for itself: the smallest has "
            f"{counts[least]} of {len(cells)} cells, about {in_brackets(middle)}"
        )
    facets = [np.asarray(of_kind) for region in mesh.regions.values() for of_kind in region.facets.values()]
    doubled, hanging = _on_other_facets(mesh.nodes, np.concatenate(facets)) if facets else (NOWHERE, NOWHERE)
    opens = "the mesh is not joined there and opens as a crack does"
    if doubled.size:
        yield (
            f"has facets that lie on each other, with nodes ({doubled.size}) at the same places: the first is at "
            f"{in_brackets(mesh.nodes[doubled[0]])}; {opens}"
        )
    if hanging.size:
        yield (
            f"has hanging nodes ({hanging.size}), which lie on facets to which they do not belong: the first is at "
            f"{in_brackets(mesh.nodes[hanging[0]])}; {opens}"
        )


def in_brackets(point: Floats) -> str:
    """Return a place in words."""
    return f"({', '.join(f'{value + 0.0:.6g}' for value in point)})"


def _on_other_facets(nodes: Floats, facets: Integers) -> tuple[Integers, Integers]:
    """Return the nodes of facets that lie on a facet without them: those at one of its nodes, and all others."""
    from scipy.spatial import cKDTree

    corners, known = nodes[facets], np.unique(facets)
    middle = corners.mean(axis=1)
    radius = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    near = cKDTree(nodes[known]).query_ball_point(middle, (1.0 + ON_FACET) * radius)
    facet = np.repeat(np.arange(len(facets)), [len(one) for one in near])
    node = known[np.concatenate([np.asarray(one, dtype=np.int64) for one in near])]
    other = (facets[facet] != node[:, None]).all(axis=1)
    facet, node = facet[other], node[other]
    slack = ON_FACET * radius[facet]
    at_corner = (np.linalg.norm(corners[facet] - nodes[node][:, None], axis=2) < slack[:, None]).any(axis=1)
    on = places_on(nodes[node], corners[facet])[0] < slack
    return np.unique(node[at_corner]), np.unique(node[on & ~at_corner])
