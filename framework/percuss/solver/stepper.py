"""How a march makes its steps: what leap-frog and multi-stage schemes have to offer the driver."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats
    from percuss.solver.build import Kernels
    from percuss.solver.compiled.bulk import Bulk
    from percuss.solver.compiled.leapfrog_loop import Boundary, Record


class Loop(NamedTuple):
    """What the steps of a stretch of time work on: as long as the same supports and drives hold, the same arrays."""

    groups: Any  # (group, (group, ...)): the bodies that share element and material
    masses: Bulk
    boundary: Boundary
    laws: Any  # contact laws with a kernel of their own, as `custom_laws.nest` returned them
    midpoint: float  # a time of the stretch


class Stepper(Protocol):
    """The state of a march and the way to its next steps.

    Attributes
    ----------
    energy_at
        Where in a step the energies recorded with it stand: this fraction of the step after t_n.
    u, v : (nodes * dim,)
        Displacement and velocity of the nodes, changed in place.
    levels
        How many nodal arrays the state consists of: displacement, velocity, and what is kept between steps.
    keeps_constraints
        Whether a support or drive that has let go stays among those of the boundary.
    """

    energy_at: float
    u: Floats
    v: Floats
    levels: int
    keeps_constraints: bool

    def changing(self) -> list[Any]:
        """Return the arrays that a step changes, beyond those of the boundary."""

    def renew(self, loop: Loop) -> None:
        """Take up the arrays of the next stretch of time."""

    def start(self, kernels: Kernels) -> None:
        """Prepare the first step."""

    def amplitudes(self, first: int, count: int) -> Any:
        """Return the amplitudes of the loads in `count` steps from step `first`."""

    def advance(self, kernels: Kernels, amplitudes: Any, record: Record, first: int, count: int) -> int:
        """March `count` steps; return how many were done when one was not sound, else `count`."""

    def step_without_loads(self, kernels: Kernels, record: Record, state: Floats) -> Floats:
        """Return what one step without loads makes of a nodal state, (levels, nodes * dim)."""

    def load_impulse(self, amplitudes: Any) -> Floats:
        """Return the impulse of the loads on all bodies so far, (dim,), after the steps of `amplitudes`."""
