"""Nitsche's method without the adjoint term, theta = 0."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from percuss import ContactLaw, ContactPoints, Doc, Ge, Le, LinearLaw, Unit
from percuss_methods.contacts import _auto


@dataclass(frozen=True)
class Nitsche(ContactLaw):
    """Nitsche's method, theta = 0: the contact force is that of the bulk stress, corrected in proportion to the gap.

    Formula: ``lambda = <-A sigma_n - gamma g>``, sigma_n the normal stress of the bulk, tension positive; ``gamma =
    beta_s EA/h`` on the softer side. Contacts may press before they touch, where the bulk is compressed.

    ``A sigma_n = g''_bulk / s`` is the force by which the bulk accelerates the nodes of the contact: at an end without
    a load, the normal force of the end element; between two bodies, the mean of both sides, each weighted by the mass
    of the node of the other; with a load, what the load leaves to contact. The relative acceleration of a closed
    contact is thus ``g'' = -gamma s g``, that of an undamped oscillator, whatever the bars do.

    Stable with closed contacts for ``dt^2 gamma s <= 4`` and a step stable without contact. ``auto``, the default, is
    ``gamma = omega^2 / s`` with omega the smaller 2c/h of the two sides, which is stable at every step up to a Courant
    number of 1 of the smallest element at ends in one contact: beta_s = 1 between equal bars and 2 at a rigid wall.
    With less, the oscillation of the gap is slow enough for the bars to carry it away, and the force is far off; with
    more, it has a larger amplitude. There is no bound on energy: an impact adds some, on coarse meshes much.
    """

    name = "nitsche"
    summary = "Nitsche, theta = 0: bulk stress and penalty, cut off at zero"
    references = (
        "Chouly, Renard: Explicit Verlet time-integration for a Nitsche-based approximation of elastodynamic contact "
        "problems, Adv. Model. Simul. Eng. Sci. 5 (2018), doi 10.1186/s40323-018-0124-5",
        "Chouly, Hild, Renard: A Nitsche finite element method for dynamic contact, ESAIM: M2AN 49 (2015)",
    )
    expected_failures = {
        "energy-never-grows with central-difference": "the force of the bulk stress does work that nothing stores"
    }
    guarantees = ("never pulls",)
    stiffening = ("beta_s", "epsilon_s")
    headline = ("beta_s",)

    beta_s: _auto.BetaS = None
    epsilon_s: _auto.EpsilonS = None
    theta: Annotated[float, Ge(-1), Le(1), Unit("1"), Doc("variant: 1 symmetric, 0 simplest, -1 skew")] = 0.0
    stress: Annotated[
        Literal["auto", "acceleration", "elements"],
        Doc("where A sigma_n comes from; auto is acceleration for theta = 0, else elements"),
    ] = "auto"

    def __post_init__(self) -> None:
        _auto.refuse_several(self, ("beta_s", "epsilon_s"), "stiffness")
        if self.theta != 0.0 and self.stress == "acceleration":
            raise ValueError("stress: acceleration is for theta = 0: the other variants push the end elements too")

    @property
    def _by_acceleration(self) -> bool:
        return self.theta == 0.0 and self.stress != "elements"

    def gamma(self, points: ContactPoints) -> Any:
        """Return gamma at each contact point, (P,) [force/length]."""
        if self.epsilon_s is not None:
            return self.epsilon_s * points.weight
        if self.beta_s in {None, "auto"} and self.theta != 0.0:
            return 2.0 * points.trace_stiffness
        if self.beta_s in {None, "auto"}:
            return points.frequency**2 / points.delassus
        return self.beta_s * points.stiffness

    def bind(self, points: ContactPoints, dt: float) -> LinearLaw:  # noqa: ARG002
        """Return the linear law ``lambda = -gamma g - g''_bulk / s`` with ``lambda >= 0``, at any gap."""
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
        return _auto.described(_auto.Choice(self.gamma(points) / points.stiffness, why))
