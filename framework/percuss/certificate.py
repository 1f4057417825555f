"""What can be said of stability: the certificate of a run before its first step, and the cause of one that blew up."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contact import SWEEPS
from percuss.errors import InputError
from percuss.judges import BETWEEN, NEVER_GROWS, NOT_GUARANTEED, BlackBoxJudge, Closed, Finding, RowsJudge, closed
from percuss.model import Model
from percuss.pencil import EDGE

if TYPE_CHECKING:
    from percuss.case import Case
    from percuss.march import March

UNSOLVED = "one of these contacts joins masses too unlike: drop one of them, or refine the heavier side"
NOT_STARTED = "the certificate says no, so no step was made"
LEAST = 1e-4  # of the free step: a smaller critical one counts as none
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
    limit = np.inf
    while True:  # a run of so many steps ends the sooner the shorter they are, and with it what its drives hold
        judge = judge_of(model, closed(model, model.dt))
        critical = judge.critical()
        # growth so slow that a single tiny step does not show it is no stability
        if not LEAST * judge.free < critical < np.inf or not judge.judge(SAFETY * critical).known:
            message, advice = "expected methods of which some step is stable", "Give a step, or take another law."
            raise InputError([case.problem(("time", "courant"), message, advice)])
        if critical >= limit * (1.0 - EDGE):
            return model
        limit = critical
        model = Model(case, SAFETY * critical)


def judge_of(model: Model, said: Closed) -> RowsJudge | BlackBoxJudge:
    """Return the judge of a model: its laws' rows where what they `said` is enough, else the step itself."""
    return BlackBoxJudge(model) if said.unknown else RowsJudge(model)


def certificate(model: Model) -> dict[str, Any]:
    """Return the certificate of a run.

    Parameters
    ----------
    model
        The case as arrays.

    Returns
    -------
    dict
        ``stable`` (yes, marginal, no, unknown; of the closed linear step), ``energy`` (what the pair guarantees over
        switching) and ``energy_why``, ``dt_critical``, ``dt_critical_free``, ``courant_critical``, ``margin`` (dt over
        the critical one), ``worst`` (the contacts closed in the worst combination), ``theta``, ``by`` (pencil or
        black-box), ``why``, ``cure``, ``ignores`` (sentences: which laws take no account of contacts at the same end).
    """
    said = closed(model, model.dt)
    judge = judge_of(model, said)
    free, critical = judge.free, judge.critical()
    found = judge.judge(model.dt)
    if found.known and np.isnan(critical):
        found = dataclasses.replace(found, known=False, doubt="the closed step is not linear at longer steps")
    critical = critical if found.known else free
    margin = model.dt / critical if critical > 0 else np.inf
    if found.stable and not found.worst and critical < free * (1.0 - EDGE):  # what becomes unstable first
        found = dataclasses.replace(found, worst=judge.judge(critical * (1.0 + 1e-5)).worst)
    verdict, why = _verdict(model, found, free, critical, margin)
    energy, energy_why = said.energy, said.why
    if energy in {NEVER_GROWS, BETWEEN} and (verdict == "no" or (found.theta is not None and found.theta >= 1.0)):
        more = ", with theta below 1" if found.theta is not None else ""
        energy, energy_why = NOT_GUARANTEED, f"that takes a stable closed step{more}"
    return {
        "stable": verdict,
        "energy": energy,
        "energy_why": energy_why,
        "dt_critical": critical,
        "dt_critical_free": free,
        "courant_critical": 0.5 * critical * model.omega,
        "margin": margin,
        "worst": [model.meetings[p].name for p in found.worst],
        "theta": found.theta,
        "by": judge.by,
        "why": why,
        "cure": _cure(judge, critical) if verdict == "no" else "",
        "ignores": model.ignored_couplings(),
    }


def _verdict(model: Model, found: Finding, free: float, critical: float, margin: float) -> tuple[str, str]:
    """Return the verdict on the closed linear step, and the reason in words."""
    if model.dt > free * (1.0 + EDGE):
        courant = f"Courant number {model.courant:.6g}"
        return "no", f"the step {model.dt:.6g} ({courant}) is above {free:.6g}, what the bodies allow without contact"
    if not found.known:
        return "unknown", f"{found.doubt}; without contact the bodies allow {free:.6g}"
    names = ", ".join(f"'{model.meetings[p].name}'" for p in found.worst)
    combination = f"with closed contact {names}" if found.worst else "with all contacts open"
    told = f"; theta = {found.theta:.6g}" if found.theta is not None else ""
    told += f" ({found.doubt})" if found.doubt else ""
    if margin > 1.0 + EDGE:
        digits = 6 if margin > 1.0 + 1e-5 else 12
        above = f"the step {model.dt:.{digits}g} is above {critical:.{digits}g}"
        return "no", f"{above}, the critical step {combination}{told}"
    if margin >= 1.0 - EDGE:
        return "marginal", f"the step is the critical one {combination}{told}"
    return "yes", f"the step is {margin:.6g} of {critical:.6g}, the critical step {combination}{told}"


