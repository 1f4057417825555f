"""The force of end elements at a contact point: the weight of each side in it, and its stiffness."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.contact.contact_rows import Side
    from percuss.mesh.bodies import Bodies
    from percuss.methods.interfaces import Floats


def weights_of(sides: Sequence[Side]) -> list[float]:
    """Return the weight of each side in the end force, proportional to 1/m of its end node; they sum to 1."""
    mobility = [float(side.normal @ side.response) for side in sides]
    return [value / sum(mobility) for value in mobility]


def trace_stiffness(bodies: Bodies, sides_of_points: Sequence[Sequence[Side]]) -> Floats:
    """Return `percuss.ContactPoints.trace_stiffness` of contact points with these sides, (P,) [force/length]."""
    return np.array(
        [
            sum(
                weight**2 * bodies.bar_at(side.node).end_stiffness(side.node)
                for weight, side in zip(weights_of(sides), sides, strict=True)
            )
            for sides in sides_of_points
        ]
    )
