"""Stability criteria: from the linear relations of the contact laws, and from the time step itself.

`BlackBoxCriterion` uses no property of the laws and `percuss.certificate.closed_form` no mesh, so each of them is an
independent check of `PencilCriterion`, which examines the time step itself only for bars of one or two elements above
theta = 1.
"""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from percuss.certificate.black_box import (
    LARGEST_DENSE_STATE,
    MOST_ALONE,
    MOST_TOGETHER,
    ClosedStepStability,
    Motions,
    combinations,
    examine,
)
from percuss.certificate.closed_contacts import ClosedContacts, closed_contacts
from percuss.certificate.pencil import MARGINAL_DISTANCE, MOST_TRIED_CONTACTS, Pencil, largest_step, largest_step_below
from percuss.certificate.scheme_limit import limit_ratio
from percuss.certificate.unequal_contacts import MOST_WORK, ClosedMatrix, unequal_sets, work
from percuss.methods.kernel_trial import changes_with_time

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.march.model import Model, Stretch
    from percuss.methods.interfaces import Floats

UNALIKE = (
    "contacts {} share an end and differ in eps_m / eps_s: they do not act on one another as equals, and such a step "
    "can grow at any theta"
)
NOT_EXCLUDED = "above theta = 1 of contacts that share an end growth is not certain, and not excluded"
SHORT_AND_COUPLED = (
    "above theta = 1 contact may damp all of a bar of one or two elements, and the step itself is examined with "
    "diagonal masses alone"
)
EQUALS = "give contacts that share an end the same eps_m / eps_s, or evaluate contact at the current gap"
# A mass that removes the predicted overlap of a step whole makes theta 1, and round-off must not make it unstable.
THETA_ROUNDING = 1e-12

# Number of elements below which contact can damp all of a bar, so that a step above theta = 1 may be stable.
SHORT_BAR_ELEMENTS = 3
# Relative tolerance of the critical step in a search with the time step itself, where each trial is expensive.
SEARCH_TOLERANCE = 1e-6
# Difference of two eps_m / eps_s, relative to their scale and dt^2, below which it is round-off.
ROUND_OFF = 1e-9
# Largest group of contacts of which every part is tried, as the number of parts doubles with each contact.
MOST_SUBSETS = 10
# Number of sets of closed contacts from which on the model counts as too large to examine them all.
MOST_SETS = 4096
# Number of contacts that a reason names, so that it stays readable.
MOST_NAMED = 6


@dataclass(frozen=True)
class StepAssessment:
    """Assessment of one step by a stability criterion.

    Attributes
    ----------
    stable
        Whether nothing grows in any combination of closed contacts.
    worst
        Contacts that suffice to make the step unstable while they are closed; empty where none are needed.
    theta
        theta of Wu's predictor-corrector in that combination, or the largest one found.
    doubt
        Why the assessment is less than certain or inconclusive; empty where it is certain.
    conclusive
        Whether the criterion can decide about the step.
    stretch
        Number of the stretch of the run that is assessed.
    cure
        Cure of an unstable step, where neither a shorter step nor another value of an option cures it.
    """

    stable: bool
    worst: list[int] = field(default_factory=list)
    theta: float | None = None
    doubt: str = ""
    conclusive: bool = True
    stretch: int = 0
    cure: str = ""


class Criterion(Protocol):
    """A criterion of one stretch of a run."""

    by: ClassVar[str]

    def __init__(self, model: Model) -> None: ...

    @property
    def free(self) -> float:
        """Largest step that is stable with no contact closed but ties."""

    @property
    def critical_step(self) -> float:
        """Largest stable step, nan where it is not known."""

    def assess_step(self, dt: float) -> StepAssessment:
        """Return the assessment of a step."""


