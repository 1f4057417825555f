"""Cells cut into equal parts: the parts are those of a finer mesh of blocks, and neighbours have the same nodes."""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from percuss_methods.shapes._cuts import cut
from percuss_methods.shapes.block import Block


def as_sets(nodes, cells):
    """Positions of the corners of each cell, in whatever order nodes and cells stand."""
    return {frozenset(map(tuple, corners)) for corners in np.round(nodes[cells], 9).tolist()}


@pytest.mark.parametrize("parts", [2, 3])
@pytest.mark.parametrize("kind", ["quad4", "tri3", "hex8"])
def test_a_block_cut_into_parts_is_the_block_of_as_many_times_more_elements(kind, parts):
    dim = 3 if kind == "hex8" else 2
    shape = Block(size=[2.0, 1.0, 1.5][:dim], elements=[2, 1, 2][:dim], cells=kind)
    coarse, fine = (shape.mesh(np.zeros(dim), refine) for refine in (1, parts))
    (name, cells), (_, expected) = *coarse.cells.items(), *fine.cells.items()
    nodes, found = cut(coarse.nodes, {name: cells, **coarse.regions["left"].facets}, parts)
    assert len(nodes) == len(fine.nodes)
    assert as_sets(nodes, np.concatenate(found[name])) == as_sets(fine.nodes, expected)
    ((side, facets),) = fine.regions["left"].facets.items()
    assert as_sets(nodes, np.concatenate(found[side])) == as_sets(fine.nodes, facets)


@pytest.mark.parametrize("parts", [1, 2, 5])
@pytest.mark.parametrize(("kind", "turned"), [("triangle", [0, 2, 1]), ("tetra", [0, 2, 1, 3])])
def test_parts_of_irregular_simplices_meet_face_to_face_and_fill_the_body(kind, turned, parts):
    dim = len(turned) - 1
    positions = np.random.default_rng(1).random((40, dim))
    cells = Delaunay(positions).simplices.astype(np.int64)
    volume = np.linalg.det(positions[cells[:, 1:]] - positions[cells[:, :1]])
    cells[volume < 0] = cells[volume < 0][:, turned]
    nodes, found = cut(positions, {kind: cells}, parts)
    assert found[kind].shape == (len(cells), parts**dim, dim + 1)
    # Each part has an equal share of the volume of its cell, counted in the same sense.
    shares = np.linalg.det(nodes[found[kind][..., 1:]] - nodes[found[kind][..., :1]])
    assert shares == pytest.approx(np.abs(volume)[:, None] / parts**dim * np.ones(parts**dim), rel=1e-9, abs=1e-15)
    of_parts = faces(np.concatenate(found[kind]))
    assert set(of_parts) == {1, 2}
    assert of_parts[1] == faces(cells)[1] * parts ** (dim - 1)


def faces(cells):
    """Numbers of faces that belong to one cell, to two cells."""
    corners = cells.shape[1]
    all_of_them = [np.sort(np.delete(cells, corner, axis=1), axis=1) for corner in range(corners)]
    _, count = np.unique(np.concatenate(all_of_them), axis=0, return_counts=True)
    return dict(zip(*(part.tolist() for part in np.unique(count, return_counts=True)), strict=True))
