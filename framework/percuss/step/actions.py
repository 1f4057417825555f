"""What a step does at each of its places: kernels with the arrays that only they read.

The bodies, the contact laws with a kernel and the optional parts of a step all enter it this way. A step performs the
actions of one place after the other and knows none of them. In plain Python a place has a list of kernels with their
data; in compiled code a list of addresses (`percuss.step.linked`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from percuss.jit import Kernel
from percuss.methods.interfaces import Floats

if TYPE_CHECKING:
    from percuss.step.linked import Block

# The places of a step in their order, then those of a stage of a multi-stage scheme. They are no integers of Python,
# since numba compiles a function anew for each one of those that it is called with.
PLACES = cast("tuple[int, ...]", tuple(np.arange(20)))
(
    SNAPSHOT,
    BULK,
    BEFORE_SUPPORTS,
    BEFORE_CONTACT,
    LAWS,
    CONTACT_EQUATION,
    AFTER_CONTACT,
    AFTER_STEP,
    BEFORE_ACCOUNT,
    KINETIC_ENERGY,
    BEFORE_STRAIN_ENERGY,
    STRAIN_ENERGY,
    AFTER_STRAIN_ENERGY,
    RECORD,
    # in a stage
    INTERNAL_FORCES,
    INTERNAL_FORCES_ASIDE,
    AFTER_FORCES,
    BEFORE_LOADS,
    LOADS_OF_A_STAGE,
    AFTER_SUPPORTS,
) = PLACES


@dataclass(frozen=True)
class Action:
    """What is done at one place of a step.

    Attributes
    ----------
    place
        The place, one of `PLACES`.
    kernel
        Called as ``kernel(data, n, u, v, a)``: data, the number of the step, or of the stage at a place of a stage, and
        the displacements, velocities and accelerations of all nodes. A leap-frog scheme has no accelerations, and
        passes the velocities once more.
    data
        Arrays and numbers, in tuples.
    slots
        Functions that `kernel` calls without knowing them, as those of an element and a material, with what fills them.
    of_plugin
        Whether the slots are those of plug-ins, whose array indices are checked.
    allocates
        Whether they make arrays, which needs reference counts in compiled code.
    name
        Of what it belongs to, for the text of an error.
    order
        Place among the actions of a place: below 0 for those before the others, above 0 for those after them.
    """

    place: int
    kernel: Kernel
    data: Any
    slots: Mapping[Kernel, Kernel] = field(default_factory=dict)
    of_plugin: bool = False
    allocates: bool = False
    name: str = "the step"
    order: int = 0

    @cached_property
    def block(self) -> Block:
        """The data as compiled code reads them.

        Raises
        ------
        CannotLink
            If compiled code cannot read them.
        """
        from percuss.step.linked import Block

        return Block(self.data)


def perform(actions: Any, place: int, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Perform the actions of one place, in plain Python (a slot in compiled code)."""
    for kernel, data in actions[place]:
        kernel(data, n, u, v, a)