class PencilCriterion:
    """Criterion from the linear laws: exact for any mesh and any combination of closed contacts.

    Laws evaluated at the current state: the inertia of the matrix pencil of mass and stiffness with contacts closed
    decides about central difference. Under a multi-stage scheme every mode of this pencil is an oscillator, so the
    inertia decides there too, at the step dt / `limit_ratio` at which central difference is at its limit when the
    scheme is at its own.

    Laws evaluated at the predicted gap or at the end of the step: with ``u_{n+1} = u* + dt^2 M^-1 N lambda`` their
    multipliers are ``lambda = -F^-1 g_{n+1}``, ``F = diag(1/eps_s) + diag(eps_m/eps_s - dt^2) S``. Where F is
    symmetric and positive definite, the contacts act as springs at the end of the step and no combination grows. F is
    symmetric where contacts that share an end have the same eps_m / eps_s; then no part of such a group is worse than
    the whole group. Where their ratios differ, a part can be worse than the whole, and the step can grow even with
    every theta at most 1; then amplification matrices are examined (`percuss.certificate.unequal_contacts`), or the
    assessment is inconclusive.

    Parameters
    ----------
    model
        A stretch of a run, `percuss.march.model.Model.stretches`.
    closed
        The closed contacts of the stretch at its step, if they are known.
    """

    by: ClassVar[str] = "pencil"

    def __init__(self, model: Model, closed: ClosedContacts | None = None) -> None:
        self.model = model
        self._closed = closed
        self.pencil = Pencil(model)
        self.limit_ratio = limit_ratio(model.case.method.integrator, model.stages, model.dt, model.viscosity)
        _, self.delassus, self.coupling = model.contact_rows(0.5 * model.dt)
        self._shares_ends = any(self.coupling)

    def _groups(self, laws: ClosedContacts) -> list[tuple[Any, bool]]:
        """Return the groups of contacts that share ends, each with whether its F is symmetric.

        Contacts that share no end with another of these are left out, as are contacts of laws without a `surplus` and
        contacts that cannot press for want of stiffness.
        """
        if not self._shares_ends:
            return []
        pressing = [int(p) for p in np.flatnonzero(_pressing(laws))]
        left = set(pressing)
        out = []
        for first in pressing:
            members, waiting = set(), [first]
            while waiting:
                p = waiting.pop()
                if p in left:
                    left.discard(p)
                    members.add(p)
                    waiting.extend(self.coupling[p])
            if len(members) > 1:
                group = np.array(sorted(members))
                scale = np.abs(laws.surplus[group]).max() + np.abs(self.model.tables[-1].end.response[0])
                out.append((group, bool(np.ptp(laws.surplus[group]) <= ROUND_OFF * scale)))
        return out

    def _theta_of(self, part: Any, dt: float, laws: ClosedContacts) -> float:
        """Return ``dt^2 lambda_max((I + S D_m)^-1 S D_s)`` of some contacts evaluated at the predicted gap."""
        s = np.diag(self.delassus[part])
        place = {int(p): k for k, p in enumerate(part)}
        for p, k in place.items():
            for q, value in self.coupling[p].items():
                if q in place:
                    s[k, place[q]] = value
        left = np.eye(part.size) + s * laws.inertia[part]
        values = np.linalg.eigvals(np.linalg.solve(left, s * laws.stiffness[part]))
        return float(dt**2 * np.max(values.real))

    def theta(self, dt: float, laws: ClosedContacts) -> tuple[float | None, list[int]]:
        """Return the largest theta of the contacts evaluated at the predicted gap, and the contacts it comes from.

        Without such contacts theta is None. Of a group that shares ends, the whole is tried where F is symmetric, else
        every part; of a group of more than `MOST_SUBSETS` contacts only each contact, each pair and the whole.
        """
        largest_theta: float | None = None
        worst: Any = ()
        groups = self._groups(laws)
        alone = laws.predicted & _pressing(laws)
        for group, _ in groups:
            alone[group] = False
        points = np.flatnonzero(alone)
        if points.size:
            s, stiffness, inertia = self.delassus[points], laws.stiffness[points], laws.inertia[points]
            thetas = dt**2 * (s * stiffness / (1.0 + s * inertia))
            limiting = int(np.argmax(thetas * (1.0 + 1e-12) >= thetas.max()))  # of equal ones the first
            largest_theta, worst = float(thetas[limiting]), points[limiting : limiting + 1]
        for group, symmetric in groups:
            explicit = group[laws.predicted[group]]
            if explicit.size == 0:
                continue
            sizes = range(1, explicit.size + 1)
            if symmetric:
                sizes = range(explicit.size, explicit.size + 1)
            elif explicit.size > MOST_SUBSETS:
                sizes = range(1, 3)
            parts = [np.array(part) for size in sizes for part in itertools.combinations(explicit, size)]
            for part in [*parts, *([explicit] if explicit.size > MOST_SUBSETS else [])]:
                theta = self._theta_of(part, dt, laws)
                if largest_theta is None or theta > largest_theta * (1.0 + 1e-12):
                    largest_theta, worst = theta, part
        if largest_theta is not None and 1.0 < largest_theta <= 1.0 + THETA_ROUNDING:
            largest_theta = 1.0
        return largest_theta, [int(p) for p in worst]

    def _closed_at(self, dt: float) -> ClosedContacts:
        """Return the closed contacts, with laws bound for a step."""
        return self._closed if self._closed and dt == self.model.dt else closed_contacts(self.model, dt)

    def assess_step(self, dt: float) -> StepAssessment:
        """Return the assessment of a step."""
        laws = self._closed_at(dt)
        assessment = self._assess_by_pencil(dt, laws)
        if assessment.stable and (groups := self._unequal_groups(laws)):
            return dataclasses.replace(self._assess_by_matrix(dt, laws, groups), theta=assessment.theta)
        return assessment

    def _assess_by_pencil(self, dt: float, laws: ClosedContacts) -> StepAssessment:
        """Return the assessment of a step by the inertia of the pencil and by theta."""
        if self.limit_ratio == 0.0:
            return StepAssessment(False)
        definite, limiting = self.pencil.definite(dt / self.limit_ratio, *_at_current_state(laws))
        theta, group = self.theta(dt, laws)
        if theta is None or theta <= 1.0:
            return StepAssessment(definite, limiting, theta)
        if self._black_box is not None:
            return dataclasses.replace(self._black_box.assess_step(dt), theta=theta)
        if definite and self._short and self.model.couples_nodes:
            return StepAssessment(False, group, theta, SHORT_AND_COUPLED, conclusive=False)
        return StepAssessment(False, group, theta, NOT_EXCLUDED if len(group) > 1 else "")

    def _excess(self, dt: float) -> float:
        """Return the signed distance of a step from the critical one: -1 to 1, continuous, 0 at the critical step.

        A step above theta = 1 counts as unstable.
        """
        if self.limit_ratio == 0.0:
            return 1.0
        laws = self._closed_at(dt)
        theta = self.theta(dt, laws)[0] or 0.0
        softening = self.pencil.largest_softening(dt / self.limit_ratio, *_at_current_state(laws))
        if not (np.isfinite(softening) and np.isfinite(theta)):
            return 1.0
        excess = [(number - 1.0) / (number + 1.0) for number in (softening, max(theta, 0.0))]
        return max(*excess, np.finfo(float).tiny) if softening >= 1.0 else max(excess)

    def _criterion_above_theta_of_one(self, bound: float) -> BlackBoxCriterion | None:
        """Return the criterion of the stable steps above theta = 1, or None if steps above `bound` are unstable."""
        above = bound * (1.0 + SEARCH_TOLERANCE)
        # Where theta is above 1 at every step, the bound is 0 and no step just above it can tell.
        beyond_theta = bound == 0.0 or (
            above < self.free and (self.theta(above, self._closed_at(above))[0] or 0.0) > 1.0
        )
        if not beyond_theta or self._black_box is None:
            return None
        return self._black_box if bound == 0.0 or self._black_box.excess(above) <= 0.0 else None

    def _unequal_groups(self, laws: ClosedContacts) -> list[Any]:
        """Return the groups of contacts that share ends and differ in eps_m / eps_s."""
        return [group for group, symmetric in self._groups(laws) if not symmetric]

    def _assess_by_matrix(self, dt: float, laws: ClosedContacts, groups: list[Any]) -> StepAssessment:
        """Return the assessment by the amplification matrix, for groups about which theta alone does not decide."""
        reason = UNALIKE.format(quoted_names(self.model, [int(p) for group in groups for p in group]))
        sets = list(itertools.islice(unequal_sets(groups, laws, self.model.tied_points), MOST_SETS))
        if len(sets) == MOST_SETS or work(self.pencil, len(sets)) > MOST_WORK:
            return StepAssessment(
                False, doubt=f"{reason}; the model is too large to examine all sets of them", conclusive=False
            )
        stable, worst = self._matrix.worst(dt, laws, sets)
        if stable is None:
            slow = (
                f"with contacts {quoted_names(self.model, worst)} closed it may grow, too slowly to be told from "
                "rounding"
            )
            return StepAssessment(False, worst, doubt=f"{reason}; {slow}", conclusive=False)
        return StepAssessment(True) if stable else StepAssessment(False, worst, doubt=reason, cure=EQUALS)

    @cached_property
    def _matrix(self) -> ClosedMatrix:
        return ClosedMatrix(self.pencil)

    @cached_property
    def _black_box(self) -> BlackBoxCriterion | None:
        """Black-box criterion of a model with a bar of one or two elements; None for other models and for large ones.

        Contact can damp all of such a bar, so a step above theta = 1 may be stable.
        """
        model = self.model
        # The state of ends without mass is not one of displacement and velocity alone, and states are weighted with
        # diagonal masses.
        covered = not (model.points_without_mass.any() or model.couples_nodes)
        small = self._short and 2 * model.mass.size <= LARGEST_DENSE_STATE
        return BlackBoxCriterion(model) if covered and small else None

    @cached_property
    def _short(self) -> bool:
        """Whether a bar has so few elements that contact can damp all of it."""
        return any(body.stiffness.size < SHORT_BAR_ELEMENTS for body in self.model.bodies.values())

    @cached_property
    def free(self) -> float:
        """Largest step that is stable with no contact closed but ties."""
        return self.pencil.free_step() * self.limit_ratio

    @cached_property
    def bound(self) -> float:
        """Largest step that is stable by theta and the pencil; short bars and unequal ratios are not considered yet."""
        return largest_step_below(self._excess, self.free)

    @cached_property
    def critical_step(self) -> float:
        """Largest stable step, with laws bound anew for each step tried; nan where it is not known."""
        if self.free in {0.0, np.inf}:  # No step is stable, or every step is because all nodes are held.
            return self.free

        bound = self.bound
        criterion = self._criterion_above_theta_of_one(bound)
        if criterion is not None:
            bound = largest_step_below(criterion.excess, self.free)
        if not self._shares_ends or not 0.0 < bound < np.inf:
            return bound
        if not self._unequal_groups(self._closed_at(bound)):
            return bound
        # Growth caused by unequal ratios goes on at shorter steps, ever more slowly: there is no critical step then.
        return bound if self.assess_step(bound * (1.0 - MARGINAL_DISTANCE)).stable else np.nan


