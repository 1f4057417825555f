"""Wu's predictor-corrector, with contact evaluated at the predicted state."""

from __future__ import annotations

from dataclasses import dataclass

from percuss import ContactState, Integrator, LeapFrog, end_of_step


@dataclass(frozen=True)
class WuPredictorCorrector(Integrator):
    """Predictor-corrector of Wu: bulk accelerations first, contact accelerations as a correction.

    Formula: ``v* = v_{n-1/2} + dt a_bulk``, ``u* = u_n + dt v*``; contact is evaluated at u*;
    ``a_corr = (M + M_p)^-1 f_cont``; ``v_{n+1/2} = v* + dt a_corr``, ``u_{n+1} = u_n + dt v_{n+1/2}``.

    Stable with closed contacts for ``theta = dt^2 eps_s s / (1 + eps_m s) <= 1`` and a step stable without contact; for
    theta < 1 the modified energy ``E + kappa/4 (<-g_{n+1}>^2 + <-g_n>^2) - W`` never grows.
    """

    name = "wu-predictor-corrector"
    summary = "Wu's predictor-corrector, contact evaluated at the predicted state"
    references = (
        "Wu (2003), in the form of section 5 of Kolman et al.",
        "Kolman, Kopacka, Gonzalez, Gabriel, Cho, Plesek, Park: Bi-penalty stabilized explicit finite element "
        "algorithm for one-dimensional contact-impact problems",
    )
    order = 2
    conserves = ("energy", "momentum")
    critical_courant = 1.0

    def bind(self, dt: float) -> LeapFrog:
        """Return the table of the scheme: explicit laws see u* and no gap acceleration."""
        return LeapFrog(explicit=ContactState("predicted", "predicted", "none", (0.0, 0.0, 1.0)), end=end_of_step(dt))
