"""The criterion of the sparse operator: exact for linear laws, any mesh and any combination of closed contacts.

Laws evaluated at the current state: `percuss.certificate.operator` decides about central difference. Under a
multi-stage scheme every mode of bodies and closed contacts is an oscillator, so it decides there too, at the step
dt / `limit_ratio` at which central difference is at its limit when the scheme is at its own.

Laws evaluated at the predicted gap or at the end of the step: with ``u_{n+1} = u* + dt^2 M^-1 N lambda`` their
multipliers are ``lambda = -F^-1 g_{n+1}``, ``F = diag(1/eps_s) + diag(eps_m/eps_s - dt^2) S``. Where F is symmetric and
positive definite, the contacts act as springs at the end of the step and no combination grows: that is where
``theta = dt^2 lambda_max((I + S D_m)^-1 S D_s)`` is at most 1. F is symmetric where contacts that share an end have the
same eps_m / eps_s; then no part of such a group is worse than the whole group. Where their ratios differ, a part can be
worse than the whole, and the step can grow even with every theta at most 1; then the amplification matrices of all sets
of closed contacts are examined, or the assessment is inconclusive: the closed step is ``u_{n+1} = Q u*`` with
``Q = I - dt^2 M^-1 N (diag(sigma) + diag(w) S)^-1 N^T``. Here w is eps_m / eps_s for the predicted gap and dt^2 for the
end of the step, and Q is not symmetric with respect to the mass matrix.
"""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from percuss.certificate.assessment import Assessment, quoted
from percuss.certificate.operator import SMALL_MATRIX, deflated, largest_eigenvalue, submatrix, unfelt
from percuss.certificate.search import MARGINAL_DISTANCE, SMALLEST_NUMBER, largest_step_below, signed_distance

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from percuss.certificate.assessment import Criterion
    from percuss.certificate.closed_contacts import ClosedContacts
    from percuss.certificate.operator import Operator
    from percuss.methods.interfaces import Floats, Integers

UNALIKE = (
    "contacts {} share an end and differ in eps_m / eps_s: they do not act on one another as equals, and such a step "
    "can grow at any theta"
)
NOT_EXCLUDED = "above theta = 1 of contacts that share an end growth is not certain, and not excluded"
EQUALS = "give contacts that share an end the same eps_m / eps_s, or evaluate contact at the current gap"
# A mass that removes the predicted overlap of a step whole makes theta 1, and round-off must not make it unstable.
THETA_ROUNDING = 1e-12
# Relative distance above the largest step by theta and the operator at which longer steps are asked about.
JUST_ABOVE = 1e-6
# Difference of two eps_m / eps_s, relative to their scale and dt^2, below which it is round-off.
ROUND_OFF = 1e-9
# Largest group of contacts of which every part is tried, as the number of parts doubles with each contact.
MOST_SUBSETS = 10
# Number of sets of closed contacts from which on the model counts as too large to examine them all.
MOST_SETS = 4096
# Growth in a step below which it cannot be told from rounding with certainty.
GROWTH_RESOLUTION = 1e-7
# Largest number of sets times the cube of the matrix size for which a step is examined, to bound the time.
MOST_WORK = 1e8