def _pressing(laws: ClosedContacts) -> Any:
    """Return which contacts have a `surplus` and can press, (P,): the predicted ones need stiffness for it."""
    return np.where(laws.predicted, laws.stiffness > 0.0, ~np.isnan(laws.surplus))


def _at_current_state(laws: ClosedContacts) -> tuple[Floats, Floats]:
    """Return eps_s and eps_m of the contacts evaluated at the current state, 0 for the others, (P,) each."""
    return np.where(laws.predicted, 0.0, laws.stiffness), np.where(laws.predicted, 0.0, laws.inertia)


class RunCriterion:
    """Criterion for a whole run, made of one criterion for each of its stretches, of which the worst decides.

    Parameters
    ----------
    model
        The model of the whole run.
    kind
        `PencilCriterion`, `BlackBoxCriterion` or `percuss.certificate.decoupled_gaps.DecoupledGapsCriterion`.
    other_step
        The criterion of the same run with another step. If the run has the same stretches with both steps, it also has
        the same critical step, and their criteria are taken over with what they have searched already.
    closed
        The closed contacts of the model at its step, if they are known.
    """

    def __init__(
        self,
        model: Model,
        kind: type[Criterion],
        other_step: RunCriterion | None = None,
        *,
        closed: ClosedContacts | None = None,
    ) -> None:
        self.model = model
        self.closed = closed or closed_contacts(model, model.dt)
        self.by = kind.by
        self.stretches = model.stretches()
        self.criteria: list[Criterion]
        if other_step is not None and other_step.by == kind.by and other_step._actions() == self._actions():
            self.criteria = other_step.criteria
        else:
            self.criteria = [self._criterion_of(kind, stretch) for stretch in self.stretches]

    def _criterion_of(self, kind: type[Criterion], stretch: Stretch) -> Criterion:
        if not issubclass(kind, PencilCriterion):
            return kind(stretch.model)
        # The same laws act in the first step of the run as in this stretch, mostly.
        same = stretch.inactive == self.model.inactive_points(0.5 * self.model.dt)
        return kind(stretch.model, self.closed if same else None)

    def _actions(self) -> list[Any]:
        """Return the numbers of the active constraints and of the inactive contact points in each stretch."""
        return [(stretch.constraints, stretch.inactive) for stretch in self.stretches]

    @property
    def free(self) -> float:
        """Largest step that is stable with no contact closed but ties."""
        return min(criterion.free for criterion in self.criteria)

    def nothing_closed(self, stretch: int | None = None, without_ties: str = "without contact") -> str:
        """Return in words that no contact is closed but ties, in a stretch or the one that limits `free`."""
        if stretch is None:
            stretch = int(np.argmin([criterion.free for criterion in self.criteria]))
        tied = self.stretches[stretch].model.tied_points
        noun = "contacts" if len(tied) > 1 else "contact"
        return f"with {noun} {quoted_names(self.model, tied)} tied and no other closed" if tied else without_ties

    @property
    def critical_step(self) -> float:
        """Largest stable step, nan where it is not known."""
        try:
            limits = [criterion.critical_step for criterion in self.criteria]
        except np.linalg.LinAlgError:  # of matrices that overflow, as the assessment of a step says
            return np.nan
        return float(np.nan if np.isnan(limits).any() else min(limits))

    def assess_step(self, dt: float) -> StepAssessment:
        """Return the assessment of a step in the worst stretch, with the largest theta of all stretches."""
        try:
            assessments = [
                dataclasses.replace(criterion.assess_step(dt), stretch=k) for k, criterion in enumerate(self.criteria)
            ]
        except np.linalg.LinAlgError as error:
            doubt = f"the numbers of its matrices are too large or too unlike to be computed with ({error})"
            return StepAssessment(False, doubt=doubt, conclusive=False)
        thetas = [assessment.theta for assessment in assessments if assessment.theta is not None]

        def severity(assessment: StepAssessment) -> tuple[int, float]:
            kind = 0 if assessment.stable and assessment.conclusive else 1 if not assessment.conclusive else 2
            return kind, assessment.theta or 0.0

        return dataclasses.replace(max(assessments, key=severity), theta=max(thetas, default=None))


