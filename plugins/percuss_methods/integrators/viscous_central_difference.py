"""Central difference with stiffness-proportional bulk viscosity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from percuss import ContactState, Doc, Ge, Integrator, Le, LeapFrog, Unit, end_of_step
from percuss_methods.integrators._reasons import CONTACT_SWINGS


@dataclass(frozen=True)
class ViscousCentralDifference(Integrator):
    """Central difference with the linear bulk viscosity of explicit codes: a stress proportional to the strain rate.

    Formula: ``v_{n+1/2} = v_{n-1/2} + dt M^-1 (f_ext - K (u_n + beta_d v_{n-1/2}) + N lambda)``,
    ``u_{n+1} = u_n + dt v_{n+1/2}``, with ``beta_d = viscosity dt``, for linear bodies.

    The strain rate is that of half a step before. A mode of frequency omega has the damping ratio
    ``xi = omega beta_d / 2``, and the step is stable for ``dt <= 2 / omega (sqrt(1 + xi^2) - xi)``, that is for
    ``omega dt <= 2 / sqrt(1 + 2 viscosity)``: this is the limit of the scheme with the lagging rate, exactly. In
    uniform bars a linear bulk viscosity b_1 of explicit codes, the damping ratio of the highest mode of an element, is
    ``viscosity = b_1 / C`` at the Courant number C. As it vanishes with the step, the scheme is consistent with the
    bodies without viscosity, to first order. Contact is evaluated as in `central-difference`. The energy that viscosity
    takes is ``dissipated_energy``, and the ledger closes with it to round-off.
    """

    name = "viscous-central-difference"
    summary = "Central difference with linear bulk viscosity"
    references = (
        "von Neumann, Richtmyer: A method for the numerical calculation of hydrodynamic shocks, J. Appl. Phys. 21 "
        "(1950) 232-237, doi 10.1063/1.1699639",
        "Belytschko, Liu, Moran, Elkhodary: Nonlinear Finite Elements for Continua and Structures, Wiley 2014, ch. 6",
    )
    examples = ({}, {"viscosity": 0.1})
    order = 1
    conserves = ("momentum",)
    critical_courant = 1.12**-0.5
    expected_failures = CONTACT_SWINGS

    viscosity: Annotated[float, Ge(0.0), Le(10.0), Unit("1"), Doc("beta_d over the time step")] = 0.06

    def bind(self, dt: float) -> LeapFrog:
        """Return the table of central difference, with the viscosity."""
        explicit = ContactState("current", "current", "bulk", (0.0, 0.0, 1.0))
        return LeapFrog(explicit, end_of_step(dt), viscosity=self.viscosity)