@dataclass(eq=False)
class OperatorCriterion:
    """Criterion of one stretch of a run from the linear laws.

    Attributes
    ----------
    operator
        Bodies and contact rows, with bodies as one that are tied throughout.
    coupling
        The Delassus operator S: its diagonal, and for each contact the entries beside it by contact.
    laws_at
        The closed contacts of a step.
    names
        Names of the contacts.
    limit_ratio
        Largest stable step of the scheme over that of central difference, for an oscillator.
    tied
        Contacts that are tied throughout.
    apart
        Bodies and contact rows, with ties among the contacts; None without ties.
    beyond
        The criterion of steps above theta = 1, where contact may damp all of a short body: such a step may be stable.
        None where they all grow.
    why_open
        Why a step above theta = 1 that the operator finds stable is not known to grow; empty if it is known.
    """

    by: ClassVar[str] = "pencil"
    operator: Operator
    coupling: tuple[Floats, Sequence[dict[int, float]]]
    laws_at: Callable[[float], ClosedContacts]
    names: Sequence[str]
    limit_ratio: float = 1.0
    tied: Sequence[int] = ()
    apart: Callable[[], Operator] | None = None
    beyond: Criterion | None = None
    why_open: str = ""

    # ------------------------------------------------------------------------------------------------------- theta

    @cached_property
    def _delassus(self) -> Any:
        return delassus(*self.coupling)

    def _groups(self, laws: ClosedContacts, dt: float) -> list[tuple[Integers, bool]]:
        """Return the groups of contacts that share ends, each with whether its F is symmetric.

        Contacts that share no end with another of these are left out, as are contacts of laws without a `surplus` and
        contacts that cannot press for want of stiffness.
        """
        if not any(self.coupling[1]):
            return []
        from scipy.sparse.csgraph import connected_components

        pressing = np.flatnonzero(can_press(laws))
        if not pressing.size:
            return []
        label = connected_components(submatrix(self._delassus, pressing), directed=False)[1]
        groups = np.split(pressing[np.argsort(label, kind="stable")], np.cumsum(np.bincount(label))[:-1])
        surplus = [laws.surplus[group] for group in groups]
        return [
            (group, bool(np.ptp(ratios) <= ROUND_OFF * (np.abs(ratios).max() + dt * dt)))
            for group, ratios in zip(groups, surplus, strict=True)
            if group.size > 1
        ]

    def theta(self, dt: float, laws: ClosedContacts) -> tuple[float | None, list[int]]:
        """Return the largest theta of the contacts evaluated at the predicted gap, and the contacts it comes from.

        Without such contacts theta is None. Of a group that shares ends, the whole is tried where F is symmetric, else
        every part; of a group of more than `MOST_SUBSETS` contacts only each contact, each pair and the whole.
        """
        largest_theta: float | None = None
        worst: Any = ()
        groups = self._groups(laws, dt)
        alone = laws.predicted & can_press(laws)
        for group, _ in groups:
            alone[group] = False
        points = np.flatnonzero(alone)
        if points.size:
            s, stiffness, inertia = self.coupling[0][points], laws.stiffness[points], laws.inertia[points]
            thetas = dt**2 * (s * stiffness / (1.0 + s * inertia))
            limiting = int(np.argmax(thetas * (1.0 + 1e-12) >= thetas.max()))  # of equal ones the first
            largest_theta, worst = float(thetas[limiting]), points[limiting : limiting + 1]
        for group, symmetric in groups:
            explicit = group[laws.predicted[group]]
            if explicit.size == 0:
                continue
            sizes: Sequence[int] = (explicit.size,) if symmetric else range(1, explicit.size + 1)
            if not symmetric and explicit.size > MOST_SUBSETS:
                sizes = (1, 2, explicit.size)
            coupled = submatrix(self._delassus, explicit).toarray()
            for part in (list(part) for size in sizes for part in itertools.combinations(range(explicit.size), size)):
                theta = _theta_of(coupled[np.ix_(part, part)], explicit[part], dt, laws)
                if largest_theta is None or theta > largest_theta * (1.0 + 1e-12):
                    largest_theta, worst = theta, explicit[part]
        if largest_theta is not None and 1.0 < largest_theta <= 1.0 + THETA_ROUNDING:
            largest_theta = 1.0
        return largest_theta, [int(p) for p in worst]

    # ---------------------------------------------------------------------------------------------------- one step

    def assess_step(self, dt: float) -> Assessment:
        """Return the assessment of a step."""
        laws = self.laws_at(dt)
        assessment = self._assess_by_theta_and_operator(dt, laws)
        if assessment.answer == "stable" and (groups := self._unequal_groups(laws, dt)):
            return dataclasses.replace(self._assess_by_matrix(dt, laws, groups), theta=assessment.theta)
        return assessment

    def _assess_by_theta_and_operator(self, dt: float, laws: ClosedContacts) -> Assessment:
        if self.limit_ratio == 0.0:
            return Assessment("grows")
        definite, limiting = self.operator.definite(dt / self.limit_ratio, *at_current_state(laws))
        theta, group = self.theta(dt, laws)
        if theta is None or theta <= 1.0:
            return Assessment("stable" if definite else "grows", limiting, theta)
        if self.beyond is not None:
            return dataclasses.replace(self.beyond.assess_step(dt), theta=theta)
        if definite and self.why_open:
            return Assessment("unknown", group, theta, self.why_open)
        if definite and len(group) > 1 and not self._flips(dt, laws, np.array(group)):
            return Assessment("unknown", group, theta, NOT_EXCLUDED)
        return Assessment("grows", group, theta)

    def _flips(self, dt: float, laws: ClosedContacts, group: Integers) -> bool:
        """Return whether a motion that changes its sign in each step is known to grow while a group is closed.

        The closed step is ``P(z) u = z^2 (M + B) u - z (2 M - dt^2 K) u + M u = 0`` with ``B = dt^2 N F^-1 N^T``. P is
        symmetric and has as many negative eigenvalues at z = -inf as F; where it has fewer at z = -1, z is real and
        below -1 for some motion. By the inertia of a block matrix that is where ``F + N^T (4/dt^2 M - K)^-1 N`` has a
        negative eigenvalue.
        """
        surplus = laws.surplus[group]
        factor = self.operator.factor(4.0 / dt**2)
        if factor is None or np.ptp(surplus) > ROUND_OFF * (np.abs(surplus).max() + dt * dt):
            return False
        seen = surplus.mean() * submatrix(self._delassus, group).toarray() + self.operator.compliance(factor, group)
        least = np.linalg.eigvalsh(np.diag(laws.compliance[group]) + seen)[0]
        return bool(least < -ROUND_OFF * np.abs(seen).max())

    def excess(self, dt: float) -> float:
        """Return the signed distance of a step from the critical one: -1 to 1, continuous, 0 at the critical step.

        A step above theta = 1 counts as unstable.
        """
        if self.limit_ratio == 0.0:
            return 1.0
        laws = self.laws_at(dt)
        theta = self.theta(dt, laws)[0] or 0.0
        softening = self.operator.largest_softening(dt / self.limit_ratio, *at_current_state(laws))
        excess = signed_distance(softening, max(theta, 0.0))
        return max(excess, SMALLEST_NUMBER) if softening >= 1.0 else excess

    # ---------------------------------------------------------------------------------------------- critical step

    @cached_property
    def free(self) -> float:
        """Largest step that is stable with no contact closed but ties."""
        return self.operator.free_step() * self.limit_ratio

    @cached_property
    def bound(self) -> float:
        """Largest step that is stable by theta and the operator, short bodies and unequal ratios left aside."""
        return largest_step_below(self.excess, self.free)

    @cached_property
    def critical_step(self) -> float:
        """Largest stable step, with laws bound anew for each step tried; nan where it is not known."""
        if self.free in {0.0, np.inf}:  # No step is stable, or every step is because all nodes are held.
            return self.free
        bound = self.bound
        if self.beyond is not None and self._longer_steps_may_be_stable(self.beyond, bound):
            bound = largest_step_below(self.beyond.excess, self.free)
        some = any(self.coupling[1]) and 0.0 < bound < np.inf
        if not some or not self._unequal_groups(self.laws_at(bound), bound):
            return bound
        # Growth caused by unequal ratios goes on at shorter steps, ever more slowly: there is no critical step then.
        return bound if self.assess_step(bound * (1.0 - MARGINAL_DISTANCE)).answer == "stable" else np.nan

    def _longer_steps_may_be_stable(self, beyond: Criterion, bound: float) -> bool:
        """Return whether theta alone limits the step to `bound`, and the step just above it is stable."""
        if bound == 0.0:  # Theta is above 1 at every step, and no step just above the bound can tell.
            return True
        above = bound * (1.0 + JUST_ABOVE)
        by_theta = above < self.free and (self.theta(above, self.laws_at(above))[0] or 0.0) > 1.0
        return by_theta and beyond.excess(above) <= 0.0

    # --------------------------------------------------------------------------------------------- unequal ratios

    def _unequal_groups(self, laws: ClosedContacts, dt: float) -> list[Any]:
        """Return the groups of contacts that share ends and differ in eps_m / eps_s."""
        return [group for group, symmetric in self._groups(laws, dt) if not symmetric]

    def _assess_by_matrix(self, dt: float, laws: ClosedContacts, groups: list[Any]) -> Assessment:
        """Return the assessment by amplification matrices, for groups about which theta alone does not decide."""
        reason = UNALIKE.format(quoted(self.names, [int(p) for group in groups for p in group]))
        sets = list(itertools.islice(unequal_sets(groups, laws, self.tied), MOST_SETS))
        apart = self.apart() if self.apart else self.operator
        if len(sets) == MOST_SETS or len(sets) * (2.0 * apart.size) ** 3 > MOST_WORK:
            return Assessment("unknown", doubt=f"{reason}; the model is too large to examine all sets of them")
        matrix = ClosedMatrix(apart)
        slow: Sequence[int] | None = None
        for closed in sets:
            radius = matrix.radius(dt, laws, closed)
            if radius > 1.0 + GROWTH_RESOLUTION:
                return Assessment("grows", list(closed), doubt=reason, cure=EQUALS)
            if radius > 1.0 + MARGINAL_DISTANCE and slow is None:
                slow = closed
        if slow is None:
            return Assessment("stable")
        may_grow = (
            f"with contacts {quoted(self.names, slow)} closed it may grow, too slowly to distinguish from rounding"
        )
        return Assessment("unknown", list(slow), doubt=f"{reason}; {may_grow}")


