"""The kinds of cells in their own coordinates: shape functions, facets, and the edges at their corners."""

import numpy as np
import pytest

from percuss import REFERENCE_CELLS

STEP = 1e-6


@pytest.mark.parametrize("kind", REFERENCE_CELLS)
def test_shape_functions_are_one_at_their_own_node_and_their_slopes_are_right(kind):
    cell = REFERENCE_CELLS[kind]
    count, dim = cell.corners.shape
    np.testing.assert_allclose(cell.shape_functions(cell.corners)[0], np.eye(count), atol=1e-15)
    places = 0.1 + 0.2 * np.cos(np.arange(5.0 * dim)).reshape(5, dim)
    shares, slopes = cell.shape_functions(places)
    np.testing.assert_allclose(shares.sum(axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(shares @ cell.corners, places, rtol=0.0, atol=1e-15)
    for d, step in enumerate(STEP * np.eye(dim)):
        ahead, back = (cell.shape_functions(places + way * step)[0] for way in (1.0, -1.0))
        np.testing.assert_allclose((ahead - back) / (2.0 * STEP), slopes[..., d], atol=1e-9)


@pytest.mark.parametrize("kind", ["triangle", "quad", "tetra", "hexahedron"])
def test_facets_look_out_of_the_cell_and_its_edges_span_it(kind):
    cell = REFERENCE_CELLS[kind]
    middle = cell.corners.mean(axis=0)
    for facet in cell.facets:
        corners = cell.corners[facet]
        first, last = corners[1] - corners[0], corners[-1] - corners[0]
        outward = np.array([first[1], -first[0]]) if len(middle) == 2 else np.cross(first, last)
        assert outward @ (corners.mean(axis=0) - middle) > 0.0
        assert facet.size == len(REFERENCE_CELLS[cell.kind_of_facet].corners)
    edges = cell.corners[cell.beside] - cell.corners[: len(cell.beside), None]
    assert (np.linalg.det(edges) > 0.0).all()
