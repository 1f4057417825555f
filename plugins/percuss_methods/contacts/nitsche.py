"""Nitsche's method with theta = 0: the contact force is that of the bulk stress, corrected in proportion to the gap."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from percuss import ContactLaw, ContactPoints, LinearLaw
from percuss_methods.contacts import _auto


@dataclass(frozen=True)
class Nitsche(ContactLaw):
    """Nitsche's method, theta = 0: the contact force is that of the bulk stress, corrected in proportion to the gap.

    Formula: ``lambda = <-A sigma_n - gamma g>``; A sigma_n the bulk acceleration of the gap over s, ``g''_bulk / s``,
    tension positive; ``gamma = beta_s EA/h`` on the softer side.

    It is consistent: at a gap of zero lambda is the exact pressure, whatever gamma, where a penalty needs an overlap.
    Contacts may press before they touch, where the bulk is compressed. Without loads on the ends A sigma_n is the
    normal force of the end elements, of both sides with weights proportional to 1/m of their end nodes; with loads,
    such as gravity, it is the part that the load leaves to contact. The scheme has to give the bulk acceleration. The
    gap of a closed contact moves by itself, ``g'' = -s gamma g``, whatever the motion of the bars. The force has no
    potential: the energy changes by ``lambda g'``, so that an impact adds some energy, and much on coarse meshes and
    with a small gamma.

    Stable with central difference for ``0 < dt^2 s gamma <= 4``.

    ``auto``, the default, is ``gamma = omega^2 / s``, with omega the smaller 2c/h of the two sides, which is stable at
    every step up to a Courant number of 1 of the smallest element at ends in one contact: beta_s = 1 between equal bars
    and 2 at a rigid wall. With a smaller gamma the oscillation of the gap is so slow that the bars carry it away, and
    the force is far from the exact one; with a larger gamma its amplitude is larger.
    """

    name = "nitsche"
    summary = "Nitsche, theta = 0: bulk stress and penalty, cut off at zero"
    references = (
        "Chouly, Renard: Explicit Verlet time-integration for a Nitsche-based approximation of elastodynamic contact "
        "problems, Adv. Model. Simul. Eng. Sci. 5 (2018), doi 10.1186/s40323-018-0124-5",
        "Chouly, Hild, Renard: A Nitsche finite element method for dynamic contact: 1. Space semi-discretization and "
        "time-marching schemes, ESAIM: M2AN 49 (2015), doi 10.1051/m2an/2014041",
        "Chouly, Hild, Renard: A Nitsche finite element method for dynamic contact: 2. Stability of the schemes and "
        "numerical experiments, ESAIM: M2AN 49 (2015), doi 10.1051/m2an/2014046",
    )
    expected_failures = {
        "energy-never-grows with central-difference": "the force of the bulk stress does work that nothing stores"
    }
    guarantees = ("never pulls",)
    stiffening = ("beta_s", "epsilon_s")
    headline = ("beta_s",)

    beta_s: _auto.BetaS = None
    epsilon_s: _auto.EpsilonS = None

    def __post_init__(self) -> None:
        _auto.refuse_several(self, ("beta_s", "epsilon_s"), "stiffness")

    def gamma(self, points: ContactPoints) -> Any:
        """Return gamma at each contact point, (P,) [force/length]."""
        if self.epsilon_s is not None:
            return self.epsilon_s * points.weight
        if self.beta_s in {None, "auto"}:
            return points.frequency**2 / points.delassus
        return self.beta_s * points.stiffness

    def bind(self, points: ContactPoints, dt: float) -> LinearLaw:  # noqa: ARG002
        """Return the linear law ``lambda = -gamma g - g''_bulk / s``, ``lambda >= 0``."""
        share = 1.0 / points.delassus
        return LinearLaw(
            at="explicit", sigma=0.0, gap=self.gamma(points), acceleration=share, active="all", sign=">= 0"
        )

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:  # noqa: ARG002
        """Return gamma as eps_s, and its dimensionless form beta_s."""
        return _auto.both_forms(self.gamma(points), points)

    def chosen(self, points: ContactPoints, dt: float) -> Mapping[str, str]:  # noqa: ARG002
        """Return the automatic beta_s with the reason for it, in words."""
        if self.epsilon_s is not None or self.beta_s not in {None, "auto"}:
            return {}
        why = ("so that a closed gap vibrates at the highest frequency of the mesh",)
        return _auto.described(_auto.Choice(self.gamma(points) / points.stiffness, why))