class ClosedMatrix:
    """Amplification matrices of (u_n, u_{n-1}) with laws at the predicted gap or at the end of the step, dense.

    Parameters
    ----------
    operator
        Bodies and contact rows.
    """

    def __init__(self, operator: Operator) -> None:
        stiffness, mass, rows = operator.dense()
        root = np.linalg.cholesky(mass)
        self.size = mass.shape[0]
        self.scaled = np.linalg.solve(root, np.linalg.solve(root, stiffness).T)
        self.normal = np.linalg.solve(root, rows)
        rigid = root.T @ operator.rigid()
        self.rigid = rigid / np.linalg.norm(rigid, axis=0)

    def radius(self, dt: float, laws: ClosedContacts, closed: Sequence[int]) -> float:
        """Return the largest modulus of the eigenvalues of the step, leaving out motions without strain.

        Parameters
        ----------
        dt
            Time step.
        laws
            The closed contacts at this step, as their linear laws describe them.
        closed
            Numbers of the closed contacts.
        """
        indices = list(closed)
        normal = self.normal[:, indices]
        weight = laws.surplus[indices] + dt * dt
        left = np.diag(laws.compliance[indices]) + weight[:, None] * (normal.T @ normal)
        back = np.eye(self.size) - dt * dt * normal @ np.linalg.lstsq(left, normal.T, rcond=None)[0]
        one = np.eye(self.size)
        matrix = np.block([[back @ (2.0 * one - dt * dt * self.scaled), -back], [one, np.zeros_like(one)]])
        idle = np.asarray(np.kron(np.eye(2), unfelt(self.rigid, normal.T)))
        return float(np.abs(np.linalg.eigvals(deflated(matrix, idle))).max(initial=0.0))


