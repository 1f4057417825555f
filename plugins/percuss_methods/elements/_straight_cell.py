"""Straight bar elements of any number of nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss import stress

if TYPE_CHECKING:
    from percuss import Floats


class StraightRule(NamedTuple):
    """Shape functions and quadrature of a cell whose length is 1; its first two nodes are its ends."""

    slope: Floats  # (points, nodes) derivatives of the shape functions along the cell
    weight: Floats  # (points,) share of each point in the length


def straight_rule(nodes: Floats, points: Floats, weight: Floats) -> StraightRule:
    """Return the rule of Lagrange's polynomials through `nodes`, integrated by `points`; all from 0 to 1."""
    powers = np.arange(nodes.size)
    # about the middle, where powers of both halves are alike
    coefficients = np.linalg.inv((2.0 * nodes[:, None] - 1.0) ** powers)
    slopes_of_powers = 2.0 * powers * (2.0 * points[:, None] - 1.0) ** np.maximum(powers - 1, 0)
    return StraightRule(slopes_of_powers @ coefficients, weight)


def axial_forces(
    rule: StraightRule,
    material: Any,
    first: int,
    section: float,
    coordinates: Floats,
    displacement: Floats,
    force: Floats,
) -> None:
    """Set `force` to the axial forces of a cell on its nodes; a kernel."""
    nodes, dim = force.shape
    squared = 0.0
    for d in range(dim):
        squared += (coordinates[1, d] - coordinates[0, d]) ** 2
        for a in range(nodes):
            force[a, d] = 0.0
    inverse = 1.0 / np.sqrt(squared)
    for q in range(rule.weight.size):
        strain = 0.0
        for d in range(dim):
            change = 0.0
            for a in range(1, nodes):  # relative to the first node, so that a translation leaves no strain of round-off
                change += rule.slope[q, a] * (displacement[a, d] - displacement[0, d])
            strain += change * (coordinates[1, d] - coordinates[0, d])
        axial = section * rule.weight[q] * inverse * stress(material, first + q, strain * inverse * inverse)
        for d in range(dim):
            component = axial * (coordinates[1, d] - coordinates[0, d])
            for a in range(1, nodes):
                force[a, d] -= rule.slope[q, a] * component
                force[0, d] += rule.slope[q, a] * component
