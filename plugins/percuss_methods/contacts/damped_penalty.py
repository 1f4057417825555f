"""The penalty method with viscous damping of the gap rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from percuss import ContactLaw, ContactPoints, Doc, Ge, LinearLaw, Unit
from percuss_methods.contacts import _auto


@dataclass(frozen=True)
class DampedPenalty(ContactLaw):
    """Penalty spring with a dashpot beside it, a share of the critical damping of the nodes on the spring.

    Formula: ``lambda = <-eps_s g - c g'>`` while g < 0, and ``c = 2 damping sqrt(eps_s m)``, m = 1/s; the rate is that
    of n - 1/2 with central difference, and that after the bulk update with Wu's predictor-corrector.

    ``1/s = m_1 m_2 / (m_1 + m_2)`` of the two nodes, the mass of the contact damping of Abaqus/Explicit, whose default
    share is the default here. LS-DYNA's VDC is a percentage of ``2 m omega`` with the smaller of both masses, which is
    twice as large between equal nodes. The dashpot alone would pull as the bodies part: the sum is cut off at zero.

    Dissipates while closed; as with `penalty`, opening and closing between two steps may add some energy. With central
    difference the rate, half a step late, lowers the critical step: a free node is stable for
    ``omega dt <= 2 (sqrt(1 + damping^2) - damping)``, ``omega^2 = eps_s s``. ``beta_s: auto`` is that of `penalty`,
    which leaves room for moderate damping below a Courant number of 0.9; the certificate reports where it does not.
    """

    name = "damped-penalty"
    summary = "Penalty spring and dashpot, a share of critical damping; never pulls"
    references = (
        "Abaqus Analysis User's Guide, Contact damping (critical damping fraction)",
        "LS-DYNA Theory Manual, contact damping; VDC in the Keyword Manual, *CONTACT",
        "Schwager, Poeschel: Coefficient of restitution and linear-dashpot model revisited, Granular Matter 9 (2007), "
        "doi 10.1007/s10035-007-0065-z",
    )
    guarantees = ("never pulls",)
    stiffening = ("beta_s", "epsilon_s")
    headline = ("beta_s", "damping")
    totals = ("coefficient",)

    beta_s: _auto.BetaS = None
    epsilon_s: _auto.EpsilonS = None
    damping: Annotated[float, Ge(0), Unit("1"), Doc("share of critical damping")] = 0.03

    def __post_init__(self) -> None:
        _auto.refuse_several(self, ("beta_s", "epsilon_s"), "stiffness")

    def bind(self, points: ContactPoints, dt: float) -> LinearLaw:
        """Return the linear law ``lambda / eps_s = -g - (c / eps_s) g'`` with ``lambda >= 0``."""
        stiffness = _auto.limited_stiffness(self, points, dt)
        tau = 2.0 * self.damping / np.sqrt(stiffness * points.delassus)
        return LinearLaw(at="explicit", sigma=1.0 / stiffness, rate=tau, sign=">= 0")

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:
        """Return the stiffness in both forms, and the damping coefficient c [force time/length]."""
        stiffness = _auto.limited_stiffness(self, points, dt)
        coefficient = 2.0 * self.damping * np.sqrt(stiffness / points.delassus)
        return {**_auto.both_forms(stiffness, points), "coefficient": coefficient}

    def chosen(self, points: ContactPoints, dt: float) -> Mapping[str, str]:
        """Return the automatic beta_s with the reason for it, in words."""
        return _auto.limited_stiffness_described(self, points, dt)