def _cure(judge: RowsJudge | BlackBoxJudge, critical: float) -> str:
    """Return the cheapest cures of an unstable step, with their numbers."""
    model = judge.model
    cures = []
    if critical > 0:
        cures.append(f"lower the step to {_down(critical)} (Courant number {_down(0.5 * critical * model.omega)})")
    for entry in model.laws:
        law = entry["law"]
        for option in ("beta_s", "epsilon_s", "ratio", "scale"):
            value = getattr(law, option, None)
            if isinstance(value, float) and isinstance(judge, RowsJudge):
                found = _option_at_most(judge, law, option, value)
                if found is not None:
                    cures.append(f"set {option} of {law.name} to at most {_down(found)}")
    return ", or ".join(cures) or "take another law: with this one no step is stable"


def _down(value: float) -> str:
    """Return a number in six digits, rounded down: what is told as a cure must be one."""
    digit = 10.0 ** (np.floor(np.log10(value)) - 5)
    return f"{np.floor(value * (1.0 - 1e-9) / digit) * digit:.6g}"


def _option_at_most(judge: RowsJudge, law: Any, option: str, value: float) -> float | None:
    """Return the largest value of a law's option below the present one with which the step is stable."""
    model = judge.model
    kept = model.laws

    def holds(candidate: float) -> bool:
        other = dataclasses.replace(law, **{option: candidate})
        model.laws = [{**entry, "law": other} if entry["law"] is law else entry for entry in kept]
        try:
            return judge.judge(model.dt).stable
        finally:
            model.laws = kept

    if not holds(value * 1e-9):
        return None
    lo, hi = value * 1e-9, value
    for _ in range(60):
        middle = float(np.sqrt(lo * hi))
        lo, hi = (middle, hi) if holds(middle) else (lo, middle)
    return lo


def not_started(model: Model, known: dict[str, Any]) -> dict[str, Any]:
    """Return step, time, node and cause of a run that its certificate forbids, as `likely_cause` does of one."""
    worst = [meeting.nodes[0] for meeting in model.meetings if meeting.name in known["worst"]]
    body = max(model.bodies.values(), key=lambda one: float(one.frequency.max()))
    node = worst[0] if worst else body.start + int(np.argmax(body.frequency))
    return _stop(model, 0, node, NOT_STARTED, f"{known['why']}: {known['cure']}")


def _cause(model: Model, *, by_contact: bool) -> str:
    """Return why a run blew up: what the certificate says, where it says no."""
    known = certificate(model)
    if known["stable"] == "no":
        return f"{known['why']}: {known['cure']}"
    if known["stable"] == "marginal" and not by_contact:
        return "at the critical step the highest frequency of a bar with free ends grows with time: lower it"
    if by_contact:
        return "contact adds energy each time it closes or opens; this pair of methods gives no bound on it"
    return f"unknown: {known['why']}"


def likely_cause(march: March, step: int, *, by_contact: bool, unsolved: bool = False) -> dict[str, Any]:
    """Return step, time, node and likely cause of a run that was stopped.

    Parameters
    ----------
    march
        The run, as it stands after the step.
    step
        The step after which it was stopped.
    by_contact
        Whether the work of the contacts ran away, rather than the bodies' own energy.
    unsolved
        Whether the sweeps over contacts that share an end did not converge.
    """
    model = march.model
    finite = np.isfinite(march.u) & np.isfinite(march.v)
    points = march.few.points
    closed = [p for p in range(points.size) if points[p].multiplier != 0.0]
    node = _worst_node(march, finite, closed if by_contact or unsolved else [])
    energy = "the work of the contacts" if by_contact else "the kinetic energy"
    what = f"{energy} exceeds all energy put in many times"
    if not finite.all():
        what = "a value is no longer finite"
    elif unsolved:
        what = f"the equation of contacts that share an end was not solved in {SWEEPS} sweeps"
    return _stop(model, step, node, what, UNSOLVED if unsolved else _cause(model, by_contact=by_contact))


def _stop(model: Model, step: int, node: int, what: str, cause: str) -> dict[str, Any]:
    body = model.body_of(node)
    return {
        "step": step,
        "time": step * model.dt,
        "node": node,
        "body": body.name,
        "node_in_body": node - body.start,
        "position": [float(x) for x in model.nodes[node]],
        "what": what,
        "cause": cause,
    }


def _worst_node(march: March, finite: Any, closed: list[int]) -> int:
    if not finite.all():
        return int(np.argmin(finite)) // march.dim
    if closed:
        few = march.few
        worst = max(closed, key=lambda p: abs(few.points[p].multiplier))
        return int(few.special[few.entries[few.points[worst].start].place].dof) // march.dim
    return int(np.argmax(np.abs(march.v))) // march.dim
