"""The criterion of the linear laws: exact for any mesh and any combination of closed contacts.

Laws evaluated at the current state: `percuss.certificate.operator` decides about central difference. Under a
multi-stage scheme every mode of bodies and closed contacts is an oscillator, so it decides there too, at the step
dt / `limit_ratio` at which central difference is at its limit when the scheme is at its own.

Laws evaluated at the predicted gap or at the end of the step: with ``u_{n+1} = u* + dt^2 M^-1 N lambda`` their
multipliers are ``lambda = -F^-1 g_{n+1}``, ``F = diag(1/eps_s) + diag(eps_m/eps_s - dt^2) S``. Where F is symmetric and
positive definite, the contacts act as springs at the end of the step and no combination grows: that is where
``theta = dt^2 lambda_max((I + S D_m)^-1 S D_s)`` is at most 1. F is symmetric where contacts that share an end have the
same eps_m / eps_s; then no part of such a group is worse than the whole group. Where their ratios differ, a part can be
worse than the whole, and the step can grow even with every theta at most 1: the criterion does not cover these.
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from scipy.sparse.csgraph import connected_components

from percuss.certificate.assessment import SMALLEST_NUMBER, Assessment, largest_step_below, signed_distance
from percuss.certificate.black_box import LARGEST_DENSE_STATE, BlackBox
from percuss.certificate.closed_laws import ROUND_OFF, UNALIKE, ClosedLaws, closed_laws, why_unlike
from percuss.certificate.matrices import operator_of
from percuss.certificate.operator import Operator, largest_eigenvalue, limiting_rows, submatrix
from percuss.certificate.oscillator import limit_ratio

if TYPE_CHECKING:
    from collections.abc import Callable

    from percuss.contact.model import Model
    from percuss.methods.interfaces import Integers

NOT_EXCLUDED = "above theta = 1 {} growth is not certain, and not excluded"
OF_SHORT_BARS, OF_GROUPS = "of bars of one or two elements", "of contacts that share an end"
# A mass that removes the predicted overlap of a step whole makes theta 1, and round-off must not make it unstable.
THETA_ROUNDING = 1e-12
# Relative distance above the largest step by theta and the operator at which longer steps are asked about.
JUST_ABOVE = 1e-6
# Number of elements below which contact can damp all of a body, so that a step above theta = 1 may be stable.
SHORT_BODY_ELEMENTS = 3


def linear_laws(model: Model) -> LinearLaws:
    """Return the criterion of the linear laws of a stretch of a run, `percuss.march.model_of_case.stretches`."""
    # Contact can damp all of a short body, so a step above theta = 1 may be stable: the black box tells.
    short = any(body.count < SHORT_BODY_ELEMENTS for body in model.bodies.values())
    small, alone = 2 * model.dim * model.bodies.mass.size <= LARGEST_DENSE_STATE, bool(model.why("black box"))
    return LinearLaws(
        operator_of(model),
        model.delassus,
        functools.partial(closed_laws, model),
        limit_ratio=limit_ratio(model),
        beyond=BlackBox(model) if short and small and not alone else None,
        short=short and alone,
    )


def doubts_of(model: Model) -> list[str]:
    """Return the reasons why the linear laws do not tell the stability of a model; none where they do."""
    laws = closed_laws(model, model.dt)
    return [*filter(None, (*laws.doubts, why_unlike(model, laws)))]


@dataclass(eq=False)
class LinearLaws:
    """Criterion of one stretch of a run from the linear laws.

    Attributes
    ----------
    operator
        Bodies and contact rows, with bodies as one that are tied throughout.
    delassus : (P, P) sparse array
        The Delassus operator S.
    laws_at
        The closed contacts of a step.
    limit_ratio
        Largest stable step of the scheme over that of central difference, for an oscillator.
    beyond
        The criterion of steps above theta = 1, where contact may damp all of a short body: such a step may be stable.
        None where they all grow.
    short
        Whether there are short bodies about which the black box cannot be asked.
    """

    by: ClassVar[str] = "linear-laws"
    operator: Operator
    delassus: Any
    laws_at: Callable[[float], ClosedLaws]
    limit_ratio: float = 1.0
    beyond: BlackBox | None = None
    short: bool = False

    def theta(self, dt: float, laws: ClosedLaws) -> tuple[float | None, list[int]]:
        """Return the largest theta of the contacts evaluated at the predicted gap, and the contacts it comes from.

        Without such contacts theta is None. Contacts that share ends are taken together.
        """
        predicted = np.flatnonzero(laws.predicted & laws.pressing)
        if not predicted.size:
            return None, []
        coupled = self.delassus if predicted.size == laws.predicted.size else submatrix(self.delassus, predicted)
        label = np.arange(predicted.size)
        if coupled.nnz > predicted.size:
            label = connected_components(coupled, directed=False)[1]
        s, stiffness, inertia = coupled.diagonal(), laws.stiffness[predicted], laws.inertia[predicted]
        thetas = dt**2 * (s * stiffness / (1.0 + s * inertia))
        for group in np.flatnonzero(np.bincount(label) > 1):
            # Of the same eps_m / eps_s, theta rises with the eigenvalues of the symmetric D_s^1/2 S D_s^1/2.
            among = np.flatnonzero(label == group)
            root = np.sqrt(stiffness[among])
            largest = largest_eigenvalue(root[:, None] * submatrix(coupled, among).toarray() * root)
            ratio = float((inertia[among] / stiffness[among]).min())
            thetas[among] = dt**2 * largest / (1.0 + ratio * largest)
        limiting = int(np.argmax(thetas * (1.0 + THETA_ROUNDING) >= thetas.max()))  # of equal ones the first
        theta = float(thetas[limiting])
        if 1.0 < theta <= 1.0 + THETA_ROUNDING:
            theta = 1.0
        return theta, predicted[label == label[limiting]].tolist()

    def assess_step(self, dt: float) -> Assessment:
        """Return the assessment of a step."""
        laws = self.laws_at(dt)
        if self.limit_ratio == 0.0:
            return Assessment("grows")
        if unlike := laws.unlike(self.delassus, dt):
            return Assessment("unknown", unlike, doubt=UNALIKE.format("that"))
        found = self.operator.softening(dt / self.limit_ratio, *laws.at_current_state())
        definite = found is not None and largest_eigenvalue(found[1]) < 1.0
        limiting = [] if found is None or definite else found[0][limiting_rows(found[1])].tolist()
        theta, group = self.theta(dt, laws)
        if theta is None or theta <= 1.0:
            return Assessment("stable" if definite else "grows", limiting, theta)
        if self.beyond is not None:
            return dataclasses.replace(self.beyond.assess_step(dt), theta=theta)
        if definite and (self.short or len(group) > 1) and not self._flips(dt, laws, np.array(group)):
            doubt = NOT_EXCLUDED.format(OF_GROUPS if len(group) > 1 else OF_SHORT_BARS)
            return Assessment("unknown", group, theta, doubt)
        return Assessment("grows", group, theta)

    def _flips(self, dt: float, laws: ClosedLaws, group: Integers) -> bool:
        """Return whether a motion that changes its sign in each step is known to grow while a group is closed.

        The closed step is ``P(z) u = z^2 (M + B) u - z (2 M - dt^2 K) u + M u = 0`` with ``B = dt^2 N F^-1 N^T``. P is
        symmetric and has as many negative eigenvalues at z = -inf as F; where it has fewer at z = -1, z is real and
        below -1 for some motion. By the inertia of a block matrix that is where ``F + N^T (4/dt^2 M - K)^-1 N`` has a
        negative eigenvalue.
        """
        solve = self.operator.factor(4.0 / dt**2)
        if solve is None:
            return False
        delassus, compliance = submatrix(self.delassus, group), self.operator.compliance(solve, group)
        seen = (laws.surplus[group].mean() * delassus + compliance).toarray()
        least = np.linalg.eigvalsh(np.diag(laws.compliance[group]) + seen)[0]
        return bool(least < -ROUND_OFF * np.abs(seen).max())

    def excess(self, dt: float) -> float:
        """Return the signed distance of a step from the critical one: -1 to 1, continuous, 0 at the critical step.

        A step above theta = 1 counts as unstable.
        """
        laws = self.laws_at(dt)
        if self.limit_ratio == 0.0 or laws.unlike(self.delassus, dt):
            return 1.0
        found = self.operator.softening(dt / self.limit_ratio, *laws.at_current_state())
        softening = np.inf if found is None else largest_eigenvalue(found[1])
        excess = signed_distance(softening, self.theta(dt, laws)[0] or 0.0)
        return max(excess, SMALLEST_NUMBER) if softening >= 1.0 else excess

    @cached_property
    def free(self) -> float:
        """Largest step that is stable with no contact closed but ties."""
        return self.operator.free_step() * self.limit_ratio

    @cached_property
    def critical_step(self) -> float:
        """Largest stable step, with laws bound anew for each step tried."""
        if self.free in {0.0, np.inf}:  # No step is stable, or every step is because all nodes are held.
            return self.free
        bound = largest_step_below(self.excess, self.free)
        # Where theta alone limits the step, one just above the bound may be stable; theta may be above 1 at every step.
        beyond = self.beyond if bound < self.free else None
        if beyond is not None and (bound == 0.0 or beyond.excess(bound * (1.0 + JUST_ABOVE)) <= 0.0):
            return largest_step_below(beyond.excess, self.free)
        return bound
