"""Velocity Verlet: central difference with displacement and velocity at the same times."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from percuss import Integrator, Stages, accelerations
from percuss_methods.integrators._reasons import ENERGY_SWINGS

if TYPE_CHECKING:
    from percuss import Floats


@dataclass(frozen=True)
class VelocityVerlet(Integrator):
    """Velocity Verlet, the form of central difference in which displacement and velocity belong to the same time.

    Formula: ``v_{n+1/2} = v_n + dt/2 a_n``, ``u_{n+1} = u_n + dt v_{n+1/2}``,
    ``a_{n+1} = M^-1 (f_ext - f_int(u_{n+1}) + N lambda)``, ``v_{n+1} = v_{n+1/2} + dt/2 a_{n+1}``.

    Its displacements are those of `central-difference` to round-off, contact included, unless a law evaluated at the
    current state presses at t = 0: the leap-frog start ignores that force. Stable without contact for ``dt <= 2 /
    omega_max``. The energy of the state at t_n oscillates and does not drift. The contact force of a step is the mean
    of those at its ends. Laws evaluated at the current state see u_{n+1}, laws evaluated at the end of the step the
    displacement u_{n+2}, and u_1 in the acceleration at t = 0.
    """

    name = "velocity-verlet"
    summary = "Velocity Verlet: central difference, displacement and velocity at the same times"
    references = (
        "Swope, Andersen, Berens, Wilson: A computer simulation method for the calculation of equilibrium constants "
        "for the formation of physical clusters of molecules, J. Chem. Phys. 76 (1982) 637-649, doi 10.1063/1.442716",
    )
    order = 2
    conserves = ("momentum",)
    critical_courant = 1.0
    kept = 1
    expected_failures = ENERGY_SWINGS

    def bind(self, dt: float) -> Stages:
        """Return the stage at t_{n+1}, with the prediction of the displacement of the step that follows."""
        return Stages(times=(1.0,), end=((dt, dt**2, dt),), start=(dt, 0.5 * dt**2, 0.5 * dt))

    @staticmethod
    def step(numbers: Any, system: Any, u: Floats, v: Floats, kept: Floats, dt: float) -> None:  # noqa: ARG004
        """Advance u, v and the acceleration in place."""
        a = kept[0]
        v += 0.5 * dt * a
        u += dt * v
        accelerations(system, 0, u, v, a)
        v += 0.5 * dt * a
