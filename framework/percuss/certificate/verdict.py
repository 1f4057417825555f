"""Certificate of a run: the assessment of its stability before its first step."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.blas import one_blas_thread
from percuss.case.cross_checks import after_the_end
from percuss.case.quantities import percent
from percuss.certificate.assessment import MARGINAL_DISTANCE, Answer, Assessment, largest_step, named, quoted
from percuss.certificate.black_box import SMALLEST_SHARE_OF_FREE_STEP, BlackBox
from percuss.certificate.bounds import BOUND, Bounds
from percuss.certificate.closed_laws import (
    BETWEEN,
    BOUNDED,
    MOVED,
    NEVER_GROWS,
    NOT_GUARANTEED,
    RENEWED,
    UNKNOWN,
    ClosedLaws,
    closed_laws,
    why_unlike,
)
from percuss.certificate.criteria import RunCriterion, criterion_of, too_large, unknown_by_mass
from percuss.certificate.glance import Glance, looked_at_by_check, takes_longer_than_a_run
from percuss.certificate.lanczos import CHANCE, MARGIN, Lanczos, products_for
from percuss.certificate.linear_laws import doubts_of, linear_laws
from percuss.certificate.oscillator import limit_ratio
from percuss.contact.features import Verdict
from percuss.contact.frictions import frictional
from percuss.contact.laws import ignored_couplings
from percuss.contact.model import Model
from percuss.contact.moving_rows import complementary, of_every_step, with_rows_that_stay
from percuss.contact.sliding import turning
from percuss.errors import InputError, refuse_if_any
from percuss.jsonable import Entries
from percuss.march.model_of_case import model_of, with_laws, with_step
from percuss.mesh.stresses import tangent_as_declared

if TYPE_CHECKING:
    from percuss.case.case import Case

# Relative distance above the critical step at which the contacts that limit it are unstable and can be found.
DISTANCE_ABOVE_CRITICAL = 1e-6
# Entries of the summary of a run that need its critical step.
OF_CRITICAL_STEP = {f"certificate.{name}" for name in ("dt_critical", "courant_critical", "margin")}
# Share of the critical step that is chosen where the case leaves the step open.
SHARE_OF_CRITICAL_STEP = 0.9
USUAL_STRETCH = 2.0  # by which frequencies of finite strain may rise under an automatic step
# Relative tolerance of the option that is named as a cure, far below the digits that are printed.
CURE_TOLERANCE = 1e-10
LONGER = "longer steps may be stable where this one is not, or nothing is known of them"
LONG_RUN = 20  # times the products of a Lanczos run, which then costs little beside the march
NOT_ASKED = "a run does not search it unless it is asked for; `percuss check` does"
BY_LANCZOS = (
    "the highest frequency with closed contacts that a Lanczos run finds leaves the step stable; it misses a higher "
    f"one that does not with a probability below {CHANCE:g}"
)
TOLD = " (`percuss check` tells how fast they grow)"
NOT_LINEAR = "the closed step is not linear at longer steps"
EQUALS = "give contacts that share an end the same eps_m / eps_s, or evaluate contact at the current gap"


@dataclass(frozen=True)
class Finding:
    """What is found about the stability of a run.

    Attributes
    ----------
    stable
        Stability of the closed linear step: ``yes``, ``marginal``, ``no`` or ``unknown``.
    why
        Reason for that.
    energy, energy_why
        Energy guarantee of the pair of methods while contacts open and close, and the reason for it.
    ignores
        Sentences that name the laws that take no account of contacts at the same end.
    by
        Criterion: ``linear-laws``, ``black-box``, ``lanczos``, ``bounds`` or ``none``. What a Lanczos run says is `no`
        is proved; its `yes` fails with a probability below 1e-9.
    cure
        Cure of an unstable step.
    dt_critical, dt_critical_free
        Critical step, and that with no contact closed but those that are tied throughout. None where it is not known;
        with bodies that are not linear it never is, because it changes with the strain. Where theta of contacts that
        share nodes limits it, longer steps may be stable, and `why` says so. A run whose step the linear laws find
        stable has neither. By a Lanczos run the step without contact is at most 1 % too short; it is searched in runs
        of many steps alone.
    dt_critical_why
        Why the critical step is None; empty where it is known.
    dt_proven
        Step up to which no growth is proved without a search for the critical one; None where it is not asked for.
    dt_proven_why
        What proves it.
    courant_critical
        Courant number of the critical step.
    margin
        The step over the critical step.
    worst
        Names of the closed contacts that limit the step.
    stretch
        Start and stop of the decisive stretch of the run; None where supports, drives and acting laws never change.
    theta
        theta of Wu's predictor-corrector; None where it has no meaning.
    states
        With friction the stability while points are open or closed without friction, while they stick and while they
        slide; else None.
    """

    stable: Verdict
    why: str
    energy: str
    energy_why: str
    ignores: list[str]
    by: str = "none"
    cure: str = ""
    dt_critical: float | None = None
    dt_critical_free: float | None = None
    dt_critical_why: str = ""
    dt_proven: float | None = None
    dt_proven_why: str = ""
    courant_critical: float | None = None
    margin: float | None = None
    worst: list[str] = field(default_factory=list)
    stretch: list[float] | None = None
    theta: float | None = None
    states: dict[str, Verdict] | None = None


# The entries of a `Finding`, as the summary of a run has them.
Certificate = Entries
# What gives a run its certificate: `certificate`, or a function that asks for less.
Certify = Callable[[Model, RunCriterion | None], Certificate]


# ------------------------------------------------------------------------------------------------- the step of a run


class SettledRun(NamedTuple):
    """The model of a run with its step, and the criterion that found the critical step where that chose the step."""

    model: Model
    criterion: RunCriterion | None


@one_blas_thread()
@np.errstate(all="ignore")  # numbers that are not finite are refused or make a step unstable
def settled(case: Case) -> SettledRun:
    """Return the model of a case; where the case leaves the step open, choose a share of the critical step.

    Raises
    ------
    InputError
        If the case is wrong, no step is stable, or the run ends before something that the case expects of it.
    """
    run = _with_step(case)
    _refuse_after_the_end(case, run.model.steps * run.model.dt)
    return run


def _refuse_after_the_end(case: Case, end: float) -> None:
    """Refuse a case that expects something after the end of its run, where that is known of its model alone.

    A run that overrides change may end before what is expected of the case as it stands in its file.

    Raises
    ------
    InputError
        With all such expectations.
    """
    if not case.expect or case.origin.has_override("bodies", "contacts", "loads", "method", "refine", "time"):
        return
    late = [(one.path, after_the_end(one.during, one.at, end)) for one in case.expect]
    refuse_if_any([case.problem((*path, found[0]), *found[1:]) for path, found in late if found is not None])


def _with_step(case: Case) -> SettledRun:
    """Return the model of a case with its step."""
    model = model_of(case)
    if case.time.courant != "auto":
        return SettledRun(model, None)
    held, unknown = model.facts.held, "No step is known to be stable: give one."
    changes = f"The highest frequency changes with the strain, so that {unknown[0].lower()}{unknown[1:]}"
    finite = not any(body.is_bar for body in model.bodies.values() if body.why_not_linear)
    if case.time.stretch is not None and not (finite and model.bodies.why_not_linear):
        message, advice = "expected a body of finite strain, found none whose frequencies change", "Remove it."
        raise InputError([case.problem(("time", "stretch"), message, advice)])
    for expected, found, advice in (
        ("loads of which the critical step is known, found that", held is None and model.why("certificate"), unknown),
        ("a diagonal mass and ends in contact with mass, or linear laws, found that", unknown_by_mass(model), unknown),
        ("linear bodies, found that", "" if finite else model.bodies.why_not_linear, changes),
    ):
        if found:
            raise InputError([case.problem(("time", "courant"), f"expected {expected} {found}", advice)])
    if model.bodies.why_not_linear:  # the loop watches its frequencies
        share = SHARE_OF_CRITICAL_STEP / (case.time.stretch or USUAL_STRETCH)
        return SettledRun(with_step(model, share * 2.0 / model.bodies.omega), None)
    limit, criterion = np.inf, None
    # With a given number of steps, a shorter step ends the run earlier, so other drives may act during the run, and the
    # critical step may change with them. The loop ends when the critical step does not fall any more.
    while True:
        criterion = criterion_of(held(model) if held is not None else model, criterion, quickly=True)
        critical = criterion.critical_step
        # A tiny critical step is no stability: growth may be too slow to show in a single step of that length.
        known = SMALLEST_SHARE_OF_FREE_STEP * criterion.free < critical < np.inf
        if not known or criterion.assess_step(SHARE_OF_CRITICAL_STEP * critical).answer == "unknown":
            message = "expected methods of which some step is known to be stable"
            advice = f"{capitalised(no_step(model, criterion.free, critical))}." if critical == 0.0 else "Give a step."
            raise InputError([case.problem(("time", "courant"), message, advice)])
        if critical >= limit * (1.0 - MARGINAL_DISTANCE):
            return SettledRun(model, criterion)
        limit = critical
        model = with_step(model, SHARE_OF_CRITICAL_STEP * critical)


# ------------------------------------------------------------------------------------------------------- certificate


def certificate(model: Model, criterion: RunCriterion | None = None) -> Certificate:
    """Return the certificate of a run, with its critical step.

    Each stretch of the run with its own supports, drives and acting laws is assessed, and the worst of them decides.

    Parameters
    ----------
    model
        The case as arrays.
    criterion
        The criterion of this run, if `settled` has searched the critical step already.
    """
    return dataclasses.asdict(_finding(model, criterion, search=True))


def verdict_alone(model: Model, criterion: RunCriterion | None = None) -> Certificate:
    """Return the certificate of a run, which searches a critical step only where the step is unstable.

    Not even there if the black box alone can tell it: that takes many times as long as to examine one step. Of solids
    that is left to `certificate` too, but for growth that few products show.
    """
    return dataclasses.asdict(_finding(model, criterion, search=False))


def unasked(model: Model, criterion: RunCriterion | None = None) -> Certificate:  # noqa: ARG001
    """Return the certificate of a run about which nobody has asked, so that nothing is known of its step."""
    return dataclasses.asdict(_unknown(model, closed_laws(model, model.dt), "nobody has asked for a verdict"))


def _unknown(model: Model, laws: ClosedLaws, why: str, **known: Any) -> Finding:
    """Return what is found where nothing is known of a step, but for what is `known`."""
    found = Finding("unknown", why, laws.energy, laws.why, ignored_couplings(model), dt_critical_why=why)
    return dataclasses.replace(found, **known)


@one_blas_thread()
@np.errstate(all="ignore")
def _finding(model: Model, criterion: RunCriterion | None, *, search: bool) -> Finding:
    """Return what is found about a run: with and without the rows in which closed contacts may hold their bodies."""
    if (held := model.facts.held) is not None:
        slides, rubs, stuck = model.contact_points.slides.any(), bool(frictional(model)), held(model)
        # The black box looks at each of the many lines of stick, which takes far longer than the run itself.
        if rubs and not search and doubts_of(stuck):
            sticking = _unknown(stuck, closed_laws(stuck, stuck.dt), looked_at_by_check(stuck))
        else:
            sticking = _found(stuck, criterion, search=search)
        apart = sticking
        if rubs:  # where rows move those of the start are examined, as they are without friction
            apart = _found(with_rows_that_stay(model) if slides else model, None, search=search)
        when, held_name, other = model.facts.held_words
        states: dict[str, Verdict] = {"open": apart.stable, held_name: sticking.stable, other: "unknown"}
        worst = next((one for one in (apart, sticking) if one.stable == "no"), None)
        if worst is not None:
            return dataclasses.replace(worst, states=states)
        told = TOLD if rubs and not search else ""
        why = f"{model.why('certificate')}{told}. {when}: {sticking.stable}, {sticking.why}"
        if slides:
            why = f"{why}. {capitalised(of_every_step(model))}"
        return dataclasses.replace(
            sticking, stable="unknown", why=why, energy=apart.energy, energy_why=apart.energy_why, states=states
        )
    found = _found(model, criterion, search=search)
    if why := model.why("certificate"):
        why = f"{why}, which can make a stable step unstable and an unstable one stable; without it, {found.why}"
        known = {name: getattr(found, name) for name in ("energy", "energy_why", "by", "stretch", "theta")}
        return _unknown(model, closed_laws(model, model.dt), why, **known)
    return found


def _found(model: Model, criterion: RunCriterion | None, *, search: bool) -> Finding:
    """Return what is found about a run, by the criterion that covers it."""
    laws = closed_laws(model, model.dt)
    large = too_large(model)
    if model.bodies.why_not_linear and not large:
        return _about_nonlinear_bodies(model, laws)
    if why := model.bodies.why_not_linear or unknown_by_mass(model) or model.why("criterion"):
        return _unknown(model, laws, why)
    if criterion is None and not (search or large) and doubts_of(model) and takes_longer_than_a_run(model):
        criterion = RunCriterion(model, Glance)
    elif criterion is None or (search and criterion.kind is Lanczos):
        criterion = criterion_of(model, quickly=not search)
    else:
        search = True  # it has found the critical step already
    if criterion.kind in {Bounds, Lanczos, Glance}:
        return _about_solids(criterion, laws)
    return _about_linear_bodies(criterion, laws, search=search)


def _about_solids(criterion: RunCriterion, laws: ClosedLaws) -> Finding:
    """Return what is found about a run of solids whose motions are not factored, nor given to the black box."""
    model, dt = criterion.model, criterion.model.dt
    assessment = criterion.assess_step(dt)
    by, proven = assessment.by or criterion.by, criterion.proven_step
    known: dict[str, Any] = {"by": by, "dt_critical_why": too_large(model) or NOT_ASKED}
    known["stretch"] = criterion.times(assessment)
    verdicts: dict[Answer, Verdict] = {"stable": "yes", "grows": "no"}
    stable = verdicts.get(assessment.answer, "unknown")
    energy, energy_why = _energy_guarantee(model, laws, assessment, stable)
    known |= {"stable": stable, "energy": energy, "energy_why": energy_why}
    if not np.isnan(proven):
        known |= {"dt_proven": proven, "dt_proven_why": BOUND}
    if model.steps > LONG_RUN * products_for(MARGIN, model.bodies.mass_of_dofs.size) and criterion.kind is Lanczos:
        known["dt_critical_free"] = criterion.free * math.sqrt(1.0 - MARGIN)
    if assessment.answer == "unknown":
        alone = "; the step is below the bound of the cells, so that the bodies alone are stable"
        below = dt < 2.0 * limit_ratio(model) / model.bodies.omega * (1.0 - MARGINAL_DISTANCE)
        return _unknown(model, laws, f"{assessment.doubt}{alone if below else ''}", **known | {"by": "none"})
    if assessment.answer == "grows":
        critical = criterion.critical_step
        worst = named(criterion.names, assessment.worst)
        closed = f" with closed contacts {quoted(criterion.names, assessment.worst)}" if worst else " without contact"
        shows = "the step itself" if by == BlackBox.by else "its frequency"
        why = f"a motion{closed} grows in each step of {dt:.6g}, as {shows} shows"
        if critical <= 0:
            cure = no_step(model, criterion.free, critical)
        else:
            cure = cure_of(criterion, critical, searched=criterion.kind is not Glance)
        return _unknown(model, laws, why, **known, worst=worst, cure=cure)
    why = f"the step is {percent(dt / proven, 6)} of {proven:.6g}, {BOUND}" if by == Bounds.by else BY_LANCZOS
    return _unknown(model, laws, why, **known)


def _about_linear_bodies(criterion: RunCriterion, laws: ClosedLaws, *, search: bool) -> Finding:
    model, black_box = criterion.model, criterion.kind is BlackBox
    assessment = criterion.assess_step(model.dt)
    # Where nothing is certain about the step of the run nothing is about longer ones, and a search takes long.
    searched = assessment.conclusive and (search or not (black_box or assessment.stable))
    critical, critical_why = (criterion.critical_step, LONGER) if searched else (np.nan, NOT_ASKED)
    alone = assessment.conclusive and assessment.stable and not searched
    if alone and black_box and model.dt > criterion.free * (1.0 - MARGINAL_DISTANCE):
        critical = criterion.free
    elif alone and not black_box and not criterion.assess_step(model.dt * (1.0 + MARGINAL_DISTANCE)).stable:
        critical = model.dt
    if searched and np.isnan(critical) and black_box and model.period == 1:
        unsure: Answer = "no growth found" if assessment.stable else "unknown"
        assessment = dataclasses.replace(assessment, answer=unsure, doubt=NOT_LINEAR)
    if assessment.conclusive and assessment.stable and not np.isnan(critical):
        # Where growth becomes ever slower at shorter steps, that of this one is too slow to be seen.
        critical = max(critical, min(model.dt, criterion.free)) if critical > 0.0 or criterion.free == 0.0 else np.nan
    if assessment.answer == "grows" and black_box and (unlike := why_unlike(model)):
        assessment = dataclasses.replace(assessment, doubt=unlike)
    if assessment.conclusive and 0.0 < critical < criterion.free * (1.0 - MARGINAL_DISTANCE):
        # The contacts that limit the step are those with which a step just above the critical one is unstable.
        limiting = criterion.assess_step(critical * (1.0 + DISTANCE_ABOVE_CRITICAL))
        if not limiting.stable:
            doubt = assessment.doubt if limiting.conclusive else limiting.doubt
            assessment = dataclasses.replace(assessment, worst=limiting.worst, stretch=limiting.stretch, doubt=doubt)
    if not assessment.conclusive or (not assessment.stable and critical > model.dt * (1.0 + MARGINAL_DISTANCE)):
        critical = np.nan  # A longer step may be stable where this one is not, so the limit is not known.
    found = _judged(criterion, laws, assessment, critical)
    energy, energy_why = _energy_guarantee(model, laws, assessment, found.stable)
    known: dict[str, Any] = {"energy": energy, "energy_why": energy_why}
    if not (alone and not black_box and np.isnan(critical)):  # such a step is below that of the bodies alone
        known["dt_critical_free"] = criterion.free
    known["dt_critical_why"] = assessment.doubt or critical_why
    if not np.isnan(critical):
        margin = model.dt / critical if critical > 0 else np.inf
        known |= {"dt_critical": critical, "courant_critical": 0.5 * critical * model.bodies.omega, "margin": margin}
        known["dt_critical_why"] = ""
    known["stretch"] = criterion.times(assessment)
    if found.stable == "no":
        known["cure"] = cure_of(criterion, critical, searched=searched)
    return dataclasses.replace(found, **known)


def _about_nonlinear_bodies(model: Model, laws: ClosedLaws) -> Finding:
    """Return what is found about a run with bodies that are not linear.

    Their highest frequency changes with the strain, so no step is known to be stable. A step that is unstable for
    small motions about rest is known to be unstable, provided the bodies are as stiff about rest as they declare.
    """
    why = f"{model.bodies.why_not_linear}, and its highest frequency changes with the strain"
    if doubts_of(model) or not tangent_as_declared(model.bodies.values()):
        return _unknown(model, laws, why)
    criterion = criterion_of(model, quickly=True)
    assessment = criterion.assess_step(model.dt)
    critical = criterion.critical_step if assessment.conclusive else np.nan
    found = _judged(criterion, laws, assessment, critical)
    about_rest = f"for small motions about rest {found.why}"
    if found.stable != "no":
        return _unknown(model, laws, f"{why}; {about_rest}")
    cure = f"lower the step below {round_down(critical)}, the critical step of small motions about rest"
    cure = cure if critical > 0 else no_step(model, criterion.free, critical)
    return dataclasses.replace(found, why=about_rest, cure=cure, dt_critical_why=why)


def _judged(criterion: RunCriterion, laws: ClosedLaws, assessment: Assessment, critical: float) -> Finding:
    """Return the verdict on the step of a run, and what it follows from."""
    stable, why = _verdict(criterion, assessment, critical)
    worst = named(criterion.names, assessment.worst)
    known = {"stable": stable, "by": criterion.by, "worst": worst, "theta": assessment.theta}
    return _unknown(criterion.model, laws, why, **known)


def _verdict(criterion: RunCriterion, assessment: Assessment, critical: float) -> tuple[Verdict, str]:
    """Return the verdict on the closed linear step, and the reason for it in words."""
    model, dt = criterion.model, criterion.model.dt
    # A step that is stable is below that of the bodies alone.
    if not (assessment.conclusive and assessment.stable and np.isnan(critical)):
        if criterion.free == 0.0:
            return "no", f"{model.case.method.integrator.name} is unstable at any step, without contact too"
        if dt > criterion.free * (1.0 + MARGINAL_DISTANCE):
            courant = f"Courant number {model.courant:.6g}"
            why = f"the step {dt:.6g} ({courant}) is above {criterion.free:.6g}, what the bodies allow"
            return "no", f"{why} {criterion.nothing_closed()}"
    when = ""
    if times := criterion.times(assessment):
        when = f", with the supports and drives from {times[0]:.6g} to {times[1]:.6g}"
    if not assessment.conclusive:
        allowed = f"{criterion.nothing_closed()} the bodies allow {criterion.free:.6g}"
        return "unknown", f"{assessment.doubt}{when}; {allowed}"
    noun = "contacts" if len({criterion.names[p] for p in assessment.worst}) > 1 else "contact"
    combination = criterion.nothing_closed(assessment.stretch, "with all contacts open")
    if assessment.worst:
        combination = f"with closed {noun} {quoted(criterion.names, assessment.worst)}"
    more = f"; theta = {assessment.theta:.6g}" if assessment.theta is not None else ""
    more += f" ({assessment.doubt})" if assessment.doubt else ""
    return _compare_with_critical(dt, critical, f"{combination}{when}{more}", stable=assessment.stable)


def _compare_with_critical(dt: float, critical: float, combination: str, *, stable: bool) -> tuple[Verdict, str]:
    """Return the verdict from a step and the critical step, nan where that is not known, and the reason in words."""
    margin = np.inf if critical <= 0.0 else dt / critical  # A margin of nan is neither above nor below any number.
    if margin > 1.0 + MARGINAL_DISTANCE:
        digits = 6 if margin > 1.0 + 1e-5 else 12
        return "no", f"the step {dt:.{digits}g} is above {critical:.{digits}g}, the critical step {combination}"
    if margin >= 1.0 - MARGINAL_DISTANCE:
        return "marginal", f"the step is the critical one {combination}"
    if not stable:
        return "no", f"the step {dt:.6g} is unstable {combination}"
    if np.isnan(critical):
        nothing = "nothing grows in any set of closed contacts; the critical step is not known"
        return "yes", f"at the step {dt:.6g} {nothing}"
    return "yes", f"the step is {percent(margin, 6)} of {critical:.6g}, the critical step {combination}"


def _energy_guarantee(model: Model, laws: ClosedLaws, assessment: Assessment, verdict: Verdict) -> tuple[str, str]:
    """Return the energy guarantee of the pair of methods in this run, and the reason for it in words."""
    if laws.energy in {NEVER_GROWS, BETWEEN}:
        if verdict == "no" or (assessment.theta is not None and assessment.theta >= 1.0):
            more = ", with theta below 1" if assessment.theta is not None else ""
            return NOT_GUARANTEED, f"that takes a stable closed step{more}"
        if laws.energy == NEVER_GROWS and (reason := _stiffened_contacts(model, laws)):
            return NOT_GUARANTEED, reason
    if turning(model.case):
        return (BOUNDED, RENEWED) if laws.energy != UNKNOWN and complementary(model) else (NOT_GUARANTEED, MOVED)
    return laws.energy, laws.why


def _stiffened_contacts(model: Model, laws: ClosedLaws) -> str:
    """Return a sentence about the first contacts that the start or end of a drive stiffens; empty if there are none.

    A drive changes s of the contact. The stiffness at the end of the step,
    ``kappa = 1 / (1/eps_s + (eps_m/eps_s - dt^2) s)``, rises with s where eps_m / eps_s is below dt^2 and falls with s
    where it is above. The energy stored in a closed contact rises with kappa, without any work being done.
    """
    names, pressing = model.contact_points.names, laws.predicted & (laws.stiffness > 0)
    weight = np.where(pressing, laws.surplus, 0.0)
    starts = [first for first, _ in model.segments()]
    softness = [laws.compliance + weight * model.rows_at((first + 0.5) * model.dt).delassus for first in starts]
    for first, before, after in zip(starts[1:], softness, softness[1:], strict=False):
        if stiffer := [int(p) for p in np.flatnonzero(after < before * (1.0 - 1e-12))]:
            where = f"at {first * model.dt:.6g} a drive starts or ends at contact {quoted(names, stiffer)}"
            return f"{where}: what it stores while closed rises there, and no work goes with that"
    return ""


# ------------------------------------------------------------------------------------------------------------- cures


def no_step(model: Model, free: float, critical: float, *, searched: bool = True) -> str:
    """Return the cure where no step is known to be stable.

    It is another integrator if that holds without contact, a shorter step if the critical one is not known (nan), as it
    was searched in vain or not at all, else another law.
    """
    name = model.case.method.integrator.name
    if free == 0.0:
        return f"take another integrator: {name} is unstable at any step, without contact too"
    if not searched:
        return "lower the step: `percuss check` searches how far"
    if np.isnan(critical):
        return "lower the step; how far is not known, as its critical value was not found"
    return "take another law: with this one no step is stable"


def cure_of(criterion: RunCriterion, critical: float, *, searched: bool = True) -> str:
    """Return the cheapest cures of an unstable step, with their numbers."""
    model = criterion.model
    if why_unlike(model):
        return EQUALS
    cures = []
    if critical > 0:
        courant = round_down(0.5 * critical * model.bodies.omega)
        cures.append(f"lower the step to {round_down(critical)} (Courant number {courant})")
    for law in (bound_law.law for bound_law in model.laws):
        for option in law.stiffening:
            value = getattr(law, option, None)
            if isinstance(value, float) and criterion.kind is linear_laws:
                limit = largest_stable_value(criterion, law, option, value)
                if limit is not None:
                    cures.append(f"set {option} of {law.name} to at most {round_down(limit)}")
    if np.isnan(critical) and model.why("cure"):
        cures.append(model.why("cure"))
    elif np.isnan(critical) or not cures:
        cures.append(no_step(model, criterion.free, critical, searched=searched))
    return ", or ".join(cures)


def capitalised(sentence: str) -> str:
    """Return a sentence with a capital first letter."""
    return sentence[:1].upper() + sentence[1:]


def round_down(value: float) -> str:
    """Return a number in six digits, rounded down, so that the step or option named as a cure is really stable."""
    digit = 10.0 ** (np.floor(np.log10(value)) - 5)
    return f"{np.floor(value * (1.0 - 1e-9) / digit) * digit:.6g}"


def largest_stable_value(criterion: RunCriterion, law: Any, option: str, value: float) -> float | None:
    """Return the largest value of a law's option, below its present `value`, with which the step is stable.

    None if the step is unstable with a thousand-millionth of the present value, too.
    """
    model = criterion.model

    def excess(candidate: float) -> float:
        changed = with_laws(model, {law: dataclasses.replace(law, **{option: candidate})})
        return -1.0 if RunCriterion(changed, linear_laws).assess_step(model.dt).stable else 1.0

    if excess(value * 1e-9) > 0.0:
        return None
    return min(value, largest_step(excess, value, CURE_TOLERANCE))
