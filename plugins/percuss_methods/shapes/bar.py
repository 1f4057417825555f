"""A straight bar."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import Doc, Ge, Gt, Mesh, Region, Shape, Unit
from percuss_methods.shapes._row import lengths_of, places_of

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class Bar(Shape):
    """A straight bar from its start (`left`) along `direction` to its end (`right`).

    Formula: ``h_i = h_0 grading^(i / (n - 1))`` for i = 0 to n - 1, ``sum of h_i = length``: elements are of equal
    length, or their lengths form a geometric sequence whose last is `grading` times the first.
    """

    name = "bar"
    summary = "A straight line of elements with the ends left and right"
    regions = ("left", "right")
    examples = ({"length": 10.0, "elements": 10}, {"length": 10.0, "elements": 10, "grading": 3.0})

    length: Annotated[float, Gt(0), Unit("length"), Doc("length of the bar")]
    elements: Annotated[int, Ge(1), Unit("1"), Doc("number of elements, before `refine`")]
    direction: Annotated[tuple[float, ...], Unit("1"), Doc("any vector along the bar; x by default")] | None = None
    grading: Annotated[float, Gt(0), Unit("1"), Doc("last element's length over the first one's")] = 1.0

    def __post_init__(self) -> None:
        if self.direction is None:
            return
        if not 1 <= len(self.direction) <= 3:
            raise ValueError(f"direction has {len(self.direction)} components: give 1, 2 or 3")
        if not np.any(self.direction):
            raise ValueError("direction is the zero vector: give one that points along the bar")

    def dimension(self) -> int | None:
        """Return the number of components of `direction`, or None if it is not given."""
        return None if self.direction is None else len(self.direction)

    def element_count(self, refine: float) -> int:
        """Return the number of elements."""
        return self.refined(self.elements, refine)

    def mesh(self, at: Floats, refine: float) -> Mesh:
        """Return the mesh from `at` along the direction."""
        dim = at.size
        direction = np.zeros(dim)
        if self.direction is None:
            direction[0] = 1.0
        else:
            # divided by its largest component first, because the square of 1e-200 or 1e200 is out of range
            vector = np.asarray(self.direction) / np.max(np.abs(self.direction))
            direction[: vector.size] = vector / np.linalg.norm(vector)
        n = self.element_count(refine)
        lengths = lengths_of(self.length, n, self.grading)
        along = places_of(lengths, self.length)
        return Mesh.of_line(
            nodes=at + along[:, None] * direction,
            lengths=lengths,
            direction=direction,
            regions={"left": Region((0,), -direction), "right": Region((n,), direction)},
        )
