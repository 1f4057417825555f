"""Certificate of a run: the assessment of its stability before its first step."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, TypedDict

import numpy as np

from percuss.blas import one_blas_thread
from percuss.case.cross_checks import after_the_end
from percuss.case.quantities import percent
from percuss.certificate.assessment import Answer, Assessment, Criterion, quoted
from percuss.certificate.bounds import BOUND, BoundsCriterion
from percuss.certificate.closed_contacts import BETWEEN, NEVER_GROWS, NOT_GUARANTEED, ClosedContacts, closed_contacts
from percuss.certificate.criteria import RunCriterion, contact_names, operator_criterion, step_criterion
from percuss.certificate.cures import capitalised, cure_of, no_step, round_down
from percuss.certificate.search import MARGINAL_DISTANCE
from percuss.contact.features import Verdict
from percuss.errors import InputError, refuse_if_any
from percuss.march.model import Model
from percuss.mesh.size_limits import MOST_FACTORED
from percuss.mesh.stresses import tangent_as_declared

if TYPE_CHECKING:
    from percuss.case.case import Case

# Share of the free step below which a critical step counts as none, as growth may be too slow to show in one step.
SMALLEST_SHARE_OF_FREE_STEP = 1e-4
# Relative distance above the critical step at which the contacts that limit it are unstable and can be found.
DISTANCE_ABOVE_CRITICAL = 1e-6
# Share of the critical step that is chosen where the case leaves the step open.
SHARE_OF_CRITICAL_STEP = 0.9
NOT_SEARCHED = "only the step itself can tell it, and a run does not search it; `percuss check` does"
LONGER = "longer steps may be stable where this one is not, or nothing is known of them"


class Certificate(TypedDict):
    """The certificate of a run.

    Attributes
    ----------
    stable
        Stability of the closed linear step: ``yes``, ``marginal``, ``no`` or ``unknown``.
    energy, energy_why
        Energy guarantee of the pair of methods while contacts open and close, and the reason for it.
    dt_critical, dt_critical_free
        Critical step, and that with no contact closed but those that are tied throughout. None where it is not known;
        with bodies that are not linear it never is, because it changes with the strain. Where theta of contacts that
        share nodes limits it, longer steps may be stable, and `why` says so.
    dt_critical_why
        Why the critical step is None; empty where it is known.
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
    by
        Criterion: ``pencil``, ``bounds``, ``black-box`` or ``none``.
    why, cure
        Reason for the verdict, and the cure of an unstable step.
    ignores
        Sentences that name the laws that take no account of contacts at the same end.
    """

    stable: Verdict
    energy: str
    energy_why: str
    dt_critical: float | None
    dt_critical_free: float | None
    dt_critical_why: str
    courant_critical: float | None
    margin: float | None
    worst: list[str]
    stretch: list[float] | None
    theta: float | None
    by: str
    why: str
    cure: str
    ignores: list[str]


# What gives a run its certificate: `certificate`, or a function that asks for less.
Certify = Callable[[Model, RunCriterion | None], Certificate]


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
    model = Model(case)
    if case.time.courant != "auto":
        return SettledRun(model, None)
    unknown = "No step is known to be stable: give one."
    changes = f"The highest frequency changes with the strain, so that {unknown[0].lower()}{unknown[1:]}"
    for expected, found, advice in (
        ("loads of which the critical step is known, found that", model.why("certificate"), unknown),
        ("a diagonal mass and ends in contact with mass, or linear laws, found that", unknown_by_mass(model), unknown),
        ("linear bodies, found that", model.bodies.why_not_linear, changes),
    ):
        if found:
            raise InputError([case.problem(("time", "courant"), f"expected {expected} {found}", advice)])
    limit, criterion = np.inf, None
    # With a given number of steps, a shorter step ends the run earlier, so other drives may act during the run, and the
    # critical step may change with them. The loop ends when the critical step does not fall any more.
    while True:
        criterion = criterion_of(model, criterion)
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
        model = model.with_step(SHARE_OF_CRITICAL_STEP * critical)


def criterion_of(model: Model, other_step: RunCriterion | None = None) -> RunCriterion:
    """Return the criterion of a run: the pencil if it covers all of its laws, else the black box.

    Of bodies that are too large to factor it is that of bounds.

    Parameters
    ----------
    model
        The model of the run.
    other_step
        The criterion of the same run with another step, if there is one.
    """
    kind: Callable[[Model], Criterion] = operator_criterion
    if too_large(model):
        kind = BoundsCriterion
    elif closed_contacts(model, model.dt).doubts:
        kind = step_criterion
    return RunCriterion(model, kind, other_step)


@one_blas_thread()
@np.errstate(all="ignore")
def certificate(model: Model, criterion: RunCriterion | None = None, *, with_critical_step: bool = True) -> Certificate:
    """Return the certificate of a run.

    Each stretch of the run with its own supports, drives and acting laws is assessed, and the worst of them decides.

    Parameters
    ----------
    model
        The case as arrays.
    criterion
        The criterion of this run, if `settled` has searched the critical step already.
    with_critical_step
        Whether to search the critical step too where only the step itself can tell it and `criterion` is None, which
        takes many times as long as to examine the step of the run; without it that is not known.
    """
    large = too_large(model)
    if model.bodies.why_not_linear and not large:
        found = _certificate_of_nonlinear_bodies(model)
    elif why := model.bodies.why_not_linear or unknown_by_mass(model) or model.why("criterion"):
        found = _unknown_certificate(model, why)
    elif large:
        found = _certificate_by_bounds(criterion or criterion_of(model))
    else:
        known = with_critical_step or criterion is not None
        found = _certificate_of_linear_bodies(model, criterion or criterion_of(model), known)
    if why := model.why("certificate"):
        why = f"{why}, which can make a stable step unstable and an unstable one stable; without it, {found['why']}"
        found = found | {"stable": "unknown", "why": why, "cure": "", "worst": []}
        found = found | {"dt_critical": None, "dt_critical_free": None, "courant_critical": None, "margin": None}
        found["dt_critical_why"] = why
    return found


def verdict_alone(model: Model, criterion: RunCriterion | None = None) -> Certificate:
    """Return the certificate of a run, which searches no critical step that only the step itself can tell."""
    return certificate(model, criterion, with_critical_step=False)


def unasked(model: Model, criterion: RunCriterion | None = None) -> Certificate:  # noqa: ARG001
    """Return the certificate of a run about which nobody has asked, so that nothing is known of its step."""
    return _unknown_certificate(model, "nobody has asked for a verdict")


def too_large(model: Model) -> bool:
    """Return whether a body is too large to be factored, which would take minutes and much memory."""
    return model.dim == 3 and any(body.mass.size > MOST_FACTORED for body in model.bodies.values())


def _certificate_by_bounds(criterion: RunCriterion) -> Certificate:
    model, assessment = criterion.model, criterion.assess_step(criterion.model.dt)
    not_factored = f"a body of more than {MOST_FACTORED} nodes in three dimensions is not factored"
    if not assessment.stable:
        alone = "; the step is below the bound of the cells, so that the bodies alone are stable"
        below = model.dt < criterion.free * (1.0 - MARGINAL_DISTANCE)
        return _unknown_certificate(model, f"{not_factored}, and {assessment.doubt}{alone if below else ''}")
    bound = criterion.critical_step
    why = f"the step is {percent(model.dt / bound, 6)} of {bound:.6g}, {BOUND}; {not_factored}"
    energy, energy_why = _energy_guarantee(model, assessment, "yes")
    found = _unknown_certificate(model, f"{why}, so that the critical step is not known")
    return found | {"stable": "yes", "by": criterion.by, "energy": energy, "energy_why": energy_why}


def _certificate_of_linear_bodies(model: Model, criterion: RunCriterion, with_critical_step: bool) -> Certificate:
    free, assessment = criterion.free, criterion.assess_step(model.dt)
    # Where nothing is certain about the step itself nothing is about longer ones, and a search takes long.
    searched = assessment.conclusive and (with_critical_step or criterion.kind is not step_criterion)
    critical, critical_why = (criterion.critical_step, LONGER) if searched else (np.nan, NOT_SEARCHED)
    if assessment.conclusive and not searched and assessment.stable and model.dt > free * (1.0 - MARGINAL_DISTANCE):
        critical = free
    if searched and np.isnan(critical) and criterion.kind is step_criterion and model.period == 1:
        unsure: Answer = "no growth found" if assessment.stable else "unknown"
        assessment = dataclasses.replace(
            assessment, answer=unsure, doubt="the closed step is not linear at longer steps"
        )
    if assessment.conclusive and assessment.stable and not np.isnan(critical):
        critical = max(critical, min(model.dt, free))
    if assessment.conclusive and 0.0 < critical < free * (1.0 - MARGINAL_DISTANCE):
        # The contacts that limit the step are those with which a step just above the critical one is unstable.
        limiting = criterion.assess_step(critical * (1.0 + DISTANCE_ABOVE_CRITICAL))
        if not limiting.stable:
            assessment = dataclasses.replace(assessment, worst=limiting.worst, stretch=limiting.stretch)
            if not limiting.conclusive:
                assessment = dataclasses.replace(assessment, doubt=limiting.doubt)
    if not assessment.conclusive or (not assessment.stable and critical > model.dt * (1.0 + MARGINAL_DISTANCE)):
        critical = np.nan  # A longer step may be stable where this one is not, so the limit is not known.
    found = _judged(criterion, assessment, critical) | {"dt_critical_free": free}
    found["dt_critical_why"] = "" if not np.isnan(critical) else assessment.doubt or critical_why
    found["energy"], found["energy_why"] = _energy_guarantee(model, assessment, found["stable"])
    if not np.isnan(critical):
        margin = model.dt / critical if critical > 0 else np.inf
        found |= {"dt_critical": critical, "courant_critical": 0.5 * critical * model.bodies.omega, "margin": margin}
    if len(criterion.stretches) > 1:
        stretch = criterion.stretches[assessment.stretch]
        found["stretch"] = [stretch.start, stretch.stop]
    if found["stable"] == "no":
        found["cure"] = assessment.cure or cure_of(criterion, critical, searched=searched)
    return found


def _judged(criterion: RunCriterion, assessment: Assessment, critical: float) -> Certificate:
    """Return the certificate of a run with the verdict on its step, and what the verdict follows from."""
    verdict, why = _verdict(criterion, assessment, critical)
    worst = list(dict.fromkeys(criterion.names[p] for p in assessment.worst))
    found = _unknown_certificate(criterion.model, why)
    found |= {"stable": verdict, "by": criterion.by, "worst": worst, "theta": assessment.theta}
    return found


def unknown_by_mass(model: Model) -> str:
    """Return why no criterion covers the mass of a model; empty if one does.

    Ends without mass, and masses that couple nodes, are examined by the pencil alone.
    """
    what = model.why("kernels")
    doubts = closed_contacts(model, model.dt).doubts if what else ()
    return f"{what}, and {'; '.join(doubts)}" if doubts else ""


def _unknown_certificate(model: Model, why: str) -> Certificate:
    """Return the certificate of a run about whose step nothing is known, with the reason in words."""
    laws = closed_contacts(model, model.dt)
    return {
        "stable": "unknown",
        "energy": laws.energy,
        "energy_why": laws.why,
        "dt_critical": None,
        "dt_critical_free": None,
        "dt_critical_why": why,
        "courant_critical": None,
        "margin": None,
        "worst": [],
        "stretch": None,
        "theta": None,
        "by": "none",
        "why": why,
        "cure": "",
        "ignores": model.ignored_couplings(),
    }


def _certificate_of_nonlinear_bodies(model: Model) -> Certificate:
    """Return the certificate of a run with bodies that are not linear.

    Their highest frequency changes with the strain, so no step is known to be stable. A step that is unstable for
    small motions about rest is known to be unstable, provided the bodies are as stiff about rest as they declare.
    """
    why = f"{model.bodies.why_not_linear}, and its highest frequency changes with the strain"
    if closed_contacts(model, model.dt).doubts or not tangent_as_declared(model.bodies.values()):
        return _unknown_certificate(model, why)
    criterion = criterion_of(model)
    assessment = criterion.assess_step(model.dt)
    critical = criterion.critical_step if assessment.conclusive else np.nan
    found = _judged(criterion, assessment, critical)
    about_rest = f"for small motions about rest {found['why']}"
    if found["stable"] != "no":
        return _unknown_certificate(model, f"{why}; {about_rest}")
    lower = f"lower the step below {round_down(critical)}, the critical step of small motions about rest"
    found |= {"dt_critical_why": why}
    return found | {"why": about_rest, "cure": lower if critical > 0 else no_step(model, criterion.free, critical)}


def _verdict(criterion: RunCriterion, assessment: Assessment, critical: float) -> tuple[Verdict, str]:
    """Return the verdict on the closed linear step, and the reason for it in words."""
    model, dt, free = criterion.model, criterion.model.dt, criterion.free
    if free == 0.0:
        return "no", f"{model.case.method.integrator.name} is unstable at any step, without contact too"
    if dt > free * (1.0 + MARGINAL_DISTANCE):
        courant = f"Courant number {model.courant:.6g}"
        why = f"the step {dt:.6g} ({courant}) is above {free:.6g}, what the bodies allow"
        return "no", f"{why} {criterion.nothing_closed()}"
    when = ""
    if len(criterion.stretches) > 1:
        stretch = criterion.stretches[assessment.stretch]
        when = f", with the supports and drives from {stretch.start:.6g} to {stretch.stop:.6g}"
    if not assessment.conclusive:
        return "unknown", f"{assessment.doubt}{when}; {criterion.nothing_closed()} the bodies allow {free:.6g}"
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


def _energy_guarantee(model: Model, assessment: Assessment, verdict: Verdict) -> tuple[str, str]:
    """Return the energy guarantee of the pair of methods in this run, and the reason for it in words."""
    laws = closed_contacts(model, model.dt)
    if laws.energy in {NEVER_GROWS, BETWEEN}:
        if verdict == "no" or (assessment.theta is not None and assessment.theta >= 1.0):
            more = ", with theta below 1" if assessment.theta is not None else ""
            return NOT_GUARANTEED, f"that takes a stable closed step{more}"
        if laws.energy == NEVER_GROWS and (reason := _stiffened_contacts(model, laws)):
            return NOT_GUARANTEED, reason
    return laws.energy, laws.why


def _stiffened_contacts(model: Model, laws: ClosedContacts) -> str:
    """Return a sentence about the first contacts that the start or end of a drive stiffens; empty if there are none.

    A drive changes s of the contact. The stiffness at the end of the step,
    ``kappa = 1 / (1/eps_s + (eps_m/eps_s - dt^2) s)``, rises with s where eps_m / eps_s is below dt^2 and falls with s
    where it is above. The energy stored in a closed contact rises with kappa, without any work being done.
    """
    pressing = laws.predicted & (laws.stiffness > 0)
    weight = np.where(pressing, laws.surplus, 0.0)
    starts = [first for first, _ in model.segments()]
    softness = [laws.compliance + weight * model.rows.at((first + 0.5) * model.dt).diagonal for first in starts]
    for first, before, after in zip(starts[1:], softness, softness[1:], strict=False):
        if stiffer := [int(p) for p in np.flatnonzero(after < before * (1.0 - 1e-12))]:
            return (
                f"at {first * model.dt:.6g} a drive starts or ends at contact "
                f"{quoted(contact_names(model), stiffer)}: what it stores while closed rises there, and no work goes "
                "with that"
            )
    return ""
