"""The certificate of a run: what can be said of its stability before its first step."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.certificate.closed_contacts import BETWEEN, NEVER_GROWS, NOT_GUARANTEED, ClosedContacts, closed_contacts
from percuss.certificate.criteria import BlackBoxCriterion, Finding, PencilCriterion, RunCriterion, named
from percuss.certificate.cures import capital, cure_of, down, no_step
from percuss.certificate.pencil import EDGE
from percuss.errors import InputError
from percuss.solver.bodies import tangent_as_declared
from percuss.solver.model import Model

if TYPE_CHECKING:
    from percuss.case.case import Case

LEAST = 1e-4  # of the free step: a smaller critical one counts as none
ABOVE = 1e-6  # by so much above the critical step it is asked which contacts limit it
SAFETY = 0.9  # of the critical step, where the case leaves the step open


def settled(case: Case) -> Model:
    """Return the model of a case, its step chosen where the case leaves it open: `SAFETY` of the critical one.

    Raises
    ------
    InputError
        If the case is wrong, or no step is stable.
    """
    model = Model(case)
    if case.time.courant != "auto":
        return model
    if model.why_not_linear:
        message = f"expected linear bodies, found that {model.why_not_linear}"
        advice = "The highest frequency changes with the strain, so that no step is known to be stable: give one."
        raise InputError([case.problem(("time", "courant"), message, advice)])
    limit = np.inf
    while True:  # a run of so many steps ends the sooner the shorter they are, and with it what its drives hold
        judge = criterion_of(model)
        critical = judge.critical()
        chosen = judge.judge(SAFETY * critical) if 0.0 < critical < np.inf else Finding(False, known=False)
        # growth so slow that a single tiny step does not show it is no stability
        if not LEAST * judge.free < critical < np.inf or not (chosen.known or chosen.stable):
            message = "expected methods of which some step is known to be stable"
            advice = f"{capital(no_step(model, judge.free))}." if critical == 0.0 else "Give a step."
            raise InputError([case.problem(("time", "courant"), message, advice)])
        if critical >= limit * (1.0 - EDGE):
            return model
        limit = critical
        model = Model(case, SAFETY * critical)


def criterion_of(model: Model) -> RunCriterion:
    """Return the judge of a run: the rows of its laws where they are enough, else the step itself."""
    return RunCriterion(model, BlackBoxCriterion if closed_contacts(model, model.dt).unknown else PencilCriterion)


def certificate(model: Model) -> dict[str, Any]:
    """Return the certificate of a run.

    Every stretch of the run with its own supports, drives and acting laws is judged, and the worst of them speaks.

    Parameters
    ----------
    model
        The case as arrays.

    Returns
    -------
    dict
        ``stable`` (yes, marginal, no, unknown; of the closed linear step), ``energy`` (what the pair guarantees over
        switching) and ``energy_why``, ``dt_critical`` (None where it is not known), ``dt_critical_free``,
        ``courant_critical``, ``margin`` (dt over the critical one), ``worst`` (closed contacts that limit the step),
        ``stretch`` (from and until when the supports and drives hold that it is about; None where they never change),
        ``theta``, ``by`` (pencil or black-box), ``why``, ``cure``, ``ignores`` (sentences: which laws take no
        account of contacts at the same end). Of bodies that are not linear the critical steps are None: they change
        with the strain.
    """
    if model.why_not_linear:
        return _of_bodies_not_linear(model)
    judge = criterion_of(model)
    free, critical = judge.free, judge.critical()
    finding = judge.judge(model.dt)
    if finding.known and np.isnan(critical) and judge.by == BlackBoxCriterion.by:
        finding = dataclasses.replace(finding, known=False, doubt="the closed step is not linear at longer steps")
    if finding.known and finding.stable and not np.isnan(critical):
        critical = max(critical, min(model.dt, free))
    if finding.known and 0.0 < critical < free * (1.0 - EDGE):
        # the contacts that limit the step are those that are unstable just above it
        limiting = judge.judge(critical * (1.0 + ABOVE))
        if not limiting.stable and limiting.known:
            finding = dataclasses.replace(finding, worst=limiting.worst, stretch=limiting.stretch)
    if not finding.known or (not finding.stable and critical > model.dt * (1.0 + EDGE)):
        critical = np.nan  # a longer step may be stable where this one is not
    verdict, why = _verdict(judge, finding, free, critical)
    energy, energy_why = _energy(judge, finding, verdict)
    stretch = judge.stretches[finding.stretch]
    return {
        "stable": verdict,
        "energy": energy,
        "energy_why": energy_why,
        "dt_critical": None if np.isnan(critical) else critical,
        "dt_critical_free": free,
        "courant_critical": None if np.isnan(critical) else 0.5 * critical * model.omega,
        "margin": None if np.isnan(critical) else model.dt / critical if critical > 0 else np.inf,
        "worst": [model.contact_pairs[p].name for p in finding.worst],
        "stretch": [stretch.start, stretch.stop] if len(judge.stretches) > 1 else None,
        "theta": finding.theta,
        "by": judge.by,
        "why": why,
        "cure": (finding.cure or cure_of(judge, critical)) if verdict == "no" else "",
        "ignores": model.ignored_couplings(),
    }


def _of_bodies_not_linear(model: Model) -> dict[str, Any]:
    """Return the certificate of a run with bodies that are not linear.

    Their highest frequency changes with the strain, so that no step is known to be stable. A step that is unstable for
    small motions about rest is known to be unstable, where the bodies about rest are as stiff as they declare.
    """
    laws = closed_contacts(model, model.dt)
    out: dict[str, Any] = {
        "stable": "unknown",
        "energy": laws.energy,
        "energy_why": laws.why,
        **dict.fromkeys(("dt_critical", "dt_critical_free", "courant_critical", "margin", "stretch")),
        "worst": [],
        "theta": None,
        "by": "none",
        "why": f"{model.why_not_linear}, and its highest frequency changes with the strain",
        "cure": "",
        "ignores": model.ignored_couplings(),
    }
    if laws.unknown or not tangent_as_declared(model):
        return out
    judge = criterion_of(model)
    finding, critical = judge.judge(model.dt), judge.critical()
    about_rest, why = _verdict(judge, finding, judge.free, critical)
    if about_rest == "no":
        lower = f"lower the step below {down(critical)}, the critical step of small motions about rest"
        out |= {"stable": "no", "by": judge.by, "why": f"for small motions about rest {why}"}
        out["cure"] = lower if critical > 0 else no_step(model, judge.free)
        out["worst"], out["theta"] = [model.contact_pairs[p].name for p in finding.worst], finding.theta
    else:
        out["why"] += f"; for small motions about rest {why}"
    return out


def _verdict(judge: RunCriterion, finding: Finding, free: float, critical: float) -> tuple[str, str]:
    """Return the verdict on the closed linear step, and the reason in words."""
    model = judge.model
    if free == 0.0:
        return "no", f"{model.case.method.integrator.name} is unstable at any step, without contact too"
    if model.dt > free * (1.0 + EDGE):
        courant = f"Courant number {model.courant:.6g}"
        return "no", f"the step {model.dt:.6g} ({courant}) is above {free:.6g}, what the bodies allow without contact"
    when = ""
    if len(judge.stretches) > 1:
        stretch = judge.stretches[finding.stretch]
        when = f", with the supports and drives from {stretch.start:.6g} to {stretch.stop:.6g}"
    if not finding.known:
        return "unknown", f"{finding.doubt}{when}; without contact the bodies allow {free:.6g}"
    many = "contacts" if len(finding.worst) > 1 else "contact"
    combination = f"with closed {many} {named(model, finding.worst)}" if finding.worst else "with all contacts open"
    more = f"; theta = {finding.theta:.6g}" if finding.theta is not None else ""
    more += f" ({finding.doubt})" if finding.doubt else ""
    return _against(model.dt, critical, f"{combination}{when}{more}", stable=finding.stable)


def _against(dt: float, critical: float, combination: str, *, stable: bool) -> tuple[str, str]:
    """Return the verdict that follows from a step and the critical one, which is nan where it was not searched for."""
    margin = np.inf if critical <= 0.0 else dt / critical  # nan compares as neither above nor below
    if margin > 1.0 + EDGE:
        digits = 6 if margin > 1.0 + 1e-5 else 12
        return "no", f"the step {dt:.{digits}g} is above {critical:.{digits}g}, the critical step {combination}"
    if margin >= 1.0 - EDGE:
        return "marginal", f"the step is the critical one {combination}"
    if not stable:
        return "no", f"the step {dt:.6g} is unstable {combination}"
    if np.isnan(critical):
        return (
            "yes",
            f"at the step {dt:.6g} nothing grows in any set of closed contacts; the critical step is not known",
        )
    return "yes", f"the step is {margin:.6g} of {critical:.6g}, the critical step {combination}"


def _energy(judge: RunCriterion, finding: Finding, verdict: str) -> tuple[str, str]:
    """Return what the pair of methods guarantees of the energy in this run, and the reason in words."""
    model = judge.model
    laws = closed_contacts(model, model.dt)
    if laws.energy in {NEVER_GROWS, BETWEEN}:
        if verdict == "no" or (finding.theta is not None and finding.theta >= 1.0):
            more = ", with theta below 1" if finding.theta is not None else ""
            return NOT_GUARANTEED, f"that takes a stable closed step{more}"
        if laws.energy == NEVER_GROWS and (jump := _stiffening(model, laws)):
            return NOT_GUARANTEED, jump
    return laws.energy, laws.why


def _stiffening(model: Model, laws: ClosedContacts) -> str:
    """Return the words for a contact that a change of supports stiffens at the end of the step, "" for none.

    ``kappa = 1 / (1/eps_s + (eps_m/eps_s - dt^2) s)`` rises with s where eps_m / eps_s is below dt^2, and falls with it
    above. The energy that a closed contact stores rises with kappa, and no work goes with that.
    """
    soft = laws.predicted & (laws.stiffness > 0)
    before: Any = None
    for first, _ in model.segments():
        after = laws.compliance + np.where(soft, laws.surplus, 0.0) * model.delassus((first + 0.5) * model.dt)
        stiffer = [] if before is None else [int(p) for p in np.flatnonzero(after < before * (1.0 - 1e-12))]
        if stiffer:
            return (
                f"at {first * model.dt:.6g} a drive starts or ends at contact {named(model, stiffer)}: what it "
                "stores while closed rises there, and no work goes with that"
            )
        before = after
    return ""
