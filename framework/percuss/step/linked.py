"""The actions of a step as compiled code performs them: by the addresses of their kernels and of their data.

Each kernel is compiled behind an *entrance*, which finds its data at their address (`percuss.step.linking`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.methods.slots import unbound

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integers


class LinkedActions(NamedTuple):
    """The actions of all places of a step."""

    addresses: Integers  # (actions, 2) of the kernel of each, and of its data
    edges: Integers  # (places + 1,) index of the first action of each place, and the number of all actions


class LinkedKernel(NamedTuple):
    """A single kernel: addresses of its data and of its code."""

    data: int
    apply: int


class LinkedSystem(NamedTuple):
    """The system of a multi-stage scheme, and the functions for the accelerations and internal forces in a stage."""

    data: int
    accelerate: int
    internal: int  # 0 if the scheme does not ask for them


_LINE = np.zeros(1)
ACTION, ACCELERATIONS, INTERNAL, SCHEME, LOOP = (
    "action",
    "accelerations of a stage",
    "internal forces of a stage",
    "step of a scheme",
    "loop",
)
# For each kind of kernel an example of what it returns, and of its arguments behind the data. Python calls a loop, with
# the block that holds its arguments alone.
EXAMPLES: dict[str, tuple[Any, tuple[Any, ...]]] = {
    ACTION: (None, (1, _LINE, _LINE, _LINE)),
    ACCELERATIONS: (None, (1, _LINE, _LINE, _LINE)),
    INTERNAL: (None, (1, _LINE, _LINE)),
    SCHEME: (None, (_LINE, _LINE, _LINE[None], 1.0)),
    LOOP: (1, ()),
}


def at(data: object) -> Any:
    """Return the value at an address (slot)."""
    unbound()


def call(kind: str, kernel: int, data: int, arguments: object) -> Any:
    """Call a kernel by its address, with the address of its data and its arguments (slot)."""
    unbound()


def kernel(data: Any, *arguments: Any) -> Any:
    """Compute what the kernel does (slot)."""
    unbound()


def entrance(data: object, arguments: Any) -> Any:
    """Call the kernel with the arrays at the address `data`."""
    return kernel(at(data), *arguments)


def entrance_of_scheme(data: object, arguments: Any) -> None:
    """Call the kernel of a multi-stage scheme with its numbers and the system at the address `data`."""
    numbers, system = at(data)
    kernel(numbers, system, *arguments)


def entrance_of_loop(data: object, arguments: object) -> int:
    """Call a loop with all its arguments, at the address `data`; return the number of its steps."""
    return kernel(*at(data))  # type: ignore[no-any-return]


def perform(actions: LinkedActions, place: int, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Perform the actions of one place of a step."""
    for k in range(actions.edges[place], actions.edges[place + 1]):
        call("action", actions.addresses[k, 0], actions.addresses[k, 1], (n, u, v, a))


def accelerations(system: LinkedSystem, stage: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set `a` to the accelerations in a stage."""
    call("accelerations of a stage", system.accelerate, system.data, (stage, u, v, a))


def internal(system: LinkedSystem, stage: int, u: Floats, f: Floats) -> None:
    """Set `f` to the internal forces in a stage, over the masses."""
    call("internal forces of a stage", system.internal, system.data, (stage, u, f))


def take_step(numbers: LinkedKernel, system: object, u: Floats, v: Floats, kept: Floats, dt: float) -> None:
    """Make one step of the integrator."""
    call("step of a scheme", numbers.apply, numbers.data, (u, v, kept, dt))
