"""Central difference in leap-frog form, with contact evaluated at the current state."""

from __future__ import annotations

from dataclasses import dataclass

from percuss import ContactState, Integrator, LeapFrog, end_of_step
from percuss_methods.integrators._reasons import CONTACT_SWINGS


@dataclass(frozen=True)
class CentralDifference(Integrator):
    """Central difference in leap-frog form, eq. (5) of Kolman et al.

    Formula: ``a = M^-1 (f_ext - f_int(u_n) + N lambda)``, ``v_{n+1/2} = v_{n-1/2} + dt a``,
    ``u_{n+1} = u_n + dt v_{n+1/2}``, with lambda evaluated at u_n and the gap's bulk acceleration. A law evaluated at
    the end of the step sees the predicted gap.

    Stable for ``dt <= 2 / omega_max`` of (K + K_p, M + M_p); conserves the staggered energy without contact. While a
    penalty contact stays closed, it conserves the sum of that energy and
    ``(eps_s g_n g_{n+1} + eps_m r_{n+1/2}^2) / 2``, r the gap rate.
    """

    name = "central-difference"
    summary = "Central difference, contact evaluated at the current state"
    references = (
        "Belytschko, Liu, Moran, Elkhodary: Nonlinear Finite Elements for Continua and Structures, Wiley 2014",
        "Kolman, Kopacka, Gonzalez, Gabriel, Cho, Plesek, Park: Bi-penalty stabilized explicit finite element "
        "algorithm for one-dimensional contact-impact problems, eq. (5)",
    )
    order = 2
    conserves = ("energy", "momentum")
    critical_courant = 1.0
    expected_failures = CONTACT_SWINGS

    def bind(self, dt: float) -> LeapFrog:
        """Return the table of the scheme: explicit laws see u_n, and a multiplier changes the acceleration alone."""
        return LeapFrog(explicit=ContactState("current", "current", "bulk", (0.0, 0.0, 1.0)), end=end_of_step(dt))
