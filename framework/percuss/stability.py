"""What can be said of stability: the certificate of a run before its first step, and the cause of one that blew up."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contact import SWEEPS, broadcast, delassus_rows
from percuss.contracts import Rows
from percuss.pencil import EDGE, Pencil, largest

if TYPE_CHECKING:
    from percuss.contracts import Floats
    from percuss.march import March
    from percuss.model import Model

UNSOLVED = "one of these contacts joins masses too unlike: drop one of them, or refine the heavier side"
NEVER_GROWS, BETWEEN = "never grows", "conserved between switchings"
NOT_GUARANTEED, UNKNOWN = "not guaranteed", "unknown"
WEAKEST_LAST = (NEVER_GROWS, BETWEEN, NOT_GUARANTEED, UNKNOWN)


@dataclass(frozen=True)
class Closed:
    """What the laws of a model say of its points at one step; (P,) each, in the order of the case.

    Attributes
    ----------
    stiffness, inertia
        eps_s and eps_m; zero where a law is judged at the end of the step.
    predicted
        Whether the law is judged at the predicted gap.
    unknown
        Names of laws of which the rows say nothing: a kernel of their own, or a weight on the gap rate.
    energy
        What the pair guarantees of the energy, the weakest of all contacts.
    """

    stiffness: Floats
    inertia: Floats
    predicted: Any
    unknown: tuple[str, ...]
    energy: str


def closed(model: Model, dt: float) -> Closed:
    """Return what the laws of a model say of its closed points for a step `dt`."""
    count = len(model.meetings)
    stiffness, inertia = np.zeros(count), np.zeros(count)
    predicted = np.zeros(count, dtype=bool)
    unknown: list[str] = []
    energy = [NEVER_GROWS if count else BETWEEN]
    table = model.case.method.integrator.bind(dt)
    for entry in model.laws:
        law, where = entry["law"], entry["where"]
        bound = law.bind(entry["points"], dt)
        if not isinstance(bound, Rows):
            unknown.append(law.name)
            continue
        rows = broadcast(bound, entry["points"], law.name)
        if rows["at"] == "end":
            held = rows["active"] == "all" and rows["sign"] == ">= 0" and not rows["rate"].any()
            if not held:
                unknown.append(law.name)
            continue
        if rows["rate"].any() or (rows["sigma"] <= 0).any():
            unknown.append(law.name)
            continue
        stiffness[where] = rows["gap"] / rows["sigma"]
        predicted[where] = table.explicit.gap == "predicted"
        answered = table.explicit.answer[2] if table.explicit.gap == "predicted" else 1.0
        inertia[where] = rows["acceleration"] / rows["sigma"] * answered
        if table.explicit.gap == "current":
            energy.append(NOT_GUARANTEED if inertia[where].any() else BETWEEN)
    if unknown:
        energy.append(UNKNOWN)
    return Closed(stiffness, inertia, predicted, tuple(unknown), max(energy, key=WEAKEST_LAST.index))


class Judge:
    """Judges steps of one model.

    Parameters
    ----------
    model
        The case as arrays.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.pencil = Pencil(model)
        diagonal, others = delassus_rows(model.sides(0.5 * model.dt))
        self.delassus = np.diag(diagonal)
        for p, row in enumerate(others):
            for q, value in row.items():
                self.delassus[p, q] = value

    def theta(self, dt: float, said: Closed) -> float | None:
        """Return ``dt^2 lambda_max((I + S D_m)^-1 S D_s)`` of the contacts judged at the predicted gap, or None."""
        which = np.flatnonzero(said.predicted & (said.stiffness > 0))
        if which.size == 0:
            return None
        s = self.delassus[np.ix_(which, which)]
        left = np.eye(which.size) + s * said.inertia[which]
        values = np.linalg.eigvals(np.linalg.solve(left, s * said.stiffness[which]))
        return float(dt**2 * np.max(values.real))

    def stable(self, dt: float, *, contacts: bool = True) -> tuple[bool, list[int]]:
        """Return whether a step is stable, and the contacts closed in the worst combination."""
        said = closed(self.model, dt) if contacts else None
        nothing = np.zeros(len(self.model.meetings))
        current = ~said.predicted if said is not None else nothing.astype(bool)
        stiffness = np.where(current, said.stiffness, 0.0) if said is not None else nothing
        inertia = np.where(current, said.inertia, 0.0) if said is not None else nothing
        definite, worst = self.pencil.definite(dt, stiffness, inertia)
        theta = self.theta(dt, said) if said is not None else None
        if theta is not None and theta > 1.0:
            return False, [int(p) for p in np.flatnonzero(said.predicted & (said.stiffness > 0))]  # type: ignore[union-attr]
        return definite, worst

    @cached_property
    def free(self) -> float:
        """The largest step that is stable without contact."""
        return largest(lambda dt: self.stable(dt, contacts=False)[0], 2.0 / self.model.omega)

    def critical(self) -> float:
        """Return the largest stable step, laws bound anew for each step tried."""
        if self.stable(self.free * (1.0 - 0.1 * EDGE))[0]:
            return self.free
        return largest(lambda dt: self.stable(dt)[0], 2.0 / self.model.omega)


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
        switching), ``dt_critical``, ``dt_critical_free``, ``margin`` (dt over the former), ``worst`` (the contacts
        closed in the worst combination), ``theta``, ``why``, ``cure``.
    """
    judge = Judge(model)
    said = closed(model, model.dt)
    free = judge.free
    critical = free if said.unknown else judge.critical()
    worst = judge.stable(model.dt)[1] if model.dt <= free * (1.0 + EDGE) else []
    margin = model.dt / critical if critical > 0 else np.inf
    theta = judge.theta(model.dt, said)
    verdict, why = _verdict(model, said, free, critical, margin, worst, theta)
    energy = said.energy
    if verdict == "no" and energy in {NEVER_GROWS, BETWEEN}:
        energy = NOT_GUARANTEED
    return {
        "stable": verdict,
        "energy": energy,
        "dt_critical": critical,
        "dt_critical_free": free,
        "margin": margin,
        "worst": [model.meetings[p].name for p in worst],
        "theta": theta,
        "why": why,
        "cure": _cure(judge, critical) if verdict == "no" else "",
    }


def _verdict(
    model: Model, said: Closed, free: float, critical: float, margin: float, worst: list[int], theta: float | None
) -> tuple[str, str]:
    """Return the verdict on the closed linear step, and the reason in words."""
    if model.dt > free * (1.0 + EDGE):
        courant = f"Courant number {model.courant:.6g}"
        return "no", f"the step {model.dt:.6g} ({courant}) is above {free:.6g}, what the bodies allow without contact"
    if said.unknown:
        laws = ", ".join(said.unknown)
        return "unknown", f"nothing follows from the rows of {laws}; without contact the bodies allow {free:.6g}"
    names = ", ".join(f"'{model.meetings[p].name}'" for p in worst)
    combination = f"with closed contact {names}" if worst else "with all contacts open"
    told = f"; theta = {theta:.6g}" if theta is not None else ""
    if margin > 1.0 + EDGE:
        return "no", f"the step {model.dt:.6g} is above {critical:.6g}, the critical step {combination}{told}"
    if margin >= 1.0 - EDGE:
        return "marginal", f"the step is the critical one {combination}{told}"
    return "yes", f"the step is {margin:.6g} of {critical:.6g}, the critical step {combination}{told}"


def _cure(judge: Judge, critical: float) -> str:
    """Return the cheapest cures of an unstable step, with their numbers."""
    model = judge.model
    cures = [f"lower the step to {critical:.6g} (Courant number {0.5 * critical * model.omega:.6g})"]
    for entry in model.laws:
        law = entry["law"]
        for option in ("beta_s", "epsilon_s", "ratio"):
            value = getattr(law, option, None)
            if isinstance(value, float):
                found = _option_at_most(judge, law, option, value)
                if found is not None:
                    cures.append(f"set {option} of {law.name} to at most {found:.6g}")
    return ", or ".join(cures)


def _option_at_most(judge: Judge, law: Any, option: str, value: float) -> float | None:
    """Return the largest value of a law's option below the present one with which the step is stable."""
    import dataclasses

    model = judge.model
    kept = model.laws

    def holds(candidate: float) -> bool:
        other = dataclasses.replace(law, **{option: candidate})
        model.laws = [{**entry, "law": other} if entry["law"] is law else entry for entry in kept]
        try:
            return judge.stable(model.dt)[0]
        finally:
            model.laws = kept

    if not holds(value * 1e-9):
        return None
    lo, hi = value * 1e-9, value
    for _ in range(60):
        middle = float(np.sqrt(lo * hi))
        lo, hi = (middle, hi) if holds(middle) else (lo, middle)
    return lo


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
    body = model.body_of(node)
    energy = "the work of the contacts" if by_contact else "the kinetic energy"
    what = f"{energy} exceeds all energy put in many times"
    if not finite.all():
        what = "a value is no longer finite"
    elif unsolved:
        what = f"the equation of contacts that share an end was not solved in {SWEEPS} sweeps"
    return {
        "step": step,
        "time": step * model.dt,
        "node": node,
        "body": body.name,
        "node_in_body": node - body.start,
        "position": [float(x) for x in model.nodes[node]],
        "what": what,
        "cause": UNSOLVED if unsolved else _cause(model, by_contact=by_contact),
    }


def _worst_node(march: March, finite: Any, closed: list[int]) -> int:
    if not finite.all():
        return int(np.argmin(finite)) // march.dim
    if closed:
        few = march.few
        worst = max(closed, key=lambda p: abs(few.points[p].multiplier))
        return int(few.special[few.entries[few.points[worst].start].place].dof) // march.dim
    return int(np.argmax(np.abs(march.v))) // march.dim
