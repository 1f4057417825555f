"""Stability in closed form where the laws of all contacts are Nitsche's: the gap of a closed contact moves by itself.

With the end force ``F = Sigma^T u`` (`percuss.methods.interfaces.LinearLaw`) elements change the gap rate by ``s F``. A
law ``lambda = -gamma g - F`` of the current state takes that away. With ``P = N + (theta / gamma) Sigma`` and the force
``(theta / gamma) Sigma F`` that always acts, a closed contact adds ``-g (gamma N + theta Sigma) - N F`` in all, and

    g'' = -s (gamma - theta kappa) g,        kappa = -N^T M^-1 Sigma / s,

whatever else moves. All other motions are those with this gap tied. The eigenvalues of the closed step are therefore
those of this oscillator, and of the bodies tied at closed contacts with the stiffness
``K - sum of (theta / gamma) Sigma Sigma^T`` over the open ones, which is symmetric. Ties lower its highest frequency.

Laws that push what they see, evaluated at the end of the step, are springs at the end of the step of what they see:
energy never grows, whatever is closed, so that the step is stable where that of the bodies with this stiffness is.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from percuss.certificate.assessment import Assessment
from percuss.certificate.lines import LineOperator, line_operator, with_rows
from percuss.certificate.search import largest_step_below, signed_distance
from percuss.step.integrator_check import unchecked_scheme
from percuss.step.parts.end_forces import end_forces

if TYPE_CHECKING:
    from percuss.march.model import Model
    from percuss.methods.interfaces import Floats, LinearLaw

SAME = 1e-12  # relative difference of two numbers of a law that count as equal
LIMIT = 4.0  # of (omega dt)^2 with central difference
MOST_POINTS = 2000  # contacts up to which the dense matrix of their end forces is made


def closed_form(model: Model) -> type[DecoupledGapsCriterion] | None:
    """Return the criterion in closed form that covers the laws of all contacts of a model, or None."""
    stages, (table, *_) = unchecked_scheme(model.case.method.integrator, model.dt)
    if (
        stages is not None
        or not model.laws
        or len(model.contact_points) > MOST_POINTS
        or model.facts.no_springs
        or model.facts.beyond_pencil()
        or not all(bound_law.sees_more_than_gap and _is_spring(bound_law.linear) for bound_law in model.laws)
    ):
        return None
    lines: list[Any] = [bound_law.linear for bound_law in model.laws]
    softens = np.concatenate([linear.softens for linear in lines])
    if (softens > 0.0).any() and (softens < 0.0).any():
        return None
    # An end in contact belongs to no other contact and lies beside the end of none.
    found = end_forces(model, 0.5 * model.dt)
    nodes = [node for end_force in found.values() for node in end_force.nodes]
    ends = [node for contact_point in model.contact_points for node in contact_point.nodes]
    if not all(nodes.count(node) == 1 for node in ends):
        return None
    if all(linear.at == "end" and _same(linear.sees, linear.pushes) for linear in lines):
        return EnergyAtEndCriterion
    at_current = table.explicit.gap == "current" and table.explicit.response[0] == 0.0
    return DecoupledGapsCriterion if at_current and all(map(_is_nitsche, lines)) else None


def _same(one: Any, other: Any) -> bool:
    """Return whether the numbers of a law are equal up to round-off."""
    return bool(np.all(np.abs(one - other) <= SAME * np.maximum(np.abs(one), np.abs(other))))


def _is_spring(linear: LinearLaw | None) -> bool:
    """Return whether a law is a spring of what it sees, in compression alone, at all times."""
    return (
        linear is not None
        and linear.during is None
        and (linear.active == "gap < 0") == (linear.sign == "free")
        and not np.any(linear.rate)
        and not np.any(linear.acceleration)
        and bool(np.all(np.asarray(linear.gap) > 0.0))
        and bool(np.all(np.asarray(linear.sigma) > 0.0))
    )


def _is_nitsche(linear: Any) -> bool:
    """Return whether a law has ``sees = sigma`` and ``softens = pushes``, as Nitsche's at the current state."""
    sees_stress = _same(linear.sees, linear.sigma / linear.gap)
    return linear.at == "explicit" and sees_stress and _same(linear.softens, linear.pushes)


