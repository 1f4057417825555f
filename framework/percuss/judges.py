"""Three ways to judge whether a step is stable: the rows of the laws, the step itself, and closed forms.

`BlackBoxJudge` asks nothing of the laws and `ClosedForm` nothing of meshes, so that each checks `RowsJudge`; that one
asks the step itself only about bars of an element or two, above theta = 1.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.blackbox import DENSE, Motions, combinations, examine
from percuss.methods.interfaces import Rows
from percuss.methods.kernel_trial import changes_with_time
from percuss.pencil import EDGE, Pencil, critical_step, largest
from percuss.solver.contact_rows import broadcast, delassus_rows
from percuss.solver.integrator_check import reach, scheme
from percuss.unalike import WORK, ClosedMatrix, sets_in_question

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.methods.interfaces import Floats, Judged
    from percuss.solver.model import Model

NEVER_GROWS, BETWEEN = "never grows", "conserved between switchings"
NOT_GUARANTEED, UNKNOWN = "not guaranteed", "unknown"
WEAKEST_LAST = (NEVER_GROWS, BETWEEN, NOT_GUARANTEED, UNKNOWN)
BY_END = "the force follows from the gap at the end of the step: energy and what contacts store never exceed the work"
NO_CONTACT = "without contact the step conserves energy"
JUMPS = "the force follows from the gap at the current state: energy jumps as a contact closes or opens, either way"
PULLS = "with its mass the contact pulls before it opens, and each opening or closing may gain energy"
OTHER = "{} is no leap-frog scheme: what it does to energy as contacts open and close is not known"
SHARED = "contacts share an end: one may open or close another against what was predicted"
TIES = "a tie takes up the gap rate of its ends when it begins: energy jumps there, either way"
BILATERAL = "the law pulls as it pushes from its first step on: a gap that is there then brings energy"
INTERVALS = "the law acts in intervals of time: what its contacts store jumps as one of them begins"
UNALIKE = (
    "contacts {} share an end and differ in eps_m / eps_s: they do not act on one another as equals, and such a step "
    "can grow at any theta"
)
OF_LINEAR_BODIES = "the energy of a step is balanced by the work of contacts and loads for linear bodies only"
EQUALS = "give contacts that share an end the same eps_m / eps_s, or judge contact at the current gap"
SHORT = 3  # elements
LOOSE = 1e-6  # of the critical step: what a search by the step itself settles for
ALIKE = 1e-9  # of dt^2: a smaller difference of two eps_m / eps_s is round-off
MOST_SUBSETS = 10  # contacts of a group of which every part is tried
MOST_SETS = 4096  # of closed contacts that are tried
MOST_NAMED = 6  # contacts that a reason names


class NoClosedFormError(Exception):
    """A case for which no closed form is known; the message says why."""


@dataclass(frozen=True)
class Closed:
    """What the laws of a model say of its points at one step; (P,) each, in the order of the case.

    Attributes
    ----------
    stiffness, inertia
        eps_s and eps_m; zero where a law is judged at the end of the step, or does not act.
    predicted
        Whether the law is judged at the predicted gap.
    surplus
        Of laws judged at the predicted gap or at the end of the step: by what ``eps_m / eps_s`` exceeds that of a
        gap judged at the end of the step, dt^2 of a leap-frog scheme; 0 of the latter, nan elsewhere [time^2].
    compliance
        sigma of the laws that have a `surplus`, over the weight of the gap; 0 of a tie [length/force].
    tied
        Points whose gap never changes while the law acts, and it acts whatever the gap.
    unknown
        Names of laws of which the rows say nothing: a kernel of their own, or a weight on the gap rate; in a scheme of
        stages all that are judged at the end of the step, too.
    doubts
        Of each of these, in words why.
    energy, why
        What the pair guarantees of the energy, the weakest of all contacts, and the reason in words.
    """

    stiffness: Floats
    inertia: Floats
    predicted: Any
    surplus: Floats
    compliance: Floats
    tied: tuple[int, ...]
    unknown: tuple[str, ...]
    doubts: tuple[str, ...]
    energy: str
    why: str


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


def closed(model: Model, dt: float) -> Closed:
    """Return what the laws of a model say of its closed points for a step `dt`."""
    count = len(model.meetings)
    stiffness, inertia, compliance = np.zeros(count), np.zeros(count), np.zeros(count)
    predicted, surplus = np.zeros(count, dtype=bool), np.full(count, np.nan)
    unknown: list[str] = []
    tied: list[int] = []
    doubts: list[str] = []

    def doubt(name: str, why: str) -> None:
        unknown.append(name)
        doubts.append(why)

    energy = [(NEVER_GROWS, BY_END) if count else (BETWEEN, NO_CONTACT)]
    stages, (*_, table) = scheme(model.case.method.integrator, dt)
    if model.why_not_linear:
        energy.append((NOT_GUARANTEED, f"{model.why_not_linear}, and {OF_LINEAR_BODIES}"))
    if stages is not None:
        energy.append((UNKNOWN, OTHER.format(model.case.method.integrator.name)))
    for entry in model.laws:
        law, where = entry["law"], entry["where"]
        points = model.points(where, dt)
        bound = law.bind(points, dt)
        if not isinstance(bound, Rows):
            doubt(law.name, f"{law.name} has a kernel of its own, and is no line in gap and acceleration")
            continue
        rows = broadcast(bound, points, law.name)
        if why := _not_followed(rows, law.name, staged=stages is not None):
            doubt(law.name, why)
            continue
        if rows["at"] == "explicit" and not _readable(table.explicit, rows):
            name = model.case.method.integrator.name
            doubt(f"{law.name} with {name}", f"{name} shows {law.name} its gap and acceleration of different times")
            continue
        if rows["at"] == "explicit":
            stiffness[where] = rows["gap"] / rows["sigma"]
            by_gap, _, by_acceleration = table.explicit.answer
            inertia[where] = (rows["gap"] * by_gap + rows["acceleration"] * by_acceleration) / rows["sigma"]
            predicted[where] = table.explicit.gap == "predicted"
            if table.explicit.gap == "predicted":
                surplus[where] = inertia[where] / stiffness[where] - table.end.answer[0]
        else:
            surplus[where] = 0.0
        if rows["rate"].any():
            tied += where
        else:
            compliance[where] = rows["sigma"] / rows["gap"]
        energy.append(_energy_of(model, where, rows, inert=bool(inertia[where].any())))
    if unknown and stages is None:
        energy.append((UNKNOWN, f"nothing is known: {'; '.join(dict.fromkeys(doubts))}"))
    resting = list(model.resting(0.5 * model.dt))
    stiffness[resting], inertia[resting], surplus[resting] = 0.0, 0.0, np.nan
    ties = tuple(p for p in tied if p not in resting)
    weakest, why = max(energy, key=lambda known: WEAKEST_LAST.index(known[0]))
    return Closed(
        stiffness,
        inertia,
        predicted,
        surplus,
        compliance,
        ties,
        tuple(unknown),
        tuple(dict.fromkeys(doubts)),
        weakest,
        why,
    )


def _not_followed(rows: dict[str, Any], law: str, *, staged: bool) -> str:
    """Return why neither stiffness and inertia nor a constraint follows from a law's row; empty if one does.

    Parameters
    ----------
    rows
        The row with one value a point.
    law
        Name of the law.
    staged
        Whether the integrator is a scheme of stages.
    """
    end = rows["at"] == "end"
    tie = end and bool(rows["rate"].all()) and not rows["gap"].any() and not rows["sigma"].any()
    reasons = {
        f"{law} is judged at the end of a step of stages, and no closed form of that is known": end and staged,
        f"{law} weighs the gap rate, which damps or drives": rows["rate"].any() and not tie,
        f"{law} ties the gap rate of its contacts, but not always or not both ways": (
            tie and (rows["active"] != "all" or rows["sign"] != "free")
        ),
        f"{law} does not weigh the gap": not rows["gap"].all() and not tie,
        f"{law} weighs the gap acceleration at the end of the step": end and rows["acceleration"].any(),
        f"{law} is judged at the current or predicted gap without a compliance (sigma = 0)": (
            not end and (rows["sigma"] <= 0).any()
        ),
    }
    return next((reason for reason, holds in reasons.items() if holds), "")


def _energy_of(model: Model, where: list[int], rows: dict[str, Any], *, inert: bool) -> tuple[str, str]:
    """Return what one law of readable rows guarantees of the energy at its points, and why."""
    table = model.tables[-1]
    if rows["during"] is not None:
        return NOT_GUARANTEED, INTERVALS
    if rows["at"] == "end":
        if rows["rate"].any():
            return NOT_GUARANTEED, TIES
        if rows["active"] == "gap < 0" and _share_an_end(model, where):
            return NOT_GUARANTEED, SHARED
        bilateral = rows["active"] == "all" and rows["sign"] == "free"
        return (NOT_GUARANTEED, BILATERAL) if bilateral else (NEVER_GROWS, BY_END)
    if table.explicit.gap == "current":
        return (NOT_GUARANTEED, PULLS) if inert else (BETWEEN, JUMPS)
    return (NOT_GUARANTEED, SHARED) if _share_an_end(model, where) else (NEVER_GROWS, BY_END)


def _readable(judged: Judged, rows: dict[str, Any]) -> bool:
    """Return whether stiffness and inertia of a closed contact follow from a law's rows with this table."""
    if judged.gap == "current":
        return judged.answer[0] == 0.0 and judged.acceleration == "bulk" and judged.answer[2] == 1.0
    return judged.acceleration == "none" or not rows["acceleration"].any()


