"""The slots of the compiled time loops: kernels called by address (`percuss.step.linking`).

In plain Python the slots are filled with the kernels themselves. In compiled code the functions of this module fill
them, and the loop receives `LinkedBodies`, `LinkedLaws` and their like in the place of the arrays that only the
kernels read. Each kernel is compiled behind an *entrance*, which finds these arrays at the address of its data.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.contact.equation import OTHER, POINT
from percuss.methods.slots import unbound
from percuss.step.bulk import Bulk
from percuss.step.parts.followers import FOLLOWER

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats


class LinkedBodies(NamedTuple):
    """The bodies of a model: address of their arrays, of the kernel of their update and of that of their energy."""

    data: int
    update: int
    energy: int


class LinkedLaws(NamedTuple):
    """The contact laws with a kernel; all addresses are 0 where there is none."""

    in_turn: int  # 1 if kernels and the contact equation have to be solved in turn
    data: int
    apply: int


class LinkedKernel(NamedTuple):
    """A single kernel: that of the loads that follow the motion of an end, or the step of a multi-stage scheme.

    The data of the latter are its numbers and the `LinkedSystem`. Both addresses are 0 where no load follows.
    """

    data: int
    apply: int


class LinkedSystem(NamedTuple):
    """The system of a multi-stage scheme, and the functions for the accelerations and internal forces in a stage."""

    data: int
    accelerate: int
    internal: int  # 0 if the scheme does not ask for them


_LINE, _ROWS = np.zeros(1), np.zeros((1, 1))
_NUMBER = np.zeros(1, dtype=np.int64)
_MASSES = Bulk(_LINE, _LINE, _LINE, 0.0, _LINE, 1, _ROWS, _ROWS, _LINE, _LINE, _LINE, _NUMBER, _LINE, _LINE)
_POINTS = np.zeros(0, dtype=POINT).view(np.recarray)
_OTHERS = np.zeros(0, dtype=OTHER).view(np.recarray)
_FOLLOWERS = np.zeros(0, dtype=FOLLOWER).view(np.recarray)
# For each kind of kernel an example of what it returns, and of its arguments behind the data.
EXAMPLES: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "bulk update": (None, (_MASSES, _LINE, _LINE, _LINE, 1.0)),
    "internal forces": (None, (_LINE, _LINE, 1)),
    "strain energy": (1.0, (_LINE, _LINE, 1, 1.0)),
    "contact laws": (None, (_POINTS, _OTHERS, 1.0, 1.0, (1.0, 1.0))),
    "following loads": (None, (_FOLLOWERS, 1.0)),
    "accelerations of a stage": (None, (1, _LINE, _LINE, _LINE)),
    "internal forces of a stage": (None, (1, _LINE, _LINE)),
    "step of a scheme": (None, (_LINE, _LINE, _LINE[None], 1.0)),
    # Python calls these, with the block that holds their arguments alone.
    "leap-frog loop": (1, ()),
    "multi-stage loop": (1, ()),
    "first accelerations": (None, ()),
}


def at(data: Any) -> Any:
    """Return the value at an address (slot)."""
    unbound()


def call(kind: str, kernel: int, data: int, arguments: Any) -> Any:
    """Call a kernel by its address, with the address of its data and its arguments (slot)."""
    unbound()


def kernel(data: Any, *arguments: Any) -> Any:
    """Compute what the kernel does (slot)."""
    unbound()


def entrance(data: Any, arguments: Any) -> Any:
    """Call the kernel with the arrays at the address `data`."""
    return kernel(at(data), *arguments)


def entrance_of_step(data: Any, arguments: Any) -> None:
    """Call the kernel of a multi-stage scheme with its numbers and the system at the address `data`."""
    numbers, system = at(data)
    kernel(numbers, system, *arguments)


def entrance_of_loop(data: Any, arguments: Any) -> Any:
    """Call a loop with all its arguments, at the address `data`."""
    return kernel(*at(data))


def bulk(groups: LinkedBodies, masses: Bulk, u: Floats, v: Floats, body_acceleration: Floats, dt: float) -> None:
    """Advance all bodies by a step without contact."""
    call("bulk update", groups.update, groups.data, (masses, u, v, body_acceleration, dt))


def forces(groups: LinkedBodies, u: Floats, force: Floats, dim: int) -> None:
    """Set `force` to the internal force on the nodes of all bodies."""
    call("internal forces", groups.update, groups.data, (u, force, dim))


def elastic(groups: LinkedBodies, u: Floats, v: Floats, dim: int, dt: float) -> float:
    """Return the strain energy of all bodies."""
    return call("strain energy", groups.energy, groups.data, (u, v, dim, dt))  # type: ignore[no-any-return]


def kernel_laws(
    laws: LinkedLaws, points: Any, others: Any, dt: float, time: float, response: tuple[float, float]
) -> None:
    """Set the multipliers of laws with a kernel."""
    if laws.apply != 0:
        call("contact laws", laws.apply, laws.data, (points, others, dt, time, response))


def following_forces(loads: LinkedKernel, followers: Any, time: float) -> None:
    """Set the forces of loads that follow the motion of an end."""
    if loads.apply != 0:
        call("following loads", loads.apply, loads.data, (followers, time))


def accelerations(system: LinkedSystem, stage: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set `a` to the accelerations in a stage."""
    call("accelerations of a stage", system.accelerate, system.data, (stage, u, v, a))


def internal(system: LinkedSystem, stage: int, u: Floats, f: Floats) -> None:
    """Set `f` to the internal forces in a stage, over the masses."""
    call("internal forces of a stage", system.internal, system.data, (stage, u, f))


def take_step(numbers: LinkedKernel, system: Any, u: Floats, v: Floats, kept: Floats, dt: float) -> None:
    """Make one step of the integrator."""
    call("step of a scheme", numbers.apply, numbers.data, (u, v, kept, dt))
