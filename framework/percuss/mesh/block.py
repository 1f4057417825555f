"""The bodies of one kind as a step reads them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integers


class Block(NamedTuple):
    """The bodies that share one element class and one material class."""

    element: Any  # NamedTuple of (elements, ...) arrays
    parameters: Floats  # (bodies, k) material parameters
    body: Integers  # (bodies,) number of the body in the case
    start: Integers  # (bodies,) first node
    stop: Integers  # (bodies,) the number after the last node
    first: Integers  # (bodies,) index of the first element in the arrays of `element`
    before: Floats  # (points, state variables) as the last step has left them
    after: Floats  # (points, state variables) as the present step leaves them
