"""Impact law on the gap rates, with restitution: Moreau's midpoint scheme and CD-Lagrange."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from percuss import ContactLaw, ContactPoints, Doc, Ge, Integrator, Le, LinearLaw, Unit
from percuss_methods.contacts import _leap_frog

WHY_ENERGY_MAY_GROW = "a force that stops nodes as they part, in a contact that counts as closed, does positive work"


@dataclass(frozen=True)
class MoreauJean(ContactLaw):
    """Newton's impact law on the gap rates before and after the forces of a step, for closed contacts.

    Formula: where the gap of `gate` is below zero: ``0 <= lambda_n``, ``g'_{n+1/2} + e g'_{n-1/2} >= 0``, one of them
    zero; elsewhere lambda_n = 0. The gap of ``gate: current`` is g(u_n), that of ``predicted`` the gap after the bulk
    update, which lets a contact press one step sooner.

    ``gate: current`` is CD-Lagrange, which numbers the displacement one higher: it computes u_{n+1} before the balance.
    It is Moreau's midpoint scheme too, whose midpoint displacements are those of the leap-frog. Time-stepping schemes
    for rigid bodies also use predicted gaps. A gap of zero counts as open, so that touching bodies overlap by one step
    of their motion; the overlap stays until they part.

    The contact work of a step is ``dt (1 - e) lambda_n g'_{n-1/2} / 2``: e = 1 conserves the energy of the bodies; a
    smaller e takes energy from bodies that approach, and adds some to bodies that part and are held back by a force in
    the next step. With ``gate: predicted`` and a step within a few per cent of the critical one a bar that bounces many
    times may gain energy again and again. A step that is stable without contact is stable with any contacts held
    closed. ``gate: current`` needs the bulk acceleration beside the current gap, which Wu's predictor-corrector does
    not supply.
    """

    name = "moreau-jean"
    summary = "Impulses on the gap rate with restitution: CD-Lagrange, Moreau-Jean"
    references = (
        "Fekak, Brun, Gravouil, Depale: A new heterogeneous asynchronous explicit-implicit time integrator for "
        "nonsmooth dynamics, Comput. Mech. 60 (2017), doi 10.1007/s00466-017-1397-0",
        "Di Stasio, Dureisseix, Gravouil, Georges, Homolle: Benchmark cases for robust explicit time integrators in "
        "non-smooth transient dynamics, Adv. Model. Simul. Eng. Sci. 6 (2019), doi 10.1186/s40323-019-0126-y",
        "Moreau: Numerical aspects of the sweeping process, CMAME 177 (1999), doi 10.1016/S0045-7825(98)00387-9",
        "Jean: The non-smooth contact dynamics method, CMAME 177 (1999), doi 10.1016/S0045-7825(98)00383-1",
    )
    guarantees = ("never pulls",)
    headline = ("restitution", "gate")
    expected_failures = {
        "energy-never-grows with central-difference": WHY_ENERGY_MAY_GROW,
        "energy-never-grows with wu-predictor-corrector": WHY_ENERGY_MAY_GROW,
    }
    examples = ({}, {"restitution": 0.5}, {"gate": "current"})

    restitution: Annotated[float, Ge(0), Le(1), Unit("1"), Doc("e of the nodes in contact")] = 0.0
    gate: Annotated[Literal["current", "predicted"], Doc("gap that has to be below zero")] = "predicted"

    def bind(self, points: ContactPoints, dt: float) -> LinearLaw:  # noqa: ARG002
        """Return the complementarity of ``0 <= lambda`` and ``g'_{n+1/2} + e g'_{n-1/2} >= 0`` as a linear law.

        With ``g'_{n+1/2} = g'_{n-1/2} + dt g''`` the sum is ``(1 + e) g'_{n-1/2} + dt g''`` in terms of the current
        rate, and ``(1 + e) g'_{n+1/2} - e dt g''`` in terms of the rate at the end of the step.
        """
        e = self.restitution
        if self.gate == "current":
            return LinearLaw(at="explicit", sigma=0.0, gap=0.0, rate=1.0 + e, acceleration=dt, sign=">= 0")
        return LinearLaw(at="end", sigma=0.0, gap=0.0, rate=1.0 + e, acceleration=-e * dt, sign=">= 0")

    def refuses(self, integrator: Integrator) -> str | None:
        """Refuse schemes that are no leap-frog."""
        return _leap_frog.reason_against(integrator, "the gap rates half a step before and after a force")
