"""Implicit alpha method of Hilber, Hughes and Taylor; the trapezoidal rule of Newmark for alpha = 0."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from percuss import Doc, Ge, Implicit, Integrator, Le, Unit

SWINGS = "a multiplier that acts only at the end of a step adds or removes energy when its contact closes or opens"


@dataclass(frozen=True)
class ImplicitHHT(Integrator):
    """Implicit reference: Newmark's trapezoidal rule, or with ``alpha < 0`` the method of Hilber, Hughes and Taylor.

    Formula: ``M a_{n+1} + (1 + alpha) K u_{n+1} - alpha K u_n = (1 + alpha) f_{n+1} - alpha f_n + N lambda_{n+1}``,
    ``u_{n+1} = u_n + dt v_n + dt^2 ((1/2 - beta) a_n + beta a_{n+1})``,
    ``v_{n+1} = v_n + dt ((1 - gamma) a_n + gamma a_{n+1})``, ``beta = (1 - alpha)^2 / 4``, ``gamma = 1/2 - alpha``.

    Contact is solved with ``K_eff = M / (beta dt^2) + (1 + alpha) K`` at the end of the step, so that no law lowers the
    step. It is a reference that shows the cost of an implicit scheme, in NumPy and SciPy, for linear bodies, supports
    and forces. Without contact it is stable at any step; the trapezoidal rule then conserves ``v M v / 2 + u K u / 2``,
    and alpha below 0 damps high frequencies. With exact multipliers the trapezoidal rule oscillates and does not keep
    the energy.
    """

    name = "implicit-hht"
    summary = "Implicit reference: trapezoidal rule, or HHT alpha method, contact at the end of the step"
    references = (
        "Hilber, Hughes, Taylor: Improved numerical dissipation for time integration algorithms in structural "
        "dynamics, Earthq. Eng. Struct. Dyn. 5 (1977) 283-292, doi 10.1002/eqe.4290050306",
        "Newmark: A method of computation for structural dynamics, J. Eng. Mech. Div. 85 (1959), "
        "doi 10.1061/JMCEA3.0000098",
        "Doyen, Ern, Piperno: Time-integration schemes for the finite element dynamic Signorini problem, SIAM J. Sci. "
        "Comput. 33 (2011) 223-249, doi 10.1137/100791440",
    )
    examples = ({}, {"alpha": -0.1})
    order = 2
    conserves = ("momentum",)
    expected_failures = {"energy-never-grows": SWINGS}

    alpha: Annotated[float, Ge(-1.0 / 3.0), Le(0.0), Unit("1"), Doc("numerical damping, 0 for none")] = 0.0

    def bind(self, dt: float) -> Implicit:  # noqa: ARG002
        """Return Newmark's parameters of the method."""
        return Implicit(beta=(1.0 - self.alpha) ** 2 / 4.0, gamma=0.5 - self.alpha, alpha=self.alpha)
