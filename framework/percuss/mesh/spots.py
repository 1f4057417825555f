"""A point of a body: the nodes of the cell in which it lies, each with its share in the motion there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.specs import Spot
from percuss.case.type_words import found
from percuss.methods.interfaces import REFERENCE_CELLS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from percuss.case.case import Case
    from percuss.errors import Problem
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats, Mesh, ReferenceCell

OUTSIDE = 1e-9  # of a cell; a point that lies so far outside is on its boundary
NEWTON = 20  # steps of the search for the place of a point in a cell


def outside(case: Case, bodies: Mapping[str, Body]) -> Iterator[Problem]:
    """Yield the recorded points that lie outside of their bodies."""
    for i, one in enumerate(case.record.probes or ()):
        if isinstance(one, Spot) and not shares_at(bodies[one.body], one):
            least, largest = (corner.tolist() for corner in bodies[one.body].extent)
            message = f"expected a point of body '{one.body}', found {found(one.at)}"
            advice = f"The body lies between {least} and {largest}."
            yield case.problem(("record", "probes", i, "at"), message, advice)


def shares_at(body: Body, spot: Any) -> list[tuple[int, float]]:
    """Return nodes of the model, each with its share in the motion at a point of a body; nothing if it lies outside.

    In a line of nodes the motion is linear between neighbours, in any cell that of its shape functions.
    """
    point = np.zeros(body.mesh.nodes.shape[1])
    point[: len(spot.at)] = spot.at
    return [(body.start + node, share) for node, share in shares_in(body.mesh, point)]


def shares_in(mesh: Mesh, point: Floats) -> list[tuple[int, float]]:
    """Return nodes of a mesh as `shares_at` does, for a point with a component for each dimension."""
    if mesh.line is not None:
        place, along = mesh.nodes @ mesh.direction, float(point @ mesh.direction)
        across = point - mesh.nodes[0] - (along - place[0]) * mesh.direction
        slack = OUTSIDE * float(np.ptp(place))
        if np.linalg.norm(across) > slack or not place[0] - slack <= along <= place[-1] + slack:
            return []
        k = int(np.clip(np.searchsorted(place, along) - 1, 0, len(place) - 2))
        part = float((along - place[k]) / (place[k + 1] - place[k]))
        return [(k, 1.0 - part), (k + 1, part)]
    ((kind, cells),) = mesh.cells.items()
    corners = mesh.nodes[cells]
    slack = OUTSIDE * np.ptp(corners, axis=1).max(axis=1)[:, None]
    near = (corners.min(axis=1) <= point + slack) & (corners.max(axis=1) >= point - slack)
    for cell in np.flatnonzero(near.all(axis=1)):
        shares = _shares(REFERENCE_CELLS[kind], corners[cell], point)
        if shares.min() >= -OUTSIDE:
            return list(zip(cells[cell].tolist(), shares.tolist(), strict=True))
    return []


def _shares(cell: ReferenceCell, corners: Floats, point: Floats) -> Floats:
    """Return the shape functions of a cell at a point; one of them is negative if it lies outside."""
    at = np.zeros((1, point.size))
    for _ in range(NEWTON):
        shapes, slopes = cell.shape_functions(at)
        at = at - np.linalg.solve(corners.T @ slopes[0], shapes[0] @ corners - point)
    shares: Floats = cell.shape_functions(at)[0][0]
    return shares
