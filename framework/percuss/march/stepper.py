"""The interface between the driver of a run and its time integration scheme, leap-frog or multi-stage."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.methods.interfaces import Array, Floats
    from percuss.step.build import Kernels
    from percuss.step.part import Part
    from percuss.step.record import Record
    from percuss.step.records import Step


class Stepper(Protocol):
    """The state of a run and the methods that advance it by time steps.

    Attributes
    ----------
    energy_at
        Time of the energies recorded in a step, as a fraction of the step after t_n.
    force_at
        Middle of the time over which the contact force recorded in a step acts, as a fraction of the step after t_n.
    u, v : (nodes * dim,)
        Displacement and velocity of the nodes, changed in place.
    levels
        Number of nodal arrays in the state: displacement, velocity, and the arrays kept between steps.
    """

    energy_at: float
    force_at: float
    u: Floats
    v: Floats
    levels: int

    def set_step(self, step: Step, parts: Sequence[Part[Any]], kernels: Kernels, midpoint: float) -> None:
        """Use the arrays and actions of the next stretch of the run."""

    def changing_arrays(self) -> list[Array]:
        """Return the arrays that a step changes, except those of `percuss.march.arrays.Arrays`."""

    def start(self) -> None:
        """Prepare the first step."""

    def amplitudes(self, first: int, count: int) -> Any:
        """Return the amplitudes of the loads for `count` steps from step `first`."""

    def advance(self, amplitudes: Any, record: Record, first: int, count: int) -> int:
        """Make `count` steps; return `count`, or the number of steps before the first one that failed a check."""

    def step_without_loads(self, record: Record, state: Floats) -> Floats:
        """Return the nodal state after one step from `state` without loads given in time, (levels, nodes * dim).

        The state of the run is overwritten: of many steps each would take longer with arrays of its own.
        """

    def load_impulse(self, amplitudes: Any) -> Floats:
        """Return the impulse of the loads up to and including the steps of `amplitudes`, with its moment.

        Both are those on all bodies, as `percuss.mesh.bodies.Bodies.with_moment` returns them.
        """
