"""Nitsche's method: theta = 0, the symmetric variant theta = 1, and the skew-symmetric one theta = -1."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from percuss import ContactLaw, ContactPoints, Doc, Ge, Le, LinearLaw, Unit
from percuss_methods.contacts import _auto

SAFETY = 2.0  # automatic gamma over kappa for theta other than 0


@dataclass(frozen=True)
class Nitsche(ContactLaw):
    """Nitsche's method: the contact force is that of the bulk stress, corrected in proportion to the gap.

    Formula: ``lambda = <-A sigma_n - gamma g>``, ``P = N + theta Sigma / gamma`` pushed by lambda, and the force
    ``theta Sigma A sigma_n / gamma`` always; Sigma the row of A sigma_n, tension positive; ``gamma = beta_s EA/h`` on
    the softer side.

    It is consistent: at a gap of zero lambda is the exact pressure, whatever gamma and theta, where a penalty needs an
    overlap. Contacts may press before they touch, where the bulk is compressed. A sigma_n is the normal force of the
    end elements, of both sides with weights w proportional to 1/m of their end nodes. With these the gap of a closed
    contact moves by itself, ``g'' = -s (gamma - theta kappa) g`` with ``kappa = sum of w^2 EA/h``, whatever the motion
    of the bars.

    ``theta = 1``: what is pushed is what is seen, and the force has a potential. Kinetic and elastic energy with
    ``theta (lambda^2 - (A sigma_n)^2) / (2 gamma)`` are constant between switchings with central difference and never
    grow with Wu's predictor-corrector. It requires ``gamma > kappa``; open ends are softer. ``theta = 0``: the force
    acts on the ends alone. ``theta = -1``: stable for every gamma in statics; open ends are stiffer, which requires a
    shorter step. For theta other than 1 this energy changes by ``(1 - theta) lambda g'``: an impact adds some energy,
    and much on coarse meshes and with a small gamma.

    Stable with central difference for ``0 < dt^2 s (gamma - theta kappa) <= 4``, if the bodies with the stiffness ``K -
    theta Sigma Sigma^T / gamma`` are. With Wu's predictor-corrector, for theta below 1, the certificate often finds no
    stable step: there the law sees a force one step ahead, which is negative damping if the force has no potential. At
    rest it leaves a gap of ``dt^2 G^T M^-1 P lambda`` there, with the exact pressure.

    ``auto``, the default, is ``gamma = omega^2 / s`` for theta = 0, with omega the smaller 2c/h of the two sides, which
    is stable at every step up to a Courant number of 1 of the smallest element at ends in one contact: beta_s = 1
    between equal bars and 2 at a rigid wall; otherwise ``gamma = 2 kappa``, which is the same between equal sides. With
    a smaller gamma the oscillation of the gap is so slow that the bars carry it away, and the force is far from the
    exact one; with a larger gamma its amplitude is larger.

    For theta = 0 A sigma_n may come from the bulk acceleration of the gap, ``A sigma_n = g''_bulk / s``, which is the
    default and needs a scheme that gives it: without loads on the ends this is the same; with loads, such as gravity,
    it is the part that the load leaves to contact. With ``stress_from: elements`` it comes from the end elements, as
    for other theta.
    """

    name = "nitsche"
    summary = "Nitsche: bulk stress and penalty, cut off at zero; theta = 0, 1 or -1"
    references = (
        "Chouly, Renard: Explicit Verlet time-integration for a Nitsche-based approximation of elastodynamic contact "
        "problems, Adv. Model. Simul. Eng. Sci. 5 (2018), doi 10.1186/s40323-018-0124-5",
        "Chouly, Hild, Renard: A Nitsche finite element method for dynamic contact: 1. Space semi-discretization and "
        "time-marching schemes, ESAIM: M2AN 49 (2015), doi 10.1051/m2an/2014041",
        "Chouly, Hild, Renard: A Nitsche finite element method for dynamic contact: 2. Stability of the schemes and "
        "numerical experiments, ESAIM: M2AN 49 (2015), doi 10.1051/m2an/2014046",
    )
    examples = ({}, {"theta": 1.0}, {"theta": -1.0}, {"stress_from": "elements"})
    expected_failures = {
        "energy-never-grows with central-difference": "the force of the bulk stress does work that nothing stores"
    }
    guarantees = ("never pulls",)
    stiffening = ("beta_s", "epsilon_s")
    headline = ("beta_s",)

    beta_s: _auto.BetaS = None
    epsilon_s: _auto.EpsilonS = None
    theta: Annotated[float, Ge(-1), Le(1), Unit("1"), Doc("variant: 1 symmetric, 0 simplest, -1 skew")] = 0.0
    stress_from: Annotated[
        Literal["auto", "acceleration", "elements"],
        Doc("where A sigma_n comes from; auto is acceleration for theta = 0, else elements"),
    ] = "auto"

    def __post_init__(self) -> None:
        _auto.refuse_several(self, ("beta_s", "epsilon_s"), "stiffness")
        if self.theta != 0.0 and self.stress_from == "acceleration":
            raise ValueError("stress_from: acceleration is for theta = 0: the other variants push the end elements too")

    @property
    def _by_acceleration(self) -> bool:
        return self.theta == 0.0 and self.stress_from != "elements"

    def gamma(self, points: ContactPoints) -> Any:
        """Return gamma at each contact point, (P,) [force/length]."""
        if self.epsilon_s is not None:
            return self.epsilon_s * points.weight
        if self.beta_s in {None, "auto"} and self.theta != 0.0:
            return SAFETY * points.trace_stiffness
        if self.beta_s in {None, "auto"}:
            return points.frequency**2 / points.delassus
        return self.beta_s * points.stiffness

    def bind(self, points: ContactPoints, dt: float) -> LinearLaw:  # noqa: ARG002
        """Return the law of the end force, or the linear law ``lambda = -gamma g - g''_bulk / s``, ``lambda >= 0``."""
        gamma = self.gamma(points)
        if not self._by_acceleration:
            share = 1.0 / gamma
            pushes = self.theta * share
            return LinearLaw(at="explicit", sigma=share, sees=share, pushes=pushes, softens=pushes)
        share = 1.0 / points.delassus
        return LinearLaw(at="explicit", sigma=0.0, gap=gamma, acceleration=share, active="all", sign=">= 0")

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:  # noqa: ARG002
        """Return gamma as eps_s, and its dimensionless form beta_s."""
        return _auto.both_forms(self.gamma(points), points)

    def chosen(self, points: ContactPoints, dt: float) -> Mapping[str, str]:  # noqa: ARG002
        """Return the automatic beta_s with the reason for it, in words."""
        if self.epsilon_s is not None or self.beta_s not in {None, "auto"}:
            return {}
        why = ("so that a closed gap vibrates at the highest frequency of the mesh",)
        if self.theta != 0.0:
            why = ("twice kappa, which it has to exceed for theta = 1",)
        return _auto.described(_auto.Choice(self.gamma(points) / points.stiffness, why))