def _share_an_end(model: Model, where: list[int]) -> bool:
    """Return whether a contact of `where` shares a node with any other: one then opens or closes what another saw."""
    nodes = [node for meeting in model.meetings for node in meeting.nodes]
    return any(nodes.count(node) > 1 for p in where for node in model.meetings[p].nodes)


class RowsJudge:
    """Judges steps by the rows of the laws: exact for any mesh and any combination of closed contacts.

    Central difference by the inertia of the closed pencil. In stages, laws judged at the current state make every mode
    of the closed pencil an oscillator, so that its inertia tells there too, at the step that brings central difference
    to its limit where it brings the scheme to its own.

    Laws judged at the predicted gap or at the end of the step: with ``u_{n+1} = u* + dt^2 M^-1 N lambda`` their
    multipliers are ``lambda = -F^-1 g_{n+1}``, ``F = diag(1/eps_s) + diag(eps_m/eps_s - dt^2) S``. Where F is
    symmetric and positive definite it is a spring at the end of the step, and no combination grows. It is symmetric
    where contacts that share an end have the same eps_m / eps_s; then the whole of such a group is the worst part of
    it. Where they have not, a part can be worse than the whole, and even with every theta at most 1 the step can grow:
    then amplification matrices are examined (`percuss.unalike`), or the judge says that it does not know.

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

    def _groups(self, laws: Closed) -> list[tuple[Any, bool]]:
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
            scale = np.abs(laws.surplus[group]).max() + np.abs(self.model.tables[-1].end.answer[0])
            out.append((group, bool(np.ptp(laws.surplus[group]) <= ALIKE * scale)))
        return out

    def _theta_of(self, part: Any, dt: float, laws: Closed) -> float:
        """Return ``dt^2 lambda_max((I + S D_m)^-1 S D_s)`` of some contacts judged at the predicted gap."""
        s = self.delassus[np.ix_(part, part)]
        left = np.eye(part.size) + s * laws.inertia[part]
        values = np.linalg.eigvals(np.linalg.solve(left, s * laws.stiffness[part]))
        return float(dt**2 * np.max(values.real))

    def theta(self, dt: float, laws: Closed) -> tuple[float | None, list[int]]:
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
        laws = closed(self.model, dt)
        finding = self._by_rows(dt, laws)
        if finding.stable and (unalike := self._unalike(laws)):
            return dataclasses.replace(self._by_matrix(dt, laws, unalike), theta=finding.theta)
        return finding

    def _by_rows(self, dt: float, laws: Closed) -> Finding:
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
        return Finding(False, group, theta)

    def _unalike(self, laws: Closed) -> list[Any]:
        """Return the groups of contacts that share ends and differ in eps_m / eps_s."""
        return [group for group, alike in self._groups(laws) if not alike]

    def _by_matrix(self, dt: float, laws: Closed, unalike: list[Any]) -> Finding:
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
    def _coarse(self) -> BlackBoxJudge | None:
        """The judge of steps above theta = 1, where a bar so short that contact damps all of it may stay stable."""
        short = any(body.stiffness.size < SHORT for body in self.model.bodies.values())
        return BlackBoxJudge(self.model) if short and 2 * self.model.mass.size <= DENSE else None

    @cached_property
    def free(self) -> float:
        """The largest step that is stable without contact."""
        return free_step(self.pencil) * self.reach

    def critical(self) -> float:
        """Return the largest stable step, laws bound anew for each step tried; nan where that is not known."""
        if self.free in {0.0, np.inf}:  # no step, or any: all nodes are held
            return self.free
        bound = critical_step(lambda dt: self._by_rows(dt, closed(self.model, dt)).stable, self.free)
        if not 0.0 < bound < np.inf or not self._unalike(closed(self.model, bound)):
            return bound
        # what grows because they are unalike does so at shorter steps too, ever more slowly: there is no critical one
        return bound if self.judge(bound * (1.0 - EDGE)).stable else np.nan


class EveryStretch:
    """The judges of all stretches of a run together: the worst of them speaks.

    Parameters
    ----------
    model
        The model of the whole run.
    kind
        `RowsJudge` or `BlackBoxJudge`.
    """

    def __init__(self, model: Model, kind: type[RowsJudge | BlackBoxJudge]) -> None:
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
    names = ", ".join(f"'{model.meetings[p].name}'" for p in points[:MOST_NAMED])
    more = len(points) - MOST_NAMED
    return f"{names} and {more} more" if more > 0 else names


class BlackBoxJudge:
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
        every = combinations(len(self.model.meetings))
        return every if self.model.stages is None else every[1:]

    def judge(self, dt: float) -> Finding:
        """Return what is to be said of a step, over the combinations of closed contacts that are tried."""
        doubt, radius, theta = "", -1.0, None
        worst: list[int] = []
        tried = self._tried
        if self.model.stages is not None and dt > self.free * (1.0 + EDGE):
            return Finding(False)
        complete = 2 ** len(self.model.meetings) == len(combinations(len(self.model.meetings)))
        if not complete:
            doubt = (
                "no growth was found with no contact, each one and all of them closed; other combinations can be worse"
            )
        for one in tried:
            found = examine(self.motions, dt, one, sure=dt < self.free and self._limits == [])
            if not found.linear:
                names = ", ".join(f"'{self.model.meetings[p].name}'" for p in one) or "none"
                doubt = f"the step is not linear with contacts {names} closed"
                if found.failure:
                    doubt = f"with contacts {names} held closed a kernel fails ({found.failure})"
                return Finding(False, list(one), doubt=doubt, known=False)
            if found.theta is not None and (theta is None or found.theta > theta):
                theta = found.theta
            if not found.stable:
                return Finding(False, list(one), found.theta)
            if not found.whole:
                complete = False
                doubt = "the model is large: growth was looked for by a Krylov iteration, and none found"
            if found.radius > radius * (1.0 + 1e-6):
                radius, worst = found.radius, list(one)
        if self._changing:
            names = ", ".join(self._changing)
            doubt = f"{names} changes with time, and no growth was found as it acts at the start"
        return Finding(True, worst, theta, doubt, known=complete and not self._changing)

    @cached_property
    def _changing(self) -> list[str]:
        """Names of laws with a kernel whose force changes with time."""
        end = self.model.whole.steps * self.model.whole.dt
        return [
            entry["law"].name
            for entry in self.model.laws
            if not isinstance(entry["bound"], Rows)
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


class ClosedForm:
    """Critical steps of uniform bars taken as endless: no mesh, no matrix.

    A harmonic that decays into an endless bar of elements h holds its end with the stiffness
    ``(EA/h)(2/C) sqrt(1/C^2 - 1)`` at the step dt = C h/c; central difference is stable while both ends in series are
    stiffer than ``eps_s - 4 eps_m / dt^2`` is soft. On a rigid wall ``C = sqrt(2 / (1 + sqrt(1 + beta_s^2)))`` for the
    penalty method. Wu's predictor-corrector is stable for ``theta <= 1``.

    Parameters
    ----------
    model
        The case as arrays.

    Raises
    ------
    NoClosedFormError
        If a bar is not uniform, or ends share contacts.
    """

    by = "closed-form"

    def __init__(self, model: Model) -> None:
        self.model = model
        if model.why_not_linear:
            raise NoClosedFormError(f"{model.why_not_linear}")
        if model.stages is not None:
            raise NoClosedFormError(f"{model.case.method.integrator.name} is no leap-frog scheme")
        self.sides: list[list[tuple[float, float]]] = []  # EA/h and 2c/h
        for body in model.bodies.values():
            if np.ptp(body.mesh.lengths) > 1e-9 * body.mesh.lengths.mean():
                raise NoClosedFormError(f"the elements of body '{body.name}' are unequal")
        nodes = [node for meeting in model.meetings for node in meeting.nodes]
        if len(set(nodes)) < len(nodes):
            raise NoClosedFormError("an end is in several contacts")
        if {hold.node for hold in Pencil(model).holds} & set(nodes):
            raise NoClosedFormError("an end in contact is fixed or driven")
        for meeting in model.meetings:
            ends = [(model.body_of(node), model.body_of(node).end_element(node)) for node in meeting.nodes]
            self.sides.append([(float(b.stiffness[e]), float(b.frequency[e])) for b, e in ends])
        self.free = 2.0 / model.omega

    def _stable(self, dt: float) -> bool:
        said = closed(self.model, dt)
        if said.unknown:
            raise NoClosedFormError("; ".join(said.doubts))
        if dt > self.free:
            return False
        for p, sides in enumerate(self.sides):
            if said.predicted[p]:
                # s = 1/m of each side, m = 2 (EA/h) / omega^2
                s = sum(frequency**2 / (2.0 * stiffness) for stiffness, frequency in sides)
                if dt**2 * said.stiffness[p] * s > 1.0 + said.inertia[p] * s:
                    return False
                continue
            excess = said.stiffness[p] - 4.0 * said.inertia[p] / dt**2
            courant = [0.5 * dt * frequency for _, frequency in sides]
            holds = [
                stiffness * 2.0 / c * np.sqrt(max(1.0 / c**2 - 1.0, 0.0))
                for (stiffness, _), c in zip(sides, courant, strict=True)
            ]
            if excess > 0 and sum(excess / h if h > 0 else np.inf for h in holds) > 1.0:
                return False
        return True

    def critical(self) -> float:
        """Return the critical step."""
        return critical_step(self._stable, self.free)


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