def unequal_sets(
    groups: Sequence[Sequence[int]], laws: ClosedContacts, tied: Sequence[int]
) -> Iterator[tuple[int, ...]]:
    """Yield the sets of closed contacts in which two contacts of one group differ in `surplus`, smallest sets first.

    Tied contacts are closed in each set.
    """
    candidates = [p for p in range(laws.surplus.size) if not np.isnan(laws.surplus[p])]
    free = [p for p in candidates if p not in tied]
    for count in range(len(free) + 1):
        for chosen in itertools.combinations(free, count):
            closed = sorted({*chosen, *tied})
            if any(np.ptp(laws.surplus[[p for p in group if p in closed] or [group[0]]]) > 0.0 for group in groups):
                yield tuple(closed)


def delassus(diagonal: Floats, coupling: Sequence[dict[int, float]]) -> Any:
    """Return the Delassus operator as a sparse array."""
    from scipy.sparse import csr_array

    entries = [(p, q, value) for p, row in enumerate(coupling) for q, value in {**row, p: diagonal[p]}.items()]
    row, column, value = np.array(entries).reshape(-1, 3).T
    return csr_array((value, (row.astype(np.int64), column.astype(np.int64))), shape=(diagonal.size,) * 2)


def can_press(laws: ClosedContacts) -> Any:
    """Return which contacts have a `surplus` and can press, (P,): the predicted ones need stiffness for it."""
    return np.where(laws.predicted, laws.stiffness > 0.0, ~np.isnan(laws.surplus))


def at_current_state(laws: ClosedContacts) -> tuple[Floats, Floats]:
    """Return eps_s and eps_m of the contacts evaluated at the current state, 0 for the others, (P,) each."""
    return np.where(laws.predicted, 0.0, laws.stiffness), np.where(laws.predicted, 0.0, laws.inertia)


def _theta_of(s: Floats, contacts: Integers, dt: float, laws: ClosedContacts) -> float:
    """Return ``dt^2 lambda_max((I + S D_m)^-1 S D_s)`` of some contacts evaluated at the predicted gap."""
    stiffness, inertia = laws.stiffness[contacts], laws.inertia[contacts]
    if contacts.size > SMALL_MATRIX and np.ptp(laws.surplus[contacts]) == 0.0:
        # Of the same eps_m / eps_s, theta rises with the eigenvalues of the symmetric D_s^1/2 S D_s^1/2.
        root = np.sqrt(stiffness)
        largest = largest_eigenvalue(root[:, None] * s * root)
        return float(dt**2 * largest / (1.0 + inertia[0] / stiffness[0] * largest))
    values = np.linalg.eigvals(np.linalg.solve(np.eye(contacts.size) + s * inertia, s * stiffness))
    return float(dt**2 * np.max(values.real))
