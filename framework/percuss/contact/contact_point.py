"""A contact point of a model."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.methods.interfaces import ContactLaw, Floats

TOUCHING = 1e-9  # fraction of an element length; a smaller initial gap or overlap is set to zero


@dataclass(frozen=True)
class ContactPoint:
    """A contact point: the contact that it belongs to, its gap, its law and scales.

    Stiffness, frequency and mass are as `percuss.methods.interfaces.ContactPoints` defines them.
    """

    name: str  # of its contact
    contact: int  # number of its contact in the case
    gradient: tuple[tuple[int, Floats], ...]  # nodes, and the derivative of the gap by the displacement of each, (dim,)
    normal: Floats  # (dim,) from the first side to the second, or to the wall
    at_wall: bool
    gap: float
    law: ContactLaw
    stiffness: float
    frequency: float
    mass: float
    equal_sides: bool
    weight: float = 1.0
    facet: float = math.inf  # size of the facet that it met at the start, at a wall of its own [length]

    @property
    def nodes(self) -> tuple[int, ...]:
        """The nodes that the gap depends on."""
        return tuple(node for node, _ in self.gradient)


def gap_rows(points: Sequence[ContactPoint], size: int, dim: int) -> Any:
    """Return N of contact points as a sparse array, (size, P), with `size` degrees of freedom."""
    from scipy.sparse import csr_array

    entries = [
        (node * dim + d, p, value)
        for p, point in enumerate(points)
        for node, normal in point.gradient
        for d, value in enumerate(normal)
    ]
    row, column, value = np.array(entries, dtype=float).reshape(-1, 3).T
    return csr_array((value, (row.astype(np.int64), column.astype(np.int64))), shape=(size, len(points)))
