"""A penalty force that is a difference quotient of its potential."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from percuss import ContactLaw, ContactPoints, Integrator, Trial, coupled_gap
from percuss_methods.contacts import _auto, _leap_frog

if TYPE_CHECKING:
    from percuss import Floats

WHY_ENERGY_SEEMS_TO_GROW = (
    "the constant sum includes the energy that the contact stores, which a kernel cannot report: bodies that touch at "
    "the start have stored some in the first half step, and give it back"
)


class Bound(NamedTuple):
    """Stiffness eps_s of each point."""

    stiffness: Floats


def force_over_stiffness(before: float, free: float, response: float) -> float:
    """Return ``(V(g_{n-1}) - V(g_{n+1})) / (g_{n+1} - g_{n-1})`` over eps_s, where ``V = eps_s <-g>^2 / 2``.

    Parameters
    ----------
    before, free
        Gap g_{n-1}, and gap at n + 1 without the force sought [length].
    response
        Change of the gap at n + 1 by a force of eps_s times a unit length [1].

    Returns
    -------
    float
        The only solution: the quotient falls as g_{n+1} grows, and g_{n+1} grows with the force [length].
    """
    if before < 0.0:
        closed = -0.5 * (free + before) / (1.0 + 0.5 * response)
        if free + response * closed < 0.0:
            return closed
        # open at n + 1: x (free - before + response x) = before^2 / 2
        half = 0.5 * (free - before)
        root = math.sqrt(half * half + 0.5 * response * before * before)
        return 0.5 * before * before / (half + root) if half > 0.0 else (root - half) / response
    if free >= 0.0:
        return 0.0
    # open at n - 1: with y = g_{n+1} < 0, (y - free) (before - y) = response y^2 / 2
    total = before + free
    root = math.sqrt(total * total - 4.0 * (1.0 + 0.5 * response) * before * free)
    after = 2.0 * before * free / (total + root) if total > 0.0 else (total - root) / (2.0 + response)
    return 0.5 * after * after / (before - after) if after < before else 0.0  # equal where the gaps underflow


@dataclass(frozen=True)
class EnergyConservingPenalty(ContactLaw):
    """Penalty whose force is the difference quotient of its potential between the gaps at n - 1 and n + 1.

    Formula: ``lambda_n = -(V(g_{n+1}) - V(g_{n-1})) / (g_{n+1} - g_{n-1})``, ``V(g) = eps_s <-g>^2 / 2``; ``eps_s =
    beta_s EA/h`` on the softer side. While the contact is closed it is ``-eps_s (g_{n-1} + g_{n+1}) / 2``.

    A leap-frog step changes the energy of the bodies by ``lambda_n (g_{n+1} - g_{n-1}) / 2``, so that energy minus work
    plus ``(V(g_n) + V(g_{n+1})) / 2`` is constant to round-off, also as contacts open and close. This is the discrete
    gradient of energy-conserving schemes, taken over the two steps between which a leap-frog balances its energy.
    Closed contacts are stable with any stiffness at every step that the free bodies allow. Never pulls. The equation of
    a contact has one solution, in closed form; contacts that share an end are swept until no force changes.
    """

    name = "energy-conserving-penalty"
    summary = "Penalty by a difference quotient of its potential: energy is constant over all impacts"
    references = (
        "Laursen, Chawla: Design of energy conserving algorithms for frictionless dynamic contact problems, IJNME 40 "
        "(1997) 863-886",
        "Hauret, Le Tallec: Energy-controlling time integration methods for nonlinear elastodynamics and low-velocity "
        "impact, CMAME 195 (2006), doi 10.1016/j.cma.2005.11.005",
        "Gonzalez: Time integration and discrete Hamiltonian systems, J. Nonlinear Sci. 6 (1996), doi "
        "10.1007/BF02440162",
    )
    expected_failures = {
        "energy-never-grows with central-difference": WHY_ENERGY_SEEMS_TO_GROW,
        "energy-never-grows with wu-predictor-corrector": WHY_ENERGY_SEEMS_TO_GROW,
    }
    uses_coupling = True
    guarantees = ("never pulls",)
    headline = ("beta_s",)

    beta_s: _auto.BetaS = None
    epsilon_s: _auto.EpsilonS = None

    def __post_init__(self) -> None:
        _auto.refuse_several(self, ("beta_s", "epsilon_s"), "stiffness")

    def bind(self, points: ContactPoints, dt: float) -> Bound:  # noqa: ARG002
        """Return the stiffness."""
        return Bound(_auto.any_stiffness(self, points))

    @staticmethod
    def multipliers(bound: Bound, trial: Trial, multiplier: Floats) -> None:
        """Set the multipliers by sweeps over the points, one that shares no end with another exactly at once."""
        multiplier[:] = 0.0
        for _ in range(1000):
            moved, largest = 0.0, 0.0
            for p in range(multiplier.size):
                previous = multiplier[p]
                multiplier[p] = 0.0
                free = coupled_gap(trial, multiplier, p)
                before = trial.gap[p] - trial.dt * trial.rate[p]
                stiffness = bound.stiffness[p]
                response = stiffness * trial.gap_response * trial.delassus[p]
                multiplier[p] = stiffness * force_over_stiffness(before, free, response)
                moved, largest = max(moved, abs(multiplier[p] - previous)), max(largest, multiplier[p])
            if moved <= 1e-14 * largest:
                break

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:  # noqa: ARG002
        """Return the stiffness eps_s and its dimensionless form beta_s."""
        return _auto.both_forms(_auto.any_stiffness(self, points), points)

    def chosen(self, points: ContactPoints, dt: float) -> Mapping[str, str]:  # noqa: ARG002
        """Return the automatic beta_s with the reason for it, in words."""
        return _auto.any_stiffness_described(self)

    def refuses(self, integrator: Integrator) -> str | None:
        """Refuse schemes that are no leap-frog."""
        return _leap_frog.reason_against(integrator, "the gaps one step before and after a force")