def quoted_names(model: Model, points: Sequence[int]) -> str:
    """Return the names of contacts in quotes, of many contacts the first `MOST_NAMED` and the number of the others."""
    names = ", ".join(f"'{model.contact_pairs[p].name}'" for p in points[:MOST_NAMED])
    more = len(points) - MOST_NAMED
    return f"{names} and {more} more" if more > 0 else names


class BlackBoxCriterion:
    """Criterion from the amplification matrix of the solver's own step, for any integrator and contact law.

    Parameters
    ----------
    model
        The case as arrays.
    """

    by: ClassVar[str] = "black-box"

    def __init__(self, model: Model) -> None:
        self.model = model
        self.motions = Motions(model)
        # Combinations that are unstable at the free step; None until `critical_step` has tried them.
        self._unstable_combinations: list[tuple[int, ...]] | None = None
        # Combination that limited the last step of a search, and may limit the next one too.
        self._limiting_combination: tuple[int, ...] | None = None
        self._examined: dict[tuple[float, tuple[int, ...]], ClosedStepStability] = {}

    @cached_property
    def free(self) -> float:
        """Largest step that is stable with no contact closed but ties."""
        model = self.model
        ratio = limit_ratio(model.case.method.integrator, model.stages, model.dt, model.viscosity)
        return self.motions.pencil.free_step() * ratio

    @cached_property
    def _combinations(self) -> list[tuple[int, ...]]:
        """Combinations of closed contacts to be tried, ties in each of them.

        Under a multi-stage scheme `free` covers that of no contact, but no load that follows the motion of an end, and
        not what a tie does to the velocities of its ends.
        """
        tied = self.model.tied_points
        closed_sets = [(*tied, *(self._not_tied[k] for k in closed)) for closed in combinations(len(self._not_tied))]
        return closed_sets if self.model.stages is None or self.model.followers or tied else closed_sets[1:]

    @cached_property
    def _not_tied(self) -> list[int]:
        """Contacts that may be open."""
        return [p for p in range(len(self.model.contact_pairs)) if p not in self.model.tied_points]

    @property
    def _all_are_tried(self) -> bool:
        """Whether every combination of closed contacts is tried."""
        count = len(self._not_tied)
        return len(combinations(count)) == 1 << count

    @property
    def _none_alone(self) -> bool:
        """Whether there are so many contacts that no step is examined with one of them closed alone."""
        return len(self._not_tied) > MOST_ALONE

    def assess_step(self, dt: float) -> StepAssessment:
        """Return the assessment of a step over the combinations of closed contacts that are tried."""
        doubt, radius, theta = "", -1.0, None
        worst: list[int] = []
        closed_sets = self._combinations
        if self.model.stages is not None and dt > self.free * (1.0 + MARGINAL_DISTANCE):
            return StepAssessment(False)
        complete = self._all_are_tried
        tried = "no contact and all" if self._none_alone else "no contact, each one and all"
        if not complete:
            doubt = f"no growth was found with {tried} of them closed; other combinations can be worse"
        for closed in closed_sets:
            stable_at_longer_step = dt < self.free and self._unstable_combinations == []
            stability = self._examine(dt, closed, stable_at_longer_step=stable_at_longer_step)
            names = quoted_names(self.model, closed) or "none"
            if not stability.linear:
                doubt = f"the step is not linear with contacts {names} closed"
                if stability.failure:
                    doubt = f"with contacts {names} held closed a kernel fails ({stability.failure})"
                return StepAssessment(False, list(closed), doubt=doubt, conclusive=False)
            if stability.theta is not None and (theta is None or stability.theta > theta):
                theta = stability.theta
            if not stability.stable:
                return StepAssessment(False, self._smallest_combination(dt, closed), stability.theta)
            if stability.several_lines:
                complete = False
                doubt = (
                    f"with contacts {names} closed the step is another one at other overlaps or while they open; on "
                    "none of these lines growth was found"
                )
            elif not stability.conclusive:
                complete = False
                with_which = f" with {tried} of its contacts closed" if self._none_alone else ""
                doubt = f"the model is large: growth{with_which} was looked for by a Krylov iteration, and none found"
            if stability.radius > radius * (1.0 + 1e-6):
                radius, worst = stability.radius, [p for p in closed if p in self._not_tied]
        if self._time_dependent_laws:
            names = ", ".join(self._time_dependent_laws)
            doubt = f"{names} changes with time, and no growth was found as it acts at the start"
        return StepAssessment(True, worst, theta, doubt, conclusive=complete and not self._time_dependent_laws)

    def excess(self, dt: float) -> float:
        """Return a `ClosedStepStability.excess` above 0 or else the largest; 1 where it is not known for all sets."""
        if not self._all_are_tried:
            return 1.0
        largest = -np.inf
        limiting = self._limiting_combination
        for closed in sorted(self._combinations, key=lambda closed: closed != limiting):
            stability = self._examine(dt, closed)
            excess = stability.excess if stability.conclusive else 1.0
            if excess > largest:
                largest, self._limiting_combination = excess, closed
            if excess > 0.0:
                break
        return largest

    def _smallest_combination(self, dt: float, unstable: tuple[int, ...]) -> list[int]:
        """Return contacts of an unstable combination that suffice for instability and none of which can be left out."""
        kept = [p for p in unstable if p in self._not_tied]
        if len(self._not_tied) <= MOST_TOGETHER or len(kept) > MOST_TRIED_CONTACTS:
            return kept  # All smaller combinations were stable, or there are too many to try.
        for contact in list(kept):
            fewer = [other for other in kept if other != contact]
            stability = self._examine(dt, (*self.model.tied_points, *fewer))
            if stability.linear and not stability.stable:
                kept = fewer
        return kept

    @cached_property
    def _time_dependent_laws(self) -> list[str]:
        """Names of the laws with a kernel whose force changes with time."""
        end = self.model.whole.steps * self.model.whole.dt
        return [
            bound_law.law.name
            for bound_law in self.model.laws
            if bound_law.linear is None
            and changes_with_time(bound_law.law, bound_law.kernel_data, bound_law.points, self.model.dt, end)
        ]

    @cached_property
    def critical_step(self) -> float:
        """Largest stable step within the relative tolerance `SEARCH_TOLERANCE`, or nan where the step is not linear.

        It is nan too where bodies have steps of their own.

        A combination of closed contacts that is stable at the free step is taken as stable at all shorter steps.
        """
        if self.free in {0.0, np.inf}:
            return self.free
        if self.model.own_steps:  # steps of different lengths resonate: a longer step may be stable, a shorter one not
            return np.nan
        results = [
            (closed, self._examine(self.free * (1.0 - MARGINAL_DISTANCE), closed)) for closed in self._combinations
        ]
        if not all(stability.linear for _, stability in results):
            return np.nan
        unstable = [closed for closed, stability in results if not stability.stable]
        self._unstable_combinations = unstable
        if not unstable:
            return self.free
        nonlinear_steps: list[float] = []

        def excess(dt: float) -> float:
            stabilities = [self._examine(dt, closed) for closed in unstable]
            nonlinear_steps.extend(dt for stability in stabilities if not stability.linear)
            return max(stability.excess for stability in stabilities)

        critical = largest_step(excess, self.free, SEARCH_TOLERANCE, guess=self._guess)
        return np.nan if nonlinear_steps else critical

    @property
    def _guess(self) -> float | None:
        """Critical step by theta and the pencil, about which the step itself is asked; None if there is none."""
        if closed_contacts(self.model, self.model.dt).doubts:
            return None
        bound = PencilCriterion(self.model).bound
        return bound if 0.0 < bound < np.inf else None

    def _examine(
        self, dt: float, closed: tuple[int, ...], *, stable_at_longer_step: bool = False
    ) -> ClosedStepStability:
        """Return the stability of a step; if it is certain it is kept, as a search ends where an assessment begins."""
        known = self._examined.get((dt, closed))
        if known is None:
            known = examine(self.motions, dt, closed, stable_at_longer_step=stable_at_longer_step)
            if known.conclusive:
                self._examined[dt, closed] = known
        return known
