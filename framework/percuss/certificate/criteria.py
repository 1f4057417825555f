"""Criteria of stability: by the linear relations of the laws, and by the step itself.

`BlackBoxCriterion` asks nothing of the laws and `percuss.certificate.closed_form` nothing of meshes, so that each
checks `PencilCriterion`; that one asks the step itself only about bars of an element or two, above theta = 1.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.certificate.black_box import DENSE, MOST_TOGETHER, Motions, combinations, examine
from percuss.certificate.closed_contacts import ClosedContacts, closed_contacts
from percuss.certificate.pencil import EDGE, FEW, Pencil, critical_step, largest
from percuss.certificate.scheme_limit import reach
from percuss.certificate.unequal_contacts import WORK, ClosedMatrix, sets_in_question
from percuss.methods.interfaces import LinearLaw
from percuss.methods.kernel_trial import changes_with_time
from percuss.solver.contact_rows import delassus_rows

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.solver.model import Model

UNALIKE = (
    "contacts {} share an end and differ in eps_m / eps_s: they do not act on one another as equals, and such a step "
    "can grow at any theta"
)
NOT_EXCLUDED = "above theta = 1 of contacts that share an end growth is not certain, and not excluded"
EQUALS = "give contacts that share an end the same eps_m / eps_s, or judge contact at the current gap"
SHORT = 3  # elements
LOOSE = 1e-6  # of the critical step: what a search by the step itself settles for
ALIKE = 1e-9  # of dt^2: a smaller difference of two eps_m / eps_s is round-off
MOST_SUBSETS = 10  # contacts of a group of which every part is tried
MOST_SETS = 4096  # of closed contacts that are tried
MOST_NAMED = 6  # contacts that a reason names


@dataclass(frozen=True)
class Finding:
    """What a judge finds of one step.

    Attributes
    ----------
    stable
        Whether nothing grows in any combination of closed contacts.
    worst
        Contacts that suffice to make it unstable while they are closed; empty where none are needed.
    theta
        Of Wu's predictor-corrector, in that combination or the largest known.
    doubt
        Why that is less than certain, or why nothing can be said; empty where it is certain.
    known
        Whether anything can be said.
    stretch
        Number of the stretch of the run it is about.
    cure
        What cures an unstable step, where neither a shorter step nor another value of one option does.
    """

    stable: bool
    worst: list[int] = field(default_factory=list)
    theta: float | None = None
    doubt: str = ""
    known: bool = True
    stretch: int = 0
    cure: str = ""


class PencilCriterion:
    """Judges steps by the rows of the laws: exact for any mesh and any combination of closed contacts.

    Central difference by the inertia of the closed pencil. In stages, laws judged at the current state make every mode
    of the closed pencil an oscillator, so that its inertia tells there too, at the step that brings central difference
    to its limit where it brings the scheme to its own.

    Laws judged at the predicted gap or at the end of the step: with ``u_{n+1} = u* + dt^2 M^-1 N lambda`` their
    multipliers are ``lambda = -F^-1 g_{n+1}``, ``F = diag(1/eps_s) + diag(eps_m/eps_s - dt^2) S``. Where F is
    symmetric and positive definite it is a spring at the end of the step, and no combination grows. It is symmetric
    where contacts that share an end have the same eps_m / eps_s; then the whole of such a group is the worst part of
    it. Where they have not, a part can be worse than the whole, and even with every theta at most 1 the step can grow:
    then amplification matrices are examined (`percuss.certificate.unequal_contacts`), or the judge says that it does
    not know.

    Parameters
    ----------
    model
        A stretch of a run, `percuss.solver.model.Model.stretches`.
    """

    by = "pencil"

    def __init__(self, model: Model) -> None:
        self.model = model
        self.pencil = Pencil(model)
        self.reach = reach(model.case.method.integrator, model.stages, model.dt)
        diagonal, others = delassus_rows(model.sides(0.5 * model.dt))
        self.delassus = np.diag(diagonal)
        for p, row in enumerate(others):
            for q, value in row.items():
                self.delassus[p, q] = value

    def _groups(self, laws: ClosedContacts) -> list[tuple[Any, bool]]:
        """Return the groups of contacts that share ends, of laws with a `surplus`, and whether F of each is symmetric.

        Contacts that cannot press at all, for want of stiffness, are left out.
        """
        from scipy.sparse.csgraph import connected_components

        at_end = ~laws.predicted & ~np.isnan(laws.surplus)
        which = np.flatnonzero((laws.predicted & (laws.stiffness > 0)) | at_end)
        if which.size == 0:
            return []
        coupled = self.delassus[np.ix_(which, which)] != 0
        labels = connected_components(coupled)[1] if which.size > 1 else np.zeros(1, dtype=np.int64)
        out = []
        for label in range(int(labels.max()) + 1):
            group = which[labels == label]
            scale = np.abs(laws.surplus[group]).max() + np.abs(self.model.tables[-1].end.response[0])
            out.append((group, bool(np.ptp(laws.surplus[group]) <= ALIKE * scale)))
        return out

    def _theta_of(self, part: Any, dt: float, laws: ClosedContacts) -> float:
        """Return ``dt^2 lambda_max((I + S D_m)^-1 S D_s)`` of some contacts judged at the predicted gap."""
        s = self.delassus[np.ix_(part, part)]
        left = np.eye(part.size) + s * laws.inertia[part]
        values = np.linalg.eigvals(np.linalg.solve(left, s * laws.stiffness[part]))
        return float(dt**2 * np.max(values.real))

    def theta(self, dt: float, laws: ClosedContacts) -> tuple[float | None, list[int]]:
        """Return the largest theta of the contacts judged at the predicted gap, None where there are none.

        And the contacts it comes from. Of a group that shares ends, every part is tried unless F is symmetric; of a
        group too large for that each contact, each pair and the whole.
        """
        most: float | None = None
        worst: Any = ()
        for group, alike in self._groups(laws):
            explicit = group[laws.predicted[group]]
            if explicit.size == 0:
                continue
            sizes = range(1, explicit.size + 1)
            if alike:
                sizes = range(explicit.size, explicit.size + 1)
            elif explicit.size > MOST_SUBSETS:
                sizes = range(1, 3)
            parts = [np.array(part) for size in sizes for part in itertools.combinations(explicit, size)]
            for part in [*parts, *([explicit] if explicit.size > MOST_SUBSETS else [])]:
                theta = self._theta_of(part, dt, laws)
                if most is None or theta > most * (1.0 + 1e-12):
                    most, worst = theta, part
        return most, [int(p) for p in worst]

    def judge(self, dt: float) -> Finding:
        """Return what is to be said of a step."""
        laws = closed_contacts(self.model, dt)
        finding = self._by_rows(dt, laws)
        if finding.stable and (unalike := self._unalike(laws)):
            return dataclasses.replace(self._by_matrix(dt, laws, unalike), theta=finding.theta)
        return finding

    def _by_rows(self, dt: float, laws: ClosedContacts) -> Finding:
        """Return what inertia of the pencil and theta say of a step."""
        current = ~laws.predicted
        if self.reach == 0.0:
            return Finding(False)
        definite, limiting = self.pencil.definite(
            dt / self.reach,
            np.where(current, laws.stiffness, 0.0),
            np.where(current, laws.inertia, 0.0),
            laws.tied,
        )
        theta, group = self.theta(dt, laws)
        if theta is None or theta <= 1.0:
            return Finding(definite, limiting, theta)
        if self._coarse is not None:
            return dataclasses.replace(self._coarse.judge(dt), theta=theta)
        return Finding(False, group, theta, NOT_EXCLUDED if len(group) > 1 else "")

    def _unalike(self, laws: ClosedContacts) -> list[Any]:
        """Return the groups of contacts that share ends and differ in eps_m / eps_s."""
        return [group for group, alike in self._groups(laws) if not alike]

    def _by_matrix(self, dt: float, laws: ClosedContacts, unalike: list[Any]) -> Finding:
        """Return what the amplification matrix says of groups of which theta does not tell all."""
        reason = UNALIKE.format(named(self.model, [int(p) for group in unalike for p in group]))
        sets = list(itertools.islice(sets_in_question(unalike, laws), MOST_SETS))
        if len(sets) == MOST_SETS or self._matrix.work(len(sets)) > WORK:
            return Finding(False, doubt=f"{reason}; the model is too large to examine all sets of them", known=False)
        stable, worst = self._matrix.worst(dt, laws, sets)
        if stable is None:
            slow = f"with contacts {named(self.model, worst)} closed it may grow, too slowly to be told from rounding"
            return Finding(False, worst, doubt=f"{reason}; {slow}", known=False)
        return Finding(True) if stable else Finding(False, worst, doubt=reason, cure=EQUALS)

    @cached_property
    def _matrix(self) -> ClosedMatrix:
        return ClosedMatrix(self.pencil)

    @cached_property
    def _coarse(self) -> BlackBoxCriterion | None:
        """The judge of steps above theta = 1, where a bar so short that contact damps all of it may stay stable."""
        short = any(body.stiffness.size < SHORT for body in self.model.bodies.values())
        return BlackBoxCriterion(self.model) if short and 2 * self.model.mass.size <= DENSE else None

    @cached_property
    def free(self) -> float:
        """The largest step that is stable without contact."""
        return free_step(self.pencil) * self.reach

    def critical(self) -> float:
        """Return the largest stable step, laws bound anew for each step tried; nan where that is not known."""
        if self.free in {0.0, np.inf}:  # no step, or any: all nodes are held
            return self.free

        def holds(dt: float) -> bool:
            finding = self._by_rows(dt, closed_contacts(self.model, dt))
            return finding.stable and finding.known

        bound = critical_step(holds, self.free)
        if not 0.0 < bound < np.inf or not self._unalike(closed_contacts(self.model, bound)):
            return bound
        # what grows because they are unalike does so at shorter steps too, ever more slowly: there is no critical one
        return bound if self.judge(bound * (1.0 - EDGE)).stable else np.nan


class RunCriterion:
    """The judges of all stretches of a run together: the worst of them speaks.

    Parameters
    ----------
    model
        The model of the whole run.
    kind
        `PencilCriterion` or `BlackBoxCriterion`.
    """

    def __init__(self, model: Model, kind: type[PencilCriterion | BlackBoxCriterion]) -> None:
        self.model = model
        self.by = kind.by
        self.stretches = model.stretches()
        self.judges = [kind(stretch.model) for stretch in self.stretches]

    @property
    def free(self) -> float:
        """The largest step that is stable without contact."""
        return min(judge.free for judge in self.judges)

    def critical(self) -> float:
        """Return the largest stable step, nan where it is not known."""
        limits = [judge.critical() for judge in self.judges]
        return float(np.nan if np.isnan(limits).any() else min(limits))

    def judge(self, dt: float) -> Finding:
        """Return what is to be said of a step: of the worst stretch, theta the largest of all."""
        findings = [dataclasses.replace(judge.judge(dt), stretch=k) for k, judge in enumerate(self.judges)]
        thetas = [finding.theta for finding in findings if finding.theta is not None]

        def badness(finding: Finding) -> tuple[int, float]:
            kind = 0 if finding.stable and finding.known else 1 if not finding.known else 2
            return kind, finding.theta or 0.0

        return dataclasses.replace(max(findings, key=badness), theta=max(thetas, default=None))


def named(model: Model, points: Sequence[int]) -> str:
    """Return the names of contacts in quotes, the first few of many."""
    names = ", ".join(f"'{model.contact_pairs[p].name}'" for p in points[:MOST_NAMED])
    more = len(points) - MOST_NAMED
    return f"{names} and {more} more" if more > 0 else names


class BlackBoxCriterion:
    """Judges steps by the amplification matrix of the march's own step; needs nothing from integrator and law.

    Parameters
    ----------
    model
        The case as arrays.
    """

    by = "black-box"

    def __init__(self, model: Model) -> None:
        self.model = model
        self.motions = Motions(model)
        self._limits: list[tuple[int, ...]] | None = None  # combinations unstable at the free step, once that is known

    @cached_property
    def free(self) -> float:
        """The largest step that is stable without contact."""
        model = self.model
        return free_step(self.motions.pencil) * reach(model.case.method.integrator, model.stages, model.dt)

    @cached_property
    def _tried(self) -> list[tuple[int, ...]]:
        """The combinations of closed contacts; of stages without the open one, which `free` is about."""
        every = combinations(len(self.model.contact_pairs))
        return every if self.model.stages is None else every[1:]

    def judge(self, dt: float) -> Finding:
        """Return what is to be said of a step, over the combinations of closed contacts that are tried."""
        doubt, radius, theta = "", -1.0, None
        worst: list[int] = []
        tried = self._tried
        if self.model.stages is not None and dt > self.free * (1.0 + EDGE):
            return Finding(False)
        complete = 2 ** len(self.model.contact_pairs) == len(combinations(len(self.model.contact_pairs)))
        if not complete:
            doubt = (
                "no growth was found with no contact, each one and all of them closed; other combinations can be worse"
            )
        for one in tried:
            found = examine(self.motions, dt, one, sure=dt < self.free and self._limits == [])
            if not found.linear:
                names = ", ".join(f"'{self.model.contact_pairs[p].name}'" for p in one) or "none"
                doubt = f"the step is not linear with contacts {names} closed"
                if found.failure:
                    doubt = f"with contacts {names} held closed a kernel fails ({found.failure})"
                return Finding(False, list(one), doubt=doubt, known=False)
            if found.theta is not None and (theta is None or found.theta > theta):
                theta = found.theta
            if not found.stable:
                return Finding(False, self._fewest(dt, one), found.theta)
            if not found.whole:
                complete = False
                doubt = "the model is large: growth was looked for by a Krylov iteration, and none found"
            if found.radius > radius * (1.0 + 1e-6):
                radius, worst = found.radius, list(one)
        if self._changing:
            names = ", ".join(self._changing)
            doubt = f"{names} changes with time, and no growth was found as it acts at the start"
        return Finding(True, worst, theta, doubt, known=complete and not self._changing)

    def _fewest(self, dt: float, unstable: tuple[int, ...]) -> list[int]:
        """Return contacts of an unstable combination that suffice to make it so, none of which can be left out."""
        kept = list(unstable)
        if len(self.model.contact_pairs) <= MOST_TOGETHER or len(kept) > FEW:
            return kept  # all smaller combinations were stable, or there are too many
        for contact in unstable:
            fewer = [other for other in kept if other != contact]
            found = examine(self.motions, dt, fewer)
            if found.linear and not found.stable:
                kept = fewer
        return kept

    @cached_property
    def _changing(self) -> list[str]:
        """Names of laws with a kernel whose force changes with time."""
        end = self.model.whole.steps * self.model.whole.dt
        return [
            entry["law"].name
            for entry in self.model.laws
            if not isinstance(entry["bound"], LinearLaw)
            and changes_with_time(entry["law"], entry["bound"], entry["points"], self.model.dt, end)
        ]

    def critical(self) -> float:
        """Return the largest stable step, within `LOOSE`; a combination stable at the free step is so below it.

        nan where the step is not linear, of which nothing can be said.
        """
        if self.free in {0.0, np.inf}:
            return self.free
        tried = [(one, examine(self.motions, self.free * (1.0 - EDGE), one)) for one in self._tried]
        if not all(found.linear for _, found in tried):
            return np.nan
        limits = [one for one, found in tried if not found.stable]
        self._limits = limits
        if not limits:
            return self.free
        broken: list[float] = []  # steps that are not linear

        def holds(dt: float) -> bool:
            found = [examine(self.motions, dt, one) for one in limits]
            broken.extend(dt for one in found if not one.linear)
            return all(one.linear and one.stable for one in found)

        critical = largest(holds, self.free, LOOSE)
        return np.nan if broken else critical


_FREE: dict[bytes, float] = {}


def free_step(pencil: Pencil) -> float:
    """Return the largest step that is stable without contact."""
    digest = hashlib.blake2b(np.float64(pencil.model.omega).tobytes())
    for _, *arrays in pencil.bodies:
        for array in arrays:
            digest.update(np.int64(array.size).tobytes() + array.tobytes())
    key = digest.digest()
    step = _FREE.get(key)  # many runs on the same bodies differ in their contacts alone
    if step is None:
        if len(_FREE) >= 256:
            _FREE.clear()  # also while another thread is here
        step = _FREE[key] = largest(lambda dt: pencil.factors(dt) is not None, 2.0 / pencil.model.omega)
    return step