class DecoupledGapsCriterion:
    """Criterion of Nitsche's law at the current state, at all contacts, as `closed_form` finds it.

    Parameters
    ----------
    model
        A stretch of a run, `percuss.march.model.Model.stretches`.
    """

    by: ClassVar[str] = "decoupled-gaps"

    def __init__(self, model: Model) -> None:
        self.model = model
        self._end_forces = end_forces(model, 0.5 * model.dt)  # of all contact points
        self._delassus = model.rows.at(0.5 * model.dt).diagonal

    @cached_property
    def _kappa(self) -> Floats:
        """``-N^T M^-1 Sigma / s``, (P,)."""
        mass, out = self.model.bodies.mass, np.zeros(len(self._end_forces))
        rows = self.model.rows.at(0.5 * self.model.dt).sides
        for p, sides in enumerate(rows):
            sigma = self._end_forces[p].rows
            out[p] = -sum(float(side.response @ sigma[side.node]) for side in sides if mass[side.node] > 0.0)
        return out / self._delassus

    def _oscillators(self, dt: float) -> tuple[Floats, Floats]:
        """Return ``s (gamma - theta kappa)`` of the closed gaps and theta / gamma of the open end elements, (P,) each.

        The first is the square of a frequency; a gap has no stiffness where it is 0 or less.
        """
        gamma, softens = np.zeros(self._delassus.size), np.zeros(self._delassus.size)
        for bound_law in self.model.laws_at(dt):
            linear: Any = bound_law.linear
            gamma[list(bound_law.where)] = linear.gap / linear.sigma
            softens[list(bound_law.where)] = linear.softens
        return self._delassus * gamma * (1.0 - softens * self._kappa), softens

    def _stiffening(self, dt: float, softens: Floats) -> float:
        """Return the share of ``(4/dt^2) M - K`` that stiffer end elements of open contacts take; inf without any."""
        return self._elements.largest_softening(dt, np.maximum(-softens, 0.0), np.zeros_like(softens))

    @cached_property
    def _elements(self) -> LineOperator:
        """The bodies with Sigma in place of N."""
        sigma = [self._end_forces[p].rows.items() for p in range(len(self._end_forces))]
        return with_rows(line_operator(self.model), self.model, sigma)

    @cached_property
    def free(self) -> float:
        """Largest step that is stable without contact and without laws."""
        return self._elements.free_step()

    def assess_step(self, dt: float) -> Assessment:
        """Return the assessment of a step."""
        frequency_squared, softens = self._oscillators(dt)
        too_soft = np.flatnonzero(frequency_squared <= 0.0)
        if too_soft.size:
            why = "the law takes all stiffness of the end elements: gamma has to exceed theta kappa"
            return Assessment("grows", [int(p) for p in too_soft[:1]], doubt=why)
        too_stiff = np.flatnonzero(dt**2 * frequency_squared > LIMIT * (1.0 + SAME))
        if too_stiff.size:
            return Assessment("grows", [int(p) for p in too_stiff[:1]])
        share = self._stiffening(dt, softens)
        if not share < 1.0:
            return Assessment("grows")
        fastest = int(np.argmax(frequency_squared))
        return Assessment("stable", [fastest] if dt**2 * frequency_squared[fastest] / LIMIT >= share else [])

    def excess(self, dt: float) -> float:
        """Return the signed distance of a step from the critical one, as `percuss.certificate.search.largest_step`."""
        frequency_squared, softens = self._oscillators(dt)
        share = self._stiffening(dt, softens)
        if (frequency_squared <= 0.0).any():
            return 1.0
        return signed_distance(dt**2 * float(frequency_squared.max()) / LIMIT, share)

    @cached_property
    def critical_step(self) -> float:
        """Largest stable step, with laws bound anew for each step tried."""
        return self.free if self.free in {0.0, np.inf} else largest_step_below(self.excess, self.free)


class EnergyAtEndCriterion(DecoupledGapsCriterion):
    """Criterion of laws at the end of the step that push what they see, at all contacts.

    Closed contacts need no shorter step. The bodies have to be stable while contacts are open.
    """

    by: ClassVar[str] = "energy-at-end"

    def _oscillators(self, dt: float) -> tuple[Floats, Floats]:
        frequency_squared, softens = super()._oscillators(dt)
        return np.where(frequency_squared > 0.0, np.finfo(float).tiny, frequency_squared), softens
