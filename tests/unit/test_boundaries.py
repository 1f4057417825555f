"""Boundaries and pieces of meshes against what plain loops find, for cells drawn with holes and in any order."""

from collections import Counter

import numpy as np
import pytest

from percuss import REFERENCE_CELLS, Mesh
from percuss.mesh.cells import extents_of, pieces_of
from percuss.mesh.surfaces import boundary_of
from percuss_methods.shapes.block import Block

COUNTS = {"quad4": (6, 5), "tri3": (6, 5), "hex8": (5, 4, 3), "tet4": (4, 4, 3)}


def with_holes(cells, seed):
    """The kind and the cells of a block of which a third is left out, and its nodes."""
    count = COUNTS[cells]
    mesh = Block(size=(1.0,) * len(count), elements=count, cells=cells).mesh(np.zeros(len(count)), 1)
    ((kind, whole),) = mesh.cells.items()
    return kind, np.random.default_rng(seed).permutation(whole)[len(whole) // 3 :], mesh.nodes


def pieces_by_sets(cells):
    """The number of pieces, by sets of nodes that are joined one cell after the other."""
    pieces = []
    for cell in cells.tolist():
        touched = [piece for piece in pieces if piece & set(cell)]
        pieces = [piece for piece in pieces if piece not in touched] + [set(cell).union(*touched)]
    return pieces


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("cells", COUNTS)
def test_the_boundary_is_the_facets_of_one_cell(cells, seed):
    kind, some, _ = with_holes(cells, seed)
    facets = some[:, REFERENCE_CELLS[kind].facets].reshape(-1, REFERENCE_CELLS[kind].facets.shape[1]).tolist()
    times = Counter(tuple(sorted(facet)) for facet in facets)
    alone = sorted((facet for facet in facets if times[tuple(sorted(facet))] == 1), key=sorted)
    assert boundary_of(kind, some).tolist() == alone


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("cells", COUNTS)
def test_pieces_and_extents_are_those_of_plain_loops(cells, seed):
    kind, some, nodes = with_holes(cells, seed)
    few = some[: len(some) // 4]
    found = pieces_of(Mesh(nodes, {kind: few}, {}))
    pieces = pieces_by_sets(few)
    assert sorted(set(found.tolist())) == list(range(len(pieces)))
    number = {node: k for k, piece in enumerate(pieces) for node in piece}
    assert len({(number[cell[0]], piece) for cell, piece in zip(few.tolist(), found.tolist(), strict=True)}) == len(
        pieces
    )
    assert (extents_of(nodes, few) == np.ptp(nodes[few], axis=1)).all()
